# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Recorder that writes messages from its own thread."""
from __future__ import annotations

import atexit
from collections import deque
from collections.abc import Callable, Mapping
import json
import operator
from pathlib import Path
import threading
import time
from typing import Literal, SupportsIndex

from icofabric_sim.bag.bag_file import BagFile
from icofabric_sim.bag.folder import absolute_path, BagError
from icofabric_sim.bag.handover import End, Heading, Message, MessageQueue, RecorderStatistics
from icofabric_sim.bag.storage import (
    CONTINUED,
    definition,
    encode_custom,
    FILE_INDEX,
    quality_of_service,
    REPEATED,
    STOPPED,
    TopicEntry,
)
from icofabric_sim.messages import StringBytes
from icofabric_sim.process.closing import Closing
from rosbags.interfaces import QosDurability

# [s] of wall time. A kill may lose 1 s of a recording: this interval and the time to write.
FLUSH_INTERVAL_S = 0.25
QUEUE_BYTES = 128 * 2**20
CUSTOM_TOPIC = '/icofabric/recording'


class BagRecorder(Closing):
    """
    Recorder of messages to a new rosbag2 bag, written by a separate thread in order.

    The queue to the thread is bounded in bytes. When it is full, `overflow='wait'` lets `write`
    wait (a run without a deadline loses nothing), and `overflow='drop'` rejects and counts the
    message (a live simulation is not slowed by its disk). Essential messages are never dropped:
    for them the limit is twice `queue_bytes`. At that limit `write` waits or, with 'drop', the
    recording ends.

    A disk error ends the recording but not the caller. The error is stored in `error` and passed
    once to `on_error`, usually from the writing thread; later messages count as lost. The data
    recorded before is finished as a complete bag if the disk has room for the final index.

    Custom data is written to the metadata when the bag is closed, and at once as a JSON message on
    `custom_topic`, the first message of the bag, because a killed bag has no metadata.yaml. Each
    further file of a split bag starts with the custom data and the last message of each latched
    topic, so that it can be read alone. BagReader skips these repetitions when it reads the entire
    bag.
    """

    def __init__(
        self, path: str | Path, *,
        storage: str = 'mcap',
        overflow: Literal['wait', 'drop'] = 'wait',
        custom: Mapping[str, str] | None = None,
        custom_topic: str = CUSTOM_TOPIC,
        start: SupportsIndex = 0,
        compression: str = 'none',
        split_size: int = 0,
        split_duration: float = 0.0,
        queue_bytes: int = QUEUE_BYTES,
        flush_interval: float = FLUSH_INTERVAL_S,
        patience: float | None = None,
        on_error: Callable[[BagError], None] | None = None,
    ) -> None:
        """
        Open a new bag; raise BagError with `record.path` and the reason if that is impossible.

        `start` is the simulated time [ns] of the first custom data. A file that exceeds
        `split_size` [bytes] or `split_duration` [s] is followed by another file; 0: no limit.
        `patience` [s] limits the wait for a disk that does not respond; an error after that is
        passed to `on_error` instead of being raised. None: no limit.
        """
        if overflow not in ('wait', 'drop'):
            raise ValueError(f'overflow must be wait or drop, got {overflow!r}')
        if not queue_bytes > 0:
            raise ValueError(f'queue_bytes must be positive, got {queue_bytes!r}')
        if not flush_interval > 0.0:
            raise ValueError(f'flush_interval must be positive, got {flush_interval!r} s')
        if not split_size >= 0:
            raise ValueError(f'split_size must not be negative, got {split_size!r} bytes')
        if not split_duration >= 0.0:
            raise ValueError(f'split_duration must not be negative, got {split_duration!r} s')
        custom = dict(custom or {})
        _check_custom(custom)
        self.path = absolute_path(path)
        self.storage = storage
        self.error: BagError | None = None
        self._custom = custom
        self._custom_topic = custom_topic
        self._flush_interval = flush_interval
        self._on_error = on_error
        self._latest = operator.index(start)
        self._types: dict[str, str] = {}
        self._handover = MessageQueue(queue_bytes, overflow)
        self._failing = threading.Lock()
        self._opened = threading.Event()
        self._awaited = True
        # A daemon thread, so that a program that does not close the bag can end; atexit closes it.
        self._thread = threading.Thread(
            target=self._run, name=f'recorder of {self.path.name}', daemon=True,
            args=(compression, split_size, round(split_duration * 1e9), custom))
        self._thread.start()
        self._opened.wait(patience)
        with self._failing:
            self._awaited = False
            if self.error is not None:
                raise self.error
        atexit.register(self.close)
        if custom:
            self._announce(custom)

    @property
    def survives_kill(self) -> bool:
        """Return whether flushed data can always be recovered after a kill."""
        return self.storage == 'mcap'

    def add_topic(
        self, topic: str, type_name: str, *, latched: bool = False, depth: int | None = None,
    ) -> None:
        """
        Add a topic before its first message; repeated calls have no effect.

        The topic is offered as reliable; if latched, as transient local with depth 1 unless given.
        """
        if depth is not None and not depth > 0:
            raise ValueError(f'depth of {topic} must be positive, got {depth!r}')
        described = definition(type_name)
        known = self._types.get(topic)
        if known == type_name:
            return
        if known is not None:
            raise ValueError(f'{topic} was added as {known}, it cannot also be {type_name}')
        self._types[topic] = type_name
        qos = quality_of_service(latched=latched, depth=depth or (1 if latched else 10))
        self._handover.put_control(TopicEntry(topic, type_name, described, [qos]))

    def write(
        self, topic: str, nanoseconds: SupportsIndex, data: bytes, *, essential: bool = False,
    ) -> bool:
        """
        Queue a message at its simulated time [ns]; return False if it will not be in the bag.
        """
        nanoseconds = operator.index(nanoseconds)
        if not 0 <= nanoseconds < 2**63:
            raise ValueError(f'the time of a message on {topic} must lie in 0 to 2^63 ns, '
                             f'got {nanoseconds}')
        if type(data) is not bytes:  # other types may change while queued
            raise TypeError(f'a message on {topic} must be bytes, got {type(data).__name__}')
        if topic not in self._types:
            raise ValueError(f'{topic} must be added before its first message')
        self._latest = max(self._latest, nanoseconds)
        try:
            return self._handover.put(topic, nanoseconds, data, essential=essential)
        except TimeoutError:
            self._handover.give_up()
            self._fail(BagError(
                f'recording to {self.path} stopped: the disk is too slow, the queue is full '
                f'and {topic} must not be dropped; choose a faster disk, lower rates or '
                'fewer outputs'))
            return False

    def has_room(self, size: int) -> bool:
        """
        Return whether a message of `size` [bytes] that is not essential would be accepted now.
        """
        return self._handover.has_room(size)

    def set_custom(self, key: str, value: str) -> None:
        """Set an entry of the custom data, in the metadata and as a message."""
        _check_custom({key: value})
        self._custom = {**self._custom, key: value}  # the writing thread may read the old one
        self._handover.put_control(Heading(key, value))
        self._announce({key: value})

    def set_heading(self, key: str, value: str) -> None:
        """Set one custom entry of later files only; `set_custom` also sets it in this file."""
        _check_custom({key: value})
        self._handover.put_control(Heading(key, value))

    @property
    def statistics(self) -> RecorderStatistics:
        return self._handover.statistics

    def close(self, patience: float | None = None) -> bool:
        """
        Write the queue and finish the bag; a second call has no effect.

        Return False if this takes longer than `patience` [s]; closing continues, and another call
        may wait for it.
        """
        self._handover.end()
        if threading.current_thread() is not self._thread:  # `on_error` may also close
            self._thread.join(patience)
            if self._thread.is_alive():
                return False
            atexit.unregister(self.close)
        return True

    def _announce(self, custom: dict[str, str]) -> None:
        self.add_topic(self._custom_topic, StringBytes.TYPE, latched=True)
        self.write(self._custom_topic, self._latest, encode_custom(custom), essential=True)

    def _run(
        self, compression: str, split_size: int, split_duration: int, custom: dict[str, str],
    ) -> None:
        """Open, fill and close the bag, all in this thread, as SQLite requires."""
        try:
            file = BagFile(
                self.path, self.storage, compression=compression, split_size=split_size,
                split_duration=split_duration, custom=custom)
        except BagError as error:
            with self._failing:
                if self._awaited:
                    self.error = error  # raised by the constructor
            if self.error is None:
                self._handover.give_up(written=0)
                self._fail(error)
            self._opened.set()
            return
        self._opened.set()
        writing = _BagWriter(file, self._custom_topic, dict(custom))
        try:
            self._write_all(writing)
            file.close(self._custom)
        except Exception as error:
            # The simulation continues after any error, which is reported.
            said = (error.strerror if isinstance(error, OSError) else str(error)) or repr(error)
            whole = file.salvage({**self._custom, STOPPED: said})
            self._handover.give_up(written=max(0, file.message_count - writing.extra))
            self._fail(self._describe_error(error, said, whole))

    def _write_all(self, writing: _BagWriter) -> None:
        flush_due: float | None = None  # None while everything is on the disk
        while not isinstance(item := self._handover.take(flush_due), End):
            if isinstance(item, Message):
                writing.write(item)
                if flush_due is None:
                    flush_due = time.monotonic() + self._flush_interval
            elif isinstance(item, TopicEntry):
                writing.add_topic(item)
            elif item is not None:
                writing.heading[item.key] = item.value
            if flush_due is not None and time.monotonic() >= flush_due:
                writing.file.flush()
                flush_due = None

    def _describe_error(self, reason: Exception, said: str, whole: bool) -> BagError:
        way_out = 'make room or choose another record.path'
        if self.statistics.written:
            way_out += ('; the data recorded before is a complete bag' if whole else
                        f'; `icofabric recover {self.path}` saves the data recorded before')
        error = BagError(f'recording to {self.path} stopped: {said}; {way_out}')
        error.__cause__ = reason
        return error

    def _fail(self, error: BagError) -> None:
        with self._failing:
            if self.error is not None:
                return  # reported once
            self.error = error
        if self._on_error is not None:
            self._on_error(error)


class _BagWriter:
    """Bag as filled by the writing thread, file after file."""

    def __init__(self, file: BagFile, custom_topic: str, heading: dict[str, str]) -> None:
        self.file, self.heading = file, heading
        self.extra = 0  # messages added by the recorder
        self._custom_topic = custom_topic
        self._part = self._latest = 0
        self._latched: dict[str, deque[bytes]] = {}  # messages for late subscribers

    def add_topic(self, topic: TopicEntry) -> None:
        self.file.add_topic(topic)
        (qos,) = topic.qos
        if qos.durability is QosDurability.TRANSIENT_LOCAL and topic.name != self._custom_topic:
            self._latched[topic.name] = deque(maxlen=qos.depth)

    def write(self, message: Message) -> None:
        if self.file.must_split(message.nanoseconds):
            self._begin_file(message.nanoseconds)
        self.file.write(message.topic, message.nanoseconds, message.data)
        self._latest = max(self._latest, message.nanoseconds)
        if message.topic in self._latched:
            self._latched[message.topic].append(message.data)

    def _begin_file(self, nanoseconds: int) -> None:
        """
        Split the bag; custom data in each file link it to the others and repeat latched messages.
        """
        if self.heading:
            said = encode_custom({CONTINUED: self.file.next_name})
            self._add(self._custom_topic, self._latest, said)
        self.file.split()
        self._part, self._latest = self._part + 1, nanoseconds
        if not self.heading:
            return
        counts = {topic: len(kept) for topic, kept in self._latched.items() if kept}
        self._add(self._custom_topic, nanoseconds, encode_custom(
            {**self.heading, FILE_INDEX: str(self._part), REPEATED: json.dumps(counts)}))
        for topic, kept in self._latched.items():
            for data in kept:
                self._add(topic, nanoseconds, data)

    def _add(self, topic: str, nanoseconds: int, data: bytes) -> None:
        self.file.write(topic, nanoseconds, data)
        self.extra += 1


def _check_custom(custom: Mapping[str, str]) -> None:
    for key, value in custom.items():
        if not (type(key) is str and type(value) is str):
            raise TypeError(f'custom data must be text, got {key!r}: {value!r}')
