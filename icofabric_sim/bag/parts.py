# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Reader of one file of a bag, for any storage."""
from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
import shutil
import tempfile
from typing import NamedTuple, Protocol

from icofabric_sim.bag import zstd
from icofabric_sim.bag.sqlite3_storage import Sqlite3Reader
from icofabric_sim.bag.storage import Tally
from rosbags.interfaces import ConnectionExtRosbag2, Qos
from rosbags.rosbag2 import Reader


class PartTopic(NamedTuple):
    """Topic of one file."""

    name: str
    type_name: str
    digest: str  # '' if the file has no hash
    qos: list[Qos]


class _Stored(Protocol):

    def tally(self) -> Tally: ...

    def messages(
        self, names: Collection[str] | None, start: int | None, stop: int | None,
    ) -> Iterator[tuple[str, int, bytes]]: ...

    def close(self) -> None: ...


class StoredFile:
    """One .mcap or .db3 file, or one that rosbag2 has compressed entirely (.zstd)."""

    def __init__(self, path: Path, *, compression_mode: str = '') -> None:
        """Open the file; `compression_mode` comes from the metadata, if any."""
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        if compression_mode == 'file':
            self._folder = tempfile.TemporaryDirectory(prefix='icofabric-')
            plain = Path(self._folder.name, path.stem)
            with zstd.ZstdFile(path) as source, plain.open('wb') as target:
                shutil.copyfileobj(source, target)
            path = plain
        self._stored: _Stored
        try:
            if path.suffix == '.db3':
                database = Sqlite3Reader(path)
                self._stored = database
                self.topics = [
                    PartTopic(topic.name, topic.type_name, topic.digest, topic.qos)
                    for topic in database.topics.values()]
            else:
                mcap = _McapReader(path, unwrap=compression_mode == 'message')
                self._stored, self.topics = mcap, mcap.topics
        except BaseException:
            if self._folder is not None:
                self._folder.cleanup()
            raise

    def tally(self) -> Tally:
        """Count the messages of each topic."""
        return self._stored.tally()

    def messages(
        self, names: Collection[str], start: int | None, stop: int | None,
    ) -> Iterator[tuple[str, int, bytes]]:
        """Yield messages in order of time, then of writing."""
        return self._stored.messages(names, start, stop)

    def close(self) -> None:
        """Close the file."""
        self._stored.close()
        if self._folder is not None:
            self._folder.cleanup()


class _McapReader:
    """Finished .mcap file, read by rosbags with one chunk in memory at a time."""

    def __init__(self, path: Path, *, unwrap: bool) -> None:
        self._reader = Reader(path)
        self._reader.open()
        self._unwrap = unwrap  # old versions compress each message
        self.topics = [
            PartTopic(item.topic, item.msgtype, item.digest,
                      item.ext.offered_qos_profiles
                      if isinstance(item.ext, ConnectionExtRosbag2) else [])
            for item in self._reader.connections]

    def tally(self) -> Tally:
        tally = Tally()
        if self._reader.message_count:
            for item in self._reader.connections:
                tally.counts[item.topic] = tally.counts.get(item.topic, 0) + item.msgcount
            tally.first, tally.last = self._reader.start_time, self._reader.end_time - 1
        return tally

    def messages(
        self, names: Collection[str] | None, start: int | None, stop: int | None,
    ) -> Iterator[tuple[str, int, bytes]]:
        chosen = [item for item in self._reader.connections
                  if names is None or item.topic in names]
        if not chosen:
            return  # rosbags would read no topics as all topics
        for connection, nanoseconds, data in self._reader.messages(chosen, start, stop):
            data = zstd.decompress(data) if self._unwrap else bytes(data)
            yield connection.topic, nanoseconds, data

    def close(self) -> None:
        if self._reader.is_open:
            self._reader.close()
