# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Energy of charges and dipoles, and the bound of their frequency."""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fabs,
    fma,
    load,
    maximum,
    rsqrt,
    splat,
    sqrt,
    Vector,
    where,
)
from icofabric_sim.terms.coulomb.multipoles import direction_from, dot, moment_at, moments_of
from icofabric_sim.terms.coulomb.record import Coulomb
from icofabric_sim.terms.shared import SMALLEST_SQUARE
import numpy as np


@compiled
def add_bound(
    coulomb: Coulomb | None, inverse_mass: float, inverse_inertia: float, position: np.ndarray,
    orientation: np.ndarray, alive: int, s: int, bound: Vector, energy: Vector
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
        bound, energy = add_dipole_bound(
            coulomb, coulomb.moment, inverse_mass, inverse_inertia, position, orientation, s,
            bound, energy)
        return where(there, bound, zero), where(there, energy, zero)


@compiled
def add_dipole_bound(
    coulomb: Coulomb, moment: np.ndarray | None, inverse_mass: float, inverse_inertia: float,
    position: np.ndarray, orientation: np.ndarray, s: int, bound: Vector, energy: Vector
) -> tuple[Vector, Vector]:
    """
    Add the same of dipoles.

    By the norms of the derivatives of 1 / r (multipoles.py) the second variation is at most
    A du^2 + 2 (B |dtheta| + B' |dtheta'|) |du| + (C + D) dtheta^2 + (C' + D) dtheta'^2, where
    A = 6 (|q| p' + |q'| p) / r^4 + 24 p p' / r^5, B = 2 |q'| p / r^3 + 6 p p' / r^4,
    C = |q'| p / r^2 + 2 p p' / r^3 and D = 2 p p' / r^3. For any length l, 2 |dtheta| |du| <=
    l dtheta^2 + du^2 / l; l^2 = 2 Lambda / M serves best.
    """
    if moment is None:
        return bound, energy
    else:
        zero = splat(0.0)
        length = math.sqrt(2.0 * inverse_mass / inverse_inertia)
        own, charge = moments_of(moment, orientation, s), load(coulomb.charge, 0, s)
        size, along, around, total = sqrt(dot(own, own)), zero, zero, zero
        for i in range(coulomb.slots.shape[0]):
            j = coulomb.slots[i]
            n, inverse = direction_from(position, j, s)
            other, its = moment_at(moment, orientation, j), splat(coulomb.charge[0, j])
            square = inverse * inverse
            pair = fma(splat(-3.0) * dot(own, n), dot(other, n), dot(own, other))
            total = fma(square, fma(
                pair, inverse, charge * dot(other, n) - its * dot(own, n)), total)
            # Factors of 0 come first: high powers of a short distance overflow.
            its_size = sqrt(dot(other, other))
            both, single = size * its_size * inverse * square, fabs(its) * size * square
            mixed = fma(fabs(charge) * its_size, square, single)
            along = fma(inverse, mixed * fma(splat(12.0), inverse, splat(4.0 / length)), along)
            along = fma(inverse, both * fma(splat(48.0), inverse, splat(24.0 / length)), along)
            around = fma(single, fma(splat(2.0 * length), inverse, splat(1.0)), around)
            around = fma(both, fma(splat(6.0 * length), inverse, splat(4.0)), around)
        most = maximum(splat(inverse_mass) * along, splat(inverse_inertia) * around)
        return (
            fma(splat(coulomb.strength), most, bound),
            fma(splat(0.5 * coulomb.strength), total, energy))


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
