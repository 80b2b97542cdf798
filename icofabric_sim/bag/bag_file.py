# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Bag being written: a folder, its files one after the other, and the metadata at the end."""
from __future__ import annotations

import contextlib
import os
from pathlib import Path

from icofabric_sim.bag.folder import BagError, require_new
from icofabric_sim.bag.mcap_storage import McapFile
from icofabric_sim.bag.metadata import describe_bag, distribution, write_metadata
from icofabric_sim.bag.sqlite3_storage import MIN_SPLIT_BYTES, Sqlite3File
from icofabric_sim.bag.storage import (
    COMPRESSIONS,
    StorageFile,
    STORAGES,
    Tally,
    to_yaml,
    TopicEntry,
)


class BagFile:
    """New bag: a folder of files. All calls must come from its thread, as SQLite requires."""

    def __init__(
        self, path: Path, storage: str, *,
        compression: str = 'none',
        split_size: int = 0,
        split_duration: int = 0,
        custom: dict[str, str] | None = None,
    ) -> None:
        """
        Create the folder and open the first file in it; reject an existing path.

        `split_size` [bytes] and `split_duration` [ns] are the limits of `must_split`; 0: none.
        `custom` is the custom data known at the start, for readers of a killed bag.
        """
        if storage not in STORAGES:
            raise BagError(f'record.storage: {storage!r} is not one of {", ".join(STORAGES)}')
        if compression not in COMPRESSIONS:
            raise BagError(
                f'record.compression: {compression!r} is not one of {", ".join(COMPRESSIONS)}')
        if storage == 'sqlite3' and 0 < split_size < MIN_SPLIT_BYTES:
            raise BagError(
                f'record.split_size: with sqlite3 it must be 0 or at least {MIN_SPLIT_BYTES} '
                f'bytes, got {split_size}: an empty file is nearly as large')
        require_new(path)
        self.path = path
        self._storage, self._compression = storage, compression
        self._split_size, self._split_duration = split_size, split_duration
        self._custom = dict(custom or {})
        self._topics: list[TopicEntry] = []
        self._finished: list[tuple[str, Tally]] = []
        self._current: StorageFile | None = None
        self._current_first: int | None = None  # time of the current file's first message [ns]
        made = False
        try:
            path.mkdir(parents=True)
            made = True
            self._open_next()
        except Exception as error:  # of the operating system or SQLite
            if made:
                with contextlib.suppress(OSError):
                    path.rmdir()  # an empty folder would block the next attempt
            text = error.strerror if isinstance(error, OSError) else str(error)
            raise BagError(
                f'record.path: cannot write a bag to {path}: {text}; '
                'choose a folder where you may write') from error

    def add_topic(self, topic: TopicEntry) -> None:
        self._topics.append(topic)
        self._file.add_topic(topic)

    def must_split(self, nanoseconds: int) -> bool:
        """
        Return whether a message of this time belongs in the next file, by the rules of rosbag2.
        """
        first = self._current_first
        if first is None:
            return False
        return (0 < self._split_size <= self._file.size
                or 0 < self._split_duration < nanoseconds - first)

    def split(self) -> None:
        """Finish the current file and open the next one, with the same topics."""
        self._finish_current()
        self._open_next()
        for topic in self._topics:
            self._file.add_topic(topic)

    def write(self, topic: str, nanoseconds: int, data: bytes) -> None:
        if self._current_first is None:
            self._current_first = nanoseconds
        self._file.write(topic, nanoseconds, data)

    def flush(self) -> None:
        """Write everything received so far to the file."""
        self._file.flush()
        _check_exists(self._file)

    @property
    def next_name(self) -> str:
        """Return the name of the file that the next split opens."""
        return self._name(len(self._finished) + 1)

    @property
    def message_count(self) -> int:
        """Return the number of messages in the files, without those still queued."""
        count = sum(tally.message_count for _, tally in self._finished)
        return count + (self._current.tally.message_count if self._current is not None else 0)

    def close(self, custom: dict[str, str]) -> None:
        """Finish the bag with its metadata."""
        self._custom = dict(custom)
        self._finish_current()
        write_metadata(self.path, self._describe(self._finished))

    def salvage(self, custom: dict[str, str]) -> bool:
        """
        After an error, finish a complete bag from the data in its files; return False on failure.
        """
        try:
            if self._current is not None:
                try:
                    self._current.flush()
                except Exception:  # then without the queued messages
                    self._current.roll_back()
            self._close_within_free_space(custom)
        except Exception:  # probably the same error; the files stay as they are
            self.abandon()
            return False
        return True

    def _close_within_free_space(self, custom: dict[str, str]) -> None:
        try:
            self.close(custom)
        except OSError:
            # The end of the file is larger than the free space: a complete bag without its last
            # messages is worth more than one that only `recover` reads.
            if self._current is None or not self._current.shorten():
                raise
            self.close(custom)

    def abandon(self) -> None:
        """Close a bag that cannot be written any more."""
        current, self._current = self._current, None
        if current is not None:
            current.abandon()
            self._finished.append((current.path.name, current.tally))

    @property
    def _file(self) -> StorageFile:
        if self._current is None:
            raise BagError(f'{self.path} is not open for writing')
        return self._current

    def _name(self, number: int) -> str:
        return f'{self.path.name}_{number}{STORAGES[self._storage]}'

    def _open_next(self) -> None:
        name = self._name(len(self._finished))
        path = self.path / name
        described = to_yaml(self._describe([(name, Tally())]))
        self._current_first = None
        if self._storage == 'mcap':
            self._current = McapFile(path, compression=self._compression, metadata=described)
        else:
            self._current = Sqlite3File(
                path, compression=self._compression, metadata=described,
                distribution=distribution())

    def _finish_current(self) -> None:
        current = self._current
        if current is None:
            return
        current.flush()
        _check_exists(current)
        entry = current.path.name, current.tally
        # The metadata in a file describe only that file: there may be many others.
        current.finish(to_yaml(self._describe([entry])))
        self._finished.append(entry)
        self._current = None

    def _describe(self, files: list[tuple[str, Tally]]) -> dict[str, object]:
        return describe_bag(
            self._storage, self._compression, files, self._topics, self._custom)


def _check_exists(file: StorageFile) -> None:
    """Raise BagError if the file was removed; the system reports no error when writing to it."""
    if not os.path.lexists(file.path):
        raise BagError(f'{file.path} was removed')
