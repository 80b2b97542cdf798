# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Integrals over the surface between two overlapping icosahedra.

p_A is the depth of a point below the surface of A: rho - max over the faces of n . x, with rho the
inscribed radius. The surface S = {p_A = p_B = p >= 0} consists of plane polygons, one for each
pair of faces i of A and j of B: the plane where the depths below both faces are equal, within the
pyramid from the centre of A to face i and that of B to face j. With n the unit normal from A to B,
M_k = integral over both bodies of min(p_A, p_B)^k, and g = rho - p:

    grad M_k by the position of B = -integral over S of p^k n
    M_k = sum over polygons of h times the integral of F_k(p),  h = (x_B - x_A) . n
    F_k = g^-3 integral from 0 to p of (rho - u)^2 u^k du

The second follows from the divergence theorem with the fields -F_k (x - x_A) and -F_k (x - x_B).
Their divergence is p^k. They are zero on the outer surfaces and lie in the planes between the
pyramids of two faces. Over a triangle of area T with depths p1, p2, p3 at its corners
the integral of g^-3 is T / (g1 g2 g3), so with the elementary symmetric functions e of the depths

    integral of F_0 = T (rho^2 e1 - rho e2 + e3) / (3 g1 g2 g3)
    integral of F_1 = T (rho^2 (e1^2 - e2) - rho (e1 e2 - e3) + e1 e3) / (12 g1 g2 g3)

where nothing cancels. Frame: axes of A, its centre at the origin, lengths over a.

Bodies of two sizes have individual rho and F_k, and each polygon adds, for both, the
integral of F_k times its distance from the centre of the body: these add up to h. The centre of
the smaller body may lie so deep in the other that it is less deep below its own surface. Its field
is then singular there, and the integral over the whole body is added.
"""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    fabs,
    fma,
    LANES,
    load_at,
    splat,
    sqrt,
    store_at,
    where,
)
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.terms.contacts.axis import RATIO
from icofabric_sim.terms.contacts.shape import (
    CORNERS,
    FACE_VERTICES,
    INNER,
    NEIGHBOURS,
    NORMALS,
    RIDGES,
    VERTEX_ROOM,
    VERTEX_ROWS,
)
import numpy as np

# Volume of a body, over a^3.
_VOLUME = float(sum(np.linalg.det(CORNERS[i]) for i in range(20))) / 6.0
# Largest distance of a corner on a side: the polygon beyond is tested. More tests cost only time.
_TOLERANCE = 1e-12
# A polygon exists; bits 0 to 5 of the same number are sides, the others pairs of sides.
FOUND = 1 << 6


class Scratch(Record):
    """
    Scratch arrays for one pair at a time.

    All numbers are in one array, because each array that is passed on costs time.
    """

    room: np.ndarray   # (1784,), see below
    marks: np.ndarray  # (436,)


# Offsets in the scratch array; the first, and those from 256 to 543, are of axis.py and apex.py.
NORMAL = 33    # normals of B's faces in A's axes, x, y and z of all, (3, 24)
HEIGHT = 105   # of a point along these, (24,)
VALUE = 129    # of the corners of a polygon on a side, (8,)
POLYGON = 137  # two polygons: x, y, z and depth of the corners, (2, 8, 4)
SUMS = 201     # M_0, M_1, integrals of n, p n, x cross n, p x cross n, p x and p, (18,)
# For a plane: depths of the vertices (16,); corners and depths of faces in lanes, the first corner
# below the plane first, and normals (15, 8); and their terms of the sums (18, 8).
_DEPTHS, _WAITING_FACES, _TOTALS = 544, 560, 680
# A pyramid gives a polygon 4 corners at most, and each of three sides of another one more.
_NEXT, _CORNERS = 32, 4
# Pairs in lanes (apex.py): one alone, pairs of edges, pairs of a vertex and a face.
ALONE, EDGES, POINTS, _SCRATCH_SIZE = 824, 1144, 1464, 1784
# Faces, padded with 0 to whole vectors.
_FACES = 24
FACE_NORMALS = np.concatenate([NORMALS, np.zeros((_FACES - 20, 3))]).T.ravel()
# Indices of the sums.
M0, M1, S0, S1, T0, T1, X1, P1 = 0, 1, 2, 5, 8, 11, 14, 17
SUM_COUNT = 18
# Offsets in the marks: pairs of faces to evaluate; bit j of number i is set once pair i, j was
# added; pairs of bodies that wait to be computed in lanes, of either kind.
_WAITING, _SEEN, EDGES_WAIT, POINTS_WAIT, _MARKS = 0, 400, 420, 428, 436


def contact_scratch() -> Scratch:
    """Return scratch arrays for one thread."""
    return Scratch(np.zeros(_SCRATCH_SIZE), np.zeros(_MARKS, np.int64))


@compiled
def put_section(
    room: np.ndarray, i: int, mx: float, my: float, mz: float, offset: float
) -> tuple[int, int]:
    """
    Cut pyramid i of A by the plane of equal depth below its face and below offset - m . x.

    Write the corners into the first polygon, in order; return how many, and bit k for each
    neighbour k of i beyond a side that the polygon reaches.
    """
    # Depths below the other face of the corners of face i, and the difference of the depths at
    # the centre, where that below face i is rho.
    e0 = offset - (mx * CORNERS[i, 0, 0] + my * CORNERS[i, 0, 1] + mz * CORNERS[i, 0, 2])
    e1 = offset - (mx * CORNERS[i, 1, 0] + my * CORNERS[i, 1, 1] + mz * CORNERS[i, 1, 2])
    e2 = offset - (mx * CORNERS[i, 2, 0] + my * CORNERS[i, 2, 1] + mz * CORNERS[i, 2, 2])
    centre = INNER - offset
    if centre > 0.0:
        in0, in1, in2 = e0 > 0.0, e1 > 0.0, e2 > 0.0
    else:
        # The centre of A is deeper below the other face than below its own.
        in0, in1, in2 = e0 < 0.0, e1 < 0.0, e2 < 0.0
    if not (in0 or in1 or in2):
        return 0, 0
    sides = (5 if in0 or abs(e0) < _TOLERANCE else 0) | (
        3 if in1 or abs(e1) < _TOLERANCE else 0) | (6 if in2 or abs(e2) < _TOLERANCE else 0)
    at = POLYGON
    for k in range(3):
        if k == 0:
            here, there, inside, beyond, n = e0, e1, in0, in1, 1
        elif k == 1:
            here, there, inside, beyond, n = e1, e2, in1, in2, 2
        else:
            here, there, inside, beyond, n = e2, e0, in2, in0, 0
        x, y, z = CORNERS[i, k, 0], CORNERS[i, k, 1], CORNERS[i, k, 2]
        if inside:
            # On the line from the centre to this corner.
            whole = 1.0 / (centre + here)
            t = centre * whole
            room[at] = t * x
            room[at + 1] = t * y
            room[at + 2] = t * z
            room[at + 3] = INNER * (here * whole)
            at += _CORNERS
        if inside != beyond:
            # On the edge to the next.
            t = here / (here - there)
            room[at] = x + t * (CORNERS[i, n, 0] - x)
            room[at + 1] = y + t * (CORNERS[i, n, 1] - y)
            room[at + 2] = z + t * (CORNERS[i, n, 2] - z)
            room[at + 3] = 0.0
            at += _CORNERS
    return (at - POLYGON) // _CORNERS, sides


@compiled
def clip(
    room: np.ndarray, kept: int, count: int, rx: float, ry: float, rz: float, r: float
) -> tuple[int, int, bool]:
    """
    Cut a polygon to the half space r . x <= r.

    Return which polygon holds the rest, its number of corners, and True if it reaches that side.
    """
    start = POLYGON + _NEXT * kept
    outside, near = 0, 0
    for k in range(count):
        at = start + _CORNERS * k
        value = rx * room[at] + ry * room[at + 1] + rz * room[at + 2] - r
        room[VALUE + k] = value
        outside += 1 if value > 0.0 else 0
        near += 1 if value > -_TOLERANCE else 0
    if outside == 0:
        return kept, count, near > 0
    if outside == count:
        return kept, 0, False
    to = POLYGON + _NEXT * (1 - kept)
    last = start + _CORNERS * (count - 1)
    before = room[VALUE + count - 1]
    left = 0
    for k in range(count):
        at, value = start + _CORNERS * k, room[VALUE + k]
        if (value > 0.0) != (before > 0.0):
            t = before / (before - value)
            for n in range(_CORNERS):
                room[to + n] = room[last + n] + t * (room[at + n] - room[last + n])
            to += _CORNERS
            left += 1
        if value <= 0.0:
            for n in range(_CORNERS):
                room[to + n] = room[at + n]
            to += _CORNERS
            left += 1
        last, before = at, value
    return 1 - kept, left, True


@compiled
def field_over(
    triangle: float, p0: float, p1: float, p2: float, rho: float
) -> tuple[float, float]:
    """
    Return 3 times the integral of F_0 and 12 times that of F_1 over a `triangle` of this area.

    With these depths at its corners, of a body of this `rho`.
    """
    e1 = p0 + p1 + p2
    e2 = p0 * p1 + p1 * p2 + p2 * p0
    e3 = p0 * p1 * p2
    shared = triangle / ((rho - p0) * (rho - p1) * (rho - p2))
    return (
        shared * (rho * (rho * e1 - e2) + e3),
        shared * (rho * (rho * (e1 * e1 - e2) - (e1 * e2 - e3)) + e1 * e3))


@compiled
def add_integrals(
    room: np.ndarray, kept: int, count: int, nx: float, ny: float, nz: float, h: float
) -> None:
    """Add the integrals over a polygon with unit normal n."""
    at = POLYGON + _NEXT * kept
    x0, y0, z0, p0 = room[at], room[at + 1], room[at + 2], room[at + 3]
    at += _CORNERS
    x1, y1, z1, p1 = room[at], room[at + 1], room[at + 2], room[at + 3]
    area, depth, zeroth, first = 0.0, 0.0, 0.0, 0.0
    ax, ay, az, bx, by, bz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ux, uy, uz = x1 - x0, y1 - y0, z1 - z0
    for _ in range(2, count):
        at += _CORNERS
        x2, y2, z2, p2 = room[at], room[at + 1], room[at + 2], room[at + 3]
        vx, vy, vz = x2 - x0, y2 - y0, z2 - z0
        triangle = 0.5 * abs(
            nx * (uy * vz - uz * vy) + ny * (uz * vx - ux * vz) + nz * (ux * vy - uy * vx))
        e1 = p0 + p1 + p2
        part_0, part_1 = field_over(triangle, p0, p1, p2, INNER)
        zeroth += part_0
        first += part_1
        area += triangle
        depth += triangle * e1
        sx, sy, sz = x0 + x1 + x2, y0 + y1 + y2, z0 + z1 + z2
        ax += triangle * sx
        ay += triangle * sy
        az += triangle * sz
        bx += triangle * (sx * e1 + (x0 * p0 + x1 * p1 + x2 * p2))
        by += triangle * (sy * e1 + (y0 * p0 + y1 * p1 + y2 * p2))
        bz += triangle * (sz * e1 + (z0 * p0 + z1 * p1 + z2 * p2))
        x1, y1, z1, p1, ux, uy, uz = x2, y2, z2, p2, vx, vy, vz
    room[SUMS + M0] += h * zeroth / 3.0
    room[SUMS + M1] += h * first / 12.0
    room[SUMS + S0] += nx * area
    room[SUMS + S0 + 1] += ny * area
    room[SUMS + S0 + 2] += nz * area
    depth /= 3.0
    room[SUMS + S1] += nx * depth
    room[SUMS + S1 + 1] += ny * depth
    room[SUMS + S1 + 2] += nz * depth
    room[SUMS + X1] += bx / 12.0
    room[SUMS + X1 + 1] += by / 12.0
    room[SUMS + X1 + 2] += bz / 12.0
    room[SUMS + P1] += depth
    nx, ny, nz = nx / 3.0, ny / 3.0, nz / 3.0
    room[SUMS + T0] += ay * nz - az * ny
    room[SUMS + T0 + 1] += az * nx - ax * nz
    room[SUMS + T0 + 2] += ax * ny - ay * nx
    nx, ny, nz = 0.25 * nx, 0.25 * ny, 0.25 * nz
    room[SUMS + T1] += by * nz - bz * ny
    room[SUMS + T1 + 1] += bz * nx - bx * nz
    room[SUMS + T1 + 2] += bx * ny - by * nx


@compiled
def add_fields(
    room: np.ndarray, kept: int, count: int, nx: float, ny: float, nz: float, rho: float, h: float
) -> None:
    """
    Add the terms of a polygon to M_k, by the field of a body of this `rho`, `h` from its centre.
    """
    at = POLYGON + _NEXT * kept
    x0, y0, z0, p0 = room[at], room[at + 1], room[at + 2], room[at + 3]
    at += _CORNERS
    p1 = room[at + 3]
    ux, uy, uz = room[at] - x0, room[at + 1] - y0, room[at + 2] - z0
    zeroth, first = 0.0, 0.0
    for _ in range(2, count):
        at += _CORNERS
        vx, vy, vz, p2 = room[at] - x0, room[at + 1] - y0, room[at + 2] - z0, room[at + 3]
        triangle = 0.5 * abs(
            nx * (uy * vz - uz * vy) + ny * (uz * vx - ux * vz) + nz * (ux * vy - uy * vx))
        part_0, part_1 = field_over(triangle, p0, p1, p2, rho)
        zeroth += part_0
        first += part_1
        p1, ux, uy, uz = p2, vx, vy, vz
    room[SUMS + M0] += h * zeroth / 3.0
    room[SUMS + M1] += h * first / 12.0


@compiled
def add_polygon(room: np.ndarray, i: int, j: int, cx: float, cy: float, cz: float) -> int:
    """
    Add the polygon of faces i of A and j of B, whose centre is c.

    Return 0 without a polygon. Else FOUND, bits 0 to 2 for neighbours of i that lie beyond a side
    which the polygon reaches, 3 to 5 for neighbours of j, and bit 7 + 3 k + l for the neighbours k
    of i and l of j if it reaches both sides in one corner.
    """
    mx, my, mz = room[NORMAL + j], room[NORMAL + _FACES + j], room[NORMAL + 2 * _FACES + j]
    centre = mx * cx + my * cy + mz * cz
    ratio = room[RATIO]
    count, own_sides = put_section(room, i, mx, my, mz, ratio * INNER + centre)
    if count == 0:
        return 0
    n0, n1, n2 = NEIGHBOURS[j, 0], NEIGHBOURS[j, 1], NEIGHBOURS[j, 2]
    ux, uy, uz = (room[NORMAL + n0] - mx, room[NORMAL + _FACES + n0] - my,
                  room[NORMAL + 2 * _FACES + n0] - mz)
    vx, vy, vz = (room[NORMAL + n1] - mx, room[NORMAL + _FACES + n1] - my,
                  room[NORMAL + 2 * _FACES + n1] - mz)
    wx, wy, wz = (room[NORMAL + n2] - mx, room[NORMAL + _FACES + n2] - my,
                  room[NORMAL + 2 * _FACES + n2] - mz)
    u = ux * cx + uy * cy + uz * cz
    v = vx * cx + vy * cy + vz * cz
    w = wx * cx + wy * cy + wz * cz
    kept, count, at_u = clip(room, 0, count, ux, uy, uz, u)
    if count == 0:
        return 0
    kept, count, at_v = clip(room, kept, count, vx, vy, vz, v)
    if count == 0:
        return 0
    kept, count, at_w = clip(room, kept, count, wx, wy, wz, w)
    if count == 0:
        return 0
    # If both faces have the same normal, equal depth holds nowhere or everywhere.
    nx, ny, nz = NORMALS[i, 0] - mx, NORMALS[i, 1] - my, NORMALS[i, 2] - mz
    square = nx * nx + ny * ny + nz * nz
    if not square > _TOLERANCE * _TOLERANCE:
        return 0
    scale = 1.0 / math.sqrt(square)
    nx, ny, nz = nx * scale, ny * scale, nz * scale
    between = nx * cx + ny * cy + nz * cz
    if ratio == 1.0:
        add_integrals(room, kept, count, nx, ny, nz, between)
    else:
        # Distances of the plane from both centres.
        own = (INNER - (ratio * INNER + centre)) * scale
        add_integrals(room, kept, count, nx, ny, nz, own)
        add_fields(room, kept, count, nx, ny, nz, ratio * INNER, between - own)
    if not (at_u or at_v or at_w):
        # Within the pyramid of j.
        return FOUND | own_sides
    reached = FOUND
    for corner in range(count):
        at = POLYGON + _NEXT * kept + _CORNERS * corner
        x, y, z = room[at], room[at + 1], room[at + 2]
        # If the polygon before the cuts does not reach a side, no corner of the rest reaches it.
        own, other = 0, 0
        for k in range(3):
            if own_sides >> k & 1 and (
                    RIDGES[i, k, 0] * x + RIDGES[i, k, 1] * y + RIDGES[i, k, 2] * z > -_TOLERANCE):
                own |= 1 << k
        if at_u and ux * x + uy * y + uz * z - u > -_TOLERANCE:
            other |= 1
        if at_v and vx * x + vy * y + vz * z - v > -_TOLERANCE:
            other |= 2
        if at_w and wx * x + wy * y + wz * z - w > -_TOLERANCE:
            other |= 4
        reached |= own | other << 3
        if own and other:
            for k in range(3):
                if own >> k & 1:
                    reached |= other << (7 + 3 * k)
    return reached


@compiled
def turn_normals(room: np.ndarray) -> None:
    """Write the normals of B's faces in the axes of A; room[MATRIX:] holds the matrix."""
    for k in range(0, _FACES, LANES):
        x, y, z = (load_at(FACE_NORMALS, k), load_at(FACE_NORMALS, _FACES + k),
                   load_at(FACE_NORMALS, 2 * _FACES + k))
        for c in range(3):
            store_at(room, NORMAL + _FACES * c + k, fma(splat(room[3 * c]), x, fma(
                splat(room[3 * c + 1]), y, splat(room[3 * c + 2]) * z)))


@compiled
def add_surface(
    room: np.ndarray, marks: np.ndarray, cx: float, cy: float, cz: float,
    x: float, y: float, z: float
) -> bool:
    """
    Add the polygons connected to those at a point of S, each once; return False without any.

    S is connected if bodies are not deep in each other: a line from the centre of A crosses it
    once, because the participating faces of B are directed towards that centre.
    """
    # Faces of A, then of B, above the point: several where it lies on their ridges.
    for k in range(0, _FACES, LANES):
        store_at(room, HEIGHT + k, fma(load_at(FACE_NORMALS, k), splat(x), fma(
            load_at(FACE_NORMALS, _FACES + k), splat(y),
            load_at(FACE_NORMALS, 2 * _FACES + k) * splat(z))))
    above_own = highest(room)
    x, y, z = x - cx, y - cy, z - cz
    for k in range(0, _FACES, LANES):
        store_at(room, HEIGHT + k, fma(load_at(room, NORMAL + k), splat(x), fma(
            load_at(room, NORMAL + _FACES + k), splat(y),
            load_at(room, NORMAL + 2 * _FACES + k) * splat(z))))
    above_other = highest(room)
    known = 0
    for i in range(20):
        marks[_SEEN + i] = 0
        if above_own >> i & 1:
            marks[_SEEN + i] = above_other
            for j in range(20):
                if above_other >> j & 1:
                    marks[_WAITING + known] = 32 * i + j
                    known += 1
    done, found = 0, 0
    while done < known:
        pair = marks[_WAITING + done]
        done += 1
        i, j = pair >> 5, pair & 31
        reached = add_polygon(room, i, j, cx, cy, cz)
        found |= reached
        for k in range(3):
            if reached >> k & 1:
                known = wait(marks, known, NEIGHBOURS[i, k], j)
            if reached >> (3 + k) & 1:
                known = wait(marks, known, i, NEIGHBOURS[j, k])
        if reached >> 7:
            for k in range(3):
                for m in range(3):
                    if reached >> (7 + 3 * k + m) & 1:
                        known = wait(marks, known, NEIGHBOURS[i, k], NEIGHBOURS[j, m])
    return found != 0


@compiled
def highest(room: np.ndarray) -> int:
    """Return bits of the faces with the greatest height, or nearly so."""
    most = 0.0
    for k in range(20):
        most = max(most, room[HEIGHT + k])
    bits = 0
    for k in range(20):
        bits |= (1 if room[HEIGHT + k] >= most - _TOLERANCE else 0) << k
    return bits


@compiled
def wait(marks: np.ndarray, known: int, i: int, j: int) -> int:
    """
    Add a pair of faces to those to evaluate, unless it was added before; return their number.
    """
    if marks[_SEEN + i] >> j & 1:
        return known
    marks[_SEEN + i] |= 1 << j
    marks[_WAITING + known] = 32 * i + j
    return known + 1


@compiled
def add_all(room: np.ndarray, cx: float, cy: float, cz: float) -> None:
    """Add every polygon."""
    for i in range(20):
        for j in range(20):
            add_polygon(room, i, j, cx, cy, cz)


@compiled
def add_inner(room: np.ndarray, cx: float, cy: float, cz: float) -> None:
    """Add integrals over the whole smaller body if its centre is deep in the other body."""
    ratio, below = room[RATIO], 0.0
    for k in range(20):
        if ratio < 1.0:
            height = NORMALS[k, 0] * cx + NORMALS[k, 1] * cy + NORMALS[k, 2] * cz
        else:
            height = -(room[NORMAL + k] * cx + room[NORMAL + _FACES + k] * cy
                       + room[NORMAL + 2 * _FACES + k] * cz)
        below = max(below, height)
    size = min(ratio, 1.0)
    if max(ratio, 1.0) * INNER - below > size * INNER:
        # As of a pyramid: the mean depth is a quarter of its height.
        room[SUMS + M0] += size * size * size * _VOLUME
        room[SUMS + M1] += size * size * size * _VOLUME * 0.25 * size * INNER


@compiled
def add_plane(room: np.ndarray, nx: float, ny: float, nz: float, offset: float) -> None:
    """
    Add the surface between A and a plane n . x = offset, whose depth is offset - n . x.

    The plane's own field is -n p^(k + 1) / (k + 1). So M_k is the sum over polygons, with unit
    normal v from A to the plane, of x . v (which is constant) times the integral of F_k, and of
    -(n . v) times that of p^(k + 1) / (k + 1).
    """
    if not offset < INNER:
        # The centre of A is deeper below the plane than below any face.
        for i in range(20):
            add_section(room, i, nx, ny, nz, offset)
        return
    # Depths of the vertices.
    for k in range(0, VERTEX_ROOM, LANES):
        store_at(room, _DEPTHS + k, splat(offset) - fma(
            splat(nx), load_at(VERTEX_ROWS, k), fma(
                splat(ny), load_at(VERTEX_ROWS, VERTEX_ROOM + k),
                splat(nz) * load_at(VERTEX_ROWS, 2 * VERTEX_ROOM + k))))
    waiting = 0
    for i in range(20):
        e0, e1 = room[_DEPTHS + FACE_VERTICES[i, 0]], room[_DEPTHS + FACE_VERTICES[i, 1]]
        e2 = room[_DEPTHS + FACE_VERTICES[i, 2]]
        if not (e0 > 0.0 or e1 > 0.0 or e2 > 0.0):
            continue
        # The first corner below the plane, and so the second where two are.
        if e0 > 0.0 and not (e1 <= 0.0 and e2 > 0.0):
            k = 0
        elif e1 > 0.0 and not (e2 <= 0.0 and e0 > 0.0):
            k = 1
        else:
            k = 2
        for c in range(3):
            corner = k + c if k + c < 3 else k + c - 3
            for axis in range(3):
                room[_WAITING_FACES + LANES * (3 * c + axis) + waiting] = CORNERS[i, corner, axis]
            room[_WAITING_FACES + LANES * (9 + c) + waiting] = (
                room[_DEPTHS + FACE_VERTICES[i, corner]])
            room[_WAITING_FACES + LANES * (12 + c) + waiting] = NORMALS[i, c]
        waiting += 1
        if waiting == LANES:
            add_sections(room, nx, ny, nz, offset, waiting)
            waiting = 0
    if waiting > 0:
        for row in range(15):
            for k in range(waiting, LANES):
                # The other lanes have no depth, and so no polygon.
                room[_WAITING_FACES + LANES * row + k] = (
                    room[_WAITING_FACES + LANES * row] if row < 9 or row > 11 else 0.0)
        add_sections(room, nx, ny, nz, offset, waiting)


@compiled
def add_sections(
    room: np.ndarray, nx: float, ny: float, nz: float, offset: float, count: int
) -> None:
    """
    Add the polygons of the first `count` waiting faces, in lanes.

    Of three corners the first is below the plane, the second too if two are. The polygon is
    cut into the triangles of its first, second and third, and its first, third and fourth corner.
    """
    zero, one, rho = splat(0.0), splat(1.0), splat(INNER)
    centre = splat(INNER - offset)
    at = _WAITING_FACES
    ax, ay, az = load_at(room, at), load_at(room, at + LANES), load_at(room, at + 2 * LANES)
    bx, by, bz = (load_at(room, at + 3 * LANES), load_at(room, at + 4 * LANES),
                  load_at(room, at + 5 * LANES))
    cx, cy, cz = (load_at(room, at + 6 * LANES), load_at(room, at + 7 * LANES),
                  load_at(room, at + 8 * LANES))
    e0, e1, e2 = (load_at(room, at + 9 * LANES), load_at(room, at + 10 * LANES),
                  load_at(room, at + 11 * LANES))
    vx, vy, vz = (load_at(room, at + 12 * LANES) - splat(nx),
                  load_at(room, at + 13 * LANES) - splat(ny),
                  load_at(room, at + 14 * LANES) - splat(nz))
    # Points on the lines from the centre to the corners, and on the edges.
    one_in, two_in = e1 > zero, e2 > zero
    w0, w1, w2 = one / (centre + e0), one / (centre + e1), one / (centre + e2)
    t0, t1, t2 = centre * w0, centre * w1, centre * w2
    s01, s12, s02 = e0 / (e0 - e1), e1 / (e1 - e2), e0 / (e0 - e2)
    p0x, p0y, p0z, d0 = t0 * ax, t0 * ay, t0 * az, rho * (e0 * w0)
    x02, y02, z02 = fma(s02, cx - ax, ax), fma(s02, cy - ay, ay), fma(s02, cz - az, az)
    p1x = where(one_in, t1 * bx, fma(s01, bx - ax, ax))
    p1y = where(one_in, t1 * by, fma(s01, by - ay, ay))
    p1z = where(one_in, t1 * bz, fma(s01, bz - az, az))
    d1 = where(one_in, rho * (e1 * w1), zero)
    p2x = where(two_in, t2 * cx, where(one_in, fma(s12, cx - bx, bx), x02))
    p2y = where(two_in, t2 * cy, where(one_in, fma(s12, cy - by, by), y02))
    p2z = where(two_in, t2 * cz, where(one_in, fma(s12, cz - bz, bz), z02))
    d2 = where(two_in, rho * (e2 * w2), zero)
    p3x, p3y, p3z = (where(two_in, p2x, x02), where(two_in, p2y, y02), where(two_in, p2z, z02))
    d3 = where(two_in, d2, zero)
    square = fma(vx, vx, fma(vy, vy, vz * vz))
    # If the plane is parallel to the face, equal depth holds nowhere or everywhere.
    some = where(square > splat(_TOLERANCE * _TOLERANCE), one, zero)
    some = where(e0 > zero, some, zero)
    scale = one / sqrt(where(square > splat(_TOLERANCE * _TOLERANCE), square, one))
    vx, vy, vz = vx * scale, vy * scale, vz * scale
    h = centre * scale
    facing = zero - fma(splat(nx), vx, fma(splat(ny), vy, splat(nz) * vz))
    half = splat(0.5) * some
    # The first triangle.
    ux, uy, uz = p1x - p0x, p1y - p0y, p1z - p0z
    qx, qy, qz = p2x - p0x, p2y - p0y, p2z - p0z
    rx, ry, rz = p3x - p0x, p3y - p0y, p3z - p0z
    area_1 = half * fabs(fma(vx, uy * qz - uz * qy, fma(
        vy, uz * qx - ux * qz, vz * (ux * qy - uy * qx))))
    area_2 = half * fabs(fma(vx, qy * rz - qz * ry, fma(
        vy, qz * rx - qx * rz, vz * (qx * ry - qy * rx))))
    e1_1, e1_2 = d0 + d1 + d2, d0 + d2 + d3
    e2_1, e2_2 = d0 * d1 + d1 * d2 + d2 * d0, d0 * d2 + d2 * d3 + d3 * d0
    e3_1, e3_2 = d0 * d1 * d2, d0 * d2 * d3
    g02 = (rho - d0) * (rho - d2)
    shared_1, shared_2 = area_1 / (g02 * (rho - d1)), area_2 / (g02 * (rho - d3))
    zeroth = shared_1 * fma(rho, fma(rho, e1_1, zero - e2_1), e3_1) + (
        shared_2 * fma(rho, fma(rho, e1_2, zero - e2_2), e3_2))
    first = shared_1 * fma(rho, fma(rho, e1_1 * e1_1 - e2_1, e3_1 - e1_1 * e2_1), e1_1 * e3_1) + (
        shared_2 * fma(rho, fma(rho, e1_2 * e1_2 - e2_2, e3_2 - e1_2 * e2_2), e1_2 * e3_2))
    area = area_1 + area_2
    depth = area_1 * e1_1 + area_2 * e1_2
    squares = area_1 * (e1_1 * e1_1 - e2_1) + area_2 * (e1_2 * e1_2 - e2_2)
    third, twelfth = splat(1.0 / 3.0), splat(1.0 / 12.0)
    to = _TOTALS
    store_at(room, to, third * fma(h, zeroth, facing * depth))
    store_at(room, to + LANES, twelfth * fma(h, first, facing * squares))
    store_at(room, to + LANES * S0, vx * area)
    store_at(room, to + LANES * (S0 + 1), vy * area)
    store_at(room, to + LANES * (S0 + 2), vz * area)
    depth = third * depth
    store_at(room, to + LANES * S1, vx * depth)
    store_at(room, to + LANES * (S1 + 1), vy * depth)
    store_at(room, to + LANES * (S1 + 2), vz * depth)
    store_at(room, to + LANES * P1, depth)
    # Three times the areas' centres, and twelve times their centres of depth.
    sx, sy, sz = p0x + p1x + p2x, p0y + p1y + p2y, p0z + p1z + p2z
    wx, wy, wz = p0x + p2x + p3x, p0y + p2y + p3y, p0z + p2z + p3z
    mx, my, mz = area_1 * sx + area_2 * wx, area_1 * sy + area_2 * wy, area_1 * sz + area_2 * wz
    kx = area_1 * fma(sx, e1_1, fma(p0x, d0, fma(p1x, d1, p2x * d2))) + (
        area_2 * fma(wx, e1_2, fma(p0x, d0, fma(p2x, d2, p3x * d3))))
    ky = area_1 * fma(sy, e1_1, fma(p0y, d0, fma(p1y, d1, p2y * d2))) + (
        area_2 * fma(wy, e1_2, fma(p0y, d0, fma(p2y, d2, p3y * d3))))
    kz = area_1 * fma(sz, e1_1, fma(p0z, d0, fma(p1z, d1, p2z * d2))) + (
        area_2 * fma(wz, e1_2, fma(p0z, d0, fma(p2z, d2, p3z * d3))))
    store_at(room, to + LANES * X1, twelfth * kx)
    store_at(room, to + LANES * (X1 + 1), twelfth * ky)
    store_at(room, to + LANES * (X1 + 2), twelfth * kz)
    store_at(room, to + LANES * T0, third * (my * vz - mz * vy))
    store_at(room, to + LANES * (T0 + 1), third * (mz * vx - mx * vz))
    store_at(room, to + LANES * (T0 + 2), third * (mx * vy - my * vx))
    store_at(room, to + LANES * T1, twelfth * (ky * vz - kz * vy))
    store_at(room, to + LANES * (T1 + 1), twelfth * (kz * vx - kx * vz))
    store_at(room, to + LANES * (T1 + 2), twelfth * (kx * vy - ky * vx))
    for k in range(SUM_COUNT):
        for lane in range(count):
            room[SUMS + k] += room[to + LANES * k + lane]


@compiled
def add_section(
    room: np.ndarray, i: int, nx: float, ny: float, nz: float, offset: float
) -> None:
    """Add the polygon of face i and a plane."""
    count, _ = put_section(room, i, nx, ny, nz, offset)
    if count == 0:
        return
    vx, vy, vz = NORMALS[i, 0] - nx, NORMALS[i, 1] - ny, NORMALS[i, 2] - nz
    length = math.sqrt(vx * vx + vy * vy + vz * vz)
    if not length > _TOLERANCE:
        return
    vx, vy, vz = vx / length, vy / length, vz / length
    add_integrals(room, 0, count, vx, vy, vz, (INNER - offset) / length)
    facing = -(nx * vx + ny * vy + nz * vz)
    x, y, z, p0 = room[POLYGON], room[POLYGON + 1], room[POLYGON + 2], room[POLYGON + 3]
    at = POLYGON + _CORNERS
    for _ in range(2, count):
        ux, uy, uz, p1 = room[at] - x, room[at + 1] - y, room[at + 2] - z, room[at + 3]
        at += _CORNERS
        wx, wy, wz, p2 = room[at] - x, room[at + 1] - y, room[at + 2] - z, room[at + 3]
        triangle = 0.5 * abs(vx * (uy * wz - uz * wy) + vy * (uz * wx - ux * wz)
                             + vz * (ux * wy - uy * wx))
        e1 = p0 + p1 + p2
        room[SUMS + M0] += facing * triangle * e1 / 3.0
        room[SUMS + M1] += facing * triangle * (
            e1 * e1 - (p0 * p1 + p1 * p2 + p2 * p0)) / 12.0
