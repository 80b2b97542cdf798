# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Jumps of the lengths of connectors around shells that pass through each other.

The geodesic around two shells changes continuously with their poses while they do not overlap. If
they overlap, it may no longer be taut, and another geodesic, longer or shorter, replaces it: the
energy of the connector jumps with its length, whatever the step.
"""

from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import vertices
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.terms.contacts.many import signed_distances
import numpy as np

# Rounding of angles by an arc cosine near 1, or somewhat more [rad].
_ROUNDING = 1e-7


class Jump(NamedTuple):
    """A connector whose length jumped between two states."""

    connector: int
    bodies: tuple[int, int]
    before: float  # length [m]
    after: float  # [m]
    energy: float  # that it has more [J]
    depth: float  # least shift that parts the two shells after it [m]

    def __str__(self) -> str:
        """Return a sentence on the jump and its cause."""
        first, second = self.bodies
        return (
            f'the shells of bodies {first} and {second} pass through each other, by '
            f'{self.depth:.3g} m, and the shortest way of connector {self.connector} around them '
            f'jumps from {self.before:.6g} m to {self.after:.6g} m, which changes its energy by '
            f'{self.energy:.3g} J')


def jumps_between(
    packed: PackedScene, half_edge: float, before: State, after: State,
    broken_since: np.ndarray | None
) -> list[Jump]:
    """
    Return connectors around overlapping shells whose length jumped, the largest jump first.

    Shells have the `half_edge` [m]. `broken_since` (c,) [s] is NaN while unbroken; None: no
    connector is broken.
    """
    connectors = packed.connectors
    if connectors is None or packed.model.wrapping is None:
        return []
    one, two = (
        Snapshot(
            0.0, *packed.layout.unpack(state), len(connectors.first), packed, {}, broken_since)
        for state in (before, after))
    first, second = connectors.first, connectors.second
    change = np.abs(two.connector_length - one.connector_length)
    with np.errstate(all='ignore'):
        # Where a connector may leave its shell, or be attached to it.
        radius = np.linalg.norm(
            np.vstack([vertices(half_edge), packed.model.wrapping.points]), axis=1).max()
        most = _most(one, two, first, second, float(radius))
    which = np.flatnonzero(((one.obstructed > 0) | (two.obstructed > 0)) & (change > most))
    if not len(which):
        return []
    energy = two.spring_energy - one.spring_energy
    depths = depths_of(two, half_edge, first[which], second[which])
    jumps = [
        Jump(
            int(c), (int(first[c]), int(second[c])), float(one.connector_length[c]),
            float(two.connector_length[c]), float(energy[c]), float(depth))
        for c, depth in zip(which, depths) if depth > 0.0]
    return sorted(jumps, key=lambda jump: -abs(jump.energy))


def depths_of(
    snapshot: Snapshot, half_edge: float, first: np.ndarray, second: np.ndarray
) -> np.ndarray:
    """
    Return the overlaps [m] of the shells of bodies, (p,), or minus their distances.

    Shells have the `half_edge` [m]; bodies are `first` and `second`, (p,) each.
    """
    # Columns of these are the axes of a body.
    axes = cosines_from_quaternions(snapshot.orientation).transpose(0, 2, 1)
    ends = [
        np.ascontiguousarray(values[chosen]) for chosen in (first, second)
        for values in (snapshot.position, axes)]
    distance = np.zeros(len(first))
    signed_distances(
        np.full((len(first), 2), half_edge), *ends, distance, np.zeros((len(first), 3)))
    return -distance


def _most(
    one: Snapshot, two: Snapshot, first: np.ndarray, second: np.ndarray, radius: float
) -> np.ndarray:
    """
    Return the largest changes of lengths [m], (c,), by the motion of shells of `radius` [m].

    Connectors lead from the bodies `first` to the bodies `second`, (c,).
    """
    shift = two.position - one.position
    # The product of two unit quaternions is the cosine of half the angle between them.
    cosine = np.abs((one.orientation * two.orientation).sum(axis=1))
    angle = 2.0 * np.arccos(np.minimum(cosine, 1.0))
    moved = np.linalg.norm(shift[second] - shift[first], axis=1)
    return np.asarray(moved + radius * (angle[first] + angle[second] + _ROUNDING))
