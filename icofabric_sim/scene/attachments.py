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
"""Where connectors attach to their bodies, and how long they are in the weave."""

from icofabric_sim.geometry.icosahedron import edge_midpoints, NAMED_EDGES
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.radial import bent_spans
from icofabric_sim.scene.weave import fabric_orientation, rotation_matrix, Weave
from icofabric_sim.scene.weave_geometry import WeaveGeometry
from icofabric_sim.scene.weave_tables import TABLE_5
import numpy as np

# Connectors shorter than this part of the pitch have no direction.
_SHORTEST = 1e-6
# How far from its body a point may lie, in pitches: beyond it rounding hides the weave.
_FARTHEST = 1e6
# Lengths that differ by less, relatively, are taken for one.
_ROUNDING = 1e-12


def are_given(parameters: Parameters) -> bool:
    """Whether there are attachment points other than on the body axes."""
    return any(any(parameters[f'connector.attachment.{name}']) for name in NAMED_EDGES)


def attachment_points(parameters: Parameters, half_edge: float) -> np.ndarray:
    """The six points in body axes [m], (6, 3), by edge code."""
    points = edge_midpoints(half_edge) * parameters['connector.attachment_scale']
    for code, name in enumerate(NAMED_EDGES):
        given = parameters[f'connector.attachment.{name}']
        if any(given):
            points[code] = given
    return points


def check_attachments(parameters: Parameters, geometry: WeaveGeometry) -> None:
    """Refuse points that leave connectors without a length, or lie beyond all bodies."""
    points = attachment_points(parameters, geometry.half_edge)
    for name, point in zip(NAMED_EDGES, points):
        if not np.abs(point).max() <= _FARTHEST * geometry.pitch:
            name = f'connector.attachment.{name}'
            if not any(parameters[name]):
                name = 'connector.attachment_scale'
            raise ParameterError(
                name,
                f'{name} {parameters[name]!r} puts a point more than {_FARTHEST:g} times as far '
                f'from its body as bodies are apart ({geometry.pitch:g} m); give a smaller one')
    for code, step in TABLE_5:
        span = geometry.pitch * np.array(step) + points[code ^ 1] - points[code]
        if not np.linalg.norm(span) > _SHORTEST * geometry.pitch:
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


def woven_spans(weave: Weave, azimuth: float, points: np.ndarray) -> np.ndarray:
    """
    From the first end to the second of each connector in the weave [m], (c, 3), in body axes.

    `azimuth` [rad] is that of the weave, `points` (6, 3) [m] the attachment points. In a radial
    weave, where bodies are turned each by its own angle, in world axes.
    """
    if weave.kind == 'radial':
        return bent_spans(weave, points)
    first, second = weave.connector_bodies.T
    fabric = rotation_matrix(fabric_orientation(weave.kind, azimuth))
    # From the fabric's axes to those that all bodies have in common.
    to_body = np.round(rotation_matrix(weave.orientation).T @ fabric)
    steps = (weave.grid[second] - weave.grid[first]) @ to_body.T
    edges = weave.connector_edges
    return weave.geometry.pitch * steps + points[edges[:, 1]] - points[edges[:, 0]]


def woven_lengths(parameters: Parameters, weave: Weave) -> float | np.ndarray:
    """Woven lengths [m] of all connectors, or of each, (c,), where they differ."""
    if weave.kind != 'radial' and not are_given(parameters) and (
            parameters['connector.attachment_scale'] == 1.0):
        return weave.geometry.connector_length
    points = attachment_points(parameters, weave.geometry.half_edge)
    spans = woven_spans(weave, parameters['weave.azimuth'], points)
    lengths: np.ndarray = np.linalg.norm(spans, axis=1)
    if not len(lengths):
        return weave.geometry.connector_length
    return float(lengths[0]) if np.ptp(lengths) <= _ROUNDING * lengths[0] else lengths
