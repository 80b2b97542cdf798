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
"""
The radial weave, as defined in docs/radial.md: an orthogonal weave bent round a cylinder.

The document leaves it out ("curved connectors"), so this definition is our own.
"""

from dataclasses import replace
import math

from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.weave import Weave
from icofabric_sim.scene.weave_geometry import size_for_box, WeaveGeometry
import numpy as np

_ROUNDING = 1e-9


def check_radius(parameters: Parameters, geometry: WeaveGeometry) -> float:
    """
    Radius [m] of the lowest level; 0 means that the rows span a quarter of a circle.

    Raises ParameterError where rows would meet behind the axis or inside it.
    """
    box = parameters['weave.box']
    rows = (size_for_box(box, geometry) if any(box) else parameters['weave.size'])[0]
    radius: float = parameters['weave.radius']
    pitch = geometry.pitch
    if not radius > 0.0:
        return max(2.0 * (rows - 1) * pitch / math.pi, pitch)
    least = pitch * max(1.0, rows / (2.0 * math.pi))
    if not radius >= least * (1.0 - _ROUNDING):
        raise ParameterError(
            'weave.radius',
            f'weave.radius {radius!r} m is too small for {rows} rows of pitch W = '
            f'{pitch:.9g} m: they go once round a circle of radius {least:.9g} m, or shells '
            'meet at its axis; give a larger one, fewer rows, or 0 for a quarter of a circle')
    return radius


def bend(weave: Weave, radius: float) -> Weave:
    """
    Bend an orthogonal slab round an axis along its y.

    Row i of the lowest level lies at the angle (i - (N_x - 1) / 2) W / radius from the
    vertical, as far apart along the arc as in the slab; level k at the radius k W farther out.
    Every body turns with its row. For a large radius it is the orthogonal slab.
    """
    pitch = weave.geometry.pitch
    middle = 0.5 * (weave.size[0] - 1)
    angle = (weave.grid[:, 0] - middle) * (pitch / radius)
    height = weave.grid[:, 2] * pitch
    half = np.sin(0.5 * angle)
    position = np.array(weave.position)
    # r sin and r cos - radius, so written that a large radius loses no digits.
    position[:, 0] = middle * pitch + (radius + height) * np.sin(angle)
    position[:, 2] = height - 2.0 * (radius + height) * half * half
    # About y by the angle, after the orientation that all bodies have in the slab.
    x, y, z, w = weave.orientation
    cosine = np.cos(0.5 * angle)
    orientation = np.column_stack([
        cosine * x + half * z, cosine * y + half * w, cosine * z - half * x,
        cosine * w - half * y])
    return replace(weave, kind='radial', position=position, orientation=orientation)


def bent_spans(weave: Weave, points: np.ndarray) -> np.ndarray:
    """
    From the first end to the second of each connector in a bent weave [m], (c, 3), world frame.
    """
    axes = cosines_from_quaternions(weave.orientation)
    first, second = weave.connector_bodies.T
    edges = weave.connector_edges
    arms = [
        np.einsum('ci,cij->cj', points[edges[:, end]], axes[bodies])
        for end, bodies in enumerate((first, second))]
    spans: np.ndarray = weave.position[second] - weave.position[first] + arms[1] - arms[0]
    return spans
