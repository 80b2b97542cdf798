# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Reading a recorded run: its topics, its messages in time order, and what it says of itself.
"""
from __future__ import annotations

from collections.abc import Collection, Iterator
import contextlib
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from icofabric_sim.bag.storage import BagError, decode_custom
from rosbags.interfaces import ConnectionExtRosbag2, QosDurability
from rosbags.rosbag2 import Reader

_MCAP_MAGIC = b'\x89MCAP0\r\n'
_SQLITE3_MAGIC = b'SQLite format 3\0'


class BagTopic(NamedTuple):
    """
    A topic of a bag; latched: offered transient local.
    """

    type_name: str
    message_count: int
    latched: bool
    depth: int
    type_hash: str  # '' where the bag does not say: a bare file has none


class BagReader:
    """
    Reads a bag folder, or a bare .mcap or .db3 file; open from its construction to `close`.
    """

    def __init__(self, path: str | Path) -> None:
        """
        Open the bag; BagError says what is wrong with it and what helps.
        """
        self.path = Path(path).expanduser()
        check_finished(self.path)
        try:
            self._reader = Reader(self.path)
            self._reader.open()
        except Exception as error:  # rosbags lets many kinds through when a file is malformed
            raise BagError(f'cannot read {self.path} as a bag: {error}') from error
        self.topics: dict[str, BagTopic] = {}
        for connection in self._reader.connections:
            known = self.topics.get(connection.topic)
            if known is not None and known.type_name != connection.msgtype:
                self.close()
                raise BagError(
                    f'{self.path} holds {connection.topic} both as {known.type_name} and as '
                    f'{connection.msgtype}; only one type to a topic can be read')
            profiles = (connection.ext.offered_qos_profiles
                        if isinstance(connection.ext, ConnectionExtRosbag2) else [])
            self.topics[connection.topic] = BagTopic(
                connection.msgtype,
                connection.msgcount + (known.message_count if known is not None else 0),
                any(item.durability is QosDurability.TRANSIENT_LOCAL for item in profiles),
                max((item.depth for item in profiles), default=0),
                connection.digest)

    @property
    def message_count(self) -> int:
        return self._reader.message_count

    @property
    def start_time(self) -> int:
        """
        Time of the first message [ns]; 0 in an empty bag.
        """
        return self._reader.start_time if self.message_count else 0

    @property
    def end_time(self) -> int:
        """
        Time of the last message [ns]; 0 in an empty bag.
        """
        return self._reader.end_time - 1 if self.message_count else 0

    @property
    def custom(self) -> dict[str, str]:
        """
        The custom data: from the metadata, else from the messages that repeat it.
        """
        stored = self._reader.storage.metadata.custom
        if stored:
            return dict(stored)
        for topic, _, data in self.messages():
            if decode_custom(self.topics[topic].type_name, data) is None:
                break
            return merge_custom(
                (self.topics[topic].type_name, item) for _, _, item in self.messages([topic]))
        return {}

    def messages(
        self, topics: Collection[str] | None = None, *,
        start: int | None = None, stop: int | None = None,
    ) -> Iterator[tuple[str, int, bytes]]:
        """
        Yield (topic, time [ns], message) with start <= time < stop, in order of time.

        Messages of one time come in the order in which they were written. A topic that the bag
        does not hold yields nothing.
        """
        connections = [
            item for item in self._reader.connections if topics is None or item.topic in topics]
        if not connections:
            return  # rosbags would take none for all
        try:
            for connection, nanoseconds, data in self._reader.messages(connections, start, stop):
                yield connection.topic, nanoseconds, bytes(data)
        except Exception as error:
            raise BagError(
                f'{self.path} is damaged: {error}; for MCAP, `icofabric recover {self.path}` '
                'saves what comes before') from error

    def close(self) -> None:
        """
        Let go of the files; a second call changes nothing.
        """
        if self._reader.is_open:
            with contextlib.suppress(Exception):
                self._reader.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def merge_custom(messages: Iterator[tuple[str, bytes]]) -> dict[str, str]:
    """
    Put together the custom data that messages of one topic hold, the later over the earlier.
    """
    custom: dict[str, str] = {}
    for type_name, data in messages:
        custom.update(decode_custom(type_name, data) or {})
    return custom


def storage_files(path: Path) -> list[Path]:
    """
    Return the .mcap and .db3 files of a bag, in the order in which they were recorded.
    """
    if path.is_dir():
        found = [item for item in path.iterdir() if item.suffix in ('.mcap', '.db3')]
        return sorted(found, key=lambda item: (len(item.name), item.name))
    return [path]


def check_finished(path: Path) -> None:
    """
    Refuse, with the way out, what is not a bag and a recording that was never finished.
    """
    if not path.exists():
        raise BagError(f'{path} does not exist')
    try:
        files = storage_files(path)
        if not files or not path.is_dir() and path.suffix not in ('.mcap', '.db3'):
            raise BagError(
                f'{path} is not a bag: it must be a folder that rosbag2 recorded, or one of the '
                '.mcap or .db3 files in it')
        unfinished = path.is_dir() and not (path / 'metadata.yaml').exists()
        for file in files:
            with file.open('rb') as opened:
                start = opened.read(16)
                opened.seek(-min(8, opened.seek(0, 2)), 2)
                end = opened.read()
            if file.suffix == '.db3':
                if start and start != _SQLITE3_MAGIC:
                    raise BagError(f'{file} is not a bag: it does not begin as SQLite')
                unfinished = unfinished or not start or Path(f'{file}-journal').exists()
            elif not _MCAP_MAGIC.startswith(start[:8]) and start:
                raise BagError(f'{file} is not a bag: it does not begin as MCAP')
            elif end != _MCAP_MAGIC or len(start) < 16:
                unfinished = True
    except OSError as error:
        raise BagError(f'cannot read {path}: {error.strerror}') from error
    if unfinished:
        raise BagError(
            f'{path} was not finished, its recorder was killed or ran out of disk; '
            f'`icofabric recover {path}` makes a whole bag of it')
