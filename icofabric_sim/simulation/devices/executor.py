# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Verbs of ranks and GPUs, which the step control asks in Python.

The control is that of a single process, `splitting` in kernels/integrators/splitting.py or that of
pairs in embedded.py. It computes with scalars only; `Remote` has the arrays of bodies.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Any, NamedTuple

from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.integrators.splitting import (
    is_guarded,
    NEVER,
    splitting,
    stride_of,
    swing_status,
)
from icofabric_sim.kernels.loads import keep_work
from icofabric_sim.kernels.monitor import (
    DEEPEST_LIMIT,
    examine,
    judge_roughness,
    save,
    SAVED_AT,
    TOO_DEEP,
)
from icofabric_sim.kernels.records import Loads, Model, State, Team, Work
from icofabric_sim.simulation.devices.near_pairs import team_of_one
from icofabric_sim.simulation.stepping.executor import Executor
from icofabric_sim.simulation.stepping.ledger import Ledger
from icofabric_sim.terms.contacts.displacement import farthest, SOON
from icofabric_sim.terms.contacts.force import deepest_overlap
from icofabric_sim.terms.contacts.losses import save_stretches
from icofabric_sim.terms.contacts.rebuild_check import judge_ways
from icofabric_sim.terms.contacts.record import Watch
import numpy as np


class Interval(NamedTuple):
    """Steps of equal length without a health check in between."""

    origin: float  # [s]
    first: int  # number of the first step, counted from the origin
    step: float  # [s]
    steps: int
    since_check: int
    check_interval: int
    regular: int = 0  # steps of equal length before
    # Displacements and overlaps are exchanged at the end, and the impulses of contacts.
    is_watched: bool = False
    is_guarded: bool = False
    # Name of the trial in beside.py; '': a run, or a trial whose state is on the first rank.
    beside: str = ''

    @property
    def is_checked(self) -> bool:
        """True for steps of a run, False for those of a trial."""
        return self.check_interval < NEVER


Steps = tuple[int, int, int]  # status, number, and steps since the last health check


class Call(NamedTuple):
    """Arrays of a call that takes steps."""

    model: Model
    loads: Loads
    state: State
    saved: State
    work: Work
    watch: Watch | None
    ledger: np.ndarray
    of_run: bool  # not of a trial


class Remote(Executor, ABC):
    """Ranks or a GPU that take the steps of one call at a time."""

    is_remote = True
    _keeps_work = True  # the work of loads is saved with the state
    _call: Call
    # Arrays of the run that is held; whether its state is there, and whether only there; and
    # whether that of the present call is here, too.
    _run: Any = None
    _is_out = _is_stale = _is_here = False

    def gather(self) -> bool:
        """Gather the state of the run; return True if it was elsewhere."""
        is_stale, self._is_out, self._is_stale = self._is_stale, False, False
        is_lacking = is_stale and self._run is not None
        if is_lacking:
            self._gather_run()
        return is_lacking

    @abstractmethod
    def _gather_run(self) -> None:
        """Gather the state of the run, with all data of the next step."""

    @abstractmethod
    def together(self) -> AbstractContextManager[None]:
        """Exclude other threads in the block; discard the held state if it fails."""

    @abstractmethod
    def enter(self) -> None:
        """Distribute the state of the call, unless the executor holds it already."""

    @abstractmethod
    def have_state(self) -> None:
        """Copy the state at the end of the last step to this process."""

    @abstractmethod
    def exchange(self, *, is_guarded: bool, is_searched: bool) -> None:
        """
        Collect displacements and overlaps, if `is_searched`.

        `is_guarded`: also the impulses of contacts.
        """

    @abstractmethod
    def follow_search(self) -> None:
        """Record displacements from the search that this process has made."""

    @abstractmethod
    def leave(self) -> None:
        """Gather the state of a trial."""

    def _take(self, call: Call, kernel: Any, method: Any, *arguments: Any) -> Steps:
        """Take steps by the control of a `kernel`; numbers that are too large are infinite."""
        self._call = call
        with self.together():
            self.enter()
            with np.errstate(all='ignore'):
                status, done, since_check = kernel(self, method, *arguments)
            self.leave()
        return int(status), int(done), int(since_check)

    # What the control asks.

    def agree(self, status: int) -> int:
        """Return the status: there is one control."""
        return status

    def examine(self, time: float, ledger: np.ndarray) -> int:
        """Return the status of a health check at `time` [s], with its figures in the ledger."""
        model, loads, state, _, work, *_ = self._call
        self.have_state()
        place_all(model, state, work, 0, len(model.blocks.slot))
        return int(examine(model, loads, state, work, time, ledger))

    def search(self, time: float, step: float, ledger: np.ndarray) -> int:
        """Return the status of displacements and overlaps at `time` [s]."""
        status, watch = 0, self._call.watch
        if watch is not None and (most := farthest(watch, 1)) > watch.limits[SOON]:
            self.have_state()
            status = int(judge_ways(watch, most, self._call.state, time, step))
            if not status:
                self.follow_search()
        if deepest_overlap(self._call.model.contacts, 1) > ledger[DEEPEST_LIMIT]:
            status |= TOO_DEEP
        return status

    def save_sound(self, done: int, ledger: np.ndarray) -> None:
        """Save the state that was just examined, after `done` steps."""
        ledger[SAVED_AT] = done
        self.save()

    def save(self) -> None:
        """Save the state that was just examined."""
        model, loads, state, saved, *_ = self._call
        last = len(model.blocks.slot)
        save(model, state, saved, 0, last)
        if model.contacts is not None and model.contacts.losses is not None:
            save_stretches(model.contacts.losses, team_of_one())
        if self._keeps_work:
            keep_work(loads, 0, last)


def sampled_batches(
    interval: Interval, differences: int, stages: int
) -> Iterator[tuple[int, int, int]]:
    """
    Divide an interval where step ends are sampled for the roughness of the motion.

    Windows of `differences` steps follow each other; a method with fewer than four `stages` has
    one before each health check.

    Yields
    ------
    first, count, place : int
        Steps to take, and the place of the last one in its window; negative: not sampled.
    """
    done = 0
    while done < interval.steps:
        count, place = interval.steps - done, -1
        if differences and interval.is_checked:
            place = (interval.regular + done) % differences
            if stages < 4:
                place = interval.since_check + done - (interval.check_interval - differences)
            count = 1 if place >= 0 else min(count, -place)
        yield interval.first + done, count, place
        done += count


class RemoteSteps(Remote):
    """Steps of a splitting method."""

    _differences: int  # order of those that measure the roughness of the motion
    _stages: int
    _origin = _step = 0.0  # [s] of the call

    @abstractmethod
    def take(self, interval: Interval) -> None:
        """Take the steps of an interval, and sample the roughness of the motion."""

    def advance(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        origin: float, index: int, h: float, count: int, since_check: int, check_interval: int,
        watch: Watch | None, ledger: np.ndarray
    ) -> Steps:
        """Take steps as `splitting` does."""
        self._origin, self._step = origin, h
        call = Call(
            model, loads, state, saved, work, watch, ledger, of_run=check_interval < NEVER)
        return self._take(
            call, splitting, None, origin, index, h, count, since_check, check_interval, ledger)

    # What the control asks.

    def can_swing(self, ledger: np.ndarray) -> bool:
        """Check that each step must be examined for the energy oscillation of contacts."""
        return bool(is_guarded(self._call.model.contacts, ledger))

    def judge_swing(self, h: float, ledger: np.ndarray) -> int:
        """Return the status of the last step of `h` [s]."""
        return int(swing_status(self._call.model.contacts, h, ledger))

    def check_stride(self) -> int:
        """Return the number of steps between two checks of displacements; 0: no checks."""
        return int(stride_of(self._call.watch)) if self._call.of_run else 0

    def judge_motion(self, method: object, check_interval: int, ledger: np.ndarray) -> int:
        """Return ROUGHER if the motion is too rough for the step, else 0."""
        return int(judge_roughness(
            self._call.work, ledger, self._differences if self._stages < 4 else check_interval))

    def take_interval(
        self, method: object, origin: float, index: int, h: float, count: int, since_check: int,
        check_interval: int, regular: int, guarded: bool, searched: bool, ledger: np.ndarray
    ) -> None:
        """Take the steps up to the next check, and collect what it examines."""
        is_watched = searched or (guarded and self._call.watch is not None)
        self.take(Interval(
            origin, index, h, count, since_check, check_interval, regular, is_watched, guarded))
        if self._call.of_run:
            book = Ledger.over(ledger)
            book.regular += count
            book.uncounted += count
        if is_watched:
            self.exchange(is_guarded=guarded, is_searched=searched)
