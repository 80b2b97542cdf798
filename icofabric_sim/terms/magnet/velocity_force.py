# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The Lorentz force."""

from icofabric_sim.kernels.rotations import turn_to_world
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, load, splat, Vector
from icofabric_sim.terms.magnet.record import Magnet
from icofabric_sim.terms.shared import add_wrench, Supports
import numpy as np


@compiled
def add_velocity_force(
    magnet: Magnet | None, supports: Supports | None, inverse_mass: float, inverse_inertia: float,
    orientation: np.ndarray, linear_velocity: np.ndarray, angular_velocity: np.ndarray,
    linear: np.ndarray, angular: np.ndarray, s: int, spent: Vector
) -> Vector:
    """
    Add the magnetic terms of the Lorentz force on a charged shell with a dipole; return `spent`.

    Integrated over the charges at r from the centre, which move with v + omega x r: with
    charge q, dipole p and an isotropic second moment s 1, s = q Lambda / (2 M) (that of the
    shell's mass, whose inertia is Lambda 1 = integral (r^2 1 - r r) dm, times q / M),
    F = q v x B + (omega x p) x B, and because (omega x r) x B = r (omega . B) - omega (r . B),
    N = p x (v x B) + s omega x B. Their power F . v + N . omega vanishes: no energy is dissipated.
    """
    if magnet is None:
        return spent
    bx, by, bz = splat(magnet.field[0]), splat(magnet.field[1]), splat(magnet.field[2])
    vx, vy = load(linear_velocity, 0, s), load(linear_velocity, 1, s)
    vz, ox = load(linear_velocity, 2, s), load(angular_velocity, 0, s)
    oy, oz = load(angular_velocity, 1, s), load(angular_velocity, 2, s)
    px, py, pz = turn_to_world(
        orientation, s, load(magnet.moment, 0, s), load(magnet.moment, 1, s),
        load(magnet.moment, 2, s))
    charge, second = load(magnet.charge, 0, s), load(magnet.second, 0, s)
    # The current of the whole body, q v + omega x p, then v x B.
    cx = fma(charge, vx, oy * pz - oz * py)
    cy = fma(charge, vy, oz * px - ox * pz)
    cz = fma(charge, vz, ox * py - oy * px)
    ex, ey, ez = vy * bz - vz * by, vz * bx - vx * bz, vx * by - vy * bx
    add_wrench(
        supports, inverse_mass, inverse_inertia, linear, angular, s,
        cy * bz - cz * by, cz * bx - cx * bz, cx * by - cy * bx,
        fma(second, oy * bz - oz * by, py * ez - pz * ey),
        fma(second, oz * bx - ox * bz, pz * ex - px * ez),
        fma(second, ox * by - oy * bx, px * ey - py * ex))
    return spent
