# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Attachment points of connectors on their bodies, and their lengths as woven."""

from icofabric_sim.geometry.icosahedron import edge_midpoints, NAMED_EDGES
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.radial import bent_spans
from icofabric_sim.scene.weave import fabric_orientation, rotation_matrix, Weave
from icofabric_sim.scene.weave_geometry import WeaveGeometry
from icofabric_sim.scene.weave_tables import TABLE_5
import numpy as np

# Connectors shorter than this fraction of the pitch have no defined direction.
_MIN_LENGTH_RATIO = 1e-6
# Largest distance of a point from its body, in pitches; farther away round-off hides the weave.
_MAX_DISTANCE_PITCHES = 1e6
# Relative difference below which lengths count as equal.
_EQUAL_LENGTH_RATIO = 1e-12


def has_own_attachments(parameters: Parameters) -> bool:
    """Return True if the scene gives attachment points off the body axes."""
    return any(any(parameters[f'connector.attachment.{name}']) for name in NAMED_EDGES)


def attachment_points(parameters: Parameters, half_edge: float) -> np.ndarray:
    """Return the six attachment points [m], (6, 3), body axes, by edge code."""
    points = edge_midpoints(half_edge) * parameters['connector.attachment_scale']
    for code, name in enumerate(NAMED_EDGES):
        given = parameters[f'connector.attachment.{name}']
        if any(given):
            points[code] = given
    return points


def check_attachments(parameters: Parameters, geometry: WeaveGeometry) -> None:
    """Refuse points that make connectors vanish, or lie too far from their body."""
    points = attachment_points(parameters, geometry.half_edge)
    for name, point in zip(NAMED_EDGES, points):
        if not np.abs(point).max() <= _MAX_DISTANCE_PITCHES * geometry.pitch:
            name = f'connector.attachment.{name}'
            if not any(parameters[name]):
                name = 'connector.attachment_scale'
            raise ParameterError(
                name,
                f'{name} {parameters[name]!r} puts a point more than {_MAX_DISTANCE_PITCHES:g} '
                f'pitches of the weave ({geometry.pitch:g} m) from its body; give a smaller one')
    for code, step in TABLE_5:
        span = geometry.pitch * np.array(step) + points[code ^ 1] - points[code]
        if not np.linalg.norm(span) > _MIN_LENGTH_RATIO * geometry.pitch:
            one, other = NAMED_EDGES[code], NAMED_EDGES[code ^ 1]
            name = 'connector.attachment_scale'
            for edge in (one, other):
                if any(parameters[f'connector.attachment.{edge}']):
                    name = f'connector.attachment.{edge}'
            raise ParameterError(
                name,
                f'{name} {parameters[name]!r}: the points at {one} and {other} of two neighbours '
                f'coincide in the weave, so the connector between them has no length; move one of '
                'them, or give a longer weave.connector_length')


def woven_end_to_end(weave: Weave, azimuth: float, points: np.ndarray) -> np.ndarray:
    """
    Return the vector from the first to the second end of each connector as woven [m], (c, 3).

    `azimuth` [rad] is that of the weave, and `points` (6, 3) [m] are the attachment points. The
    vectors are in body axes, or in world axes for a radial weave, where bodies differ in
    orientation.
    """
    if weave.kind == 'radial':
        return bent_spans(weave, points)
    first, second = weave.connector_bodies.T
    fabric = rotation_matrix(fabric_orientation(weave.kind, azimuth))
    # From the fabric's axes to the body axes, which are the same for all bodies.
    to_body = np.round(rotation_matrix(weave.orientation).T @ fabric)
    steps = (weave.grid[second] - weave.grid[first]) @ to_body.T
    edges = weave.connector_edges
    return weave.geometry.pitch * steps + points[edges[:, 1]] - points[edges[:, 0]]


def woven_lengths(parameters: Parameters, weave: Weave) -> float | np.ndarray:
    """Return the woven length [m] of all connectors, or of each, (c,), if they differ."""
    if weave.kind != 'radial' and not has_own_attachments(parameters) and (
            parameters['connector.attachment_scale'] == 1.0):
        return weave.geometry.connector_length
    points = attachment_points(parameters, weave.geometry.half_edge)
    spans = woven_end_to_end(weave, parameters['weave.azimuth'], points)
    lengths: np.ndarray = np.linalg.norm(spans, axis=1)
    if not len(lengths):
        return weave.geometry.connector_length
    return float(lengths[0]) if np.ptp(lengths) <= _EQUAL_LENGTH_RATIO * lengths[0] else lengths
