# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Store compiled kernels on disk: cache keys, the cache folder, and recovery from disk errors.

Kernels lie in the user's cache folder, below a stamp of their source; NUMBA_CACHE_DIR names
another folder. They are never written into the package: pip leaves files that it did not install,
and such a remnant shadows an editable install. A wheel may contain compiled kernels, which are
only read (`make wheel`). A disk error never ends a run: the kernel is compiled.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import fcntl
from functools import cache
import glob
import hashlib
import logging
import os
from pathlib import Path
import re
import shutil
import tempfile
from typing import Any
import uuid

from icofabric_sim.kernels.runtime.lane_types import LANES
from icofabric_sim.kernels.runtime.numba_private import (
    cache_folder_setting,
    CacheFile,
    DiskCache,
)
import llvmlite
import numba

_LOGGER = logging.getLogger('icofabric_sim')
_PACKAGE = Path(__file__).resolve().parents[2]
# Kernels that a wheel contains, in folders by stamp. A clone has no such folder.
_SHIPPED = _PACKAGE / 'kernels' / 'compiled'


# The rooms of the compiled functions and of their constants. They import no other room
# (test/kernels/test_kernel_cache.py checks their imports).
_STAMPED = ('geometry', 'kernels', 'terms')
# Files of terms that kernels do not read (docs/architecture.md).
_NOT_COMPILED = {'device.py', 'parameters.py', 'curve.py'}
# A folder of compiled kernels takes some 100 MB. Installations and working trees that share the
# cache folder rarely have more different sources in use.
_MAX_STAMP_COUNT = 12
_STAMP_NAME = re.compile('[0-9a-f]{16}')


def _source_files() -> list[tuple[str, int]]:
    """Return the paths of the source of all kernels and the time of last change of each [ns]."""
    paths = []
    for room in _STAMPED:
        for folder, subfolders, names in os.walk(_PACKAGE / room):
            # Neither has source files, and both have many other files.
            subfolders[:] = {*subfolders} - {'__pycache__', _SHIPPED.name}
            paths += [
                os.path.join(folder, name) for name in names
                if name.endswith('.py') and (room != 'terms' or name not in _NOT_COMPILED)]
    return sorted((path, os.stat(path).st_ctime_ns) for path in paths)


def _is_as_stamped() -> bool:
    """
    Check that no source file has changed since the stamp; files added later are not examined.
    """
    try:
        return all(os.stat(path).st_ctime_ns == changed for path, changed in _FILES)
    except OSError:
        return False


def _source_stamp() -> tuple[str, str]:
    """
    Return the hash of the source of all kernels, and the version of the compiler.

    All kernels share one hash because they call each other. Numba would hash only the file of a
    function, and adds its own version.
    """
    digest, first = hashlib.sha256(), len(str(_PACKAGE)) + 1
    for path, _ in _FILES:
        with open(path, 'rb') as file:
            text = file.read()
        digest.update(f'{path[first:]} {len(text)}\n'.encode() + text)
    return digest.hexdigest(), llvmlite.__version__


_FILES = _source_files()
_STAMP = _source_stamp()


def kernel_cache_folder() -> str:
    """
    Return the folder of all compiled kernels, whatever source they were compiled from.

    Raises
    ------
    OSError
        If neither NUMBA_CACHE_DIR nor XDG_CACHE_HOME is set and the user has no home folder.
    """
    named = cache_folder_setting()
    if named:
        return os.path.abspath(os.path.join(named, 'icofabric_sim'))
    # Programs ignore a relative XDG_CACHE_HOME (XDG Base Directory Specification).
    user = os.environ.get('XDG_CACHE_HOME', '')
    if not os.path.isabs(user):
        user = os.path.expanduser('~/.cache')
    if not os.path.isabs(user):
        raise OSError('the user has no home folder')
    return os.path.join(user, 'icofabric_sim', 'kernels')


def stamp_folder_name() -> str:
    """Return the name of the folder of kernels of this source and these versions of Numba."""
    return hashlib.sha256(repr((_STAMP, numba.__version__)).encode()).hexdigest()[:16]


@cache
def _shipped_folder() -> str:
    """Return the folder of kernels of this source that the wheel contains, '' if none."""
    # One look at the disk in a clone.
    folder = os.path.join(_SHIPPED, stamp_folder_name())
    return folder if os.path.isdir(folder) else ''


@cache
def _prepare_stamp_folder(root: str) -> str:
    """
    Return the folder below `root` for kernels of this source, and remove those long unused.

    The time of change of a folder is that of its last use.
    """
    folder = os.path.join(root, stamp_folder_name())
    is_new = not os.path.isdir(folder)
    os.makedirs(folder, exist_ok=True)
    with suppress(OSError):  # a shared folder that this user may only read
        os.utime(folder)
        if is_new:
            _remove_unused(root)
    return folder


def _remove_unused(root: str) -> None:
    """Remove the kernels of other sources but the most recently used."""
    with os.scandir(root) as entries:
        folders = [one for one in entries if _STAMP_NAME.fullmatch(one.name) and one.is_dir()]
    folders.sort(key=lambda one: one.stat().st_mtime_ns, reverse=True)
    for folder in folders[_MAX_STAMP_COUNT:]:
        shutil.rmtree(folder.path, ignore_errors=True)


class _Locator:
    """The place of one kernel in the cache folder, by the protocol of Numba's locators."""

    def __init__(self, function: Callable[..., Any], path: str) -> None:
        self._path, self._line = path, function.__code__.co_firstlineno
        source = Path(path).resolve()
        name = (
            str(source.parent.relative_to(_PACKAGE)) if source.is_relative_to(_PACKAGE)
            else hashlib.sha256(str(source).encode()).hexdigest()[:16])
        shipped = _shipped_folder()
        self.shipped_path = os.path.join(shipped, name) if shipped else ''
        self.is_writable = True
        try:
            self._folder = os.path.join(_prepare_stamp_folder(kernel_cache_folder()), name)
            self.ensure_cache_path()
        except OSError:
            if not shipped:
                raise
            self._folder, self.is_writable = self.shipped_path, False

    @classmethod
    def from_function(cls, function: Callable[..., Any], path: str) -> Any:
        """Return the locator, or None if there is no source file or no folder."""
        if not os.path.isfile(path):
            return None
        try:
            return cls(function, path)
        except OSError:
            return None

    def ensure_cache_path(self) -> None:
        """Create the folder. Raise OSError if nothing can be written there."""
        _require_writable(self._folder)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return self._folder

    def get_source_stamp(self) -> bytes:
        """Return a hash of the source file."""
        return _hash_of_file(self._path)

    def get_disambiguator(self) -> str:
        """Return the line of the function, which tells it from others of its name."""
        return str(self._line)


@cache
def _require_writable(folder: str) -> None:
    """Create `folder`. Raise OSError if nothing can be written there."""
    os.makedirs(folder, exist_ok=True)
    tempfile.TemporaryFile(dir=folder).close()


@cache
def _hash_of_file(path: str) -> bytes:
    """Return a hash of the content of a source file as this process has first read it."""
    return hashlib.sha256(Path(path).read_bytes()).digest()


class _CacheFile(CacheFile):
    """
    The index of a kernel and its entries, safe against other processes and damage.

    Entries of `shipped`, the file of the same kernel in a wheel, are only read.
    """

    shipped: CacheFile | None = None

    def load(self, key: Any) -> Any:
        """Return the entry of a key, or None."""
        entry = super().load(key)
        return self.shipped.load(key) if entry is None and self.shipped is not None else entry

    def holds(self, key: Any) -> bool:
        """Return True if the index has the key."""
        return super().holds(key) or (self.shipped is not None and self.shipped.holds(key))

    def read_index(self) -> Any:
        """Return the file name of each entry; empty if the index cannot be read."""
        try:
            return super().read_index()
        except Exception:  # noqa: BLE001 - truncated, or it names records that no longer exist
            return {}

    def read_entry(self, name: str) -> Any:
        """Return the content of an entry. Raise OSError if the entry cannot be read."""
        try:
            return super().read_entry(name)
        except Exception as error:  # noqa: BLE001 - truncated by a full disk or a power failure
            raise OSError(f'{name} cannot be read') from error

    def entry_name(self, number: int) -> str:
        """Return a file name that no other process uses."""
        # Numba numbers the entries. An index may then name an entry of an older source or of other
        # arguments: after a process ended before it wrote the entry, or two processes raced.
        return f'{self.name}.{uuid.uuid4().hex[:16]}.nbc'

    def write_index(self, names: Any) -> None:
        """Write the file name of each entry; remove entries of older sources."""
        super().write_index(names)
        if len(names) > 1:
            # The first entry has cleared the folder. Listing thousands of files for each further
            # entry would take a noticeable fraction of the compile time.
            return
        used = set(names.values())
        for path in glob.glob(os.path.join(
                glob.escape(self.folder), f'{glob.escape(self.name)}.*.nbc')):
            if os.path.basename(path) not in used:
                Path(path).unlink(missing_ok=True)


@contextmanager
def _one_writer(folder: str) -> Iterator[None]:
    """Lock `folder` against other processes, whose writes would drop each other's entries."""
    os.makedirs(folder, exist_ok=True)
    with open(os.path.join(folder, 'icofabric.lock'), 'ab') as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


class KernelCache(DiskCache, locator=_Locator):
    """The entries of one kernel."""

    # The error by which entries could not be written, once it has been logged.
    _lost = ''

    def __init__(self, function: Callable[..., Any], *, entrance: bool) -> None:
        """
        Raise RuntimeError if no folder can be written and the wheel has no kernels.

        `entrance`: the entries can be called from Python, not from other kernels only.
        """
        super().__init__(function)
        self._entrance = entrance

    def open_file(self, folder: str, name: str, source_stamp: Any) -> _CacheFile:
        """Return the index and the entries of this kernel, which are valid for one source."""
        stamp = (_STAMP, source_stamp)
        file = _CacheFile(folder, name, stamp)
        if self.locator.shipped_path and self.is_writable:
            file.shipped = _CacheFile(self.locator.shipped_path, name, stamp)
        return file

    @property
    def is_writable(self) -> bool:
        """True if kernels that are compiled now are written to disk."""
        return bool(self.locator.is_writable)

    def key_parts(self) -> tuple[Any, ...]:
        """
        Return the number of lanes, and whether the entries can be called from Python.

        Numba's key has the target: a level of x86-64, or a processor (target.py). If only its
        features are set, the processor at hand determines the number of lanes.
        """
        return LANES, self._entrance

    def save_overload(self, sig: Any, data: Any) -> None:
        """
        Write a compiled kernel to disk if its source has not changed since the stamp.

        A source that changed after the stamp may have been read after its change. A disk error is
        logged once.
        """
        try:
            if not self.is_writable or not _is_as_stamped():
                return
            with _one_writer(self.cache_path):
                super().save_overload(sig, data)
        except OSError as error:
            if not KernelCache._lost:
                KernelCache._lost = str(error)
                _LOGGER.warning(
                    'compiled kernels cannot be kept on disk, the next start compiles them again: '
                    '%s; NUMBA_CACHE_DIR names another folder for them', error)
