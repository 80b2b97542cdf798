# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Queries about all bodies of a run, computed in this process."""

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.group_sums import note_squares, note_sums
from icofabric_sim.simulation.model.anchor_stiffness import anchor_accelerations
from icofabric_sim.simulation.stepping.executor import Executor
from icofabric_sim.simulation.stepping.trajectory import Trajectory
import numpy as np


class Threads(Executor):
    """Executor of the state of a trajectory, which is gathered when it is read."""

    def __init__(self, trajectory: Trajectory) -> None:
        """Compute with the state of the `trajectory`."""
        self._trajectory = trajectory

    def refresh(self, time: float) -> None:
        """Compute the accelerations of the state at `time` [s]."""
        self._trajectory.refresh(time)

    def fill_figures(self, time: float, numbers: np.ndarray) -> None:
        """Write the figures of a health check at `time` [s] to the `numbers` of a ledger."""
        trajectory = self._trajectory
        # A state that comes from ranks or a device comes without its attachment points.
        trajectory.place_points()
        monitor.examine(
            trajectory.model, trajectory.loads, trajectory.state, trajectory.work, time, numbers)

    def squares(self, fall: np.ndarray, sums: np.ndarray) -> None:
        """Write sums (2, g) of squared accelerations, with those by anchors."""
        trajectory, model = self._trajectory, self._trajectory.model
        acceleration = trajectory.work.acceleration
        if trajectory.loads.anchors is not None:
            acceleration = acceleration + anchor_accelerations(
                model, trajectory.loads, trajectory.state, trajectory.time)
        note_squares(
            model.blocks, model.masses, acceleration, fall, sums, trajectory.work.group, 0,
            sums.shape[1], len(model.blocks.slot))

    def velocity_sums(self, sums: np.ndarray) -> None:
        """Write sums (3, g) of velocities [m/s]."""
        trajectory, blocks = self._trajectory, self._trajectory.model.blocks
        note_sums(
            blocks, trajectory.state.linear_velocity, sums, trajectory.work.group, 0,
            sums.shape[1], len(blocks.slot))

    def fastest_square(self, velocity: np.ndarray) -> float:
        """Return the largest squared velocity relative to `velocity` (3,) [m^2/s^2]."""
        trajectory = self._trajectory
        apart = trajectory.state.linear_velocity[:, trajectory.packed.layout.slot] - (
            velocity[:, None])
        return float((apart**2).sum(axis=0).max(initial=0.0))
