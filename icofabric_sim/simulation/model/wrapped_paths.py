# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Paths of connectors over shells as straight segments, for drawings.

Unfolded into a plane, the path over the faces is a straight line from the attachment point (see
wrapping.py). The path crosses each edge where this line does.
"""

from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import inscribed_radius
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.kernels.obstruction import find_obstructed
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.packing import list_connectors
from icofabric_sim.simulation.model.shells import pack_shells
from icofabric_sim.simulation.model.wrapping import pack_wrapping, ways_from
from icofabric_sim.terms.shared import Connectors
from icofabric_sim.terms.wrapping.lengths import find_ways
from icofabric_sim.terms.wrapping.record import Wrapping
import numpy as np

# Rank of the second end, beyond the number of edges that a path crosses.
_SECOND_RANK = 100


class Segments(NamedTuple):
    """Straight segments of connectors, in order from the first body of each connector."""

    ends: np.ndarray  # (s, 2, 3) [m], world frame
    of: np.ndarray  # (s,) number of the connector

    def lengths(self, count: int) -> np.ndarray:
        """Return the total lengths [m] of `count` connectors, (c,)."""
        parts = np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1)
        return np.bincount(self.of, parts, count)


def straight_segments(ends: np.ndarray) -> Segments:
    """Return straight connectors between `ends` (c, 2, 3) [m] as one segment each."""
    return Segments(ends, np.arange(len(ends)))


def trace_scene(
    scene: Scene, ends: np.ndarray, position: np.ndarray, orientation: np.ndarray
) -> Segments:
    """Return the segments of a scene, by `trace_paths` if `connector.obstruction` is wrap."""
    half_edge = scene.geometry.half_edge
    wrapping = pack_wrapping(scene.parameters, half_edge)
    if wrapping is None or not len(ends):
        return straight_segments(ends)
    connectors = list_connectors(scene).listed
    found = np.zeros(len(ends), np.uint8)
    views = np.array(position), np.array(orientation)
    for view in views:
        # As the kernel was compiled for.
        view.flags.writeable = False
    find_obstructed(connectors, pack_shells(scene.parameters, half_edge), *views, found)
    return trace_paths(wrapping, connectors, ends, np.flatnonzero(found), position, orientation)


def trace_paths(
    wrapping: Wrapping, connectors: Connectors, ends: np.ndarray, entering: np.ndarray,
    position: np.ndarray, orientation: np.ndarray
) -> Segments:
    """
    Return the straight segments of all connectors, bent at the edges of shells under them.

    Parameters
    ----------
    wrapping : Wrapping
        All paths from the attachment points.
    connectors : Connectors
        Bodies and edges of the connectors.
    ends : ndarray
        (c, 2, 3) attachment points [m], world frame.
    entering : ndarray
        Numbers of the connectors that would enter a shell if they were straight.
    position, orientation : ndarray
        (n, 3) [m] and (n, 4) unit quaternions x y z w of the bodies.

    Returns
    -------
    Segments
        One segment of each straight connector, several of each one wrapped over a shell. Ends
        without a path lead straight through the shell.
    """
    if not len(entering):
        return straight_segments(ends)
    ways, places = np.zeros((len(entering), 2), np.int64), np.zeros((len(entering), 2))
    find_ways(
        wrapping, connectors, np.ascontiguousarray(position.T),
        np.ascontiguousarray(orientation.T), entering, ways, places)
    every = np.arange(len(ends))
    points, of = [ends[:, 0], ends[:, 1]], [every, every]
    ranks = [np.zeros(len(ends), int), np.full(len(ends), _SECOND_RANK)]
    sides = ((connectors.first, connectors.first_edge, 0, 1),
             (connectors.second, connectors.second_edge, _SECOND_RANK, -1))
    for side, (bodies, edges, start, sign) in enumerate(sides):
        codes, way = edges[entering], ways[:, side]
        for code, number in np.unique(np.stack([codes, way], axis=1), axis=0).tolist():
            if number < 0:
                continue
            chosen = (codes == code) & (way == number)
            numbers = entering[chosen]
            body = bodies[numbers]
            axes = cosines_from_quaternions(orientation[body])
            crossed = _crossings(wrapping, code, number, places[chosen, side])
            for rank, arms in enumerate(crossed, start=1):
                points.append(position[body] + np.einsum('wi,wij->wj', arms, axes))
                of.append(numbers)
                ranks.append(np.full(len(numbers), start + sign * rank))
    whose = np.concatenate(of)
    order = np.lexsort((np.concatenate(ranks), whose))
    line, whose = np.concatenate(points)[order], whose[order]
    joined = whose[1:] == whose[:-1]
    return Segments(np.stack([line[:-1], line[1:]], axis=1)[joined], whose[:-1][joined])


def _crossings(
    wrapping: Wrapping, code: int, number: int, places: np.ndarray
) -> list[np.ndarray]:
    """Return points (w, 3) [m], body axes, at each edge of a path that leaves at `places`."""
    half_edge = wrapping.height / inscribed_radius(1.0)
    crossed = ways_from(*(wrapping.points[code] / half_edge).tolist()).rows[number].crossed
    last = crossed[-1]
    target = last.begin + (places / half_edge)[:, None] * last.along
    found = []
    for each in crossed:
        t = -_cross(target, each.begin) / _cross(target, each.along)
        begin, end = wrapping.corners[each.corner], wrapping.corners[each.end]
        found.append(begin + 0.5 * t[:, None] * (end - begin))
    return found


def _cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])
