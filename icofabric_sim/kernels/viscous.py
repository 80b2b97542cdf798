# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Damping along connectors.

For slopes of Runge-Kutta methods: accelerations are added to the slopes of velocity and spin of a
block, and the dissipated power [W] is returned.
"""

from icofabric_sim.kernels.records import Damping, Links, Model, State
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    store_at,
    Vector,
    where,
)
from icofabric_sim.terms.shared import add_wrench, SMALLEST_SQUARE
import numpy as np


@compiled
def place_speeds(
    damping: Damping | None, state: State, points: np.ndarray, speeds: np.ndarray, s: int
) -> None:
    """
    Write velocities v + omega x arm [m/s] of the attachment points of a block, laid out as points.
    """
    if damping is None:
        return
    stride = state.position.shape[1]
    px, py = load(state.position, 0, s), load(state.position, 1, s)
    pz = load(state.position, 2, s)
    vx, vy = load(state.linear_velocity, 0, s), load(state.linear_velocity, 1, s)
    vz, ox = load(state.linear_velocity, 2, s), load(state.angular_velocity, 0, s)
    oy, oz = load(state.angular_velocity, 1, s), load(state.angular_velocity, 2, s)
    for edge in range(6):
        at = 3 * edge * stride + s
        ax, ay = load_at(points, at) - px, load_at(points, at + stride) - py
        az = load_at(points, at + 2 * stride) - pz
        store_at(speeds, at, fma(oy, az, vx - oz * ay))
        store_at(speeds, at + stride, fma(oz, ax, vy - ox * az))
        store_at(speeds, at + 2 * stride, fma(ox, ay, vz - oy * ax))


@compiled
def add_damping(
    damping: Damping | None, links: Links | None, model: Model, state: State, points: np.ndarray,
    speeds: np.ndarray, linear: np.ndarray, angular: np.ndarray, block: int, s: int
) -> Vector:
    """
    Add damping forces c dl/dt along the connectors; return the dissipated power [W].

    With u from this end to the other and w their relative velocity the force is c (u . w) u / l^2,
    bit-identical from either end except for its sign. It is frame-invariant: a common rigid motion
    has u . w = 0. Half of the power c (dl/dt)^2 of each connector counts for either end.
    """
    zero = splat(0.0)
    spent = zero
    if damping is None:
        return spent
    if links is None:
        return spent
    stride = state.position.shape[1]
    px, py = load(state.position, 0, s), load(state.position, 1, s)
    pz = load(state.position, 2, s)
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
            spent = fma(pull, rate, spent)
            pull = pull * inverse
            ex, ey, ez = fma(pull, ux, ex), fma(pull, uy, ey), fma(pull, uz, ez)
        ax, ay, az = qx - px, qy - py, qz - pz
        fx, fy, fz = fx + ex, fy + ey, fz + ez
        tx = fma(ay, ez, tx - az * ey)
        ty = fma(az, ex, ty - ax * ez)
        tz = fma(ax, ey, tz - ay * ex)
    add_wrench(
        model.supports, model.inverse_mass, model.inverse_inertia, linear, angular, s, fx, fy, fz,
        tx, ty, tz)
    return splat(0.5) * spent


@compiled
def coefficient_of(
    own: np.ndarray | None, coefficient: float, link: int, s: int
) -> Vector:
    """Return the coefficient of a connector at each body of a block, individual or common."""
    if own is None:
        return splat(coefficient)
    else:
        return load(own, link, s)
