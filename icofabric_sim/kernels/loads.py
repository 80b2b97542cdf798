# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
External wrenches on bodies: what they add to the velocities, and the work that they do.

Functions of one row, without branches: the loops over rows are in their callers. A compiled
function with a loop counts the references of all its arrays at every call, which takes ten times
as long as what it computes.
"""

from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.lanes import (
    bits,
    fma,
    LANES,
    load,
    load_at,
    splat,
    store,
    store_at,
    Vector,
    where,
)
from icofabric_sim.kernels.records import Loads, Model, State, Supports
from icofabric_sim.kernels.rotations import half_angle_factors, turn_to_world
import numpy as np

Three = tuple[Vector, Vector, Vector]


@compiled
def kick_load(model: Model, loads: Loads, state: State, m: int, s: int, h: float) -> None:
    """
    Add h F / M and h N / Lambda of row `m` to the velocities of the block at slot `s`.

    The force acts at its point, the torque adds to the moment of the force.
    """
    velocity, spin = state.linear_velocity, state.angular_velocity
    force, torque = wrench_of(loads, state.orientation, loads.wrench[m], s)
    mx, my, mz, inertia = inverses(
        model.supports, model.inverse_mass, model.inverse_inertia, s)
    step = where(bits(loads.lanes[m]), splat(h), splat(0.0))
    inertia = step * inertia
    store(velocity, 0, s, fma(step * mx, force[0], load(velocity, 0, s)))
    store(velocity, 1, s, fma(step * my, force[1], load(velocity, 1, s)))
    store(velocity, 2, s, fma(step * mz, force[2], load(velocity, 2, s)))
    store(spin, 0, s, fma(inertia, torque[0], load(spin, 0, s)))
    store(spin, 1, s, fma(inertia, torque[1], load(spin, 1, s)))
    store(spin, 2, s, fma(inertia, torque[2], load(spin, 2, s)))


@compiled
def inverses(
    supports: Supports | None, inverse_mass: float, inverse_inertia: float, s: int
) -> tuple[Vector, Vector, Vector, Vector]:
    """
    Inverse masses along x, y, z [1/kg] and inverse inertias [1/(kg m^2)] of a block.
    """
    if supports is None:
        mass = splat(inverse_mass)
        return mass, mass, mass, splat(inverse_inertia)
    else:
        return (
            load(supports.inverse_mass, 0, s), load(supports.inverse_mass, 1, s),
            load(supports.inverse_mass, 2, s), load(supports.inverse_inertia, 0, s))


@compiled
def wrench_of(loads: Loads, orientation: np.ndarray, w: int, s: int) -> tuple[Three, Three]:
    """
    Force [N] and torque about the centre [N m] of a wrench on a block, world frame.
    """
    turning = bits(loads.turning[w])
    fx, fy, fz = splat(loads.force[w, 0]), splat(loads.force[w, 1]), splat(loads.force[w, 2])
    tx, ty, tz = splat(loads.torque[w, 0]), splat(loads.torque[w, 1]), splat(loads.torque[w, 2])
    ax, ay, az = turn_to_world(orientation, s, fx, fy, fz)
    fx, fy, fz = where(turning, ax, fx), where(turning, ay, fy), where(turning, az, fz)
    ax, ay, az = turn_to_world(orientation, s, tx, ty, tz)
    tx, ty, tz = where(turning, ax, tx), where(turning, ay, ty), where(turning, az, tz)
    px, py, pz = point_of(loads, orientation, w, s)
    return (fx, fy, fz), (
        fma(py, fz, tx - pz * fy), fma(pz, fx, ty - px * fz), fma(px, fy, tz - py * fx))


@compiled
def point_of(loads: Loads, orientation: np.ndarray, w: int, s: int) -> Three:
    """
    Where a wrench acts, from the centres of a block [m], world frame.
    """
    return turn_to_world(
        orientation, s, splat(loads.point[w, 0]), splat(loads.point[w, 1]),
        splat(loads.point[w, 2]))


@compiled
def work_load(loads: Loads, state: State, m: int, s: int, h: float) -> None:
    """
    Add the work [J] of row `m` on a block over a drift of `h`, before the drift moves it.

    Exact: the body moves at constant v and turns at constant omega. A wrench that turns with it
    keeps its moment about omega, and its force turns by omega t; one that does not turn has the
    power F . v + N . omega + F . d/dt p, where d/dt p = omega x p turns with the body as p does.
    """
    velocity, spin = state.linear_velocity, state.angular_velocity
    w = loads.wrench[m]
    turning = bits(loads.turning[w])
    vx, vy, vz = load(velocity, 0, s), load(velocity, 1, s), load(velocity, 2, s)
    ox, oy, oz = load(spin, 0, s), load(spin, 1, s), load(spin, 2, s)
    force, torque = wrench_of(loads, state.orientation, w, s)
    fx, fy, fz = force
    px, py, pz = point_of(loads, state.orientation, w, s)
    cx, cy, cz = oy * pz - oz * py, oz * px - ox * pz, ox * py - oy * px
    # What turns: the force, or d/dt p.
    mx, my, mz = mean_of_turning(
        where(turning, fx, cx), where(turning, fy, cy), where(turning, fz, cz), ox, oy, oz, h)
    with_body = fma(mx, vx, fma(my, vy, mz * vz))
    with_body = fma(torque[0], ox, fma(torque[1], oy, fma(torque[2], oz, with_body)))
    fixed = fma(fx, vx + mx, fma(fy, vy + my, fz * (vz + mz)))
    fixed = fma(splat(loads.torque[w, 0]), ox, fma(
        splat(loads.torque[w, 1]), oy, fma(splat(loads.torque[w, 2]), oz, fixed)))
    done = load_at(loads.work, LANES * m)
    more = fma(splat(h), where(turning, with_body, fixed), done)
    store_at(loads.work, LANES * m, where(bits(loads.lanes[m]), more, done))


@compiled
def keep_work(loads: Loads | None, first: int, last: int) -> None:
    """
    Note the work so far, to come back to.
    """
    if loads is None:
        return
    for m in range(loads.start[first], loads.start[last]):
        store_at(loads.earlier_work, LANES * m, load_at(loads.work, LANES * m))


@compiled
def mean_of_turning(
    fx: Vector, fy: Vector, fz: Vector, ox: Vector, oy: Vector, oz: Vector, h: float
) -> Three:
    """
    Mean over `h` of a vector that turns at omega from `f` on: the integral of eq 22's rotation.

    f + (1 - cos x) / x^2 (h omega x f) + (x - sin x) / x^3 (h omega x (h omega x f)), with
    x = |omega| h.
    """
    step, one = splat(h), splat(1.0)
    # cos(x / 2), and sin(x / 2) / x.
    cosine, sine = half_angle_factors(h, ox, oy, oz)
    sine = sine * splat(1.0 / h)
    ux, uy, uz = step * ox, step * oy, step * oz
    square = fma(ux, ux, fma(uy, uy, uz * uz))
    first = splat(2.0) * sine * sine
    # Horner's rule below 1, where the difference would cancel; the next term is 1e-20.
    series = fma(square, splat(-1.0 / 121645100408832000.0), splat(1.0 / 355687428096000.0))
    series = fma(square, series, splat(-1.0 / 1307674368000.0))
    series = fma(square, series, splat(1.0 / 6227020800.0))
    series = fma(square, series, splat(-1.0 / 39916800.0))
    series = fma(square, series, splat(1.0 / 362880.0))
    series = fma(square, series, splat(-1.0 / 5040.0))
    series = fma(square, series, splat(1.0 / 120.0))
    small = square < one
    divisor = where(small, one, square)
    direct = (one - splat(2.0) * sine * cosine) / divisor
    second = where(small, splat(1.0 / 6.0) - square * series, direct)
    cx, cy, cz = uy * fz - uz * fy, uz * fx - ux * fz, ux * fy - uy * fx
    dx, dy, dz = uy * cz - uz * cy, uz * cx - ux * cz, ux * cy - uy * cx
    return (
        fx + fma(first, cx, second * dx), fy + fma(first, cy, second * dy),
        fz + fma(first, cz, second * dz))
