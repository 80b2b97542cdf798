# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Contact of a configuration at rest: the potential of docs/contact.md, and how it changes."""

from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import circumscribed_radius
from icofabric_sim.geometry.rotations import turned_axes
from icofabric_sim.kernels.contact.many import touch_pairs, touch_planes
from icofabric_sim.kernels.contact.pair import contact_scratch, OUT_SIZE
from icofabric_sim.simulation.contact.setup import ContactSetup
from icofabric_sim.statics.meetings import Meetings, meetings_of
import numpy as np

# Pairs of shells; other groups are numbers of planes.
PAIRS = -1
# Overlap in parts of a with which a search begins, and how much stiffer contacts get at a time.
_DEEP, _STIFFER = 0.1, 3.0
# So many times softer is a search that does not come to an end: then contacts are about as soft
# as connectors.
_SOFTER = 6
# Step of the differences of forces, in parts of a and in rad, at most; and in parts of the
# overlap, so that what touches does so at all of them.
_STEP, _WITHIN = 1e-6, 0.1
# Overlap, or gap, below which shells are at their first touch, in parts of a.
_FIRST = 1e-9
# Deepest overlap, in parts of a, that contact is meant for; it chooses half of this.
MEANT = 0.01


class Contacts(NamedTuple):
    """What touches in a configuration."""

    energy: float  # [J]
    wrench: np.ndarray  # (n, 6) forces [N] and torques about the centres [N m]
    pairs: np.ndarray  # (p, 2) bodies that touch
    planes: tuple[np.ndarray, ...]  # bodies that touch each of the planes
    depth: float  # [m] the deepest overlap
    largest_force: float  # [N] of a contact
    stiffness: float  # [N/m] of all contacts
    # Of each plane the forces [N] and torques about the centres [N m] on these bodies, (m, 6).
    plane_wrenches: tuple[np.ndarray, ...]


class StaticContacts:
    """Shells and planes of a scene that push each other."""

    def __init__(self, setup: ContactSetup, body_count: int) -> None:
        """See simulation/contact/setup.py."""
        self._setup, self._count = setup, body_count
        self.stiffness = setup.stiffness  # K [N/m] in use
        self._scratch = contact_scratch()
        self._reach = 2.0 * circumscribed_radius(setup.half_edge)
        self._pairs: np.ndarray | None = None

    def restrict(self, pairs: np.ndarray) -> None:
        """Have only these pairs of shells (p, 2) count from now on."""
        self._pairs = np.asarray(pairs, np.int64)

    @property
    def whole(self) -> float:
        """Stiffness of the scene [N/m]."""
        return self._setup.stiffness

    def stages(self, force: float) -> list[float]:
        """
        Stiffnesses [N/m], rising to that of the scene, from one that lets a force overlap deeply.
        """
        whole = self._setup.stiffness
        softest = min(force / (_DEEP * self._setup.half_edge), whole)
        if not softest > 0.0:
            return [whole]
        return self._rising(int(np.ceil(np.log(whole / softest) / np.log(_STIFFER))))

    def softer(self) -> list[float]:
        """The same for a search that has come close, and is held up by stiff contacts."""
        return self._rising(_SOFTER)

    def _rising(self, count: int) -> list[float]:
        whole = self._setup.stiffness
        return [*(whole / _STIFFER**k for k in range(count, 0, -1)), whole]

    def act(self, position: np.ndarray, axes: np.ndarray) -> Contacts:
        """In a configuration: `position` (n, 3), `axes` (n, 3, 3) with body axes as rows."""
        near = self._near(position)
        planes = tuple(
            np.flatnonzero(position @ plane[:3] - plane[3] < 0.5 * self._reach)
            for plane in self._setup.planes)
        return self._push(position, axes, near, planes)

    def meetings(self, position: np.ndarray, axes: np.ndarray) -> Meetings:
        """What touches in a configuration, first touches included, and how; for friction."""
        pairs, pushes, rows, middles = [], [], [], []
        for number, (group, toward) in enumerate(self._candidates(position)):
            places, turns = position[group], axes[group]
            touching, out = self._met(places, turns, number - 1)
            push = self.stiffness * np.where(touching[:, None], out[:, :3], 0.0)
            # Where they are open by next to nothing, how they would meet.
            places[:, 0] += _FIRST * self._setup.half_edge * toward
            nearly, near = self._met(places, turns, number - 1)
            out = np.where(touching[:, None], out, near)
            there = touching | nearly
            pairs.append(group[there] if number == 0 else np.column_stack(
                [group[there, 0], np.full(int(there.sum()), -number)]))
            pushes.append(push[there])
            rows.append(out[there])
            middles.append(position[group[there]].mean(axis=1))
        return meetings_of(
            np.concatenate(pairs).astype(np.int64), np.concatenate(pushes), np.concatenate(rows),
            np.concatenate(middles))

    def _candidates(self, position: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """
        Pairs (m, 2) that are near, and directions (m, 3) in which the first nears the other.

        Of shells, and of shells and each plane: a body and itself.
        """
        near = self._near(position)
        apart = position[near[:, 0]] - position[near[:, 1]]
        size = np.linalg.norm(apart, axis=1, keepdims=True)
        found = [(near, -apart / np.where(size > 0.0, size, 1.0))]
        for plane in self._setup.planes:
            bodies = np.flatnonzero(position @ plane[:3] - plane[3] < 0.5 * self._reach)
            found.append((
                np.repeat(bodies[:, None], 2, axis=1),
                np.broadcast_to(-plane[:3], (len(bodies), 3))))
        return found

    def blocks(
        self, contacts: Contacts, position: np.ndarray, axes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """
        Second derivatives by pairs: rows of two bodies, (m, 2), and of 12 x 12 numbers.

        By differences of forces on what the first body does, from which those of the second
        follow. Where shells are at their first touch the push has a kink: it
        resists one way only, and is left out. A torque on a turned body is seen from other axes:
        half of its turn is taken out, so that the derivative is symmetric as that of the
        connectors is. A contact with a plane is a pair of a body and itself, with the first 6 x 6
        numbers.
        """
        groups: list[tuple[np.ndarray, int]] = [(contacts.pairs, PAIRS)]
        groups += [
            (np.repeat(bodies[:, None], 2, axis=1), number)
            for number, bodies in enumerate(contacts.planes)]
        bodies, blocks = [np.zeros((0, 2), np.int64)], [np.zeros((0, 12, 12))]
        for pairs, which in groups:
            here, _, depth, _ = self._wrenches(position[pairs], axes[pairs], which)
            deep = depth > _FIRST * self._setup.half_edge
            pairs, here, depth = pairs[deep], here[deep], depth[deep]
            if not len(pairs):
                continue
            part = np.zeros((len(pairs), 12, 12))
            places, turns = position[pairs], axes[pairs]
            # Of each pair, in parts of a and in rad.
            step = np.minimum(_STEP, _WITHIN * depth / self._setup.half_edge)[:, None]
            for k in range(6):
                sides = []
                for sign in (1.0, -1.0):
                    moved, turned = places.copy(), turns.copy()
                    if k < 3:
                        moved[:, 0, k] += sign * step[:, 0] * self._setup.half_edge
                    else:
                        rotation = np.zeros((len(pairs), 3))
                        rotation[:, k - 3] = sign * step[:, 0]
                        turned[:, 0] = turned_axes(rotation, turned[:, 0])
                    sides.append(self._wrenches(moved, turned, which)[0])
                part[:, :, k] = (sides[1] - sides[0]) / (
                    2.0 * step * (self._setup.half_edge if k < 3 else 1.0))
            if which == PAIRS:
                _follow_second(part, here, places[:, 1] - places[:, 0])
            freedoms = 12 if which == PAIRS else 6
            for freedom in range(freedoms):
                end, k = divmod(freedom, 6)
                if k >= 3:
                    part[:, 6 * end + 3:6 * end + 6, freedom] += 0.5 * np.cross(
                        np.eye(3)[k - 3], here[:, 6 * end + 3:6 * end + 6])
            # The plane feels the opposite, and stays where it is.
            part[:, freedoms:] = 0.0
            bodies.append(pairs)
            blocks.append(0.5 * (part + np.swapaxes(part, 1, 2)))
        return np.concatenate(bodies), np.concatenate(blocks)

    def first_touches(self, position: np.ndarray, axes: np.ndarray) -> int:
        """How many pairs of shells, or shells and planes, are at their first touch."""
        first, count = _FIRST * self._setup.half_edge, 0
        for number, (group, toward) in enumerate(self._candidates(position)):
            places, turns = position[group], axes[group]
            open_yet = self._wrenches(places, turns, number - 1)[2] <= first
            places[:, 0] += first * toward
            touching = self._wrenches(places, turns, number - 1)[3]
            count += int(np.count_nonzero(open_yet & touching))
        return count

    def _near(self, position: np.ndarray) -> np.ndarray:
        if self._pairs is not None:
            return self._pairs
        from scipy.spatial import cKDTree

        return np.asarray(
            cKDTree(position).query_pairs(self._reach, output_type='ndarray'), np.int64)

    def _push(
        self, position: np.ndarray, axes: np.ndarray, pairs: np.ndarray,
        planes: tuple[np.ndarray, ...]
    ) -> Contacts:
        wrench, found, pressed = np.zeros((self._count, 6)), [], []
        energies, depths, forces = 0.0, [np.zeros(0)], [np.zeros((0, 3))]
        groups = [pairs, *(np.repeat(bodies[:, None], 2, axis=1) for bodies in planes)]
        for number, group in enumerate(groups):
            pushes, energy, depth, touching = self._wrenches(
                position[group], axes[group], number - 1)
            group, pushes = group[touching], pushes[touching]
            np.add.at(wrench, group[:, 0], pushes[:, :6])
            if number == 0:
                np.add.at(wrench, group[:, 1], pushes[:, 6:])
            energies += float(energy.sum())
            depths.append(depth)
            forces.append(pushes[:, :3])
            found.append(group)
            pressed.append(pushes[:, :6])
        sizes = np.linalg.norm(np.concatenate(forces), axis=1)
        return Contacts(
            energies, wrench, found[0], tuple(group[:, 0] for group in found[1:]),
            float(np.concatenate(depths).max(initial=0.0)), float(sizes.max(initial=0.0)),
            self.stiffness, tuple(pressed[1:]))

    def _wrenches(
        self, places: np.ndarray, axes: np.ndarray, which: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """
        Wrenches on both (m, 12), energies [J], overlaps [m] and whether they touch, of pairs.

        `places` (m, 2, 3), `axes` (m, 2, 3, 3); `which`: PAIRS, or the number of a plane that
        pushes the first.
        """
        touching, out = self._met(places, axes, which)
        out[~touching] = 0.0
        wrenches = self.stiffness * np.hstack([out[:, :6], -out[:, :3], out[:, 6:9]])
        return wrenches, self.stiffness * out[:, 9], out[:, 11], touching

    def _met(
        self, places: np.ndarray, axes: np.ndarray, which: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Whether pairs touch, and what the kernels say of them for 1 N/m, (m, 20)."""
        setup, count = self._setup, len(places)
        # From body to world.
        turns = np.ascontiguousarray(np.swapaxes(axes, 2, 3))
        first, second = (np.ascontiguousarray(places[:, end]) for end in range(2))
        touching, out = np.zeros(count, bool), np.zeros((count, OUT_SIZE))
        if which == PAIRS:
            touch_pairs(
                setup.half_edge, first, np.ascontiguousarray(turns[:, 0]), second,
                np.ascontiguousarray(turns[:, 1]), self._scratch, touching, out)
        else:
            plane = setup.planes[which]
            touch_planes(
                setup.half_edge, np.ascontiguousarray(plane[:3]), float(plane[3]), first,
                np.ascontiguousarray(turns[:, 0]), self._scratch, touching, out)
        return touching, out


def _follow_second(part: np.ndarray, wrenches: np.ndarray, arm: np.ndarray) -> None:
    """
    Fill in what the second body of each pair does, (m, 12, 6 of 12), by what the first does.

    To move both changes nothing, and to turn both about the first turns the `wrenches` (m, 12) and
    moves the second by its `arm` (m, 3) from the first; `part` is of minus the wrenches.
    """
    part[:, :, 6:9] = -part[:, :, :3]
    for k, axis in enumerate(np.eye(3)):
        turned = np.cross(axis, wrenches.reshape(-1, 4, 3)).reshape(-1, 12)
        moved = np.einsum('mij,mj->mi', part[:, :, 6:9], np.cross(axis, arm))
        part[:, :, 9 + k] = -turned - part[:, :, 3 + k] - moved
