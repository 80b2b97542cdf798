# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Charged shells in uniform fields and beside each other: from parameters to what kernels take.
"""

from typing import NamedTuple

from icofabric_sim.kernels.records import Coulomb, Dipole, Magnet
from icofabric_sim.layout import Layout
from icofabric_sim.parameters import ParameterError, Parameters
import numpy as np

# 1 / (4 pi eps_0) [N m^2/C^2] with eps_0 = 8.8541878188e-12 F/m (CODATA 2022).
COULOMB_CONSTANT = 8.9875517862e9
# Bodies whose mutual forces are summed pair by pair: 25 million pairs, about 20 ms for each
# evaluation.
MOST_MUTUAL = 5000


class Electric(NamedTuple):
    """
    Charge and dipole of every shell, and the fields.
    """

    charge: float  # q [C]
    dipole: np.ndarray  # (3,) p [C m], body axes
    electric: np.ndarray  # (3,) E [V/m]
    magnetic: np.ndarray  # (3,) B [T]
    mutual: bool

    @property
    def force(self) -> np.ndarray:
        """
        Force q E [N] of the electric field on every body.
        """
        return self.charge * self.electric

    def pack_dipole(self) -> Dipole | None:
        """
        Dipoles in the electric field, if both are there.
        """
        largest = float(np.linalg.norm(self.dipole) * np.linalg.norm(self.electric))
        return Dipole(self.electric, self.dipole, largest) if largest > 0.0 else None

    def pack_magnet(self, mass: float, inertia: float) -> Magnet | None:
        """
        Charges and dipoles that move in the magnetic field, if both are there.
        """
        if not (self.magnetic.any() and (self.charge != 0.0 or self.dipole.any())):
            return None
        second = 0.5 * self.charge * inertia / mass
        return Magnet(self.magnetic, self.charge, self.dipole, second)

    def pack_coulomb(self, layout: Layout) -> Coulomb | None:
        """
        Charges on each other, if that is asked for.
        """
        if not (self.mutual and self.charge != 0.0 and layout.body_count > 1):
            return None
        return Coulomb(COULOMB_CONSTANT * self.charge**2, np.sort(layout.slot))


def make_electric(parameters: Parameters, bodies: int) -> Electric:
    """
    What `charge.*` and `field.*` say of a scene of so many bodies.
    """
    dipole, field, magnetic = (np.array(parameters[name], float) for name in (
        'charge.dipole', 'field.electric', 'field.magnetic'))
    electric = Electric(
        parameters['charge.per_body'], dipole, field, magnetic, parameters['charge.mutual'])
    if electric.mutual and bodies > MOST_MUTUAL:
        raise ParameterError(
            'charge.mutual',
            f'charge.mutual with {bodies:,} bodies: the forces are summed over all pairs, which '
            f'takes time with the square of their number, so at most {MOST_MUTUAL:,} bodies can '
            'have them; choose a smaller weave, or false')
    return electric
