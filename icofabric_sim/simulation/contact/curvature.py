# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Second derivatives of the contact potential by the motions of both bodies, in closed form.

    delta = 4 M_1 / M_0,   M_k = integral of min(p_A, p_B)^k over both bodies

(terms/contacts/pair.py). Each depth p is the minimum of p_i = h_i - n_i . x over the faces of its
body and moves with the body: dp_i = alpha_i . dq, alpha_i = (n_i, (x - x_A) x n_i) by
displacements and rotation vectors. M_0 changes by the volume that its faces sweep. M_1 changes by
the volume that the boundary of the region p_A < p_B sweeps. A motion of A and one of B each move
their share of the boundary. With Reynolds' transport theorem,

    M_0,AB = sum over edges between a face i of A and j of B, of integral alpha_i beta_j^T /
             |n_i x n_j| dl,
    M_1,AB = sum over the surface p_i = p_j, of integral alpha_i beta_j^T / |n_j - n_i| dA.

All integrands are polynomials of second degree over segments and polygons: Simpson's rule and the
midpoint rule of edges are exact. Second derivatives by motions of one body follow, because a
common motion of both bodies does not change the energy (pair_forces.py).
"""

from icofabric_sim.geometry.icosahedron import face_geometry
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.terms.contacts.shape import INNER
import numpy as np

# Results of a pair: the volume M_0 [m^3], its derivatives by both motions (12), and M_0,AB and
# M_1,AB, 36 each.
VOLUME, SWEPT, BY_EDGES, BY_SURFACE, COUNT = 0, 1, 13, 49, 85
_PLANE_COUNT = 40  # of two bodies
_MAX_CORNERS = 48  # of a polygon
_FIRST_PLANE_COUNT = 8  # nearest planes of the first cut
_SQUARE_SIZE_RATIO = 8.0  # half the side of the clipped square over a: it exceeds both bodies
_MIN_SINE = 1e-12  # of the angle between planes that are not parallel
_NORMALS = np.ascontiguousarray(face_geometry(1.0).normals)


def curvature_room() -> np.ndarray:
    """Return the working memory of a thread."""
    return np.zeros((_PLANE_COUNT + 3, _MAX_CORNERS, 4))


@compiled
def pair_curvatures(
    half_edge: np.ndarray, xa: np.ndarray, ra: np.ndarray, xb: np.ndarray, rb: np.ndarray,
    point: np.ndarray, normal: np.ndarray, offset: float, room: np.ndarray, out: np.ndarray
) -> None:
    """
    Compute volumes and derivatives (n, COUNT) of n overlapping pairs, as in the module docstring.

    Arguments are half edges [m] (n, 2), positions [m] (n, 3), matrices from body to world axes (n,
    3, 3), and a `point` [m] (n, 3) within each overlap. With a nonzero `normal` (3,), the pairs
    are shells A and the plane at `offset` [m].
    """
    planes, order = np.zeros((_PLANE_COUNT, 4)), np.zeros(_PLANE_COUNT, np.int64)
    count = np.zeros(_PLANE_COUNT, np.int64)
    is_plane = normal[0] != 0.0 or normal[1] != 0.0 or normal[2] != 0.0
    for p in range(xa.shape[0]):
        own = 0
        for body in range(2):
            if body == 1 and is_plane:
                for k in range(3):
                    planes[own, k] = normal[k]
                planes[own, 3] = offset - (
                    normal[0] * point[p, 0] + normal[1] * point[p, 1] + normal[2] * point[p, 2])
                own += 1
                continue
            x, r = (xa, ra) if body == 0 else (xb, rb)
            for face in range(20):
                height = INNER * half_edge[p, body]
                for k in range(3):
                    n = (r[p, k, 0] * _NORMALS[face, 0] + r[p, k, 1] * _NORMALS[face, 1]
                         + r[p, k, 2] * _NORMALS[face, 2])
                    planes[own, k] = n
                    height += n * (x[p, k] - point[p, k])
                planes[own, 3] = height
                own += 1
        # The half edge of either body suits: the overlap is within both.
        curvature(
            planes, own, order, count, half_edge[p, 0], xa[p], xb[p], point[p], room, out[p])


@compiled
def curvature(
    planes: np.ndarray, total: int, order: np.ndarray, count: np.ndarray, half_edge: float,
    xa: np.ndarray, xb: np.ndarray, point: np.ndarray, room: np.ndarray, out: np.ndarray
) -> None:
    """
    Compute volume and derivatives of a pair with planes (n, 4) about the point, 20 of body A.
    """
    for k in range(total):
        order[k] = k
    # The nearest first.
    for k in range(1, total):
        j, number = k, order[k]
        while j > 0 and planes[order[j - 1], 3] > planes[number, 3]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = number
    near = min(_FIRST_PLANE_COUNT, total)
    while True:
        reach = cut_faces(planes, order, near, half_edge, room, count)
        more = near
        while more < total and planes[order[more], 3] <= reach:
            more += 1
        if more == near:
            break
        near = more
    for k in range(COUNT):
        out[k] = 0.0
    for a in range(near):
        if count[a] < 3:
            continue
        i = order[a]
        sweep(planes, i, room[a], count[a], xa if i < 20 else xb, point, out)
        if i < 20:
            for k in range(count[a]):
                j = int(room[a, k, 3])
                if j >= 20:
                    after = k + 1 if k + 1 < count[a] else 0
                    add_edge(planes, i, j, room[a, k], room[a, after], xa, xb, point, out)
            for b in range(near):
                j = order[b]
                if j >= 20 and count[b] >= 3:
                    add_between(
                        planes, i, j, order, near, count, half_edge, xa, xb, point, room, out)


@compiled
def cut_faces(
    planes: np.ndarray, order: np.ndarray, near: int, half_edge: float, room: np.ndarray,
    count: np.ndarray
) -> float:
    """
    Cut the faces of the overlap with its nearest planes; return the largest corner distance [m].
    """
    reach = 0.0
    for a in range(near):
        i = order[a]
        corners = begin(
            planes[i, 0], planes[i, 1], planes[i, 2], planes[i, 3], half_edge, room[a])
        for b in range(near):
            j = order[b]
            if b != a and corners:
                corners = cut(
                    room, a, corners, -planes[j, 0], -planes[j, 1], -planes[j, 2], planes[j, 3],
                    float(j))
        count[a] = corners
        for k in range(corners):
            reach = max(
                reach, room[a, k, 0] ** 2 + room[a, k, 1] ** 2 + room[a, k, 2] ** 2)
    return float(np.sqrt(reach))


@compiled
def begin(
    nx: float, ny: float, nz: float, height: float, half_edge: float, corners: np.ndarray
) -> int:
    """
    Write a sufficiently wide square in the plane n . x = height; return its number of corners.
    """
    ux, uy, uz = 0.0, 0.0, 0.0
    if abs(nx) <= abs(ny) and abs(nx) <= abs(nz):
        ux, uy, uz = 0.0, -nz, ny
    elif abs(ny) <= abs(nz):
        ux, uy, uz = nz, 0.0, -nx
    else:
        ux, uy, uz = -ny, nx, 0.0
    scale = _SQUARE_SIZE_RATIO * half_edge / np.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = scale * ux, scale * uy, scale * uz
    vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    for k in range(4):
        s, t = 1.0 - 2.0 * (k == 1 or k == 2), 1.0 - 2.0 * (k > 1)
        corners[k, 0] = height * nx + s * ux + t * vx
        corners[k, 1] = height * ny + s * uy + t * vy
        corners[k, 2] = height * nz + s * uz + t * vz
        corners[k, 3] = -1.0
    return 4


@compiled
def cut(
    room: np.ndarray, row: int, count: int, cx: float, cy: float, cz: float, rest: float,
    number: float
) -> int:
    """
    Clip a polygon to c . x + rest >= 0 (Sutherland and Hodgman 1974, CACM 17, 32).

    The fourth value of a corner is the number of the plane of the edge after the corner.
    """
    corners, kept, spare = room[row], 0, room[_PLANE_COUNT + 2]
    lowest = highest = 0.0
    for k in range(count):
        value = cx * corners[k, 0] + cy * corners[k, 1] + cz * corners[k, 2] + rest
        spare[k, 3] = value
        lowest, highest = min(lowest, value), max(highest, value)
    if lowest >= 0.0:
        return count
    if highest <= 0.0:
        return 0
    target = room[_PLANE_COUNT + 1]
    for k in range(count):
        after = k + 1 if k + 1 < count else 0
        here, there = spare[k, 3], spare[after, 3]
        if here >= 0.0:
            for m in range(4):
                target[kept, m] = corners[k, m]
            kept += 1
        if (here >= 0.0) != (there >= 0.0):
            part = here / (here - there)
            for m in range(3):
                target[kept, m] = corners[k, m] + part * (corners[after, m] - corners[k, m])
            target[kept, 3] = number if here >= 0.0 else corners[k, 3]
            kept += 1
    for k in range(kept):
        for m in range(4):
            corners[k, m] = target[k, m]
    return kept


@compiled
def sweep(
    planes: np.ndarray, i: int, corners: np.ndarray, count: int, x: np.ndarray,
    point: np.ndarray, out: np.ndarray
) -> None:
    """Add a face of the overlap to the volume and to its derivatives by the motion of its body."""
    nx, ny, nz = planes[i, 0], planes[i, 1], planes[i, 2]
    base = SWEPT + (0 if i < 20 else 6)
    for k in range(1, count - 1):
        area = triangle(corners, k)
        out[VOLUME] += planes[i, 3] * area / 3.0
        # From the centre of the body to that of the triangle.
        rx = (corners[0, 0] + corners[k, 0] + corners[k + 1, 0]) / 3.0 + point[0] - x[0]
        ry = (corners[0, 1] + corners[k, 1] + corners[k + 1, 1]) / 3.0 + point[1] - x[1]
        rz = (corners[0, 2] + corners[k, 2] + corners[k + 1, 2]) / 3.0 + point[2] - x[2]
        out[base] += area * nx
        out[base + 1] += area * ny
        out[base + 2] += area * nz
        out[base + 3] += area * (ry * nz - rz * ny)
        out[base + 4] += area * (rz * nx - rx * nz)
        out[base + 5] += area * (rx * ny - ry * nx)


@compiled
def triangle(corners: np.ndarray, k: int) -> float:
    """Return the area of the triangle of the first corner, corner k and the next corner."""
    ax, ay, az = (corners[k, 0] - corners[0, 0], corners[k, 1] - corners[0, 1],
                  corners[k, 2] - corners[0, 2])
    bx, by, bz = (corners[k + 1, 0] - corners[0, 0], corners[k + 1, 1] - corners[0, 1],
                  corners[k + 1, 2] - corners[0, 2])
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return float(0.5 * np.sqrt(x * x + y * y + z * z))


@compiled
def add_edge(
    planes: np.ndarray, i: int, j: int, begin_: np.ndarray, end: np.ndarray, xa: np.ndarray,
    xb: np.ndarray, point: np.ndarray, out: np.ndarray
) -> None:
    """Add an edge between a face of either body, by Simpson's rule."""
    cx = planes[i, 1] * planes[j, 2] - planes[i, 2] * planes[j, 1]
    cy = planes[i, 2] * planes[j, 0] - planes[i, 0] * planes[j, 2]
    cz = planes[i, 0] * planes[j, 1] - planes[i, 1] * planes[j, 0]
    sine = np.sqrt(cx * cx + cy * cy + cz * cz)
    if not sine > _MIN_SINE:
        return
    dx, dy, dz = end[0] - begin_[0], end[1] - begin_[1], end[2] - begin_[2]
    weight = np.sqrt(dx * dx + dy * dy + dz * dz) / (6.0 * sine)
    for k in range(3):
        part = 0.5 * k
        add_product(
            planes, i, j, begin_[0] + part * dx, begin_[1] + part * dy, begin_[2] + part * dz,
            (4.0 if k == 1 else 1.0) * weight, xa, xb, point, out, BY_EDGES)


@compiled
def add_between(
    planes: np.ndarray, i: int, j: int, order: np.ndarray, near: int, count: np.ndarray,
    half_edge: float, xa: np.ndarray, xb: np.ndarray, point: np.ndarray, room: np.ndarray,
    out: np.ndarray
) -> None:
    """Add the surface p_i = p_j between both bodies, by the midpoints of edges."""
    gx, gy, gz = (planes[j, 0] - planes[i, 0], planes[j, 1] - planes[i, 1],
                  planes[j, 2] - planes[i, 2])
    size = np.sqrt(gx * gx + gy * gy + gz * gz)
    if not size > _MIN_SINE:
        return
    corners = begin(
        gx / size, gy / size, gz / size, (planes[j, 3] - planes[i, 3]) / size, half_edge,
        room[_PLANE_COUNT])
    corners = cut(
        room, _PLANE_COUNT, corners, -planes[i, 0], -planes[i, 1], -planes[i, 2], planes[i, 3],
        -2.0)
    for b in range(near):
        k = order[b]
        if corners and k != i and k != j and count[b] >= 3:
            corners = cut(
                room, _PLANE_COUNT, corners, planes[i, 0] - planes[k, 0],
                planes[i, 1] - planes[k, 1], planes[i, 2] - planes[k, 2],
                planes[k, 3] - planes[i, 3], -2.0)
    found = room[_PLANE_COUNT]
    for k in range(1, corners - 1):
        weight = triangle(found, k) / (3.0 * size)
        for side in range(3):
            one = 0 if side < 2 else k
            other = k + 1 if side > 0 else k
            add_product(
                planes, i, j, 0.5 * (found[one, 0] + found[other, 0]),
                0.5 * (found[one, 1] + found[other, 1]), 0.5 * (found[one, 2] + found[other, 2]),
                weight, xa, xb, point, out, BY_SURFACE)


@compiled
def add_product(
    planes: np.ndarray, i: int, j: int, x: float, y: float, z: float, weight: float,
    xa: np.ndarray, xb: np.ndarray, point: np.ndarray, out: np.ndarray, base: int
) -> None:
    """Add alpha_i beta_j^T at a point, times a weight."""
    a0, a1, a2, a3, a4, a5 = rate(planes, i, x, y, z, xa, point)
    b0, b1, b2, b3, b4, b5 = rate(planes, j, x, y, z, xb, point)
    row = base
    for alpha in (a0, a1, a2, a3, a4, a5):
        scaled = weight * alpha
        out[row] += scaled * b0
        out[row + 1] += scaled * b1
        out[row + 2] += scaled * b2
        out[row + 3] += scaled * b3
        out[row + 4] += scaled * b4
        out[row + 5] += scaled * b5
        row += 6


@compiled
def rate(
    planes: np.ndarray, i: int, x: float, y: float, z: float, centre: np.ndarray,
    point: np.ndarray
) -> tuple[float, float, float, float, float, float]:
    """Return the derivative of the depth below a face at a point by the motion of its body."""
    nx, ny, nz = planes[i, 0], planes[i, 1], planes[i, 2]
    rx, ry, rz = x + point[0] - centre[0], y + point[1] - centre[1], z + point[2] - centre[2]
    return nx, ny, nz, ry * nz - rz * ny, rz * nx - rx * nz, rx * ny - ry * nx
