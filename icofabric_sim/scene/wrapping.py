# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of scenes whose connectors wrap over their shells."""

from icofabric_sim.geometry.icosahedron import face_geometry, inscribed_radius, NAMED_EDGES
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.attachments import attachment_points

# Relative distance from a face below which a point counts as on the face.
_FACE_TOLERANCE_RATIO = 1e-9


def check_wrapping(parameters: Parameters, half_edge: float) -> None:
    """Refuse attachment points inside a shell of half edge a [m]: no path wraps from them."""
    name = 'connector.obstruction'
    if parameters[name] != 'wrap':
        return
    points = attachment_points(parameters, half_edge)
    # Distance of a point relative to the shell, 1 on the surface.
    out = (points @ face_geometry(half_edge).normals.T).max(axis=1) / inscribed_radius(half_edge)
    for edge, point, part in zip(NAMED_EDGES, points, out.tolist()):
        if part >= 1.0 - _FACE_TOLERANCE_RATIO:
            continue
        own, nearest = f'connector.attachment.{edge}', 'the edge midpoint'
        if not any(parameters[own]):
            own, nearest = 'connector.attachment_scale', '1'
        elif part > 0.0:
            nearest = str((point / part).tolist())
        raise ParameterError(
            own, f'{own} {parameters[own]!r} lies inside the shell, from where no path wraps over '
            f'it ({name} wrap): give a point on the shell or outside, such as {nearest}, or use '
            f'{name} warn')
