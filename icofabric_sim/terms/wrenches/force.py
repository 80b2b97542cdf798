# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Force and torque of wrenches."""

from icofabric_sim.kernels.rotations import Three, turn_to_world
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import bits, fma, splat, where
from icofabric_sim.terms.loads import Loads
import numpy as np


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
