# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Queries about the full state of a run: forces, figures, the largest frequency.

Ranks that take the steps may hold the state and answer (`Elsewhere` in methods.py); else this
process computes the answer. The sums are bit-identical.
"""

import math

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.group_sums import note_squares, note_sums
from icofabric_sim.kernels.lanczos import added_up
from icofabric_sim.kernels.masses import units_of
from icofabric_sim.simulation.model.anchor_stiffness import anchor_accelerations
from icofabric_sim.simulation.model.stability import Frequency, largest_frequency, with_anchors
from icofabric_sim.simulation.stepping.method_calls import MethodCalls
from icofabric_sim.simulation.stepping.methods import Elsewhere
from icofabric_sim.simulation.stepping.trajectory import Trajectory
import numpy as np


class WholeState:
    """Queries about the full state, local or distributed."""

    def __init__(self, trajectory: Trajectory, calls: MethodCalls) -> None:
        """Query the state of the `trajectory`, by `calls` if it is distributed."""
        self._trajectory, self._calls = trajectory, calls

    def refresh(self) -> None:
        """Compute the accelerations of the state."""
        trajectory, elsewhere = self._trajectory, self._elsewhere()
        if elsewhere is None:
            trajectory.refresh()
            return
        trajectory.evaluations.add()
        with self._calls.or_lost():
            elsewhere.refresh(trajectory.time)

    def examine(self) -> None:
        """Write the figures of a health check to the ledger."""
        trajectory, elsewhere = self._trajectory, self._elsewhere()
        numbers = trajectory.ledger.numbers
        if elsewhere is not None:
            with self._calls.or_lost():
                elsewhere.examine(trajectory.time, numbers)
            return
        # A state that comes from ranks or a device comes without its attachment points.
        trajectory.place_points()
        monitor.examine(
            trajectory.model, trajectory.loads, trajectory.state, trajectory.work,
            trajectory.time, numbers)

    def squares(self) -> float:
        """
        Return the sum of squared forces and torques over masses and inertias [N^2/kg].

        Forces of anchors are included, and the weight in free fall is not, because it does not
        return. Accelerations are those of `refresh`.
        """
        trajectory, elsewhere = self._trajectory, self._elsewhere()
        packed, model, work = trajectory.packed, trajectory.model, trajectory.for_steps()[3]
        fall = np.zeros(3)
        if model.gravity is not None and not packed.held:
            fall = model.gravity.acceleration
        count = len(model.blocks.slot)
        sums = np.zeros((2, -(-count // work.group)))
        if elsewhere is not None:
            with self._calls.or_lost():
                elsewhere.squares(fall, sums)
        else:
            acceleration = trajectory.work.acceleration
            if trajectory.loads.anchors is not None:
                acceleration = acceleration + anchor_accelerations(
                    model, trajectory.loads, trajectory.state, trajectory.time)
            note_squares(
                model.blocks, model.masses, acceleration, fall, sums, work.group, 0,
                sums.shape[1], count)
        mass, inertia = units_of(model.masses, model.inverse_mass, model.inverse_inertia)
        return float(mass * added_up(sums[0]) + inertia * added_up(sums[1]))

    def relative_speed(self) -> float:
        """Return the largest speed [m/s] of a body relative to the mean velocity."""
        trajectory, elsewhere = self._trajectory, self._elsewhere()
        blocks, work = trajectory.model.blocks, trajectory.for_steps()[3]
        count = len(blocks.slot)
        sums = np.zeros((3, -(-count // work.group)))
        if elsewhere is None:
            velocity = trajectory.state.linear_velocity
            note_sums(blocks, velocity, sums, work.group, 0, sums.shape[1], count)
        else:
            with self._calls.or_lost():
                elsewhere.velocity_sums(sums)
        mean = np.array([added_up(row) for row in sums]) / trajectory.packed.layout.body_count
        if elsewhere is None:
            apart = velocity[:, trajectory.packed.layout.slot] - mean[:, None]
            return math.sqrt(float((apart**2).sum(axis=0).max(initial=0.0)))
        with self._calls.or_lost():
            return math.sqrt(elsewhere.fastest_square(mean))

    def frequency(self, *, locate: bool = False) -> Frequency:
        """
        Return the largest frequency of the fabric; `locate` adds the bodies of its vibration.
        """
        trajectory, found = self._trajectory, None
        elsewhere = None if locate else self._elsewhere()
        if elsewhere is not None:
            with self._calls.or_lost():
                found = elsewhere.largest()
        if found is not None:
            return found
        packed, state = trajectory.packed, trajectory.state
        return with_anchors(
            largest_frequency(packed, state, locate=locate), packed, trajectory.loads, state,
            trajectory.time)

    def _elsewhere(self) -> Elsewhere | None:
        """Return the processes that answer for the state; None: this process."""
        trajectory = self._trajectory
        elsewhere, (loads, _, _, work) = trajectory.method.elsewhere, trajectory.for_steps()
        # What touches, anchors, paths, and what is spent are added up here alone.
        if elsewhere is None or not (
                trajectory.model.contacts is None and loads.anchors is None
                and loads.drives is None and work.spent is None and work.given is None):
            return None
        self._calls.hold(elsewhere)
        return elsewhere
