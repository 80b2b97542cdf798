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
"""Packs the shells that connectors may run into."""

from icofabric_sim.geometry.icosahedron import face_geometry, inscribed_radius
from icofabric_sim.kernels.records import Shells
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.scene.attachments import are_given, attachment_points
import numpy as np

# A point this close to a face, in parts of the inscribed radius, lies on it.
_ON_FACE = 1e-9


def pack_shells(parameters: Parameters, half_edge: float) -> Shells | None:
    """
    How deep the attachment points lie below the faces; None where they are the edge midpoints.
    """
    if not are_given(parameters) and parameters['connector.attachment_scale'] == 1.0:
        return None
    normals, height = face_geometry(half_edge).normals, inscribed_radius(half_edge)
    depth = height - attachment_points(parameters, half_edge) @ normals.T
    depth[np.abs(depth) <= _ON_FACE * height] = 0.0
    depth[(depth > 0.0).all(axis=1)] = -np.inf
    return Shells(np.ascontiguousarray(normals), depth)
