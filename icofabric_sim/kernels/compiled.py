# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The one decorator of all kernels.
"""

from collections.abc import Callable
import logging
from typing import Any

from icofabric_sim.kernels.disk_cache import KernelCache
from icofabric_sim.patience import Patience
import numba
from numba.core import config, event
from numba.core.caching import NullCache
from numba.core.registry import cpu_target

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
    kernel: Any = numba.njit(nogil=True, error_model='numpy')(function)
    if not _PLAIN:
        try:
            kernel._cache = KernelCache(function)
        except RuntimeError:
            # No folder can be written.
            kernel._cache = _NoCache()
    return kernel


class _NoCache(NullCache):
    """
    Tells kernels from what else Numba compiles in this process.
    """


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
