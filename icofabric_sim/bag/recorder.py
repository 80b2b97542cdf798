# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Recording beside the simulation: messages are handed over, a thread of its own writes them.
"""
from __future__ import annotations

import atexit
from collections.abc import Callable, Mapping
import operator
from pathlib import Path
import threading
import time
from types import TracebackType
from typing import Literal, Self, SupportsIndex

from icofabric_sim.bag.handover import End, Handover, Message, NewTopic, RecorderStatistics
from icofabric_sim.bag.storage import (
    absolute_path,
    BagError,
    BagFile,
    definition,
    encode_custom,
    quality_of_service,
)
from icofabric_sim.messages import StringBytes

# [s] of wall time: a killed recording may lose a second, and the writing takes part of it.
FLUSH_INTERVAL = 0.5
QUEUE_BYTES = 128 * 2**20
CUSTOM_TOPIC = '/icofabric/recording'


class BagRecorder:
    """
    Writes messages to a new rosbag2 bag from a thread of its own, in the order handed over.

    The queue between is bounded in bytes. When it is full, `overflow='wait'` makes `write` wait
    (a run without a deadline loses nothing), `overflow='drop'` refuses the message and counts it
    (a live simulation is not slowed by its disk). Essential messages are never dropped: they may
    fill the queue a second time over, and wait only then.

    An error of the disk ends the recording, never the caller: it is kept in `error`, told once to
    `on_error` (from the writing thread), and messages after it are counted as lost.

    Custom data goes to the metadata when the bag is closed, and at once into a message of JSON on
    `custom_topic`, the first of the bag: a bag that is killed has no metadata.
    """

    def __init__(
        self, path: str | Path, *,
        storage: str = 'mcap',
        overflow: Literal['wait', 'drop'] = 'wait',
        custom: Mapping[str, str] | None = None,
        custom_topic: str = CUSTOM_TOPIC,
        start: SupportsIndex = 0,
        queue_bytes: int = QUEUE_BYTES,
        flush_interval: float = FLUSH_INTERVAL,
        on_error: Callable[[BagError], None] | None = None,
    ) -> None:
        """
        Open a new bag; where that is not possible, BagError names `record.path` and the reason.

        `start` is the simulated time [ns] at which the first custom data is written.
        """
        if overflow not in ('wait', 'drop'):
            raise ValueError(f'overflow must be wait or drop, got {overflow!r}')
        if not queue_bytes > 0:
            raise ValueError(f'queue_bytes must be positive, got {queue_bytes!r}')
        if not flush_interval > 0.0:
            raise ValueError(f'flush_interval must be positive, got {flush_interval!r} s')
        custom = dict(custom or {})
        _check_custom(custom)
        self.path = absolute_path(path)
        self.storage = storage
        self.error: BagError | None = None
        self.survives_kill = False  # whether what was flushed can always be recovered
        self._custom = custom
        self._custom_topic = custom_topic
        self._flush_interval = flush_interval
        self._on_error = on_error
        self._latest = operator.index(start)
        self._types: dict[str, str] = {}
        self._handover = Handover(queue_bytes, overflow)
        self._opened = threading.Event()
        # A daemon, so that a program that ends without closing does not hang; atexit closes it.
        self._thread = threading.Thread(
            target=self._run, name=f'recorder of {self.path.name}', daemon=True)
        self._thread.start()
        self._opened.wait()
        if self.error is not None:
            self._thread.join()
            raise self.error
        atexit.register(self.close)
        if custom:
            self._announce(custom)

    def add_topic(
        self, topic: str, type_name: str, *, latched: bool = False, depth: int | None = None,
    ) -> None:
        """
        Add a topic before its first message; the same topic again changes nothing.

        It is offered reliable; latched: transient local, with depth 1 unless given.
        """
        if depth is not None and not depth > 0:
            raise ValueError(f'depth of {topic} must be positive, got {depth!r}')
        described = definition(type_name)
        known = self._types.setdefault(topic, type_name)
        if known != type_name:
            raise ValueError(f'{topic} was added as {known}, it cannot also be {type_name}')
        qos = quality_of_service(latched=latched, depth=depth or (1 if latched else 10))
        self._handover.put_topic(NewTopic(topic, type_name, described, qos))

    def write(
        self, topic: str, nanoseconds: SupportsIndex, data: bytes, *, essential: bool = False,
    ) -> bool:
        """
        Hand over a message at its simulated time [ns]; False when it will not be in the bag.
        """
        nanoseconds = operator.index(nanoseconds)
        if not 0 <= nanoseconds < 2**63:
            raise ValueError(f'the time of a message on {topic} must lie in 0 to 2^63 ns, '
                             f'got {nanoseconds}')
        if type(data) is not bytes:  # others may still change while they wait
            raise TypeError(f'a message on {topic} must be bytes, got {type(data).__name__}')
        if topic not in self._types:
            raise ValueError(f'{topic} must be added before its first message')
        self._latest = max(self._latest, nanoseconds)
        return self._handover.put(topic, nanoseconds, data, essential=essential)

    def set_custom(self, key: str, value: str) -> None:
        """
        Set one entry of the custom data, in the metadata and as a message of its own.
        """
        _check_custom({key: value})
        self._custom = {**self._custom, key: value}  # the writing thread may read the old one
        self._announce({key: value})

    @property
    def statistics(self) -> RecorderStatistics:
        return self._handover.statistics

    def close(self) -> None:
        """
        Write what is queued and finish the bag; a second call changes nothing.
        """
        self._handover.end()
        if threading.current_thread() is not self._thread:  # `on_error` may close too
            self._thread.join()
            atexit.unregister(self.close)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _announce(self, custom: dict[str, str]) -> None:
        self.add_topic(self._custom_topic, StringBytes.TYPE, latched=True)
        self.write(self._custom_topic, self._latest, encode_custom(custom), essential=True)

    def _run(self) -> None:
        """
        Open, fill and close the bag: all in this thread, as SQLite demands.
        """
        try:
            file = BagFile(self.path, self.storage)
            self.survives_kill = file.survives_kill
        except BagError as error:
            self.error = error
            return
        finally:
            self._opened.set()
        try:
            self._write_all(file)
            file.close(self._custom)
        except Exception as error:
            # Whatever it is, the simulation goes on and must hear of it.
            file.abandon()
            self._fail(error)

    def _write_all(self, file: BagFile) -> None:
        known: set[str] = set()
        flush_due: float | None = None  # None while all that was written is on the disk
        while not isinstance(item := self._handover.take(flush_due), End):
            if isinstance(item, Message):
                file.write(item.topic, item.nanoseconds, item.data)
                if flush_due is None:
                    flush_due = time.monotonic() + self._flush_interval
            elif item is not None and item.name not in known:
                known.add(item.name)
                file.add_topic(item.name, item.type_name, item.described, [item.qos])
            if flush_due is not None and time.monotonic() >= flush_due:
                file.flush()
                flush_due = None

    def _fail(self, reason: Exception) -> None:
        way_out = 'make room or choose another record.path'
        if self.statistics.written:
            way_out += f'; `icofabric recover {self.path}` saves what was recorded until then'
        text = reason.strerror if isinstance(reason, OSError) else str(reason)
        error = BagError(f'recording to {self.path} stopped: {text or repr(reason)}; {way_out}')
        error.__cause__ = reason
        self.error = error
        self._handover.fail()
        if self._on_error is not None:
            self._on_error(error)


def _check_custom(custom: Mapping[str, str]) -> None:
    for key, value in custom.items():
        if not (type(key) is str and type(value) is str):
            raise TypeError(f'custom data must be text, got {key!r}: {value!r}')
