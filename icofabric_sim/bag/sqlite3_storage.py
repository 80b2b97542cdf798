# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Writer and reader of one SQLite file of a bag, with the tables of rosbag2's plugin."""
from __future__ import annotations

from collections.abc import Collection, Iterator
import contextlib
from pathlib import Path
import sqlite3
from urllib.parse import quote

from icofabric_sim.bag import zstd
from icofabric_sim.bag.folder import BagError
from icofabric_sim.bag.storage import (
    from_yaml,
    qos_entries,
    StoredTopic,
    Tally,
    to_yaml,
    TopicEntry,
    ZSTD_LEVEL,
)

# Smallest size at which rosbag2 splits: an empty file is almost that large.
MIN_SPLIT_BYTES = 86016
_METADATA_VERSION = 9
_TABLES = """
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(
  id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
CREATE TABLE topics(
  id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
  serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
  type_description_hash TEXT NOT NULL);
CREATE TABLE message_definitions(
  id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
  encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE messages(
  id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
  data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
"""


class Sqlite3File:
    """.db3 file being written, with one transaction for each flush."""

    def __init__(self, path: Path, *, compression: str, metadata: str, distribution: str) -> None:
        """Create a file; `metadata` is the metadata of the bag so far."""
        self.path = path
        self.tally = Tally()
        self._pending = Tally()
        self._zstd = compression == 'zstd'
        self._numbers: dict[str, int] = {}
        self._types: set[str] = set()
        path.touch(exist_ok=False)
        try:
            self._database = sqlite3.connect(path, isolation_level=None)
            # A power failure then costs at most the last transactions, and each commit waits less.
            self._database.execute('PRAGMA synchronous=NORMAL')
            self._database.execute('BEGIN')
            for statement in _TABLES.split(';'):
                self._database.execute(statement)
            self._database.execute('INSERT INTO schema VALUES(4, ?)', (distribution,))
            self._put_metadata(metadata)
            self._database.execute('COMMIT')
        except BaseException:
            if hasattr(self, '_database'):
                self.abandon()
            path.unlink(missing_ok=True)
            raise
        (self._page_size,) = self._database.execute('PRAGMA page_size').fetchone()

    @property
    def size(self) -> int:
        (count,) = self._database.execute('PRAGMA page_count').fetchone()
        return int(count * self._page_size)

    def add_topic(self, topic: TopicEntry) -> None:
        self._begin()
        if topic.type_name not in self._types:
            self._types.add(topic.type_name)
            self._database.execute(
                'INSERT INTO message_definitions (topic_type, encoding, '
                'encoded_message_definition, type_description_hash) VALUES(?, ?, ?, ?)',
                (topic.type_name, topic.definition.encoding, topic.definition.text,
                 topic.definition.digest))
        self._numbers[topic.name] = len(self._numbers) + 1
        self._database.execute(
            'INSERT INTO topics VALUES(?, ?, ?, ?, ?, ?)',
            (self._numbers[topic.name], topic.name, topic.type_name, 'cdr',
             to_yaml(qos_entries(topic.qos)), topic.definition.digest))

    def write(self, topic: str, nanoseconds: int, data: bytes) -> None:
        self._begin()
        # Each message is a frame with its size: the only form that rosbag2's reader accepts.
        self._database.execute(
            'INSERT INTO messages (topic_id, timestamp, data) VALUES(?, ?, ?)',
            (self._numbers[topic], nanoseconds,
             zstd.compress(data, ZSTD_LEVEL) if self._zstd else data))
        self._pending.add(topic, nanoseconds)

    def flush(self) -> None:
        # SQLite rolls back automatically after some errors.
        if self._database.in_transaction:
            self._database.execute('COMMIT')
            self.tally.merge(self._pending)
        self._pending = Tally()

    def roll_back(self) -> None:
        if self._database.in_transaction:
            self._database.execute('ROLLBACK')
        self._pending = Tally()

    def shorten(self) -> bool:
        return False  # deleting rows does not shrink the file

    def finish(self, metadata: str) -> None:
        self._put_metadata(metadata)
        self._database.close()

    def abandon(self) -> None:
        with contextlib.suppress(sqlite3.Error):
            self._database.close()  # rolls back

    def _begin(self) -> None:
        if not self._database.in_transaction:
            self._database.execute('BEGIN')

    def _put_metadata(self, text: str) -> None:
        self._database.execute(
            'INSERT INTO metadata (metadata_version, metadata) VALUES(?, ?)',
            (_METADATA_VERSION, text))


class Sqlite3Reader:
    """.db3 file being read, without changes on the disk and without locks."""

    def __init__(self, path: Path, *, unfinished: bool = False) -> None:
        """Open the file; an `unfinished` one is first repaired by SQLite, which writes to it."""
        mode = 'rw' if unfinished else 'ro&immutable=1'
        self.path = path
        try:
            self._database = sqlite3.connect(
                f'file:{quote(str(path))}?mode={mode}', uri=True, check_same_thread=False)
            # Invalid text must not make the messages unreadable.
            self._database.text_factory = lambda data: data.decode(errors='replace')
            try:
                self.topics = self._read_topics()
                self.compressed = self._is_compressed()
            except BaseException:
                self._database.close()
                raise
        except sqlite3.Error as error:
            raise BagError(f'{path} cannot be read by SQLite: {error}') from error

    def tally(self) -> Tally:
        """Count all messages."""
        tally = Tally()
        for number, count, first, last in self._database.execute(
                'SELECT topic_id, count(*), min(timestamp), max(timestamp) FROM messages '
                'GROUP BY topic_id'):
            if number in self.topics:
                tally.merge(Tally({self.topics[number].name: count}, first, last))
        return tally

    def messages(
        self, names: Collection[str] | None, start: int | None, stop: int | None,
        *, by_time: bool = True,
    ) -> Iterator[tuple[str, int, bytes]]:
        """Yield messages in order of time and writing, or only of writing."""
        topics = {number: topic.name for number, topic in self.topics.items()
                  if names is None or topic.name in names}
        wanted = ', '.join(str(number) for number in topics)
        query = f'SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({wanted})'
        limits = []
        for condition, limit in (('timestamp >= ?', start), ('timestamp < ?', stop)):
            if limit is not None:
                query += f' AND {condition}'
                limits.append(max(-2**63, min(limit, 2**63 - 1)))
        query += f' ORDER BY {"timestamp, id" if by_time else "id"}'
        for number, nanoseconds, data in self._database.execute(query, limits):
            if self.compressed:
                data = zstd.decompress(data)
            yield topics[number], nanoseconds, data

    def is_finished(self) -> bool:
        """Return whether the recording was closed, so that the metadata count the messages."""
        if not self._has('metadata'):
            return True  # rosbag2 before Iron
        stored = self._metadata()
        return bool(stored) and (
            not self._has_messages() or bool(stored.get('message_count')))

    def close(self) -> None:
        self._database.close()

    def _read_topics(self) -> dict[int, StoredTopic]:
        columns = self._columns('topics')
        chosen = ['id', 'name', 'type']
        chosen += [name if name in columns else "''"
                   for name in ('type_description_hash', 'offered_qos_profiles')]
        definitions: dict[str, str] = {}
        if self._has('message_definitions'):
            definitions = dict(self._database.execute(
                'SELECT topic_type, encoded_message_definition FROM message_definitions'))
        rows = self._database.execute(f'SELECT {", ".join(chosen)} FROM topics ORDER BY id')
        return {
            number: StoredTopic(
                name, type_name, definitions.get(type_name, ''), profiles, digest)
            for number, name, type_name, digest, profiles in rows}

    def _is_compressed(self) -> bool:
        """Return whether each message is a zstd frame; the folder may have no metadata."""
        first = self._database.execute('SELECT data FROM messages LIMIT 1').fetchone()
        # No CDR message starts like this: its first byte is 0.
        return first is not None and bytes(first[0][:4]) == b'\x28\xb5\x2f\xfd'

    def _metadata(self) -> dict[str, object]:
        row = self._database.execute(
            'SELECT metadata FROM metadata ORDER BY id DESC LIMIT 1').fetchone()
        with contextlib.suppress(Exception):
            stored = from_yaml(row[0])
            if isinstance(stored, dict):
                return stored
        return {}

    def _has_messages(self) -> bool:
        return self._database.execute('SELECT 1 FROM messages LIMIT 1').fetchone() is not None

    def _has(self, table: str) -> bool:
        return bool(self._columns(table))

    def _columns(self, table: str) -> set[str]:
        return {row[1] for row in self._database.execute(f'PRAGMA table_info({table})')}
