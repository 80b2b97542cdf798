# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Damping forces."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    Vector,
    where,
)
from icofabric_sim.terms.damping.record import Damping
from icofabric_sim.terms.shared import add_wrench, coefficient_of, Links, SMALLEST_SQUARE, Supports
import numpy as np


@compiled
def add_velocity_force(
    damping: Damping | None, links: Links | None, supports: Supports | None, inverse_mass: float,
    inverse_inertia: float, position: np.ndarray, points: np.ndarray, speeds: np.ndarray,
    linear: np.ndarray, angular: np.ndarray, block: int, s: int, spent: Vector
) -> Vector:
    """
    Add damping forces c dl/dt along the connectors; return `spent` plus the dissipated power [W].

    With u from this end to the other and w their relative velocity the force is c (u . w) u / l^2,
    bit-identical from either end except for its sign. It is frame-invariant: a common rigid motion
    has u . w = 0. Half of the power c (dl/dt)^2 of each connector counts for either end.
    """
    if damping is None:
        return spent
    if links is None:
        return spent
    zero = splat(0.0)
    taken = zero
    stride = position.shape[1]
    px, py = load(position, 0, s), load(position, 1, s)
    pz = load(position, 2, s)
    fx, fy, fz, tx, ty, tz = zero, zero, zero, zero, zero, zero
    for edge in range(6):
        at = 3 * edge * stride + s
        qx, qy = load_at(points, at), load_at(points, at + stride)
        qz = load_at(points, at + 2 * stride)
        ex, ey, ez = zero, zero, zero
        for link in range(2 * edge, 2 * edge + 2):
            place = links.place[block, link]
            ux, uy = load_at(points, place) - qx, load_at(points, place + stride) - qy
            uz = load_at(points, place + 2 * stride) - qz
            wx = load_at(speeds, place) - load_at(speeds, at)
            wy = load_at(speeds, place + stride) - load_at(speeds, at + stride)
            wz = load_at(speeds, place + 2 * stride) - load_at(speeds, at + 2 * stride)
            inverse = rsqrt(maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(SMALLEST_SQUARE)))
            rate = fma(ux, wx, fma(uy, wy, uz * wz)) * inverse
            rate = where(bits(links.present[block, link]), rate, zero)
            pull = coefficient_of(damping.own, damping.coefficient, link, s) * rate
            taken = fma(pull, rate, taken)
            pull = pull * inverse
            ex, ey, ez = fma(pull, ux, ex), fma(pull, uy, ey), fma(pull, uz, ez)
        ax, ay, az = qx - px, qy - py, qz - pz
        fx, fy, fz = fx + ex, fy + ey, fz + ez
        tx = fma(ay, ez, tx - az * ey)
        ty = fma(az, ex, ty - ax * ez)
        tz = fma(ax, ey, tz - ay * ex)
    add_wrench(
        supports, inverse_mass, inverse_inertia, linear, angular, s, fx, fy, fz,
        tx, ty, tz)
    return spent + splat(0.5) * taken
