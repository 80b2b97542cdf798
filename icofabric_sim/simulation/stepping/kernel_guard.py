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
Keeps one thread from compiling: where a kernel is missing it hears of it, and does other things.

A live run has to answer while the compiler works for a minute, so it takes back what it began
(`Driver`) and waits until another thread or process has the kernel ready. Kernels on disk count as
missing too: they are loaded under the lock of the compiler.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import threading
from typing import TypeVar

from icofabric_sim.kernels.runtime.compile_notice import KernelsMissing
from numba.core import event

Result = TypeVar('Result')


class _Guard(threading.local):
    """Whether this thread must not compile."""

    def __init__(self) -> None:
        self.is_on = False


class _Watch(event.Listener):
    """Hears when a thread is about to ask for the lock of the compiler."""

    def on_start(self, happening: event.Event) -> None:
        if _guard.is_on:
            raise KernelsMissing

    def on_end(self, happening: event.Event) -> None:
        pass


class _End(event.Listener):
    """Ends compilations of other threads between their passes, as the process ends."""

    def on_start(self, happening: event.Event) -> None:
        if threading.current_thread() is not threading.main_thread():
            raise KernelsMissing

    def on_end(self, happening: event.Event) -> None:
        pass


_guard = _Guard()
event.register('numba:compiler_lock', _Watch())


@contextmanager
def no_compiling() -> Iterator[None]:
    """Have KernelsMissing raised where this thread would load or compile a kernel."""
    before, _guard.is_on = _guard.is_on, True
    try:
        yield
    finally:
        _guard.is_on = before


def end_compiling() -> None:
    """Have other threads than the main one compile nothing any more: the process ends."""
    event.register('numba:run_pass', _End())


def guarded_alike(work: Callable[..., Result]) -> Callable[..., Result]:
    """Return `work` for another thread, which must not compile where this one must not."""
    if not _guard.is_on:
        return work

    def guarded(*arguments: object) -> Result:
        with no_compiling():
            return work(*arguments)

    return guarded
