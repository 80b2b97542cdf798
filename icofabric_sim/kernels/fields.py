# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Forces of electric fields on charged shells: of a uniform field on dipoles, and between charges.

A uniform field on the charges is an acceleration like gravity and is packed with it.
"""

import math

from icofabric_sim.kernels.connectors import Six
from icofabric_sim.kernels.records import Blocks, Coulomb, Dipole, Model, State, Supports
from icofabric_sim.kernels.rotations import turn_to_world
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fabs,
    fma,
    lane,
    LANES,
    load,
    maximum,
    rsqrt,
    splat,
    sqrt,
    store,
    Vector,
    where,
)
import numpy as np

_SMALLEST_SQUARE = 1e-300


@compiled
def add_dipole(
    dipole: Dipole | None, orientation: np.ndarray, alive: int, s: int, force: Six
) -> Six:
    """Add the torque p x E of a uniform field on a dipole that turns with the body."""
    if dipole is None:
        return force
    else:
        fx, fy, fz, tx, ty, tz = force
        there, zero = bits(alive), splat(0.0)
        ex, ey, ez = splat(dipole.field[0]), splat(dipole.field[1]), splat(dipole.field[2])
        px, py, pz = turn_to_world(
            orientation, s, splat(dipole.moment[0]), splat(dipole.moment[1]),
            splat(dipole.moment[2]))
        return (
            fx, fy, fz, tx + where(there, py * ez - pz * ey, zero),
            ty + where(there, pz * ex - px * ez, zero), tz + where(there, px * ey - py * ex, zero))


@compiled
def add_coulomb(
    coulomb: Coulomb | None, position: np.ndarray, alive: int, s: int, force: Six
) -> Six:
    """
    Add the repulsion kappa (x - x_j) / r^3 of all other charges, kappa = q q_j / (4 pi eps_0).

    The sum goes over all pairs, from either end with exactly opposite results. Two charges in the
    same place have no direction, and no force.
    """
    if coulomb is None:
        return force
    else:
        fx, fy, fz, tx, ty, tz = force
        zero, smallest = splat(0.0), splat(_SMALLEST_SQUARE)
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


@compiled
def field_parts(
    dipole: Dipole | None, coulomb: Coulomb | None, model: Model, state: State, alive: int, s: int
) -> tuple[Vector, Vector]:
    """
    Return a bound of what fields add to the squared frequency [1/s^2] of a block; energy [J].

    A dipole's energy varies with a small rotation dtheta by (p . E) dtheta^2 - (p . dtheta)
    (E . dtheta), at most |p| |E| dtheta^2. That of two charges, kappa / r, varies with their
    relative motion du by at most 2 |kappa| / r^3 du^2, and du^2 <= 2 dx_1^2 + 2 dx_2^2: for each
    body the sum of 4 |kappa| / r^3 over all others. Both forms are block-diagonal and add to that
    of the connectors (kernels/frequency_bound.py), and eigenvalues of a sum are at most their sum.
    """
    energy, there = dipole_energy(dipole, state.orientation, s), bits(alive)
    bound = dipole_bound(dipole, model.inverse_inertia)
    sums, cubes = coulomb_sums(coulomb, state.position, s)
    strength = coulomb_strength(coulomb, s)
    energy = fma(splat(0.5) * strength, sums, energy)
    bound = fma(splat(4.0 * model.inverse_mass) * fabs(strength), cubes, bound)
    return where(there, bound, splat(0.0)), where(there, energy, splat(0.0))


@compiled
def dipole_energy(dipole: Dipole | None, orientation: np.ndarray, s: int) -> Vector:
    """
    Return energies |p| |E| - p . E [J] of a block; zero if the dipole points along the field.
    """
    if dipole is None:
        return splat(0.0)
    else:
        px, py, pz = turn_to_world(
            orientation, s, splat(dipole.moment[0]), splat(dipole.moment[1]),
            splat(dipole.moment[2]))
        return splat(dipole.largest) - fma(splat(dipole.field[0]), px, fma(
            splat(dipole.field[1]), py, splat(dipole.field[2]) * pz))


@compiled
def dipole_bound(dipole: Dipole | None, inverse_inertia: float) -> Vector:
    """Return the bound |p| |E| / Lambda of the squared frequency of dipoles [1/s^2]."""
    if dipole is None:
        return splat(0.0)
    else:
        return splat(dipole.largest * inverse_inertia)


@compiled
def coulomb_strength(coulomb: Coulomb | None, s: int) -> Vector:
    """Return energy times distance [J m] of each charge of a block and the largest charge."""
    if coulomb is None:
        return splat(0.0)
    else:
        return splat(coulomb.strength) * load(coulomb.charge, 0, s)


@compiled
def coulomb_sums(
    coulomb: Coulomb | None, position: np.ndarray, s: int
) -> tuple[Vector, Vector]:
    """
    Return two sums over all other charges for each body of a block, q_j relative to the largest.

    The sums are those of q_j / r [1/m] and of |q_j| / r^3 [1/m^3].
    """
    zero = splat(0.0)
    sums, cubes = zero, zero
    if coulomb is None:
        return sums, cubes
    smallest = splat(_SMALLEST_SQUARE)
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
        smallest, zero = splat(_SMALLEST_SQUARE), splat(0.0)
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


@compiled
def field_energy(model: Model, state: State) -> float:
    """Return the energy [J] of all dipoles in the field and of all pairs of charges."""
    total = 0.0
    for block in range(model.blocks.slot.shape[0]):
        _, energy = field_parts(
            model.dipole, model.coulomb, model, state, model.blocks.alive[block],
            model.blocks.slot[block])
        for i in range(LANES):
            total += lane(energy, i)
    return total
