# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The one decorator of all kernels.
"""

from collections.abc import Callable
from contextlib import suppress
import logging
from typing import Any

from icofabric_sim.kernels.disk_cache import KernelCache
from icofabric_sim.patience import Patience
from numba.core import config, event
from numba.core.caching import NullCache
from numba.core.registry import cpu_target, CPUDispatcher

_LOGGER = logging.getLogger('icofabric_sim')
_PLAIN = bool(getattr(config, 'DISABLE_JIT', 0))
_COMPILING = 'compiling the kernels of this kind of scene, which takes up to half a minute'
_ONCE = 'once on a machine: later starts take them from disk'
_ALWAYS = (
    'at every start: neither the folder of the package nor the cache folder of the user can be '
    'written; NUMBA_CACHE_DIR=FOLDER names another place for compiled kernels')


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """
    Compile `function` on first use, cached on disk, without the interpreter lock, IEEE division.
    """
    if _PLAIN:
        return function
    return _Kernel(function)


class _NoCache(NullCache):
    """
    Tells kernels from what else Numba compiles in this process.
    """


class _Part(CPUDispatcher):
    """
    A kernel as other kernels call it: without entrances for Python and C.

    Such an entrance takes records of a hundred arrays apart: a third of all compilation.
    """

    def __init__(self, function: Callable[..., Any], *, entrance: bool = False) -> None:
        super().__init__(function, targetoptions={
            'nopython': True, 'nogil': True, 'error_model': 'numpy', 'boundscheck': None,
            'no_cpython_wrapper': not entrance, 'no_cfunc_wrapper': True})
        self._cache: Any = _NoCache()
        # Else no folder can be written.
        with suppress(RuntimeError):
            self._cache = KernelCache(function, entrance=entrance)


class _Kernel(_Part):
    """
    A kernel as Python calls it.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function, entrance=True)
        self._part: _Part | None = None

    # What other kernels ask for.
    def get_call_template(self, args: Any, kws: Any) -> Any:
        return self._as_part().get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        return self._as_part().get_overload(sig)

    def is_ready(self, *arguments: Any) -> bool:
        """
        Whether nothing has to be compiled for such arguments: it is loaded, or on disk.
        """
        types = tuple(self.typeof_pyval(argument) for argument in arguments)
        return types in self.overloads or (
            isinstance(self._cache, KernelCache)
            and self._cache.holds(types, self.targetctx))

    def _as_part(self) -> _Part:
        # Not at once: where all is on disk nothing asks for it.
        if self._part is None:
            self._part = _Part(self.py_func)
        return self._part


class _Compilations(event.Listener):
    """
    Has a long compilation of kernels explained; what comes from disk is none.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._kept = True
        self._patience = Patience(self._explain)

    def on_start(self, happening: event.Event) -> None:
        cache = getattr(happening.data['dispatcher'], '_cache', None)
        if not self._depth and not isinstance(cache, (KernelCache, _NoCache)):
            return
        self._depth += 1
        if self._depth == 1:
            self._kept = isinstance(cache, KernelCache)
            self._patience.begin()

    def on_end(self, happening: event.Event) -> None:
        if self._depth:
            self._depth -= 1
            if not self._depth:
                self._patience.end()

    def _explain(self) -> None:
        if not self._kept:
            _LOGGER.warning('%s %s', _COMPILING, _ALWAYS)
        else:
            # Where nobody has set up logging, Python shows warnings only.
            level = logging.INFO if _LOGGER.hasHandlers() else logging.WARNING
            _LOGGER.log(level, '%s %s', _COMPILING, _ONCE)


if not _PLAIN:
    event.register('numba:compile', _Compilations())
    # Numba sets itself up in the first call of a kernel, which takes as long as several thousand
    # steps of a small fabric: rather now, while everybody waits for imports.
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
