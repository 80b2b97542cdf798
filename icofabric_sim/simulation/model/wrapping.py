# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The ways that a connector can take over the faces of the shell it is attached to.

A taut band crosses a row of edges and leaves the shell at the last one. With the faces it passes
unfolded into a plane, and the free rest turned about the last edge into the same plane, it is one
straight line (Sharir and Schorr 1986, SIAM J. Comput. 15, 193). So each row of edges is a few
constants: where the attachment point comes to lie beside the last edge, and between which points
of that edge the line passes all edges within their ends. See kernels/wrap/path.py.

An attachment point sees the faces that it lies on or over; its connector comes to the shell's
other faces over the edges around these. From a point on the shell that leads along a face, from
one outside along the plane of the point and the edge: together with the unseen faces these planes
bound the convex hull of shell and point.
"""

from functools import lru_cache
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import (
    edge_midpoints,
    face_geometry,
    FACES,
    inscribed_radius,
    vertices,
)
from icofabric_sim.kernels.records import Wrapping
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.scene.attachments import attachment_points
from icofabric_sim.simulation.model.shells import pack_shells
import numpy as np

# No geodesic to a point outside crosses more edges (tested), from any point on a shell or outside,
# and from the midpoint of an edge.
MOST_EDGES, FROM_MIDPOINTS = 6, 5
# Ways that see less of their last edge, in parts of a, or that less of an angle, see nothing.
_NARROW = 1e-9
# A point this close to a face, in parts of the inscribed radius, lies on it.
_ON_FACE = 1e-9
_FACE_COUNT = len(FACES)
# No point is over a plane as far out as this, in units of a.
_NEVER = 1e150

_Pair = tuple[int, int]
_Cone = tuple[np.ndarray, np.ndarray]


class Crossing(NamedTuple):
    """An edge that a way crosses, and where it lies unfolded, the attachment point as origin."""

    corner: int  # vertex where the edge begins
    end: int  # and where it ends
    begin: np.ndarray  # (2,) place of the first one
    along: np.ndarray  # (2,) unit vector from there to the other one


class Way(NamedTuple):
    """A row of edges, in units of a."""

    corner: int  # vertex where its last edge begins
    end: int  # and where it ends
    faces: _Pair  # planes on which it comes to the last edge, and which it would pass next
    foot: float  # place along the last edge next to the attachment point
    away: float  # distance of that from it, all unfolded
    low: float  # between these places along the last edge it crosses all
    high: float
    crossed: tuple[Crossing, ...]  # the whole row, the last edge at its end


class Ways(NamedTuple):
    """All that a connector can do about a shell from one attachment point, in units of a."""

    # (p, 4) outward unit normals and heights over the centre: the faces of the shell, then planes
    # through the point and an edge
    planes: np.ndarray
    start: tuple[int, ...]  # a connector to a point on or over one of these planes is straight
    rows: tuple[Way, ...]


@lru_cache(maxsize=64)
def ways_from(x: float, y: float, z: float) -> Ways:
    """All geodesics from an attachment point, over a, that can be the shortest."""
    point, corners = np.array([x, y, z]), vertices(1.0)
    is_midpoint = (np.linalg.norm(edge_midpoints(1.0) - point, axis=1) < _ON_FACE).any()
    most = min(MOST_EDGES, FROM_MIDPOINTS) if is_midpoint else MOST_EDGES
    planes = np.column_stack([
        face_geometry(1.0).normals, np.full(_FACE_COUNT, inscribed_radius(1.0))])
    seen = _seen(point)
    start, found = list(seen), list[Way]()
    for face in seen:
        for side in range(3):
            edge = int(FACES[face][side]), int(FACES[face][(side + 1) % 3])
            following = _across(face, edge)
            if following in seen:
                continue
            begin, end = corners[edge[0]], corners[edge[1]]
            on = face
            if planes[face, :3] @ point - planes[face, 3] > _ON_FACE * planes[face, 3]:
                on = len(planes)
                start.append(on)
                planes = np.vstack([planes, _plane(point, begin, end)])
            along = 0.5 * (end - begin)
            place = float((begin - point) @ along)
            beside = float(np.linalg.norm(begin - point - place * along))
            ends = np.array([place, beside]), np.array([place + 2.0, beside])
            _go_on(on, following, edge, ends, _ordered(*ends), most - 1, (), found)
    return Ways(planes, tuple(start), tuple(found))


def _seen(point: np.ndarray) -> list[int]:
    """Faces that a point, in units of a, lies on or over."""
    height = inscribed_radius(1.0)
    over = face_geometry(1.0).normals @ point - height
    return [int(face) for face in np.flatnonzero(over >= -_ON_FACE * height)]


def _plane(*points: np.ndarray) -> np.ndarray:
    """Unit normal, away from the centre, and height of the plane through three points, (4,)."""
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    normal /= np.linalg.norm(normal)
    height = float(normal @ points[1])
    return np.append(normal, height) * (1.0 if height > 0.0 else -1.0)


def _go_on(
    on: int, following: int, edge: _Pair, ends: tuple[np.ndarray, np.ndarray], cone: _Cone,
    more: int, crossed: tuple[Crossing, ...], found: list[Way]
) -> None:
    """
    Leave the plane `on` over an edge with these ends, unfolded, and go on over `more` edges.

    It has `crossed` others before.

    The attachment point is the origin, and `cone` two points that bound what it sees, the first
    of them to the right.
    """
    begin, end = ends
    # Seen from the origin, which lies to one side of every edge.
    right, left = _ordered(begin, end)
    right = right if _cross(cone[0], right) > 0.0 else cone[0]
    left = left if _cross(left, cone[1]) > 0.0 else cone[1]
    along = 0.5 * (end - begin)
    if not _cross(right, left) > _NARROW * np.linalg.norm(right) * np.linalg.norm(left):
        return
    places = sorted(-_cross(point, begin) / _cross(point, along) for point in (right, left))
    low, high = max(places[0], 0.0), min(places[1], 2.0)
    if high - low < _NARROW:
        return
    crossed = (*crossed, Crossing(*edge, begin, along))
    found.append(Way(
        *edge, (on, following), float(-begin @ along), abs(_cross(begin, along)), low, high,
        crossed))
    if more:
        # The next face is an equilateral triangle, away from the origin.
        out = np.array([-along[1], along[0]])
        apex = 0.5 * (begin + end) + np.copysign(np.sqrt(3.0), out @ begin) * out
        corner = _third(following, edge)
        for side, place in zip(edge, ends):
            _go_on(
                following, _across(following, (side, corner)), (side, corner), (place, apex),
                (right, left), more - 1, crossed, found)


def _ordered(begin: np.ndarray, end: np.ndarray) -> _Cone:
    """Two points seen from the origin, the right one first."""
    return (begin, end) if _cross(begin, end) > 0.0 else (end, begin)


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
    corners, points = vertices(half_edge), attachment_points(parameters, half_edge)
    table = [ways_from(*point) for point in (points / half_edge).tolist()]
    # One plane more, which nothing is over.
    plane_count = 1 + max(len(all_ways.planes) for all_ways in table)
    count = max(len(all_ways.rows) for all_ways in table)
    planes = np.zeros((6, plane_count, 4))
    planes[:, :, 3] = _NEVER
    start = np.zeros((6, max(len(all_ways.start) for all_ways in table)), np.int32)
    # Rows that are not used: nothing lies between their ends, nor over their planes.
    ways, faces = np.zeros((6, count, 10)), np.full((6, count, 2), plane_count - 1, np.int32)
    ways[:, :, 8:] = half_edge, -half_edge
    for code, all_ways in enumerate(table):
        planes[code, :len(all_ways.planes)] = all_ways.planes
        start[code] = all_ways.start[0]
        start[code, :len(all_ways.start)] = all_ways.start
        for number, way in enumerate(all_ways.rows):
            begin, end = corners[way.corner], corners[way.end]
            ways[code, number, :3] = begin
            ways[code, number, 3:6] = (end - begin) / (2.0 * half_edge)
            ways[code, number, 6:] = half_edge * np.array(way[3:7])
            faces[code, number] = way.faces
    return Wrapping(
        normals=np.ascontiguousarray(planes[:, :, :3]), heights=half_edge * planes[:, :, 3],
        height=inscribed_radius(half_edge), corners=np.ascontiguousarray(corners),
        points=np.ascontiguousarray(points), shells=pack_shells(parameters, half_edge),
        start=start, ways=ways, faces=faces)
