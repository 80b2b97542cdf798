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
(`Driver`) and waits until another thread or process has the kernel ready. Kernels on disk may
count as missing too: they are loaded under the lock of the compiler, which another thread may hold
for as long.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import threading
from typing import TypeVar

from icofabric_sim.kernels.runtime.compile_notice import KernelsMissing
from numba.core import event
from numba.core.compiler_lock import global_compiler_lock

Result = TypeVar('Result')


class _Guard(threading.local):
    """Whether this thread must not compile, or not even load; while `when` says so."""

    def __init__(self) -> None:
        self.kinds: tuple[str, ...] = ()
        self.when: Callable[[], bool] = bool

    @property
    def forbids(self) -> tuple[str, ...]:
        return self.kinds if self.kinds and self.when() else ()


class _Watch(event.Listener):
    """Hears when a thread is about to compile, or to ask for the lock of the compiler."""

    def on_start(self, happening: event.Event) -> None:
        if happening.kind in _guard.forbids:
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
_COMPILING, _LOADING = 'numba:compile', 'numba:compiler_lock'
for _kind in (_COMPILING, _LOADING):
    event.register(_kind, _Watch())


@contextmanager
def no_compiling(
    *, loading: bool = False, when: Callable[[], bool] = lambda: True
) -> Iterator[None]:
    """
    Have KernelsMissing raised where this thread would compile; load a kernel if `loading`.

    `when` says at each kernel whether that holds.
    """
    before = _guard.kinds, _guard.when
    _guard.kinds, _guard.when = (_COMPILING,) if loading else (_COMPILING, _LOADING), when
    try:
        yield
    finally:
        _guard.kinds, _guard.when = before


@contextmanager
def none_becomes_ready() -> Iterator[None]:
    """In a guarded thread: no kernel comes up meanwhile, which part of a team would miss."""
    if not _guard.forbids:
        yield
        return
    # Kernels come up under this lock.
    lock = global_compiler_lock._lock
    if not lock.acquire(blocking=False):
        raise KernelsMissing
    try:
        yield
    finally:
        lock.release()


def is_compiler_free() -> bool:
    """Whether no other thread compiles or loads."""
    lock = global_compiler_lock._lock
    if not lock.acquire(blocking=False):
        return False
    lock.release()
    return True


def end_compiling() -> None:
    """Have other threads than the main one compile nothing any more: the process ends."""
    event.register('numba:run_pass', _End())


def guarded_alike(work: Callable[..., Result]) -> Callable[..., Result]:
    """Return `work` for another thread, which must not compile where this one must not."""
    if not _guard.forbids:
        return work

    def guarded(*arguments: object) -> Result:
        with no_compiling():
            return work(*arguments)

    return guarded
