# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Drag forces and torques."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import bits, fma, load, splat, Vector, where
from icofabric_sim.terms.drag.record import Drag
from icofabric_sim.terms.shared import add_wrench, Supports
import numpy as np


@compiled
def add_velocity_force(
    drag: Drag | None, supports: Supports | None, inverse_mass: float, inverse_inertia: float,
    linear_velocity: np.ndarray, angular_velocity: np.ndarray, linear: np.ndarray,
    angular: np.ndarray, alive: int, s: int, spent: Vector
) -> Vector:
    """
    Add drag -gamma v on centres and -gamma' omega on spins; return `spent` plus its power [W].
    """
    if drag is None:
        return spent
    else:
        # None on carriers of planes.
        there, zero = bits(alive), splat(0.0)
        minus = where(there, splat(-drag.linear), zero)
        turning = where(there, splat(-drag.angular), zero)
        vx, vy = load(linear_velocity, 0, s), load(linear_velocity, 1, s)
        vz, ox = load(linear_velocity, 2, s), load(angular_velocity, 0, s)
        oy, oz = load(angular_velocity, 1, s), load(angular_velocity, 2, s)
        add_wrench(
            supports, inverse_mass, inverse_inertia, linear, angular, s,
            minus * vx, minus * vy, minus * vz, turning * ox, turning * oy, turning * oz)
        speed = fma(vx, vx, fma(vy, vy, vz * vz))
        spin = fma(ox, ox, fma(oy, oy, oz * oz))
        return spent - fma(minus, speed, turning * spin)
