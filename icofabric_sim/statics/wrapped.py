# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Connectors wrapped over shells: first and second derivatives of their lengths.

Over a given sequence of edges the length is F(q, y), where q are the poses and y the positions
along the last edges, at which the connector leaves its shells; y minimises F. By the implicit
function theorem, its derivatives by the poses are L' = F_q and L'' = F_qq - F_qy F_yy^-1 F_yq. An
end without an edge (a straight connector) has no y.
"""

from typing import NamedTuple

from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.terms.shared import Connectors
from icofabric_sim.terms.wrapping.lengths import find_ways
from icofabric_sim.terms.wrapping.record import Wrapping
import numpy as np


class Wrapped(NamedTuple):
    """Wrapped connectors in one configuration."""

    of: np.ndarray  # (w,) their numbers
    ends: np.ndarray  # (w, 2, 3) [m] points where they leave the shells of both bodies, world
    # (w, 12, 12) second derivatives of their lengths by displacements [m] and rotation vectors
    # [rad] of the first body and of the second
    second: np.ndarray


def length_gradients(
    ends: np.ndarray, position: np.ndarray, direction: np.ndarray | None = None
) -> np.ndarray:
    """
    Return first derivatives (2, w, 6) of distances by motions of the bodies at either end.

    The `ends` (w, 2, 3) move with the bodies at `position` (w, 2, 3); all world [m]. With a
    `direction` (w, 3), the derivatives are those of the component of the distance along it.
    """
    if direction is None:
        direction = directions_of(ends)
    arms = ends - position
    return np.stack([
        sign * np.hstack([direction, np.cross(arms[:, end], direction)])
        for end, sign in ((0, -1.0), (1, 1.0))])


def directions_of(ends: np.ndarray) -> np.ndarray:
    """Return unit vectors (w, 3) from first to second `ends` (w, 2, 3); 0 if these coincide."""
    reach = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(reach, axis=1, keepdims=True)
    return np.divide(reach, length, out=np.zeros_like(reach), where=length > 0.0)


def find_wrapped(
    wrapping: Wrapping, connectors: Connectors, bodies: np.ndarray, entering: np.ndarray,
    position: np.ndarray, orientation: np.ndarray
) -> Wrapped:
    """
    Return the connectors that wrap, of those `entering` shells, by number.

    `bodies` (c, 2) are those of all connectors; `position` (n, 3), `orientation` (n, 4) x y z w.
    """
    ways, places = np.zeros((len(entering), 2), np.int64), np.zeros((len(entering), 2))
    find_ways(
        wrapping, connectors, np.ascontiguousarray(position.T),
        np.ascontiguousarray(orientation.T), entering, ways, places)
    around = (ways >= 0).any(axis=1)
    of, ways, places = entering[around], ways[around], places[around]
    edges = np.stack([connectors.first_edge[of], connectors.second_edge[of]], axis=1)
    joined = bodies[of]
    axes = cosines_from_quaternions(orientation[joined.ravel()]).reshape(*joined.shape, 3, 3)
    arms, along, bend = _leaving(wrapping, edges, ways, places)
    # From body axes, which are rows, to the world.
    arms, along = (np.einsum('weik,wei->wek', axes, part) for part in (arms, along))
    ends = position[joined] + arms
    return Wrapped(of, ends, second_derivatives(ends, arms, along, bend))


def _leaving(
    wrapping: Wrapping, edges: np.ndarray, ways: np.ndarray, places: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Return the arm [m] and edge direction of each end, (w, 2, 3), body axes, and its bend [1/m].

    The bend (w, 2) is the second derivative of the length on the shell by the position along the
    edge. Directions and bend are 0 at ends without an edge.
    """
    rows = wrapping.ways[edges, np.maximum(ways, 0)]
    there = ways >= 0
    along = np.where(there[..., None], rows[..., 3:6], 0.0)
    arms = np.where(
        there[..., None], rows[..., :3] + places[..., None] * rows[..., 3:6],
        wrapping.points[edges])
    wound = np.sqrt((places - rows[..., 6])**2 + rows[..., 7]**2)
    with np.errstate(divide='ignore', invalid='ignore'):
        bend = np.where(there, rows[..., 7]**2 / wound**3, 0.0)
    return arms, along, bend


def second_derivatives(
    ends: np.ndarray, arms: np.ndarray, along: np.ndarray, bend: np.ndarray
) -> np.ndarray:
    """
    Return second derivatives (w, 12, 12) of lengths; arguments as in `_leaving`, world frame.

    With n the direction and l the length of the free part, P = 1 - n n^T, s the arms and t the
    directions of the edges: F_qq is that of a straight connector, (J^T P J) / l plus the terms of
    rotated arms, and F_y of an end is the rate on the shell plus or minus n . t.
    """
    reach = ends[:, 1] - ends[:, 0]
    free = np.sqrt((reach * reach).sum(axis=1))[:, None, None]
    n = reach / free[:, :, 0]
    across = (np.eye(3) - n[:, :, None] * n[:, None, :]) / free
    count = len(ends)
    moves = np.zeros((count, 3, 12), ends.dtype)
    second = np.zeros((count, 12, 12), ends.dtype)
    mixed, give = np.zeros((count, 2, 12), ends.dtype), np.zeros((count, 2, 2), ends.dtype)
    for end, sign in ((0, -1.0), (1, 1.0)):
        own, s, t = slice(6 * end, 6 * end + 3), arms[:, end], along[:, end]
        turn = slice(6 * end + 3, 6 * end + 6)
        moves[:, :, own] = sign * np.eye(3)
        moves[:, :, turn] = sign * _turned(s)
        product = n[:, :, None] * s[:, None, :]
        second[:, turn, turn] = sign * (
            0.5 * (product + np.swapaxes(product, 1, 2))
            - (n * s).sum(axis=1)[:, None, None] * np.eye(3))
        mixed[:, end, turn] = sign * np.cross(t, n)
    second += np.einsum('wki,wkl,wlj->wij', moves, across, moves)
    shifts = along * np.array([-1.0, 1.0])[:, None]
    mixed += np.einsum('wek,wkl,wlj->wej', shifts, across, moves)
    give += np.einsum('wek,wkl,wfl->wef', shifts, across, shifts)
    for end in range(2):
        # An end without an edge has no position to minimise over.
        give[:, end, end] += np.where((along[:, end] != 0.0).any(axis=1), bend[:, end], 1.0)
    return np.asarray(second - np.einsum(
        'wei,wej->wij', mixed, np.linalg.solve(give, mixed)))


def _turned(arms: np.ndarray) -> np.ndarray:
    """Return matrices (w, 3, 3) from small rotation vectors to displacements of arms (w, 3)."""
    turned = np.zeros((len(arms), 3, 3), arms.dtype)
    turned[:, 0, 1], turned[:, 0, 2] = arms[:, 2], -arms[:, 1]
    turned[:, 1, 0], turned[:, 1, 2] = -arms[:, 2], arms[:, 0]
    turned[:, 2, 0], turned[:, 2, 1] = arms[:, 1], -arms[:, 0]
    return turned
