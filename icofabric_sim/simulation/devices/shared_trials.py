# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Trial steps of all ranks beside a run, whose state stays where it is.

Their result is a largest difference, so the first rank needs no state.
"""

from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.kernels.monitor import save
from icofabric_sim.kernels.records import Loads, Model, State, Watch, Work
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.beside import AHEAD, HALF, meter_room, squares_apart
from icofabric_sim.simulation.devices.executor import Interval
from icofabric_sim.simulation.devices.leader import SharedSteps
from icofabric_sim.simulation.devices.part_steps import Arrays, PartSteps
from icofabric_sim.simulation.devices.slot_rows import SlotRows
from icofabric_sim.simulation.model.layout import aligned_empty
import numpy as np


class SharedTrials:
    """Trial steps of all ranks; created on the first rank."""

    def __init__(self, steps: SharedSteps) -> None:
        """Try steps beside the `steps` of a run."""
        self._steps, self._sharing = steps, steps.holder
        self._own: PartSteps | None = None
        self._arrays: dict[str, Arrays] = {}

    def begin(
        self, model: Model, loads: Loads, state: State, work: Work, watch: Watch | None
    ) -> None:
        """Begin at the state of the run; the work of its loads does not change."""
        with self._steps.together():
            own, run = self._steps.hold(model, loads, state, work, watch)
            if own is not self._own:
                # Windows are other ones, and read other slots.
                self._own, self._arrays = own, {}
            self._sharing.order('begin_beside')
            acts = loads._replace(work=np.zeros_like(loads.work)) if self._sharing.acts else None
            for name in (AHEAD, HALF):
                if name not in self._arrays:
                    self._arrays[name] = self._room(state, work)
                self._arrays[name] = self._arrays[name]._replace(loads=acts)
            self._copy(model, run, self._arrays[AHEAD])

    def branch(self, model: Model) -> None:
        """Start trial steps of half the length at the state of the others."""
        with self._steps.together():
            self._sharing.order('branch')
            self._copy(model, self._arrays[AHEAD], self._arrays[HALF])

    def take(self, which: str, origin: float, first: int, step: float, count: int) -> None:
        """Take `count` steps of `step` [s] from number `first` after `origin` [s] on."""
        assert self._own is not None
        interval = Interval(origin, first, step, count, 0, NEVER, beside=which)
        with self._steps.together():
            self._sharing.order('take', interval)
            self._own.take(self._arrays[which], interval)

    def apart(self) -> tuple[float, float]:
        """Return the largest squared distance [m^2] and squared difference of orientations."""
        with self._steps.together():
            self._sharing.order('apart')
            place, turn = self._sharing.largest_of(squares_apart(
                self._arrays[AHEAD].state, self._arrays[HALF].state, self._sharing.rows[0]))
        return float(place), float(turn)

    def _room(self, state: State, work: Work) -> Arrays:
        # Slots that vectors pass over hold ordinary numbers, too; all others take no memory.
        rows, read = [aligned_empty(values.shape) for values in state.rows()], SlotRows(
            LANES * self._sharing.slots_of_first)
        for values, target in zip(state.rows(), rows):
            read.copy(values, target)
        acceleration = aligned_empty(work.acceleration.shape)
        spent = None if work.spent is None else meter_room(acceleration.shape[1])
        return Arrays(
            None, State(*rows), work._replace(acceleration=acceleration, spent=spent))

    def _copy(self, model: Model, source: Arrays, target: Arrays) -> None:
        """Copy the state of this rank's bodies."""
        part = self._sharing.parts[0]
        save(model, source.state, target.state, part.first, part.last)
        self._sharing.rows[0].copy(source.work.acceleration, target.work.acceleration)
