# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Masses and inertias of a block: of all bodies, or of each."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import load, splat, Vector
from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Masses(Record):
    """Masses and inertias of bodies that are not all alike."""

    mass: np.ndarray  # (1, s) [kg]
    inertia: np.ndarray  # (1, s) [kg m^2]
    largest_mass: float  # [kg]
    largest_inertia: float  # [kg m^2]


@compiled
def masses_of(
    masses: Masses | None, inverse_mass: float, inverse_inertia: float, s: int
) -> tuple[Vector, Vector]:
    """
    Return masses [kg] and inertias [kg m^2] of a block; the inverse ones are those of all bodies.
    """
    if masses is None:
        return splat(1.0 / inverse_mass), splat(1.0 / inverse_inertia)
    else:
        return load(masses.mass, 0, s), load(masses.inertia, 0, s)


@compiled
def mass_at(
    masses: Masses | None, inverse_mass: float, inverse_inertia: float, s: int
) -> tuple[float, float]:
    """Return mass [kg] and inertia [kg m^2] of the body in one slot."""
    if masses is None:
        return 1.0 / inverse_mass, 1.0 / inverse_inertia
    else:
        return masses.mass[0, s], masses.inertia[0, s]


@compiled
def largest_of(
    masses: Masses | None, inverse_mass: float, inverse_inertia: float
) -> tuple[float, float]:
    """Return the largest mass [kg] and inertia [kg m^2]."""
    if masses is None:
        return 1.0 / inverse_mass, 1.0 / inverse_inertia
    else:
        return masses.largest_mass, masses.largest_inertia


@compiled
def units_of(
    masses: Masses | None, inverse_mass: float, inverse_inertia: float
) -> tuple[float, float]:
    """Return the factors of sums that are weighted by `weights_of`."""
    if masses is None:
        return 1.0 / inverse_mass, 1.0 / inverse_inertia
    else:
        return 1.0, 1.0


@compiled
def weights_of(masses: Masses | None, s: int) -> tuple[Vector, Vector]:
    """Return masses and inertias of a block in the units of `units_of`: 1 if all are alike."""
    if masses is None:
        return splat(1.0), splat(1.0)
    else:
        return load(masses.mass, 0, s), load(masses.inertia, 0, s)
