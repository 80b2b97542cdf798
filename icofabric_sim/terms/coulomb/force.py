# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Forces and torques between all pairs of charges and dipoles."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import bits, fma, load, maximum, rsqrt, splat, where
from icofabric_sim.terms.coulomb.multipoles import (
    cross,
    direction_from,
    moment_at,
    moments_of,
    plus,
    scaled,
    second_derivative,
    third_derivative,
)
from icofabric_sim.terms.coulomb.record import Coulomb
from icofabric_sim.terms.shared import Six, SMALLEST_SQUARE
import numpy as np


@compiled
def add_force(
    coulomb: Coulomb | None, position: np.ndarray, orientation: np.ndarray, alive: int, s: int,
    wrench: Six
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
        wrench = fma(kappa, ax, fx), fma(kappa, ay, fy), fma(kappa, az, fz), tx, ty, tz
        return add_dipoles(coulomb, coulomb.moment, position, orientation, alive, s, wrench)


@compiled
def add_dipoles(
    coulomb: Coulomb, moment: np.ndarray | None, position: np.ndarray, orientation: np.ndarray,
    alive: int, s: int, wrench: Six
) -> Six:
    """
    Add the forces between charges and dipoles, and between dipoles, and the torques p x E.

    With c = q p' - q' p the force is grad grad f c + grad grad grad f p p', see multipoles.py. E
    is the field of charges and dipoles of all other bodies.
    """
    if moment is None:
        return wrench
    else:
        zero = splat(0.0)
        force, field = (zero, zero, zero), (zero, zero, zero)
        own, charge = moments_of(moment, orientation, s), load(coulomb.charge, 0, s)
        for i in range(coulomb.slots.shape[0]):
            j = coulomb.slots[i]
            n, inverse = direction_from(position, j, s)
            other, its = moment_at(moment, orientation, j), splat(coulomb.charge[0, j])
            one = splat(1.0)
            field = plus(its * inverse * inverse, n, field)
            field = plus(one, second_derivative(other, n, inverse), field)
            mixed = plus(charge, other, scaled(zero - its, own))
            force = plus(one, second_derivative(mixed, n, inverse), force)
            force = plus(one, third_derivative(own, other, n, inverse), force)
        kappa = where(bits(alive), splat(coulomb.strength), zero)
        torque = cross(own, field)
        fx, fy, fz, tx, ty, tz = wrench
        return (
            fma(kappa, force[0], fx), fma(kappa, force[1], fy), fma(kappa, force[2], fz),
            fma(kappa, torque[0], tx), fma(kappa, torque[1], ty), fma(kappa, torque[2], tz))
