# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The one decorator of all kernels."""

import builtins
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, update_wrapper
import gc
import inspect
import sys
from types import CodeType, FunctionType
from typing import Any

from icofabric_sim.kernels.runtime.disk_cache import KernelCache
from icofabric_sim.kernels.runtime.parts import compiling
from icofabric_sim.kernels.runtime.target import kernel_target, target
from icofabric_sim.process.compile_notice import compile_notice
from icofabric_sim.process.interrupts import exit_request
from numba.core import config, event
from numba.core.caching import NullCache
from numba.core.registry import cpu_target, CPUDispatcher
from numba.core.types import unliteral

_PLAIN = bool(getattr(config, 'DISABLE_JIT', 0))


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """
    Compile `function` on first use, cached on disk, without the interpreter lock, IEEE division.
    """
    if _PLAIN:
        return function
    return _Kernel(function)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """
    Compile `function` as `compiled` does, and always into the functions that call it.

    For what is done for every block: left to itself the optimiser looks at the length of a
    function alone, and a call of one costs as much as a part of its work.
    """
    if _PLAIN:
        return function
    return _Kernel(function, inline=True)


class _NoCache(NullCache):
    """Tells kernels from what else Numba compiles in this process."""


class _Part(CPUDispatcher):
    """
    A kernel as other kernels call it: without entrances for Python and C.

    With an `entrance`, that is compiled in its place, and kept on disk as the kernel.
    """

    _compiler: Any

    def __init__(
        self, function: Callable[..., Any], *, inline: bool = False,
        entrance: Callable[..., Any] | None = None
    ) -> None:
        super().__init__(entrance or function, targetoptions={
            'nopython': True, 'nogil': True, 'error_model': 'numpy', 'boundscheck': None,
            'forceinline': inline,
            'no_cpython_wrapper': entrance is None, 'no_cfunc_wrapper': True})
        self._made_of = function
        self._kept: Any = None
        self._entrance = function.__qualname__ if entrance else ''

    @property
    def _cache(self) -> Any:
        """What is on disk; looked for when something asks for it, as few kernels are used."""
        if self._kept is None:
            self._kept = _NoCache()
            # Else no folder can be written.
            with suppress(RuntimeError):
                self._kept = KernelCache(self._made_of, entrance=bool(self._entrance))
        return self._kept

    @_cache.setter
    def _cache(self, unused: Any) -> None:
        """Numba begins with a cache that holds nothing."""

    def _compilation_chain_init_hook(self) -> None:
        """Types of other packages, which Numba looks for before it reads those of arguments."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """
        How another kernel calls this one: with numbers of the source as with any others.

        To Numba each is a type of its own, for which all would be compiled once more.
        """
        return super().get_call_template(
            tuple(unliteral(kind) for kind in args),
            {name: unliteral(kind) for name, kind in kws.items()})

    def compile(self, sig: Any) -> Any:
        """Compile for such arguments, or load what is on disk."""
        with compiling(self._entrance):
            return super().compile(sig)


class _Kernel(_Part):
    """
    A kernel as Python calls it: an entrance to its part.

    So what both Python and other kernels call is typed and written once.
    """

    def __init__(self, function: Callable[..., Any], *, inline: bool = False) -> None:
        self._inline = inline
        self._part: _Part | None = None
        self._call = _handing_on(function)
        super().__init__(function, entrance=self._call)
        update_wrapper(self, function)
        self.py_func = function
        self._compile_call, self._compiler.compile = self._compiler.compile, self._compile

    def _compile(self, arguments: Any, result: Any) -> Any:
        # A part is made when something asks for it: where all is on disk nothing does.
        self._call.__globals__['part'] = self._as_part()
        return self._compile_call(arguments, result)

    # What other kernels ask for.
    def get_call_template(self, args: Any, kws: Any) -> Any:
        return self._as_part().get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        return self._as_part().get_overload(sig)

    def is_ready(self, *arguments: Any) -> bool:
        """Whether nothing has to be compiled for such arguments: it is loaded, or on disk."""
        types = tuple(self.typeof_pyval(argument) for argument in arguments)
        return types in self.overloads or (
            isinstance(self._cache, KernelCache)
            and self._cache.holds(types, self.targetctx))

    def _as_part(self) -> _Part:
        if self._part is None:
            self._part = _Part(self.py_func, inline=self._inline)
        return self._part


def _handing_on(function: Callable[..., Any]) -> Any:
    """Make a function of the same name and arguments that hands them on to `part`."""
    names = function.__code__.co_varnames[:function.__code__.co_argcount]
    code = _call_of(len(names)).replace(
        co_varnames=names, co_name=function.__name__, co_qualname=function.__qualname__)
    call = FunctionType(code, {'__builtins__': builtins})
    call.__module__ = function.__module__
    # Which Numba would find out twice, a third of the time that a kernel takes to be defined.
    call.__signature__ = inspect.signature(call)  # type: ignore[attr-defined]
    return call


@cache
def _call_of(count: int) -> CodeType:
    """The code of a function that hands so many arguments on to `part`."""
    names = ', '.join(f'argument_{number}' for number in range(count))
    made: dict[str, Any] = {}
    exec(f'def call({names}):\n    return part({names})\n', made)
    code: CodeType = made['call'].__code__
    return code


class _Compilations(event.Listener):
    """Reports the compilation of kernels; what comes from disk is none."""

    def __init__(self) -> None:
        self._depth = 0
        self._collects = False

    def on_start(self, happening: event.Event) -> None:
        cache = getattr(happening.data['dispatcher'], '_cache', None)
        if not self._depth and not isinstance(cache, (KernelCache, _NoCache)):
            return
        compile_notice.require_allowed()
        self._depth += 1
        if self._depth == 1:
            # Of millions of objects that the compiler keeps: a fifth of its time.
            self._collects = gc.isenabled()
            gc.disable()
        reason = target().why
        compile_notice.begin(
            kept=isinstance(cache, KernelCache),
            remark=f'; for {kernel_target()} alone, because {reason}' if reason else '')
        _set_up_compiler()

    def on_end(self, happening: event.Event) -> None:
        if self._depth:
            self._depth -= 1
            if not self._depth and self._collects:
                gc.enable()
            compile_notice.end()


class _Passes(event.Listener):
    """Ends a compilation between its passes where the process is to end."""

    def on_start(self, happening: event.Event) -> None:
        exit_request.check()

    def on_end(self, happening: event.Event) -> None:
        pass


@contextmanager
def _blas_is_there() -> Iterator[None]:
    """
    Spare Numba the import of scipy.linalg, by which it learns that there is BLAS: a fifth of ours.

    There is, as this package needs SciPy; code that calls it imports it when it is compiled.
    """
    from numba.np import linalg

    if 'numba.np.arraymath' in sys.modules:  # it has asked already
        yield
        return
    asks, linalg.ensure_blas = linalg.ensure_blas, lambda: None
    try:
        yield
    finally:
        linalg.ensure_blas = asks
        arraymath = sys.modules.get('numba.np.arraymath')
        if arraymath is not None:
            arraymath.ensure_blas = asks  # type: ignore[attr-defined]


@cache
def _set_up_compiler() -> None:
    """Have Numba load all that it can compile: a tenth of a node's start, where nothing is."""
    with _blas_is_there():
        cpu_target.typing_context.refresh()
        cpu_target.target_context.refresh()


if not _PLAIN:
    event.register('numba:compile', _Compilations())
    event.register('numba:run_pass', _Passes())
