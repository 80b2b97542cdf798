# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Imports Numba, and tells it what to compile for before it makes its code generator; see target.py.
"""

from collections.abc import Iterator
from contextlib import contextmanager
import os
import sys

from icofabric_sim.kernels.runtime.target import target
from llvmlite.binding import ffi


@contextmanager
def _importing_numba() -> Iterator[None]:
    """
    Import Numba without what only its reports need.

    The package coverage, which it imports wherever it is installed, a tenth of its own import; and
    an event at each call of LLVM, for timers, a fifteenth of what compiling takes.
    """
    bars = 'coverage' not in sys.modules and (
        os.environ.get('NUMBA_JIT_COVERAGE', '0') in ('', '0'))
    register = ffi.register_lock_callback
    ffi.register_lock_callback = lambda *_: None
    if bars:
        sys.modules['coverage'] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        ffi.register_lock_callback = register
        if bars:
            del sys.modules['coverage']


with _importing_numba():
    from numba.core import config

if target().level:
    config.CPU_NAME = target().level  # type: ignore[attr-defined]
    config.CPU_FEATURES = target().features  # type: ignore[attr-defined]
