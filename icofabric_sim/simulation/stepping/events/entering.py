# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Connectors that enter their own shell within a step, if such connectors end the run.

Health checks test the ends of steps (connector.obstruction: stop). Steps of high order may be as
long as a third of a vibration, so that a connector may be inside a shell in between.
"""

from typing import Any

from icofabric_sim.geometry.rotations import quaternions_from_cosines
from icofabric_sim.kernels.obstruction import find_obstructed
from icofabric_sim.kernels.records import State
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.stepping.pieces import Pieces
from icofabric_sim.simulation.stepping.step_in_progress import StepInProgress
import numpy as np

# Radians of the fastest motion from one look to the next, at most; looks within a step. A look
# takes as long as a step of a few dozen bodies.
_APART, _MAX_SAMPLE_COUNT = 1.0, 7


def why(scene: Scene) -> str:
    """Return an empty text: other methods test the ends of their steps."""
    return ''


def make(pieces: Pieces, step: StepInProgress) -> 'Entering | None':
    """Return the locator; None if no connector ends the run."""
    obstruction = pieces.monitor.obstruction
    return Entering(pieces, step) if obstruction.stops and obstruction.is_watching else None


class Entering:
    """Tests between the ends of the step in progress."""

    status = 0

    def __init__(self, pieces: Pieces, step: StepInProgress) -> None:
        """Search the `step` in progress."""
        self._pieces, self._step, self.is_due = pieces, step, False

    def find(self) -> float | None:
        """
        Return a fraction of the step in progress at which a connector is in its shell, if any.
        """
        pieces, step = self._pieces, self._step
        if not pieces.monitor.obstruction.is_watching:
            return None
        rate = pieces.rates.fabric.rate + pieces.trajectory.ledger.spin
        looks = min(int(step.length * rate / _APART), _MAX_SAMPLE_COUNT)
        parts = (number / (looks + 1) for number in range(1, looks + 1))
        return next((part for part in parts if self._enters(step.dense(part))), None)

    def happen(self) -> None:
        """End the run if the connector is in its shell also in the step that ends here."""
        if self._enters(self._pieces.trajectory.state):
            self._pieces.monitor.handle_obstruction(self._step.end)

    def state_tree(self) -> dict[str, Any]:
        """Return no entries: this event ends the run."""
        return {}

    def load_state(self, tree: StateTree) -> None:
        """Reset the event."""
        self.is_due = False

    def _enters(self, state: State) -> bool:
        trajectory = self._pieces.trajectory
        packed = trajectory.packed
        assert packed.connectors is not None
        layout, found = packed.layout, np.zeros(len(packed.connectors.first), np.uint8)
        orientation = layout.gather(state.orientation)
        if layout.cosines:
            orientation = quaternions_from_cosines(orientation)
        places = layout.gather(state.position), orientation
        for rows in places:
            # As the kernel was compiled for snapshots.
            rows.flags.writeable = False
        find_obstructed(packed.connectors, packed.model.shells, *places, found[packed.woven])
        if trajectory.broken.since is not None:
            found[~np.isnan(trajectory.broken.since)] = 0
        return bool(found.any())
