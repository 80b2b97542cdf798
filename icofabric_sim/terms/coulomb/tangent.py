# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Second derivatives of the energy of charges."""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    load,
    maximum,
    rsqrt,
    splat,
    sqrt,
    store,
    Vector,
    where,
)
from icofabric_sim.terms.coulomb.record import Coulomb
from icofabric_sim.terms.shared import Blocks, SMALLEST_SQUARE, Supports
import numpy as np


@compiled
def add_coulomb_product(
    coulomb: Coulomb | None, blocks: Blocks, position: np.ndarray, supports: Supports | None,
    root: float, vector: np.ndarray, product: np.ndarray
) -> None:
    """
    Add the terms of charges to M^-1/2 H M^-1/2 times a vector, (6, s) both.

    `root` is that of the inverse mass; 1 and no supports: H itself. Second derivative of
    kappa / r along du = dx_i - dx_j, with n the direction: kappa (3 n (n . du) - du) / r^3.
    """
    if coulomb is None:
        return
    else:
        smallest, zero = splat(SMALLEST_SQUARE), splat(0.0)
        for block in range(blocks.slot.shape[0]):
            s = blocks.slot[block]
            mx, my, mz = roots_of(supports, root, s)
            x, y, z = load(position, 0, s), load(position, 1, s), load(position, 2, s)
            vx, vy, vz = mx * load(vector, 0, s), my * load(vector, 1, s), mz * load(vector, 2, s)
            ax, ay, az = zero, zero, zero
            for i in range(coulomb.slots.shape[0]):
                j = coulomb.slots[i]
                ux, uy = x - splat(position[0, j]), y - splat(position[1, j])
                uz = z - splat(position[2, j])
                dx = vx - splat(root_at(supports, root, 0, j) * vector[0, j])
                dy = vy - splat(root_at(supports, root, 1, j) * vector[1, j])
                dz = vz - splat(root_at(supports, root, 2, j) * vector[2, j])
                square = fma(ux, ux, fma(uy, uy, uz * uz))
                inverse = where(square > smallest, rsqrt(maximum(square, smallest)), zero)
                second = inverse * inverse
                cube = splat(coulomb.charge[0, j]) * second * inverse
                along = splat(3.0) * second * fma(ux, dx, fma(uy, dy, uz * dz))
                ax = fma(cube, fma(along, ux, zero - dx), ax)
                ay = fma(cube, fma(along, uy, zero - dy), ay)
                az = fma(cube, fma(along, uz, zero - dz), az)
            kappa = where(
                bits(blocks.alive[block]), splat(coulomb.strength) * load(coulomb.charge, 0, s),
                zero)
            store(product, 0, s, fma(kappa * mx, ax, load(product, 0, s)))
            store(product, 1, s, fma(kappa * my, ay, load(product, 1, s)))
            store(product, 2, s, fma(kappa * mz, az, load(product, 2, s)))


@compiled
def roots_of(
    supports: Supports | None, root: float, s: int
) -> tuple[Vector, Vector, Vector]:
    """Return roots of the inverse masses of a block along x, y, z; 0 where held."""
    if supports is None:
        return splat(root), splat(root), splat(root)
    else:
        return (
            sqrt(load(supports.inverse_mass, 0, s)), sqrt(load(supports.inverse_mass, 1, s)),
            sqrt(load(supports.inverse_mass, 2, s)))


@compiled
def root_at(supports: Supports | None, root: float, k: int, s: int) -> float:
    """Return the root of the inverse mass of one body along one axis."""
    if supports is None:
        return root
    else:
        return math.sqrt(supports.inverse_mass[k, s])
