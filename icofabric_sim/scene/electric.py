# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Charges and dipoles of shells, uniform electric and magnetic fields, and mutual forces."""

from collections.abc import Mapping
from typing import NamedTuple

from icofabric_sim.geometry.shell import Shell
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.charge_distributions import (
    ChargeDistribution,
    check_distribution,
    make_distribution,
)
from icofabric_sim.scene.profiles import make_profile, Profile, STEADY_PROFILE
import numpy as np

# Most bodies with mutual forces summed over all pairs: 25 million pairs, about 20 ms per
# evaluation.
MAX_MUTUAL_BODIES = 5000
_FIELD = 'field'


class FieldWrench(NamedTuple):
    """Force of the electric field on some bodies, at a point in body axes."""

    bodies: np.ndarray  # (m,) int32
    force: np.ndarray  # (3,) world frame
    point: np.ndarray  # (3,) from the centre


class Electric(NamedTuple):
    """Charges and dipoles of shells, and the fields; one row if all shells are equal."""

    charge: np.ndarray  # (n,) or (1,) Q [C]
    dipole: np.ndarray  # (n, 3) or (1, 3) p [C m], body axes
    # (n,) or (1,) s [C m^2]: the integral of r r^T over the charge is s times the unit matrix;
    # NaN: that of a charge distributed like the mass
    second: np.ndarray
    electric: np.ndarray  # (3,) E [V/m]
    magnetic: np.ndarray  # (3,) B [T]
    mutual: bool
    profile: Profile  # time factor of E
    equal_masses: bool  # all shells have the same mass
    bodies: int  # number of bodies
    # Charge densities by the prefixes of their parameters.
    distributions: Mapping[str, ChargeDistribution]

    @property
    def is_potential(self) -> bool:
        """True if the field adds a potential energy: one steady force on equal shells."""
        return len(self.charge) == 1 and self.profile == STEADY_PROFILE and self.equal_masses

    @property
    def is_mutual(self) -> bool:
        """True if charges or dipoles of bodies act on each other."""
        return self.mutual and bool(self.charge.any() or self.dipole.any())

    @property
    def force(self) -> np.ndarray:
        """Force Q E [N] on every body if the field `is_potential`, else 0."""
        return float(self.charge[0]) * self.electric if self.is_potential else np.zeros(3)

    def wrenches(self, size: float) -> list[FieldWrench]:
        """
        Return the forces of a field without potential; they keep their world direction.

        The force q E acts at the centre. Two opposite forces at +-`size` [m] from the centre
        along p give the torque p x E. Bodies of equal charge and dipole share their forces.
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
    """Return True if any shell has a charge or a dipole."""
    return any(
        parameters[total] != 0.0 or any(parameters[f'{prefix}.dipole'])
        or check_distribution(parameters, prefix, total)[0]
        for prefix, total in _charge_prefixes(parameters))


def _charge_prefixes(parameters: Parameters) -> list[tuple[str, str]]:
    """Return prefixes of parameters of charges, and the name of the charge of each."""
    return [('charge', 'charge.per_body'), *(
        (f'charges.{name}', f'charges.{name}.charge') for name in parameters.names('charges'))]


def check_electric(parameters: Parameters, bodies: int) -> None:
    """Refuse unsupported combinations of charges and fields for this number of `bodies`."""
    for prefix, total in _charge_prefixes(parameters):
        check_distribution(parameters, prefix, total)
    if parameters['charge.mutual'] and bodies > MAX_MUTUAL_BODIES:
        raise ParameterError(
            'charge.mutual',
            f'charge.mutual with {bodies:,} bodies: the forces are summed over all pairs, at a '
            f'cost that grows with the square of the number of bodies, so at most '
            f'{MAX_MUTUAL_BODIES:,} bodies are allowed; choose a smaller weave, or false')
    if make_profile(parameters, _FIELD) != STEADY_PROFILE and any(parameters['field.magnetic']):
        raise ParameterError(
            'field.profile',
            f'field.profile {parameters["field.profile"]!r}, from field.start '
            f'{parameters["field.start"]!r} s on: a magnetic field that changes in time induces '
            'an electric field that depends on the coil, which no parameter describes; leave '
            'field.magnetic out, or make both fields steady from the start')


def make_electric(
    parameters: Parameters, groups: Mapping[str, np.ndarray], bodies: int, shell: Shell, *,
    equal_masses: bool
) -> Electric:
    """Return the charges and fields of `charge.*`, `charges.*` and `field.*`."""
    check_electric(parameters, bodies)
    # Charge, dipole and second moment.
    rows = np.zeros((1, 5))
    distributions = {}
    for prefix, total in _charge_prefixes(parameters):
        members: slice | np.ndarray = slice(None)
        if prefix != 'charge':
            # A body in several groups follows the last one.
            rows = np.broadcast_to(rows, (bodies, 5)).copy()
            members = groups[parameters[f'{prefix}.group']]
        rows[members] = parameters[total], *parameters[f'{prefix}.dipole'], np.nan
        found = make_distribution(parameters, prefix, total, shell)
        if found is not None:
            distributions[prefix] = found
            rows[members] = found.charge, *found.dipole, found.second
            _refuse_uneven(parameters, f'{prefix}.expression', found)
    return Electric(
        rows[:, 0].copy(), rows[:, 1:4].copy(), rows[:, 4].copy(),
        np.array(parameters['field.electric'], float),
        np.array(parameters['field.magnetic'], float), parameters['charge.mutual'],
        make_profile(parameters, _FIELD), equal_masses, bodies, distributions)


def _refuse_uneven(parameters: Parameters, name: str, found: ChargeDistribution) -> None:
    """Refuse a magnetic field if the second moments of charges are not isotropic."""
    if np.isnan(found.second) and any(parameters['field.magnetic']):
        raise ParameterError(
            name, f'{name} {parameters[name]!r}: the integrals of x x, y y and z z over the '
            'charge differ, or those of x y, y z and z x are not zero, and the torque of '
            'field.magnetic on such charges is not supported; leave field.magnetic out, or give a '
            'charge density that is alike along x, y and z')
