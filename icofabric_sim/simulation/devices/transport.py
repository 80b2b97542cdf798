# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Messages between ranks by mpi4py: orders, arrays, poses, and reports of failures.

No rank waits forever: a waiting rank polls for reports of failures.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
import math
import os
import threading
import time
from typing import Any, Protocol
import weakref

from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.simulation.errors import RankError
from icofabric_sim.simulation.model.layout import aligned_empty
import numpy as np

_ORDER, _ARRAY, _POSES, _FAILED = 11, 12, 13, 14
# Polls for a message between two checks for failed ranks, and the number of polls that keep the
# processor.
_POLL_COUNT, _BUSY_POLL_COUNT = 64, 50
# Time [s] after which a waiting rank sleeps between polls instead of yielding the processor; the
# shortest and the longest sleep [s], and the ratio of a sleep to the time waited.
_AWAKE, _NAP, _LONGEST_NAP, _NAP_RATIO = 2e-3, 5e-5, 2e-3, 0.01
# An offer that takes longer [s] went to a process that uses its whole time slice. The scheduler
# puts whoever offers behind such a process, and lets whoever wakes from sleep in before it, so for
# a while [s] waits sleep.
_TIME_SLICE_S, _CROWDED = 2e-3, 0.02
# How long a rank that has failed waits for the others to hear of it [s].
_FAREWELL = 5.0
# Messages that no rank will take, or send, after a failure: their bytes stay where they are.
_unsent: list[Any] = []


class Holder(Protocol):
    """Owner of a run whose state the ranks hold."""

    def bring_all(self) -> None:
        """Gather all of the state."""


class Transport:
    """Messages between ranks, in a separate communicator."""

    def __init__(self, communicator: Any) -> None:
        """Connect the processes of an mpi4py `communicator`, in a collective call."""
        self._mpi: Any = import_module('mpi4py.MPI')
        self._comm = communicator.Dup()
        self.rank: int = self._comm.Get_rank()
        self.size: int = self._comm.Get_size()
        # Numbers of simulations that are gone, for the next order: who notes them is called by the
        # collector of garbage, at any moment, and must not send.
        self.dropped: list[int] = []
        # Those of the simulations that are there.
        self.holders: weakref.WeakSet[Holder] = weakref.WeakSet()
        # Small messages under way: kept until they have left.
        self._sent: list[Any] = []
        # Until when others compute on these processors, as far as one can tell.
        self._crowded_until = 0.0
        self.has_ended = False
        # Which rank has failed, and why.
        self._failure = ''
        # Tickets of threads of this process that talk to the others, in their order.
        self._turns, self._drawn, self._served = threading.Condition(), 0, 0

    @contextmanager
    def alone(self) -> Iterator[None]:
        """
        Exclude other threads from messages in the block; threads proceed in order of arrival.

        A node computes in one thread and builds a changed scene in another. Blocks must not be
        nested.
        """
        with self._turns:
            ticket, self._drawn = self._drawn, self._drawn + 1
        try:
            with self._turns:
                self._turns.wait_for(lambda: self._served == ticket)
            yield
        finally:
            # Also after an interrupt: a ticket that is not given back blocks all other threads.
            with self._turns:
                self._served += 1
                self._turns.notify_all()

    def end(self, status: int = 0) -> None:
        """
        End all other ranks after the first one has gathered their states.

        With the exit `status` of the first: of processes that end with several statuses a launcher
        reports any.
        """
        if not (self.has_failed or self.has_ended):
            for holder in list(self.holders):
                holder.bring_all()
            with self.alone():
                self.order(('end', status))
                self._send_off(math.inf)
        self.has_ended = True

    def order(self, what: Any) -> None:
        """Send an order to all other ranks: a name and its arguments."""
        self._sent = [request for request in self._sent if not request.Test()]
        while self.dropped:
            self._order(('forget', self.dropped.pop()))
        self._order(what)

    def _order(self, what: Any) -> None:
        for rank in range(self.size):
            if rank != self.rank:
                self.send_order(what, rank)

    def send_order(self, what: Any, rank: int) -> None:
        """Send an order to one rank."""
        self._sent.append(self._comm.isend(_flat(what), dest=rank, tag=_ORDER))

    def next_order(self) -> Any:
        """Wait for an order of the first rank."""
        self._wait_until(self._comm.Iprobe, 0, _ORDER)
        return _round(self._comm.recv(source=0, tag=_ORDER))

    def answer(self, what: Any) -> None:
        """Send a small answer to the first rank."""
        self._sent.append(self._comm.isend(what, dest=0, tag=_ORDER))

    def answers(self) -> list[Any]:
        """Wait for an answer of each of the other ranks, in order."""
        found = []
        for rank in range(1, self.size):
            self._wait_until(self._comm.Iprobe, rank, _ORDER)
            found.append(self._comm.recv(source=rank, tag=_ORDER))
        return found

    def send(self, values: np.ndarray, rank: int) -> Any:
        """Start to send an array of doubles; return a request for `wait`."""
        return self._comm.Isend([values, self._mpi.DOUBLE], dest=rank, tag=_ARRAY)

    def receive(self, values: np.ndarray, rank: int) -> Any:
        """Start to receive an array of doubles; return a request for `wait`."""
        return self._comm.Irecv([values, self._mpi.DOUBLE], source=rank, tag=_ARRAY)

    def send_poses(self, values: np.ndarray, rank: int) -> Any:
        """Start to send poses; return a request for `wait`."""
        return self._comm.Isend([values, self._mpi.DOUBLE], dest=rank, tag=_POSES)

    def receive_poses(self, values: np.ndarray, rank: int) -> Any:
        """Start to receive poses; return a request for `wait`."""
        return self._comm.Irecv([values, self._mpi.DOUBLE], source=rank, tag=_POSES)

    def any(self, is_so: bool) -> bool:
        """Return True if the argument is true on any rank; all ranks call it."""
        found = np.zeros(1, np.int32)
        self.wait([self._comm.Iallreduce(
            [np.array([is_so], np.int32), self._mpi.INT32_T], [found, self._mpi.INT32_T],
            op=self._mpi.MAX)])
        return bool(found[0])

    def wait(self, requests: Sequence[Any]) -> None:
        """Wait until all requests are done."""
        try:
            self._wait_until(self._mpi.Request.Testall, requests)
        except RankError:
            _unsent.extend(requests)
            raise

    def _wait_until(self, is_so: Callable[..., bool], *arguments: Any) -> None:
        """
        Poll until the condition holds, or raise if a rank has failed.

        Usually the condition holds at once. Otherwise the processor is offered to other processes,
        perhaps the awaited ranks; after a while, or on busy processors, the thread sleeps.
        """
        looks, since = 0, 0.0
        while not is_so(*arguments):
            looks += 1
            if looks % _POLL_COUNT == 0:
                self.require_health()
            if looks <= _BUSY_POLL_COUNT:
                continue
            now = time.monotonic()
            since = since or now
            if now - since < _AWAKE and now >= self._crowded_until:
                os.sched_yield()
                back = time.monotonic()
                if back - now > _TIME_SLICE_S:
                    self._crowded_until = back + _CROWDED
            else:
                time.sleep(min(max(_NAP, _NAP_RATIO * (now - since)), _LONGEST_NAP))

    @property
    def has_failed(self) -> bool:
        """True if this rank knows that some rank has failed."""
        return bool(self._failure)

    def fail(self, error: BaseException) -> None:
        """Report a failure of this rank to all other ranks, unless the run has failed already."""
        if self._failure:
            return
        reason = str(error) or type(error).__name__
        if not isinstance(error, (RuntimeError, ValueError)):
            reason = f'{type(error).__name__}: {reason}'
        self._failure = f'rank {self.rank} of {self.size} has failed: {reason}'
        for rank in range(self.size):
            if rank != self.rank:
                self._sent.append(self._comm.isend(self._failure, dest=rank, tag=_FAILED))
        # Who has gone hears nothing any more.
        self._send_off(_FAREWELL)

    def _send_off(self, seconds: float) -> None:
        """Wait until small messages are sent, because their memory ends with this object."""
        since = time.monotonic()
        while self._sent and time.monotonic() - since < seconds:
            self._sent = [request for request in self._sent if not request.Test()]
            time.sleep(_NAP)
        _unsent.extend(self._sent)

    def require_health(self) -> None:
        """Raise RankError if a rank has failed."""
        if not self._failure and self._comm.Iprobe(source=self._mpi.ANY_SOURCE, tag=_FAILED):
            self._failure = self._comm.recv(source=self._mpi.ANY_SOURCE, tag=_FAILED)
        if self._failure:
            raise RankError(self._failure)


class _Flat:
    """A record as its class and fields, so that read-only arrays remain read-only."""

    def __init__(self, kind: Any, values: list[Any]) -> None:
        self.kind, self.values = kind, values


class _ReadOnly:

    def __init__(self, values: np.ndarray) -> None:
        self.values = values


def _flat(value: Any) -> Any:
    if isinstance(value, Record):
        return _Flat(type(value)._base(), [_flat(part) for part in value])
    if isinstance(value, np.ndarray):
        return value if value.flags.writeable else _ReadOnly(value)
    if isinstance(value, tuple):
        parts = [_flat(part) for part in value]
        return type(value)(*parts) if hasattr(value, '_fields') else tuple(parts)
    return value


def _aligned(values: np.ndarray) -> np.ndarray:
    """Return an array, copied to the start of a cache line if it has rows of doubles."""
    if values.dtype != np.float64 or not values.flags.c_contiguous or not values.size:
        return values
    target = aligned_empty(values.shape)
    target[...] = values
    return target


def _round(value: Any) -> Any:
    if isinstance(value, _Flat):
        return value.kind(*(_round(part) for part in value.values))
    if isinstance(value, _ReadOnly):
        values = _aligned(value.values)
        values.flags.writeable = False
        return values
    if isinstance(value, np.ndarray):
        return _aligned(value)
    if isinstance(value, tuple):
        parts = [_round(part) for part in value]
        return type(value)(*parts) if hasattr(value, '_fields') else tuple(parts)
    return value
