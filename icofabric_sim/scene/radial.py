# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Radial weave: an orthogonal weave bent round a cylinder, as defined in docs/radial.md.

The document mentions it without a definition ("curved connectors"); this project defines it.
"""

from dataclasses import replace
import math

from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.weave import Weave
from icofabric_sim.scene.weave_geometry import size_for_box, WeaveGeometry
import numpy as np

_ROUNDING_RATIO = 1e-9


def check_radius(parameters: Parameters, geometry: WeaveGeometry) -> float:
    """
    Return the radius [m] of the lowest level; weave.radius 0 gives a quarter circle.

    Raises ParameterError if the rows exceed a full circle, or shells would reach the axis.
    """
    box = parameters['weave.box']
    rows = (size_for_box(box, geometry) if any(box) else parameters['weave.size'])[0]
    radius: float = parameters['weave.radius']
    pitch = geometry.pitch
    if not radius > 0.0:
        return max(2.0 * (rows - 1) * pitch / math.pi, pitch)
    least = pitch * max(1.0, rows / (2.0 * math.pi))
    if not radius >= least * (1.0 - _ROUNDING_RATIO):
        raise ParameterError(
            'weave.radius',
            f'weave.radius {radius!r} m is too small for {rows} rows of pitch W = '
            f'{pitch:.9g} m: the smallest radius is {least:.9g} m, at which the rows fill a '
            'circle or shells meet at the axis; give a larger radius, fewer rows, or 0 for a '
            'quarter circle')
    return radius


def bend(weave: Weave, radius: float) -> Weave:
    """
    Bend an orthogonal slab round an axis parallel to its y axis.

    Row i of the lowest level lies at the angle (i - (N_x - 1) / 2) W / radius from the vertical,
    so rows are W apart along the arc. Level k lies k W farther out. Every body turns with its row.
    For a large radius the result approaches the orthogonal slab.
    """
    pitch = weave.geometry.pitch
    middle = 0.5 * (weave.size[0] - 1)
    angle = (weave.grid[:, 0] - middle) * (pitch / radius)
    height = weave.grid[:, 2] * pitch
    half = np.sin(0.5 * angle)
    position = np.array(weave.position)
    # r sin and r cos - radius, written so that a large radius causes no cancellation.
    position[:, 0] = middle * pitch + (radius + height) * np.sin(angle)
    position[:, 2] = height - 2.0 * (radius + height) * half * half
    # Rotation about y by the angle, after the common orientation of the slab.
    x, y, z, w = weave.orientation
    cosine = np.cos(0.5 * angle)
    orientation = np.column_stack([
        cosine * x + half * z, cosine * y + half * w, cosine * z - half * x,
        cosine * w - half * y])
    return replace(weave, kind='radial', position=position, orientation=orientation)


def bent_spans(weave: Weave, points: np.ndarray) -> np.ndarray:
    """Return the vectors from first to second ends of bent connectors [m], (c, 3), world frame."""
    axes = cosines_from_quaternions(weave.orientation)
    first, second = weave.connector_bodies.T
    edges = weave.connector_edges
    arms = [
        np.einsum('ci,cij->cj', points[edges[:, end]], axes[bodies])
        for end, bodies in enumerate((first, second))]
    spans: np.ndarray = weave.position[second] - weave.position[first] + arms[1] - arms[0]
    return spans
