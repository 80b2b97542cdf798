# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Import Numba, and set its compile target before Numba makes its code generator; see target.py.
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
    Import Numba without features that only its reports need.

    Numba imports the package coverage if it is installed, a tenth of the import time. Numba also
    records an event for timers at each call of LLVM, a fifteenth of the compile time.
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
