# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Charged shells in uniform fields and beside each other, as the scene describes them."""

from collections.abc import Mapping
from typing import NamedTuple

from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.profiles import make_profile, Profile, STEADY
import numpy as np

# Bodies whose mutual forces are summed pair by pair: 25 million pairs, about 20 ms for each
# evaluation.
MOST_MUTUAL = 5000
_FIELD = 'field'


class FieldWrench(NamedTuple):
    """A force [N] of the electric field on some bodies, at a point [m] in their own axes."""

    bodies: np.ndarray  # (m,) int32
    force: np.ndarray  # (3,) world frame
    point: np.ndarray  # (3,) from the centre


class Electric(NamedTuple):
    """Charges and dipoles of shells, and the fields; one row where all shells are alike."""

    charge: np.ndarray  # (n,) or (1,) q [C]
    dipole: np.ndarray  # (n, 3) or (1, 3) p [C m], body axes
    electric: np.ndarray  # (3,) E [V/m]
    magnetic: np.ndarray  # (3,) B [T]
    mutual: bool
    profile: Profile  # what E is multiplied by in time
    equal_masses: bool  # of the shells
    bodies: int  # how many there are

    @property
    def is_potential(self) -> bool:
        """Whether the electric field is part of the energy: one steady force on equal shells."""
        return len(self.charge) == 1 and self.profile == STEADY and self.equal_masses

    @property
    def force(self) -> np.ndarray:
        """Force q E [N] on every body of a field that `is_potential`; else 0."""
        return float(self.charge[0]) * self.electric if self.is_potential else np.zeros(3)

    def wrenches(self, size: float) -> list[FieldWrench]:
        """
        What the electric field does otherwise, as forces that keep their direction.

        q E at the centre, and for the torque p x E two opposite forces at points +-`size` [m]
        from it along p. Bodies with the same charge and dipole share their forces.
        """
        if self.is_potential or not self.electric.any():
            return []
        found = []
        rows, kind = np.unique(
            np.broadcast_to(np.column_stack([self.charge, self.dipole]), (self.bodies, 4)),
            axis=0, return_inverse=True)
        for number, (charge, *dipole) in enumerate(rows.tolist()):
            bodies = np.flatnonzero(kind.ravel() == number).astype(np.int32)
            if charge != 0.0:
                found.append(FieldWrench(bodies, charge * self.electric, np.zeros(3)))
            moment = float(np.linalg.norm(dipole))
            if moment > 0.0:
                point = size / moment * np.array(dipole)
                force = 0.5 * moment / size * self.electric
                found += [FieldWrench(bodies, force, point), FieldWrench(bodies, -force, -point)]
        return found


def is_charged(parameters: Parameters) -> bool:
    """Whether any shell has a charge or a dipole."""
    return parameters['charge.per_body'] != 0.0 or any(parameters['charge.dipole']) or any(
        parameters[f'charges.{name}.charge'] != 0.0 or any(parameters[f'charges.{name}.dipole'])
        for name in parameters.names('charges'))


def check_electric(parameters: Parameters, bodies: int) -> None:
    """Refuse what charges and fields cannot mean in a scene of so many bodies."""
    if parameters['charge.mutual'] and bodies > MOST_MUTUAL:
        raise ParameterError(
            'charge.mutual',
            f'charge.mutual with {bodies:,} bodies: the forces are summed over all pairs, which '
            f'takes time with the square of their number, so at most {MOST_MUTUAL:,} bodies can '
            'have them; choose a smaller weave, or false')
    if make_profile(parameters, _FIELD) != STEADY and any(parameters['field.magnetic']):
        raise ParameterError(
            'field.profile',
            f'field.profile {parameters["field.profile"]!r}, from field.start '
            f'{parameters["field.start"]!r} s on: a magnetic field that changes in time drives an '
            'electric one around wherever its coil is, which no parameter says; leave '
            'field.magnetic out, or let both be steady from the start')


def make_electric(
    parameters: Parameters, groups: Mapping[str, np.ndarray], bodies: int, *, equal_masses: bool
) -> Electric:
    """What `charge.*`, `charges.*` and `field.*` say of a scene of so many bodies."""
    check_electric(parameters, bodies)
    charge = np.array([parameters['charge.per_body']])
    dipole = np.array([parameters['charge.dipole']], float)
    own = parameters.names('charges')
    if own:
        charge, dipole = np.repeat(charge, bodies), np.repeat(dipole, bodies, axis=0)
    for name in own:
        # Of several groups that hold a body the last counts.
        members = groups[parameters[f'charges.{name}.group']]
        charge[members] = parameters[f'charges.{name}.charge']
        dipole[members] = parameters[f'charges.{name}.dipole']
    return Electric(
        charge, dipole, np.array(parameters['field.electric'], float),
        np.array(parameters['field.magnetic'], float), parameters['charge.mutual'],
        make_profile(parameters, _FIELD), equal_masses, bodies)
