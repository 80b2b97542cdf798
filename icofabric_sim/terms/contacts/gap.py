# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Gaps of two shells, or of a shell and a plane, along an axis, and the axis with the widest gap.

Along a unit vector n the shell of a body at x covers n . x - h to n . x + h, h its support. If
two of these intervals have a gap, the shells are at least that far apart. Axes are
numbered: the line of centres, the face normals of either body (10 and 10, up to their sign) and
the products of their edges (15 times 15). If two shells do not overlap, one of these axes shows a
gap (separating axis theorem, S. Gottschalk, M. C. Lin and D. Manocha 1996, OBBTree).
"""

import math

from icofabric_sim.geometry.icosahedron import EDGES, FACES, inscribed_radius, vertices
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    any_lane,
    fabs,
    fma,
    lane,
    LANES,
    load_at,
    maximum,
    rsqrt,
    splat,
    where,
)
from icofabric_sim.terms.contacts.shape import reach, reach_lanes
import numpy as np

_CORNERS = vertices(1.0)
# The first of each pair of opposite faces and of parallel edges.
_ALL_NORMALS = _CORNERS[FACES].sum(axis=1)
_ALL_NORMALS /= np.sqrt((_ALL_NORMALS**2).sum(axis=1))[:, None]
_ALL_WAYS = 0.5 * (_CORNERS[EDGES[:, 1]] - _CORNERS[EDGES[:, 0]])


def _halved(directions: np.ndarray) -> np.ndarray:
    chosen: list[np.ndarray] = []
    for row in directions:
        if not any(abs(row @ other) > 0.999 for other in chosen):
            chosen.append(row)
    return np.ascontiguousarray(chosen)


_NORMALS, _DIRECTIONS = _halved(_ALL_NORMALS), _halved(_ALL_WAYS)
_RHO = inscribed_radius(1.0)
_FIRST_EDGE = 1 + 2 * len(_NORMALS)
AXIS_COUNT = _FIRST_EDGE + len(_DIRECTIONS) ** 2
# x, y, z and number of normals and edges, padded to whole vectors with the first, and with zeros.
_PADDED_COUNT = 16
_NORMAL_ROWS = np.concatenate([
    np.concatenate([row, np.full(_PADDED_COUNT - len(row), row[0])])
    for row in (*_NORMALS.T, 1.0 + np.arange(len(_NORMALS)))])
_WAY_ROWS = np.concatenate([
    np.concatenate([row, np.zeros(_PADDED_COUNT - len(row))])
    for row in (*_DIRECTIONS.T, np.arange(float(len(_DIRECTIONS))))])
# Squared sine of an angle between edges below which they count as parallel: the same axis is then
# found from a face normal.
_PARALLEL = 1e-12

# World components of body axes x, y and z.
Axes = tuple[float, float, float, float, float, float, float, float, float]


@compiled
def axes_of(orientation: np.ndarray, s: int) -> Axes:
    """Return world components of the body axes (eqs 16 and 26) of slot `s`."""
    if orientation.ndim == 2:
        x, y, z, w = orientation[0, s], orientation[1, s], orientation[2, s], orientation[3, s]
        return (
            1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
            2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
            2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    else:
        return (
            orientation[0, 0, s], orientation[0, 1, s], orientation[0, 2, s],
            orientation[1, 0, s], orientation[1, 1, s], orientation[1, 2, s],
            orientation[2, 0, s], orientation[2, 1, s], orientation[2, 2, s])


@compiled
def edge_of(half_edge: float, half_edges: np.ndarray | None, s: int) -> float:
    """Return the half edge [m] of a body or slot, common or individual."""
    if half_edges is None:
        return half_edge
    else:
        return float(half_edges[s])


@compiled
def ratio_of(half_edges: np.ndarray | None, s: int, t: int) -> float:
    """Return the half edge of the second body over that of the first."""
    if half_edges is None:
        return 1.0
    else:
        return float(half_edges[t] / half_edges[s])


@compiled
def support(axes: Axes, nx: float, ny: float, nz: float) -> float:
    """
    Return half the width of a shell of half edge 1 along a unit vector, max n . v over vertices.
    """
    return reach(
        axes[0] * nx + axes[1] * ny + axes[2] * nz, axes[3] * nx + axes[4] * ny + axes[5] * nz,
        axes[6] * nx + axes[7] * ny + axes[8] * nz)


@compiled
def gap_along(
    code: int, half_edge: float, ratio: float, dx: float, dy: float, dz: float, first: Axes,
    second: Axes
) -> float:
    """
    Return the gap [m] of two shells along an axis, negative if they overlap along it.

    (dx, dy, dz) [m] leads from the first centre to the second. `half_edge` [m] of the first, and
    `ratio` of the second half edge over it.
    """
    if code == 0:
        size = math.sqrt(dx * dx + dy * dy + dz * dz)
        if not size > 0.0:
            return -(1.0 + ratio) * half_edge * _RHO
        nx, ny, nz = dx / size, dy / size, dz / size
        return size - half_edge * (
            support(first, nx, ny, nz) + ratio * support(second, nx, ny, nz))
    if code < _FIRST_EDGE:
        number = code - 1
        own, other = first, second
        own_size, other_size = 1.0, ratio
        if number >= _NORMALS.shape[0]:
            number -= _NORMALS.shape[0]
            own, other = second, first
            own_size, other_size = ratio, 1.0
        x, y, z = _NORMALS[number, 0], _NORMALS[number, 1], _NORMALS[number, 2]
        nx = own[0] * x + own[3] * y + own[6] * z
        ny = own[1] * x + own[4] * y + own[7] * z
        nz = own[2] * x + own[5] * y + own[8] * z
        return abs(nx * dx + ny * dy + nz * dz) - half_edge * (
            own_size * _RHO + other_size * support(other, nx, ny, nz))
    number = code - _FIRST_EDGE
    i, j = number // _DIRECTIONS.shape[0], number % _DIRECTIONS.shape[0]
    x, y, z = _DIRECTIONS[i, 0], _DIRECTIONS[i, 1], _DIRECTIONS[i, 2]
    ux = first[0] * x + first[3] * y + first[6] * z
    uy = first[1] * x + first[4] * y + first[7] * z
    uz = first[2] * x + first[5] * y + first[8] * z
    x, y, z = _DIRECTIONS[j, 0], _DIRECTIONS[j, 1], _DIRECTIONS[j, 2]
    vx = second[0] * x + second[3] * y + second[6] * z
    vy = second[1] * x + second[4] * y + second[7] * z
    vz = second[2] * x + second[5] * y + second[8] * z
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    if not square > _PARALLEL:
        return -(1.0 + ratio) * half_edge * _RHO
    size = math.sqrt(square)
    nx, ny, nz = nx / size, ny / size, nz / size
    return abs(nx * dx + ny * dy + nz * dz) - half_edge * (
        support(first, nx, ny, nz) + ratio * support(second, nx, ny, nz))


@compiled
def widest_gap(
    wanted: float, half_edge: float, ratio: float, dx: float, dy: float, dz: float, first: Axes,
    second: Axes
) -> tuple[float, int]:
    """
    Return the largest gap [m] of two shells along any of the axes, and the number of its axis.

    The search ends early if a gap is at least `wanted` [m]. Several axes are tested in lanes.
    """
    gap = gap_along(0, half_edge, ratio, dx, dy, dz, first, second)
    if gap >= wanted:
        return gap, 0
    best, which = splat(gap), splat(0.0)
    a, rho, enough = splat(half_edge), splat(_RHO), splat(wanted)
    size = splat(ratio)
    other_rho = size * rho
    # The vector between the centres on the axes of both; the second's axes on those of the first.
    ax, ay, az = (
        splat(first[0] * dx + first[1] * dy + first[2] * dz),
        splat(first[3] * dx + first[4] * dy + first[5] * dz),
        splat(first[6] * dx + first[7] * dy + first[8] * dz))
    bx, by, bz = (
        splat(second[0] * dx + second[1] * dy + second[2] * dz),
        splat(second[3] * dx + second[4] * dy + second[5] * dz),
        splat(second[6] * dx + second[7] * dy + second[8] * dz))
    q0, q1, q2 = (scalar(second, 0, first, 0), scalar(second, 0, first, 3),
                  scalar(second, 0, first, 6))
    q3, q4, q5 = (scalar(second, 3, first, 0), scalar(second, 3, first, 3),
                  scalar(second, 3, first, 6))
    q6, q7, q8 = (scalar(second, 6, first, 0), scalar(second, 6, first, 3),
                  scalar(second, 6, first, 6))
    v0, v1, v2, v3, v4, v5, v6, v7, v8 = (
        splat(q0), splat(q1), splat(q2), splat(q3), splat(q4), splat(q5), splat(q6), splat(q7),
        splat(q8))
    for k in range(0, _PADDED_COUNT, LANES):
        x, y, z = (load_at(_NORMAL_ROWS, k), load_at(_NORMAL_ROWS, _PADDED_COUNT + k),
                   load_at(_NORMAL_ROWS, 2 * _PADDED_COUNT + k))
        number = load_at(_NORMAL_ROWS, 3 * _PADDED_COUNT + k)
        shown = fabs(fma(x, ax, fma(y, ay, z * az))) - a * (rho + size * reach_lanes(
            fma(v0, x, fma(v1, y, v2 * z)), fma(v3, x, fma(v4, y, v5 * z)),
            fma(v6, x, fma(v7, y, v8 * z))))
        which = where(best < shown, number, which)
        best = maximum(shown, best)
        shown = fabs(fma(x, bx, fma(y, by, z * bz))) - a * (other_rho + reach_lanes(
            fma(v0, x, fma(v3, y, v6 * z)), fma(v1, x, fma(v4, y, v7 * z)),
            fma(v2, x, fma(v5, y, v8 * z))))
        which = where(best < shown, number + splat(float(_NORMALS.shape[0])), which)
        best = maximum(shown, best)
    found = any_lane(enough < best)
    for k in range(0, _PADDED_COUNT, LANES):
        if found:
            break
        # Edges of the second in the axes of both.
        x, y, z = (load_at(_WAY_ROWS, k), load_at(_WAY_ROWS, _PADDED_COUNT + k),
                   load_at(_WAY_ROWS, 2 * _PADDED_COUNT + k))
        tx, ty, tz = (fma(v0, x, fma(v3, y, v6 * z)), fma(v1, x, fma(v4, y, v7 * z)),
                      fma(v2, x, fma(v5, y, v8 * z)))
        for way in range(_DIRECTIONS.shape[0]):
            ux, uy, uz = _DIRECTIONS[way, 0], _DIRECTIONS[way, 1], _DIRECTIONS[way, 2]
            ex, ey, ez = splat(ux), splat(uy), splat(uz)
            nx, ny, nz = ey * tz - ez * ty, ez * tx - ex * tz, ex * ty - ey * tx
            fx, fy, fz = (splat(q0 * ux + q1 * uy + q2 * uz), splat(q3 * ux + q4 * uy + q5 * uz),
                          splat(q6 * ux + q7 * uy + q8 * uz))
            square = fma(nx, nx, fma(ny, ny, nz * nz))
            shown = rsqrt(square) * (fabs(fma(nx, ax, fma(ny, ay, nz * az))) - a * (
                reach_lanes(nx, ny, nz)
                + size * reach_lanes(fy * z - fz * y, fz * x - fx * z, fx * y - fy * x)))
            shown = where(splat(_PARALLEL) < square, shown, best)
            number = load_at(_WAY_ROWS, 3 * _PADDED_COUNT + k) + splat(
                float(_FIRST_EDGE + _DIRECTIONS.shape[0] * way))
            which = where(best < shown, number, which)
            best = maximum(shown, best)
            if any_lane(enough < best):
                found = True
                break
    most = 0
    for k in range(1, LANES):
        most = k if lane(best, k) > lane(best, most) else most
    code = int(lane(which, most))
    # Recomputed as for a stored axis, so that both results are bit-identical.
    return max(gap, gap_along(code, half_edge, ratio, dx, dy, dz, first, second)), code


@compiled
def scalar(one: Axes, i: int, two: Axes, j: int) -> float:
    """Return the scalar product of two body axes that begin at these indices."""
    return one[i] * two[j] + one[i + 1] * two[j + 1] + one[i + 2] * two[j + 2]


@compiled
def plane_gap(
    plane: np.ndarray, offset: float, half_edge: float, x: float, y: float, z: float, axes: Axes
) -> float:
    """
    Return the distance [m] of a shell at (x, y, z) from a plane, below 0 within.

    `plane` begins with the unit normal; `offset` [m].
    """
    nx, ny, nz = plane[0], plane[1], plane[2]
    return nx * x + ny * y + nz * z - offset - half_edge * support(axes, nx, ny, nz)
