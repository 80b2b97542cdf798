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
import itertools
import os
import threading
from typing import Any

from icofabric_sim.kernels.runtime.numba_private import (
    cpu_target,
    FunctionIdentity,
    JITCodeLibrary,
)
import llvmlite.binding as ll


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


class _PartLibrary(JITCodeLibrary):
    """Code that is linked into kernels only."""

    def finalize(self) -> None:
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            if hasattr(library, '_reload_init'):
                # From Numba 0.59 on.
                self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._final_module.verify()
        self._finalize_final_module()

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: a part has no machine code."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """Return the content of a cache entry: the bitcode for linking."""
        self._ensure_finalized()
        return self.name, _PART, self._get_module_for_linking().as_bitcode()


class _KernelLibrary(JITCodeLibrary):
    """
    Code that only Python calls: stored as machine code, with nothing to link.

    Reading code for linking took half of the time of loading.
    """

    def _optimize_final_module(self) -> None:
        # One run: Numba's first run removes reference counts, which kernels hardly have.
        full = self._codegen._module_pass_manager()
        if isinstance(full, tuple):
            manager, builder = full
            manager.run(self._final_module, builder)
        else:
            # Numba versions before LLVM's new pass managers.
            super()._optimize_final_module()

    def serialize_using_object_code(self) -> tuple[str, str, tuple[bytes, tuple[str, ...]]]:
        """Return the content of a cache entry: machine code, and the names that it defines."""
        self._ensure_finalized()
        module = self._final_module
        names = (
            one.name for kind in (module.functions, module.global_variables) for one in kind
            if not one.is_declaration)
        return self.name, _KERNEL, (self._get_compiled_object(), tuple(names))


def _number_functions() -> None:
    """
    Start the numbers of compiled functions where no other process uses the same numbers.

    Numba distinguishes functions of one name and type by a number, and counts from 1. But a kernel
    is linked from parts that several processes have compiled. The fabs of one and the sqrt of
    another, both lambdas, would be one function there.
    """
    first = int.from_bytes(os.urandom(7), 'big')
    FunctionIdentity._unique_ids = itertools.count(first)


_number_functions()
os.register_at_fork(after_in_child=_number_functions)

_PART, _KERNEL = 'part', 'kernel'
_codegen = cpu_target.target_context.codegen()
_create, _set_env, _load = (
    _codegen.create_library, _codegen.set_env, _codegen.unserialize_library)


def _create_library(name: str, **options: Any) -> Any:
    if not _compiling.names:
        return _create(name, **options)
    library = _KernelLibrary if name == _compiling.names[-1] else _PartLibrary
    return library(_codegen, name, **options)


def _load_library(serialized: Any) -> Any:
    name, kind, data = serialized
    library: Any
    if kind == _PART:
        library = _PartLibrary(_codegen, name)
        library._final_module = library._shared_module = ll.parse_bitcode(data)
    elif kind == _KERNEL:
        library = _KernelLibrary(_codegen, name)
        code, names = data
        library.enable_object_caching()
        library._set_compiled_object(code)
        _codegen._engine._defined_symbols.update(names)
    else:
        return _load(serialized)
    library._finalize_final_module()
    return library


def _set_environment(name: str, environment: Any) -> None:
    # A part has no symbol for an environment.
    if _codegen._engine.is_symbol_defined(name):
        _set_env(name, environment)


_codegen.create_library = _create_library
_codegen.unserialize_library = _load_library
_codegen.set_env = _set_environment
# Numba reads its settings again when one of its environment variables changes. Without the fixed
# value, it would then treat cached code as code for another processor.
_magic = _codegen.magic_tuple()
_codegen.magic_tuple = lambda: _magic
