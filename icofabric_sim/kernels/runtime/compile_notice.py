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
"""
What is said of the compiler while it works, how long it has worked, and how it is ended early.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import logging
import threading

from icofabric_sim.kernels.runtime.interrupts import leaving
from icofabric_sim.kernels.runtime.target import kernel_target, target
from icofabric_sim.kernels.runtime.wait_notice import Patience

_LOGGER = logging.getLogger('icofabric_sim')
# With figures in docs/performance.md, "The first start".
COMPILING = 'compiling the kernels of this kind of scene, which takes 20 s to two minutes'
STILL_COMPILING = 'still compiling the kernels'
_ONCE = 'once on a machine: later starts take them from disk'
_ALWAYS = (
    'at every start: the cache folder of the user cannot be written; NUMBA_CACHE_DIR=FOLDER '
    'names another place for compiled kernels')


class KernelsMissing(Exception):
    """Something would have to be compiled where that is not wanted."""


class CompileNotice:
    """Hears when compilations begin and end, from whatever thread; they may be nested."""

    def __init__(self) -> None:
        """Nothing has been compiled yet."""
        self._lock, self._depth = threading.Lock(), 0
        self.is_forbidden = False
        self._kept, self._told = True, False
        self._patience = Patience(self._explain)
        self._show: Callable[[str], object] | None = None

    @property
    def seconds(self) -> float:
        """Wall time [s] that compiling has taken in this process so far."""
        return self._patience.seconds

    @property
    def is_compiling(self) -> bool:
        """Whether a compilation goes on."""
        return self._depth > 0

    @contextmanager
    def forbidden(self) -> Iterator[None]:
        """Have KernelsMissing raised where something would be compiled."""
        before, self.is_forbidden = self.is_forbidden, True
        try:
            yield
        finally:
            self.is_forbidden = before

    def require_allowed(self) -> None:
        """Raise KernelsMissing where compiling is forbidden."""
        if self.is_forbidden:
            raise KernelsMissing

    def begin(self, *, kept: bool) -> None:
        """
        Note that a kernel is being compiled; `kept`: it will be on disk.

        Raises KeyboardInterrupt where the process is to end; `end` is called all the same.
        """
        with self._lock:
            self._depth += 1
            if self._depth == 1:
                self._kept = kept
                self._patience.begin()
        leaving.check()

    def end(self) -> None:
        """Note that it is compiled."""
        with self._lock:
            self._depth -= 1
            if not self._depth:
                self._patience.end()

    @contextmanager
    def shown_by(self, show: Callable[[str], object]) -> Iterator[None]:
        """Have the words shown by `show` instead of the log."""
        before, self._show = self._show, show
        try:
            yield
        finally:
            self._show = before

    def _explain(self, seconds: float) -> None:
        first, self._told = not self._told or seconds < 10.0, True
        text = f'{STILL_COMPILING}, for {seconds:.0f} s so far'
        if first:
            text = f'{COMPILING}, {_ONCE if self._kept else _ALWAYS}'
            if target().why:
                text += f'; for {kernel_target()} alone, because {target().why}'
        # Where logging is not set up, Python shows warnings only.
        level = logging.INFO if _LOGGER.hasHandlers() and self._kept else logging.WARNING
        if self._show is not None:
            self._show(text)
        else:
            _LOGGER.log(level, '%s', text)


# Of this process.
compile_notice = CompileNotice()
