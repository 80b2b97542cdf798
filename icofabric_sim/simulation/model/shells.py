# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Packing of the shells that obstruct connectors."""

from icofabric_sim.geometry.icosahedron import face_geometry, inscribed_radius
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.scene.attachments import attachment_points, has_own_attachments
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.layout import aligned_zeros, Layout
from icofabric_sim.terms.shells import Shells
import numpy as np

# Largest distance of a point on a face, over the inscribed radius.
_FACE_DISTANCE_RATIO = 1e-9


def pack_shells(parameters: Parameters, half_edge: float) -> Shells | None:
    """Return the depths of attachment points below faces; None if they are the edge midpoints."""
    if not has_own_attachments(parameters) and parameters['connector.attachment_scale'] == 1.0:
        return None
    depth = _depths(parameters, half_edge)
    depth[np.abs(depth) <= _FACE_DISTANCE_RATIO * inscribed_radius(half_edge)] = 0.0
    return Shells(_normals(), depth)


def pack_own_shells(scene: Scene, layout: Layout) -> Shells | None:
    """Return the depths of attachment points of a scene, whose woven shells may differ in size."""
    half_edge = scene.geometry.half_edge
    woven = scene.body_half_edges[:len(scene.weave.position)]
    if (woven == half_edge).all():
        return pack_shells(scene.parameters, half_edge)
    deeper = inscribed_radius(1.0) * (scene.body_half_edges - half_edge)
    by_slot = aligned_zeros((layout.slot_count,))
    by_slot[layout.slot] = deeper
    return Shells(
        _normals(), _depths(scene.parameters, half_edge), by_slot, deeper,
        _FACE_DISTANCE_RATIO * inscribed_radius(float(woven.min())))


def _depths(parameters: Parameters, half_edge: float) -> np.ndarray:
    """Return the depth [m] of each attachment point below each face, (6, 20)."""
    return np.asarray(
        inscribed_radius(half_edge) - attachment_points(parameters, half_edge) @ _normals().T)


def _normals() -> np.ndarray:
    """Return the outward normals of the faces, (20, 3)."""
    return np.ascontiguousarray(face_geometry(1.0).normals)
