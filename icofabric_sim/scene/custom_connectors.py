# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Custom connectors, `connectors.NAME`: springs between any points of any two bodies."""

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
    laws: np.ndarray  # (3, m) k_e [N/m], k_c [N/m], D [m]
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
        arms = np.einsum('mei,meij->mej', points, axes[bodies])
        ends = position[bodies] + arms
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        if not (length > _MIN_LENGTH_RATIO * geometry.pitch).all():
            one, two = bodies[int(np.argmin(length))].tolist()
            raise ParameterError(
                f'{prefix}.points', f'{prefix}.points: the points on bodies {one} and {two} '
                'coincide at rest, so the connector has no direction; move one of them')
        laws = np.array([spring_law(parameters, prefix, own) for own in length.tolist()])
        damping = parameters[f'{prefix}.damping']
        limits = [_limits(parameters, prefix, rest, own)
                  for rest, own in zip(laws[:, 2].tolist(), length.tolist())]
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


def _ends(
    parameters: Parameters, prefix: str, body_count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return bodies (m, 2), the lower one first, and points (m, 2, 3) [m] of `connectors.NAME`."""
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
    ends, places = bodies.astype(np.int32), rows[:, 2:].reshape(-1, 2, 3)
    turned = ends[:, 0] > ends[:, 1]
    ends[turned], places[turned] = ends[turned, ::-1], places[turned, ::-1]
    return ends, places
