# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Custom connectors, `connectors.NAME`: springs and hinges between any points of any two bodies.

A hinge is a penalty spring of natural length 0 between points that coincide at rest. With an axis
it is two such springs of half the stiffness, at the distances a on either side of the point.
"""

from typing import NamedTuple

from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.anchors import AnchorLimits, make_break_lengths
from icofabric_sim.scene.connector_laws import spring_law
from icofabric_sim.scene.tables import read_numeric_table
from icofabric_sim.scene.weave_geometry import WeaveGeometry
import numpy as np

# Connectors shorter than this fraction of the pitch have no defined direction.
_MIN_LENGTH_RATIO = 1e-6


class CustomConnectors(NamedTuple):
    """Custom connectors, numbered after those of the weave; sorted by name, then by table row."""

    names: tuple[str, ...]  # NAME of each, (m,)
    bodies: np.ndarray  # (m, 2) int32, the lower number first
    points: np.ndarray  # (m, 2, 3) [m] in the axes of each body
    length: np.ndarray  # (m,) [m] between bodies at rest
    laws: np.ndarray  # (3, m) k_e [N/m], k_c [N/m], D [m]; D of hinges is 0
    damping: np.ndarray  # (m,) [N s/m]
    limits: np.ndarray  # (2, m) L_e and L_c [m]; infinite and 0: never


def make_custom_connectors(
    parameters: Parameters, position: np.ndarray, orientation: np.ndarray,
    geometry: WeaveGeometry
) -> CustomConnectors | None:
    """
    Return all `connectors.NAME`, or None; raise ParameterError if one is invalid.

    `position` (n, 3) [m] and `orientation` (n, 4) are those of the bodies at rest.
    """
    names: list[str] = []
    columns: list[tuple[np.ndarray, ...]] = []
    axes = cosines_from_quaternions(orientation)
    for name in parameters.names('connectors'):
        prefix = f'connectors.{name}'
        if parameters['connector.obstruction'] == 'wrap':
            raise ParameterError(
                prefix, f'{prefix}: custom connectors are straight; take connector.obstruction '
                'warn or stop, or leave them out')
        bodies, points = _ends(parameters, prefix, len(position))
        damping, hinged = parameters[f'{prefix}.damping'], parameters[f'{prefix}.kind'] == 'hinge'
        if hinged:
            bodies, points = _hinge_ends(
                parameters, prefix, bodies, points, position, axes, geometry)
            length = np.zeros(len(bodies))
            stiffness = spring_law(parameters, prefix, geometry.connector_length)[0]
            share = 0.5 if any(parameters[f'{prefix}.axis']) else 1.0
            laws = np.tile([share * stiffness, share * stiffness, 0.0], (len(bodies), 1))
            limits = [_hinge_limits(parameters, prefix)] * len(bodies)
            damping = 0.0
        else:
            _refuse(parameters, prefix, ('axis',), 'only hinges have it; set kind to hinge')
            ends = position[bodies] + np.einsum('mei,meij->mej', points, axes[bodies])
            length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
            if not (length > _MIN_LENGTH_RATIO * geometry.pitch).all():
                one, two = bodies[int(np.argmin(length))].tolist()
                raise ParameterError(
                    f'{prefix}.points', f'{prefix}.points: the points on bodies {one} and {two} '
                    'coincide at rest, so the connector has no direction; move one of them, or '
                    'set kind to hinge')
            laws = np.array([spring_law(parameters, prefix, own) for own in length.tolist()])
            limits = [_limits(parameters, prefix, rest, own)
                      for rest, own in zip(laws[:, 2].tolist(), length.tolist())]
        turned = bodies[:, 0] > bodies[:, 1]
        bodies[turned], points[turned] = bodies[turned, ::-1], points[turned, ::-1]
        names += [name] * len(bodies)
        columns.append((
            bodies, points, length, laws,
            np.full(len(bodies), parameters['connector.damping'] if damping < 0.0 else damping),
            np.array(limits)))
    if not columns:
        return None
    bodies, points, length, laws, dampings, limit = (
        np.concatenate(parts) for parts in zip(*columns))
    return CustomConnectors(tuple(names), bodies, points, length, laws.T, dampings, limit.T)


def _limits(
    parameters: Parameters, prefix: str, rest: float, length: float
) -> AnchorLimits:
    """Return the break limits of a connector, which must hold at its length at rest [m]."""
    limits = make_break_lengths(parameters, prefix, rest)
    for name, wrong in (
            ('break_length_extension', length >= limits.longest),
            ('break_length_compression', length <= limits.shortest)):
        if wrong:
            raise ParameterError(
                f'{prefix}.{name}', f'{prefix}.{name} {parameters[f"{prefix}.{name}"]!r} m: the '
                f'connector is {length:.6g} m long at rest and would break at once; change the '
                'limit, or set 0 for a connector that never breaks')
    return limits


def _refuse(
    parameters: Parameters, prefix: str, fields: tuple[str, ...], why: str
) -> None:
    """Raise ParameterError for the first of these fields that is above 0."""
    for field in fields:
        value = parameters[f'{prefix}.{field}']
        if any(np.atleast_1d(value) > 0.0) or (field == 'axis' and any(value)):
            raise ParameterError(f'{prefix}.{field}', f'{prefix}.{field} {value!r}: {why}')


def _hinge_limits(parameters: Parameters, prefix: str) -> AnchorLimits:
    """Return the opening [m] at which a hinge breaks, without other properties of springs."""
    _refuse(
        parameters, prefix,
        ('natural_length', 'damping', 'break_length_compression', 'stiffness_compression'),
        'a hinge has none; leave it out')
    longest = parameters[f'{prefix}.break_length_extension']
    # Below the length 0 of a closed hinge.
    return AnchorLimits(longest, -1.0) if longest > 0.0 else AnchorLimits()


def _hinge_ends(
    parameters: Parameters, prefix: str, bodies: np.ndarray, points: np.ndarray,
    position: np.ndarray, axes: np.ndarray, geometry: WeaveGeometry
) -> tuple[np.ndarray, np.ndarray]:
    """Return bodies and points of hinges, whose second point is the place of the first at rest."""
    axis = np.array(parameters[f'{prefix}.axis'])
    size = float(np.linalg.norm(axis))
    if size > 0.0:
        arm = geometry.half_edge / size * axis
        bodies = np.repeat(bodies, 2, axis=0)
        points = np.repeat(points, 2, axis=0)
        points[0::2, 0] += arm
        points[1::2, 0] -= arm
    one, two = bodies.T
    place = position[one] + np.einsum('mi,mij->mj', points[:, 0], axes[one])
    second = np.einsum('mj,mij->mi', place - position[two], axes[two])
    given = points[:, 1].any(axis=1)
    if given.any() and not size > 0.0:
        apart = np.linalg.norm(second - points[:, 1], axis=1)[given]
        if (apart > _MIN_LENGTH_RATIO * geometry.pitch).any():
            raise ParameterError(
                f'{prefix}.points', f'{prefix}.points: the points are {apart.max():.6g} m apart '
                'at rest, and a hinge joins one place; set the last three numbers to 0')
    points[:, 1] = second
    return bodies, points


def _ends(
    parameters: Parameters, prefix: str, body_count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return bodies (m, 2) and points (m, 2, 3) [m] of `connectors.NAME`."""
    pair, points = parameters[f'{prefix}.bodies'], parameters[f'{prefix}.points']
    file, key = parameters[f'{prefix}.file'].strip(), f'{prefix}.bodies'
    rows = np.array([[*pair, *points]], float)
    if file:
        key = f'{prefix}.file'
        if any(pair) or any(points):
            other = 'bodies' if any(pair) else 'points'
            raise ParameterError(
                key, f'{key}: {prefix}.{other} is given too; give the table or bodies and points')
        rows = read_numeric_table(
            key, file, {8: 'two body numbers and x, y, z [m] of the point on each'}, first='')
    bodies = rows[:, :2]
    bad = (bodies != np.rint(bodies)).any(axis=1) | (bodies[:, 0] == bodies[:, 1]) | (
        (bodies < 0.0) | (bodies >= body_count)).any(axis=1)
    if bad.any():
        raise ParameterError(
            key, f'{key} must name two different bodies, numbered 0 to {body_count - 1}, got '
            f'{bodies[int(np.argmax(bad))].tolist()}')
    return bodies.astype(np.int32), rows[:, 2:].reshape(-1, 2, 3).copy()
