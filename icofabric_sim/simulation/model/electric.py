# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Packing of charges, dipoles and fields for the kernels."""

from icofabric_sim.scene.electric import Electric
from icofabric_sim.scene.masses import BodyMasses
from icofabric_sim.simulation.model.layout import Layout
from icofabric_sim.terms.coulomb.record import Coulomb
from icofabric_sim.terms.dipole.record import Dipole
from icofabric_sim.terms.magnet.record import Magnet
import numpy as np

# 1 / (4 pi eps_0) [N m^2/C^2] with eps_0 = 8.8541878188e-12 F/m (CODATA 2022).
COULOMB_CONSTANT = 8.9875517862e9


def pack_dipole(electric: Electric) -> Dipole | None:
    """Pack equal dipoles in a steady electric field; None without dipoles or without the field."""
    if not electric.is_potential:
        return None
    moment = electric.dipole[0]
    largest = float(np.linalg.norm(moment) * np.linalg.norm(electric.electric))
    return Dipole(electric.electric, moment, largest) if largest > 0.0 else None


def pack_magnet(
    electric: Electric, masses: BodyMasses, layout: Layout
) -> Magnet | None:
    """Pack charges and dipoles that move in a magnetic field; None without either."""
    if not (electric.magnetic.any() and (electric.charge.any() or electric.dipole.any())):
        return None
    charge = layout.spread(np.broadcast_to(electric.charge, layout.body_count)[:, None])
    moment = layout.spread(np.broadcast_to(electric.dipole, (layout.body_count, 3)))
    spread = layout.spread(np.broadcast_to(
        0.5 * masses.inertia / masses.mass, layout.body_count)[:, None])
    second = layout.spread(np.broadcast_to(electric.second, layout.body_count)[:, None])
    return Magnet(
        electric.magnetic, charge, moment, np.where(np.isnan(second), spread * charge, second))


def pack_coulomb(electric: Electric, layout: Layout) -> Coulomb | None:
    """
    Pack charges and dipoles that act on each other; None without mutual forces.

    They are relative to the largest charge, or to 1 C without charges.
    """
    if not (electric.is_mutual and layout.body_count > 1):
        return None
    largest = float(np.abs(electric.charge).max(initial=0.0)) or 1.0
    charge = np.broadcast_to(electric.charge, layout.body_count)
    dipole = np.broadcast_to(electric.dipole, (layout.body_count, 3))
    return Coulomb(
        COULOMB_CONSTANT * largest**2,
        np.sort(layout.slot[(charge != 0.0) | dipole.any(axis=1)]),
        layout.spread((charge / largest)[:, None]),
        layout.spread(dipole / largest) if dipole.any() else None)
