# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Forces between all pairs of charges."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import bits, fma, load, maximum, rsqrt, splat, where
from icofabric_sim.terms.coulomb.record import Coulomb
from icofabric_sim.terms.shared import Six, SMALLEST_SQUARE
import numpy as np


@compiled
def add_force(
    coulomb: Coulomb | None, position: np.ndarray, alive: int, s: int, wrench: Six
) -> Six:
    """
    Add the repulsion kappa (x - x_j) / r^3 of all other charges, kappa = q q_j / (4 pi eps_0).

    The sum goes over all pairs, from either end with exactly opposite results. Two charges in the
    same place have no direction, and no force.
    """
    if coulomb is None:
        return wrench
    else:
        fx, fy, fz, tx, ty, tz = wrench
        zero, smallest = splat(0.0), splat(SMALLEST_SQUARE)
        ax, ay, az = zero, zero, zero
        x, y, z = load(position, 0, s), load(position, 1, s), load(position, 2, s)
        for i in range(coulomb.slots.shape[0]):
            j = coulomb.slots[i]
            ux, uy = x - splat(position[0, j]), y - splat(position[1, j])
            uz = z - splat(position[2, j])
            square = fma(ux, ux, fma(uy, uy, uz * uz))
            inverse = where(square > smallest, rsqrt(maximum(square, smallest)), zero)
            cube = splat(coulomb.charge[0, j]) * inverse * inverse * inverse
            ax, ay, az = fma(cube, ux, ax), fma(cube, uy, ay), fma(cube, uz, az)
        kappa = where(
            bits(alive), splat(coulomb.strength) * load(coulomb.charge, 0, s), zero)
        return fma(kappa, ax, fx), fma(kappa, ay, fy), fma(kappa, az, fz), tx, ty, tz
