# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Verbs of ranks and GPUs, and the control of splitting methods whose steps they take.

`RemoteSteps` makes the decisions of `splitting` in kernels/integrators/splitting.py: the ends of
intervals, the times of health checks, and the status that ends a call. It computes with scalars
only, and asks the verbs of `Remote`, which has the arrays of bodies.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Any, NamedTuple

from icofabric_sim.kernels.contact.displacement import farthest, SOON
from icofabric_sim.kernels.contact.forces import deepest_overlap
from icofabric_sim.kernels.contact.losses import save_stretches
from icofabric_sim.kernels.contact.rebuild_check import judge_ways, MISSED
from icofabric_sim.kernels.contact.stiffness import swing_of
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.integrators.splitting import is_guarded, NEVER, stride_of
from icofabric_sim.kernels.loads import keep_work
from icofabric_sim.kernels.monitor import (
    DEEPEST_LIMIT,
    examine,
    judge_roughness,
    least_scale,
    ROUGHER,
    save,
    SWING,
    SWING_LIMIT,
    SWINGS,
    TOO_DEEP,
    UNSOUND,
)
from icofabric_sim.kernels.records import Loads, Model, State, Team, Watch, Work
from icofabric_sim.simulation.devices.near_pairs import team_of_one
from icofabric_sim.simulation.stepping.executor import Executor
from icofabric_sim.simulation.stepping.ledger import Ledger
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

    def examine(self, time: float) -> int:
        """Return the status of a health check at `time` [s], with its figures in the ledger."""
        model, loads, state, _, work, _, ledger, _ = self._call
        self.have_state()
        place_all(model, state, work, 0, len(model.blocks.slot))
        return int(examine(model, loads, state, work, time, ledger))

    def search(self, time: float, step: float) -> int:
        """Return the status of displacements and overlaps at `time` [s]."""
        status, watch = 0, self._call.watch
        if watch is not None and (most := farthest(watch, 1)) > watch.limits[SOON]:
            self.have_state()
            status = int(judge_ways(watch, most, self._call.state, time, step))
            if not status:
                self.follow_search()
        if deepest_overlap(self._call.model.contacts, 1) > self._call.ledger[DEEPEST_LIMIT]:
            status |= TOO_DEEP
        return status

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
    _whole: Interval  # all steps of the call

    @abstractmethod
    def take(self, interval: Interval) -> None:
        """Take the steps of an interval, and sample the roughness of the motion."""

    def advance(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        origin: float, index: int, h: float, count: int, since_check: int, check_interval: int,
        watch: Watch | None, ledger: np.ndarray
    ) -> tuple[int, int, int]:
        """Return status, steps taken and steps since the last health check, as `splitting`."""
        whole = self._whole = Interval(origin, index, h, count, since_check, check_interval)
        self._call = Call(
            model, loads, state, saved, work, watch, ledger, of_run=whole.is_checked)
        with self.together():
            self.enter()
            taken = self._control(whole)
            self.leave()
            return taken

    def _control(self, whole: Interval) -> tuple[int, int, int]:
        """Take the steps of a call, interval by interval."""
        model, *_, work, watch, ledger, of_run = self._call
        origin, index, h, count, since_check, check_interval, *_ = whole
        contacts, book, done, status = model.contacts, Ledger.over(ledger), 0, 0
        guarded = of_run and is_guarded(contacts, ledger)
        while done < count and not status:
            # A search within the call may change the stride.
            stride = stride_of(watch, check_interval)
            steps = min(count - done, check_interval - since_check, stride - since_check % stride)
            if guarded:
                # A strongly damped collision may end within a few steps.
                steps = 1
            is_searched = watch is not None and of_run and (since_check + steps) % stride == 0
            is_watched = is_searched or (watch is not None and guarded)
            self.take(whole._replace(
                first=index + done, steps=steps, since_check=since_check,
                regular=int(book.regular), is_watched=is_watched, is_guarded=guarded))
            done, since_check = done + steps, since_check + steps
            if not of_run:
                continue
            book.regular += steps
            book.uncounted += steps
            if is_watched:
                self.exchange(is_guarded=guarded, is_searched=is_searched)
            time, is_examined = origin + (index + done) * h, since_check >= check_interval
            # A limit that overflows is no limit.
            with np.errstate(over='ignore'):
                if guarded:
                    ledger[SWING] = max(ledger[SWING], swing_of(contacts, h))
                    if ledger[SWING] > ledger[SWING_LIMIT] * least_scale(ledger):
                        status |= SWINGS
            if is_examined:
                since_check = 0
                status |= self.examine(time) | judge_roughness(
                    work, ledger, self._differences if self._stages < 4 else check_interval)
            if is_searched:
                status |= self.search(time, h)
            if is_examined and not status & (UNSOUND | ROUGHER | TOO_DEEP | MISSED | SWINGS):
                book.saved_at = done
                self.save()
        return int(status), done, since_check
