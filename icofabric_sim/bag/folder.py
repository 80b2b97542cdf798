# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Bag folder and its errors, without importing rosbags."""

import os
from pathlib import Path


class BagError(ValueError):
    """Error of a bag that cannot be written or read; the message gives reason and remedy."""


def require_new(path: Path) -> None:
    """Raise BagError if something exists at `path`."""
    if os.path.lexists(path):
        raise BagError(
            f'record.path: {path} exists and is never overwritten; '
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
