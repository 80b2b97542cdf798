# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Private interfaces of Numba and llvmlite: the one module that names them.

Other modules use `numba`, `numba.types`, `numba.extending`, `llvmlite.ir` and `llvmlite.binding`,
and import all else from this module. test/kernels/test_numba_private.py checks each interface, and
docs/numba.md explains how to replace each. This module also imports Numba, with the compilation
target of target.py, which Numba reads when it makes its code generator.
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
    # The settings; CPU_NAME and CPU_FEATURES are assigned below.
    from numba.core import config

if target().level:
    config.CPU_NAME = target().level  # type: ignore[attr-defined]
    config.CPU_FEATURES = target().features  # type: ignore[attr-defined]

# Emit common machine code; report what the compiler does.
from numba.core import cgutils, event  # noqa: E402

# Numbers functions of one name and type.
from numba.core.bytecode import FunctionIdentity  # noqa: E402

# Keep compiled functions on disk.
from numba.core.caching import (  # noqa: E402
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    NullCache,
)

# Makes machine code of compiled functions.
from numba.core.codegen import JITCodeLibrary  # noqa: E402

# Held while a thread compiles or loads.
from numba.core.compiler_lock import global_compiler_lock  # noqa: E402

# The code generator and the typing rules of this process; the class of compiled functions.
from numba.core.registry import cpu_target, CPUDispatcher  # noqa: E402

# Addresses of the functions of the runtime library.
from numba.core.runtime.nrt import _nrt  # noqa: E402

# Typing rules of attributes and operators.
from numba.core.typing.templates import (  # noqa: E402
    AbstractTemplate,
    AttributeTemplate,
    infer_global,
    signature,
)

__all__ = [
    'AbstractTemplate', 'AttributeTemplate', 'cgutils', 'CompileResultCacheImpl', 'config',
    'cpu_target', 'CPUDispatcher', 'event', 'FunctionCache', 'FunctionIdentity',
    'global_compiler_lock', 'IndexDataCacheFile', 'infer_global', 'JITCodeLibrary', '_nrt',
    'NullCache', 'signature', 'without_blas_check']


@contextmanager
def without_blas_check() -> Iterator[None]:
    """
    Spare Numba the import of scipy.linalg, which takes a fifth of the import time of this package.

    Numba imports scipy.linalg to check for BLAS. This package requires SciPy, so BLAS is
    available; code that calls BLAS imports it when the code is compiled.
    """
    from numba.np import linalg

    if 'numba.np.arraymath' in sys.modules:  # Numba has checked for BLAS already
        yield
        return
    check, linalg.ensure_blas = linalg.ensure_blas, lambda: None
    try:
        yield
    finally:
        linalg.ensure_blas = check
        arraymath = sys.modules.get('numba.np.arraymath')
        if arraymath is not None:
            arraymath.ensure_blas = check  # type: ignore[attr-defined]
