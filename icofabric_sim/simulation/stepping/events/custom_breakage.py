# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Breakage of custom connectors that reach a limit of their length."""

from typing import Any

from icofabric_sim.scene.custom_connectors import CustomConnectors
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.model.ties import tie_lengths
from icofabric_sim.simulation.stepping.event_location import first_limit
from icofabric_sim.simulation.stepping.pieces import Pieces
from icofabric_sim.simulation.stepping.step_in_progress import StepInProgress
import numpy as np


def why(scene: Scene) -> str:
    """Return why the scene needs such steps: breakage.py gives the reason for all connectors."""
    return ''


def make(pieces: Pieces, step: StepInProgress) -> 'CustomBreakage | None':
    """Return the locator; None if no custom connector can break."""
    custom = pieces.trajectory.packed.custom
    if custom is None or (custom.limits == [[np.inf], [0.0]]).all():
        return None
    return CustomBreakage(pieces, step, custom)


class CustomBreakage:
    """
    Locator of the first custom connectors to break in the step in progress.

    They break at the end of the step. Each step is searched.
    """

    status = 0

    def __init__(self, pieces: Pieces, step: StepInProgress, custom: CustomConnectors) -> None:
        """Search the `step` in progress for unbroken connectors of `custom`."""
        self._trajectory, self._step, self._custom = pieces.trajectory, step, custom
        self._layout = self._trajectory.packed.layout
        self.is_due = False
        # Numbers of the custom connectors that were found.
        self._found = np.zeros(0, np.int64)

    @property
    def _left(self) -> np.ndarray:
        """Numbers of the unbroken custom connectors with a limit."""
        longest, shortest = self._custom.limits
        ties = self._trajectory.model.ties
        assert ties is not None
        intact = np.zeros(len(longest), bool)
        intact[ties.number[ties.present != 0]] = True
        return np.flatnonzero(intact & (np.isfinite(longest) | (shortest > 0.0)))

    def find(self) -> float | None:
        """Return the fraction of the step in progress at which some first break; None: none do."""
        step, left = self._step, self._left
        if not len(left):
            return None
        longest, shortest = self._custom.limits[:, left]
        found = first_limit(
            lambda part: tie_lengths(self._custom, left, self._layout, step.within(part)),
            longest, shortest, step.length)
        if found is None:
            return None
        part, reached = found
        self._found = left[reached]
        return part

    def happen(self) -> None:
        """Break the located connectors; their energy is lost."""
        trajectory, found = self._trajectory, self._found
        length, _ = tie_lengths(self._custom, found, self._layout, trajectory.state)
        extension, compression, rest = self._custom.laws[:, found]
        stretch = length - rest
        slope = np.where(stretch > 0.0, extension, compression)
        trajectory.ledger.lost += float((0.5 * slope * stretch**2).sum())
        trajectory.broken.add(found + trajectory.packed.woven.stop, self._step.end)

    def state_tree(self) -> dict[str, Any]:
        """Return the connectors that break at the end of the step in progress, as an entry."""
        return {'due_custom': self._found.astype(float)} if self.is_due else {}

    def load_state(self, tree: StateTree) -> None:
        """Restore the connectors to break from a checkpoint."""
        self.is_due = 'due_custom' in tree
        if self.is_due:
            values = tree.array('due_custom')
            if values.ndim != 1 or not np.isin(values, np.arange(len(self._custom.bodies))).all():
                raise ValueError('due_custom must be numbers of custom connectors')
            self._found = values.astype(np.int64)
