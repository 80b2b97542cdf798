# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Wrenches and anchors on a fabric at one time."""

from typing import NamedTuple

from icofabric_sim.simulation.model.anchor_stiffness import stiffness_of
from icofabric_sim.simulation.model.packing import WrenchRow
from icofabric_sim.statics.sides import slopes_on
from icofabric_sim.statics.tangent import as_springs, find_kinks, Stretched
from icofabric_sim.terms.anchors.record import Anchors
import numpy as np


class Acting(NamedTuple):
    """Wrenches in one configuration, and the energy of those with a potential."""

    energy: float  # [J] of dead loads: forces of fixed direction at fixed points of their bodies
    wrench: np.ndarray  # (n, 6) force [N] and torque about the centre [N m], world frame
    # (n, 3, 3) second derivative of that energy along rotation vectors; None: all dead loads act
    # at centres.
    turning: np.ndarray | None


class DeadLoads:
    """Wrenches at one time; follower loads and torques have no potential."""

    def __init__(
        self, rows: list[WrenchRow], time: float, body_count: int, factor: float = 1.0
    ) -> None:
        """Evaluate the wrenches at `time` [s], times a `factor`."""
        self._count = body_count
        self._rows = [(row, factor * row.piece.at(time)) for row in rows]
        self._rows = [(row, factor) for row, factor in self._rows if factor != 0.0]

    @property
    def largest_force(self) -> float:
        """Largest force [N] on a body."""
        return max((float(np.linalg.norm(factor * row.force)) for row, factor in self._rows),
                   default=0.0)

    @property
    def largest_torque(self) -> float:
        """Largest torque [N m] on a body, without that of its force."""
        return max((float(np.linalg.norm(factor * row.torque)) for row, factor in self._rows),
                   default=0.0)

    @property
    def conservative(self) -> bool:
        """True if all wrenches have a potential."""
        return not any(
            row.in_body_axes or row.torque.any() or row.normal.any() for row, _ in self._rows)

    def dead_wrench(self, axes: np.ndarray) -> np.ndarray:
        """Return the wrenches (n, 6) that have a potential."""
        wrench = np.zeros((self._count, 6))
        for row, factor in self._rows:
            if not (row.in_body_axes or row.normal.any()):
                arm = np.einsum('i,nij->nj', row.point, axes[row.bodies])
                force = np.broadcast_to(factor * row.force, arm.shape)
                wrench[row.bodies] += np.hstack([force, np.cross(arm, force)])
        return wrench

    def act(self, position: np.ndarray, axes: np.ndarray) -> Acting:
        """Return the wrenches at `position` (n, 3) and `axes` (n, 3, 3), body axes as rows."""
        energy, wrench = 0.0, np.zeros((self._count, 6))
        turning: np.ndarray | None = None
        for row, factor in self._rows:
            own = axes[row.bodies]
            arm = np.einsum('i,nij->nj', row.point, own)
            force, torque = factor * row.force, factor * row.torque
            if row.in_body_axes:
                forces = np.einsum('i,nij->nj', force, own)
                torques = np.einsum('i,nij->nj', torque, own)
            else:
                forces, torques = (np.broadcast_to(part, arm.shape) for part in (force, torque))
            if row.normal.any():
                normal = np.einsum('i,nij->nj', row.normal, own)
                forces = normal * (forces * normal).sum(axis=1, keepdims=True)
            elif not row.in_body_axes:
                energy -= float(((position[row.bodies] + arm) @ force).sum())
                if row.point.any():
                    if turning is None:
                        turning = np.zeros((self._count, 3, 3))
                    turning[row.bodies] += turned_potential(forces, arm)
            wrench[row.bodies, :3] += forces
            wrench[row.bodies, 3:] += torques + np.cross(arm, forces)
        return Acting(energy, wrench, turning)


def turned_potential(force: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """
    Return the second derivative (n, 3, 3) of - F . (R p) along rotation vectors; s = R p: `arm`.

    With t = dtheta the second variation of s is (t (t . s) + t (s . t)) / 2 - s t^2, so the result
    is (F . s) 1 - (F s^T + s F^T) / 2.
    """
    mixed = force[:, :, None] * arm[:, None, :]
    dot = (force * arm).sum(axis=1)
    return np.asarray(
        dot[:, None, None] * np.eye(3) - 0.5 * (mixed + np.swapaxes(mixed, 1, 2)))


class AnchorPull:
    """Anchors with their world points at one time."""

    def __init__(
        self, anchors: Anchors | None, bodies: tuple[int, ...], points: np.ndarray, time: float
    ) -> None:
        """Store world `points` (a, 3) [m] at `time` [s]."""
        self._anchors, self._time = anchors, time
        self._bodies, self._points = np.array(bodies, np.int64), points

    @property
    def points(self) -> np.ndarray:
        """World points (a, 3) [m] of the anchors."""
        return self._points

    @property
    def count(self) -> int:
        """Number of anchors."""
        return len(self._bodies)

    def directions(
        self, position: np.ndarray, axes: np.ndarray
    ) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """Return body, arm [m] and direction to the world point of every anchor."""
        if self._anchors is None:
            return []
        arm = np.einsum('ai,aij->aj', self._anchors.arm, axes[self._bodies])
        reach = self._points - position[self._bodies] - arm
        reach = reach / np.linalg.norm(reach, axis=1, keepdims=True)
        return list(zip(self._bodies.tolist(), arm, reach))

    def act(self, position: np.ndarray, axes: np.ndarray, lever: float) -> 'AnchorState':
        """Return the anchors in a configuration; `lever`: see `lever_of`."""
        wrench = np.zeros((len(position), 6))
        anchors = self._anchors
        if anchors is None:
            none = np.zeros(0)
            return AnchorState(
                0.0, wrench, none, none, Stretched(none, none, none > 0.0, none > 0.0))
        arm = np.einsum('ai,aij->aj', anchors.arm, axes[self._bodies])
        reach = self._points - position[self._bodies] - arm
        length = np.linalg.norm(reach, axis=1)
        place = np.maximum(
            np.abs(self._points).max(axis=1), np.abs(position[self._bodies]).max(axis=1))
        jump = anchors.extension - anchors.compression
        here = find_kinks(length, anchors.natural_length, place, lever, jump != 0.0)
        stretch = here.stretch
        tension = np.where(stretch > 0.0, anchors.extension, anchors.compression) * stretch
        with np.errstate(invalid='ignore', divide='ignore'):
            force = np.where(length[:, None] > 0.0, reach * (tension / length)[:, None], 0.0)
        np.add.at(wrench, self._bodies, np.hstack([force, np.cross(arm, force)]))
        return AnchorState(float(0.5 * (tension * stretch).sum()), wrench, tension, jump, here)

    def slope(self, state: 'AnchorState', side: str) -> np.ndarray:
        """Return tangent stiffnesses [N/m], (a,), with the `side` of anchors at their kink."""
        anchors, here = self._anchors, state.here
        return np.zeros(0) if anchors is None else slopes_on(
            side, anchors.extension, anchors.compression, here.stretch, here.at_kink, here.rounded)

    def blocks(
        self, state: 'AnchorState', position: np.ndarray, axes: np.ndarray, slope: np.ndarray
    ) -> list[tuple[int, np.ndarray]]:
        """Return second derivatives (6, 6) by body, from tangent stiffnesses [N/m], (a,)."""
        anchors, here = self._anchors, state.here
        if anchors is None:
            return []
        stiffness, rest = as_springs(
            np.where(here.rounded, 0.0, state.tension), slope, here.length)
        laws = anchors._replace(
            extension=stiffness, compression=stiffness, natural_length=rest)
        return [
            (body, stiffness_of(laws, a, position[body], axes[body], self._time))
            for a, body in enumerate(self._bodies.tolist())]


class AnchorState(NamedTuple):
    """Anchors in one configuration."""

    energy: float  # [J]
    wrench: np.ndarray  # (n, 6) on the bodies
    tension: np.ndarray  # (a,) [N]
    jump: np.ndarray  # (a,) k_e - k_c [N/m]
    here: Stretched
