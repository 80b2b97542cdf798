# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The step in progress of an embedded Runge-Kutta pair, and states and energies within it."""

import math
from typing import Any

from icofabric_sim.kernels.integrators import embedded
from icofabric_sim.kernels.records import Loads, State, Trail
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.model.layout import copy_state
from icofabric_sim.simulation.model.shared_kinds import (
    BESIDE_DRIVES,
    TERMS,
    Without,
    without,
)
from icofabric_sim.simulation.stepping.contact_scheduler import ContactScheduler
from icofabric_sim.simulation.stepping.embedded_control import EmbeddedControl
from icofabric_sim.simulation.stepping.trajectory import Trajectory
from icofabric_sim.simulation.stepping.trial_steps import TrialSteps
from icofabric_sim.terms.meters import Meter
import numpy as np


class StepInProgress:
    """
    A step from the time of the trajectory to the end where the state of the trajectory is.

    Length 0 means that no step is in progress, and the state belongs to the time of the
    trajectory.
    """

    def __init__(
        self, trajectory: Trajectory, contact: ContactScheduler, trials: TrialSteps
    ) -> None:
        """Belong to a `trajectory` with an embedded control."""
        assert trajectory.method.embedded is not None
        self._kernels = trajectory.method.embedded
        self._kept = list(self._kernels.slopes)
        self._trajectory, self._contact, self._trials = trajectory, contact, trials
        self._has_dense = False
        self._room: State | None = None
        # For states within the step, which need only the paths of drives.
        self._bodies = without(trajectory.model, *TERMS)
        self._drives_of: Without[Loads] = Without(*BESIDE_DRIVES)

    @property
    def control(self) -> EmbeddedControl:
        """Values by which the kernel controls steps."""
        control = self._trajectory.control
        assert control is not None
        return control

    @property
    def trail(self) -> Trail:
        """Arrays of the step that the kernel keeps."""
        trail = self._trajectory.work.trail
        assert trail is not None
        return trail

    @property
    def start(self) -> State:
        """State at the start of the step."""
        return self.trail.start

    @property
    def length(self) -> float:
        """Length of the step [s]; 0: no step is in progress."""
        return self.control.length

    @property
    def end(self) -> float:
        """Time [s] of the end of the step, to which the state of the trajectory belongs."""
        return self.control.start + self.control.length

    def change(self) -> None:
        """Discard the dense output, because another step follows."""
        self._has_dense = False

    def give_up(self) -> None:
        """Return to the start of the step."""
        trajectory, control = self._trajectory, self.control
        if control.length > 0.0:
            copy_state(self.start, trajectory.state)
            trajectory.return_work()
            for meter in trajectory.meters().values():
                np.copyto(meter.done[0], meter.done[1])
            losses = trajectory.losses
            if losses is not None:
                np.copyto(losses.stretch, losses.start)
            control.total -= control.rate * control.length
            control.clear_total -= control.is_clear * control.rate * control.length
            if trajectory.saved_time > trajectory.time:
                trajectory.save()
        control.length = control.has_last = 0.0
        self._has_dense = False

    def prepare_dense(self) -> None:
        """Compute the slopes that states within the step need."""
        if self._has_dense:
            return
        trajectory, length = self._trajectory, self.length
        loads, watch = self._trials.copy_loads(), self._contact.phase.trial_watch
        trajectory.thread_team.run(lambda team: self._kernels.prepare(
            trajectory.model, loads, trajectory.state, trajectory.work, team, watch,
            trajectory.time, length))
        trajectory.evaluations.add(self._kernels.prepare_count)
        self._has_dense = True
        trajectory.require_body_force()

    def within(self, part: float) -> State:
        """Return the state at a fraction of the step, 0 and 1 included; see `dense`."""
        if part == 0.0:
            return self.start
        return self._trajectory.state if part == 1.0 else self.dense(part)

    def dense(self, part: float) -> State:
        """
        Return the state at a fraction `part` of the step, in (0, 1]; valid until the next call.
        """
        self.prepare_dense()
        trajectory, trail, length = self._trajectory, self.trail, self.length
        if self._room is None:
            # Slots without a body are never written.
            self._room = trajectory.packed.layout.like(trajectory.state)
            copy_state(trajectory.state, self._room)
        target = self._room
        model, loads = trajectory.model, trajectory.loads
        if not self._kernels.reads_terms:
            model, loads = self._bodies, self._drives_of(loads)
        trajectory.thread_team.run(lambda team: self._kernels.state(
            model, loads, trajectory.state, team, trail, trajectory.time, length, part, target))
        return target

    def state_within(self, rest: float) -> State:
        """Return the state `rest` [s] after the start; dense output is prepared."""
        if not self._is_within:
            return self._trajectory.state
        if not rest > 0.0:
            return self.start
        return self.dense(rest / self.length)

    def stretches_within(self, rest: float) -> np.ndarray | None:
        """Return the stretches of friction springs `rest` [s] after the start."""
        losses = self._trajectory.losses
        if losses is None or not self._is_within:
            return self._trajectory.stretches()
        if not rest > 0.0:
            return losses.start
        found = self._kernels.sum(
            losses.slopes.reshape(len(losses.slopes), -1), losses.start.ravel(),
            losses.stretch.ravel(), self.length, rest / self.length)
        return np.asarray(found).reshape(losses.stretch.shape)

    def work_within(self, rest: float) -> float:
        """Return the work [J] of the present loads until `rest` [s] after the start."""
        loads = self._trajectory.loads
        return self._flow_within(loads.power, loads.earlier_work, loads.work, rest)

    def flow_within(self, meter: Meter | None, rest: float) -> float:
        """Return the energy [J] of a `meter` until `rest` [s] after the start."""
        if meter is None:
            return 0.0
        return self._flow_within(meter.power, meter.done[1], meter.done[0], rest)

    def _flow_within(
        self, power: np.ndarray, before: np.ndarray, after: np.ndarray, rest: float
    ) -> float:
        """Return the energy [J] that flowed with `power` (16, m), by dense output."""
        if not self._is_within:
            return _total(after)
        if not rest > 0.0:
            return _total(before)
        rates = np.array([_total(row) for row in power])
        return float(self._kernels.sum(
            rates, _total(before), _total(after), self.length, rest / self.length))

    @property
    def _is_within(self) -> bool:
        """True if states within a step exist; after a failure only the last good one does."""
        return self._trajectory.failure is None and self.length > 0.0

    def state_tree(self, tree: dict[str, Any]) -> None:
        """Add the step to the `tree` of its trajectory."""
        trajectory, gather = self._trajectory, self._trajectory.packed.layout.gather_moving
        tree['control'] = self.control.numbers.copy()
        # Where the last call was to lead says nothing of the next.
        tree['control'][embedded.GOAL] = 0.0
        if not self.length > 0.0:
            return
        tree['start'] = trajectory.by_body(self.start)
        tree['slopes'] = gather(self.trail.slopes[self._kept])
        if 'loads' in tree:
            rows = trajectory.rows_by_body(trajectory.loads)
            tree['loads']['power'] = trajectory.loads.power[:, rows][self._kept]
        for name, meter in trajectory.meters().items():
            tree[f'{name}_power'] = gather(meter.power[self._kept])

    def load_control(self, tree: StateTree) -> None:
        """Restore the control from a checkpoint, which includes the time of the trajectory."""
        numbers = tree.array('control', (embedded.CONTROL_COUNT,))
        if not (np.isfinite(numbers).all() and numbers.min() >= 0.0):
            raise ValueError('control holds a negative number or one that is not finite')
        np.copyto(self.control.numbers, numbers)
        self._has_dense = False

    def load_state(self, tree: StateTree) -> None:
        """Restore the step from a checkpoint."""
        trajectory, control = self._trajectory, self.control
        if trajectory.failure is None and not control.next > 0.0 < control.shortest:
            raise ValueError('control has no length for the next step')
        if not control.length > 0.0:
            return
        slots, slopes = trajectory.packed.layout.moving_slots, self.trail.slopes
        trajectory.take_back(self.start, tree.part('start'))
        found = tree.array('slopes', (len(slots), len(self._kept), slopes.shape[1]))
        slopes[:] = 0.0
        for k, number in enumerate(self._kept):
            slopes[number][:, slots] = found[:, k].T
        self._load_power(trajectory.loads, tree)
        for name, meter in trajectory.meters().items():
            power = tree.array(f'{name}_power', (len(slots), len(self._kept)))
            for number, values in zip(self._kept, power.T):
                meter.power[number, slots] = values

    def _load_power(self, loads: Loads, tree: StateTree) -> None:
        if not len(loads.wrench):
            return
        rows = self._trajectory.rows_by_body(loads)
        power = tree.part('loads').array('power', (len(self._kept), len(rows)))
        for number, values in zip(self._kept, power):
            loads.power[number, rows] = values


def _total(values: np.ndarray) -> float:
    # Where numbers run away the next health check ends the run.
    return math.fsum(values) if np.isfinite(values).all() else math.nan
