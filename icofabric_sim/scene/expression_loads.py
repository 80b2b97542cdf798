# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Loads F(r, t) of eqs 15 and 47 by expressions: at points of bodies, and over faces or edges.

Loads over faces and edges are sums over the points of a Gauss rule. Its degree is the smallest of
a list for which the rule of twice that degree gives the same sums and first moments.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.electric import Electric
from icofabric_sim.scene.expression_times import critical_times
from icofabric_sim.scene.expressions import Expression, make_expression
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.profiles import make_profile, Profile
import numpy as np

# Coordinates (k, 2) and weights (k,) of the points of a rule, by its degree.
Rule = Callable[[int], tuple[np.ndarray, np.ndarray]]

_DEGREES = (2, 4, 8, 16, 32, 64)
# Differences of sums over the sum of magnitudes: that ends the search, and the largest allowed.
_TARGET_ERROR_RATIO, _MAX_ERROR_RATIO = 1e-8, 5e-3
# Rules of two degrees are compared where an expression varies most among these bodies and times.
_SAMPLE_COUNT, _SAMPLE_DEGREE, _MAX_SAMPLE_BODIES, _MAX_SAMPLE_TIMES = 32, 8, 500, 32
# Times [s] besides those at which the expression changes.
_SAMPLE_TIMES_S = (0.0, 0.1372, 0.7391, 3.1847)
PLACE = ('x', 'y', 'z', 't')


class Quadrature(NamedTuple):
    """The rule of a load over faces or edges."""

    degree: int
    error: float  # difference from the rule of twice the degree, over the sum of magnitudes


class PointLoad(NamedTuple):
    """A force at a point of each body."""

    expression: Expression  # three components [N] or, with a charge as the factor, [V/m]
    bodies: np.ndarray  # (m,) int32
    in_body_axes: bool
    point: np.ndarray  # (3,) [m], body axes
    factor: float
    profile: Profile


class SurfaceLoad(NamedTuple):
    """Forces over j faces or edges of each body, at k points of each."""

    expression: Expression  # factors of the directions
    bodies: np.ndarray  # (m,) int32
    mask: np.ndarray  # (m, j) faces or edges that are loaded
    points: np.ndarray  # (j, k, 3) [m], body axes
    weights: np.ndarray  # (k,) [m^2] or [m]
    coordinates: np.ndarray  # (k, 2)
    directions: np.ndarray  # (j, c, 3) force per area or length of the components, body axes
    normals: np.ndarray | None  # (j, 3) without friction: only the component along them acts
    # (m, 4) orientations at which forces of fixed direction have these directions; None: they
    # turn with the bodies
    woven: np.ndarray | None
    quadrature: Quadrature
    profile: Profile


def make_point_loads(
    parameters: Parameters, groups: Mapping[str, np.ndarray], electric: Electric, half_edge: float
) -> list[PointLoad]:
    """Return the loads of `loads.NAME.expression` and `field.electric_expression`."""
    found = []
    for name in parameters.names('loads'):
        prefix = f'loads.{name}'
        expression = make_expression(parameters, f'{prefix}.expression', PLACE, (3,))
        if expression is not None:
            bodies = groups[parameters[f'{prefix}.group']]
            share = 1.0 / len(bodies) if parameters[f'{prefix}.share'] == 'total' else 1.0
            found.append(PointLoad(
                expression, bodies, parameters[f'{prefix}.frame'] == 'body',
                np.array(parameters[f'{prefix}.point'], float), share,
                make_profile(parameters, prefix)))
    field = make_expression(parameters, 'field.electric_expression', PLACE, (3,))
    if field is not None:
        # A wrench of a field of 1 V/m has the charge as its force.
        unit = electric._replace(
            electric=np.array([1.0, 0.0, 0.0]), equal_masses=False)
        found += [
            PointLoad(
                field, part.bodies, False, part.point, float(part.force[0]), electric.profile)
            for part in unit.wrenches(half_edge)]
    return found


def check_point_loads(parameters: Parameters) -> None:
    """Check the expressions of forces at points, and of the electric field."""
    for name in parameters.names('loads'):
        make_expression(parameters, f'loads.{name}.expression', PLACE, (3,))
    make_expression(parameters, 'field.electric_expression', PLACE, (3,))


def choose_quadrature(
    expression: Expression, rule: Rule, places: Callable[[np.ndarray], dict[str, np.ndarray]]
) -> Quadrature:
    """
    Return the quadrature of an expression over faces or edges.

    `places` returns the variables at points of given coordinates, their last axis by points.
    Raises ParameterError if the sums do not converge.
    """
    error, before, known = np.inf, np.zeros(0), np.zeros(0, bool)
    for degree in (*_DEGREES, 2 * _DEGREES[-1]):
        coordinates, weights = rule(degree)
        values = expression.values(**places(coordinates)) * weights
        finite = np.isfinite(values).all(axis=(0, -1))
        values = np.where(finite[..., None], values, 0.0)
        sums = values @ np.column_stack([np.ones(len(weights)), coordinates])
        if degree > _DEGREES[0]:
            # Samples where the expression is not defined do not count.
            off = np.where((finite & known)[..., None], sums - before, 0.0)
            size = float(np.abs(values).sum(axis=-1).max())
            error = float(np.abs(off).max()) / size if size > 0.0 else np.nan
            if error <= _TARGET_ERROR_RATIO:
                return Quadrature(degree // 2, error)
        before, known = sums, finite
    # Not known if all samples are zero.
    if error > _MAX_ERROR_RATIO:
        raise ParameterError(
            expression.name,
            f'{expression.name}: sums over a face or an edge do not converge: Gauss rules of the '
            f'degrees {_DEGREES[-1]} and {2 * _DEGREES[-1]} differ by {error:.2g} of the sum of '
            f'magnitudes, more than {_MAX_ERROR_RATIO:g}; give a smoother expression')
    return Quadrature(_DEGREES[-1], error)


def sample_places(
    expression: Expression, rule: Rule, state: InitialState, bodies: np.ndarray,
    points: Callable[[np.ndarray], np.ndarray], duration: float
) -> Callable[[np.ndarray], dict[str, np.ndarray]]:
    """
    Return the function `places` for points (j, k, 3) [m] in body axes, by their coordinates.

    Samples are those of the `bodies` in their initial places, and of times until `duration` [s],
    for which the expression varies most over faces or edges.
    """
    chosen = bodies[np.unique(np.linspace(
        0, len(bodies) - 1, min(len(bodies), _MAX_SAMPLE_BODIES)).astype(int))]
    times = _SAMPLE_TIMES_S[:1]
    if 't' in expression.variables:
        changes = critical_times(expression, state.position[chosen]).times
        changes = changes[np.unique(np.linspace(
            0, len(changes) - 1, _MAX_SAMPLE_TIMES).astype(int))] if len(changes) else changes
        times = (*_SAMPLE_TIMES_S, *changes, *np.linspace(0.0, duration, _MAX_SAMPLE_TIMES)[1:])

    def at(time: np.ndarray | float, found: np.ndarray, coordinates: np.ndarray) -> dict[
            str, np.ndarray]:
        axes = cosines_from_quaternions(state.orientation[found])
        world = np.einsum('jkc,bci->ibjk', points(coordinates), axes)
        x, y, z = world + state.position[found].T[:, :, None, None]
        return {'x': x, 'y': y, 'z': z, 't': np.reshape(time, (-1, 1, 1)),
                **named_coordinates(coordinates)}

    coordinates, _ = rule(_SAMPLE_DEGREE)
    ranges = []
    for time in times:
        values = expression.values(**at(time, chosen, coordinates))
        values = np.where(np.isfinite(values), values, 0.0)
        ranges.append(np.ptp(values, axis=-1).max(axis=(0, 2)))
    # And some that are spread evenly.
    order = np.argsort(-np.ravel(ranges), kind='stable')[:_SAMPLE_COUNT]
    spread = np.linspace(0, len(times) * len(chosen) - 1, 8).astype(int)
    number, body = np.divmod(np.union1d(order, spread), len(chosen))
    sampled = np.array(times)[number]
    return lambda coordinates: at(sampled, chosen[body], coordinates)


def named_coordinates(coordinates: np.ndarray) -> dict[str, np.ndarray]:
    """Return xi and eta of faces, or s of edges, at points with coordinates (k, 2)."""
    first, second = coordinates.T
    return {'xi': first, 'eta': second, 's': first}
