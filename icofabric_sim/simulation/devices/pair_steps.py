# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps of an embedded Runge-Kutta pair on the part of one rank, executed on orders.

The functions are those of kernels/integrators/embedded.py for the blocks of a part. At each stage,
ranks exchange poses, with velocities if forces depend on them, while inner blocks are computed.
"""

from typing import Any, NamedTuple

from icofabric_sim.kernels.figures import note_figures
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.integrators.bodies import copy_last
from icofabric_sim.kernels.integrators.tableau import DENSE, Pair, SECOND
from icofabric_sim.kernels.loads import keep_work
from icofabric_sim.kernels.monitor import save
from icofabric_sim.kernels.records import Loads, Model, State, Trail, Work
from icofabric_sim.kernels.rhs import add_work, find_slopes, LAST, place_blocks
from icofabric_sim.simulation.devices.part_steps import NO_EXCHANGE, NO_TRANSPORT, RankPart
from icofabric_sim.simulation.devices.rank_kernels import (
    combine_all,
    errors_of,
    POSE,
    put_poses,
    put_stage,
    STAGE,
    take_poses,
    take_stage,
)
from icofabric_sim.simulation.devices.shared_contacts import friction_of, look_at
from icofabric_sim.simulation.devices.slot_rows import Exchanged
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.window import Exchange
from icofabric_sim.simulation.model.layout import aligned_empty
from icofabric_sim.terms.contacts.clearance import fastest_points
from icofabric_sim.terms.contacts.displacement import ways_of
from icofabric_sim.terms.contacts.force import has_touched, note_touch
from icofabric_sim.terms.contacts.losses import (
    accept_stretches,
    combine_stretches,
    repeat_stretches,
    touch_moving,
)
from icofabric_sim.terms.contacts.record import Contacts, Watch
from icofabric_sim.terms.meters import add_flow
import numpy as np

# Slopes that states within a step need, and that of its end, which begins the next.
ALL, END = range(DENSE), range(LAST, DENSE)


class PairArrays(NamedTuple):
    """Arrays that steps change."""

    loads: Loads
    state: State
    work: Work
    contacts: Contacts | None = None  # of the part
    watch: Watch | None = None  # None: of steps beside the run, or where nothing can touch

    @property
    def trail(self) -> Trail:
        """Slopes, stage and start of the step."""
        assert self.work.trail is not None
        return self.work.trail

    def exchanged(
        self, contacts: Contacts | None, slopes: range = END, with_start: bool = False
    ) -> Exchanged:
        """
        Return the arrays to exchange, with some slopes and the history of any `contacts`.

        `with_start`: also the state at the start of the step.
        """
        losses, loads, trail = friction_of(contacts), self.loads, self.trail
        spent = self.work.spent
        tables = [*self.state.rows()]
        if with_start:
            tables += trail.start.rows()
        tables += [trail.slopes[k] for k in slopes]
        if spent is not None:
            tables += [spent.done, *(spent.power[k:k + 1] for k in slopes)]
        history: list[np.ndarray] = []
        if losses is not None:
            history = [losses.stretch, losses.held, *(losses.slopes[k] for k in slopes)]
            history += [losses.start] * with_start
        return Exchanged(
            tables, [loads.work, loads.earlier_work, *(loads.power[k] for k in slopes)], history)


class PairPart(RankPart):
    """Steps of a part, with the poses of its neighbours."""

    def __init__(
        self, transport: Transport, model: Model, exchange: Exchange, pair: Pair
    ) -> None:
        """Step the blocks of the `exchange` in the arrays of `model`."""
        super().__init__(transport, model, exchange)
        self._pair = pair
        self._poses, self._motions = self._rooms(POSE), self._rooms(STAGE)
        # Of the blocks that need none of others the longest run: computed while poses travel.
        self._inner = _longest_run(exchange.inner, exchange.first)

    def examine(
        self, arrays: PairArrays, time: float, limit: float, inside: bool
    ) -> np.ndarray:
        """
        Sum the figures of a health check at `time` [s] over this part.

        The result is that of `note_figures`; the last row is not of this part.
        """
        loads, state, work, contacts, _ = arrays
        first, last = self._exchange.first, self._exchange.last
        place_all(self._model, state, work, first, last)
        self._put(self._send(state, contacts), state, work, contacts)
        figures = work.figures[:-(-(last - first) // work.group) + 1]
        note_figures(
            self._model, loads, state, work, time, limit, inside, 0, len(figures) - 1, last)
        figures[-1] = 0.0
        return figures

    def find_slope(self, arrays: PairArrays, at_stage: bool, index: int, time: float) -> None:
        """Compute slope number `index` at the state or the stage, at a `time` [s]."""
        loads, state, work, contacts, watch = arrays
        model, number = self._model_with(contacts), np.int64(index)
        trail, (first, last) = arrays.trail, (self._exchange.first, self._exchange.last)
        state = trail.stage if at_stage else state
        place_blocks(self._model, loads, state, work, time, first, last)
        if watch is not None:
            ways_of(watch, self._model.blocks, state, time, 0, first, last)
        requests = self._send(state, contacts)
        slope, (begin, end) = trail.slopes[index], self._inner
        if contacts is None:
            find_slopes(model, loads, state, work, time, slope, number, begin, end)
            self._put(requests, state, work, contacts)
            find_slopes(model, loads, state, work, time, slope, number, first, begin)
            find_slopes(model, loads, state, work, time, slope, number, end, last)
            return
        self._put(requests, state, work, contacts)
        touch_moving(contacts, state, number, self._team)
        note_touch(loads.drives, contacts, index == SECOND, 0)
        self.touches += 1
        find_slopes(model, loads, state, work, time, slope, number, first, last)

    def try_step(self, arrays: PairArrays, time: float, h: float, forget: bool) -> None:
        """Compute the other slopes of a step of `h` [s] at `time` [s]; its end is the stage."""
        state, contacts, watch, pair = arrays.state, arrays.contacts, arrays.watch, self._pair
        losses = None if contacts is None else contacts.losses
        first, last, slot = self._exchange.first, self._exchange.last, self._model.blocks.slot
        if forget and watch is not None:
            watch.far[0] = 0.0
        for index, weights in enumerate(pair.stage_weights, start=1):
            is_end = index == pair.stage_count
            combine_all(state, arrays.trail, weights, h, slot, first, last, is_end)
            if losses is not None:
                combine_stretches(losses, weights, h, False, self._team)
            if not is_end:
                self.find_slope(arrays, True, index, time + pair.nodes[index] * h)
        if watch is not None:
            # Forces will be evaluated at the end too.
            ways_of(watch, self._model.blocks, arrays.trail.stage, time + h, 0, first, last)

    def find_errors(self, arrays: PairArrays, scales: np.ndarray, smooth: float) -> np.ndarray:
        """
        Return the errors of the step: for step control, probable, and of the work of paths.

        They are followed by the contact flag and the largest squared displacement.
        """
        contacts, watch = arrays.contacts, arrays.watch
        found = errors_of(
            arrays.trail, self._model, arrays.loads,
            None if contacts is None else contacts.losses, self._pair.higher_error,
            self._pair.lower_error, scales, smooth, self._exchange.first, self._exchange.last,
            self._team)
        touched = has_touched(arrays.loads.drives, contacts, 1)
        return np.array([*found, touched, 0.0 if watch is None else watch.far[0]])

    def accept_step(self, arrays: PairArrays, h: float, keeps_start: bool) -> None:
        """Accept the step: the stage becomes the state."""
        loads, state, work, contacts, _ = arrays
        first, last, pair = self._exchange.first, self._exchange.last, self._pair
        if keeps_start:
            save(self._model, state, arrays.trail.start, first, last)
            keep_work(loads, first, last)
        save(self._model, arrays.trail.stage, state, first, last)
        if contacts is not None:
            accept_stretches(contacts.losses, self._team)
        add_work(loads, h, pair.step, first, last)
        add_flow(work.spent, self._model.blocks.slot, h, pair.step, first, last)

    def repeat_slope(self, arrays: PairArrays) -> None:
        """Copy the last slope of a step to the first slope of the next."""
        copy_last(
            self._model, arrays.loads, arrays.work, arrays.trail, self._exchange.first,
            self._exchange.last)
        if arrays.contacts is not None:
            repeat_stretches(arrays.contacts.losses, self._team)

    def find_speeds(
        self, arrays: PairArrays, mean: tuple[float, float, float], time: float
    ) -> np.ndarray:
        """Return the largest speed at the stages, and the largest squared displacement before."""
        assert arrays.watch is not None
        return np.array(fastest_points(
            arrays.watch, self._model.blocks, arrays.state, arrays.trail,
            self._pair.stage_count, mean, time, self._exchange.first, self._exchange.last))

    def look(self, arrays: PairArrays) -> np.ndarray:
        """Return and reset recorded displacements and overlaps."""
        return look_at(arrays.contacts, arrays.watch)

    def _is_moving(self, contacts: Contacts | None) -> bool:
        """Return True if forces on a body depend on the velocities of its neighbours."""
        return self._model.damping is not None or (
            contacts is not None and contacts.losses is not None)

    def _send(self, state: State, contacts: Contacts | None) -> list[Any]:
        """Start the exchange of poses at the border."""
        transport, moving = self._transport, self._is_moving(contacts)
        gives, needs = self._motions if moving else self._poses
        requests = [transport.receive_poses(poses, rank) for rank, _, poses in needs]
        for rank, slots, poses in gives:
            (take_stage if moving else take_poses)(state, slots, poses)
            requests.append(transport.send_poses(poses, rank))
        return requests

    def _put(
        self, requests: list[Any], state: State, work: Work, contacts: Contacts | None
    ) -> None:
        self._transport.wait(requests)
        moving = self._is_moving(contacts)
        for _, slots, poses in (self._motions if moving else self._poses)[1]:
            (put_stage if moving else put_poses)(self._model, state, work, slots, poses)

    def make_ready(self, arrays: PairArrays) -> None:
        """Compile or load the kernels of steps, by steps without bodies and pairs."""
        state, work, none = arrays.state, arrays.work, np.zeros(0, np.int32)
        for take, put, rows in ((take_poses, put_poses, POSE), (take_stage, put_stage, STAGE)):
            take(state, none, aligned_empty((rows, 0)))
            put(self._model, state, work, none, aligned_empty((rows, 0)))
        empty = PairPart(NO_TRANSPORT, self._model, NO_EXCHANGE, self._pair)
        empty.find_slope(arrays, False, 0, 0.0)
        empty.try_step(arrays, 0.0, 0.0, False)
        empty.find_errors(arrays, np.zeros(4), 1.0)
        empty.accept_step(arrays, 0.0, True)
        empty.repeat_slope(arrays)
        empty.examine(arrays, 0.0, 0.0, False)
        if arrays.watch is not None:
            empty.find_speeds(arrays, (0.0, 0.0, 0.0), 0.0)


def _longest_run(blocks: np.ndarray, first: int) -> tuple[int, int]:
    """Return the bounds of the longest run of numbers; an empty one at `first`."""
    if not len(blocks):
        return first, first
    numbers = np.sort(blocks.astype(np.int64))
    ends = np.append(np.flatnonzero(np.diff(numbers) != 1), len(numbers) - 1)
    begins = np.append(0, ends[:-1] + 1)
    which = int(np.argmax(ends - begins))
    return int(numbers[begins[which]]), int(numbers[ends[which]]) + 1
