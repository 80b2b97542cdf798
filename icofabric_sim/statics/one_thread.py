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
"""
Dense linear algebra in one thread.

OpenBLAS divides small matrices too among threads, which then wait for each other; where a machine
is busy that takes ten times as long as the work itself.
"""

from collections.abc import Iterator
from contextlib import contextmanager
import ctypes
from pathlib import Path
from typing import Any

_NAMES = tuple(
    (f'{prefix}openblas_get_num_threads{suffix}', f'{prefix}openblas_set_num_threads{suffix}')
    for prefix in ('', 'scipy_') for suffix in ('', '64_'))


@contextmanager
def one_thread() -> Iterator[None]:
    """Have every OpenBLAS that is loaded use one thread inside; other libraries are left alone."""
    before = [(give, ask()) for ask, give in _libraries()]
    for give, _ in before:
        give(1)
    try:
        yield
    finally:
        for give, count in before:
            give(count)


def _libraries() -> tuple[tuple[Any, Any], ...]:
    """What asks for the number of threads and what gives it, of each library."""
    try:
        lines = Path('/proc/self/maps').read_text().splitlines()
    except OSError:
        return ()
    paths = {line.split(maxsplit=5)[5] for line in lines if 'openblas' in line}
    found = []
    for path in sorted(paths):
        try:
            library = ctypes.CDLL(path)
        except OSError:
            continue
        for ask, give in _NAMES:
            if hasattr(library, ask) and hasattr(library, give):
                found.append((getattr(library, ask), getattr(library, give)))
    return tuple(found)
