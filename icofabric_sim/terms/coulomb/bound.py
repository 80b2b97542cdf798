# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Energy of charges and the bound of their frequency."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fabs,
    fma,
    load,
    maximum,
    rsqrt,
    splat,
    Vector,
    where,
)
from icofabric_sim.terms.coulomb.record import Coulomb
from icofabric_sim.terms.shared import SMALLEST_SQUARE
import numpy as np


@compiled
def add_bound(
    coulomb: Coulomb | None, inverse_mass: float, position: np.ndarray, alive: int, s: int,
    bound: Vector, energy: Vector
) -> tuple[Vector, Vector]:
    """
    Add the bound of the squared frequency [1/s^2]; add half of the energy [J] of each pair.

    The energy kappa / r of two charges varies with their relative motion du by at most
    2 |kappa| / r^3 du^2, and du^2 <= 2 dx_1^2 + 2 dx_2^2: for each body the sum of
    4 |kappa| / r^3 over all others. This form is block-diagonal and adds to that of the connectors
    (kernels/frequency_bound.py), and eigenvalues of a sum are at most their sum.
    """
    if coulomb is None:
        return bound, energy
    else:
        there, zero = bits(alive), splat(0.0)
        sums, cubes = sums_over_charges(coulomb, position, s)
        strength = splat(coulomb.strength) * load(coulomb.charge, 0, s)
        energy = fma(splat(0.5) * strength, sums, energy)
        bound = fma(splat(4.0 * inverse_mass) * fabs(strength), cubes, bound)
        return where(there, bound, zero), where(there, energy, zero)


@compiled
def sums_over_charges(
    coulomb: Coulomb, position: np.ndarray, s: int
) -> tuple[Vector, Vector]:
    """
    Return two sums over all other charges for each body of a block, q_j relative to the largest.

    The sums are those of q_j / r [1/m] and of |q_j| / r^3 [1/m^3].
    """
    zero, smallest = splat(0.0), splat(SMALLEST_SQUARE)
    sums, cubes = zero, zero
    x, y, z = load(position, 0, s), load(position, 1, s), load(position, 2, s)
    for i in range(coulomb.slots.shape[0]):
        j = coulomb.slots[i]
        ux, uy = x - splat(position[0, j]), y - splat(position[1, j])
        uz = z - splat(position[2, j])
        square = fma(ux, ux, fma(uy, uy, uz * uz))
        inverse = where(square > smallest, rsqrt(maximum(square, smallest)), zero)
        charge = splat(coulomb.charge[0, j])
        sums = fma(charge, inverse, sums)
        cubes = fma(fabs(charge) * inverse * inverse, inverse, cubes)
    return sums, cubes
