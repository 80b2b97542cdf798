# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Forces of custom connectors: eq 49 between any points of two bodies."""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import bits, splat, Vector, where
from icofabric_sim.terms.shared import Six, SMALLEST_SQUARE
from icofabric_sim.terms.ties.record import Ties
import numpy as np


@compiled
def arm_of_point(
    orientation: np.ndarray, s: int, points: np.ndarray, r: int
) -> tuple[float, float, float]:
    """Return point `r` of the body at slot `s` from its centre [m], world frame (eq 26)."""
    vx, vy, vz = points[r, 0], points[r, 1], points[r, 2]
    if orientation.ndim == 2:
        x, y, z, w = orientation[0, s], orientation[1, s], orientation[2, s], orientation[3, s]
        tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
        return (
            vx + w * tx + y * tz - z * ty, vy + w * ty + z * tx - x * tz,
            vz + w * tz + x * ty - y * tx)
    else:
        a, b, c = orientation[0], orientation[1], orientation[2]
        return (
            vx * a[0, s] + vy * b[0, s] + vz * c[0, s],
            vx * a[1, s] + vy * b[1, s] + vz * c[1, s],
            vx * a[2, s] + vy * b[2, s] + vz * c[2, s])


@compiled
def span_of(
    ties: Ties, position: np.ndarray, orientation: np.ndarray, r: int
) -> tuple[float, float, float, float, float, float]:
    """
    Return the arm [m] of the end of row `r`, and the vector from there to the other end [m].

    The vector is bit-identical from either end except for its sign.
    """
    i, j = ties.own[r], ties.other[r]
    sx, sy, sz = arm_of_point(orientation, i, ties.point, r)
    qx, qy, qz = arm_of_point(orientation, j, ties.far, r)
    return (
        sx, sy, sz, (position[0, j] + qx) - (position[0, i] + sx),
        (position[1, j] + qy) - (position[1, i] + sy),
        (position[2, j] + qz) - (position[2, i] + sz))


@compiled
def stretch_of(
    ties: Ties, r: int, ux: float, uy: float, uz: float
) -> tuple[float, float, float]:
    """Return length [m], stretch l - D [m] and slope k_e or k_c [N/m] of row `r` (eqs 1, 2)."""
    length = math.sqrt(max(ux * ux + uy * uy + uz * uz, SMALLEST_SQUARE))
    stretch = length - ties.natural_length[r]
    if ties.present[r] == 0:
        return length, stretch, 0.0
    return length, stretch, float(
        ties.extension[r] if stretch > 0.0 else ties.compression[r])


@compiled
def add_at_lane(lanes: int, value: float, total: Vector) -> Vector:
    """Add a number to one lane, whose bit is `lanes`."""
    return total + where(bits(lanes), splat(value), splat(0.0))


@compiled
def add_force(
    ties: Ties | None, position: np.ndarray, orientation: np.ndarray, block: int, wrench: Six
) -> Six:
    """Add the pull k (l - D) of each connector at the bodies of a block towards its other end."""
    if ties is None:
        return wrench
    else:
        fx, fy, fz, tx, ty, tz = wrench
        for r in range(ties.start[block], ties.start[block + 1]):
            sx, sy, sz, ux, uy, uz = span_of(ties, position, orientation, r)
            length, stretch, slope = stretch_of(ties, r, ux, uy, uz)
            pull, lane = slope * stretch / length, ties.lane[r]
            px, py, pz = pull * ux, pull * uy, pull * uz
            fx, fy, fz = (
                add_at_lane(lane, px, fx), add_at_lane(lane, py, fy), add_at_lane(lane, pz, fz))
            tx = add_at_lane(lane, sy * pz - sz * py, tx)
            ty = add_at_lane(lane, sz * px - sx * pz, ty)
            tz = add_at_lane(lane, sx * py - sy * px, tz)
        return fx, fy, fz, tx, ty, tz
