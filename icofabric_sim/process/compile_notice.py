# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Notices to the user while kernels compile, the time spent, and an early end."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import logging
import threading

from icofabric_sim.process.interrupts import exit_request
from icofabric_sim.process.wait_notice import WaitNotice

_LOGGER = logging.getLogger('icofabric_sim')
# With figures in docs/performance.md, "The first start".
COMPILING = 'compiling the kernels of this kind of scene, which takes 20 s to two minutes'
STILL_COMPILING = 'still compiling the kernels'
_ONCE = 'once on a machine: later starts take them from disk'
_ALWAYS = (
    'at every start: the cache folder of the user cannot be written; NUMBA_CACHE_DIR=FOLDER '
    'names another place for compiled kernels')


class KernelsMissing(Exception):
    """A kernel is not compiled, and compiling is forbidden."""


class CompileNotice:
    """Count of running compilations, in any thread; they may be nested."""

    def __init__(self) -> None:
        """Start with no compilation running."""
        self._lock, self._depth = threading.Lock(), 0
        self.is_forbidden = False
        self._kept, self._shown, self._remark = True, False, ''
        self._wait_notice = WaitNotice(self._explain)
        self._show: Callable[[str], object] | None = None

    @property
    def seconds(self) -> float:
        """Wall time [s] spent on compiling in this process."""
        return self._wait_notice.seconds

    @property
    def is_compiling(self) -> bool:
        """True while a compilation is running."""
        return self._depth > 0

    @contextmanager
    def forbidden(self) -> Iterator[None]:
        """Raise KernelsMissing for each kernel that would have to be compiled."""
        before, self.is_forbidden = self.is_forbidden, True
        try:
            yield
        finally:
            self.is_forbidden = before

    def require_allowed(self) -> None:
        """Raise KernelsMissing if compiling is forbidden."""
        if self.is_forbidden:
            raise KernelsMissing

    def begin(self, *, kept: bool, remark: str = '') -> None:
        """
        Note the start of a compilation.

        Raises KeyboardInterrupt if the process is to end; the caller must call `end` even then.

        Parameters
        ----------
        kept
            Whether the compiled kernel will be written to disk.
        remark
            Addition to the notice for the user.

        """
        with self._lock:
            self._depth += 1
            if self._depth == 1:
                self._kept, self._remark = kept, remark
                self._wait_notice.begin()
        exit_request.check()

    def end(self) -> None:
        """Note the end of a compilation."""
        with self._lock:
            self._depth -= 1
            if not self._depth:
                self._wait_notice.end()

    @contextmanager
    def shown_by(self, show: Callable[[str], object]) -> Iterator[None]:
        """Pass notices to `show` instead of the log."""
        before, self._show = self._show, show
        try:
            yield
        finally:
            self._show = before

    def _explain(self, seconds: float) -> None:
        first, self._shown = not self._shown or seconds < 10.0, True
        text = f'{STILL_COMPILING}, for {seconds:.0f} s so far'
        if first:
            text = f'{COMPILING}, {_ONCE if self._kept else _ALWAYS}{self._remark}'
        # If logging is not set up, Python shows warnings only.
        level = logging.INFO if _LOGGER.hasHandlers() and self._kept else logging.WARNING
        if self._show is not None:
            self._show(text)
        else:
            _LOGGER.log(level, '%s', text)


# Of this process.
compile_notice = CompileNotice()
