# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Mass and principal moments of a density in the shell that an expression of x, y, z gives.

The centre of mass must be the centre of the shell.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from icofabric_sim.geometry.mass_distribution import integrate_density
from icofabric_sim.geometry.shell import Shell
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.body_sizes import half_edge_of
from icofabric_sim.scene.expressions import Expression, make_expression
import numpy as np

BODY_AXES = ('x', 'y', 'z')
# Required relative error of integrals, and the largest that is accepted. An expression that jumps
# across rays from the centre converges slowly.
ERROR_RATIO, MAX_ERROR_RATIO = 1e-6, 5e-3
EVALUATION_LIMIT = 4_000_000
# Largest distance of the centre of mass over a, and largest product of inertia over the mean
# moment; below the same difference moments are equal. Points of the rule are symmetric, so the
# values of a symmetric density are round-off.
_SYMMETRY_RATIO = 1e-9


class Density(NamedTuple):
    """Integrals of a density."""

    mass: float  # [kg]
    moments: np.ndarray  # (3,) [kg m^2] about the principal axes
    axes: np.ndarray | None  # (3, 3) principal axes in body axes, by rows; None: the body axes
    error: float  # estimate, relative


def make_density(parameters: Parameters, prefix: str, shell: Shell) -> Density | None:
    """
    Return the density of `PREFIX.expression`, in a shell of the size of PREFIX; None without one.

    Raises ParameterError if another parameter gives the inertia, or if the density is refused.
    """
    name = f'{prefix}.expression'
    expression = make_expression(parameters, name, BODY_AXES, (1,))
    if expression is None:
        return None
    others = [f'{prefix}.inertia', f'{prefix}.principal_inertia']
    if prefix == 'shell':
        others.append('shell.layers')
    for other in others:
        value = parameters[other]
        if value and (not isinstance(value, Sequence) or any(value)):
            raise ParameterError(
                other, f'{name} and {other} both give the inertia: leave one out')
    size = half_edge_of(parameters, prefix, shell) / shell.half_edge
    return _integrate(
        expression, parameters[name], shell.half_edge * size, shell.thickness * size)


def density_values(expression: Expression, text: str, points: np.ndarray) -> np.ndarray:
    """Return the values at points (m, 3) [m]; raise ParameterError if one is not finite."""
    values = expression.values(**dict(zip(BODY_AXES, points.T)))[0]
    bad = ~np.isfinite(values)
    if bad.any():
        place = points[int(np.argmax(bad))].tolist()
        raise ParameterError(
            expression.name,
            f'{expression.name} {text!r} is not finite at x, y, z = {place} m in the shell; '
            'change the expression there')
    return values


# Scenes with other parameters have the same integrals, which take seconds.
@lru_cache(maxsize=32)
def _integrate(
    expression: Expression, text: str, half_edge: float, thickness: float
) -> Density:
    name = expression.name
    try:
        found = integrate_density(
            lambda points: density_values(expression, text, points), half_edge, thickness,
            tolerance=ERROR_RATIO, evaluation_limit=EVALUATION_LIMIT, needs_symmetry=False)
    except ParameterError:
        raise
    except ValueError as error:
        raise ParameterError(name, f'{name} {text!r}: {error}') from None
    if not found.mass > 0.0:
        raise ParameterError(
            name, f'{name} {text!r} is 0 in the whole shell: give a density above 0 kg/m^3')
    if not found.relative_error <= MAX_ERROR_RATIO:
        raise ParameterError(
            name, f'{name} {text!r}: the integral over the shell does not converge: its estimated '
            f'relative error is {found.relative_error:.2g}; give a smoother expression')
    if np.abs(found.centre_of_mass).max() > _SYMMETRY_RATIO * half_edge:
        raise ParameterError(
            name, f'{name} {text!r} puts the centre of mass at {found.centre_of_mass.tolist()} m; '
            'it must be the centre of the shell, to which poses and velocities refer: balance the '
            'density')
    moments = np.diag(found.inertia).copy()
    mean = float(moments.mean())
    axes = None
    if np.abs(found.inertia - np.diag(moments)).max() > _SYMMETRY_RATIO * mean:
        moments, vectors = np.linalg.eigh(found.inertia)
        vectors[:, 2] *= np.sign(np.linalg.det(vectors))
        axes = vectors.T
    elif np.ptp(moments) <= _SYMMETRY_RATIO * mean:
        moments[:] = mean
    return Density(found.mass, moments, axes, found.relative_error)
