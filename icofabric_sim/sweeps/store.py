# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The store of finished runs: one folder per run, named by its key.

A run is written under another name and renamed when complete, so a folder named by a key is a
finished run even after a crash. Several sweeps may share a store: they reuse each other's finished
runs and, where the file system has locks, do not compute a run twice. The store must be on a file
system shared by all workers.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import errno
import fcntl
import hashlib
import json
import math
import os
from pathlib import Path
import shutil
import socket
from typing import Any, NamedTuple
import uuid

from icofabric_sim.sweeps.outcomes import Column

_RESULT, _FAILURE = 'result.json', 'failure.json'
_WORK, _LOCKS, _FILES, _IDENTITY = '.work', '.locks', '.files', '.identity'
_LENGTH = 32
# Errors of file systems without locks, and of renaming to an existing folder.
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS, errno.EINVAL)
_THERE_ALREADY = (errno.EEXIST, errno.ENOTEMPTY)


class Finished(NamedTuple):
    """Stored results of a run."""

    columns: tuple[Column, ...]
    reason: str  # of a failed run; '': not failed


class Store:
    """Finished runs by their keys."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Set the folder; `prepare` creates it."""
        self.path = Path(path).expanduser().absolute()

    def prepare(self) -> None:
        """Create the folder; delete unfinished runs of killed workers of this machine."""
        for name in (_WORK, _LOCKS, _FILES):
            (self.path / name).mkdir(parents=True, exist_ok=True)
        self._identify()
        for left in (self.path / _WORK).iterdir():
            host, process = left.name.split('@')[1:3] if left.name.count('@') == 3 else ('', '')
            if host == socket.gethostname() and not Path(f'/proc/{process}').exists():
                shutil.rmtree(left, ignore_errors=True)

    @property
    def identity(self) -> str:
        """Unique identifier of the store, '' without a store."""
        with suppress(FileNotFoundError, NotADirectoryError):
            return (self.path / _IDENTITY).read_text('ascii')
        return ''

    def is_one(self, identity: str = '') -> bool:
        """Return True if the folder is a store, with `identity` if given."""
        found = self.identity
        return bool(found) and identity in ('', found)

    def _identify(self) -> None:
        """Write the permanent identity of the store, also with several processes at once."""
        path = self.path / _IDENTITY
        if path.exists():
            return
        aside = path.with_name(f'{_IDENTITY}.{uuid.uuid4().hex}')
        aside.write_text(uuid.uuid4().hex, 'ascii')
        try:
            os.link(aside, path)
        except FileExistsError:
            pass
        except OSError:
            # A file system without links.
            aside.replace(path)
        finally:
            aside.unlink(missing_ok=True)

    def folder(self, key: str) -> Path:
        """Return the folder of a finished run."""
        return self.path / key

    def keys(self) -> set[str]:
        """Return the names of all finished runs."""
        with suppress(FileNotFoundError):
            return {entry.name for entry in os.scandir(self.path)
                    if len(entry.name) == _LENGTH and not entry.name.startswith('.')}
        return set()

    def read(self, key: str) -> Finished | None:
        """Return a finished run, or None if missing or truncated by a power failure."""
        folder = self.folder(key)
        for name in (_RESULT, _FAILURE):
            try:
                said = json.loads((folder / name).read_text('utf-8'))
                return Finished(
                    tuple(Column(column, unit, math.nan if value is None else value)
                          for column, unit, value in said['columns']),
                    str(said.get('reason', '')))
            except FileNotFoundError:
                continue
            except (ValueError, KeyError, TypeError):
                return None
        return None

    def forget(self, key: str) -> None:
        """Remove a run atomically."""
        aside = self._aside(key)
        with suppress(FileNotFoundError):
            self.folder(key).rename(aside)
        shutil.rmtree(aside, ignore_errors=True)

    @contextmanager
    def temporary_folder(self, key: str) -> Iterator[Path]:
        """Yield a folder for a run; delete the folder at the end unless `finish` has moved it."""
        aside = self._aside(key)
        aside.mkdir(parents=True)
        try:
            yield aside
        finally:
            shutil.rmtree(aside, ignore_errors=True)

    def finish(self, key: str, aside: Path, finished: Finished, facts: dict[str, Any]) -> None:
        """Write the results and rename the folder; an existing run of this key is kept."""
        said = {'columns': [[column.name, column.unit, _plain(column.value)]
                            for column in finished.columns], **facts}
        if finished.reason:
            said['reason'] = finished.reason
        with open(aside / (_FAILURE if finished.reason else _RESULT), 'w',
                  encoding='utf-8') as stream:
            json.dump(said, stream, allow_nan=False)
            stream.flush()
            os.fsync(stream.fileno())
        for _ in range(2):
            try:
                aside.rename(self.folder(key))
                return
            except OSError as error:
                if error.errno not in _THERE_ALREADY:
                    raise
            if self.read(key) is not None:
                return
            # Damaged.
            self.forget(key)

    @contextmanager
    def claim(self, key: str) -> Iterator[bool]:
        """Yield True if this process may compute the run, False if another process does."""
        path = self.path / _LOCKS / key
        with open(path, 'ab') as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                yield False
                return
            except OSError as error:
                # Without locks two processes may compute the run; the first to finish wins.
                if error.errno not in _NO_LOCKS:
                    raise
            # The last owner may have deleted the file, which is then no lock.
            if not _is_at(file.fileno(), path):
                yield False
                return
            try:
                yield True
            finally:
                path.unlink(missing_ok=True)

    def keep_file(self, digest: str, content: bytes) -> None:
        """Store a file that a scene reads, named by its SHA-256."""
        path = self.path / _FILES / digest
        with suppress(OSError):
            self.file(digest)
            return
        aside = path.with_name(f'{digest}.{uuid.uuid4().hex}')
        with open(aside, 'wb') as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        aside.replace(path)

    def file(self, digest: str) -> bytes:
        """Return the file with a SHA-256. Raise OSError if missing or damaged."""
        path = self.path / _FILES / digest
        content = path.read_bytes()
        if hashlib.sha256(content).hexdigest() != digest:
            raise OSError(
                f'{path} is damaged: its SHA-256 does not match its name; the next sweep that '
                'needs this file writes it again')
        return content

    def _aside(self, key: str) -> Path:
        name = f'{key}@{socket.gethostname()}@{os.getpid()}@{uuid.uuid4().hex[:8]}'
        return self.path / _WORK / name


def _plain(value: float | int | str) -> float | int | str | None:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _is_at(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False
