# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The one decorator of all kernels."""

import builtins
from collections.abc import Callable
from contextlib import suppress
from functools import cache, update_wrapper, wraps
import gc
import inspect
from types import CodeType, FunctionType
from typing import Any

from icofabric_sim.kernels.runtime.disk_cache import KernelCache
from icofabric_sim.kernels.runtime.numba_private import (
    cache_of,
    COMPILE_EVENT,
    Dispatcher,
    event,
    is_compiling_disabled,
    NullCache,
    PASS_EVENT,
    set_up_compiler,
    unliteral,
)
from icofabric_sim.kernels.runtime.parts import compiling
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.kernels.runtime.target import kernel_target, target
from icofabric_sim.process.compile_notice import compile_notice
from icofabric_sim.process.interrupts import exit_request

_PLAIN = is_compiling_disabled()


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

    Meant for work that is done for every block. The optimiser alone decides by the length of a
    function, and a call costs as much as a fraction of its work.
    """
    if _PLAIN:
        return function
    return _Kernel(function, inline=True)


def asked(function: Callable[..., Any]) -> Callable[..., Any]:
    """
    Compile `function`, and let Python ask an object in place of a record as first argument.

    A method of this name of the object is called with the other arguments. Without such a method
    the function runs in Python.
    """
    if not _PLAIN:
        return _Asked(function)

    @wraps(function)
    def ask(first: Any, *others: Any) -> Any:
        method = None if isinstance(first, Record) else getattr(first, function.__name__, None)
        return function(first, *others) if method is None else method(*others)
    return ask


def compiled_for(**ends: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """
    Return a decorator like `compiled` for a function that reads only the first fields of records.

    Records that differ in other fields share one kernel. `ends` names parameters, and for each the
    field before which the fields end; '': as `Record.common`.
    """
    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        return function if _PLAIN else _FirstFields(function, ends)
    return decorate


def in_python(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """Return the Python function of a kernel."""
    return getattr(kernel, 'py_func', kernel)


class _NoCache(NullCache):
    """A cache that marks kernels among all functions that Numba compiles in this process."""


class _Part(Dispatcher):
    """
    A kernel as other kernels call it: without wrappers for Python and C.

    An `entrance` is compiled in place of the function, and stored on disk as the kernel.
    """

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

    def find_cache(self) -> Any:
        """Return the cache on disk, opened on first access because a process uses few kernels."""
        if self._kept is None:
            self._kept = _NoCache()
            # RuntimeError: no folder can be written.
            with suppress(RuntimeError):
                self._kept = KernelCache(self._made_of, entrance=bool(self._entrance))
        return self._kept

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """
        Return the template of a call by another kernel; literal numbers count as plain numbers.

        Numba gives each literal its own type, and would compile all kernels once more for it.
        """
        return super().get_call_template(
            tuple(unliteral(kind) for kind in args),
            {name: unliteral(kind) for name, kind in kws.items()})

    def compile(self, sig: Any) -> Any:
        """Compile for such arguments, or load the kernel from disk."""
        with compiling(self._entrance):
            return super().compile(sig)


class _Kernel(_Part):
    """
    A kernel as Python calls it: an entrance to its part.

    A function that both Python and other kernels call is therefore typed and written once.
    """

    def __init__(self, function: Callable[..., Any], *, inline: bool = False) -> None:
        self._inline = inline
        self._part: _Part | None = None
        self._call = _handing_on(function)
        super().__init__(function, entrance=self._call)
        update_wrapper(self, function)
        self.py_func = function
        self.add_before_compiling(self._provide_part)

    def _provide_part(self) -> None:
        # The part is made when another kernel calls it: no kernel does if all are on disk.
        self._call.__globals__['part'] = self._as_part()

    # Attributes that other kernels read.
    def get_call_template(self, args: Any, kws: Any) -> Any:
        return self._as_part().get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        return self._as_part().get_overload(sig)

    def is_ready(self, *arguments: Any) -> bool:
        """
        Check that the kernel for such arguments is loaded or on disk and need not be compiled.
        """
        types = self.types_of(arguments)
        return types in self.overloads or (
            isinstance(self.find_cache(), KernelCache)
            and self.find_cache().holds(types, self.targetctx))

    def types_of(self, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
        """Return the types for which the kernel is compiled if it is called with `arguments`."""
        return tuple(self.typeof_pyval(argument) for argument in self.taken(arguments))

    def taken(self, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
        """Return the arguments as compiled code takes them."""
        return arguments

    def _as_part(self) -> _Part:
        if self._part is None:
            self._part = _Part(self.py_func, inline=self._inline)
        return self._part


class _Asked(_Kernel):
    """A kernel whose first argument may be an object with a method of its name."""

    def __call__(self, first: Any, *others: Any) -> Any:
        if isinstance(first, Record):
            return super().__call__(first, *others)
        method = getattr(first, self.py_func.__name__, None)
        return self.py_func(first, *others) if method is None else method(*others)


class _FirstFields(_Kernel):
    """A kernel that takes the first fields of some records."""

    def __init__(self, function: Callable[..., Any], ends: dict[str, str]) -> None:
        super().__init__(function)
        self._ends = [
            (function.__code__.co_varnames.index(name), end) for name, end in ends.items()]

    def __call__(self, *arguments: Any) -> Any:
        return super().__call__(*self.taken(arguments))

    def taken(self, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
        taken = list(arguments)
        for place, end in self._ends:
            taken[place] = arguments[place].common(end)
        return tuple(taken)


def _handing_on(function: Callable[..., Any]) -> Any:
    """Return a function of the same name and arguments that calls `part` with them."""
    names = function.__code__.co_varnames[:function.__code__.co_argcount]
    code = _call_of(len(names)).replace(
        co_varnames=names, co_name=function.__name__, co_qualname=function.__qualname__)
    call = FunctionType(code, {'__builtins__': builtins})
    call.__module__ = function.__module__
    # Numba would inspect the function twice, a third of the time of a kernel's definition.
    call.__signature__ = inspect.signature(call)  # type: ignore[attr-defined]
    return call


@cache
def _call_of(count: int) -> CodeType:
    """Return the code of a function that calls `part` with its `count` arguments."""
    names = ', '.join(f'argument_{number}' for number in range(count))
    made: dict[str, Any] = {}
    exec(f'def call({names}):\n    return part({names})\n', made)
    code: CodeType = made['call'].__code__
    return code


class _Compilations(event.Listener):
    """Listener that reports compilations of kernels, but not kernels loaded from disk."""

    def __init__(self) -> None:
        self._depth = 0
        self._collects = False

    def on_start(self, happening: event.Event) -> None:
        cache = cache_of(happening.data['dispatcher'])
        if not self._depth and not isinstance(cache, (KernelCache, _NoCache)):
            return
        compile_notice.require_allowed()
        self._depth += 1
        if self._depth == 1:
            # Garbage collection of its millions of objects takes a fifth of the compiler's time.
            self._collects = gc.isenabled()
            gc.disable()
        reason = target().why
        compile_notice.begin(
            kept=isinstance(cache, KernelCache) and cache.is_writable,
            remark=f'; for {kernel_target()} alone, because {reason}' if reason else '')
        set_up_compiler()

    def on_end(self, happening: event.Event) -> None:
        if self._depth:
            self._depth -= 1
            if not self._depth and self._collects:
                gc.enable()
            compile_notice.end()


class _Passes(event.Listener):
    """Listener that ends a compilation between two passes if the process is to end."""

    def on_start(self, happening: event.Event) -> None:
        exit_request.check()

    def on_end(self, happening: event.Event) -> None:
        pass


if not _PLAIN:
    event.register(COMPILE_EVENT, _Compilations())
    event.register(PASS_EVENT, _Passes())
