# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Paths of connectors over the faces of the shells that they are attached to.

A taut connector crosses a row of edges and leaves the shell at the last one. Unfold the faces that
it passes into a plane, and turn the free remainder about the last edge into the same plane. The
connector is then one straight line (Sharir and Schorr 1986, SIAM J. Comput. 15, 193). So each row
of edges is a few constants: the position of the attachment point relative to the last edge, and
the interval of that edge where the line crosses all other edges between their ends. See
terms/wrapping/path.py.

An attachment point sees the faces that it lies on or over. Its connector reaches the other faces
of the shell over the edges around the seen faces: from a point on the shell along a face, from a
point outside along the plane of point and edge. These planes and the unseen faces bound the convex
hull of shell and point.
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
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.scene.attachments import attachment_points
from icofabric_sim.simulation.model.shells import pack_shells
from icofabric_sim.terms.wrapping.record import Wrapping
import numpy as np

# No geodesic to a point outside crosses more edges (tested), from any point on a shell or outside,
# and from the midpoint of an edge.
MOST_EDGES, FROM_MIDPOINTS = 6, 5
# Smallest visible length of the last edge, over a, and smallest visible angle [rad].
_MIN_VISIBLE_RATIO = 1e-9
# Largest distance of a point on a face, over the inscribed radius.
_FACE_DISTANCE_RATIO = 1e-9
_FACE_COUNT = len(FACES)
# Height of a plane that no point lies over, in units of a.
_UNREACHED_HEIGHT = 1e150

_Pair = tuple[int, int]
_Cone = tuple[np.ndarray, np.ndarray]


class Crossing(NamedTuple):
    """An edge that a path crosses, unfolded with the attachment point as origin."""

    corner: int  # vertex where the edge begins
    end: int  # vertex where the edge ends
    begin: np.ndarray  # (2,) position of the first vertex
    along: np.ndarray  # (2,) unit vector to the other vertex


class Way(NamedTuple):
    """A path over a row of edges, in units of a."""

    corner: int  # vertex where its last edge begins
    end: int  # vertex where the edge ends
    faces: _Pair  # planes before and after the last edge
    foot: float  # coordinate along the last edge closest to the attachment point
    away: float  # distance of this place from the attachment point, unfolded
    low: float  # interval of the last edge where the path crosses all edges
    high: float
    crossed: tuple[Crossing, ...]  # the whole row, the last edge at its end


class Ways(NamedTuple):
    """All paths over a shell from one attachment point, in units of a."""

    # (p, 4) outward unit normals and heights over the centre: the faces of the shell, then planes
    # through the point and an edge
    planes: np.ndarray
    start: tuple[int, ...]  # a connector to a point on or over one of these planes is straight
    rows: tuple[Way, ...]


@lru_cache(maxsize=64)
def ways_from(x: float, y: float, z: float) -> Ways:
    """Return all geodesics from an attachment point, over a, that can be the shortest."""
    point, corners = np.array([x, y, z]), vertices(1.0)
    distances = np.linalg.norm(edge_midpoints(1.0) - point, axis=1)
    is_midpoint = (distances < _FACE_DISTANCE_RATIO).any()
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
            outside = planes[face, :3] @ point - planes[face, 3]
            if outside > _FACE_DISTANCE_RATIO * planes[face, 3]:
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
    """Return the faces that a point, in units of a, lies on or over."""
    height = inscribed_radius(1.0)
    over = face_geometry(1.0).normals @ point - height
    return [int(face) for face in np.flatnonzero(over >= -_FACE_DISTANCE_RATIO * height)]


def _plane(*points: np.ndarray) -> np.ndarray:
    """
    Return the unit normal, away from the centre, and the height of a plane by three points, (4,).
    """
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    normal /= np.linalg.norm(normal)
    height = float(normal @ points[1])
    return np.append(normal, height) * (1.0 if height > 0.0 else -1.0)


def _go_on(
    on: int, following: int, edge: _Pair, ends: tuple[np.ndarray, np.ndarray], cone: _Cone,
    more: int, crossed: tuple[Crossing, ...], found: list[Way]
) -> None:
    """
    Add the paths that leave the plane `on` over an edge, and extend them over `more` edges.

    `ends` are the ends of the edge, unfolded, and `crossed` the edges crossed before. The
    attachment point is the origin. `cone` are two points that bound the visible sector, the right
    one first.
    """
    begin, end = ends
    # Seen from the origin, which lies to one side of every edge.
    right, left = _ordered(begin, end)
    right = right if _cross(cone[0], right) > 0.0 else cone[0]
    left = left if _cross(left, cone[1]) > 0.0 else cone[1]
    along = 0.5 * (end - begin)
    if not _cross(right, left) > _MIN_VISIBLE_RATIO * np.linalg.norm(right) * np.linalg.norm(left):
        return
    places = sorted(-_cross(point, begin) / _cross(point, along) for point in (right, left))
    low, high = max(places[0], 0.0), min(places[1], 2.0)
    if high - low < _MIN_VISIBLE_RATIO:
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
    """Return two points as seen from the origin, the right one first."""
    return (begin, end) if _cross(begin, end) > 0.0 else (end, begin)


def _cross(one: np.ndarray, other: np.ndarray) -> float:
    return float(one[0] * other[1] - one[1] * other[0])


def _third(face: int, edge: _Pair) -> int:
    return next(int(corner) for corner in FACES[face] if corner not in edge)


def _across(face: int, edge: _Pair) -> int:
    """Return the other face at an edge of `face`."""
    return next(
        number for number, corners in enumerate(FACES.tolist())
        if number != face and set(edge) <= set(corners))


def pack_wrapping(parameters: Parameters, half_edge: float) -> Wrapping | None:
    """
    Pack all geodesics from all attachment points; None if connectors do not wrap over shells.
    """
    if parameters['connector.obstruction'] != 'wrap':
        return None
    corners, points = vertices(half_edge), attachment_points(parameters, half_edge)
    table = [ways_from(*point) for point in (points / half_edge).tolist()]
    # One more plane, which no point lies over.
    plane_count = 1 + max(len(all_ways.planes) for all_ways in table)
    count = max(len(all_ways.rows) for all_ways in table)
    planes = np.zeros((6, plane_count, 4))
    planes[:, :, 3] = _UNREACHED_HEIGHT
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
