# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Recovery of a bag whose recorder was killed or ran out of disk space."""
from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
from pathlib import Path
import shutil
import sqlite3
import tempfile
from typing import NamedTuple

from icofabric_sim.bag.bag_file import BagFile
from icofabric_sim.bag.folder import absolute_path, BagError
from icofabric_sim.bag.mcap_scan import Damage, McapScan, ScannedMessage
from icofabric_sim.bag.reader import storage_files
from icofabric_sim.bag.sqlite3_storage import Sqlite3Reader
from icofabric_sim.bag.storage import (
    decode_custom,
    foreign_definition,
    merge_custom,
    STORAGES,
    StoredTopic,
    TopicEntry,
)

_PROGRESS_INTERVAL = 256  # messages


class RecoveryReport(NamedTuple):
    """
    Recovered messages by topic, times of the first and last [ns], and custom data.

    `damage` describes skipped chunks and where reading ended; it is empty for a complete source.
    """

    path: Path
    topics: dict[str, int]
    start_time: int
    end_time: int
    custom: dict[str, str]
    damage: str

    @property
    def message_count(self) -> int:
        return sum(self.topics.values())


def recover_bag(
    source: str | Path, destination: str | Path, *,
    on_progress: Callable[[float], None] | None = None,
) -> RecoveryReport:
    """
    Copy every readable message of a bag, or of a bare file, into a new complete bag.

    MCAP yields all messages up to the last closed chunk, except in damaged chunks, SQLite all up
    to the last commit.
    Storage, compression, files of a split bag, topics with their QoS, order and custom data are
    preserved. `on_progress` receives the completed fraction, 0 to 1. The source is not changed.
    """
    source, destination = Path(source).expanduser(), absolute_path(destination)
    if not source.exists():
        raise BagError(f'{source} does not exist')
    files = storage_files(source)
    storages = {suffix: storage for storage, suffix in STORAGES.items()}
    if not files or not all(file.suffix in storages for file in files):
        raise BagError(f'{source} contains no .mcap or .db3 file to recover')
    writer = _RecoveredBag(destination, storages[files[0].suffix])
    damages: list[str] = []
    try:
        for index, file in enumerate(files):
            writer.begin_file()
            for count, (part, message) in enumerate(_read(file, writer, damages)):
                writer.write(message)
                if on_progress is not None and count % _PROGRESS_INTERVAL == 0:
                    on_progress((index + part) / len(files))
        damage = '; '.join(damages)
        if not any(writer.counts.values()):
            raise BagError(
                f'nothing can be recovered from {source}: it contains no complete message'
                + (f' ({damage})' if damage else ''))
        report = writer.finish(damage)
    except BaseException as error:
        writer.discard()
        if isinstance(error, OSError | sqlite3.Error):
            text = error.strerror if isinstance(error, OSError) else str(error)
            raise BagError(f'cannot write {destination}: {text}') from error
        raise
    if on_progress is not None:
        on_progress(1.0)
    return report


class _RecoveredBag:
    """New bag, whose folder is created with the first message."""

    def __init__(self, path: Path, storage: str) -> None:
        self.path, self.storage = path, storage
        self.compressed = False  # whether the messages being read were compressed
        self.counts: dict[str, int] = {}
        self._file: BagFile | None = None
        self._types: dict[str, str] = {}
        self._new: list[StoredTopic] = []  # not yet in the file, which starts with a message
        self._times: tuple[int, int] | None = None
        self._custom: dict[str, str] = {}
        self._custom_topic: str | None = None
        self._split_due = False

    def begin_file(self) -> None:
        """Start a new file with the next message, as in the source."""
        self._split_due = self._file is not None

    def add_topic(self, topic: StoredTopic) -> None:
        """Declare a topic, possibly without messages; repeated calls have no effect."""
        if topic.name not in self._types:
            self._types[topic.name] = topic.type_name
            self._new.append(topic)

    def write(self, message: ScannedMessage) -> None:
        topic, nanoseconds = message.topic, message.nanoseconds
        if self._file is None:
            self._file = BagFile(
                self.path, self.storage, compression='zstd' if self.compressed else 'none')
            if decode_custom(topic.type_name, message.data) is not None:
                self._custom_topic = topic.name
        known = self._types[topic.name]
        if known != topic.type_name:
            raise BagError(f'{topic.name} is both {known} and {topic.type_name}')
        if self._split_due:
            self._split_due = False
            self._file.split()
        self._declare()
        self._file.write(topic.name, nanoseconds, message.data)
        self.counts[topic.name] += 1
        first, last = self._times or (nanoseconds, nanoseconds)
        self._times = min(first, nanoseconds), max(last, nanoseconds)
        if topic.name == self._custom_topic:
            self._custom = merge_custom([(topic.type_name, message.data)], self._custom)

    def _declare(self) -> None:
        assert self._file is not None
        for topic in self._new:
            self.counts[topic.name] = 0
            described = foreign_definition(topic.type_name, topic.definition)
            self._file.add_topic(TopicEntry(
                topic.name, topic.type_name,
                described._replace(digest=topic.digest) if topic.digest else described,
                topic.qos))
        self._new.clear()

    def finish(self, damage: str) -> RecoveryReport:
        assert self._file is not None and self._times is not None
        self._declare()
        self._file.close(self._custom)
        self._file = None
        return RecoveryReport(self.path, self.counts, *self._times, self._custom, damage)

    def discard(self) -> None:
        if self._file is not None:
            self._file.abandon()
            shutil.rmtree(self.path, ignore_errors=True)


_Read = Iterator[tuple[float, ScannedMessage]]  # with the fraction read, 0 to 1


def _read(path: Path, writer: _RecoveredBag, damages: list[str]) -> _Read:
    """Yield the readable messages of a file, and record the damage."""
    read = _read_mcap if path.suffix == '.mcap' else _read_sqlite3
    try:
        yield from read(path, writer, damages)
    except Damage as error:
        damages.append(f'{path.name} ends early: {error}')


def _read_mcap(path: Path, writer: _RecoveredBag, damages: list[str]) -> _Read:
    size = max(1, path.stat().st_size)
    scan = McapScan(
        path, on_damage=lambda text: damages.append(f'{path.name}: {text}'),
        on_topic=writer.add_topic)
    for message in scan.messages():
        writer.compressed = scan.compressed
        yield message.offset / size, message


def _read_sqlite3(path: Path, writer: _RecoveredBag, damages: list[str]) -> _Read:
    with contextlib.ExitStack() as stack:
        try:
            file = stack.enter_context(contextlib.closing(_open_sqlite3(path, writer.path, stack)))
            writer.compressed = file.compressed
            count = max(1, file.tally().message_count)
            topics = {topic.name: topic for topic in file.topics.values()}
            for topic in topics.values():
                writer.add_topic(topic)
            for number, (name, nanoseconds, data) in enumerate(
                    file.messages(None, None, None, by_time=False)):
                yield number / count, ScannedMessage(topics[name], nanoseconds, bytes(data), 0)
            finished = file.is_finished()
        except OSError:
            raise
        except Exception as error:  # any error that damaged pages cause
            raise Damage(str(error)) from error
    if not finished:
        raise Damage('it was not closed, and uncommitted messages are lost')


def _open_sqlite3(path: Path, beside: Path, stack: contextlib.ExitStack) -> Sqlite3Reader:
    """Open a file, or a copy that SQLite repairs if a transaction was interrupted."""
    companions = [Path(f'{path}{ending}') for ending in ('-journal', '-wal')]
    if not any(item.exists() and item.stat().st_size for item in companions):
        return Sqlite3Reader(path)
    beside.parent.mkdir(parents=True, exist_ok=True)
    folder = Path(stack.enter_context(
        tempfile.TemporaryDirectory(prefix=f'.{beside.name}-', dir=beside.parent)))
    for item in (path, *companions):
        if item.exists():
            shutil.copy(item, folder / item.name)
    return Sqlite3Reader(folder / path.name, unfinished=True)
