# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Overlaps with one apex: a vertex in a face, an edge across an edge, a vertex in a plane.

Their surface between the bodies (surface.py) consists of triangles with one corner in common, the
point q where the bodies would touch if they shrank about their centres, of depth P; the other
corners have depth 0. Then M_1 / M_0 = P / 4, so delta = P. P is the largest p such that a point is
p below all faces that take part. P is a linear program, so its derivatives are those of a force
along the normal n of the facet (axis.py) through q:

    delta = P = -rho gap / h,    grad delta by the position of B = -(rho / h) n

with the gap along n, less than 0, and h the extent of both bodies along n, at which the gap would
be 0. The only integrals that remain are the contact point and the area.

Pairs of bodies are computed in lanes, one in each lane. Pairs of two edges and pairs of a vertex
and a face are computed separately, in frames of the features (shape.py), in which all edges, all
vertices and all faces look alike. The result of a pair depends on its own lane alone, so the bits
do not depend on the pairs in the other lanes.

Frame: axes of a feature of the first body, its centre at the origin, lengths over a.
"""

from typing import Any

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    any_lane,
    fabs,
    fma,
    LANES,
    load_at,
    maximum,
    splat,
    sqrt,
    store_at,
    Vector,
    where,
)
from icofabric_sim.terms.contacts.axis import (
    FACE_OF_FIRST,
    FACE_OF_SECOND,
    OVERLAPPING,
    SLANT,
    SLOPING,
    WITHIN,
)
from icofabric_sim.terms.contacts.gap import Axes
from icofabric_sim.terms.contacts.shape import (
    EDGE_FRAMES,
    FACE_ACROSS,
    FACE_FRAMES,
    FACE_OUT,
    INNER,
    MIDDLE,
    OPPOSITE,
    OUTER,
    OWN_RIDGES,
    OWN_SPOKES,
    reach_lanes,
    SIDE_ACROSS,
    SIDE_ALONG,
    SIDE_OUT,
    SLOPE,
    SPOKE_COUNT,
    SPOKE_ROOM,
    SPOKES,
    VERTEX_FRAMES,
    VERTICES,
)
import numpy as np

# Offset in the scratch array of a pair of the triangles between spokes: their areas, areas times
# the sums of two corners, and areas projected along an axis, SPOKE_ROOM each.
_FAN = 256
# Offsets of pairs in lanes: rows of LANES numbers. Input: the vector from the first centre to the
# second, matrices from body to world axes of both, frames of their features. Output: the first 19
# numbers of `out` of a pair (pair.py), the overlap along the line of centres, 1 if there is one
# apex, and 1 if a search would find no other facet.
CENTRE_VECTOR, OWN_AXES, OTHER_AXES, OWN_FRAME, OTHER_FRAME, ROW_COUNT = 0, 3, 12, 21, 30, 39
ALONG_CENTRES, FOUND, SURE = 19, 20, 21
# Added to numbers of facets (axis.py) with one apex; for those of a face once more for each number
# of the vertex in the face.
APEX_UNIT = 4096

Found = tuple[bool, float, float, float, float]
# Vectors of three and of nine rows.
Three = tuple[Any, Any, Any]
Nine = tuple[Any, Any, Any, Any, Any, Any, Any, Any, Any]


@compiled
def put_features(
    room: np.ndarray, at: int, lane: int, dx: float, dy: float, dz: float, first: Axes,
    second: Axes, number: int
) -> bool:
    """
    Write a pair into a lane; the first component of d, from the first body to the second, is >= 0.

    `number`: of the facet, with APEX_UNIT. Return True if the bodies are exchanged, so that the
    body with the vertex comes first.
    """
    facet = number % APEX_UNIT
    if facet < FACE_OF_FIRST:
        put_lane(room, at, lane, dx, dy, dz, first, second)
        put_frame(room, at + LANES * OWN_FRAME, lane, EDGE_FRAMES, (facet - 1) >> 5)
        put_frame(room, at + LANES * OTHER_FRAME, lane, EDGE_FRAMES, (facet - 1) & 31)
        return False
    exchanged, face = facet < FACE_OF_SECOND, facet & 31
    if exchanged:
        put_lane(room, at, lane, -dx, -dy, -dz, second, first)
    else:
        put_lane(room, at, lane, dx, dy, dz, first, second)
        # The facet is that of the sum: the face itself has the opposite normal.
        face = OPPOSITE[face]
    put_frame(room, at + LANES * OWN_FRAME, lane, VERTEX_FRAMES, number // APEX_UNIT - 1)
    put_frame(room, at + LANES * OTHER_FRAME, lane, FACE_FRAMES, face)
    return exchanged


@compiled
def put_lane(
    room: np.ndarray, at: int, lane: int, dx: float, dy: float, dz: float, own: Axes, other: Axes
) -> None:
    """Write the vector between the centres and the matrices of a pair."""
    to = at + lane
    room[to], room[to + LANES], room[to + 2 * LANES] = dx, dy, dz
    for row in range(3):
        for column in range(3):
            place = LANES * (3 * row + column)
            room[to + LANES * OWN_AXES + place] = own[3 * column + row]
            room[to + LANES * OTHER_AXES + place] = other[3 * column + row]


@compiled
def put_frame(room: np.ndarray, at: int, lane: int, frames: np.ndarray, k: int) -> None:
    """Write a frame of a feature."""
    for n in range(9):
        room[at + LANES * n + lane] = frames[k, n]


@compiled
def three_rows(room: np.ndarray, at: int) -> Three:
    """Load a vector."""
    return load_at(room, at), load_at(room, at + LANES), load_at(room, at + 2 * LANES)


@compiled
def nine_rows(room: np.ndarray, at: int) -> Nine:
    """Load a matrix, row by row."""
    return (load_at(room, at), load_at(room, at + LANES), load_at(room, at + 2 * LANES),
            load_at(room, at + 3 * LANES), load_at(room, at + 4 * LANES),
            load_at(room, at + 5 * LANES), load_at(room, at + 6 * LANES),
            load_at(room, at + 7 * LANES), load_at(room, at + 8 * LANES))


@compiled
def dot(one: Three, two: Three) -> Vector:
    """Return scalar products."""
    return fma(one[0], two[0], fma(one[1], two[1], one[2] * two[2]))


@compiled
def cross(one: Three, two: Three) -> Three:
    """Return cross products."""
    return (one[1] * two[2] - one[2] * two[1], one[2] * two[0] - one[0] * two[2],
            one[0] * two[1] - one[1] * two[0])


@compiled
def turned(matrix: Nine, x: Three) -> Three:
    """Return matrices times vectors."""
    return (
        fma(matrix[0], x[0], fma(matrix[1], x[1], matrix[2] * x[2])),
        fma(matrix[3], x[0], fma(matrix[4], x[1], matrix[5] * x[2])),
        fma(matrix[6], x[0], fma(matrix[7], x[1], matrix[8] * x[2])))


@compiled
def turned_back(matrix: Nine, x: Three) -> Three:
    """Return transposed matrices times vectors."""
    return (
        fma(matrix[0], x[0], fma(matrix[3], x[1], matrix[6] * x[2])),
        fma(matrix[1], x[0], fma(matrix[4], x[1], matrix[7] * x[2])),
        fma(matrix[2], x[0], fma(matrix[5], x[1], matrix[8] * x[2])))


@compiled
def product(one: Nine, two: Nine) -> Nine:
    """Return products of matrices."""
    x = turned(one, (two[0], two[3], two[6]))
    y = turned(one, (two[1], two[4], two[7]))
    z = turned(one, (two[2], two[5], two[8]))
    return x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]


@compiled
def transposed_product(one: Nine, two: Nine) -> Nine:
    """Return the transpose of one matrix times the other."""
    return product(
        (one[0], one[3], one[6], one[1], one[4], one[7], one[2], one[5], one[8]), two)


@compiled
def store_three(room: np.ndarray, at: int, x: Three) -> None:
    """Write a vector."""
    store_at(room, at, x[0])
    store_at(room, at + LANES, x[1])
    store_at(room, at + 2 * LANES, x[2])


@compiled
def put_results(
    room: np.ndarray, at: int, half_edge: float, own: Nine, other: Nine, frame: Nine, way: Three,
    n: Three, between: Vector, gap: Vector, apex: Three, point: Three, square: Vector
) -> None:
    """
    Write results of pairs with one apex: 19 numbers of `out`, and the overlap along the centres.

    `frame`: from the features' axes to the world's; normal n, apex and contact point (3) in the
    former, lengths over a; `between`: along n from centre to centre. `way` [m] in the world.
    """
    a, zero, half = splat(half_edge), splat(0.0), splat(0.5)
    part = splat(INNER) / (between - gap)
    delta = (zero - gap) * part * a
    size = zero - delta * part
    force = size * n[0], size * n[1], size * n[2]
    torque = turned(frame, cross((a * apex[0], a * apex[1], a * apex[2]), force))
    force = turned(frame, force)
    x = turned(frame, point)
    back = cross(way, force)
    store_three(room, at, force)
    store_three(room, at + 3 * LANES, torque)
    # Angular momentum is conserved.
    store_three(room, at + 6 * LANES, (
        back[0] - torque[0], back[1] - torque[1], back[2] - torque[2]))
    store_at(room, at + 9 * LANES, half * (delta * delta))
    store_at(room, at + 10 * LANES, delta)
    store_at(room, at + 11 * LANES, maximum((zero - gap) * a, zero))
    store_three(room, at + 12 * LANES, turned(frame, n))
    store_three(room, at + 15 * LANES, (
        a * x[0] - half * way[0], a * x[1] - half * way[1], a * x[2] - half * way[2]))
    store_at(room, at + 18 * LANES, (a * a) * (a * a) * square)
    length = sqrt(dot(way, way))
    u = way[0] / length, way[1] / length, way[2] / length
    first, second = turned_back(own, u), turned_back(other, u)
    store_at(room, at + ALONG_CENTRES * LANES, a * (
        reach_lanes(first[0], first[1], first[2])
        + reach_lanes(second[0], second[1], second[2])) - length)


@compiled
def edges_across(room: np.ndarray, at: int, half_edge: float) -> None:
    """
    Compute pairs of an edge across an edge, in lanes: the overlap is a tetrahedron.

    Its corners are the points where either edge crosses the two faces at the other, provided that
    each point is on the edge and in the face. See `put_features` for the input in `room`.
    """
    one, zero, middle = splat(1.0), splat(0.0), splat(MIDDLE)
    own, other = nine_rows(room, at + LANES * OWN_AXES), nine_rows(room, at + LANES * OTHER_AXES)
    frame = product(own, nine_rows(room, at + LANES * OWN_FRAME))
    second = product(other, nine_rows(room, at + LANES * OTHER_FRAME))
    way = three_rows(room, at)
    # The frame of the second edge in that of the first: columns along it, to its middle, across.
    q = transposed_product(frame, second)
    a = splat(half_edge)
    c = turned_back(frame, (way[0] / a, way[1] / a, way[2] / a))
    f = q[0], q[3], q[6]
    to_middle = middle * q[1], middle * q[4], middle * q[7]
    # The normal is across both edges; the first has (1, 0, 0).
    length = sqrt(fma(f[1], f[1], f[2] * f[2]))
    sure = where(splat(max(SLANT, WITHIN)) < length, one, zero)
    length = where(fma(f[1], c[2], zero - f[2] * c[1]) < zero, zero - length, length)
    scale = one / length
    n: Three = (zero, zero - f[2] * scale, f[1] * scale)
    between = fma(n[1], c[1], n[2] * c[2])
    rising, falling = middle * n[1], fma(n[1], to_middle[1], n[2] * to_middle[2])
    far = rising - falling
    gap = between - far
    # Where the line of centres leaves through the parallelogram of both.
    part, out = far / between, between / far
    r = (fma(part, c[0], to_middle[0]), fma(part, c[1], to_middle[1] - middle),
         fma(part, c[2], to_middle[2]))
    along = scale * fma(r[2] * f[0] - r[0] * f[2], n[1], (r[0] * f[1] - r[1] * f[0]) * n[2])
    beside = scale * (r[1] * n[2] - r[2] * n[1])
    inner = splat(1.0 - WITHIN)
    sure = where(fabs(along) < inner, sure, zero)
    sure = where(fabs(beside) < inner, sure, zero)
    sure = where(gap < splat(-OVERLAPPING), sure, zero)
    slope, part = splat(SLOPE), splat(1.0 - SLOPING)
    sure = where(slope * fabs(n[2]) < part * rising, sure, zero)
    sure = where(
        slope * fabs(fma(n[1], q[5], n[2] * q[8])) < zero - part * falling, sure, zero)
    apex: Three = (out * along, out * middle, zero)
    # The first edge and the faces of the second, in the frame of that.
    found = where(gap < zero, one, zero)
    start = turned_back(q, (zero - c[0], middle - c[1], zero - c[2]))
    ways: Three = (q[0], q[1], q[2])
    s0, found = through(start, ways, splat(FACE_ACROSS), splat(SIDE_ACROSS), found)
    s1, found = through(start, ways, splat(-FACE_ACROSS), splat(-SIDE_ACROSS), found)
    # The second edge and the faces of the first.
    start = to_middle[0] + c[0], to_middle[1] + c[1], to_middle[2] + c[2]
    t0, found = through(start, f, splat(FACE_ACROSS), splat(SIDE_ACROSS), found)
    t1, found = through(start, f, splat(-FACE_ACROSS), splat(-SIDE_ACROSS), found)
    b0 = fma(t0, f[0], start[0]), fma(t0, f[1], start[1]), fma(t0, f[2], start[2])
    b1 = fma(t1, f[0], start[0]), fma(t1, f[1], start[1]), fma(t1, f[2], start[2])
    rest = middle - apex[1]
    u0, u1 = (s0 - apex[0], rest, zero), (s1 - apex[0], rest, zero)
    w0 = b0[0] - apex[0], b0[1] - apex[1], b0[2]
    w1 = b1[0] - apex[0], b1[1] - apex[1], b1[2]
    # Twice the areas of the four triangles.
    t00, t01 = extent(cross(u0, w0)), extent(cross(u0, w1))
    t10, t11 = extent(cross(u1, w0)), extent(cross(u1, w1))
    total = t00 + t01 + (t10 + t11)
    found = where(zero < total, found, zero)
    scale, half = splat(0.25) / total, splat(0.5)
    p0, p1, r0, r1 = t00 + t01, t10 + t11, t00 + t10, t01 + t11
    point: Three = (
        fma(half, apex[0], scale * (p0 * s0 + p1 * s1 + (r0 * b0[0] + r1 * b1[0]))),
        fma(half, apex[1], scale * ((p0 + p1) * middle + (r0 * b0[1] + r1 * b1[1]))),
        scale * (r0 * b0[2] + r1 * b1[2]))
    y, z, x = b1[1] - b0[1], b1[2] - b0[2], half * (s1 - s0)
    put_results(
        room, at, half_edge, own, other, frame, way, n, between, gap, apex, point,
        (x * x) * fma(y, y, z * z))
    store_at(room, at + FOUND * LANES, found)
    store_at(room, at + SURE * LANES, sure)


@compiled
def through(
    start: Three, ways: Three, across: Vector, side: Vector, found: Vector
) -> tuple[Vector, Vector]:
    """
    Return the distances from `start` at which lines cross the plane of a face at an edge.

    In the frame of the edge. The second result is `found` if the distance is within 1 and the
    point in the face, else 0. `across`, `side`: components of its normal and of its other sides,
    positive for one of two faces.
    """
    one, zero, out = splat(1.0), splat(0.0), splat(FACE_OUT)
    s = (splat(INNER) - fma(out, start[1], across * start[2])) / (
        fma(out, ways[1], across * ways[2]))
    found = where(fabs(s) < one, found, zero)
    x, y, z = fma(s, ways[0], start[0]), fma(s, ways[1], start[1]), fma(s, ways[2], start[2])
    found = where(zero < across * z, found, zero)
    beyond = fma(splat(SIDE_ALONG), fabs(x), fma(splat(SIDE_OUT), y, side * z))
    return s, where(beyond < zero, found, zero)


@compiled
def extent(vector: Three) -> Vector:
    """Return the length of a vector."""
    return sqrt(dot(vector, vector))


@compiled
def vertices_in_faces(room: np.ndarray, at: int, half_edge: float) -> None:
    """
    Compute pairs of a vertex of the first body in a face of the second, in lanes.

    The overlap is a pyramid whose sides are the faces at the vertex. See `put_features` for the
    input in `room`.
    """
    one, zero, high = splat(1.0), splat(0.0), splat(OUTER)
    own, other = nine_rows(room, at + LANES * OWN_AXES), nine_rows(room, at + LANES * OTHER_AXES)
    frame = product(own, nine_rows(room, at + LANES * OWN_FRAME))
    second = product(other, nine_rows(room, at + LANES * OTHER_FRAME))
    way = three_rows(room, at)
    q = transposed_product(frame, second)
    a = splat(half_edge)
    c = turned_back(frame, (way[0] / a, way[1] / a, way[2] / a))
    # Out of the face, against its normal.
    n: Three = (zero - q[2], zero - q[5], zero - q[8])
    between = dot(n, c)
    far = fma(high, n[2], splat(INNER))
    gap = between - far
    part, out = far / between, between / far
    # Where the line of centres leaves the sum, seen from the second centre.
    b = turned_back(q, (
        zero - part * c[0], zero - part * c[1], high - part * c[2]))
    sure = where(zero < between, one, zero)
    sure = where(gap < splat(-OVERLAPPING), sure, zero)
    found, depth, half = where(gap < zero, one, zero), zero - gap, splat(0.5)
    for side in range(3):
        along = fma(splat(OWN_RIDGES[side, 0]), b[0], fma(
            splat(OWN_RIDGES[side, 1]), b[1], splat(OWN_RIDGES[side, 2]) * b[2]))
        sure = where(along < splat(-WITHIN), sure, zero)
    apex: Three = (zero, zero, out * high)
    total, seen, tx, ty, tz = zero, zero, zero, zero, zero
    # Where edges from the vertex leave the other side: they are so much farther back.
    ux, uy, uz = zero, zero, zero
    for number in range(SPOKE_COUNT + 1):
        spoke = number if number < SPOKE_COUNT else 0
        wx, wy, wz = (splat(OWN_SPOKES[spoke, 0]), splat(OWN_SPOKES[spoke, 1]),
                      splat(OWN_SPOKES[spoke, 2]))
        back = zero - fma(n[0], wx, fma(n[1], wy, n[2] * wz))
        sure = where(splat(SLOPING) < back, sure, zero)
        found = where(depth < back, found, zero)
        part = depth / back
        wx, wy, wz = part * wx, part * wy, fma(part, wz, high)
        y = turned_back(q, (wx - c[0], wy - c[1], wz - c[2]))
        for side in range(3):
            along = fma(splat(OWN_RIDGES[side, 0]), y[0], fma(
                splat(OWN_RIDGES[side, 1]), y[1], splat(OWN_RIDGES[side, 2]) * y[2]))
            found = where(along < zero, found, zero)
        if number > 0:
            p = cross((ux, uy, uz - apex[2]), (wx, wy, wz - apex[2]))
            area = half * extent(p)
            total = total + area
            tx = fma(area, ux + wx, tx)
            ty = fma(area, uy + wy, ty)
            tz = fma(area, uz + wz, tz)
            seen = fma(half, dot(n, p), seen)
        ux, uy, uz = wx, wy, wz
    found = where(zero < total, found, zero)
    scale = splat(0.25) / total
    put_results(
        room, at, half_edge, own, other, frame, way, n, between, gap, apex,
        (scale * tx, scale * ty, fma(half, apex[2], scale * tz)), seen * seen)
    store_at(room, at + FOUND * LANES, found)
    store_at(room, at + SURE * LANES, sure)


@compiled
def take_lane(
    room: np.ndarray, at: int, lane: int, exchanged: bool, number: int, out: np.ndarray
) -> None:
    """Write `out` of a pair from its lane; swap the results if the bodies are exchanged."""
    for k in range(19):
        out[k] = room[at + LANES * k + lane]
    out[19] = number
    if exchanged:
        for k in range(3):
            out[k], out[12 + k] = -out[k], -out[12 + k]
            out[3 + k], out[6 + k] = out[6 + k], out[3 + k]


@compiled
def cone(
    room: np.ndarray, vertex: int, nx: float, ny: float, nz: float, height: float, out: float
) -> Found:
    """
    Check that the overlap of a shell and a plane has one apex; contact point (3), squared area.

    For a vertex that is `height` beyond a plane with the unit normal n. In the axes of its body;
    `out` times the vertex is the apex.
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
