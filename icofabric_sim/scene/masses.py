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
"""
Masses and inertias of bodies: those of the shell, or their own.

All bodies are icosahedra of one size; what fills or braces them may differ. The inertia is
isotropic (eq 43), so the gyroscopic term vanishes for each of them.
"""

from collections.abc import Mapping
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import TAU
from icofabric_sim.geometry.shell import Shell
from icofabric_sim.parameters.validation import ParameterError, Parameters
import numpy as np


class BodyMasses(NamedTuple):
    """Masses and inertias, (n,), or (1,) where all are those of the shell."""

    mass: np.ndarray  # [kg]
    inertia: np.ndarray  # [kg m^2]

    @property
    def alike(self) -> bool:
        """Whether all bodies have those of the shell."""
        return len(self.mass) == 1

    def total(self, bodies: int) -> float:
        """Mass [kg] of all so many bodies."""
        return float(self.mass.sum()) if not self.alike else bodies * float(self.mass[0])


def own_masses(parameters: Parameters, shell: Shell) -> dict[str, tuple[float, float]]:
    """
    Mass [kg] and inertia [kg m^2] of each `masses.NAME` and `bodies.NAME` that has its own.

    What is not said is the shell's; the inertia scales with the mass, as within one shape.
    """
    found = {}
    for family in ('bodies', 'masses'):
        for name in parameters.names(family):
            prefix = f'{family}.{name}'
            mass, inertia = (parameters[f'{prefix}.{field}'] for field in ('mass', 'inertia'))
            if mass == inertia == 0.0:
                continue
            mass = mass or float(shell.mass)
            # All of the mass at the vertices, and a little for rounding.
            most = mass * shell.half_edge**2 * (TAU + 2.0) * 2.0 / 3.0
            if inertia > most * (1.0 + 1e-12):
                raise ParameterError(
                    f'{prefix}.inertia',
                    f'{prefix}.inertia {inertia!r} kg m^2 is more than {most:.6g} kg m^2, '
                    f'that of {mass:.6g} kg at the vertices of the icosahedron: no body in it has '
                    'so much; give a smaller one, or more mass')
            found[prefix] = mass, inertia or mass * float(shell.inertia / shell.mass)
    return found


def make_masses(
    parameters: Parameters, shell: Shell, groups: Mapping[str, np.ndarray], bodies: int
) -> BodyMasses:
    """Masses of so many bodies, loose ones last; of several groups the last counts."""
    own = own_masses(parameters, shell)
    mass, inertia = np.array([float(shell.mass)]), np.array([float(shell.inertia)])
    if not own:
        return BodyMasses(mass, inertia)
    mass, inertia = np.repeat(mass, bodies), np.repeat(inertia, bodies)
    loose = parameters.names('bodies')
    for prefix, (heavy, slow) in own.items():
        family, name = prefix.split('.')
        if family == 'bodies':
            members = np.array([bodies - len(loose) + loose.index(name)])
        else:
            members = groups[parameters[f'{prefix}.group']]
        mass[members], inertia[members] = heavy, slow
    return BodyMasses(mass, inertia)


def lightest(parameters: Parameters, shell: Shell) -> tuple[float, float]:
    """The smallest mass [kg] and the smallest inertia [kg m^2] of any body."""
    own = own_masses(parameters, shell).values()
    return (
        min([float(shell.mass), *(mass for mass, _ in own)]),
        min([float(shell.inertia), *(inertia for _, inertia in own)]))
