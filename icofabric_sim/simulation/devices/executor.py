# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Control of splitting methods whose steps ranks or a GPU take.

`take_steps` makes the decisions of `splitting` in kernels/integrators/splitting.py: the ends of
intervals, the times of health checks, and the status that ends a call. It computes with scalars
only; an `Executor` has the arrays of bodies.
"""

from collections.abc import Iterator
from typing import NamedTuple, Protocol

from icofabric_sim.kernels.contact.forces import deepest_overlap
from icofabric_sim.kernels.contact.rebuild_check import MISSED
from icofabric_sim.kernels.contact.stiffness import swing_of
from icofabric_sim.kernels.integrators.splitting import is_guarded, NEVER, stride_of
from icofabric_sim.kernels.monitor import (
    DEEPEST_LIMIT,
    judge_roughness,
    least_scale,
    ROUGHER,
    SWING,
    SWING_LIMIT,
    SWINGS,
    TOO_DEEP,
    UNSOUND,
)
from icofabric_sim.kernels.records import Loads, Model, State, Team, Watch, Work
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
    """Arrays and steps of a call of `Method.advance`."""

    model: Model
    loads: Loads
    state: State
    saved: State
    work: Work
    watch: Watch | None
    ledger: np.ndarray
    steps: Interval


class Executor(Protocol):
    """Ranks or a GPU that take the steps of one call at a time."""

    def begin(self, call: Call) -> None:
        """Distribute the state of the call, unless the executor holds it already."""

    def take(self, call: Call, interval: Interval) -> None:
        """Take the steps of an interval, and sample the roughness of the motion."""

    def exchange(self, call: Call, *, is_guarded: bool) -> None:
        """Collect displacements and overlaps; `is_guarded`: also the impulses of contacts."""

    def examine(self, call: Call, time: float) -> int:
        """Return the status of a health check at `time` [s], with its figures in the ledger."""

    def search(self, call: Call, time: float) -> int:
        """Return the status of `judge_ways` at `time` [s], if bodies have moved far."""

    def save(self, call: Call) -> None:
        """Save the state that was just examined."""

    def end(self, call: Call) -> None:
        """Gather the state of a trial."""


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


def take_steps(
    executor: Executor, differences: int, stages: int, model: Model, loads: Loads, state: State,
    saved: State, work: Work, team: Team, origin: float, index: int, h: float, count: int,
    since_check: int, check_interval: int, watch: Watch | None, ledger: np.ndarray
) -> tuple[int, int, int]:
    """Return status, steps taken and steps since the last health check, as `splitting` does."""
    whole = Interval(origin, index, h, count, since_check, check_interval)
    call = Call(model, loads, state, saved, work, watch, ledger, whole)
    executor.begin(call)
    contacts, book, done, status = model.contacts, Ledger.over(ledger), 0, 0
    guarded = whole.is_checked and is_guarded(contacts, ledger)
    while done < count and not status:
        # A search within the call may change the stride.
        stride = stride_of(watch, check_interval)
        steps = min(count - done, check_interval - since_check, stride - since_check % stride)
        if guarded:
            # A strongly damped collision may end within a few steps.
            steps = 1
        is_watched = watch is not None and whole.is_checked and (
            guarded or (since_check + steps) % stride == 0)
        executor.take(call, whole._replace(
            first=index + done, steps=steps, since_check=since_check, regular=int(book.regular),
            is_watched=is_watched, is_guarded=guarded))
        done, since_check = done + steps, since_check + steps
        if not whole.is_checked:
            continue
        book.regular += steps
        book.uncounted += steps
        if is_watched:
            executor.exchange(call, is_guarded=guarded)
        is_searched, time = is_watched and since_check % stride == 0, origin + (index + done) * h
        is_examined = since_check >= check_interval
        # A limit that overflows is no limit.
        with np.errstate(over='ignore'):
            if guarded:
                ledger[SWING] = max(ledger[SWING], swing_of(contacts, h))
                if ledger[SWING] > ledger[SWING_LIMIT] * least_scale(ledger):
                    status |= SWINGS
        if is_examined:
            since_check = 0
            status |= executor.examine(call, time) | judge_roughness(
                work, ledger, differences if stages < 4 else check_interval)
        if is_searched:
            status |= executor.search(call, time)
            if deepest_overlap(contacts, 1) > ledger[DEEPEST_LIMIT]:
                status |= TOO_DEEP
        if is_examined and not status & (UNSOUND | ROUGHER | TOO_DEEP | MISSED | SWINGS):
            book.saved_at = done
            executor.save(call)
    executor.end(call)
    return int(status), done, since_check
