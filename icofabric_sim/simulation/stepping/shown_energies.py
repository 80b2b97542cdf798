# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Energies and work of the state shown last, which may lie within a step."""

import math
from typing import Any

from icofabric_sim.kernels.loads import energy_of_drives, look_at_anchors
from icofabric_sim.kernels.records import Loads, State
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.stepping.contact_scheduler import ContactScheduler
from icofabric_sim.simulation.stepping.trajectory import Trajectory
import numpy as np


class ShownEnergies:
    """Energies [J] that a snapshot needs for its balance, in addition to its state."""

    def __init__(self, trajectory: Trajectory, contact: ContactScheduler) -> None:
        """Show states of the `trajectory` by `note`."""
        self._trajectory, self._contact = trajectory, contact
        # What a body force has spent and given since the start.
        self.given = 0.0
        self._spent = self._work = self._friction = 0.0
        # Energies of the anchors, and of the contacts with their friction springs.
        self.anchors = self.contact = 0.0
        # (p, 4) [m] of friction springs in the state that was shown last, until the next one.
        self.stretches: np.ndarray | None = None
        # Potential energy of a body force where the balance begins.
        self.potential_start = 0.0

    def restart(self) -> None:
        """Start the balance with the present state."""
        trajectory = self._trajectory
        force = trajectory.packed.body_force
        if force is not None:
            place = trajectory.packed.layout.unpack(trajectory.state)
            self.potential_start = force.energy(
                trajectory.time, place.position, place.orientation)

    @property
    def work(self) -> float:
        """Work of all loads."""
        return self._trajectory.ledger.earlier_work + self._work

    @property
    def spent(self) -> float:
        """Energy dissipated by forces that depend on velocities, less that in friction springs."""
        return self._spent - self._friction

    def note(
        self, state: State, time: float, stretches: np.ndarray | None, *, work: float,
        spent: float, given: float
    ) -> None:
        """
        Show a `state` at `time` [s] with the `stretches` of its friction springs.

        `work` of the present loads, and energies `spent` and `given`, are those until then [J].
        """
        trajectory, self.stretches = self._trajectory, stretches
        self._work, self._spent, self.given = work + self.moving(state), spent, given
        energy, self._friction = self._contact.phase.energies(state, stretches)
        self.contact = energy + self._friction
        if trajectory.loads.anchors is not None:
            _, energy = look_at_anchors(trajectory.model, trajectory.loads, state, time)
            self.anchors = float(energy)

    def moving(self, state: State | None = None) -> float:
        """
        Return the kinetic energy [J] of driven bodies in a `state`, by default the present one.
        """
        trajectory = self._trajectory
        loads = trajectory.for_steps()[0]
        if loads.drives is None:
            return 0.0
        return float(energy_of_drives(
            trajectory.model, loads, trajectory.state if state is None else state))

    def state_tree(self) -> dict[str, Any]:
        """Return the start of the balance, as an entry; empty without a body force."""
        if self._trajectory.work.given is None:
            return {}
        return {'potential_start': self.potential_start}

    def load_state(self, tree: StateTree) -> None:
        """Restore the start of the balance."""
        if self._trajectory.work.given is not None:
            self.potential_start = tree.number('potential_start')


def work_of(*loads: Loads) -> float:
    """Return the work [J] of all `loads`."""
    return sum(math.fsum(part.work) for part in loads)
