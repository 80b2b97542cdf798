# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
External wrenches on bodies: what they add to the velocities, and the work that they do.

Functions of one row, without branches: the loops over rows are in their callers. A compiled
function with a loop counts the references of all its arrays at every call, which takes ten times
as long as what it computes.
"""

import math

from icofabric_sim.kernels.records import Loads, Model, State, Supports, Varying
from icofabric_sim.kernels.rotations import half_angle_factors, turn_to_world
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
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
import numpy as np

Three = tuple[Vector, Vector, Vector]

# Gauss-Legendre on (0, 1), exact up to degree 9: beyond the order of every method.
_NEAR, _FAR = 0.269234655052841545, 0.453089922969331996
_NEAR_WEIGHT, _FAR_WEIGHT, _MIDDLE_WEIGHT = (
    0.239314335249683234, 0.118463442528094544, 64.0 / 225.0)


@compiled
def kick_load(
    model: Model, loads: Loads, orientation: np.ndarray, velocity: np.ndarray, spin: np.ndarray,
    m: int, s: int, time: float, h: float
) -> None:
    """
    Add h F / M and h N / Lambda of row `m` at `time` [s] to velocities of a block.

    The force acts at its point, the torque adds to the moment of the force.
    """
    force, torque = wrench_of(loads, orientation, loads.wrench[m], s)
    h = h * factor_of(loads.varying, loads.wrench[m], time)
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
    """Inverse masses along x, y, z [1/kg] and inverse inertias [1/(kg m^2)] of a block."""
    if supports is None:
        mass = splat(inverse_mass)
        return mass, mass, mass, splat(inverse_inertia)
    else:
        return (
            load(supports.inverse_mass, 0, s), load(supports.inverse_mass, 1, s),
            load(supports.inverse_mass, 2, s), load(supports.inverse_inertia, 0, s))


@compiled
def factor_of(varying: Varying | None, w: int, time: float) -> float:
    """What wrench `w` is multiplied by at `time` [s]."""
    if varying is None:
        return 1.0
    else:
        after = time - varying.start[w]
        return float(
            varying.value[w] + varying.slope[w] * after
            + varying.height[w] * math.sin(varying.rate[w] * after))


@compiled
def wrench_of(loads: Loads, orientation: np.ndarray, w: int, s: int) -> tuple[Three, Three]:
    """
    Force [N] and torque about the centre [N m] of a wrench on a block, world frame.

    But for the factor of its profile.
    """
    turning = bits(loads.turning[w])
    fx, fy, fz = splat(loads.force[w, 0]), splat(loads.force[w, 1]), splat(loads.force[w, 2])
    tx, ty, tz = splat(loads.torque[w, 0]), splat(loads.torque[w, 1]), splat(loads.torque[w, 2])
    ax, ay, az = turn_to_world(orientation, s, fx, fy, fz)
    fx, fy, fz = where(turning, ax, fx), where(turning, ay, fy), where(turning, az, fz)
    fx, fy, fz = part_along(fx, fy, fz, normal_of(loads.varying, orientation, w, s))
    ax, ay, az = turn_to_world(orientation, s, tx, ty, tz)
    tx, ty, tz = where(turning, ax, tx), where(turning, ay, ty), where(turning, az, tz)
    px, py, pz = point_of(loads, orientation, w, s)
    return (fx, fy, fz), (
        fma(py, fz, tx - pz * fy), fma(pz, fx, ty - px * fz), fma(px, fy, tz - py * fx))


@compiled
def normal_of(varying: Varying | None, orientation: np.ndarray, w: int, s: int) -> Three | None:
    """
    Normals along which alone a wrench pushes blocks, world frame, or zero where all of it acts.
    """
    if varying is None:
        return None
    else:
        return turn_to_world(
            orientation, s, splat(varying.normal[w, 0]), splat(varying.normal[w, 1]),
            splat(varying.normal[w, 2]))


@compiled
def part_along(fx: Vector, fy: Vector, fz: Vector, normal: Three | None) -> Three:
    """The part of a force along a unit normal; all of it where that is zero."""
    if normal is None:
        return fx, fy, fz
    else:
        nx, ny, nz = normal
        along = fma(fx, nx, fma(fy, ny, fz * nz))
        there = fma(nx, nx, fma(ny, ny, nz * nz)) > splat(0.5)
        return (
            where(there, along * nx, fx), where(there, along * ny, fy),
            where(there, along * nz, fz))


@compiled
def point_of(loads: Loads, orientation: np.ndarray, w: int, s: int) -> Three:
    """Where a wrench acts, from the centres of a block [m], world frame."""
    return turn_to_world(
        orientation, s, splat(loads.point[w, 0]), splat(loads.point[w, 1]),
        splat(loads.point[w, 2]))


@compiled
def work_load(loads: Loads, state: State, m: int, s: int, time: float, h: float) -> None:
    """
    Add the work [J] of row `m` on a block over a drift of `h` from `time` on, before it moves.
    """
    power = mean_power(loads.varying, loads, state, loads.wrench[m], s, time, h)
    done = load_at(loads.work, LANES * m)
    more = fma(splat(h), power, done)
    store_at(loads.work, LANES * m, where(bits(loads.lanes[m]), more, done))


@compiled
def mean_power(
    varying: Varying | None, loads: Loads, state: State, w: int, s: int, time: float, h: float
) -> Vector:
    """
    Mean power [W] of a wrench on a block over a drift.

    Exact where the wrench is steady; else by a Gauss rule of order 10, beyond that of any method.
    """
    if varying is None:
        return mean_power_steady(loads, state, w, s, h)
    else:
        normal = varying.normal[w]
        if varying.slope[w] == 0.0 and varying.height[w] == 0.0 and (
                normal[0] == 0.0 and normal[1] == 0.0 and normal[2] == 0.0):
            return splat(varying.value[w]) * mean_power_steady(loads, state, w, s, h)
        near = power_after(loads, state, w, s, time, (0.5 - _NEAR) * h) + power_after(
            loads, state, w, s, time, (0.5 + _NEAR) * h)
        far = power_after(loads, state, w, s, time, (0.5 - _FAR) * h) + power_after(
            loads, state, w, s, time, (0.5 + _FAR) * h)
        middle = power_after(loads, state, w, s, time, 0.5 * h)
        return fma(splat(_NEAR_WEIGHT), near, fma(
            splat(_FAR_WEIGHT), far, splat(_MIDDLE_WEIGHT) * middle))


@compiled
def power_after(
    loads: Loads, state: State, w: int, s: int, time: float, later: float
) -> Vector:
    """Power [W] of a wrench on a block `later` [s] than `time`, after free flight."""
    velocity, spin = state.linear_velocity, state.angular_velocity
    ox, oy, oz = load(spin, 0, s), load(spin, 1, s), load(spin, 2, s)
    cosine, sine = half_angle_factors(later, ox, oy, oz)
    ux, uy, uz = sine * ox, sine * oy, sine * oz
    turning = bits(loads.turning[w])
    gx, gy, gz = splat(loads.force[w, 0]), splat(loads.force[w, 1]), splat(loads.force[w, 2])
    fx, fy, fz = turned(turn_to_world(state.orientation, s, gx, gy, gz), cosine, ux, uy, uz)
    fx, fy, fz = where(turning, fx, gx), where(turning, fy, gy), where(turning, fz, gz)
    normal = normal_of(loads.varying, state.orientation, w, s)
    fx, fy, fz = part_along(fx, fy, fz, turned_normal(normal, cosine, ux, uy, uz))
    px, py, pz = turned(point_of(loads, state.orientation, w, s), cosine, ux, uy, uz)
    # A torque that turns about omega keeps its part along it.
    hx, hy, hz = splat(loads.torque[w, 0]), splat(loads.torque[w, 1]), splat(loads.torque[w, 2])
    tx, ty, tz = turn_to_world(state.orientation, s, hx, hy, hz)
    tx, ty, tz = where(turning, tx, hx), where(turning, ty, hy), where(turning, tz, hz)
    vx = load(velocity, 0, s) + (oy * pz - oz * py)
    vy = load(velocity, 1, s) + (oz * px - ox * pz)
    vz = load(velocity, 2, s) + (ox * py - oy * px)
    power = fma(fx, vx, fma(fy, vy, fma(fz, vz, fma(tx, ox, fma(ty, oy, tz * oz)))))
    return splat(factor_of(loads.varying, w, time + later)) * power


@compiled
def turned(vector: Three, cosine: Vector, ux: Vector, uy: Vector, uz: Vector) -> Three:
    """A vector turned by the unit quaternion (u, cosine)."""
    x, y, z = vector
    two = splat(2.0)
    tx, ty, tz = two * (uy * z - uz * y), two * (uz * x - ux * z), two * (ux * y - uy * x)
    return (
        x + fma(cosine, tx, uy * tz - uz * ty), y + fma(cosine, ty, uz * tx - ux * tz),
        z + fma(cosine, tz, ux * ty - uy * tx))


@compiled
def turned_normal(
    normal: Three | None, cosine: Vector, ux: Vector, uy: Vector, uz: Vector
) -> Three | None:
    """The same for a normal, if there is one."""
    if normal is None:
        return None
    else:
        return turned(normal, cosine, ux, uy, uz)


@compiled
def mean_power_steady(loads: Loads, state: State, w: int, s: int, h: float) -> Vector:
    """
    Mean power [W] of a steady wrench on a block over a drift of `h`.

    Exact: the body moves at constant v and turns at constant omega. A wrench that turns with it
    keeps its moment about omega, and its force turns by omega t; one that does not turn has the
    power F . v + N . omega + F . d/dt p, where d/dt p = omega x p turns with the body as p does.
    """
    velocity, spin = state.linear_velocity, state.angular_velocity
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
    return where(turning, with_body, fixed)


@compiled
def keep_work(loads: Loads | None, first: int, last: int) -> None:
    """Note the work so far, to come back to."""
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
