# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Torques of dipoles in the field."""

from icofabric_sim.kernels.rotations import turn_to_world
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import bits, splat, where
from icofabric_sim.terms.dipole.record import Dipole
from icofabric_sim.terms.shared import Six
import numpy as np


@compiled
def add_force(
    dipole: Dipole | None, orientation: np.ndarray, alive: int, s: int, wrench: Six
) -> Six:
    """Add the torque p x E of a uniform field on a dipole that turns with the body."""
    if dipole is None:
        return wrench
    else:
        fx, fy, fz, tx, ty, tz = wrench
        there, zero = bits(alive), splat(0.0)
        ex, ey, ez = splat(dipole.field[0]), splat(dipole.field[1]), splat(dipole.field[2])
        px, py, pz = turn_to_world(
            orientation, s, splat(dipole.moment[0]), splat(dipole.moment[1]),
            splat(dipole.moment[2]))
        return (
            fx, fy, fz, tx + where(there, py * ez - pz * ey, zero),
            ty + where(there, pz * ex - px * ez, zero), tz + where(there, px * ey - py * ex, zero))
