# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Compiled parts of kernels: stored for linking, never turned into separate machine code.

Numba optimises every function in full and emits its machine code, and does both again in each
function that calls it, though only functions that Python calls are ever run separately. A part
gets passes over its own functions; the kernel that contains it is optimised as a whole, once.
"""

from collections.abc import Iterator
from contextlib import contextmanager
import os
import threading

from icofabric_sim.kernels.runtime.numba_private import (
    KernelLibrary,
    number_functions_from,
    PartLibrary,
    use_libraries,
)


class _Compiling(threading.local):
    """Names of the libraries that this thread compiles, the innermost last; '' for a part."""

    def __init__(self) -> None:
        self.names: list[str] = []


_compiling = _Compiling()


@contextmanager
def compiling(kernel: str) -> Iterator[None]:
    """Mark that this thread compiles the kernel of this qualified name; '' for a part."""
    _compiling.names.append(kernel)
    try:
        yield
    finally:
        _compiling.names.pop()


def _number_functions() -> None:
    """
    Start the numbers of compiled functions where no other process uses the same numbers.

    Numba distinguishes functions of one name and type by a number, and counts from 1. But a kernel
    is linked from parts that several processes have compiled. The fabs of one and the sqrt of
    another, both lambdas, would be one function there.
    """
    number_functions_from(int.from_bytes(os.urandom(7), 'big'))


_number_functions()
os.register_at_fork(after_in_child=_number_functions)


def _library_class(name: str) -> type | None:
    """Return the class of the library of this name; None for functions that are no kernels."""
    if not _compiling.names:
        return None
    return KernelLibrary if name == _compiling.names[-1] else PartLibrary


use_libraries(_library_class)
