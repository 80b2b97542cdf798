# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Axes on which two icosahedra are apart, or overlap.

Both are symmetric about their centres, so the places of the second centre where the bodies touch
form the sum of both bodies about the first centre (the Minkowski sum of one and the other
reflected). The line of centres leaves that sum through one of its facets, whose normal is the
axis: the bodies are apart where the second centre lies beyond it. The facet is found by portal
refinement (G. Snethen, XenoCollide, Game Programming Gems 7, 2008): a triangle of points of the
sum's surface round the line is moved outwards until it lies in a facet.

Frame: axes of the first body, lengths over a; q is the matrix from the second body's axes.
"""

import math

from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.contact_shape import farthest, reach
import numpy as np

# What rounding may do to a scalar product of numbers near 1, generously.
ROUNDING = 1e-14
# Four or five rounds are the rule; each looks at another vertex of the sum, which has some 200.
_ROUNDS = 64
APART, OVERLAP, UNSURE = 0, 1, 2


@compiled
def turn_back(q: np.ndarray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """
    The transpose of a matrix (3, 3) times a vector.
    """
    return (q[0, 0] * x + q[1, 0] * y + q[2, 0] * z,
            q[0, 1] * x + q[1, 1] * y + q[2, 1] * z,
            q[0, 2] * x + q[1, 2] * y + q[2, 2] * z)


@compiled
def turn(q: np.ndarray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """
    A matrix (3, 3) times a vector.
    """
    return (q[0, 0] * x + q[0, 1] * y + q[0, 2] * z,
            q[1, 0] * x + q[1, 1] * y + q[1, 2] * z,
            q[2, 0] * x + q[2, 1] * y + q[2, 2] * z)


@compiled
def separation_on(
    half_edge: float, xa: np.ndarray, ra: np.ndarray, xb: np.ndarray, rb: np.ndarray,
    ux: float, uy: float, uz: float
) -> float:
    """
    Gap [m] along a unit vector of the world that leads from body A to B; negative: overlap.

    Centres [m] (3,), matrices from body to world axes (3, 3). The bodies are at least so far
    apart; their distance is the largest gap of all axes.
    """
    ax, ay, az = turn_back(ra, ux, uy, uz)
    bx, by, bz = turn_back(rb, ux, uy, uz)
    between = ux * (xb[0] - xa[0]) + uy * (xb[1] - xa[1]) + uz * (xb[2] - xa[2])
    return between - half_edge * (reach(ax, ay, az) + reach(bx, by, bz))


@compiled
def put_farthest(
    q: np.ndarray, ux: float, uy: float, uz: float, portal: np.ndarray, row: int
) -> float:
    """
    Write the sum's farthest point along u, and the first body's part of it, into a row (6,).

    Returns its scalar product with u.
    """
    ax, ay, az = farthest(ux, uy, uz)
    bx, by, bz = turn_back(q, ux, uy, uz)
    bx, by, bz = farthest(bx, by, bz)
    bx, by, bz = turn(q, bx, by, bz)
    portal[row, 0] = ax + bx
    portal[row, 1] = ay + by
    portal[row, 2] = az + bz
    portal[row, 3] = ax
    portal[row, 4] = ay
    portal[row, 5] = az
    return ux * (ax + bx) + uy * (ay + by) + uz * (az + bz)


@compiled
def cross(portal: np.ndarray, one: int, two: int) -> tuple[float, float, float]:
    """
    Cross product of two points.
    """
    x1, y1, z1 = portal[one, 0], portal[one, 1], portal[one, 2]
    x2, y2, z2 = portal[two, 0], portal[two, 1], portal[two, 2]
    return y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2


@compiled
def cross_with(
    portal: np.ndarray, row: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """
    Cross product of a point and a vector.
    """
    px, py, pz = portal[row, 0], portal[row, 1], portal[row, 2]
    return py * z - pz * y, pz * x - px * z, px * y - py * x


@compiled
def across(x: float, y: float, z: float) -> tuple[float, float, float]:
    """
    A vector at right angles to another that is not zero.
    """
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        return 0.0, -z, y
    if abs(y) <= abs(z):
        return z, 0.0, -x
    return -y, x, 0.0


@compiled
def triple(portal: np.ndarray, one: int, two: int, x: float, y: float, z: float) -> float:
    """
    Scalar product of that with a vector.
    """
    cx, cy, cz = cross(portal, one, two)
    return cx * x + cy * y + cz * z


@compiled
def find_facet(
    q: np.ndarray, cx: float, cy: float, cz: float, portal: np.ndarray
) -> tuple[int, float, float, float, float, float, float, float]:
    """
    Say whether two bodies are APART, OVERLAP, or neither was found out (UNSURE).

    Then the unit axis (3) from the first body to the second, the gap along it (negative: overlap;
    no other axis is looked at), and of overlapping bodies the deepest point of both: where they
    would touch if they shrank about their centres. c is the second centre, not at the first;
    `portal` (4, 6) is room. An axis with a gap ends the search.
    """
    far = put_farthest(q, cx, cy, cz, portal, 0)
    length = math.sqrt(cx * cx + cy * cy + cz * cz)
    gap = length - far / length
    if gap > ROUNDING:
        return APART, cx / length, cy / length, cz / length, gap, 0.0, 0.0, 0.0
    nx, ny, nz = cross_with(portal, 0, cx, cy, cz)
    if not nx * nx + ny * ny + nz * nz > 0.0:
        # The line goes through the first point: any direction across it will do.
        nx, ny, nz = across(cx, cy, cz)
    put_farthest(q, nx, ny, nz, portal, 1)
    # The sides from one to two, two to three and three to one have the line on their left.
    one, two, three, four = 0, 1, 2, 3
    if triple(portal, one, two, cx, cy, cz) < 0.0:
        one, two = two, one
    inside = False
    for _ in range(_ROUNDS):
        nx, ny, nz = cross(portal, one, two)
        far = put_farthest(q, nx, ny, nz, portal, three)
        gap = nx * cx + ny * cy + nz * cz - far
        if gap > 0.0:
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            gap /= length
            if gap > ROUNDING:
                return APART, nx / length, ny / length, nz / length, gap, 0.0, 0.0, 0.0
        if triple(portal, two, three, cx, cy, cz) < 0.0:
            one, three = three, one
        elif triple(portal, three, one, cx, cy, cz) < 0.0:
            two, three = three, two
        else:
            inside = True
            break
    if not inside:
        return UNSURE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(_ROUNDS):
        x, y, z = portal[one, 0], portal[one, 1], portal[one, 2]
        ax, ay, az = portal[two, 0] - x, portal[two, 1] - y, portal[two, 2] - z
        bx, by, bz = portal[three, 0] - x, portal[three, 1] - y, portal[three, 2] - z
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if not length > 0.0:
            break
        nx, ny, nz = nx / length, ny / length, nz / length
        far = put_farthest(q, nx, ny, nz, portal, four)
        gap = nx * cx + ny * cy + nz * cz - far
        if gap > ROUNDING:
            return APART, nx, ny, nz, gap, 0.0, 0.0, 0.0
        if far - (nx * x + ny * y + nz * z) <= ROUNDING:
            # Cramer's rule: c is the sum of the three points times these over the determinant.
            first = triple(portal, two, three, cx, cy, cz)
            second = triple(portal, three, one, cx, cy, cz)
            third = triple(portal, one, two, cx, cy, cz)
            whole = triple(portal, one, two, portal[three, 0], portal[three, 1], portal[three, 2])
            if not whole > 0.0:
                break
            first, second, third = first / whole, second / whole, third / whole
            return (
                OVERLAP, nx, ny, nz, gap,
                first * portal[one, 3] + second * portal[two, 3] + third * portal[three, 3],
                first * portal[one, 4] + second * portal[two, 4] + third * portal[three, 4],
                first * portal[one, 5] + second * portal[two, 5] + third * portal[three, 5])
        # Of the three triangles with the new point, the one that has the line in it.
        wx, wy, wz = cross_with(portal, four, cx, cy, cz)
        first = wx * portal[one, 0] + wy * portal[one, 1] + wz * portal[one, 2]
        second = wx * portal[two, 0] + wy * portal[two, 1] + wz * portal[two, 2]
        third = wx * portal[three, 0] + wy * portal[three, 1] + wz * portal[three, 2]
        if first <= 0.0 and second >= 0.0:
            three, four = four, three
        elif second <= 0.0 and third >= 0.0:
            one, four = four, one
        else:
            two, four = four, two
    return UNSURE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
