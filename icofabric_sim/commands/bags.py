# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Argument BAG of the verbs that read a bag."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from icofabric_sim.terminal import CommandFailed, InputError

_SUFFIXES = ('.mcap', '.db3')


def is_bag(path: Path) -> bool:
    """Return whether `path` denotes a bag: a folder, or a bag file."""
    return path.is_dir() or path.suffix in _SUFFIXES


def bag_path(text: str) -> Path:
    """
    Return the path of the argument BAG; reject an empty text, which Path reads as this folder.
    """
    if not text:
        raise InputError(
            'the name of the bag is empty: give the folder of a recorded run, or its file')
    return Path(text).expanduser()


@contextmanager
def bag_errors(path: Path) -> Iterator[None]:
    """
    Map errors of a bag to exit statuses: 2 (not a bag), or 1 (damaged, unfinished or foreign).
    """
    from icofabric_sim.bag import BagError
    try:
        yield
    except BagError as error:
        files = path.iterdir() if path.is_dir() else [path]
        if any(file.suffix in _SUFFIXES and file.exists() for file in files):
            raise CommandFailed(str(error)) from error
        raise InputError(str(error)) from error
