# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Forces and their derivatives of many pairs in contact: shells with shells or planes.

Equilibrium solves and implicit steps need both in arbitrary configurations.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from icofabric_sim.geometry.icosahedron import circumscribed_radius, vertices
from icofabric_sim.geometry.rotations import rotate_axes
from icofabric_sim.simulation.contact.curvature import (
    BY_EDGES,
    BY_SURFACE,
    COUNT,
    curvature_room,
    pair_curvatures,
    SWEPT,
    VOLUME,
)
from icofabric_sim.simulation.contact.setup import ContactSetup
from icofabric_sim.terms.contacts.many import (
    separations_on,
    signed_distances,
    touch_pairs,
    touch_planes,
)
from icofabric_sim.terms.contacts.pair import contact_scratch, OUT_SIZE
import numpy as np

# Group of pairs of shells; other groups are numbers of planes.
PAIRS = -1
# Overlap or gap over a below which shells are at first contact.
FIRST_TOUCH = 1e-9


@dataclass(frozen=True)
class ContactDifferenceSettings:
    """Tunables of differences of contact forces, and of the contact of open pairs."""

    max_step: float = 1e-6  # over a and in rad
    # Largest step over the overlap, so that pairs remain in contact in all evaluations.
    max_step_ratio: float = 0.1
    probe_overlap_ratio: float = 1e-6  # overlap over a at which open pairs are evaluated


_SETTINGS = ContactDifferenceSettings()


class PairForces:
    """Contact forces between shells and planes of a scene, without damping and friction."""

    def __init__(self, setup: ContactSetup) -> None:
        """Use the contact constants of simulation/contact/setup.py."""
        self._setup = setup
        self.stiffness = setup.stiffness  # K [N/m] in use
        self._scratch, self._room = contact_scratch(), curvature_room()
        self._reach = 2.0 * circumscribed_radius(setup.largest)

    def near(self, position: np.ndarray) -> np.ndarray:
        """
        Return pairs (m, 2) of bodies at `position` (n, 3) whose circumscribed spheres overlap.
        """
        from scipy.spatial import cKDTree

        return np.asarray(
            cKDTree(position).query_pairs(self._reach, output_type='ndarray'), np.int64)

    def half_edges(self, bodies: np.ndarray) -> np.ndarray:
        """Return the half edges [m] of bodies, in the shape of their numbers."""
        return self._setup.edges(bodies)

    def near_planes(self, position: np.ndarray) -> list[np.ndarray]:
        """Return the bodies whose circumscribed spheres overlap each plane."""
        return [
            np.flatnonzero(position @ plane[:3] - plane[3] < 0.5 * self._reach)
            for plane in self._setup.planes]

    def blocks(
        self, pairs: np.ndarray, planes: Sequence[np.ndarray], position: np.ndarray,
        axes: np.ndarray, *, smoothed: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """
        Return pairs in contact (m, 2) and their second derivatives (m, 12, 12).

        Candidates are `pairs` (p, 2) and, for each of the `planes`, the bodies near the plane, at
        `position` (n, 3) with `axes` (n, 3, 3), body axes as rows.

        The mixed derivative by the motion of both bodies has a closed form (curvature.py), from
        which the rest follows. At first contact the force has a kink: the contact resists in one
        direction only and is left out. The axes of a torque turn with the body. Half of this
        rotation is removed, so that the derivative is symmetric like that of the connectors. A
        contact with a plane is a pair of a body with itself and uses the first 6 x 6 values.
        `smoothed` selects differences over 1e-6 of a and rad, which include a change of the
        corners of the overlap just beyond the configuration.
        """
        groups: list[tuple[np.ndarray, int]] = [(pairs, PAIRS)]
        groups += [
            (np.repeat(near[:, None], 2, axis=1), number) for number, near in enumerate(planes)]
        bodies, blocks = [np.zeros((0, 2), np.int64)], [np.zeros((0, 12, 12))]
        for pairs, which in groups:
            edges = self.half_edges(pairs)
            touching, out = self.met(position[pairs], axes[pairs], which, edges)
            deep = touching & (out[:, 11] > FIRST_TOUCH * self._setup.half_edge)
            pairs, out, edges = pairs[deep], out[deep], edges[deep]
            if not len(pairs):
                continue
            part = (self._smoothed if smoothed else self._curvatures)(
                position[pairs], axes[pairs], which, edges, out)
            freedoms = 12 if which == PAIRS else 6
            # A plane does not move.
            part[:, freedoms:] = part[:, :, freedoms:] = 0.0
            bodies.append(pairs)
            blocks.append(0.5 * (part + np.swapaxes(part, 1, 2)))
        return np.concatenate(bodies), np.concatenate(blocks)

    def _curvatures(
        self, places: np.ndarray, axes: np.ndarray, which: int, edges: np.ndarray,
        out: np.ndarray
    ) -> np.ndarray:
        """
        Return second derivatives (m, 12, 12) of the energy of contacts, from `out` of `met`.

        They include the motion of a plane about the contact point.
        """
        setup, delta = self._setup, out[:, 10, None, None]
        point = np.ascontiguousarray(places.mean(axis=1) + out[:, 15:18])
        second = np.ascontiguousarray(places[:, 1] if which == PAIRS else point)
        turns = np.ascontiguousarray(np.swapaxes(axes, 2, 3))
        found = np.empty((len(places), COUNT))
        plane = np.zeros(4) if which == PAIRS else np.asarray(setup.planes[which], float)
        pair_curvatures(
            edges, np.ascontiguousarray(places[:, 0]), np.ascontiguousarray(turns[:, 0]), second,
            np.ascontiguousarray(turns[:, 1]), point, np.ascontiguousarray(plane[:3]),
            float(plane[3]), self._room, found)
        arm = second - places[:, 0]
        wrenches = np.hstack([
            out[:, :6], -out[:, :3], np.cross(arm, out[:, :3]) - out[:, 3:6]])
        # Derivatives of delta = 4 M_1 / M_0 by the motions of both bodies.
        slope = -wrenches[:, :, None] / delta
        swept = found[:, SWEPT:BY_EDGES, None]
        mixed = [
            one[:, :6] * np.swapaxes(other[:, 6:], 1, 2)
            for one, other in ((slope, slope), (slope, swept), (swept, slope))]
        edges, surface = (
            found[:, first:last].reshape(-1, 6, 6) for first, last in (
                (BY_EDGES, BY_SURFACE), (BY_SURFACE, COUNT)))
        across = mixed[0] + delta * (
            4.0 * surface - mixed[1] - mixed[2] - delta * edges) / found[:, VOLUME, None, None]
        return _completed(self.stiffness * across, self.stiffness * wrenches, arm)

    def _smoothed(
        self, places: np.ndarray, axes: np.ndarray, which: int, edges: np.ndarray,
        out: np.ndarray
    ) -> np.ndarray:
        """Return second derivatives by differences of forces over motions of the first body."""
        part, a = np.zeros((len(places), 12, 12)), self._setup.half_edge
        # Steps of each pair, over a and in rad.
        step = np.minimum(
            _SETTINGS.max_step, _SETTINGS.max_step_ratio * out[:, 11] / a)[:, None]
        for k in range(6):
            sides = []
            for sign in (1.0, -1.0):
                moved, turned = places.copy(), axes.copy()
                if k < 3:
                    moved[:, 0, k] += sign * step[:, 0] * a
                else:
                    rotation = np.zeros((len(places), 3))
                    rotation[:, k - 3] = sign * step[:, 0]
                    turned[:, 0] = rotate_axes(rotation, turned[:, 0])
                sides.append(self.wrenches(moved, turned, which, edges)[0])
            part[:, :, k] = (sides[1] - sides[0]) / (
                2.0 * step * (a if k < 3 else 1.0))
        here = self.stiffness * np.hstack([out[:, :6], -out[:, :3], out[:, 6:9]])
        if which == PAIRS:
            _follow_second(part, here, places[:, 1] - places[:, 0])
        return _with_half_turns(part, here)

    def wrenches(
        self, places: np.ndarray, axes: np.ndarray, which: int, edges: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """
        Return wrenches on pairs (m, 12), their energies [J], overlaps [m] and contact flags.

        `places` are (m, 2, 3), `axes` (m, 2, 3, 3). `which` is PAIRS, or the number of the plane
        in contact with the first body. `edges` are half edges [m] (m, 2); None selects that of the
        scene.
        """
        touching, out = self.met(places, axes, which, edges)
        out[~touching] = 0.0
        wrenches = self.stiffness * np.hstack([out[:, :6], -out[:, :3], out[:, 6:9]])
        return wrenches, self.stiffness * out[:, 9], out[:, 11], touching

    def close(
        self, places: np.ndarray, axes: np.ndarray, which: int, edges: np.ndarray, reach: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """
        Find pairs in contact or closer than `reach` [m], with their depths.

        `places` (m, 2, 3), `axes` (m, 2, 3, 3), `which` and `edges` are as in `wrenches`. Returns
        the numbers of the pairs (p,), depths delta [m], negative for open pairs, first derivatives
        (p, 12), and contact flags. Depths and derivatives of open pairs are those after the first
        body has moved to contact.
        """
        a = self._setup.half_edge
        touching, out = self.met(places, axes, which, edges)
        shift = np.zeros((len(places), 3))
        if which == PAIRS:
            gap, toward = self._distances(places, axes, edges, ~touching, reach)
        else:
            plane = self._setup.planes[which]
            corners = places[:, 0, None] + edges[:, :1, None] * (vertices(1.0) @ axes[:, 0])
            gap = (corners @ plane[:3]).min(axis=1) - plane[3]
            toward = np.broadcast_to(-plane[:3], shift.shape)
        open_yet = ~touching & (gap < reach)
        distance = gap + _SETTINGS.probe_overlap_ratio * a
        shift[open_yet] = distance[open_yet, None] * toward[open_yet]
        moved = places.copy()
        moved[:, 0] += shift
        met, there = self.met(moved[open_yet], axes[open_yet], which, edges[open_yet])
        out[open_yet] = there
        known = touching.copy()
        known[open_yet] = met
        depth = out[known, 10]
        slopes = np.hstack([-out[known, :6], out[known, :3], -out[known, 6:9]]) / depth[:, None]
        if which != PAIRS:
            slopes[:, 6:] = 0.0
        depth = depth - (slopes[:, :3] * shift[known]).sum(axis=1)
        return np.flatnonzero(known), depth, slopes, touching[known]

    def _distances(
        self, places: np.ndarray, axes: np.ndarray, edges: np.ndarray, chosen: np.ndarray,
        reach: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """
        Return distances [m] of `chosen` pairs, infinite above `reach`, and directions (m, 3).
        """
        turns = np.ascontiguousarray(np.swapaxes(axes, 2, 3))
        ends = [np.ascontiguousarray(part) for part in (
            places[:, 0], turns[:, 0], places[:, 1], turns[:, 1])]
        apart = places[:, 1] - places[:, 0]
        axis = apart / np.linalg.norm(apart, axis=1, keepdims=True)
        gap, distance = np.zeros(len(places)), np.full(len(places), np.inf)
        separations_on(edges, *ends, axis, gap)
        # `gap` is a lower bound of the distance.
        few = np.flatnonzero(chosen & (gap < reach))
        found, toward = np.zeros(len(few)), np.zeros((len(few), 3))
        signed_distances(
            edges[few], *(np.ascontiguousarray(end[few]) for end in ends), found, toward)
        distance[few], axis[few] = found, toward
        return distance, axis

    def met(
        self, places: np.ndarray, axes: np.ndarray, which: int, edges: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return contact flags of pairs, and the results of kernels for 1 N/m, (m, 20)."""
        setup, count = self._setup, len(places)
        if edges is None:
            edges = np.full((count, 2), setup.half_edge)
        # From body to world axes.
        turns = np.ascontiguousarray(np.swapaxes(axes, 2, 3))
        first, second = (np.ascontiguousarray(places[:, end]) for end in range(2))
        touching, out = np.zeros(count, bool), np.zeros((count, OUT_SIZE))
        if which == PAIRS:
            touch_pairs(
                edges, first, np.ascontiguousarray(turns[:, 0]), second,
                np.ascontiguousarray(turns[:, 1]), self._scratch, touching, out)
        else:
            plane = setup.planes[which]
            touch_planes(
                edges, np.ascontiguousarray(plane[:3]), float(plane[3]), first,
                np.ascontiguousarray(turns[:, 0]), self._scratch, touching, out)
        return touching, out


def _completed(across: np.ndarray, wrenches: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """
    Return all second derivatives (m, 12, 12) from the mixed ones of both bodies (m, 6, 6).

    Forces do not change if both bodies move. If both rotate about the first, the `wrenches` (m,
    12) rotate and the second moves by its `arm` (m, 3) from the first.
    """
    part = np.zeros((len(across), 12, 12))
    part[:, :6, 6:], part[:, 6:, :6] = across, np.swapaxes(across, 1, 2)
    part[:, :6, :3], part[:, 6:, 6:9] = -part[:, :6, 6:9], -part[:, 6:, :3]
    for k, axis in enumerate(np.eye(3)):
        turned = np.cross(axis, wrenches.reshape(-1, 4, 3)).reshape(-1, 12)
        moved = np.einsum('mij,mj->mi', part[:, :, 6:9], np.cross(axis, arm))
        part[:, :6, 3 + k] = -(turned + moved)[:, :6] - part[:, :6, 9 + k]
        part[:, 6:, 9 + k] = -(turned + moved)[:, 6:] - part[:, 6:, 3 + k]
    return _with_half_turns(part, wrenches)


def _follow_second(part: np.ndarray, wrenches: np.ndarray, arm: np.ndarray) -> None:
    """
    Complete the derivatives (m, 12, 12) by motions of the second body from those of the first.
    """
    part[:, :, 6:9] = -part[:, :, :3]
    for k, axis in enumerate(np.eye(3)):
        turned = np.cross(axis, wrenches.reshape(-1, 4, 3)).reshape(-1, 12)
        moved = np.einsum('mij,mj->mi', part[:, :, 6:9], np.cross(axis, arm))
        part[:, :, 9 + k] = -turned - part[:, :, 3 + k] - moved


def _with_half_turns(part: np.ndarray, wrenches: np.ndarray) -> np.ndarray:
    """Return derivatives (m, 12, 12) of torques relative to axes that rotate half as far."""
    for freedom in range(12):
        end, k = divmod(freedom, 6)
        if k >= 3:
            part[:, 6 * end + 3:6 * end + 6, freedom] += 0.5 * np.cross(
                np.eye(3)[k - 3], wrenches[:, 6 * end + 3:6 * end + 6])
    return part
