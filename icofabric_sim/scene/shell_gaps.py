# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Gaps between shells by the separating-axis test: face normals and cross products of edges.

Half edges [m] are one number or an array (n,) over bodies. The code uses NumPy only, so nothing is
compiled. For overlapping shells the result is the overlap depth, the smallest displacement that
separates them. For separated shells it is a lower bound of their distance.
"""

from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import circumscribed_radius, EDGES, FACES, vertices
from icofabric_sim.geometry.rotations import cosines_from_quaternions
import numpy as np
from scipy.spatial import cKDTree

# Pairs per batch; each pair has 245 axes.
_BATCH_PAIRS = 2000


Edges = float | np.ndarray


class Contacts(NamedTuple):
    """Pairs of shells that overlap."""

    bodies: np.ndarray  # (m, 2)
    depth: np.ndarray  # (m,) [m] the smallest displacement that separates them
    point: np.ndarray  # (m, 3) [m] a point between their centres


def find_contacts(half_edge: Edges, position: np.ndarray, orientation: np.ndarray) -> Contacts:
    """Return the overlapping pairs of shells in one state, sorted by body numbers."""
    reach = 2.0 * circumscribed_radius(float(np.max(half_edge)))
    pairs = cKDTree(position).query_pairs(reach, output_type='ndarray').reshape(-1, 2)
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    gap = pair_gaps(half_edge, position, orientation, pairs)
    touching = gap < 0.0
    first, second = pairs[touching].T
    edges = np.broadcast_to(half_edge, len(position))
    part = (edges[first] / (edges[first] + edges[second]))[:, None]
    return Contacts(
        pairs[touching], -gap[touching],
        (1.0 - part) * position[first] + part * position[second])


def smallest_gap(
    half_edge: Edges, position: np.ndarray, orientation: np.ndarray
) -> tuple[float, tuple[int, int]] | None:
    """Return the smallest gap [m] of all pairs (negative: overlap) and its pair, or None."""
    if len(position) < 2:
        return None
    tree = cKDTree(position)
    nearest = float(tree.query(position, k=2)[0][:, 1].min())
    # The circumscribed and inscribed radii bound the distance of the centres of the nearest pair.
    margin = 2.0 * circumscribed_radius(1.0) * float(
        np.max(half_edge) - _RADIUS_RATIO * np.min(half_edge))
    pairs = tree.query_pairs(nearest + margin, output_type='ndarray').reshape(-1, 2)
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    gap = pair_gaps(half_edge, position, orientation, pairs)
    least = int(np.argmin(gap))
    return float(gap[least]), (int(pairs[least, 0]), int(pairs[least, 1]))


def pair_gaps(
    half_edge: Edges, position: np.ndarray, orientation: np.ndarray, pairs: np.ndarray
) -> np.ndarray:
    """Return the gaps [m] of pairs (m, 2) of shells, (m,); negative: overlap depth."""
    edges = np.broadcast_to(half_edge, len(position))
    return np.concatenate([np.zeros(0)] + [
        _gaps(edges, position, orientation, pairs[start:start + _BATCH_PAIRS])
        for start in range(0, len(pairs), _BATCH_PAIRS)])


def _gaps(
    half_edges: np.ndarray, position: np.ndarray, orientation: np.ndarray, pairs: np.ndarray
) -> np.ndarray:
    between = position[pairs[:, 1]] - position[pairs[:, 0]]
    cosines = [cosines_from_quaternions(orientation[side]) for side in pairs.T]
    # Shells are point-symmetric, so half of all directions suffice.
    first, second = (
        np.einsum('n,ka,nai->nki', half_edges[side], _HALF_CORNERS, turn)
        for side, turn in zip(pairs.T, cosines))
    axes = [np.einsum('ka,nai->nki', _NORMALS, turn) for turn in cosines]
    one, other = (np.einsum('ka,nai->nki', _EDGES, turn) for turn in cosines)
    cross = np.cross(one[:, :, None], other[:, None]).reshape(len(pairs), -1, 3)
    size = np.linalg.norm(cross, axis=2, keepdims=True)
    axes.append(np.divide(cross, size, out=np.zeros_like(cross), where=size > 1e-6))
    gap = np.full(len(pairs), -np.inf)
    for directions in axes:
        apart = np.abs(np.einsum('nki,ni->nk', directions, between))
        for points in (first, second):
            apart -= np.abs(np.einsum('nki,nvi->nkv', directions, points)).max(axis=2)
        valid = np.einsum('nki,nki->nk', directions, directions) > 0.5
        gap = np.maximum(gap, np.where(valid, apart, -np.inf).max(axis=1))
    return gap


def _drop_opposites(directions: np.ndarray) -> np.ndarray:
    """Return one of each pair of opposite directions."""
    kept: list[np.ndarray] = []
    for direction in directions:
        if all(np.abs(np.dot(direction, other)) < (1.0 - 1e-9) * np.dot(other, other)
               for other in kept):
            kept.append(direction)
    return np.array(kept)


def _unit(directions: np.ndarray) -> np.ndarray:
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


_CORNERS = vertices(1.0)
_HALF_CORNERS = _drop_opposites(_CORNERS)  # (6, 3)
_NORMALS = _drop_opposites(_unit(np.cross(
    _CORNERS[FACES[:, 1]] - _CORNERS[FACES[:, 0]],
    _CORNERS[FACES[:, 2]] - _CORNERS[FACES[:, 0]])))  # (10, 3)
_EDGES = _drop_opposites(_unit(_CORNERS[EDGES[:, 1]] - _CORNERS[EDGES[:, 0]]))  # (15, 3)
# Ratio of the inscribed to the circumscribed radius.
_RADIUS_RATIO = float(np.abs(_NORMALS @ _CORNERS[0]).max() / np.linalg.norm(_CORNERS[0]))
