# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Forces between charges and dipoles (charge.mutual): Hessian matrix and force scale."""

from icofabric_sim.terms.coulomb.record import Coulomb
import numpy as np


def coulomb_matrix(
    strength: float, position: np.ndarray, charge: np.ndarray | None = None
) -> np.ndarray:
    """
    Return the Hessian (3 n, 3 n) of the energy strength q q' / r of all pairs of points (n, 3).

    `charge` (n,) are the charges q; None: all are 1. Coincident points do not interact, as in the
    forces.
    """
    count = len(position)
    apart = position[:, None] - position[None]
    square = (apart * apart).sum(axis=2)
    with np.errstate(divide='ignore'):
        cube = np.where(square > 0.0, square**-1.5, 0.0)
        fifth = np.where(square > 0.0, 3.0 * square**-2.5, 0.0)
    pairs = np.ones((count, count)) if charge is None else np.outer(charge, charge)
    blocks = (strength * pairs)[..., None, None] * (
        cube[..., None, None] * np.eye(3)
        - fifth[..., None, None] * apart[..., :, None] * apart[..., None, :])
    own = np.arange(count)
    blocks[own, own] = -blocks.sum(axis=1)
    return np.asarray(blocks.transpose(0, 2, 1, 3).reshape(3 * count, 3 * count))


def largest_repulsion(
    coulomb: Coulomb | None, position: np.ndarray, slot: np.ndarray
) -> float:
    """
    Return the largest force [N] on a charge at `position` (n, 3) [m]; 0 without charges.

    `slot` (n,) are the slots of the bodies. Forces of dipoles count as if all had one direction.
    """
    if coulomb is None:
        return 0.0
    most = 0.0
    charge, sizes = coulomb.charge[0, slot], np.zeros(len(slot))
    if coulomb.moment is not None:
        sizes = np.linalg.norm(coulomb.moment[:, slot], axis=0)
    # One body at a time, so that memory grows linearly.
    for place, own, size in zip(position, charge.tolist(), sizes.tolist()):
        apart = place - position
        square = (apart * apart).sum(axis=1)
        with np.errstate(divide='ignore'):
            cube = np.where(square > 0.0, square**-1.5, 0.0)
        force = abs(own) * float(np.linalg.norm((cube * charge) @ apart))
        if coulomb.moment is not None:
            force += float((
                2.0 * (abs(own) * sizes + size * np.abs(charge)) * cube
                + 6.0 * size * sizes * np.cbrt(cube)**4).sum())
        most = max(most, force)
    return coulomb.strength * most
