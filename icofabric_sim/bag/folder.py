# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Bag folder and its errors, without importing rosbags."""

import os
from pathlib import Path


class BagError(ValueError):
    """Error of a bag that cannot be written or read; the message gives reason and remedy."""


def require_new(path: Path) -> None:
    """Raise BagError if something exists at `path`."""
    if os.path.lexists(path):
        raise BagError(
            f'record.path: {path} already exists and will not be overwritten; '
            'choose another folder or remove it')


def absolute_path(path: str | Path) -> Path:
    """Return the absolute path of a bag, independent of later changes of the working directory."""
    if not str(path) or '\0' in str(path):
        raise BagError(f'record.path: {str(path)!r} is not the name of a folder')
    return Path(path).expanduser().absolute()


def next_free_path(path: str | Path) -> Path:
    """Return the first of PATH, PATH_1, PATH_2 ... that does not exist."""
    first = absolute_path(path)
    candidate, number = first, 0
    while os.path.lexists(candidate):
        number += 1
        candidate = first.with_name(f'{first.name}_{number}')
    return candidate
