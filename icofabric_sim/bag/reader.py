# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Reading of a bag: topics, messages in time order, and custom data."""
from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Generator, Iterator
import contextlib
import heapq
import json
from pathlib import Path
from typing import NamedTuple

from icofabric_sim.bag.folder import BagError
from icofabric_sim.bag.metadata import FILE_NAME, MetadataFile, read_metadata
from icofabric_sim.bag.parts import StoredFile
from icofabric_sim.bag.storage import decode_custom, FILE_INDEX, merge_custom, REPEATED, STORAGES
from icofabric_sim.messages import StringBytes
from icofabric_sim.process.closing import Closing
from rosbags.interfaces import Qos, QosDurability

_MCAP_MAGIC = b'\x89MCAP0\r\n'
_SQLITE3_MAGIC = b'SQLite format 3\0'
_SUFFIXES = tuple(STORAGES.values())
# Largest number of open files; with more files, each is opened when its turn comes.
_MAX_OPEN_FILES = 16


class BagTopic(NamedTuple):
    """
    Topic of a bag; latched means offered as transient local.

    `message_count` includes messages that files of a split bag repeat from earlier ones.
    """

    type_name: str
    message_count: int
    latched: bool
    depth: int
    type_hash: str  # '' if unknown: bare files have no hash


class BagReader(Closing):
    """
    Reader of a bag folder, or of a bare .mcap or .db3 file, open until `close`.

    `start_time` and `end_time` are the times of the first and last message [ns]; 0: none.
    Messages are read one by one, and files are opened when their turn comes: a bag may exceed the
    memory and have more files than a process may open. Latched messages that a later file of a
    split bag repeats are skipped, unless only that file is read.
    """

    def __init__(self, path: str | Path) -> None:
        """Open the bag; raise BagError with reason and remedy if it is unreadable."""
        self.path = Path(path).expanduser()
        check_finished(self.path)
        self._open_parts: dict[Path, StoredFile] = {}
        self._headings: dict[Path, tuple[int, dict[str, str]]] = {}
        self._custom: dict[str, str] = {}
        self._mode = ''
        self._closed = False
        self.topics: dict[str, BagTopic] = {}
        if self.path.is_dir():
            stored = read_metadata(self.path)
            self._files, self._mode, self._custom = (
                stored.files, stored.compression_mode, stored.custom)
            self.message_count = stored.message_count
            self.start_time, self.end_time = stored.first, stored.last
            for described in stored.topics:
                self._add(*described)
        else:
            self._files = [MetadataFile(self.path, None, None)]
            part = self._part(self.path)
            try:
                tally, topics = part.tally(), part.topics
            except Exception as error:
                self.close()
                raise BagError(f'cannot read {self.path} as a bag: {error}') from error
            self.message_count = tally.message_count
            self.start_time, self.end_time = (
                (tally.first, tally.last) if tally.message_count else (0, 0))
            for topic in topics:
                self._add(topic.name, topic.type_name, tally.counts.get(topic.name, 0),
                          topic.digest, topic.qos)

    @property
    def custom(self) -> dict[str, str]:
        """Return the custom data from the metadata, or from the messages that repeat it."""
        if self._custom:
            return dict(self._custom)
        for topic, _, data in self.messages():
            if decode_custom(self.topics[topic].type_name, data) is None:
                break
            return self.custom_on(topic)
        return {}

    def custom_on(self, topic: str) -> dict[str, str]:
        """
        Return the custom data in the messages of one topic; each fabric writes to another topic.
        """
        if topic not in self.topics:
            return {}
        return merge_custom(
            (self.topics[topic].type_name, item) for _, _, item in self.messages([topic]))

    def messages(
        self, topics: Collection[str] | None = None, *,
        start: int | None = None, stop: int | None = None,
    ) -> Iterator[tuple[str, int, bytes]]:
        """
        Yield (topic, time [ns], message) with start <= time < stop, in order of time.

        Messages of equal time keep the order of writing. Unknown topics yield nothing.
        """
        wanted = {name for name in self.topics if topics is None or name in topics}
        if not wanted:
            return
        try:
            for group in _overlapping(self._files):
                if _has_no_message_in(group, start, stop):
                    continue
                streams = [self._read(file.path, wanted, start, stop) for file in group]
                # Messages of equal time: the earlier file first.
                yield from (streams[0] if len(streams) == 1 else
                            heapq.merge(*streams, key=lambda message: message[1]))
        except BagError:
            raise
        except Exception as error:
            raise BagError(
                f'{self.path} is damaged: {error}; `icofabric recover {self.path}` copies the '
                'readable messages to a new bag') from error

    def close(self) -> None:
        """Close the files; a second call has no effect."""
        self._closed = True
        while self._open_parts:
            self._open_parts.popitem()[1].close()

    def _add(
        self, name: str, type_name: str, message_count: int, digest: str, qos: list[Qos],
    ) -> None:
        known = self.topics.get(name)
        if known is not None and known.type_name != type_name:
            self.close()
            raise BagError(
                f'{self.path} contains {name} both as {known.type_name} and as {type_name}; only '
                'one type for each topic can be read')
        self.topics[name] = BagTopic(
            type_name,
            message_count + (known.message_count if known is not None else 0),
            any(item.durability is QosDurability.TRANSIENT_LOCAL for item in qos),
            max((item.depth for item in qos), default=0),
            digest)

    def _part(self, path: Path) -> StoredFile:
        part = self._open_parts.get(path)
        if self._closed:
            raise BagError(f'{self.path} has been closed')
        if part is None:
            try:
                part = StoredFile(path, compression_mode=self._mode)
            except BagError:
                raise
            except Exception as error:  # rosbags raises many exception types for malformed files
                raise BagError(f'cannot read {path} as a bag: {error}') from error
            if len(self._files) <= _MAX_OPEN_FILES:
                self._open_parts[path] = part
        return part

    def _read(
        self, path: Path, wanted: Collection[str], start: int | None, stop: int | None,
    ) -> Iterator[tuple[str, int, bytes]]:
        """Yield the messages that one file adds to the bag."""
        time, counts = self._repeated(path)
        stored = self._stored(path, wanted, start, stop)
        if not counts.keys() & wanted:
            yield from stored
            return
        for message in stored:
            # Repeated messages are the first of their time.
            if message[1] == time and counts[message[0]] > 0:
                counts[message[0]] -= 1
            else:
                yield message

    def _repeated(self, path: Path) -> tuple[int, Counter[str]]:
        """Return the time [ns] and the counts by topic of messages known from earlier files."""
        number = [file.path for file in self._files].index(path)
        if not number or not any(topic.latched for topic in self.topics.values()):
            return 0, Counter()
        time, said = self._heading(path)
        _, before = self._heading(self._files[number - 1].path)
        try:
            # After a lost file the repeated messages are new.
            follows = int(said.get(FILE_INDEX, 0)) == int(before.get(FILE_INDEX, 0)) + 1
            return time, Counter(json.loads(said.get(REPEATED, '{}')) if follows else {})
        except (TypeError, ValueError):
            return 0, Counter()

    def _heading(self, path: Path) -> tuple[int, dict[str, str]]:
        """Return the time [ns] and the custom data at the start of a file."""
        if path not in self._headings:
            names = [name for name, topic in self.topics.items()
                     if name.endswith('/recording') and topic.type_name == StringBytes.TYPE]
            with contextlib.closing(self._stored(path, names, None, None)) as stored:
                _, time, data = next(stored, ('', 0, b''))
            self._headings[path] = time, decode_custom(StringBytes.TYPE, data) or {}
        return self._headings[path]

    def _stored(
        self, path: Path, wanted: Collection[str], start: int | None, stop: int | None,
    ) -> Generator[tuple[str, int, bytes], None, None]:
        part = self._part(path)
        try:
            yield from part.messages(wanted, start, stop)
        finally:
            if path not in self._open_parts:
                part.close()


def _overlapping(files: list[MetadataFile]) -> Iterator[list[MetadataFile]]:
    """Group files whose time spans overlap; other recorders write a few messages out of order."""
    group: list[MetadataFile] = []
    latest = -1
    for file in files:
        if group and (file.first is None or file.first >= latest):
            yield group
            group, latest = [], -1
        group.append(file)
        if file.last is not None:
            latest = max(latest, file.last)
    if group:
        yield group


def _has_no_message_in(group: list[MetadataFile], start: int | None, stop: int | None) -> bool:
    """Return whether no file of `group` can have a message between `start` and `stop`."""
    return all(
        file.first is not None and file.last is not None and (
            (start is not None and file.last < start) or (stop is not None and file.first >= stop))
        for file in group)


def storage_files(path: Path) -> list[Path]:
    """Return the .mcap and .db3 files of a bag in the order of recording."""
    if path.is_dir():
        found = [item for item in path.iterdir() if item.suffix in _SUFFIXES]
        return sorted(found, key=lambda item: (len(item.name), item.name))
    return [path]


def check_finished(path: Path) -> None:
    """Raise BagError with a remedy for a path that is not a bag, or is unfinished."""
    if not path.exists():
        raise BagError(f'{path} does not exist')
    try:
        described = path.is_dir() and (path / FILE_NAME).exists()
        files = storage_files(path)
        if not described and not files or not path.is_dir() and path.suffix not in _SUFFIXES:
            raise BagError(
                f'{path} is not a bag: it must be a folder recorded by rosbag2, or one of the '
                '.mcap or .db3 files in it')
        unfinished = path.is_dir() and not described
        for file in files:
            with file.open('rb') as opened:
                start = opened.read(16)
                opened.seek(-min(8, opened.seek(0, 2)), 2)
                end = opened.read()
            if file.suffix == '.db3':
                if start and start != _SQLITE3_MAGIC:
                    raise BagError(f'{file} is not a bag: it has no SQLite header')
                unfinished = unfinished or not start or Path(f'{file}-journal').exists()
            elif not _MCAP_MAGIC.startswith(start[:8]) and start:
                raise BagError(f'{file} is not a bag: it has no MCAP header')
            elif end != _MCAP_MAGIC or len(start) < 16:
                unfinished = True
    except OSError as error:
        raise BagError(f'cannot read {path}: {error.strerror}') from error
    if unfinished:
        raise BagError(
            f'{path} was not finished: its recorder was killed or ran out of disk space; '
            f'`icofabric recover {path}` makes a complete bag of it')
