# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Damping of custom connectors."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import splat, Vector
from icofabric_sim.terms.shared import add_wrench, Supports
from icofabric_sim.terms.ties.force import add_at_lane, arm_of_point, span_of, stretch_of
from icofabric_sim.terms.ties.record import Ties
import numpy as np


@compiled
def point_speed(
    velocity: np.ndarray, spin: np.ndarray, s: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return the velocity v + omega x arm [m/s] of a point of the body at slot `s`."""
    ox, oy, oz = spin[0, s], spin[1, s], spin[2, s]
    return (
        velocity[0, s] + (oy * z - oz * y), velocity[1, s] + (oz * x - ox * z),
        velocity[2, s] + (ox * y - oy * x))


@compiled
def add_velocity_force(
    ties: Ties | None, supports: Supports | None, inverse_mass: float, inverse_inertia: float,
    position: np.ndarray, orientation: np.ndarray, linear_velocity: np.ndarray,
    angular_velocity: np.ndarray, linear: np.ndarray, angular: np.ndarray, block: int, s: int,
    spent: Vector
) -> Vector:
    """Add forces c dl/dt along the connectors; return `spent` plus half of each power [W]."""
    if ties is None:
        return spent
    else:
        return add_damping(
            ties.damping, ties, supports, inverse_mass, inverse_inertia, position, orientation,
            linear_velocity, angular_velocity, linear, angular, block, s, spent)


@compiled
def add_damping(
    damping: np.ndarray | None, ties: Ties, supports: Supports | None, inverse_mass: float,
    inverse_inertia: float, position: np.ndarray, orientation: np.ndarray, velocity: np.ndarray,
    spin: np.ndarray, linear: np.ndarray, angular: np.ndarray, block: int, s: int, spent: Vector
) -> Vector:
    """Add damping forces, if there are any, as `add_velocity_force`."""
    if damping is None:
        return spent
    else:
        zero = splat(0.0)
        fx, fy, fz, tx, ty, tz = zero, zero, zero, zero, zero, zero
        for r in range(ties.start[block], ties.start[block + 1]):
            if ties.present[r] == 0:
                continue
            sx, sy, sz, ux, uy, uz = span_of(ties, position, orientation, r)
            length, _, _ = stretch_of(ties, r, ux, uy, uz)
            i, j = ties.own[r], ties.other[r]
            vx, vy, vz = point_speed(velocity, spin, i, sx, sy, sz)
            qx, qy, qz = arm_of_point(orientation, j, ties.far, r)
            wx, wy, wz = point_speed(velocity, spin, j, qx, qy, qz)
            rate = (ux * (wx - vx) + uy * (wy - vy) + uz * (wz - vz)) / length
            pull, lane = damping[r] * rate / length, ties.lane[r]
            px, py, pz = pull * ux, pull * uy, pull * uz
            fx, fy, fz = (
                add_at_lane(lane, px, fx), add_at_lane(lane, py, fy), add_at_lane(lane, pz, fz))
            tx = add_at_lane(lane, sy * pz - sz * py, tx)
            ty = add_at_lane(lane, sz * px - sx * pz, ty)
            tz = add_at_lane(lane, sx * py - sy * px, tz)
            spent = add_at_lane(lane, 0.5 * damping[r] * rate * rate, spent)
        add_wrench(
            supports, inverse_mass, inverse_inertia, linear, angular, s, fx, fy, fz, tx, ty, tz)
        return spent
