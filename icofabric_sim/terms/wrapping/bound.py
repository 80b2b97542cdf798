# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Changes of frequency bounds and energies of connectors due to wrapping."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import insert, lane, LANES, splat, Vector
from icofabric_sim.terms.maxwell.record import Maxwell
from icofabric_sim.terms.shared import LINK_COUNT, Links, partner_slot
from icofabric_sim.terms.wrapping.force import band_of, entering
from icofabric_sim.terms.wrapping.record import Wrapping
import numpy as np


@compiled
def add_bound(
    wrapping: Wrapping | None, links: Links, maxwell: Maxwell | None, inverse_mass: float,
    inverse_inertia: float, position: np.ndarray, orientation: np.ndarray,
    rest: np.ndarray | None, points: np.ndarray, block: int, s: int, bound: Vector, energy: Vector
) -> tuple[Vector, Vector]:
    """Add the changes due to wrapping to the bound [1/s^2] and energy [J] of a block."""
    if wrapping is None:
        return bound, energy
    else:
        more, part, _ = sum_bands(
            wrapping, links, maxwell, inverse_mass, inverse_inertia, position, orientation, rest,
            points, block, s)
        return bound + more, energy + part


@compiled
def sum_bands(
    wrapping: Wrapping, links: Links, maxwell: Maxwell | None, inverse_mass: float,
    inverse_inertia: float, position: np.ndarray, orientation: np.ndarray,
    rest: np.ndarray | None, points: np.ndarray, block: int, s: int
) -> tuple[Vector, Vector, Vector]:
    """
    Return what wrapping adds to the bound of the squared frequency [1/s^2]; energy [J]; lost ends.

    Energy and ends are half of those of each connector, because either end counts one half.
    """
    bound, energy, lost = splat(0.0), splat(0.0), splat(0.0)
    for link in range(LINK_COUNT):
        lanes = entering(
            wrapping, links, orientation, points, position.shape[1], block, s, link)
        partner = partner_slot(links, position.shape[1], block, link)
        for i in range(LANES):
            if lane(lanes, i) > 0.0:
                band = band_of(
                    wrapping, links, maxwell, inverse_mass, inverse_inertia, position,
                    orientation, rest, link, s + i, partner + i)
                bound = insert(bound, i, lane(bound, i) + band.bound)
                energy = insert(energy, i, lane(energy, i) + 0.5 * band.energy)
                lost = insert(lost, i, lane(lost, i) + 0.5 * band.lost)
    return bound, energy, lost
