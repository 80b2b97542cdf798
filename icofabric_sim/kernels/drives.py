# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Bodies that move on prescribed paths, and the work of the paths.

The bodies of a drive move as one rigid body. An interval of a path is, with t from its start,

    d(t) = d0 + d1 t + d2 t^2 + d3 t^3 + wave sin(rate t + phase)

for the displacement of the middle of the bodies (rows 0-2) [m] and for a rotation vector about it
(rows 3-5) [rad], world axes, beyond a base pose. A path moves some freedoms, or all. Forces move
the other freedoms as if there were no path.
"""

import math

from icofabric_sim.kernels.connectors import Six
from icofabric_sim.kernels.gyration import turning_square_at
from icofabric_sim.kernels.loads import turned
from icofabric_sim.kernels.masses import mass_at, masses_of
from icofabric_sim.kernels.records import Anchors, Drives, Gyration, Loads, Model, State
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


@compiled
def is_wrench(drives: Drives | None, anchors: Anchors | None, number: int) -> bool:
    """
    Check that a row of the loads is a wrench; others are drives, the first of them number -1.
    """
    if drives is None and anchors is None:
        return True
    return number >= 0


@compiled
def path_of(drives: Drives, number: int) -> int:
    """Return the number of the path of a row of the loads; negative if the row has no path."""
    p = -1 - number
    return p if p < drives.start.shape[0] else -1


@compiled
def displacement(drives: Drives, p: int, k: int, after: float) -> float:
    """Return coordinate `k` of path `p` at a time `after` [s] the start of its interval."""
    cubic = drives.cubic
    return float(
        cubic[p, 0, k] + after * (
            cubic[p, 1, k] + after * (cubic[p, 2, k] + after * cubic[p, 3, k]))
        + drives.wave[p, k] * math.sin(drives.rate[p] * after + drives.phase[p]))


@compiled
def velocity(drives: Drives, p: int, k: int, after: float) -> float:
    """
    Return the derivative of coordinate `k` of path `p` at a time `after` [s] the interval's start.
    """
    cubic, rate = drives.cubic, drives.rate[p]
    return float(
        cubic[p, 1, k] + after * (2.0 * cubic[p, 2, k] + after * (3.0 * cubic[p, 3, k]))
        + drives.wave[p, k] * rate * math.cos(rate * after + drives.phase[p]))


@compiled
def place_row(
    drives: Drives | None, loads: Loads, state: State, m: int, s: int, time: float
) -> None:
    """
    Place the bodies of row `m` in the block at slot `s` on their path at `time` [s].

    Set positions, orientations and velocities. With the rotation vector r, x = |r| and Q = exp(r)
    Q0, omega = r' + (1 - cos x) / x^2 r x r' + (x - sin x) / x^3 r x (r x r').
    """
    if drives is None:
        return
    else:
        p = path_of(drives, loads.wrench[m])
        if p < 0:
            return
        after = time - drives.start[p]
        rx, ry = displacement(drives, p, 3, after), displacement(drives, p, 4, after)
        rz = displacement(drives, p, 5, after)
        ax, ay = velocity(drives, p, 3, after), velocity(drives, p, 4, after)
        az = velocity(drives, p, 5, after)
        square = rx * rx + ry * ry + rz * rz
        # Below this square the next terms of the series are below rounding.
        if square > 1e-4:
            angle = math.sqrt(square)
            half = math.sin(0.5 * angle) / angle
            cosine = math.cos(0.5 * angle)
            second = 2.0 * half * half
            third = (angle - math.sin(angle)) / (square * angle)
        else:
            half = 0.5 - square * (1.0 / 48.0 - square * (1.0 / 3840.0 - square / 645120.0))
            cosine = 1.0 - square * (0.125 - square * (1.0 / 384.0 - square / 46080.0))
            second = 0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0 - square / 40320.0))
            third = 1.0 / 6.0 - square * (
                1.0 / 120.0 - square * (1.0 / 5040.0 - square / 362880.0))
        bx, by, bz = ry * az - rz * ay, rz * ax - rx * az, rx * ay - ry * ax
        cx, cy, cz = ry * bz - rz * by, rz * bx - rx * bz, rx * by - ry * bx
        ox = splat(ax + second * bx + third * cx)
        oy = splat(ay + second * by + third * cy)
        oz = splat(az + second * bz + third * cz)
        # Q = exp(r) Q0.
        ux, uy, uz = half * rx, half * ry, half * rz
        gx, gy = drives.turn[p, 0], drives.turn[p, 1]
        gz, gw = drives.turn[p, 2], drives.turn[p, 3]
        qx = splat(cosine * gx + ux * gw + uy * gz - uz * gy)
        qy = splat(cosine * gy + uy * gw + uz * gx - ux * gz)
        qz = splat(cosine * gz + uz * gw + ux * gy - uy * gx)
        qw = splat(cosine * gw - ux * gx - uy * gy - uz * gz)
        mine = bits(loads.lanes[m])
        wx, wy, wz = turned(
            (load(drives.arm, 0, s), load(drives.arm, 1, s), load(drives.arm, 2, s)),
            qw, qx, qy, qz)
        place, speed, spin = state.position, state.linear_velocity, state.angular_velocity
        arms = wx, wy, wz
        turning = oy * wz - oz * wy, oz * wx - ox * wz, ox * wy - oy * wx
        for k in range(3):
            if drives.moves[p, k]:
                put(place, k, s, mine, splat(
                    drives.base[p, k] + displacement(drives, p, k, after)) + arms[k])
                put(speed, k, s, mine, splat(velocity(drives, p, k, after)) + turning[k])
        if drives.moves[p, 3]:
            put(spin, 0, s, mine, ox)
            put(spin, 1, s, mine, oy)
            put(spin, 2, s, mine, oz)
            turn_bodies(drives.first, state.orientation, s, mine, (qx, qy, qz), qw)


@compiled
def put(array: np.ndarray, k: int, s: int, mine: Vector, value: Vector) -> None:
    """Write the lanes of the mask `mine`."""
    store(array, k, s, where(mine, value, load(array, k, s)))


@compiled
def turn_bodies(
    first: np.ndarray, orientation: np.ndarray, s: int, mine: Vector,
    axis: tuple[Vector, Vector, Vector], qw: Vector
) -> None:
    """Write the orientations Q q0 of a block, from those at the start."""
    qx, qy, qz = axis
    if orientation.ndim == 2:
        x, y, z, w = load(first, 0, s), load(first, 1, s), load(first, 2, s), load(first, 3, s)
        put(orientation, 0, s, mine, fma(qw, x, fma(qx, w, qy * z - qz * y)))
        put(orientation, 1, s, mine, fma(qw, y, fma(qy, w, qz * x - qx * z)))
        put(orientation, 2, s, mine, fma(qw, z, fma(qz, w, qx * y - qy * x)))
        put(orientation, 3, s, mine, qw * w - fma(qx, x, fma(qy, y, qz * z)))
    else:
        for i in range(3):
            source, target = first[i], orientation[i]
            x, y, z = turned(
                (load(source, 0, s), load(source, 1, s), load(source, 2, s)), qw, qx, qy, qz)
            put(target, 0, s, mine, x)
            put(target, 1, s, mine, y)
            put(target, 2, s, mine, z)


@compiled
def resist(
    drives: Drives | None, model: Model, loads: Loads, state: State, a: Six, m: int, s: int,
    h: float, again: float
) -> Six:
    """
    Return accelerations of a block without those of the bodies of row `m` along their path.

    The path bears the forces on these bodies. Its work [J] over a kick of `h` is - h (F . v + N .
    omega), the loss of the momentum conjugate to time, so that the energy balance closes with the
    order of the method. Two kicks with the same forces, `h` and `again`, are added one after the
    other: the bits of the work must not depend on whether one call of a kernel takes both.
    """
    if drives is None:
        return a
    else:
        p = path_of(drives, loads.wrench[m])
        if p < 0:
            return a
        mine = bits(loads.lanes[m])
        done = load_at(loads.work, LANES * m)
        power = path_power(model, state, borne(drives, p, a), s)
        more = done - splat(h) * power
        if again != 0.0:
            more = more - splat(again) * power
        store_at(loads.work, LANES * m, where(mine, more, done))
        return without(drives, p, mine, a)


@compiled
def path_power(model: Model, state: State, a: Six, s: int) -> Vector:
    """
    Return the power [W] of the forces that give these accelerations to the bodies of a block.
    """
    speed, spin = state.linear_velocity, state.angular_velocity
    linear = fma(a[0], load(speed, 0, s), fma(a[1], load(speed, 1, s), a[2] * load(speed, 2, s)))
    angular = fma(a[3], load(spin, 0, s), fma(a[4], load(spin, 1, s), a[5] * load(spin, 2, s)))
    mass, inertia = masses_of(model.masses, model.inverse_mass, model.inverse_inertia, s)
    return fma(mass, linear, inertia * angular)


@compiled
def borne(drives: Drives, p: int, a: Six) -> Six:
    """Return accelerations along the freedoms that path `p` moves, zero along the others."""
    zero, moves = splat(0.0), drives.moves
    x, y, z = a[0], a[1], a[2]
    if not moves[p, 0]:
        x = zero
    if not moves[p, 1]:
        y = zero
    if not moves[p, 2]:
        z = zero
    if not moves[p, 3]:
        return x, y, z, zero, zero, zero
    return x, y, z, a[3], a[4], a[5]


@compiled
def without(drives: Drives, p: int, mine: Vector, a: Six) -> Six:
    """Return accelerations, zero in the lanes `mine` along the freedoms that path `p` moves."""
    zero, moves = splat(0.0), drives.moves
    x, y, z = a[0], a[1], a[2]
    if moves[p, 0]:
        x = where(mine, zero, x)
    if moves[p, 1]:
        y = where(mine, zero, y)
    if moves[p, 2]:
        z = where(mine, zero, z)
    if moves[p, 3]:
        return x, y, z, where(mine, zero, a[3]), where(mine, zero, a[4]), where(mine, zero, a[5])
    return x, y, z, a[3], a[4], a[5]


@compiled
def velocities_before(drives: Drives | None, state: State, s: int) -> Six:
    """Return velocities and spins of a block before loads act on it; zeros without drives."""
    zero = splat(0.0)
    if drives is None:
        return zero, zero, zero, zero, zero, zero
    else:
        speed, spin = state.linear_velocity, state.angular_velocity
        return (
            load(speed, 0, s), load(speed, 1, s), load(speed, 2, s),
            load(spin, 0, s), load(spin, 1, s), load(spin, 2, s))


@compiled
def bear_loads(
    drives: Drives | None, loads: Loads, state: State, before: Six, m: int, s: int
) -> None:
    """
    Restore the velocities `before` the loads along the freedoms that the path of row `m` moves.

    The path bears the load: the work of the load there is minus that of the path.
    """
    if drives is None:
        return
    else:
        p = path_of(drives, loads.wrench[m])
        if p < 0:
            return
        mine = bits(loads.lanes[m])
        for k in range(3):
            if drives.moves[p, k]:
                put(state.linear_velocity, k, s, mine, before[k])
            if drives.moves[p, 3]:
                put(state.angular_velocity, k, s, mine, before[3 + k])


@compiled
def rest_along_path(drives: Drives | None, loads: Loads, state: State, m: int, s: int) -> None:
    """
    Stop the bodies of row `m` along their path, until `place_row` places them on it.

    Loads then do no work along the path, which a drift of constant velocity could only estimate.
    """
    if drives is None:
        return
    else:
        p = path_of(drives, loads.wrench[m])
        if p < 0:
            return
        for k in range(3):
            if drives.moves[p, k]:
                put(state.linear_velocity, k, s, bits(loads.lanes[m]), splat(0.0))


@compiled
def resist_slopes(
    drives: Drives | None, model: Model, loads: Loads, state: State, linear: np.ndarray,
    angular: np.ndarray, m: int, s: int, index: int
) -> None:
    """
    Remove driven freedoms from the slopes of a Runge-Kutta stage; store the path's power [W].
    """
    if drives is None:
        return
    else:
        p = path_of(drives, loads.wrench[m])
        if p < 0:
            return
        mine, zero = bits(loads.lanes[m]), splat(0.0)
        a = (
            load(linear, 0, s), load(linear, 1, s), load(linear, 2, s),
            load(angular, 0, s), load(angular, 1, s), load(angular, 2, s))
        store(loads.power, index, LANES * m, where(
            mine, zero - path_power(model, state, borne(drives, p, a), s), zero))
        for k in range(3):
            if drives.moves[p, k]:
                put(linear, k, s, mine, zero)
            if drives.moves[p, 3]:
                put(angular, k, s, mine, zero)


@compiled
def keep_turning(
    gyration: Gyration | None, drives: Drives | None, loads: Loads, angular: np.ndarray, m: int,
    s: int
) -> None:
    """Set the gyroscopic slope to zero for bodies of row `m` whose path prescribes rotations."""
    if gyration is None:
        return
    if drives is None:
        return
    p = path_of(drives, loads.wrench[m])
    if p < 0:
        return
    if drives.moves[p, 3]:
        for k in range(3):
            put(angular, k, s, bits(loads.lanes[m]), splat(0.0))


@compiled
def moving_energy(
    drives: Drives | None, model: Model, loads: Loads, state: State, first: int, last: int
) -> float:
    """
    Return the kinetic energy [J] of driven freedoms in blocks first to last, supplied by paths.
    """
    total = 0.0
    if drives is None:
        return total
    else:
        for block in range(first, last):
            s = model.blocks.slot[block]
            for m in range(loads.start[block], loads.start[block + 1]):
                p = path_of(drives, loads.wrench[m])
                if p >= 0:
                    for i in range(LANES):
                        if loads.lanes[m] >> i & 1:
                            mass, inertia = mass_at(
                                model.masses, model.inverse_mass, model.inverse_inertia, s + i)
                            for k in range(3):
                                v = state.linear_velocity[k, s + i]
                                if drives.moves[p, k]:
                                    total += 0.5 * mass * v * v
                            if drives.moves[p, 3]:
                                total += 0.5 * inertia * turning_square_at(
                                    model.gyration, state.orientation, state.angular_velocity,
                                    s + i)
        return total


@compiled
def energy_of_drives(model: Model, loads: Loads, state: State) -> float:
    """Return the kinetic energy [J] of the driven freedoms in all blocks."""
    return moving_energy(loads.drives, model, loads, state, 0, model.blocks.slot.shape[0])


@compiled
def place_driven(model: Model, loads: Loads, state: State, time: float) -> None:
    """Place all driven bodies on their paths at `time` [s]."""
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        for m in range(loads.start[block], loads.start[block + 1]):
            place_row(loads.drives, loads, state, m, s, time)
