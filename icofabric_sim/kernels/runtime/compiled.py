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
"""The one decorator of all kernels."""

from collections.abc import Callable
from contextlib import suppress
from functools import update_wrapper
import gc
import inspect
from typing import Any

from icofabric_sim.kernels.runtime.compile_notice import compile_notice
from icofabric_sim.kernels.runtime.disk_cache import KernelCache
from icofabric_sim.kernels.runtime.interrupts import leaving
from icofabric_sim.kernels.runtime.parts import compiling
from numba.core import config, event
from numba.core.caching import NullCache
from numba.core.registry import cpu_target, CPUDispatcher

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
        self._cache: Any = _NoCache()
        # Else no folder can be written.
        with suppress(RuntimeError):
            self._cache = KernelCache(function, entrance=entrance is not None)
        self._entrance = function.__qualname__ if entrance else ''

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
    names = ', '.join(inspect.signature(function).parameters)
    made: dict[str, Any] = {}
    exec(f'def call({names}):\n    return part({names})\n', made)
    call = made['call']
    call.__name__, call.__qualname__ = function.__name__, function.__qualname__
    call.__module__ = function.__module__
    return call


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
        compile_notice.begin(kept=isinstance(cache, KernelCache))

    def on_end(self, happening: event.Event) -> None:
        if self._depth:
            self._depth -= 1
            if not self._depth and self._collects:
                gc.enable()
            compile_notice.end()


class _Passes(event.Listener):
    """Ends a compilation between its passes where the process is to end."""

    def on_start(self, happening: event.Event) -> None:
        leaving.check()

    def on_end(self, happening: event.Event) -> None:
        pass


if not _PLAIN:
    event.register('numba:compile', _Compilations())
    event.register('numba:run_pass', _Passes())
    # Numba sets itself up in the first call of a kernel, which takes as long as several thousand
    # steps of a small fabric: rather now, while everybody waits for imports.
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
