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

from typing import NamedTuple

from icofabric_sim.parameters.validation import ParameterError, Parameters
import numpy as np

# Bodies whose mutual forces are summed pair by pair: 25 million pairs, about 20 ms for each
# evaluation.
MOST_MUTUAL = 5000


class Electric(NamedTuple):
    """Charge and dipole of every shell, and the fields."""

    charge: float  # q [C]
    dipole: np.ndarray  # (3,) p [C m], body axes
    electric: np.ndarray  # (3,) E [V/m]
    magnetic: np.ndarray  # (3,) B [T]
    mutual: bool

    @property
    def force(self) -> np.ndarray:
        """Force q E [N] of the electric field on every body."""
        return self.charge * self.electric


def make_electric(parameters: Parameters, bodies: int) -> Electric:
    """What `charge.*` and `field.*` say of a scene of so many bodies."""
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
