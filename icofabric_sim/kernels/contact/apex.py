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
Overlaps with one apex: a vertex in a face, an edge across an edge, a vertex in a plane.

There the surface between the bodies (surface.py) consists of triangles that have one corner in
common, the point q where they would touch if they shrank about their centres, of depth P; the
others have depth 0. Then M_1 / M_0 = P / 4, so delta = P. P is the largest p such that a point is
p below all faces that take part: a linear program, so its derivatives are those of a force along
the normal n of the facet (axis.py) through q:

    delta = P = -rho gap / h,    grad delta by the place of B = -(rho / h) n

with the gap along n, less than 0, and h where it would be 0: the extent of both bodies along n.
So all that is left of the integrals is the contact point and the area.

Frame: axes of A, its centre at the origin, lengths over a.
"""

import math

from icofabric_sim.kernels.contact.axis import (
    cross,
    dot,
    FACE_OF_FIRST,
    FACE_OF_SECOND,
    turn_from,
    turn_to,
    within,
)
from icofabric_sim.kernels.contact.shape import (
    EDGE_FACES,
    EDGE_MIDDLES,
    EDGE_WAYS,
    farthest_vertex,
    INNER,
    NORMALS,
    OPPOSITE,
    RIDGES,
    SPOKE_COUNT,
    SPOKE_ROOM,
    SPOKES,
    VERTICES,
)
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    any_lane,
    fma,
    LANES,
    load_at,
    splat,
    sqrt,
    store_at,
)
import numpy as np

# In the room of a pair: of the triangles between spokes their areas, these times the sums of two
# corners, and areas as seen along an axis, SPOKE_ROOM each; three sides with what limits them.
_FAN, _RIDGES = 256, 296

Found = tuple[bool, float, float, float, float]


@compiled
def one_apex(
    room: np.ndarray, number: int, cx: float, cy: float, cz: float, nx: float, ny: float,
    nz: float, gap: float, x: float, y: float, z: float
) -> Found:
    """
    Whether the overlap of bodies has one apex; contact point (3) and squared area between them.

    `number`, unit normal (3), gap (below 0) and deepest point (3) of the facet, as of
    `find_facet`; c is the second centre.
    """
    if number < FACE_OF_FIRST:
        return edge_across_edge(room, number, cx, cy, cz, x, y, z)
    between = nx * cx + ny * cy + nz * cz
    out = between / (between - gap)
    face = number & 31
    if number >= FACE_OF_SECOND:
        # A vertex of A in a face of B.
        face = OPPOSITE[face]
        for k in range(3):
            put_ridge(room, k, turn_to(
                room, RIDGES[face, k, 0], RIDGES[face, k, 1], RIDGES[face, k, 2]), (cx, cy, cz))
        vertex = farthest_vertex(nx, ny, nz)
        return cone(room, vertex, nx, ny, nz, -gap, out, 3)
    # The other way round, in the axes of B with its centre at the origin.
    ux, uy, uz = turn_from(room, -nx, -ny, -nz)
    bx, by, bz = turn_from(room, -cx, -cy, -cz)
    for k in range(3):
        put_ridge(room, k, turn_from(
            room, RIDGES[face, k, 0], RIDGES[face, k, 1], RIDGES[face, k, 2]), (bx, by, bz))
    vertex = farthest_vertex(ux, uy, uz)
    found, px, py, pz, square = cone(room, vertex, ux, uy, uz, -gap, out, 3)
    px, py, pz = turn_to(room, px, py, pz)
    return found, cx + px, cy + py, cz + pz, square


@compiled
def put_ridge(
    room: np.ndarray, k: int, ridge: tuple[float, float, float],
    centre: tuple[float, float, float]
) -> None:
    """Write a side of a pyramid about a centre; beyond it points have ridge . x > limit."""
    at = _RIDGES + 4 * k
    room[at], room[at + 1], room[at + 2] = ridge[0], ridge[1], ridge[2]
    room[at + 3] = dot(ridge, centre)


@compiled
def cone(
    room: np.ndarray, vertex: int, nx: float, ny: float, nz: float, height: float, out: float,
    sides: int
) -> Found:
    """
    The same for a vertex that is by `height` beyond a plane with the unit normal n.

    In the axes of its body; `out` times the vertex is the apex. So many sides of room[_RIDGES:]
    limit the plane.
    """
    vx, vy, vz = VERTICES[vertex, 0], VERTICES[vertex, 1], VERTICES[vertex, 2]
    qx, qy, qz = out * vx, out * vy, out * vz
    x, y, z = splat(vx), splat(vy), splat(vz)
    ax, ay, az = splat(nx), splat(ny), splat(nz)
    high, half, zero = splat(height), splat(0.5), splat(0.0)
    beside = False
    for k in range(0, SPOKE_ROOM, LANES):
        at = 6 * SPOKE_ROOM * vertex + k
        # Where edges from the vertex leave the other side: they are so much farther back.
        ux, uy, uz = (load_at(SPOKES, at), load_at(SPOKES, at + SPOKE_ROOM),
                      load_at(SPOKES, at + 2 * SPOKE_ROOM))
        back = zero - fma(ax, ux, fma(ay, uy, az * uz))
        beside |= any_lane(back < high)
        part = high / back
        ux, uy, uz = fma(part, ux, x), fma(part, uy, y), fma(part, uz, z)
        for side in range(sides):
            ridge = _RIDGES + 4 * side
            beside |= any_lane(fma(splat(room[ridge]), ux, fma(
                splat(room[ridge + 1]), uy, splat(room[ridge + 2]) * uz)) > splat(
                    room[ridge + 3]))
        # The same of the next edges.
        at += 3 * SPOKE_ROOM
        wx, wy, wz = (load_at(SPOKES, at), load_at(SPOKES, at + SPOKE_ROOM),
                      load_at(SPOKES, at + 2 * SPOKE_ROOM))
        part = high / (zero - fma(ax, wx, fma(ay, wy, az * wz)))
        wx, wy, wz = fma(part, wx, x), fma(part, wy, y), fma(part, wz, z)
        sx, sy, sz = ux + wx, uy + wy, uz + wz
        ux, uy, uz = ux - splat(qx), uy - splat(qy), uz - splat(qz)
        wx, wy, wz = wx - splat(qx), wy - splat(qy), wz - splat(qz)
        px, py, pz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
        area = half * sqrt(fma(px, px, fma(py, py, pz * pz)))
        store_at(room, _FAN + k, area)
        store_at(room, _FAN + SPOKE_ROOM + k, area * sx)
        store_at(room, _FAN + 2 * SPOKE_ROOM + k, area * sy)
        store_at(room, _FAN + 3 * SPOKE_ROOM + k, area * sz)
        store_at(room, _FAN + 4 * SPOKE_ROOM + k, half * fma(ax, px, fma(ay, py, az * pz)))
    if beside:
        return False, 0.0, 0.0, 0.0, 0.0
    total, tx, ty, tz, seen = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(_FAN, _FAN + SPOKE_COUNT):
        total += room[k]
        tx += room[k + SPOKE_ROOM]
        ty += room[k + 2 * SPOKE_ROOM]
        tz += room[k + 3 * SPOKE_ROOM]
        seen += room[k + 4 * SPOKE_ROOM]
    if not total > 0.0:
        return False, 0.0, 0.0, 0.0, 0.0
    scale = 0.25 / total
    return (True, 0.5 * qx + scale * tx, 0.5 * qy + scale * ty, 0.5 * qz + scale * tz,
            seen * seen)


@compiled
def edge_across_edge(
    room: np.ndarray, number: int, cx: float, cy: float, cz: float, x: float, y: float, z: float
) -> Found:
    """
    The same for two edges: the overlap is a tetrahedron.

    Its corners are where either edge goes through the two faces at the other, which is so if each
    is on the edge and in the face.
    """
    own, other = (number - 1) >> 5, (number - 1) & 31
    ex, ey, ez = EDGE_WAYS[own >> 1, 0], EDGE_WAYS[own >> 1, 1], EDGE_WAYS[own >> 1, 2]
    ax, ay, az = EDGE_MIDDLES[own, 0], EDGE_MIDDLES[own, 1], EDGE_MIDDLES[own, 2]
    fx, fy, fz = turn_to(
        room, EDGE_WAYS[other >> 1, 0], EDGE_WAYS[other >> 1, 1], EDGE_WAYS[other >> 1, 2])
    bx, by, bz = turn_to(
        room, EDGE_MIDDLES[other, 0], EDGE_MIDDLES[other, 1], EDGE_MIDDLES[other, 2])
    # The first edge and the faces of B, in its axes.
    mx, my, mz = turn_from(room, ax - cx, ay - cy, az - cz)
    wx, wy, wz = turn_from(room, ex, ey, ez)
    face, second = EDGE_FACES[other, 0], EDGE_FACES[other, 1]
    s0 = through(face, mx, my, mz, wx, wy, wz)
    s1 = through(second, mx, my, mz, wx, wy, wz)
    found = abs(s0) <= 1.0 and abs(s1) <= 1.0
    found &= within(face, mx + s0 * wx, my + s0 * wy, mz + s0 * wz, 0.0)
    found &= within(second, mx + s1 * wx, my + s1 * wy, mz + s1 * wz, 0.0)
    # The second edge and the faces of A.
    bx, by, bz = bx + cx, by + cy, bz + cz
    face, second = EDGE_FACES[own, 0], EDGE_FACES[own, 1]
    t0 = through(face, bx, by, bz, fx, fy, fz)
    t1 = through(second, bx, by, bz, fx, fy, fz)
    found &= abs(t0) <= 1.0 and abs(t1) <= 1.0
    b0 = bx + t0 * fx, by + t0 * fy, bz + t0 * fz
    b1 = bx + t1 * fx, by + t1 * fy, bz + t1 * fz
    found &= within(face, b0[0], b0[1], b0[2], 0.0)
    found &= within(second, b1[0], b1[1], b1[2], 0.0)
    if not found:
        return False, 0.0, 0.0, 0.0, 0.0
    a0 = ax + s0 * ex, ay + s0 * ey, az + s0 * ez
    a1 = ax + s1 * ex, ay + s1 * ey, az + s1 * ez
    u0, u1 = (a0[0] - x, a0[1] - y, a0[2] - z), (a1[0] - x, a1[1] - y, a1[2] - z)
    w0, w1 = (b0[0] - x, b0[1] - y, b0[2] - z), (b1[0] - x, b1[1] - y, b1[2] - z)
    # Twice the areas of the four triangles.
    t00, t01 = extent(cross(u0, w0)), extent(cross(u0, w1))
    t10, t11 = extent(cross(u1, w0)), extent(cross(u1, w1))
    total = t00 + t01 + (t10 + t11)
    if not total > 0.0:
        return False, 0.0, 0.0, 0.0, 0.0
    scale = 0.25 / total
    p0, p1, r0, r1 = t00 + t01, t10 + t11, t00 + t10, t01 + t11
    seen = cross((a1[0] - a0[0], a1[1] - a0[1], a1[2] - a0[2]),
                 (b1[0] - b0[0], b1[1] - b0[1], b1[2] - b0[2]))
    return (
        True,
        0.5 * x + scale * (p0 * a0[0] + p1 * a1[0] + (r0 * b0[0] + r1 * b1[0])),
        0.5 * y + scale * (p0 * a0[1] + p1 * a1[1] + (r0 * b0[1] + r1 * b1[1])),
        0.5 * z + scale * (p0 * a0[2] + p1 * a1[2] + (r0 * b0[2] + r1 * b1[2])),
        0.25 * dot(seen, seen))


@compiled
def through(
    face: int, x: float, y: float, z: float, ux: float, uy: float, uz: float
) -> float:
    """Where a line goes through the plane of a face, in body axes: how far along from x."""
    nx, ny, nz = NORMALS[face, 0], NORMALS[face, 1], NORMALS[face, 2]
    return (INNER - (nx * x + ny * y + nz * z)) / (nx * ux + ny * uy + nz * uz)


@compiled
def extent(vector: tuple[float, float, float]) -> float:
    """Length of a vector."""
    return math.sqrt(dot(vector, vector))
