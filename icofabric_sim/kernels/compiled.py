# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The one decorator of all kernels.

Numba's disk cache is keyed by the file of each function alone, so an edited callee in another
file would leave its callers stale. Here the key is the source of all kernels and integrators
together.
"""

from collections.abc import Callable
import hashlib
from pathlib import Path
from typing import Any

import numba

_PACKAGE = Path(__file__).resolve().parent.parent


def _source_stamp() -> tuple[str, int]:
    digest = hashlib.sha256()
    size = 0
    for folder in ('kernels', 'integrators'):
        for path in sorted((_PACKAGE / folder).glob('*.py')):
            text = path.read_bytes()
            digest.update(path.name.encode() + b'\0' + text)
            size += len(text)
    return digest.hexdigest(), size


_STAMP = _source_stamp()


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """
    Compile `function` on first use, cached on disk, without the interpreter lock, IEEE division.
    """
    kernel = numba.njit(cache=True, nogil=True, error_model='numpy')(function)
    cache_file = getattr(getattr(kernel, '_cache', None), '_cache_file', None)
    if cache_file is not None:
        cache_file._source_stamp = _STAMP
    return kernel
