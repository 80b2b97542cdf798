# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Run dense linear algebra in one thread.

OpenBLAS also divides small matrices among threads, which then wait for each other. On a busy
machine that takes ten times as long as the computation itself.
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
    """Limit every loaded OpenBLAS to one thread inside the block."""
    before = [(set_count, get_count()) for get_count, set_count in _libraries()]
    for set_count, _ in before:
        set_count(1)
    try:
        yield
    finally:
        for set_count, count in before:
            set_count(count)


def _libraries() -> tuple[tuple[Any, Any], ...]:
    """Return the functions of each library that get and set its number of threads."""
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
        for getter, setter in _NAMES:
            if hasattr(library, getter) and hasattr(library, setter):
                found.append((getattr(library, getter), getattr(library, setter)))
    return tuple(found)
