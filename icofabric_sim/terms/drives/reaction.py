# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Forces that paths of driven bodies bear, and the work of the paths."""

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
from icofabric_sim.terms.drives.path import path_of, put
from icofabric_sim.terms.drives.record import Drives
from icofabric_sim.terms.gyration import Gyration
from icofabric_sim.terms.loads import Loads
from icofabric_sim.terms.masses import Masses, masses_of
from icofabric_sim.terms.shared import Six, State
import numpy as np


@compiled
def resist_row(
    drives: Drives | None, masses: Masses | None, inverse_mass: float, inverse_inertia: float,
    loads: Loads, state: State, m: int, s: int, h: float, again: float, a: Six
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
        power = path_power(
            masses, inverse_mass, inverse_inertia, state, borne(drives, p, a), s)
        more = done - splat(h) * power
        if again != 0.0:
            more = more - splat(again) * power
        store_at(loads.work, LANES * m, where(mine, more, done))
        return without(drives, p, mine, a)


@compiled
def path_power(
    masses: Masses | None, inverse_mass: float, inverse_inertia: float, state: State, a: Six,
    s: int
) -> Vector:
    """
    Return the power [W] of the forces that give these accelerations to the bodies of a block.
    """
    speed, spin = state.linear_velocity, state.angular_velocity
    linear = fma(a[0], load(speed, 0, s), fma(a[1], load(speed, 1, s), a[2] * load(speed, 2, s)))
    angular = fma(a[3], load(spin, 0, s), fma(a[4], load(spin, 1, s), a[5] * load(spin, 2, s)))
    mass, inertia = masses_of(masses, inverse_mass, inverse_inertia, s)
    # Of carriers of planes, which have no mass, the accelerations are minus the forces.
    mass = where(splat(0.0) < mass, mass, splat(-1.0))
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
def bear_row(
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
def resist_row_slope(
    drives: Drives | None, masses: Masses | None, inverse_mass: float, inverse_inertia: float,
    loads: Loads, state: State, linear: np.ndarray, angular: np.ndarray, m: int, s: int,
    index: int
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
            mine, zero - path_power(
                masses, inverse_mass, inverse_inertia, state, borne(drives, p, a), s), zero))
        for k in range(3):
            if drives.moves[p, k]:
                put(linear, k, s, mine, zero)
            if drives.moves[p, 3]:
                put(angular, k, s, mine, zero)


@compiled
def keep_row_turning(
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
