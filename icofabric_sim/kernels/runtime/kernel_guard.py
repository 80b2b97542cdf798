# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Keep one thread from compiling: a missing kernel raises KernelsMissing in this thread.

A live run has to answer while the compiler works for a minute. The run therefore rolls back the
step it began (`Driver`), and waits until another thread or process has compiled the kernel.
Kernels on disk may count as missing too. They are loaded under the lock of the compiler, which
another thread may hold for as long.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import threading
import time
from typing import TypeVar

from icofabric_sim.kernels.runtime.numba_private import (
    COMPILE_EVENT,
    compiler_lock,
    event,
    LOCK_EVENT,
    PASS_EVENT,
)
from icofabric_sim.process.compile_notice import KernelsMissing

Result = TypeVar('Result')
# Time until a kernel that another thread loads is tried again [s].
_RETRY = 1e-3


class _Guard(threading.local):
    """State of a thread that must not compile, and perhaps not load kernels either."""

    def __init__(self) -> None:
        self.is_on = False
        self.may_load: Callable[[], bool] = bool

    @property
    def forbids(self) -> tuple[str, ...]:
        if not self.is_on:
            return ()
        return (COMPILE_EVENT,) if self.may_load() else (COMPILE_EVENT, LOCK_EVENT)


class _Watch(event.Listener):
    """Listener for threads that are about to compile, or to acquire the lock of the compiler."""

    def on_start(self, happening: event.Event) -> None:
        if happening.kind in _guard.forbids:
            raise KernelsMissing

    def on_end(self, happening: event.Event) -> None:
        pass


class _End(event.Listener):
    """Listener that ends compilations of other threads between two passes, as the process ends."""

    def on_start(self, happening: event.Event) -> None:
        if threading.current_thread() is not threading.main_thread():
            raise KernelsMissing

    def on_end(self, happening: event.Event) -> None:
        pass


_guard = _Guard()
for _kind in (COMPILE_EVENT, LOCK_EVENT):
    event.register(_kind, _Watch())


@contextmanager
def no_compiling(*, loading: bool | Callable[[], bool] = False) -> Iterator[None]:
    """
    Raise KernelsMissing if this thread would compile; load kernels from disk only if `loading`.

    `loading` may be a function, which is called for each kernel.
    """
    before = _guard.is_on, _guard.may_load
    _guard.is_on, _guard.may_load = True, loading if callable(loading) else lambda: loading
    try:
        yield
    finally:
        _guard.is_on, _guard.may_load = before


@contextmanager
def none_becomes_ready() -> Iterator[None]:
    """
    Keep kernels from becoming ready meanwhile if this thread is guarded.

    Otherwise only some threads of a team would find a kernel missing.
    """
    if not _guard.forbids:
        yield
        return
    # Kernels become ready under this lock.
    if not compiler_lock.acquire(blocking=False):
        raise KernelsMissing
    try:
        yield
    finally:
        compiler_lock.release()


def is_compiler_free() -> bool:
    """Check that no other thread compiles or loads kernels."""
    if not compiler_lock.acquire(blocking=False):
        return False
    compiler_lock.release()
    return True


def end_compiling() -> None:
    """End compilations in all threads but the main one, because the process ends."""
    event.register(PASS_EVENT, _End())


def guarded_alike(
    work: Callable[..., Result], has_failed: Callable[[], bool]
) -> Callable[..., Result]:
    """
    Return `work` for other threads of a team, guarded against compilation as this thread is.

    The other threads start once the kernel is ready, which this thread may load. They end if
    `has_failed` returns True.
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
