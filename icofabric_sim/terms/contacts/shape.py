# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The icosahedron in units of contact: half edge 1, centre at the origin, body axes.

Contact computes with lengths over a, half the outer edge, so that results scale with size.
"""

import math

from icofabric_sim.geometry.icosahedron import (
    EDGES,
    face_geometry,
    FACES,
    inscribed_radius,
    TAU,
    vertices,
)
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fabs, fma, maximum, splat, Vector
import numpy as np

# Radii of the spheres inside and around.
INNER = inscribed_radius(1.0)
OUTER = math.sqrt(1.0 + TAU * TAU)
# Faces are numbered from 0, in the order of icosahedron.FACES.
CORNERS = vertices(1.0)[FACES]
NORMALS = np.array(face_geometry(1.0).normals)


def _neighbours() -> np.ndarray:
    """Return the face across the edge from corner k to corner k + 1 of each face, (20, 3)."""
    edges = [[frozenset((int(face[k]), int(face[(k + 1) % 3]))) for k in range(3)]
             for face in FACES]
    return np.array([
        [next(other for other in range(20) if other != own and edge in edges[other])
         for edge in edges[own]] for own in range(20)])


NEIGHBOURS = _neighbours()
# Where RIDGES[i, k] . x > 0 a point is beyond the side k of the pyramid of face i.
RIDGES = NORMALS[NEIGHBOURS] - NORMALS[:, None]
# One of each two opposite faces, padded with the first to whole vectors; and their normals'
# x, y and z one after the other.
AXIS_COUNT = 16
_HALF = [face for face in range(20) if tuple(NORMALS[face].round(9)) > (0.0, 0.0, 0.0)]
AXIS_FACES = np.array(_HALF + _HALF[:1] * (AXIS_COUNT - len(_HALF)))
AXES = np.ascontiguousarray(NORMALS[AXIS_FACES].T).ravel()
OPPOSITE = np.argmin(NORMALS @ NORMALS.T, axis=1)
# Unit vectors along the edges, one of each two parallel ones, and the same as whole vectors of
# x, y and z, filled up with 0.
EDGE_ENDS = np.ascontiguousarray(vertices(1.0)[EDGES])
_DIRECTIONS = (EDGE_ENDS[:, 1] - EDGE_ENDS[:, 0]) / 2.0
EDGE_WAYS = np.array([
    way for k, way in enumerate(_DIRECTIONS)
    if not any(abs(way @ other) > 0.999 for other in _DIRECTIONS[:k])])
WAY_COUNT = len(EDGE_WAYS)
WAY_ROWS = np.concatenate([EDGE_WAYS, np.zeros((AXIS_COUNT - WAY_COUNT, 3))]).T.ravel()
# Edges 2 k and 2 k + 1 lie along EDGE_WAYS[k], opposite each other: their middles, faces (30, 2),
# and a vector at right angles to both way and middle. Directions n from which an edge is farthest
# have |n . EDGE_SLOPES| < n . EDGE_MIDDLES.
_MIDDLES = EDGE_ENDS.mean(axis=1)
_FIRST = np.array([np.flatnonzero(np.abs(_DIRECTIONS @ way) > 0.999)[0] for way in EDGE_WAYS])
EDGE_MIDDLES = np.stack([_MIDDLES[_FIRST], -_MIDDLES[_FIRST]], axis=1).reshape(30, 3)
EDGE_FACES = np.argsort(-EDGE_MIDDLES @ NORMALS.T, axis=1, kind='stable')[:, :2].copy()
_ACROSS = NORMALS[EDGE_FACES[:, 0]] - NORMALS[EDGE_FACES[:, 1]]
EDGE_SLOPES = _ACROSS * (
    (NORMALS[EDGE_FACES[:, 0]] * EDGE_MIDDLES).sum(axis=1)
    / (NORMALS[EDGE_FACES[:, 0]] * _ACROSS).sum(axis=1))[:, None]
# Vertices in the order of `farthest_vertex`.
VERTICES = np.array([
    np.roll((0.0, one, other * TAU), turn) for turn in (0, 2, 1)
    for one, other in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))])
# Their x, y and z one after the other, filled up with 0; and those of each face.
VERTEX_ROOM = 16
VERTEX_ROWS = np.concatenate([VERTICES, np.zeros((VERTEX_ROOM - 12, 3))]).T.ravel()
FACE_VERTICES = ((CORNERS[:, :, None] - VERTICES) ** 2).sum(axis=3).argmin(axis=2)


def _spokes() -> np.ndarray:
    """
    Return edges from each vertex, in order around it, and again from the second on, (12, 6, 8).
    """
    spokes = np.zeros((12, 6, SPOKE_ROOM))
    for k, vertex in enumerate(VERTICES):
        others = [other for other in VERTICES if abs(np.linalg.norm(other - vertex) - 2.0) < 1e-9]
        first = others[0] - vertex
        side = np.cross(vertex, first)
        ways = sorted(
            (other - vertex for other in others), key=lambda way: math.atan2(
                way @ side / np.linalg.norm(side),
                way @ first / 2.0 - (way @ vertex) * (first @ vertex) / (2.0 * OUTER**2)))
        ways += (SPOKE_ROOM + 1 - len(ways)) * ways[:1]
        spokes[k] = np.concatenate([np.transpose(ways[:-1]), np.transpose(ways[1:])])
    return spokes


# Five edges meet at a vertex; filled up with the first to whole vectors.
SPOKE_COUNT, SPOKE_ROOM = 5, 8
SPOKES = _spokes().ravel()
# Numbers of these edges in EDGE_MIDDLES, (12, 5).
SPOKE_EDGES = np.array([[
    int(np.argmin(((EDGE_MIDDLES - vertex - 0.5 * way) ** 2).sum(axis=1)))
    for way in SPOKES.reshape(12, 6, SPOKE_ROOM)[k, :3, :SPOKE_COUNT].T]
    for k, vertex in enumerate(VERTICES)])


def _frames(first: np.ndarray, third: np.ndarray) -> np.ndarray:
    """
    Return right-handed frames as columns in body axes, (n, 9), with given first or third axes.
    """
    first = first - (first * third).sum(axis=1, keepdims=True) * third
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    columns = np.stack([first, np.cross(third, first), third], axis=2)
    return np.ascontiguousarray(columns.reshape(-1, 9))


def _unit(rows: np.ndarray) -> np.ndarray:
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


# Frames in which all edges look alike (along the edge, its middle, across), all vertices (towards
# the first edge from it, across, outwards) and all faces (towards the first neighbour, across,
# outwards). Components are equal for all features of a kind.
_SIDES = np.cross(EDGE_WAYS[np.arange(30) // 2], _unit(EDGE_MIDDLES))
EDGE_FRAMES = _frames(EDGE_WAYS[np.arange(30) // 2], _SIDES)
VERTEX_FRAMES = _frames(SPOKES.reshape(12, 6, SPOKE_ROOM)[:, :3, 0], _unit(VERTICES))
FACE_FRAMES = _frames(RIDGES[:, 0], NORMALS)
# Of an edge: distance of its middle; along and across of the normal of the face on its far side;
# size of EDGE_SLOPES; and of the two other sides of that face along (either sign), out, across.
MIDDLE = float(np.linalg.norm(EDGE_MIDDLES[0]))
_FAR_NORMAL = max(NORMALS[EDGE_FACES[0]] @ EDGE_FRAMES[0].reshape(3, 3), key=lambda n: n[2])
FACE_OUT, FACE_ACROSS = float(_FAR_NORMAL[1]), float(_FAR_NORMAL[2])
SLOPE = float(np.linalg.norm(EDGE_SLOPES[0]))
_FAR_SIDE = max(RIDGES[np.argmax(NORMALS @ EDGE_FRAMES[0].reshape(3, 3) @ _FAR_NORMAL)]
                @ EDGE_FRAMES[0].reshape(3, 3), key=lambda side: side[0])
SIDE_ALONG, SIDE_OUT, SIDE_ACROSS = (float(part) for part in _FAR_SIDE)
# Edges from a vertex, and sides of the pyramid of a face, in those frames.
OWN_SPOKES = SPOKES.reshape(12, 6, SPOKE_ROOM)[0, :3, :SPOKE_COUNT].T @ (
    VERTEX_FRAMES[0].reshape(3, 3))
OWN_RIDGES = RIDGES[0] @ FACE_FRAMES[0].reshape(3, 3)


@compiled
def reach(ux: float, uy: float, uz: float) -> float:
    """
    Return the largest scalar product of a direction in body axes with points of the icosahedron.

    Its vertices are the corners of three golden rectangles, (0, +-1, +-tau) and cyclic.
    """
    ax, ay, az = abs(ux), abs(uy), abs(uz)
    return max(ay + TAU * az, max(ax + TAU * ay, az + TAU * ax))


@compiled
def reach_lanes(ux: Vector, uy: Vector, uz: Vector) -> Vector:
    """Return the largest scalar products of several directions with points of the icosahedron."""
    tau = splat(TAU)
    ax, ay, az = fabs(ux), fabs(uy), fabs(uz)
    return maximum(fma(tau, az, ay), maximum(fma(tau, ay, ax), fma(tau, ax, az)))


@compiled
def farthest(ux: float, uy: float, uz: float) -> tuple[float, float, float]:
    """Return the vertex of the largest scalar product with a direction; one of them if tied."""
    ax, ay, az = abs(ux), abs(uy), abs(uz)
    first, second, third = ay + TAU * az, ax + TAU * ay, az + TAU * ax
    # Selections of numbers instead of branches, half of which would be mispredicted.
    one = first >= second and first >= third
    two = second >= third
    x = 0.0 if one else (1.0 if two else TAU)
    y = 1.0 if one else (TAU if two else 0.0)
    z = TAU if one else (0.0 if two else 1.0)
    return math.copysign(x, ux), math.copysign(y, uy), math.copysign(z, uz)


@compiled
def farthest_vertex(ux: float, uy: float, uz: float) -> int:
    """Return the number in VERTICES of the vertex that `farthest` returns."""
    ax, ay, az = abs(ux), abs(uy), abs(uz)
    first, second, third = ay + TAU * az, ax + TAU * ay, az + TAU * ax
    if first >= second and first >= third:
        rectangle, one, other = 0, uy, uz
    elif second >= third:
        rectangle, one, other = 4, ux, uy
    else:
        rectangle, one, other = 8, uz, ux
    rectangle += 2 if math.copysign(1.0, one) < 0.0 else 0
    return rectangle + (1 if math.copysign(1.0, other) < 0.0 else 0)


@compiled
def lead(ux: float, uy: float, uz: float) -> float:
    """Return how much farther along a direction the farthest vertex is than any other."""
    ax, ay, az = abs(ux), abs(uy), abs(uz)
    first, second, third = ay + TAU * az, ax + TAU * ay, az + TAU * ax
    if first >= second and first >= third:
        return min(first - max(second, third), 2.0 * ay)
    if second >= third:
        return min(second - max(first, third), 2.0 * ax)
    return min(third - max(first, second), 2.0 * az)


@compiled
def farthest_edge(ux: float, uy: float, uz: float) -> tuple[int, float]:
    """Return the number of the edge farthest along a direction, and the difference of its ends."""
    vertex, least, found = farthest_vertex(ux, uy, uz), math.inf, 0
    at = 6 * SPOKE_ROOM * vertex
    for k in range(SPOKE_COUNT):
        back = -(ux * SPOKES[at + k] + uy * SPOKES[at + SPOKE_ROOM + k]
                 + uz * SPOKES[at + 2 * SPOKE_ROOM + k])
        if back < least:
            least, found = back, k
    return int(SPOKE_EDGES[vertex, found]), least
