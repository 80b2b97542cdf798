# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Energy of dipoles and the bound of their frequency."""

from icofabric_sim.kernels.rotations import turn_to_world
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import bits, fma, splat, Vector, where
from icofabric_sim.terms.dipole.record import Dipole
import numpy as np


@compiled
def add_bound(
    dipole: Dipole | None, inverse_inertia: float, orientation: np.ndarray, alive: int, s: int,
    bound: Vector, energy: Vector
) -> tuple[Vector, Vector]:
    """
    Add the bound |p| |E| / Lambda of the squared frequency [1/s^2]; add the energy [J].

    The energy |p| |E| - p . E is zero if the dipole points along the field. It varies with a small
    rotation dtheta by (p . E) dtheta^2 - (p . dtheta) (E . dtheta), at most |p| |E| dtheta^2.
    """
    if dipole is None:
        return bound, energy
    else:
        there, zero = bits(alive), splat(0.0)
        px, py, pz = turn_to_world(
            orientation, s, splat(dipole.moment[0]), splat(dipole.moment[1]),
            splat(dipole.moment[2]))
        value = splat(dipole.largest) - fma(splat(dipole.field[0]), px, fma(
            splat(dipole.field[1]), py, splat(dipole.field[2]) * pz))
        return (
            bound + where(there, splat(dipole.largest * inverse_inertia), zero),
            energy + where(there, value, zero))
