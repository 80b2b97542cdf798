# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Threads that share the work of one simulation.

Results are bit-identical for any number of threads: one thread computes each body, from values
that do not depend on the assignment.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
import logging
import os
import threading
from typing import TypeVar
import weakref

from icofabric_sim.kernels.records import Sweep, Team
from icofabric_sim.kernels.runtime.kernel_guard import guarded_alike, none_becomes_ready
from icofabric_sim.kernels.runtime.numba_private import is_compiling_disabled
from icofabric_sim.kernels.runtime.team import flag_count
from icofabric_sim.process.compile_notice import compile_notice, KernelsMissing
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.stepping.traversal_order import make_sweeps
from icofabric_sim.terms.contacts.surface import contact_scratch, Scratch
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')
Result = TypeVar('Result')

# Bodies for each thread from which a second one pays: below, waiting for each other costs more
# than it saves (`icofabric benchmark scaling`).
BODIES_PER_THREAD = 1_000
# The same of loose shells that may touch, whose steps take ten times as long.
_LOOSE_PER_THREAD = 500
# Size of teams whatever the bodies and the cores; 0: as they are worth.
_forced: ContextVar[int] = ContextVar('forced', default=0)


# Teams of this process.
_present: 'weakref.WeakSet[ThreadTeam]' = weakref.WeakSet()


def _start_anew() -> None:
    """Let teams start threads again in a forked child, which has none of the parent."""
    for team in _present:
        team.forget_threads()


os.register_at_fork(after_in_child=_start_anew)


def core_count() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def teams_of(size: int) -> Iterator[None]:
    """Compile simulations for `size` threads within this context, to compare bits."""
    token = _forced.set(size)
    try:
        yield
    finally:
        _forced.reset(token)


def size_for(wanted: int, body_count: int, *, loose: bool = False) -> int:
    """
    Return the number of threads for a number of bodies, `wanted` or fewer, with a warning.

    `loose`: shells that no connector holds, and that may touch.
    """
    cores = core_count()
    if wanted > cores:
        _LOGGER.warning(
            'solver.threads %d is more than the %d cores of this machine: %d are used; the '
            'result does not depend on it', wanted, cores, cores)
    if is_compiling_disabled():
        return 1
    if forced := _forced.get():
        return forced
    each = min(BODIES_PER_THREAD, _LOOSE_PER_THREAD) if loose else BODIES_PER_THREAD
    return min(wanted or cores, cores, max(1, body_count // each))


class ThreadTeam:
    """Threads of a simulation: `wanted` (0: one for each core), fewer for few bodies."""

    def __init__(self, wanted: int, packed: PackedScene, *, is_shared: bool = True) -> None:
        """
        Start with the thread of the caller; others start when they are first needed.

        `is_shared` is False if the work cannot be shared.
        """
        loose = packed.contact is not None and packed.model.links is None
        self.size = size_for(
            wanted, packed.layout.body_count, loose=loose) if is_shared else 1
        if compile_notice.is_forbidden:
            # A thread that finds its kernel missing would leave the others at their barrier.
            self.size = 1
        self._flags = np.zeros(flag_count(self.size), np.int64)
        self._packed = packed
        self._rooms: list[Scratch | None] = [None] * self.size
        # The same blocks in another order, where all bodies drift before one is pushed.
        self._together: list[Sweep] | None = None
        self._apart = self._sweeps = make_sweeps(
            packed.layout, packed.model.links, self.size,
            together=packed.model.coulomb is not None or packed.model.ties is not None)
        self._pool: ThreadPoolExecutor | None = None
        _present.add(self)
        self._teams: dict[int, Team] = {}

    @property
    def busy(self) -> int:
        """Number of threads with bodies: a single thread may have all of a few bodies."""
        return sum(len(sweep.pushes) > 0 for sweep in self._apart)

    def prepare_contacts(self, wanted: bool) -> None:
        """Drift all bodies before the kicks if there are contacts."""
        if wanted == (self._rooms[0] is not None):
            return
        self._teams = {}
        if not wanted:
            self._sweeps, self._rooms = self._apart, [None] * self.size
            return
        if self._together is None:
            self._together = make_sweeps(
                self._packed.layout, self._packed.model.links, self.size, together=True)
        self._sweeps = self._together
        self._rooms = [contact_scratch() for _ in range(self.size)]

    def forget_threads(self) -> None:
        """Start other threads at the next call."""
        self._pool = None

    def alone(self) -> Team:
        """Return the record of a team of one thread."""
        return Team(0, 1, self._flags, self._sweeps[0], self._rooms[0])

    def team(self, member: int) -> Team:
        """Return the record of the team for the thread `member`."""
        if member not in self._teams:
            self._teams[member] = Team(
                member, self.size, self._flags, self._sweeps[member], self._rooms[member])
        return self._teams[member]

    def run(self, work: Callable[[Team], Result]) -> Result:
        """
        Call `work` once in every thread with its member of the team; return the first result.
        """
        if self.size == 1:
            return work(self.team(0))
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.size - 1, thread_name_prefix='icofabric')
            weakref.finalize(self, self._pool.shutdown, wait=False)
        self._flags[:] = 0
        failed = threading.Event()
        begin = guarded_alike(work, failed.is_set)
        with none_becomes_ready():
            others = [
                self._pool.submit(begin, self.team(index))
                for index in range(1, self.size)]
            try:
                result = work(self.team(0))
            except KernelsMissing:
                # All of them call the same kernel, so none has begun.
                failed.set()
                for other in others:
                    other.exception()
                raise
            except BaseException:
                failed.set()
                raise
            for other in others:
                other.result()
            return result
