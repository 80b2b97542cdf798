# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Work of wrenches over a drift."""

from icofabric_sim.kernels.rotations import half_angle_factors, turn_to_world
from icofabric_sim.kernels.runtime.compiled import compiled, inlined
from icofabric_sim.kernels.runtime.lanes import bits, fma, load, splat, Vector, where
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.terms.loads import add_row_work, is_wrench, Loads
from icofabric_sim.terms.profiles import (
    factors_over,
    FAR_WEIGHT,
    Five,
    is_steady,
    MIDDLE_WEIGHT,
    NEAR_WEIGHT,
    NODES,
    Varying,
)
from icofabric_sim.terms.shared import State
from icofabric_sim.terms.turning import mean_of_turning, turned
from icofabric_sim.terms.wrenches.force import point_of, wrench_of
import numpy as np


@inlined
def work_row(
    drives: Record | None, anchors: Record | None, tractions: Record | None,
    varying: Varying | None, loads: Loads, state: State, m: int, s: int, time: float, h: float,
    known: int, factors: Five
) -> tuple[int, Five]:
    """
    Add the work [J] of row `m` on a block over a drift of `h` [s], before the block moves.

    Return the number of the wrench and the factors of its profile during the drift.
    """
    if is_wrench(drives, anchors, tractions, loads.wrench[m]):
        if loads.wrench[m] != known:
            known = np.int64(loads.wrench[m])  # type: ignore[assignment]
            factors = factors_over(varying, known, time, h)
        add_row_work(
            loads, m, h, mean_power(varying, loads, state, loads.wrench[m], s, h, factors))
    return known, factors


@compiled
def mean_power(
    varying: Varying | None, loads: Loads, state: State, w: int, s: int, h: float, factors: Five
) -> Vector:
    """
    Return the mean power [W] of a wrench on a block over a drift.

    Exact for a steady wrench; else by a Gauss rule of order 10, beyond that of any method.
    """
    if varying is None:
        return mean_power_steady(loads, state, w, s, h)
    else:
        if is_steady(varying, w):
            return splat(factors[0]) * mean_power_steady(loads, state, w, s, h)
        near = power_after(loads, state, w, s, NODES[1] * h, factors[1]) + power_after(
            loads, state, w, s, NODES[3] * h, factors[3])
        far = power_after(loads, state, w, s, NODES[0] * h, factors[0]) + power_after(
            loads, state, w, s, NODES[4] * h, factors[4])
        middle = power_after(loads, state, w, s, NODES[2] * h, factors[2])
        return fma(splat(NEAR_WEIGHT), near, fma(
            splat(FAR_WEIGHT), far, splat(MIDDLE_WEIGHT) * middle))


@compiled
def power_after(
    loads: Loads, state: State, w: int, s: int, later: float, factor: float
) -> Vector:
    """
    Return the power [W] of a wrench on a block after `later` [s] of flight, times its `factor`.
    """
    velocity, spin = state.linear_velocity, state.angular_velocity
    ox, oy, oz = load(spin, 0, s), load(spin, 1, s), load(spin, 2, s)
    cosine, sine = half_angle_factors(later, ox, oy, oz)
    ux, uy, uz = sine * ox, sine * oy, sine * oz
    turning = bits(loads.turning[w])
    gx, gy, gz = splat(loads.force[w, 0]), splat(loads.force[w, 1]), splat(loads.force[w, 2])
    fx, fy, fz = turned(turn_to_world(state.orientation, s, gx, gy, gz), cosine, ux, uy, uz)
    fx, fy, fz = where(turning, fx, gx), where(turning, fy, gy), where(turning, fz, gz)
    px, py, pz = turned(point_of(loads, state.orientation, w, s), cosine, ux, uy, uz)
    # A torque that turns about omega keeps its component along omega.
    hx, hy, hz = splat(loads.torque[w, 0]), splat(loads.torque[w, 1]), splat(loads.torque[w, 2])
    tx, ty, tz = turn_to_world(state.orientation, s, hx, hy, hz)
    tx, ty, tz = where(turning, tx, hx), where(turning, ty, hy), where(turning, tz, hz)
    vx = load(velocity, 0, s) + (oy * pz - oz * py)
    vy = load(velocity, 1, s) + (oz * px - ox * pz)
    vz = load(velocity, 2, s) + (ox * py - oy * px)
    power = fma(fx, vx, fma(fy, vy, fma(fz, vz, fma(tx, ox, fma(ty, oy, tz * oz)))))
    return splat(factor) * power


@compiled
def mean_power_steady(loads: Loads, state: State, w: int, s: int, h: float) -> Vector:
    """
    Return the mean power [W] of a steady wrench on a block over a drift of `h`.

    Exact: the body moves at constant v and turns at constant omega. A wrench that turns with it
    keeps its moment about omega, and its force turns by omega t. A wrench that does not turn has
    the power F . v + N . omega + F . d/dt p, where d/dt p = omega x p turns with the body as p
    does.
    """
    velocity, spin = state.linear_velocity, state.angular_velocity
    turning = bits(loads.turning[w])
    vx, vy, vz = load(velocity, 0, s), load(velocity, 1, s), load(velocity, 2, s)
    ox, oy, oz = load(spin, 0, s), load(spin, 1, s), load(spin, 2, s)
    force, torque = wrench_of(loads, state.orientation, w, s)
    fx, fy, fz = force
    px, py, pz = point_of(loads, state.orientation, w, s)
    cx, cy, cz = oy * pz - oz * py, oz * px - ox * pz, ox * py - oy * px
    # The vector that turns: the force, or d/dt p.
    mx, my, mz = mean_of_turning(
        where(turning, fx, cx), where(turning, fy, cy), where(turning, fz, cz), ox, oy, oz, h)
    with_body = fma(mx, vx, fma(my, vy, mz * vz))
    with_body = fma(torque[0], ox, fma(torque[1], oy, fma(torque[2], oz, with_body)))
    fixed = fma(fx, vx + mx, fma(fy, vy + my, fz * (vz + mz)))
    fixed = fma(splat(loads.torque[w, 0]), ox, fma(
        splat(loads.torque[w, 1]), oy, fma(splat(loads.torque[w, 2]), oz, fixed)))
    return where(turning, with_body, fixed)
