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
"""
The ways that a connector can take over the faces of the shell it is attached to.

A taut band crosses a row of edges and leaves the shell at the last one. With the faces it passes
unfolded into a plane, and the free rest turned about the last edge into the same plane, it is one
straight line (Sharir and Schorr 1986, SIAM J. Comput. 15, 193). So each row of edges is a few
constants: where the attachment point comes to lie beside the last edge, and between which points
of that edge the line passes all edges within their ends. See kernels/wrap/path.py.
"""

from functools import lru_cache
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import (
    face_geometry,
    FACES,
    inscribed_radius,
    midradius,
    NAMED_EDGE_FACES,
    NAMED_EDGE_VERTICES,
    vertices,
)
from icofabric_sim.kernels.records import Wrapping
from icofabric_sim.parameters.validation import Parameters
import numpy as np

# No geodesic from the midpoint of an edge to any point outside crosses more (tested).
MOST_EDGES = 5
# Ways that see less of their last edge, in parts of a, see nothing of it.
_NARROW = 1e-9

_Pair = tuple[int, int]


class Way(NamedTuple):
    """A row of edges, in units of a."""

    corner: int  # vertex where its last edge begins
    end: int  # and where it ends
    faces: _Pair  # on which it comes to the last edge, and which it would pass next
    foot: float  # place along the last edge next to the attachment point
    away: float  # distance of that from it, all unfolded
    low: float  # between these places along the last edge it crosses all
    high: float


@lru_cache(maxsize=6)
def ways_from(code: int) -> tuple[Way, ...]:
    """All geodesics from the midpoint of the named edge `code` over at most MOST_EDGES edges."""
    found: list[Way] = []
    first, second = (int(vertex) for vertex in NAMED_EDGE_VERTICES[code])
    for number in NAMED_EDGE_FACES[code]:
        face = int(number) - 1
        plane = {
            first: np.array([-1.0, 0.0]), second: np.array([1.0, 0.0]),
            _third(face, (first, second)): np.array([0.0, np.sqrt(3.0)])}
        cone = np.array([1.0, 0.0]), np.array([-1.0, 0.0])
        _unfold(face, (first, second), plane, cone, 1, found)
    return tuple(found)


def _unfold(
    face: int, entry: _Pair, plane: dict[int, np.ndarray], cone: tuple[np.ndarray, np.ndarray],
    depth: int, found: list[Way]
) -> None:
    """
    Go on from a `face` that was entered over an edge; its corners lie at `plane`.

    The attachment point is the origin, and `cone` two points that bound what it sees, the first
    of them to the right.
    """
    apex = _third(face, entry)
    for side in entry:
        begin, end = plane[side], plane[apex]
        # Seen from the origin, which lies to one side of every edge.
        right, left = (begin, end) if _cross(begin, end) > 0.0 else (end, begin)
        right = right if _cross(cone[0], right) > 0.0 else cone[0]
        left = left if _cross(left, cone[1]) > 0.0 else cone[1]
        along = 0.5 * (end - begin)
        if not _cross(right, left) > 0.0:
            continue
        places = sorted(-_cross(point, begin) / _cross(point, along) for point in (right, left))
        low, high = max(places[0], 0.0), min(places[1], 2.0)
        if high - low < _NARROW:
            continue
        following = _across(face, (side, apex))
        found.append(Way(
            side, apex, (face, following), float(-begin @ along), abs(_cross(begin, along)),
            low, high))
        if depth < MOST_EDGES:
            # The next corner is the mirror image of the one left behind.
            behind = next(corner for corner in entry if corner != side)
            offset = plane[behind] - begin
            mirrored = begin + 2.0 * float(offset @ along) * along - offset
            corners = {
                side: begin, apex: end, _third(following, (side, apex)): mirrored}
            _unfold(following, (side, apex), corners, (right, left), depth + 1, found)


def _cross(one: np.ndarray, other: np.ndarray) -> float:
    return float(one[0] * other[1] - one[1] * other[0])


def _third(face: int, edge: _Pair) -> int:
    return next(int(corner) for corner in FACES[face] if corner not in edge)


def _across(face: int, edge: _Pair) -> int:
    """The other face at an edge of `face`."""
    return next(
        number for number, corners in enumerate(FACES.tolist())
        if number != face and set(edge) <= set(corners))


def pack_wrapping(parameters: Parameters, half_edge: float) -> Wrapping | None:
    """All geodesics from all attachment points; None where connectors do not lie around shells."""
    if parameters['connector.obstruction'] != 'wrap':
        return None
    corners = vertices(half_edge)
    table = [ways_from(code) for code in range(6)]
    count = max(map(len, table))
    ways, faces = np.zeros((6, count, 10)), np.zeros((6, count, 2), np.int32)
    # Rows that are not used: nothing lies between their ends.
    ways[:, :, 8:] = half_edge, -half_edge
    for code, rows in enumerate(table):
        for number, way in enumerate(rows):
            begin, end = corners[way.corner], corners[way.end]
            ways[code, number, :3] = begin
            ways[code, number, 3:6] = (end - begin) / (2.0 * half_edge)
            ways[code, number, 6:] = half_edge * np.array(way[3:])
            faces[code, number] = way.faces
    return Wrapping(
        normals=np.ascontiguousarray(face_geometry(half_edge).normals),
        height=inscribed_radius(half_edge), corners=np.ascontiguousarray(corners),
        half_width=midradius(half_edge),
        start=(NAMED_EDGE_FACES - 1).astype(np.int32), ways=ways, faces=faces)
