# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps of the part of one rank, with force evaluations in parallel to other ranks.

The steps are those of kernels/integrators/splitting.py, in the same order for every body. The loop
over evaluations is in this module because ranks exchange poses in each. Blocks that others need
drift first, and their poses are sent. Inner blocks drift and are kicked meanwhile, and the
remaining blocks are kicked once the poses of other ranks have arrived. If shells may touch, all
blocks drift first, as in one process, and pairs are evaluated once poses have arrived; dissipative
forces need velocities, too.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

from icofabric_sim.kernels.figures import note_figures
from icofabric_sim.kernels.flows import drift, keep_accelerations, place_all, push_kept
from icofabric_sim.kernels.group_sums import note_squares, note_sums
from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.kernels.monitor import LEDGER_COUNT, roughness, sample
from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.kernels.runtime.team import TILE
from icofabric_sim.simulation.devices.beside import bodies_of, bounds_of_state, fastest_square
from icofabric_sim.simulation.devices.executor import Interval, sampled_batches
from icofabric_sim.simulation.devices.near_pairs import team_of_one
from icofabric_sim.simulation.devices.part_iteration import PartIteration
from icofabric_sim.simulation.devices.rank_kernels import (
    account_all,
    begin_kinked,
    drift_and_push,
    keep_drifted,
    MOTION,
    note_all_motion,
    note_motions,
    POSE,
    put_motions,
    put_poses,
    strike_all,
    strike_foretold,
    take_motions,
    take_poses,
)
from icofabric_sim.simulation.devices.shared_contacts import friction_of
from icofabric_sim.simulation.devices.slot_rows import Exchanged
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.window import Exchange
from icofabric_sim.simulation.model.layout import aligned_empty
from icofabric_sim.simulation.stepping.ledger import Ledger
from icofabric_sim.terms.contacts.displacement import ways_of
from icofabric_sim.terms.contacts.losses import touch_ahead
from icofabric_sim.terms.contacts.record import Contacts, Watch
from icofabric_sim.terms.contacts.stiffness import note_pushes
from icofabric_sim.terms.links.kinks import Kinks
import numpy as np

Border = tuple[int, np.ndarray, np.ndarray]  # rank, slots, and the numbers of their bodies


class Weights(NamedTuple):
    """Weights of a method, and of the roughness of the motion."""

    kicks: np.ndarray
    drifts: np.ndarray
    differences: int  # order of those by which the roughness of the motion is judged; 0: it is not
    pascal: np.ndarray  # (differences + 1,) binomial coefficients of these
    inverse_size: float  # 1 / a^2 [1/m^2]
    mends_kinks: bool  # whether steps follow where the slopes of connectors jump

    @property
    def stages(self) -> int:
        """Number of force evaluations in a step."""
        return min(len(self.kicks), len(self.drifts))


class Arrays(NamedTuple):
    """Arrays that steps change."""

    # None: nothing acts on any body of the fabric, and steps have loops of their own, as in
    # splitting.py.
    loads: Loads | None
    state: State
    work: Work
    contacts: Contacts | None = None  # of the part
    watch: Watch | None = None  # None: of steps beside the run, or where nothing can touch

    def exchanged(self, contacts: Contacts | None, whole: bool = True) -> Exchanged:
        """
        Return the arrays to exchange, with the history of the pairs of any `contacts`.

        `whole`: also what the first kick of the next step needs, accelerations and what contacts
        lose.
        """
        state, work, losses = self.state, self.work, friction_of(contacts)
        tables = [*state.rows()]
        if work.spent is not None:
            tables.append(work.spent.done)
        if whole:
            tables.append(work.acceleration)
            if contacts is not None and contacts.losses is not None:
                tables.append(contacts.losses.lost)
        return Exchanged(
            tables, [] if self.loads is None else [self.loads.work],
            [] if losses is None else [losses.stretch, losses.slopes[0]])


class NoTransport(Transport):
    """Transport of a part without bodies and neighbours."""

    def __init__(self) -> None:
        """Connect no processes."""

    def wait(self, requests: Sequence[Any]) -> None:
        """Return at once."""

    def any(self, is_so: bool) -> bool:
        """Return True, so that all kernels are called."""
        return True


NO_TRANSPORT = NoTransport()
NO_EXCHANGE = Exchange(
    0, 0, np.zeros(0, np.uint32), 0, np.zeros(0, np.uint32), np.zeros(0, np.int32), (), (),
    np.zeros(0, np.int32))


class RankPart:
    """Blocks of a rank, and the values that it exchanges with its neighbours."""

    def __init__(self, transport: Transport, model: Model, exchange: Exchange) -> None:
        """Step the blocks of the `exchange` in the arrays of `model`."""
        self._transport, self._model, self._exchange = transport, model, exchange
        self._touching, self._team = model, team_of_one()
        # Evaluations of contacts since this was asked last.
        self.touches = 0

    def _rooms(self, rows: int) -> tuple[list[Border], list[Border]]:
        """Return arrays for rows of numbers of bodies, that are given and needed."""
        gives, needs = (
            [(rank, slots, _room(len(slots), rows)) for rank, slots in sides]
            for sides in (self._exchange.gives, self._exchange.needs))
        return gives, needs

    @property
    def blocks(self) -> slice:
        """Blocks of this rank, by their numbers in the arrays of the model."""
        return slice(self._exchange.first, self._exchange.last)

    def _model_with(self, contacts: Contacts | None) -> Model:
        """Return the constants of the window with these contacts."""
        if contacts is None:
            return self._model
        if self._touching.contacts is not contacts:
            self._touching = self._model._replace(contacts=contacts)
        return self._touching

    def take_touches(self) -> int:
        """Return the number of evaluations of contacts since the last call."""
        found, self.touches = self.touches, 0
        return found


class PartSteps(RankPart):
    """Steps of a part, with the poses of its neighbours."""

    def __init__(
        self, transport: Transport, model: Model, exchange: Exchange, weights: Weights
    ) -> None:
        """Step the blocks of the `exchange` in the arrays of `model`."""
        super().__init__(transport, model, exchange)
        self._weights = weights
        self._gives, self._needs = self._rooms(POSE)
        # The same with velocities, for steps that follow kinks, and for what contacts lose.
        self._tells, self._hears = self._rooms(MOTION)
        border = exchange.drifts[:exchange.border]
        # Where all have drifted before.
        self._tiles, self._inner = (
            np.full(-(-len(blocks) // TILE), len(exchange.drifts), np.int32)
            for blocks in (border, exchange.inner))
        self._border = np.ascontiguousarray(border)
        # Differences of the motion in the samples of this part, and the roughest since asked.
        self.difference = aligned_empty((POSE, LANES * len(exchange.samples)))
        self.difference[:] = 0.0
        self._ledger = np.zeros(LEDGER_COUNT)
        Ledger.over(self._ledger).inverse_size = weights.inverse_size
        self.roughest = 0.0
        # Steps in which connectors crossed kinks since this was asked last.
        self.crossed = 0

    def take(self, arrays: Arrays, interval: Interval) -> None:
        """Take the steps of an interval, and sample the roughness of the motion."""
        differences = self._weights.differences
        for first, count, place in sampled_batches(interval, differences, self._weights.stages):
            if place >= 0 and place % differences == 0:
                self._sample(arrays, 0)
            if arrays.work.kinks is None:
                self._steps(arrays, interval, first, count)
            else:
                self._kinked_steps(arrays.work.kinks, arrays, interval, first, count)
            if place >= 0:
                self._sample(arrays, place % differences + 1)
        if interval.is_guarded and arrays.contacts is not None:
            note_pushes(
                arrays.contacts, self._model.blocks, self._model.inverse_mass,
                self._model.inverse_inertia, self._exchange.first, self._exchange.last)

    def examine(
        self, arrays: Arrays, time: float, limit: float, inside: bool
    ) -> np.ndarray:
        """
        Sum the figures of a health check at `time` [s] over this part.

        The result is that of `note_figures`, but the last row starts with the largest roughness.
        """
        exchange, (loads, state, work, _, _) = self._exchange, arrays
        first, last = exchange.first, exchange.last
        self._place(arrays)
        figures = work.figures[:-(-(last - first) // work.group) + 1]
        note_figures(
            self._model, loads, state, work, time, limit, inside, 0, len(figures) - 1, last)
        figures[-1, 0] = self.take_roughest()
        return figures

    def refresh(self, arrays: Arrays, time: float) -> None:
        """Compute the accelerations of the bodies of this part at `time` [s]."""
        exchange = self._exchange
        self._place(arrays)
        keep_accelerations(
            self._model, arrays.state, arrays.work, time, exchange.first, exchange.last)

    def squares(self, arrays: Arrays, fall: np.ndarray) -> np.ndarray:
        """Return the sums of `note_squares` (group_sums.py) over this part."""
        exchange, model, work = self._exchange, self._model, arrays.work
        sums = np.zeros((2, -(-(exchange.last - exchange.first) // work.group)))
        note_squares(
            model.blocks, model.masses, work.acceleration, fall, sums, work.group, 0,
            sums.shape[1], exchange.last)
        return sums

    def velocity_sums(self, arrays: Arrays) -> np.ndarray:
        """Return the sums of `note_sums` (group_sums.py) over the velocities of this part."""
        exchange, (_, state, work, _, _) = self._exchange, arrays
        sums = np.zeros((3, -(-(exchange.last - exchange.first) // work.group)))
        note_sums(
            self._model.blocks, state.linear_velocity, sums, work.group, 0, sums.shape[1],
            exchange.last)
        return sums

    @cached_property
    def _bodies(self) -> np.ndarray:
        """Slots of this rank's bodies."""
        return bodies_of(self._model.blocks, self._exchange.first, self._exchange.last)

    def bounds(self, arrays: Arrays) -> np.ndarray:
        """Return largest and minus least velocities [m/s] and the largest coordinate [m], (7,)."""
        return bounds_of_state(arrays.state, self._bodies)

    def fastest_square(self, arrays: Arrays, velocity: np.ndarray) -> np.ndarray:
        """Return the largest squared velocity relative to `velocity` (3,) [m^2/s^2], (1,)."""
        return np.array([fastest_square(arrays.state, self._bodies, velocity)])

    def iteration(self, arrays: Arrays) -> PartIteration:
        """Start an iteration for the largest frequency about the present state."""
        self._place(arrays)
        return self._iteration(arrays)

    def make_iteration_ready(self, arrays: Arrays) -> None:
        """Compile or load the kernels of the iteration."""
        self._iteration(arrays).make_ready()

    def _iteration(self, arrays: Arrays) -> PartIteration:
        return PartIteration(
            self._transport, self._model, self._exchange, arrays.state, arrays.work)

    def _place(self, arrays: Arrays) -> None:
        """Compute the attachment points of its bodies and of the border."""
        # Of others the last that was heard may be before the end of the step.
        self._put_poses(self._send_poses(arrays.state), arrays)
        place_all(
            self._model, arrays.state, arrays.work, self._exchange.first, self._exchange.last)

    def take_crossed(self) -> int:
        """Return the number of steps with crossings of kinks since the last call."""
        found, self.crossed = self.crossed, 0
        return found

    def take_roughest(self) -> float:
        """Return the largest roughness since the last call."""
        found, self.roughest = self.roughest, 0.0
        return found

    def make_ready(self, arrays: Arrays) -> None:
        """Compile or load the kernels of steps, by steps without bodies and pairs."""
        loads, state, work, contacts, _ = arrays
        kinks, no_slots = work.kinks, np.zeros(0, np.int32)
        take_poses(state, no_slots, _room(0))
        put_poses(self._model, state, work, no_slots, _room(0))
        place_all(self._model, state, work, 0, 0)
        if not self._weights.stages:
            return
        empty = PartSteps(NO_TRANSPORT, self._model, NO_EXCHANGE, self._weights)
        empty.take(arrays, Interval(0.0, 0, 1.0, 1, 0, NEVER, is_guarded=True))
        empty.examine(arrays, 0.0, 0.0, False)
        empty.refresh(arrays, 0.0)
        empty.squares(arrays, np.zeros(3))
        empty.velocity_sums(arrays)
        losses = None if contacts is None else contacts.losses
        for more in [row for row in (losses and losses.lead, kinks and kinks.before)
                     if row is not None]:
            take_motions(state, more, no_slots, _room(0, MOTION))
            put_motions(self._model, more, state, work, no_slots, _room(0, MOTION))
        if kinks is not None:
            note_motions(self._model, kinks, state, work, 1.0, no_slots)
        if self._weights.differences:
            sample(no_slots, state.position, state.orientation, _room(0), work.weights, 0)
            roughness(work._replace(difference=_room(0)), self._ledger)

    def _steps(self, arrays: Arrays, interval: Interval, index: int, count: int) -> None:
        """Take `count` steps from `index` on, as `steps` of splitting.py."""
        exchange, (loads, state, work, contacts, _) = self._exchange, arrays
        model = self._model_with(contacts)
        kicks, drifts = self._weights.kicks, self._weights.drifts
        origin, h = interval.origin, interval.step
        kick_first, stages = len(kicks) > len(drifts), self._weights.stages
        if kick_first:
            push_kept(
                model, loads, state, work, origin + index * h, kicks[0] * h, exchange.first,
                exchange.last)
        now = 0.0
        for evaluation in range(count * stages):
            stage, step = evaluation % stages, index + evaluation // stages
            if stage == 0:
                now = origin + step * h
            whole = drifts[stage] * h
            after = now + whole
            if kick_first and stage + 1 == stages:
                after = origin + (step + 1) * h
            kick, again, keep = kicks[stage] * h, 0.0, False
            if kick_first:
                kick = kicks[stage + 1] * h
                keep = evaluation + 1 == count * stages
                if stage + 1 == stages and not keep:
                    again = kicks[0] * h
            self._evaluate(arrays, None, 0.0, h, now, whole, after, kick, again, keep)
            now = after
            if not kick_first and stage + 1 == stages:
                drift(
                    model, loads, state, work, now, drifts[stages] * h, exchange.drifts, 0,
                    len(exchange.drifts))

    def _evaluate(
        self, arrays: Arrays, kinks: Kinks | None, step_part: float, h: float, now: float,
        whole: float, after: float, kick: float, again: float, keep: bool
    ) -> None:
        """
        Apply a drift and the kick after it; poses are exchanged while inner blocks are computed.
        """
        exchange, (loads, state, work, contacts, watch) = self._exchange, arrays
        model, order = self._model_with(contacts), exchange.drifts
        drift(model, loads, state, work, now, whole, order, 0, exchange.border)
        if keep and kinks is not None:
            keep_drifted(model, kinks, state, order, 0, exchange.border)
        losses = None if contacts is None else contacts.losses
        requests = self._send_poses(state) if losses is None else self._send_motions(
            state, losses.lead)
        if contacts is None:
            drift_and_push(
                model, loads, state, work, kinks, step_part, now, whole, after, kick, again, keep,
                order, exchange.border, exchange.inner, exchange.ahead)
            self._put_poses(requests, arrays)
        else:
            drift(model, loads, state, work, now, whole, order, exchange.border, len(order))
            if keep and kinks is not None:
                keep_drifted(model, kinks, state, order, exchange.border, len(order))
            if losses is None:
                self._put_poses(requests, arrays)
            else:
                self._put_motions(requests, losses.lead, arrays)
            self._touch(model, contacts, state, h)
            drift_and_push(
                model, loads, state, work, kinks, step_part, now, whole, after, kick, again, keep,
                order, len(order), exchange.inner, self._inner)
        drift_and_push(
            model, loads, state, work, kinks, step_part, now, whole, after, kick, again, keep,
            order, len(order), self._border, self._tiles)
        if watch is not None:
            ways_of(watch, model.blocks, state, after, 0, exchange.first, exchange.last)

    def _touch(self, model: Model, contacts: Contacts, state: State, h: float) -> None:
        """Evaluate all contacts of the part, `h` [s] after their last evaluation."""
        touch_ahead(
            contacts.losses, contacts, state, model.inverse_mass, model.inverse_inertia, h, h,
            self._team)
        self.touches += 1

    def _kinked_steps(
        self, kinks: Kinks, arrays: Arrays, interval: Interval, index: int, count: int
    ) -> None:
        """Take `count` steps from `index` on, as `kinked_steps` of integrators/kinked.py."""
        exchange, (loads, state, work, contacts, watch) = self._exchange, arrays
        model = self._model_with(contacts)
        first, last, order = exchange.first, exchange.last, exchange.drifts
        kicks, drifts = self._weights.kicks, self._weights.drifts
        origin, h, stages = interval.origin, interval.step, self._weights.stages
        place_all(model, state, work, first, last)
        for step in range(index, index + count):
            now, end = origin + step * h, origin + (step + 1) * h
            begin_kinked(model, loads, kinks, state, work, now, kicks[0] * h, first, last)
            self._exchange_kick(kinks, arrays, kicks[0] * h)
            strike_foretold(model, loads, kinks, state, work, h, kicks[0] * h, first, last)
            step_part = 0.0
            for stage in range(stages):
                whole, ends = drifts[stage] * h, stage + 1 == stages
                after = end if ends else now + whole
                step_part += drifts[stage]
                self._evaluate(
                    arrays, kinks, step_part, h, now, whole, after, kicks[stage + 1] * h, 0.0,
                    ends)
                now = after
            note_all_motion(model, kinks, state, work, -kicks[stages] * h, first, last)
            self._exchange_kick(kinks, arrays, -kicks[stages] * h)
            if not self._transport.any(account_all(model, kinks, work, h, first, last)):
                continue
            self.crossed += 1
            back = -0.5 * h
            for start, whole, row in ((end, back, 12), (end + back, -back, 0)):
                drift(model, loads, state, work, start, whole, order, 0, len(order))
                self._put_poses(self._send_poses(state), arrays)
                strike_all(model, loads, kinks, state, work, row, first, last)
            if contacts is not None:
                self._touch(model, contacts, state, h)
            if watch is not None:
                ways_of(watch, model.blocks, state, end, 0, first, last)
            keep_accelerations(model, state, work, end, first, last)

    def _send_poses(self, state: State) -> list[Any]:
        """Start the exchange of poses at the border."""
        transport = self._transport
        requests = [transport.receive_poses(poses, rank) for rank, _, poses in self._needs]
        for rank, slots, poses in self._gives:
            take_poses(state, slots, poses)
            requests.append(transport.send_poses(poses, rank))
        return requests

    def _put_poses(self, requests: list[Any], arrays: Arrays) -> None:
        """Wait for the poses of other ranks, and store them."""
        self._transport.wait(requests)
        for _, slots, poses in self._needs:
            put_poses(self._model, arrays.state, arrays.work, slots, poses)

    def _send_motions(self, state: State, more: np.ndarray) -> list[Any]:
        """Start the exchange of poses and velocities, and of six numbers `more`, (6, s)."""
        transport = self._transport
        requests = [transport.receive_poses(motions, rank) for rank, _, motions in self._hears]
        for rank, slots, motions in self._tells:
            take_motions(state, more, slots, motions)
            requests.append(transport.send_poses(motions, rank))
        return requests

    def _put_motions(self, requests: list[Any], more: np.ndarray, arrays: Arrays) -> None:
        """Wait for the motions of other ranks, and store them."""
        self._transport.wait(requests)
        for _, slots, motions in self._hears:
            put_motions(self._model, more, arrays.state, arrays.work, slots, motions)

    def _exchange_kick(self, kinks: Kinks, arrays: Arrays, kick: float) -> None:
        """Exchange motions of the border around a `kick` [s], and note them as `note_motion`."""
        self._put_motions(
            self._send_motions(arrays.state, kinks.before), kinks.before, arrays)
        for _, slots, _ in self._hears:
            note_motions(self._model, kinks, arrays.state, arrays.work, kick, slots)

    def _sample(self, arrays: Arrays, number: int) -> None:
        if not len(self._exchange.samples):
            return
        state, work = arrays.state, arrays.work
        sample(
            self._exchange.samples, state.position, state.orientation, self.difference,
            work.weights, number)
        if number == self._weights.differences:
            self.roughest = max(
                self.roughest,
                roughness(work._replace(difference=self.difference), self._ledger))


def _room(blocks: int, rows: int = POSE) -> np.ndarray:
    return aligned_empty((rows, LANES * blocks))
