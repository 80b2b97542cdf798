# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Making a whole bag of one whose recorder was killed or ran out of disk.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
from pathlib import Path
import shutil
import sqlite3
from typing import NamedTuple

from icofabric_sim.bag.reader import merge_custom, storage_files
from icofabric_sim.bag.storage import (
    absolute_path,
    BagError,
    BagFile,
    decode_custom,
    foreign_definition,
    parse_qualities_of_service,
)
from rosbags.interfaces import Qos

_PROGRESS_EVERY = 256  # messages


class RecoveryReport(NamedTuple):
    """
    What was saved: messages of each topic, times of the first and last [ns], and the custom data.

    `damage` says where reading ended; it is empty when the source was whole.
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


class _Topic(NamedTuple):
    name: str
    type_name: str
    definition: str
    qos: list[Qos]


class _Found(NamedTuple):
    topic: _Topic
    nanoseconds: int
    data: bytes
    progress: float  # part of the file that was read, 0 to 1


class _Damage(Exception):
    """
    The place up to which a file can be read.
    """


def recover_bag(
    source: str | Path, destination: str | Path, *,
    on_progress: Callable[[float], None] | None = None,
) -> RecoveryReport:
    """
    Copy every readable message of a bag, or of a bare file of it, into a new bag that is whole.

    MCAP yields all up to the last closed chunk, SQLite all up to the last commit. The storage,
    the topics with their QoS, the order and the custom data stay as they were. `on_progress` is
    told the part done, 0 to 1. The source is not written to, but that SQLite rolls an unfinished
    transaction back, as for every reader.
    """
    source, destination = Path(source).expanduser(), absolute_path(destination)
    if not source.exists():
        raise BagError(f'{source} does not exist')
    files = storage_files(source)
    storages = {'.mcap': 'mcap', '.db3': 'sqlite3'}
    if not files or not all(file.suffix in storages for file in files):
        raise BagError(f'{source} holds no .mcap or .db3 file to recover')
    writer = _Copy(destination, storages[files[0].suffix])
    damage = ''
    try:
        for index, file in enumerate(files):
            read = _read_mcap if file.suffix == '.mcap' else _read_sqlite3
            try:
                for count, found in enumerate(read(file)):
                    writer.write(found)
                    if on_progress is not None and count % _PROGRESS_EVERY == 0:
                        on_progress((index + found.progress) / len(files))
            except _Damage as error:
                damage = f'{file.name} ends early: {error}'
        if not writer.counts:
            raise BagError(
                f'nothing can be recovered from {source}: no message was complete on the disk'
                + (f' ({damage})' if damage else ''))
        report = writer.finish(damage)
    except BaseException as error:
        writer.discard()
        if isinstance(error, OSError):
            raise BagError(f'cannot write {destination}: {error.strerror}') from error
        raise
    if on_progress is not None:
        on_progress(1.0)
    return report


def recover_mcap(source: str | Path, destination: str | Path) -> RecoveryReport:
    """
    Make a killed MCAP bag whole; `recover_bag` with its defaults.
    """
    return recover_bag(source, destination)


class _Copy:
    """
    The new bag; its folder appears with the first message.
    """

    def __init__(self, path: Path, storage: str) -> None:
        self.path, self.storage = path, storage
        self.counts: dict[str, int] = {}
        self._file: BagFile | None = None
        self._types: dict[str, str] = {}
        self._times: tuple[int, int] | None = None
        self._custom: dict[str, str] = {}
        self._custom_topic: str | None = None

    def write(self, found: _Found) -> None:
        topic, nanoseconds = found.topic, found.nanoseconds
        if self._file is None:
            self._file = BagFile(self.path, self.storage)
            if decode_custom(topic.type_name, found.data) is not None:
                self._custom_topic = topic.name
        known = self._types.setdefault(topic.name, topic.type_name)
        if known != topic.type_name:
            raise BagError(f'{topic.name} is both {known} and {topic.type_name}')
        if topic.name not in self.counts:
            self.counts[topic.name] = 0
            self._file.add_topic(
                topic.name, topic.type_name,
                foreign_definition(topic.type_name, topic.definition), topic.qos)
        self._file.write(topic.name, nanoseconds, found.data)
        self.counts[topic.name] += 1
        first, last = self._times or (nanoseconds, nanoseconds)
        self._times = min(first, nanoseconds), max(last, nanoseconds)
        if topic.name == self._custom_topic:
            self._custom.update(merge_custom(iter([(topic.type_name, found.data)])))

    def finish(self, damage: str) -> RecoveryReport:
        assert self._file is not None and self._times is not None
        self._file.close(self._custom)
        self._file = None
        return RecoveryReport(self.path, self.counts, *self._times, self._custom, damage)

    def discard(self) -> None:
        if self._file is not None:
            self._file.abandon()
            shutil.rmtree(self.path, ignore_errors=True)


def _read_mcap(path: Path) -> Iterator[_Found]:
    # Only this needs the package, and rosbags' own reader refuses a file without its end.
    try:
        from mcap.exceptions import EndOfFile
        from mcap.records import Channel, Message, Schema
        from mcap.stream_reader import StreamReader
    except ImportError as error:
        raise BagError(
            f'recovering {path} needs the Python package mcap: `pip install mcap`') from error

    schemas: dict[int, Schema] = {}
    topics: dict[int, _Topic] = {}
    size = max(1, path.stat().st_size)
    with path.open('rb') as file:
        records = iter(StreamReader(file, validate_crcs=True).records)
        while True:
            try:
                record = next(records, None)
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    schema = schemas[record.schema_id]
                    topics[record.id] = _Topic(
                        record.topic, schema.name, schema.data.decode(),
                        parse_qualities_of_service(
                            record.metadata.get('offered_qos_profiles', '')))
                found = (_Found(topics[record.channel_id], record.log_time, record.data,
                                file.tell() / size)
                         if isinstance(record, Message) else None)
            except EndOfFile:
                raise _Damage(f'its last chunk was not complete at byte {size}') from None
            except Exception as error:  # whatever the parser makes of damaged bytes
                raise _Damage(f'unreadable at about byte {file.tell()} ({error!r})') from error
            if record is None:
                return
            if found is not None:
                yield found


def _read_sqlite3(path: Path) -> Iterator[_Found]:
    try:
        with contextlib.closing(sqlite3.connect(path)) as database:
            total = database.execute('SELECT count(*) FROM messages').fetchone()[0]
            definitions = dict(database.execute(
                'SELECT topic_type, encoded_message_definition FROM message_definitions'))
            topics = {
                key: _Topic(name, type_name, definitions.get(type_name, ''),
                            parse_qualities_of_service(profiles))
                for key, name, type_name, profiles in database.execute(
                    'SELECT id, name, type, offered_qos_profiles FROM topics')}
            rows = database.execute('SELECT topic_id, timestamp, data FROM messages ORDER BY id')
            for index, (key, nanoseconds, data) in enumerate(rows):
                yield _Found(topics[key], nanoseconds, data, (index + 1) / total)
            finished = database.execute('SELECT count(*) FROM metadata').fetchone()[0]
    except (sqlite3.Error, KeyError) as error:
        raise _Damage(str(error)) from error
    if not finished:
        raise _Damage('it was not closed, and what was not committed is not in it')
