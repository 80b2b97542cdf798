# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Forces that depend on velocities: damping along connectors, drag, and the magnetic field.

For slopes of Runge-Kutta methods: accelerations are added to the slopes of velocity and spin of a
block, and the dissipated power [W] is returned.
"""

from icofabric_sim.kernels.loads import inverses
from icofabric_sim.kernels.records import Damping, Drag, Links, Magnet, Model, State, Supports
from icofabric_sim.kernels.rotations import turn_to_world
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    store,
    store_at,
    Vector,
    where,
)
import numpy as np

_SMALLEST_SQUARE = 1e-300


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
            inverse = rsqrt(maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(_SMALLEST_SQUARE)))
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
    add_force(
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


@compiled
def add_force(
    supports: Supports | None, inverse_mass: float, inverse_inertia: float, linear: np.ndarray,
    angular: np.ndarray, s: int, fx: Vector, fy: Vector, fz: Vector, tx: Vector, ty: Vector,
    tz: Vector
) -> None:
    """
    Add the accelerations of forces [N] and torques [N m] to slopes; none along held freedoms.
    """
    mx, my, mz, inertia = inverses(supports, inverse_mass, inverse_inertia, s)
    store(linear, 0, s, fma(mx, fx, load(linear, 0, s)))
    store(linear, 1, s, fma(my, fy, load(linear, 1, s)))
    store(linear, 2, s, fma(mz, fz, load(linear, 2, s)))
    store(angular, 0, s, fma(inertia, tx, load(angular, 0, s)))
    store(angular, 1, s, fma(inertia, ty, load(angular, 1, s)))
    store(angular, 2, s, fma(inertia, tz, load(angular, 2, s)))


@compiled
def add_drag(
    drag: Drag | None, model: Model, state: State, linear: np.ndarray, angular: np.ndarray, s: int,
    spent: Vector
) -> Vector:
    """
    Add drag -gamma v on centres and -gamma' omega on spins; return `spent` plus its power [W].
    """
    if drag is None:
        return spent
    else:
        minus, turning = splat(-drag.linear), splat(-drag.angular)
        vx, vy = load(state.linear_velocity, 0, s), load(state.linear_velocity, 1, s)
        vz, ox = load(state.linear_velocity, 2, s), load(state.angular_velocity, 0, s)
        oy, oz = load(state.angular_velocity, 1, s), load(state.angular_velocity, 2, s)
        add_force(
            model.supports, model.inverse_mass, model.inverse_inertia, linear, angular, s,
            minus * vx, minus * vy, minus * vz, turning * ox, turning * oy, turning * oz)
        speed = fma(vx, vx, fma(vy, vy, vz * vz))
        spin = fma(ox, ox, fma(oy, oy, oz * oz))
        return spent - fma(minus, speed, turning * spin)


@compiled
def add_magnetic(
    magnet: Magnet | None, model: Model, state: State, linear: np.ndarray, angular: np.ndarray,
    s: int
) -> None:
    """
    Add the magnetic terms of the Lorentz force on a charged shell with a dipole; they do no work.

    Integrated over the charges at r from the centre, which move with v + omega x r: with
    charge q, dipole p and an isotropic second moment s 1, s = q Lambda / (2 M) (that of the
    shell's mass, whose inertia is Lambda 1 = integral (r^2 1 - r r) dm, times q / M),
    F = q v x B + (omega x p) x B, and because (omega x r) x B = r (omega . B) - omega (r . B),
    N = p x (v x B) + s omega x B. Their power F . v + N . omega vanishes.
    """
    if magnet is None:
        return
    bx, by, bz = splat(magnet.field[0]), splat(magnet.field[1]), splat(magnet.field[2])
    vx, vy = load(state.linear_velocity, 0, s), load(state.linear_velocity, 1, s)
    vz, ox = load(state.linear_velocity, 2, s), load(state.angular_velocity, 0, s)
    oy, oz = load(state.angular_velocity, 1, s), load(state.angular_velocity, 2, s)
    px, py, pz = turn_to_world(
        state.orientation, s, load(magnet.moment, 0, s), load(magnet.moment, 1, s),
        load(magnet.moment, 2, s))
    charge, second = load(magnet.charge, 0, s), load(magnet.second, 0, s)
    # The current of the whole body, q v + omega x p, then v x B.
    cx = fma(charge, vx, oy * pz - oz * py)
    cy = fma(charge, vy, oz * px - ox * pz)
    cz = fma(charge, vz, ox * py - oy * px)
    ex, ey, ez = vy * bz - vz * by, vz * bx - vx * bz, vx * by - vy * bx
    add_force(
        model.supports, model.inverse_mass, model.inverse_inertia, linear, angular, s,
        cy * bz - cz * by, cz * bx - cx * bz, cx * by - cy * bx,
        fma(second, oy * bz - oz * by, py * ez - pz * ey),
        fma(second, oz * bx - ox * bz, pz * ex - px * ez),
        fma(second, ox * by - oy * bx, px * ey - py * ex))
