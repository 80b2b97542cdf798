# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
External wrenches on bodies: their effect on velocities, and their work.

Functions of one row, without branches: the loops over rows are in their callers. A compiled
function with a loop counts the references of all its arrays at every call, which takes ten times
as long as the computation itself.
"""

from icofabric_sim.kernels.profiles import (
    FAR_WEIGHT,
    Five,
    is_steady,
    MIDDLE_WEIGHT,
    NEAR_WEIGHT,
    NODES,
)
from icofabric_sim.kernels.records import Loads, Model, State, Tractions, Varying
from icofabric_sim.kernels.rotations import (
    axes_of_lanes,
    half_angle_factors,
    Three,
    turn_to_world,
)
from icofabric_sim.kernels.runtime.compiled import compiled, inlined
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
from icofabric_sim.kernels.tractions import mean_traction_power, three_at, traction_wrench
from icofabric_sim.kernels.turning import mean_of_turning, turned
from icofabric_sim.terms.shared import inverses
import numpy as np


@compiled
def kick_load(
    model: Model, loads: Loads, orientation: np.ndarray, velocity: np.ndarray, spin: np.ndarray,
    m: int, s: int, h: float
) -> None:
    """
    Add h F / M and h N / Lambda of row `m` to velocities of a block.

    The force acts at its point, the torque adds to the moment of the force. `h` [s] includes the
    factor of the profile.
    """
    force, torque = wrench_of_row(loads.tractions, loads, orientation, m, s)
    keep_wrench(loads.tractions, loads, m, force, torque)
    kick_by(model, loads, velocity, spin, m, s, h, force, torque)


@compiled
def kick_load_again(
    model: Model, loads: Loads, orientation: np.ndarray, velocity: np.ndarray, spin: np.ndarray,
    m: int, s: int, h: float
) -> None:
    """Add a second kick directly after a `kick_load` of this row at the same orientations."""
    force, torque = kept_wrench(loads.tractions, loads, orientation, m, s)
    kick_by(model, loads, velocity, spin, m, s, h, force, torque)


@inlined
def keep_wrench(
    tractions: Tractions | None, loads: Loads, m: int, force: Three, torque: Three
) -> None:
    """Store the wrench of a surface force, which is a sum of many numbers."""
    if tractions is None:
        return
    else:
        if loads.wrench[m] >= tractions.first:
            at = 6 * LANES * tractions.place[m]
            for k in range(3):
                store_at(tractions.kept, at + k * LANES, force[k])
                store_at(tractions.kept, at + (k + 3) * LANES, torque[k])


@inlined
def kept_wrench(
    tractions: Tractions | None, loads: Loads, orientation: np.ndarray, m: int, s: int
) -> tuple[Three, Three]:
    """
    Return force [N] and torque [N m] that `keep_wrench` stored; compute those of other loads.
    """
    if tractions is None:
        return wrench_of(loads, orientation, loads.wrench[m], s)
    else:
        if loads.wrench[m] >= tractions.first:
            at = 6 * LANES * tractions.place[m]
            return three_at(tractions.kept, at), three_at(tractions.kept, at + 3 * LANES)
        return wrench_of(loads, orientation, loads.wrench[m], s)


@inlined
def kick_by(
    model: Model, loads: Loads, velocity: np.ndarray, spin: np.ndarray, m: int, s: int, h: float,
    force: Three, torque: Three
) -> None:
    """Add the velocity changes of a force [N] and a torque [N m] of row `m` over `h` [s]."""
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


@inlined
def wrench_of_row(
    tractions: Tractions | None, loads: Loads, orientation: np.ndarray, m: int, s: int
) -> tuple[Three, Three]:
    """
    Return force [N] and torque about the centre [N m] of row `m` on a block, world frame.

    The factor of its profile is not included.
    """
    if tractions is None:
        return wrench_of(loads, orientation, loads.wrench[m], s)
    else:
        if loads.wrench[m] >= tractions.first:
            return traction_wrench(
                tractions.turning, tractions.fixed, tractions.sliding, tractions.place[m],
                axes_of_lanes(orientation, s))
        return wrench_of(loads, orientation, loads.wrench[m], s)


@compiled
def wrench_of(loads: Loads, orientation: np.ndarray, w: int, s: int) -> tuple[Three, Three]:
    """
    Return force [N] and torque about the centre [N m] of a wrench on a block, world frame.

    The factor of its profile is not included.
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
    """Return the point of attack of a wrench, from the centres of a block [m], world frame."""
    return turn_to_world(
        orientation, s, splat(loads.point[w, 0]), splat(loads.point[w, 1]),
        splat(loads.point[w, 2]))


@compiled
def work_load(loads: Loads, state: State, m: int, s: int, h: float, factors: Five) -> None:
    """
    Add the work [J] of row `m` on a block over a drift of `h` [s], before the block moves.

    `factors`: values of its profile during the drift, see `factors_over`.
    """
    power = mean_power_of_row(loads.tractions, loads, state, m, s, h, factors)
    done = load_at(loads.work, LANES * m)
    more = fma(splat(h), power, done)
    store_at(loads.work, LANES * m, where(bits(loads.lanes[m]), more, done))


@compiled
def mean_power_of_row(
    tractions: Tractions | None, loads: Loads, state: State, m: int, s: int, h: float,
    factors: Five
) -> Vector:
    """Return the mean power [W] of row `m` on a block over a drift of `h` [s]."""
    if tractions is None:
        return mean_power(loads.varying, loads, state, loads.wrench[m], s, h, factors)
    else:
        if loads.wrench[m] >= tractions.first:
            return mean_traction_power(
                tractions.sliding, tractions, loads.varying, loads.wrench[m], state,
                tractions.place[m], s, h, factors)
        return mean_power(loads.varying, loads, state, loads.wrench[m], s, h, factors)


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


@inlined
def has_rows(loads: Loads) -> bool:
    """Check that there is at least one load."""
    return loads.wrench.shape[0] != 0


@compiled
def keep_work(loads: Loads, first: int, last: int) -> None:
    """Store the work so far, to restore if a step is rejected."""
    for m in range(loads.start[first], loads.start[last]):
        store_at(loads.earlier_work, LANES * m, load_at(loads.work, LANES * m))
