# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
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
import time
from typing import TypeVar

from icofabric_sim.process.compile_notice import KernelsMissing
from numba.core import event
from numba.core.compiler_lock import global_compiler_lock

Result = TypeVar('Result')
# Until a kernel that another thread loads is tried again [s].
_RETRY = 1e-3


class _Guard(threading.local):
    """Whether this thread must not compile, or not even load."""

    def __init__(self) -> None:
        self.is_on = False
        self.may_load: Callable[[], bool] = bool

    @property
    def forbids(self) -> tuple[str, ...]:
        if not self.is_on:
            return ()
        return (_COMPILING,) if self.may_load() else (_COMPILING, _LOADING)


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


_COMPILING, _LOADING = 'numba:compile', 'numba:compiler_lock'
_guard = _Guard()
for _kind in (_COMPILING, _LOADING):
    event.register(_kind, _Watch())


@contextmanager
def no_compiling(*, loading: bool | Callable[[], bool] = False) -> Iterator[None]:
    """
    Have KernelsMissing raised where this thread would compile; load a kernel if `loading`.

    `loading` may be a function, which is asked at each kernel.
    """
    before = _guard.is_on, _guard.may_load
    _guard.is_on, _guard.may_load = True, loading if callable(loading) else lambda: loading
    try:
        yield
    finally:
        _guard.is_on, _guard.may_load = before


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


def guarded_alike(
    work: Callable[..., Result], has_failed: Callable[[], bool]
) -> Callable[..., Result]:
    """
    Return `work` for other threads of a team, which must not compile where this one must not.

    They begin once the kernel is there, which this thread may load, or end where it `has_failed`.
    """
    if not _guard.forbids:
        return work

    def guarded(*arguments: object) -> Result:
        while True:
            try:
                with no_compiling():
                    return work(*arguments)
            except KernelsMissing:
                if has_failed():
                    raise
                time.sleep(_RETRY)

    return guarded
