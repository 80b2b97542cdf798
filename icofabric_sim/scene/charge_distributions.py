# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Charge, dipole and second moment of a charge density in the shell, by an expression or by layers.
"""

from functools import lru_cache, partial
from typing import NamedTuple

from icofabric_sim.geometry.mass_distribution import integrate_density
from icofabric_sim.geometry.shell import checked_layers, integrate_layers, Shell
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.densities import (
    BODY_AXES,
    density_values,
    ERROR_RATIO,
    EVALUATION_LIMIT,
    MAX_ERROR_RATIO,
)
from icofabric_sim.scene.expressions import Expression, make_expression
from icofabric_sim.scene.tables import read_numeric_table
import numpy as np

# Largest magnitude over the mean: above, the integrals cannot tell a peak from a pole.
_MAX_PEAK_RATIO = 1e6
# Largest difference of principal second moments, relative to the integral of the magnitude.
_ISOTROPY_RATIO = 1e-6


class ChargeDistribution(NamedTuple):
    """Integrals of a charge density, r from the centre in body axes."""

    charge: float  # [C]
    dipole: np.ndarray  # (3,) of r [C m]
    second: float  # [C m^2] of r r^T, s times the unit matrix; NaN if not of this form
    error: float  # estimate for charge, and dipole over a, relative to that of the magnitude


def check_distribution(
    parameters: Parameters, prefix: str, total: str
) -> tuple[str, Expression | None]:
    """
    Return the parameter that gives a charge density, '' without one, and its expression.

    `PREFIX.expression` or `PREFIX.layers` may; `total` is the name of the parameter of the charge.
    Raises ParameterError if several parameters give the charge or the dipole.
    """
    names = [name for name in (
        f'{prefix}.expression', f'{prefix}.layers') if parameters[name].strip()]
    if not names:
        return '', None
    given = [*names, *(
        name for name in (total, f'{prefix}.dipole') if np.any(parameters[name]))]
    if len(given) > 1:
        raise ParameterError(
            given[1], f'{given[0]} and {given[1]} both give charges or dipoles: leave one out')
    return names[0], make_expression(parameters, f'{prefix}.expression', BODY_AXES, (1,))


def make_distribution(
    parameters: Parameters, prefix: str, total: str, shell: Shell
) -> ChargeDistribution | None:
    """
    Return the distribution that `check_distribution` finds; None without one.

    Raises ParameterError if the density cannot be integrated.
    """
    name, expression = check_distribution(parameters, prefix, total)
    if not name:
        return None
    if expression is None:
        return _integrate_layers(name, parameters[name].strip(), shell)
    return _integrate_expression(
        expression, parameters[name], shell.half_edge, shell.thickness, shell.volume)


def _integrate_layers(name: str, file: str, shell: Shell) -> ChargeDistribution:
    table = read_numeric_table(
        name, file, {2: 'distance from the centre [m] and charge density [C/m^3]'},
        first='distances', unit='m')
    try:
        layers = checked_layers(shell.half_edge, table[:, 0], table[:, 1], 'C/m^3')
    except ValueError as error:
        raise ParameterError(name, f'{name}: {file}: {error}') from None
    charge, twice = integrate_layers(*layers)
    return ChargeDistribution(charge, np.zeros(3), 0.5 * twice, 0.0)


# Scenes with other parameters have the same integrals, which take seconds.
@lru_cache(maxsize=32)
def _integrate_expression(
    expression: Expression, text: str, half_edge: float, thickness: float, volume: float
) -> ChargeDistribution:
    """Integrate the positive and the negative part, because densities of mass are positive."""
    largest = 0.0

    def density(points: np.ndarray, sign: float) -> np.ndarray:
        nonlocal largest
        values = density_values(expression, text, points)
        largest = max(largest, float(np.abs(values).max()))
        return np.maximum(sign * values, 0.0)

    positive, negative = (
        integrate_density(
            partial(density, sign=sign), half_edge, thickness, tolerance=ERROR_RATIO,
            evaluation_limit=EVALUATION_LIMIT, needs_symmetry=False) for sign in (1.0, -1.0))
    size = positive.mass + negative.mass
    error = (positive.mass * positive.relative_error + negative.mass * negative.relative_error) / (
        size or 1.0)
    if not error <= MAX_ERROR_RATIO or largest * volume > _MAX_PEAK_RATIO * size:
        raise ParameterError(
            expression.name,
            f'{expression.name} {text!r}: the integral over the shell does not converge: its '
            f'estimated relative error is {error:.2g}, and the largest charge density found is '
            f'{largest:.3g} C/m^3; give a smoother expression')
    inertia = positive.inertia - negative.inertia
    twice = float(np.trace(inertia)) / 3.0
    off = float(np.abs(inertia - twice * np.eye(3)).max())
    isotropic = off <= _ISOTROPY_RATIO * size * half_edge**2
    return ChargeDistribution(
        positive.mass - negative.mass,
        positive.mass * positive.centre_of_mass - negative.mass * negative.centre_of_mass,
        0.5 * twice if isotropic else np.nan, error)
