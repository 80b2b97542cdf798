# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A method whose steps all ranks take, each for its part: code of the first rank.

The run, its driver and all checks are on the first rank, with arrays for the whole fabric. States
stay where they are computed. They are gathered when the trajectory needs its state, and at health
checks with contacts. Sums over all bodies are formed over groups of blocks (kernels/figures.py),
so they equal those of a single process.
"""

from functools import partial
import math
from typing import Any

from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.kernels.monitor import (
    LEDGER_COUNT,
    save,
)
from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.beside import (
    AHEAD,
    HALF,
    meter_room,
    squares_apart,
)
from icofabric_sim.simulation.devices.executor import Interval, RemoteSteps
from icofabric_sim.simulation.devices.part_steps import Arrays, PartSteps, Weights
from icofabric_sim.simulation.devices.shared_contacts import (
    look_at,
    note_look,
    REPORT_SIZE,
)
from icofabric_sim.simulation.devices.shared_iteration import SharedIteration
from icofabric_sim.simulation.devices.sharing import Sharing
from icofabric_sim.simulation.devices.slot_rows import SlotRows
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.unpacked import complete, Unpacked
from icofabric_sim.simulation.devices.window import bytes_of, exchange_of
from icofabric_sim.simulation.model.layout import aligned_empty, has_jumps
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.stability import (
    converge,
    Frequency,
    has_bounded_terms,
    is_springy,
    most_steps,
)
from icofabric_sim.simulation.stepping.ledger import Ledger
from icofabric_sim.simulation.stepping.methods import Method
from icofabric_sim.simulation.stepping.step_monitor import differences_of
from icofabric_sim.terms.contacts.record import Contacts, Watch
import numpy as np


class SharedSteps(Sharing, RemoteSteps):
    """Steps of a method that all ranks of a transport take; created on the first rank."""

    tries_steps = True

    def __init__(
        self, transport: Transport, packed: PackedScene, method: Method, *, given: bool,
        estimated: bool, half_edge: float, unpacked: Unpacked | None = None
    ) -> None:
        """
        Divide the fabric; `given` means a given step, whose error is `estimated`.

        `unpacked` is the initial state of the run if it is not packed. Raises ValueError if ranks
        are too many or lack memory.
        """
        links, contact = packed.model.links, packed.contact
        differences = differences_of(method, links, given=given, estimated=estimated)
        self._weights = Weights(
            np.array(method.kicks), np.array(method.drifts), differences,
            np.array([float(math.comb(differences, k)) for k in range(differences + 1)]),
            half_edge**-2, method.mends_kinks and has_jumps(links))
        super().__init__(transport, packed, partial(
            bytes_of, kinked=self._weights.mends_kinks, touching=contact is not None,
            spends=contact is not None and contact.spends))
        # Whether a step was taken since the ranks got it.
        self._is_moved = False
        # The state before it is with the ranks; whether some slots of it have never been here.
        self.unpacked, self._is_partial = unpacked, False
        self._unpacking: Unpacked | None = None  # that is being sent
        self._samples: list[np.ndarray] = []
        self._differences, self._stages = differences, self._weights.stages
        self._acted: Loads | None = None  # also where they are empty
        self._ledger = Ledger.over(np.zeros(LEDGER_COUNT))
        self._can_iterate = False  # whether kernels of iterations are ready
        self._tried_by: PartSteps | None = None
        self._trials: dict[str, Arrays] = {}

    def count_evaluations(self) -> int:
        """Return the number of force evaluations that crossings of kinks added."""
        return 0 if self._own is None else self._own.take_crossed()

    @property
    def _is_apart(self) -> bool:
        """True if only the ranks have the state of the run."""
        return self._is_out and self._is_stale

    # Queries about all bodies of a run without contacts.

    def can_sum(self, model: Model, loads: Loads, work: Work) -> bool:
        """Return True if the first rank alone has no term of the sums over all bodies."""
        return model.contacts is None and loads.anchors is None and loads.drives is None and (
            work.spent is None and work.given is None)

    def hold(
        self, model: Model, loads: Loads, state: State, work: Work, watch: Watch | None
    ) -> None:
        """Distribute the state of a run without contacts, and its loads."""
        with self.together():
            self._acted = loads
            self._distribute(model, loads, state, work, watch, of_run=True)

    def refresh(self, time: float) -> None:
        """Compute the accelerations at `time` [s] on the ranks, which hold the state."""
        with self.together():
            self._do('refresh', time)
            self._is_stale = True

    def fill_figures(self, time: float, numbers: np.ndarray) -> None:
        """Write the figures of a health check at `time` [s] to the `numbers` of a ledger."""
        with self.together():
            self._ledger = Ledger.over(numbers)
            self._sum_figures(time, numbers)

    def squares(self, fall: np.ndarray, sums: np.ndarray) -> None:
        """Write sums (2, g) of squared accelerations, as `note_squares` of group_sums.py."""
        with self.together():
            self.gather_sums(self._do('squares', fall), sums)

    def velocity_sums(self, sums: np.ndarray) -> None:
        """Write sums (3, g) of velocities [m/s], as `note_sums` of group_sums.py."""
        with self.together():
            self.gather_sums(self._do('velocity_sums'), sums)

    def fastest_square(self, velocity: np.ndarray) -> float:
        """Return the largest squared velocity relative to `velocity` (3,) [m^2/s^2]."""
        with self.together():
            return float(self.largest_of(self._do('fastest_square', velocity))[0])

    def bounds(self) -> np.ndarray | None:
        """Return the bounds of the start or of the state on the ranks; None: the state is here."""
        if self.unpacked is not None:
            return self.unpacked.bounds()
        if not self._is_apart:
            return None
        with self.together():
            return self.largest_of(self._do('bounds'))

    def largest_frequency(self) -> Frequency | None:
        """
        Return the largest frequency of the fabric, as `largest_frequency` of model/stability.py.

        The result is None if a term requires sums in a single process.
        """
        model, count = self.packed.model, self.packed.layout.body_count
        if has_bounded_terms(model):
            return None
        if not is_springy(model):
            return Frequency(0.0, (), 0)
        if not self._can_iterate:
            # By then all ranks find it.
            self._own.make_iteration_ready(self._run)
            self._can_iterate = True
        with self.together():
            run = SharedIteration(self, self._own, self._run, most_steps(count))
            try:
                if run.is_held:
                    return Frequency(0.0, (), 0)
                if not np.isfinite(run.bound):
                    # Numbers too large to multiply: nothing is safe.
                    return Frequency(np.inf, (), 0)
                found = converge(run, run.bound, count)
                return Frequency(
                    float(np.sqrt(max(found.value, 0.0))), (), run.matrix.done)
            finally:
                run.end()

    # The saved state.

    def save_run(self, saved: State) -> bool:
        """Save the state of the run on the ranks; return False if it is here."""
        # If ranks fail where a run restarts, the state here is the one that is left.
        is_restarted = not self._is_moved and self.begun is None
        if not self._is_apart or self._run is None or self._acted is None or (
                self._contacts is not None) or is_restarted:
            return False
        with self.together():
            self.save_parts(
                self._run.state, self._run.work, self._acted, saved)
        return True

    def put_begun(self, saved: State) -> bool:
        """Write the start of the run to `saved`; return False if a later state was here."""
        if self.begun is None:
            return False
        self.begun.put(room=saved)
        return True

    # Trial steps, whose result is a largest difference, so the first rank needs no state.

    def begin_trial(
        self, model: Model, loads: Loads, state: State, work: Work, watch: Watch | None
    ) -> None:
        """Begin at the state of the run; the work of its loads does not change."""
        with self.together():
            self._acted = loads
            self._distribute(model, loads, state, work, watch, of_run=True)
            if self._own is not self._tried_by:
                # Windows are other ones, and read other slots.
                self._tried_by, self._trials = self._own, {}
            self.order('begin_trial')
            acts = loads._replace(work=np.zeros_like(loads.work)) if len(loads.wrench) else None
            for name in (AHEAD, HALF):
                if name not in self._trials:
                    self._trials[name] = self._trial_room(state, work)
                self._trials[name] = self._trials[name]._replace(loads=acts)
            self._copy_trial(model, self._run, self._trials[AHEAD])

    def branch_trial(self, model: Model) -> None:
        """Start trial steps of half the length at the state of the others."""
        with self.together():
            self.order('branch_trial')
            self._copy_trial(model, self._trials[AHEAD], self._trials[HALF])

    def take_trial(self, which: str, origin: float, first: int, step: float, count: int) -> None:
        """Take `count` steps of `step` [s] from number `first` after `origin` [s] on."""
        interval = Interval(origin, first, step, count, 0, NEVER, beside=which)
        with self.together():
            self.order('take', interval)
            self._own.take(self._trials[which], interval)

    def trial_distance(self) -> tuple[float, float]:
        """Return the largest squared distance [m^2] and squared difference of orientations."""
        with self.together():
            self.order('trial_distance')
            place, turn = self.largest_of(squares_apart(
                self._trials[AHEAD].state, self._trials[HALF].state, self.rows[0]))
        return float(place), float(turn)

    def _trial_room(self, state: State, work: Work) -> Arrays:
        # Slots that vectors pass over hold ordinary numbers, too; all others take no memory.
        rows, read = [aligned_empty(values.shape) for values in state.rows()], SlotRows(
            LANES * self.slots_of_first)
        for values, target in zip(state.rows(), rows):
            read.copy(values, target)
        acceleration = aligned_empty(work.acceleration.shape)
        spent = None if work.spent is None else meter_room(acceleration.shape[1])
        return Arrays(
            None, State(*rows), work._replace(acceleration=acceleration, spent=spent))

    def _copy_trial(self, model: Model, source: Arrays, target: Arrays) -> None:
        """Copy the state of this rank's bodies."""
        part = self.parts[0]
        save(model, source.state, target.state, part.first, part.last)
        self.rows[0].copy(source.work.acceleration, target.work.acceleration)

    def gather(self) -> bool:
        """Gather the state of the run; return True if the ranks had it."""
        if self.unpacked is not None:
            self.unpacked.put()
            self.unpacked = None
        return super().gather()

    def enter(self) -> None:
        """Distribute the state of the call, unless the ranks hold it already."""
        if self._call.of_run:
            self._ledger, self._acted = Ledger.over(self._call.ledger), self._call.loads
        super().enter()
        self._is_moved = self._is_moved or self._call.of_run

    def take(self, interval: Interval) -> None:
        """Take the steps of an interval with all ranks."""
        contacts, self._is_here = self._call.model.contacts, False
        self.order('take', interval)
        self._own.take(self._now, interval)
        if contacts is not None:
            contacts.tests[0] += self._own.take_touches() * len(contacts.pairs)

    def leave(self) -> None:
        """Gather the state of a trial."""
        if not self._call.of_run:
            self._gather(self._now, self._call.model.contacts, of_run=False, whole=True)

    def exchange(self, *, is_guarded: bool, is_searched: bool) -> None:
        """Collect displacements, overlaps and impulses of contacts from all ranks."""
        contacts, own = self._call.model.contacts, self._now.contacts
        if own is not None and contacts is not None:
            contacts.deepest[0] = 0.0
            note_look(contacts, None, look_at(own, None))
            if is_guarded:
                mine = slice(self.parts[0].first, self.parts[0].last)
                contacts.pushes[mine] = own.pushes[mine]
        for rank in self.others:
            look = np.zeros(REPORT_SIZE)
            self.receive(look, rank)
            note_look(contacts, self._call.watch, look)
            if is_guarded and contacts is not None:
                part = self.parts[rank]
                self.receive(contacts.pushes[part.first:part.last], rank)

    def _arrays_of(
        self, loads: Loads, state: State, work: Work, contacts: Contacts | None,
        watch: Watch | None
    ) -> Arrays:
        return Arrays(loads if len(loads.wrench) else None, state, work, contacts, watch)

    def _send_windows(self, model: Model, arrays: Arrays) -> PartSteps:
        parts, layout = self.parts, self.packed.layout
        count = arrays.work.difference.shape[1] // LANES if self._weights.differences else 0
        blocks = np.arange(count) * len(layout.blocks.slot) // max(count, 1)
        chosen = [
            np.flatnonzero((blocks >= part.first) & (blocks < part.last)) for part in parts]
        self._samples = [
            (LANES * one[:, None] + np.arange(LANES)).ravel() for one in chosen]
        own = PartSteps(
            self.transport, model, exchange_of(layout, parts[0], blocks[chosen[0]]),
            self._weights)
        own.make_ready(arrays)
        self._cut_windows(
            model, arrays, self._weights, samples=[blocks[one] for one in chosen])
        return own

    def _scatter(self, now: Arrays, contacts: Contacts | None, *, of_run: bool) -> None:
        """Send each rank the state of its bodies; `contacts` are those of the whole fabric."""
        unpacked = self._unpacking = self.unpacked if of_run else None
        if unpacked is not None:
            # Also slots that vectors of this rank pass over.
            unpacked.put(SlotRows(LANES * self.slots_of_first))
            self.unpacked, self._is_stale, self._is_partial = None, True, True
            self.begun = unpacked
        super()._scatter(now, contacts, of_run=of_run)
        if unpacked is not None:
            unpacked.set_aside()
        self._is_moved = self._is_moved and not of_run
        self._copy_lost(contacts, now.contacts)
        if of_run:
            self._own.difference[:] = now.work.difference[:, self._samples[0]]
            self._own.roughest = 0.0

    def _send_tables(self, tables: list[np.ndarray], rank: int) -> list[Any]:
        """Start to send the rows of the bodies of a rank; the state may not be packed."""
        if self._unpacking is not None:
            self.transport.wait([
                self.transport.send(row, rank)
                for row in self._unpacking.rows(self.rows[rank].index)])
            tables = tables[len(self._unpacking.state.rows()):]
        return super()._send_tables(tables, rank)

    def _sampled(self, now: Arrays, rank: int) -> list[np.ndarray]:
        """Return differences of the motion in the samples of a rank."""
        return [np.ascontiguousarray(row[self._samples[rank]]) for row in now.work.difference]

    def _copy_lost(self, source: Contacts | None, target: Contacts | None) -> None:
        """Copy what contacts lose for the bodies of this rank."""
        if source is not None and target is not None and source.losses is not None and (
                target.losses is not None):
            self.rows[0].copy(source.losses.lost, target.losses.lost)

    def _gather(
        self, now: Arrays, contacts: Contacts | None, *, of_run: bool, whole: bool,
        which: tuple[Any, ...] | None = None
    ) -> None:
        """Gather the state of all ranks; `whole`: with all data of the next step."""
        if self._is_partial and of_run:
            complete(self.packed.layout, now.state)
            self._is_partial = False
        super()._gather(now, contacts, of_run=of_run, whole=whole, which=which)
        self._copy_lost(now.contacts, contacts)
        roughest = self._own.take_roughest()
        if of_run:
            self._ledger.roughest = max(self._ledger.roughest, roughest)
            if whole:
                now.work.difference[:, self._samples[0]] = self._own.difference

    def _receive_samples(self, now: Arrays, rank: int, *, whole: bool) -> None:
        """Receive the roughness of the motion, and differences in the samples of a rank."""
        rough = np.zeros(1)
        self.receive(rough, rank)
        self._ledger.roughest = max(self._ledger.roughest, float(rough[0]))
        if whole:
            for row in now.work.difference:
                sampled = np.empty(len(self._samples[rank]))
                self.receive(sampled, rank)
                row[self._samples[rank]] = sampled

    def _which(self, *, whole: bool) -> tuple[Any, ...]:
        """Return the arguments of `exchanged` by which ranks send their states."""
        return (whole,)
