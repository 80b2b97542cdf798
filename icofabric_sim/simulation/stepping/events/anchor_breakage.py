# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Breakage of anchors that reach a limit of their length."""

from typing import Any

from icofabric_sim.geometry.rotations import cosines_from_quaternions, quaternions_from_cosines
from icofabric_sim.kernels.records import State
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.inputs.anchor_breaks import AnchorBreaks
from icofabric_sim.simulation.model.anchor_stiffness import motion_of_points
from icofabric_sim.simulation.stepping.event_location import first_limit
from icofabric_sim.simulation.stepping.pieces import Pieces
from icofabric_sim.simulation.stepping.step_in_progress import StepInProgress
from icofabric_sim.terms.anchors.record import Anchors
import numpy as np


def why(scene: Scene) -> str:
    """Return why a scene needs steps that end where an anchor breaks; empty if it does not."""
    return 'anchors that break need steps that end where one does' if scene.anchors_break else ''


def make(pieces: Pieces, step: StepInProgress) -> 'AnchorBreakage | None':
    """Return the locator; None if no anchor can break."""
    breaks = pieces.trajectory.anchor_breaks
    return None if breaks is None else AnchorBreakage(pieces, step, breaks)


class AnchorBreakage:
    """
    Locator of the first anchors to break in the step in progress, which break at its end.

    Each step is searched, because anchors are few.
    """

    status = 0

    def __init__(self, pieces: Pieces, step: StepInProgress, breaks: AnchorBreaks) -> None:
        """Search the `step` in progress for unbroken anchors of `breaks`."""
        self._trajectory, self._step, self._breaks = pieces.trajectory, step, breaks
        self.is_due = False
        # Numbers of the anchors that were found.
        self._found = np.zeros(0, np.int64)

    def find(self) -> float | None:
        """
        Return the fraction of the step in progress at which anchors first break; None without any.
        """
        breaks, step = self._breaks, self._step
        left = breaks.left
        if not len(left):
            return None
        found = first_limit(
            lambda part: self._lengths(
                step.within(part), step.control.start + part * step.length, left),
            breaks.longest[left], breaks.shortest[left], step.length)
        if found is None:
            return None
        part, reached = found
        self._found = left[reached]
        return part

    def happen(self) -> None:
        """Break the located anchors; their energy is lost."""
        trajectory, found, end = self._trajectory, self._found, self._step.end
        length, _ = self._lengths(trajectory.state, end, found)
        extension, compression, rest = self._breaks.law[found].T
        stretch = length - rest
        slope = np.where(stretch > 0.0, extension, compression)
        trajectory.ledger.lost += float((0.5 * slope * stretch**2).sum())
        self._breaks.add(found, end)
        # Also in what acts now; what is packed later knows of it.
        anchors = self._anchors
        anchors.extension[found] = anchors.compression[found] = 0.0
        if anchors.damping is not None:
            anchors.damping[found] = 0.0

    def state_tree(self) -> dict[str, Any]:
        """Return the anchors that break at the end of the step in progress, as an entry."""
        return {'due_anchors': self._found.astype(float)} if self.is_due else {}

    def load_state(self, tree: StateTree) -> None:
        """Restore the anchors to break from a checkpoint."""
        self.is_due = 'due_anchors' in tree
        if self.is_due:
            values, left = tree.array('due_anchors'), self._breaks.left
            if values.ndim != 1 or not np.isin(values, left).all():
                raise ValueError('due_anchors must be numbers of anchors that may still break')
            self._found = values.astype(np.int64)

    @property
    def _anchors(self) -> Anchors:
        anchors = self._trajectory.loads.anchors
        assert anchors is not None
        return anchors

    def _lengths(
        self, state: State, time: float, chosen: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return lengths [m] of some anchors in a state at `time` [s], and their rates [m/s]."""
        layout, anchors, breaks = self._trajectory.packed.layout, self._anchors, self._breaks
        slot = layout.slot[breaks.body[chosen]]
        turned = layout.gather(state.orientation)[breaks.body[chosen]] if layout.cosines else (
            np.ascontiguousarray(state.orientation[:, slot].T))
        if layout.cosines:
            turned = quaternions_from_cosines(turned)
        arm = np.einsum('ai,aij->aj', breaks.arm[chosen], cosines_from_quaternions(turned))
        point, speed = motion_of_points(anchors, chosen, time)
        line = state.position[:, slot].T + arm - point
        moving = state.linear_velocity[:, slot].T + np.cross(
            state.angular_velocity[:, slot].T, arm) - speed
        length = np.sqrt((line * line).sum(axis=1))
        return length, (line * moving).sum(axis=1) / np.maximum(length, 1e-300)
