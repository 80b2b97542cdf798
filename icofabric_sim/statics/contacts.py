# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Contact at rest: the potential of docs/contact.md and its derivatives."""

from dataclasses import dataclass
from typing import NamedTuple

from icofabric_sim.simulation.contact.pair_forces import FIRST_TOUCH, PairForces
from icofabric_sim.simulation.contact.setup import ContactSetup
from icofabric_sim.simulation.reports.load_cells import ContactForces
from icofabric_sim.statics.contact_points import contact_points_from, ContactPoints
import numpy as np


@dataclass(frozen=True)
class StiffeningSettings:
    """Tunables of a search that stiffens contacts step by step."""

    start_overlap_ratio: float = 0.1  # overlap over a at which a search starts
    factor: float = 3.0  # between successive contact stiffnesses
    # Stages of softer contacts after a search has stalled: 3^6 times softer contacts are about as
    # soft as connectors.
    softer_stages: int = 6


_STIFFENING = StiffeningSettings()
# Largest intended overlap as a ratio to a; the automatic stiffness aims at half of it.
MAX_INTENDED_OVERLAP_RATIO = 0.01


class ContactState(NamedTuple):
    """Contacts in one configuration."""

    energy: float  # [J]
    wrench: np.ndarray  # (n, 6) forces [N] and torques about the centres [N m]
    pairs: np.ndarray  # (p, 2) bodies in contact
    planes: tuple[np.ndarray, ...]  # bodies in contact with each plane
    depth: float  # [m] largest overlap
    largest_force: float  # [N] of a contact
    stiffness: float  # [N/m] of all contacts


def margin_of(push: np.ndarray, friction: np.ndarray, coefficient: float) -> np.ndarray:
    """Return 1 - T / (mu N) for normal forces N and friction T [N]; NaN if N = 0."""
    limit = coefficient * push
    return 1.0 - np.divide(friction, limit, out=np.full_like(push, np.nan), where=limit > 0.0)


class StaticContacts:
    """Contacts between shells, and between shells and planes, of a scene at rest."""

    def __init__(self, setup: ContactSetup, body_count: int) -> None:
        """Prepare contacts; see simulation/contact/setup.py."""
        self._setup, self._count = setup, body_count
        self._forces = PairForces(setup)
        self._pairs: np.ndarray | None = None
        # Smooth second derivatives, for a search.
        self.smoothed = False

    @property
    def stiffness(self) -> float:
        """Stiffness in use [N/m]."""
        return self._forces.stiffness

    @stiffness.setter
    def stiffness(self, value: float) -> None:
        self._forces.stiffness = value

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the planes."""
        return self._setup.names

    def restrict(self, pairs: np.ndarray) -> None:
        """Restrict contacts to these pairs of shells (p, 2)."""
        self._pairs = np.asarray(pairs, np.int64)

    @property
    def whole(self) -> float:
        """Stiffness of the scene [N/m]."""
        return self._setup.stiffness

    def stages(self, force: float) -> list[float]:
        """
        Return rising stiffnesses [N/m], up to that of the scene.

        With the first one the `force` [N] causes a large overlap.
        """
        whole = self._setup.stiffness
        softest = min(force / (_STIFFENING.start_overlap_ratio * self._setup.half_edge), whole)
        if not softest > 0.0:
            return [whole]
        return self._rising_stages(
            int(np.ceil(np.log(whole / softest) / np.log(_STIFFENING.factor))))

    def softer_stages(self) -> list[float]:
        """Return rising stiffnesses [N/m] for a search near its end that stiff contacts stall."""
        return self._rising_stages(_STIFFENING.softer_stages)

    def _rising_stages(self, count: int) -> list[float]:
        whole = self._setup.stiffness
        return [*(whole / _STIFFENING.factor**k for k in range(count, 0, -1)), whole]

    def act(self, position: np.ndarray, axes: np.ndarray) -> ContactState:
        """Return the contacts at `position` (n, 3) and `axes` (n, 3, 3), body axes as rows."""
        near = self._candidate_pairs(position)
        planes = tuple(self._forces.near_planes(position))
        return self._evaluate(position, axes, near, planes)

    def forces(
        self, position: np.ndarray, axes: np.ndarray,
        friction: tuple[np.ndarray, np.ndarray, np.ndarray, float] | None
    ) -> ContactForces:
        """
        Return the wrenches in all contacts of shells and planes.

        Parameters
        ----------
        position, axes
            Centres (n, 3) [m] and body axes as rows (n, 3, 3), world frame.
        friction
            Bodies (p, 2), the second one -1 - k for plane k, wrenches (p, 12) on both, magnitudes
            (p,) [N], and the coefficient mu; None without friction.

        Returns
        -------
        ContactForces
            Normal force and friction of each pair, see docs/contact.md.

        """
        bodies, rows, points = [], [], []
        for number, (group, _) in enumerate(self._candidates(position)):
            touching, out = self._forces.met(
                position[group], axes[group], number - 1, self._forces.half_edges(group))
            group, out = group[touching], out[touching]
            points.append(out[:, 15:18] + position[group].mean(axis=1))
            bodies.append(group if number == 0 else np.column_stack(
                [group[:, 0], np.full(len(group), -number)]))
            rows.append(out)
        pairs, out = np.concatenate(bodies).astype(np.int32), np.concatenate(rows)
        first = self.stiffness * out[:, :6]
        second = np.hstack([-first[:, :3], self.stiffness * out[:, 6:9]])
        cones: tuple[np.ndarray, ...] = ()
        if friction is not None:
            in_friction, wrenches, sizes, coefficient = friction
            push, rubbed = np.linalg.norm(first[:, :3], axis=1), np.zeros(len(pairs))
            place = {pair: row for row, pair in enumerate(map(tuple, pairs.tolist()))}
            for pair, wrench, size in zip(map(tuple, in_friction.tolist()), wrenches, sizes):
                if pair in place:
                    first[place[pair]] += wrench[:6]
                    second[place[pair]] += wrench[6:]
                    rubbed[place[pair]] = size
            cones = push, rubbed, margin_of(push, rubbed, coefficient)
        return ContactForces(
            pairs, np.concatenate(points), first[:, :3], out[:, 11], self._setup.names, first,
            second, *cones)

    def contact_points(
        self, position: np.ndarray, axes: np.ndarray, reach: float = FIRST_TOUCH
    ) -> ContactPoints:
        """
        Return points, normals and normal forces of contacts, for friction.

        Includes pairs at first touch: those in contact if moved closer by `reach`, a ratio to a.
        """
        pairs, pushes, rows, middles = [], [], [], []
        for number, (group, toward) in enumerate(self._candidates(position)):
            places, turns = position[group], axes[group]
            edges = self._forces.half_edges(group)
            touching, out = self._forces.met(places, turns, number - 1, edges)
            push = self.stiffness * np.where(touching[:, None], out[:, :3], 0.0)
            # For pairs with a tiny gap: the contact that they would have.
            places[:, 0] += reach * self._setup.half_edge * toward
            nearly, near = self._forces.met(places, turns, number - 1, edges)
            out = np.where(touching[:, None], out, near)
            there = touching | nearly
            pairs.append(group[there] if number == 0 else np.column_stack(
                [group[there, 0], np.full(int(there.sum()), -number)]))
            pushes.append(push[there])
            rows.append(out[there])
            middles.append(position[group[there]].mean(axis=1))
        return contact_points_from(
            np.concatenate(pairs).astype(np.int64), np.concatenate(pushes), np.concatenate(rows),
            np.concatenate(middles))

    def _candidates(self, position: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """
        Return candidate pairs (m, 2), and directions (m, 3) from the first body to the second.

        The first entry is for pairs of shells, one more for each plane: a body and itself.
        """
        near = self._candidate_pairs(position)
        apart = position[near[:, 0]] - position[near[:, 1]]
        size = np.linalg.norm(apart, axis=1, keepdims=True)
        return [(near, -apart / np.where(size > 0.0, size, 1.0)), *(
            (np.repeat(bodies[:, None], 2, axis=1),
             np.broadcast_to(-plane[:3], (len(bodies), 3)))
            for plane, bodies in zip(self._setup.planes, self._forces.near_planes(position)))]

    def blocks(
        self, contacts: ContactState, position: np.ndarray, axes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return second derivatives of the contacts, see simulation/contact/pair_forces.py."""
        return self._forces.blocks(
            contacts.pairs, contacts.planes, position, axes, smoothed=self.smoothed)

    def close(
        self, position: np.ndarray, axes: np.ndarray, reach: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """
        Find pairs in contact or closer than `reach` [m].

        Returns bodies (p, 2) (a body and itself for planes), overlaps [m] (negative: gaps), first
        derivatives of the overlaps (2, p, 6), and the mask of pairs in contact.
        """
        near = self._candidate_pairs(position)
        groups = [near, *(
            np.repeat(bodies[:, None], 2, axis=1)
            for bodies in self._forces.near_planes(position))]
        found = []
        for number, group in enumerate(groups):
            which, depth, slopes, touching = self._forces.close(
                position[group], axes[group], number - 1, self._forces.half_edges(group), reach)
            found.append((group[which], depth, slopes, touching))
        pairs, depth, slopes, touching = (np.concatenate(parts) for parts in zip(*found))
        return pairs, depth, np.stack([slopes[:, :6], slopes[:, 6:]]), touching

    def first_touches(self, position: np.ndarray, axes: np.ndarray) -> int:
        """Count the pairs of shells, or shells and planes, at first touch."""
        first, count = FIRST_TOUCH * self._setup.half_edge, 0
        for number, (group, toward) in enumerate(self._candidates(position)):
            places, turns = position[group], axes[group]
            edges = self._forces.half_edges(group)
            open_yet = self._forces.wrenches(places, turns, number - 1, edges)[2] <= first
            places[:, 0] += first * toward
            touching = self._forces.wrenches(places, turns, number - 1, edges)[3]
            count += int(np.count_nonzero(open_yet & touching))
        return count

    def _candidate_pairs(self, position: np.ndarray) -> np.ndarray:
        return self._forces.near(position) if self._pairs is None else self._pairs

    def _evaluate(
        self, position: np.ndarray, axes: np.ndarray, pairs: np.ndarray,
        planes: tuple[np.ndarray, ...]
    ) -> ContactState:
        wrench, found = np.zeros((self._count, 6)), []
        energies, depths, forces = 0.0, [np.zeros(0)], [np.zeros((0, 3))]
        groups = [pairs, *(np.repeat(bodies[:, None], 2, axis=1) for bodies in planes)]
        for number, group in enumerate(groups):
            pushes, energy, depth, touching = self._forces.wrenches(
                position[group], axes[group], number - 1, self._forces.half_edges(group))
            group, pushes = group[touching], pushes[touching]
            np.add.at(wrench, group[:, 0], pushes[:, :6])
            if number == 0:
                np.add.at(wrench, group[:, 1], pushes[:, 6:])
            energies += float(energy.sum())
            depths.append(depth)
            forces.append(pushes[:, :3])
            found.append(group)
        sizes = np.linalg.norm(np.concatenate(forces), axis=1)
        return ContactState(
            energies, wrench, found[0], tuple(group[:, 0] for group in found[1:]),
            float(np.concatenate(depths).max(initial=0.0)), float(sizes.max(initial=0.0)),
            self.stiffness)
