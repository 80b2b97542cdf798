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

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import bits, fma, load, splat, store, Vector, where
from icofabric_sim.terms.drives.record import Drives
from icofabric_sim.terms.loads import Loads
from icofabric_sim.terms.shared import State
from icofabric_sim.terms.turning import turned
import numpy as np


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
def stop_row(drives: Drives | None, loads: Loads, state: State, m: int, s: int) -> None:
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
