# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Second derivatives of the energy of charges and dipoles."""

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
from icofabric_sim.terms.coulomb.multipoles import (
    cross,
    direction_from,
    dot,
    fourth_derivative,
    moment_at,
    moments_of,
    plus,
    scaled,
    second_derivative,
    third_derivative,
)
from icofabric_sim.terms.coulomb.record import Coulomb
from icofabric_sim.terms.shared import Blocks, SMALLEST_SQUARE, Supports
import numpy as np


@compiled
def add_coulomb_product(
    coulomb: Coulomb | None, blocks: Blocks, position: np.ndarray, orientation: np.ndarray,
    supports: Supports | None, root: float, root_i: float, vector: np.ndarray,
    product: np.ndarray
) -> None:
    """
    Add the terms of charges and dipoles to M^-1/2 H M^-1/2 times a vector, (6, s) both.

    `root` and `root_i` are those of the inverse mass and inertia; 1 and no supports: H itself.
    Second derivative of kappa / r along du = dx_i - dx_j, with n the direction:
    kappa (3 n (n . du) - du) / r^3.
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
        add_dipole_product(
            coulomb, coulomb.moment, blocks, position, orientation, supports, root, root_i,
            vector, product)


@compiled
def add_dipole_product(
    coulomb: Coulomb, moment: np.ndarray | None, blocks: Blocks, position: np.ndarray,
    orientation: np.ndarray, supports: Supports | None, root: float, root_i: float,
    vector: np.ndarray, product: np.ndarray
) -> None:
    """
    Add the same of dipoles: minus the derivatives of their forces (force.py) and torques.

    Along rotations, the symmetric part of the derivative of the torque p x E is taken.
    """
    if moment is None:
        return
    else:
        zero, one = splat(0.0), splat(1.0)
        for block in range(blocks.slot.shape[0]):
            s = blocks.slot[block]
            mx, my, mz = roots_of(supports, root, s)
            inertia = turning_root_of(supports, root_i, s)
            dx = mx * load(vector, 0, s), my * load(vector, 1, s), mz * load(vector, 2, s)
            turn = scaled(
                inertia, (load(vector, 3, s), load(vector, 4, s), load(vector, 5, s)))
            own, charge = moments_of(moment, orientation, s), load(coulomb.charge, 0, s)
            change = cross(turn, own)
            force, field, slope = (zero, zero, zero), (zero, zero, zero), (zero, zero, zero)
            for i in range(coulomb.slots.shape[0]):
                j = coulomb.slots[i]
                n, inverse = direction_from(position, j, s)
                other, its = moment_at(moment, orientation, j), splat(coulomb.charge[0, j])
                r = turning_root_at(supports, root_i, j)
                its_change = cross((
                    splat(r * vector[3, j]), splat(r * vector[4, j]),
                    splat(r * vector[5, j])), other)
                du = (
                    dx[0] - splat(root_at(supports, root, 0, j) * vector[0, j]),
                    dx[1] - splat(root_at(supports, root, 1, j) * vector[1, j]),
                    dx[2] - splat(root_at(supports, root, 2, j) * vector[2, j]))
                mixed = plus(charge, other, scaled(zero - its, own))
                mixed_change = plus(charge, its_change, scaled(zero - its, change))
                force = plus(one, second_derivative(mixed_change, n, inverse), force)
                force = plus(one, third_derivative(mixed, du, n, inverse), force)
                force = plus(one, third_derivative(change, other, n, inverse), force)
                force = plus(one, third_derivative(own, its_change, n, inverse), force)
                force = plus(one, fourth_derivative(own, other, du, n, inverse), force)
                field = plus(its * inverse * inverse, n, field)
                field = plus(one, second_derivative(other, n, inverse), field)
                moved = plus(zero - its, du, its_change)
                slope = plus(one, second_derivative(moved, n, inverse), slope)
                slope = plus(one, third_derivative(other, du, n, inverse), slope)
            half = splat(-0.5)
            torque = plus(dot(own, field), turn, plus(
                half * dot(field, turn), own, scaled(half * dot(own, turn), field)))
            torque = plus(zero - one, cross(own, slope), torque)
            kappa = where(bits(blocks.alive[block]), splat(coulomb.strength), zero)
            store(product, 0, s, load(product, 0, s) - kappa * mx * force[0])
            store(product, 1, s, load(product, 1, s) - kappa * my * force[1])
            store(product, 2, s, load(product, 2, s) - kappa * mz * force[2])
            for k in range(3):
                store(product, k + 3, s, fma(
                    kappa * inertia, torque[k], load(product, k + 3, s)))


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


@compiled
def turning_root_of(supports: Supports | None, root_i: float, s: int) -> Vector:
    """Return roots of the inverse inertias of a block; 0 where held."""
    if supports is None:
        return splat(root_i)
    else:
        return sqrt(load(supports.inverse_inertia, 0, s))


@compiled
def turning_root_at(supports: Supports | None, root_i: float, s: int) -> float:
    """Return the root of the inverse inertia of one body."""
    if supports is None:
        return root_i
    else:
        return math.sqrt(supports.inverse_inertia[0, s])
