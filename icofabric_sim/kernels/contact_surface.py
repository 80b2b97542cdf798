# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Integrals over the surface between two overlapping icosahedra.

p_A is the depth of a point below the surface of A: rho - max over the faces of n . x, with rho the
inscribed radius. The surface S = {p_A = p_B = p >= 0} consists of plane polygons, one for each
pair of faces i of A and j of B: the plane where the depths below both faces are equal, within the
pyramid from the centre of A to face i and that of B to face j. With n the unit normal from A to B,
M_k = integral over both bodies of min(p_A, p_B)^k, and g = rho - p:

    grad M_k by the place of B = -integral over S of p^k n
    M_k = sum over polygons of h times the integral of F_k(p),  h = (x_B - x_A) . n
    F_k = g^-3 integral from 0 to p of (rho - u)^2 u^k du

The second follows from the divergence theorem with the fields -F_k (x - x_A) and -F_k (x - x_B),
whose divergence is p^k, which are zero on the outer surfaces and lie in the planes where one face
of a body takes over from the next. Over a triangle of area T with depths p1, p2, p3 at its corners
the integral of g^-3 is T / (g1 g2 g3), so with the elementary symmetric functions e of the depths

    integral of F_0 = T (rho^2 e1 - rho e2 + e3) / (3 g1 g2 g3)
    integral of F_1 = T (rho^2 (e1^2 - e2) - rho (e1 e2 - e3) + e1 e3) / (12 g1 g2 g3)

where nothing cancels. Frame: axes of A, its centre at the origin, lengths over a.
"""

import math
from typing import NamedTuple

from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.contact_shape import CORNERS, face_beyond, INNER, NEIGHBOURS, NORMALS
import numpy as np

# Corners of a polygon: at most 4 from a pyramid, and one more from each of three sides.
_MOST = 8
# A corner so near a side lies on it: the polygon beyond is looked at. More cost time only.
_NEAR = 1e-12
# There is a polygon; bits 0 to 5 of the same number are sides.
FOUND = 64


class Scratch(NamedTuple):
    """
    Room for one pair at a time.
    """

    portal: np.ndarray    # (4, 6), see find_facet
    turn: np.ndarray      # from B's axes to A's, (3, 3)
    normals: np.ndarray   # of B's faces in A's axes, (20, 3)
    polygon: np.ndarray   # two polygons: x, y, z and depth of the corners, (2, 8, 4)
    value: np.ndarray     # (8,)
    waiting: np.ndarray   # pairs of faces to look at, (401,)
    seen: np.ndarray      # bit j of row i: the pair was put there, (20,)
    sums: np.ndarray      # see SUMS, (14,)


# Rows of the sums: M_0, M_1, integrals of n, of p n, of x cross n, of p x cross n.
M0, M1, S0, S1, T0, T1 = 0, 1, 2, 5, 8, 11


def contact_scratch() -> Scratch:
    """
    Room for one thread.
    """
    return Scratch(
        np.zeros((4, 6)), np.zeros((3, 3)), np.zeros((20, 3)), np.zeros((2, _MOST, 4)),
        np.zeros(_MOST), np.zeros(401, np.int64), np.zeros(20, np.int64),
        np.zeros(14))


@compiled
def put_section(
    i: int, mx: float, my: float, mz: float, offset: float, polygon: np.ndarray
) -> int:
    """
    Cut pyramid i of A by the plane of equal depth below its face and below offset - m . x.

    Writes the corners into polygon[0] (8, 4), in order; returns how many.
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
    count = 0
    for k in range(3):
        if k == 0:
            here, there, inside, beyond = e0, e1, in0, in1
        elif k == 1:
            here, there, inside, beyond = e1, e2, in1, in2
        else:
            here, there, inside, beyond = e2, e0, in2, in0
        if inside:
            # On the line from the centre to this corner.
            t = centre / (centre + here)
            polygon[0, count, 0] = t * CORNERS[i, k, 0]
            polygon[0, count, 1] = t * CORNERS[i, k, 1]
            polygon[0, count, 2] = t * CORNERS[i, k, 2]
            polygon[0, count, 3] = INNER * (here / (centre + here))
            count += 1
        if inside != beyond:
            # On the edge to the next.
            t = here / (here - there)
            n = k + 1 if k < 2 else 0
            polygon[0, count, 0] = CORNERS[i, k, 0] + t * (CORNERS[i, n, 0] - CORNERS[i, k, 0])
            polygon[0, count, 1] = CORNERS[i, k, 1] + t * (CORNERS[i, n, 1] - CORNERS[i, k, 1])
            polygon[0, count, 2] = CORNERS[i, k, 2] + t * (CORNERS[i, n, 2] - CORNERS[i, k, 2])
            polygon[0, count, 3] = 0.0
            count += 1
    return count


@compiled
def clip(
    scratch: Scratch, kept: int, count: int, rx: float, ry: float, rz: float, r: float
) -> tuple[int, int]:
    """
    Keep what of a polygon has r . x <= r; returns where the rest stands, and its corners.
    """
    polygon, value = scratch.polygon, scratch.value
    outside = 0
    for k in range(count):
        value[k] = (rx * polygon[kept, k, 0] + ry * polygon[kept, k, 1]
                    + rz * polygon[kept, k, 2] - r)
        if value[k] > 0.0:
            outside += 1
    if outside == 0:
        return kept, count
    if outside == count:
        return kept, 0
    other = 1 - kept
    left = 0
    for k in range(count):
        n = k + 1 if k + 1 < count else 0
        if value[k] <= 0.0:
            for c in range(4):
                polygon[other, left, c] = polygon[kept, k, c]
            left += 1
        if (value[k] > 0.0) != (value[n] > 0.0):
            t = value[k] / (value[k] - value[n])
            for c in range(4):
                polygon[other, left, c] = polygon[kept, k, c] + t * (
                    polygon[kept, n, c] - polygon[kept, k, c])
            left += 1
    return other, left


@compiled
def add_polygon(
    scratch: Scratch, kept: int, count: int, nx: float, ny: float, nz: float, h: float
) -> None:
    """
    Add the integrals over a polygon with unit normal n.
    """
    polygon, sums = scratch.polygon[kept], scratch.sums
    x0, y0, z0, p0 = polygon[0, 0], polygon[0, 1], polygon[0, 2], polygon[0, 3]
    x1, y1, z1, p1 = polygon[1, 0], polygon[1, 1], polygon[1, 2], polygon[1, 3]
    area, depth, zeroth, first = 0.0, 0.0, 0.0, 0.0
    ax, ay, az, bx, by, bz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ux, uy, uz = x1 - x0, y1 - y0, z1 - z0
    for k in range(2, count):
        x2, y2, z2, p2 = polygon[k, 0], polygon[k, 1], polygon[k, 2], polygon[k, 3]
        vx, vy, vz = x2 - x0, y2 - y0, z2 - z0
        triangle = 0.5 * abs(
            nx * (uy * vz - uz * vy) + ny * (uz * vx - ux * vz) + nz * (ux * vy - uy * vx))
        e1 = p0 + p1 + p2
        e2 = p0 * p1 + p1 * p2 + p2 * p0
        e3 = p0 * p1 * p2
        shared = triangle / ((INNER - p0) * (INNER - p1) * (INNER - p2))
        zeroth += shared * (INNER * (INNER * e1 - e2) + e3)
        first += shared * (
            INNER * (INNER * (e1 * e1 - e2) - (e1 * e2 - e3)) + e1 * e3)
        area += triangle
        depth += triangle * e1
        sx, sy, sz = x0 + x1 + x2, y0 + y1 + y2, z0 + z1 + z2
        ax += triangle * sx
        ay += triangle * sy
        az += triangle * sz
        bx += triangle * (sx * e1 + x0 * p0 + x1 * p1 + x2 * p2)
        by += triangle * (sy * e1 + y0 * p0 + y1 * p1 + y2 * p2)
        bz += triangle * (sz * e1 + z0 * p0 + z1 * p1 + z2 * p2)
        x1, y1, z1, p1, ux, uy, uz = x2, y2, z2, p2, vx, vy, vz
    depth /= 3.0
    sums[M0] += h * zeroth / 3.0
    sums[M1] += h * first / 12.0
    sums[S0] += nx * area
    sums[S0 + 1] += ny * area
    sums[S0 + 2] += nz * area
    sums[S1] += nx * depth
    sums[S1 + 1] += ny * depth
    sums[S1 + 2] += nz * depth
    sums[T0] += (ay * nz - az * ny) / 3.0
    sums[T0 + 1] += (az * nx - ax * nz) / 3.0
    sums[T0 + 2] += (ax * ny - ay * nx) / 3.0
    sums[T1] += (by * nz - bz * ny) / 12.0
    sums[T1 + 1] += (bz * nx - bx * nz) / 12.0
    sums[T1 + 2] += (bx * ny - by * nx) / 12.0


@compiled
def add_pair_of_faces(
    scratch: Scratch, i: int, j: int, cx: float, cy: float, cz: float
) -> int:
    """
    Add the polygon of faces i of A and j of B, whose centre is c.

    Returns which neighbours of i (bits 0 to 2) and of j (3 to 5) lie beyond sides that it
    reaches, 0 where there is no polygon.
    """
    m = scratch.normals
    mx, my, mz = m[j, 0], m[j, 1], m[j, 2]
    centre = mx * cx + my * cy + mz * cz
    count = put_section(i, mx, my, mz, INNER + centre, scratch.polygon)
    if count == 0:
        return 0
    kept = 0
    for k in range(3):
        n = NEIGHBOURS[j, k]
        rx, ry, rz = m[n, 0] - mx, m[n, 1] - my, m[n, 2] - mz
        kept, count = clip(scratch, kept, count, rx, ry, rz, rx * cx + ry * cy + rz * cz)
        if count == 0:
            return 0
    # Where both faces look the same way the planes of equal depth are nowhere or everywhere.
    nx, ny, nz = NORMALS[i, 0] - mx, NORMALS[i, 1] - my, NORMALS[i, 2] - mz
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if not length > _NEAR:
        return 0
    nx, ny, nz = nx / length, ny / length, nz / length
    add_polygon(scratch, kept, count, nx, ny, nz, nx * cx + ny * cy + nz * cz)
    reached = FOUND
    polygon = scratch.polygon
    for k in range(3):
        n = NEIGHBOURS[i, k]
        rx = NORMALS[n, 0] - NORMALS[i, 0]
        ry = NORMALS[n, 1] - NORMALS[i, 1]
        rz = NORMALS[n, 2] - NORMALS[i, 2]
        for corner in range(count):
            if (rx * polygon[kept, corner, 0] + ry * polygon[kept, corner, 1]
                    + rz * polygon[kept, corner, 2]) > -_NEAR:
                reached |= 1 << k
        n = NEIGHBOURS[j, k]
        rx, ry, rz = m[n, 0] - mx, m[n, 1] - my, m[n, 2] - mz
        for corner in range(count):
            if (rx * (polygon[kept, corner, 0] - cx) + ry * (polygon[kept, corner, 1] - cy)
                    + rz * (polygon[kept, corner, 2] - cz)) > -_NEAR:
                reached |= 8 << k
    return reached


@compiled
def turn_normals(q: np.ndarray, normals: np.ndarray) -> None:
    """
    Write the normals (20, 3) of a body's faces in the axes that a matrix (3, 3) leads to.
    """
    for j in range(20):
        for c in range(3):
            normals[j, c] = (
                q[c, 0] * NORMALS[j, 0] + q[c, 1] * NORMALS[j, 1] + q[c, 2] * NORMALS[j, 2])


@compiled
def add_surface_from(
    scratch: Scratch, q: np.ndarray, cx: float, cy: float, cz: float,
    x: float, y: float, z: float
) -> bool:
    """
    Add the polygons from the one at a point of S on, each once; False where none is there.

    S is in one piece where bodies are not deep in each other: there a line from the centre of A
    meets it once, as the faces of B that take part look towards that centre.
    """
    seen = scratch.seen
    for i in range(20):
        seen[i] = 0
    bx, by, bz = x - cx, y - cy, z - cz
    i = face_beyond(x, y, z)
    j = face_beyond(
        q[0, 0] * bx + q[1, 0] * by + q[2, 0] * bz,
        q[0, 1] * bx + q[1, 1] * by + q[2, 1] * bz,
        q[0, 2] * bx + q[1, 2] * by + q[2, 2] * bz)
    return add_beside(scratch, i, j, cx, cy, cz)


@compiled
def add_beside(
    scratch: Scratch, i: int, j: int, cx: float, cy: float, cz: float
) -> bool:
    """
    Add the polygon of two faces and all that hang together with it, each once.

    False where the first does not exist.
    """
    seen, waiting = scratch.seen, scratch.waiting
    waiting[0] = 20 * i + j
    seen[i] |= 1 << j
    done, known = 0, 1
    while done < known:
        pair = waiting[done]
        i, j = pair // 20, pair % 20
        reached = add_pair_of_faces(scratch, i, j, cx, cy, cz)
        if done == 0 and reached == 0:
            return False
        done += 1
        for k in range(3):
            if reached & (1 << k):
                n = NEIGHBOURS[i, k]
                if not seen[n] >> j & 1:
                    seen[n] |= 1 << j
                    waiting[known] = 20 * n + j
                    known += 1
            if reached & (8 << k):
                n = NEIGHBOURS[j, k]
                if not seen[i] >> n & 1:
                    seen[i] |= 1 << n
                    waiting[known] = 20 * i + n
                    known += 1
    return True


@compiled
def add_all_pairs(scratch: Scratch, cx: float, cy: float, cz: float) -> None:
    """
    Add every polygon there is.
    """
    for i in range(20):
        for j in range(20):
            add_pair_of_faces(scratch, i, j, cx, cy, cz)


@compiled
def add_plane(scratch: Scratch, nx: float, ny: float, nz: float, offset: float) -> None:
    """
    Add the surface between A and a plane n . x = offset, whose depth is offset - n . x.

    The plane's own field is -n p^(k + 1) / (k + 1). So M_k is the sum over polygons, with unit
    normal v from A to the plane, of x . v (which is constant) times the integral of F_k, and of
    -(n . v) times that of p^(k + 1) / (k + 1).
    """
    sums = scratch.sums
    for i in range(20):
        count = put_section(i, nx, ny, nz, offset, scratch.polygon)
        if count == 0:
            continue
        vx, vy, vz = NORMALS[i, 0] - nx, NORMALS[i, 1] - ny, NORMALS[i, 2] - nz
        length = math.sqrt(vx * vx + vy * vy + vz * vz)
        if not length > _NEAR:
            continue
        vx, vy, vz = vx / length, vy / length, vz / length
        add_polygon(scratch, 0, count, vx, vy, vz, (INNER - offset) / length)
        polygon = scratch.polygon[0]
        facing = -(nx * vx + ny * vy + nz * vz)
        for k in range(2, count):
            ux, uy, uz = (polygon[k - 1, 0] - polygon[0, 0], polygon[k - 1, 1] - polygon[0, 1],
                          polygon[k - 1, 2] - polygon[0, 2])
            wx, wy, wz = (polygon[k, 0] - polygon[0, 0], polygon[k, 1] - polygon[0, 1],
                          polygon[k, 2] - polygon[0, 2])
            triangle = 0.5 * abs(vx * (uy * wz - uz * wy) + vy * (uz * wx - ux * wz)
                                 + vz * (ux * wy - uy * wx))
            p0, p1, p2 = polygon[0, 3], polygon[k - 1, 3], polygon[k, 3]
            e1 = p0 + p1 + p2
            sums[M0] += facing * triangle * e1 / 3.0
            sums[M1] += facing * triangle * (e1 * e1 - (p0 * p1 + p1 * p2 + p2 * p0)) / 12.0
