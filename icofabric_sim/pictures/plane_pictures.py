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
Floors and walls in pictures: the part of each plane that lies in view, with lines to show its lie.
"""

import math
from typing import NamedTuple

from icofabric_sim.pictures.fabric_polygons import Bounds, View
from icofabric_sim.scene.planes import make_planes
from icofabric_sim.scene.scene import Scene
import numpy as np

# Planes are shown this part of the largest extent beyond the shells: to the sides and in depth,
# and above and below.
_BEYOND, _BELOW = 0.2, 0.05
# Lines are some pitches apart, but at most so many in each direction.
_MOST_LINES = 24
# Whatever is nearer to the line of sight is seen as a line.
_EDGE_ON = 1e-9


class PlanePicture(NamedTuple):
    """A plane as it is seen."""

    corners: np.ndarray  # (k, 2) [m], right and up; convex
    lines: np.ndarray  # (m, 2, 2) [m]
    faces_viewer: bool  # then what is on its free side is nearer than the plane


def plane_pictures(scene: Scene, view: View, bounds: Bounds) -> list[PlanePicture]:
    """Planes of a scene within `bounds`, the farthest first."""
    size = float((bounds.high - bounds.low).max())
    beyond = size * np.array([_BEYOND, _BELOW, _BEYOND])
    low, high = bounds.low - beyond, bounds.high + beyond
    shown = []
    for row in make_planes(scene.parameters):
        normal, offset = view.axes @ row[:3], float(row[3])
        corners = _cut_box(normal, offset, low, high)
        if len(corners) > 2:
            lines = _grid(row[:3], normal, offset, view, corners, scene.geometry.pitch)
            shown.append(PlanePicture(corners[:, :2], lines[:, :, :2], bool(normal[2] > 0.0)))
    return sorted(shown, key=lambda picture: not picture.faces_viewer)


def _cut_box(normal: np.ndarray, offset: float, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Corners (k, 3) of the plane in a box, in order around it; all in axes of the view."""
    points = []
    for axis in range(3):
        if abs(normal[axis]) <= _EDGE_ON:
            continue
        one, other = (axis + 1) % 3, (axis + 2) % 3
        for first in (low[one], high[one]):
            for second in (low[other], high[other]):
                along = (offset - normal[one] * first - normal[other] * second) / normal[axis]
                if low[axis] <= along <= high[axis]:
                    point = np.empty(3)
                    point[axis], point[one], point[other] = along, first, second
                    points.append(point)
    if len(points) < 3:
        return np.zeros((0, 3))
    found = np.array(points)
    away = found - found.mean(axis=0)
    first_axis, second_axis = _axes_in(normal)
    return found[np.argsort(np.arctan2(away @ second_axis, away @ first_axis), kind='stable')]


def _axes_in(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Two unit vectors across a normal and each other, along the frame's own as far as possible.
    """
    least = np.eye(3)[np.argmin(np.abs(normal))]
    first = least - (least @ normal) * normal
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def _grid(
    world_normal: np.ndarray, normal: np.ndarray, offset: float, view: View, corners: np.ndarray,
    pitch: float
) -> np.ndarray:
    """Lines along the plane's own axes in the world, cut to its corners: (m, 2, 3)."""
    axes = [view.axes @ axis for axis in _axes_in(world_normal)]
    flat = np.array([[corner @ axis for axis in axes] for corner in corners])
    extent = float((flat.max(axis=0) - flat.min(axis=0)).max())
    spacing = 2.0 * pitch * max(math.ceil(extent / (2.0 * pitch * _MOST_LINES)), 1)
    lines = []
    for across, along in ((0, 1), (1, 0)):
        start, end = flat[:, across].min(), flat[:, across].max()
        for number in range(math.ceil(start / spacing), math.floor(end / spacing) + 1):
            ends = _cut_polygon(flat, across, along, number * spacing)
            if len(ends) == 2:
                lines.append([
                    offset * normal + number * spacing * axes[across] + end * axes[along]
                    for end in ends])
    return np.array(lines).reshape(-1, 2, 3)


def _cut_polygon(flat: np.ndarray, across: int, along: int, value: float) -> list[float]:
    """
    Where the line of one coordinate leaves a convex polygon: the least and the largest other one.
    """
    found = []
    for one, other in zip(flat, np.roll(flat, -1, axis=0)):
        span = other[across] - one[across]
        if (one[across] - value) * (other[across] - value) <= 0.0 and span != 0.0:
            found.append(one[along] + (value - one[across]) / span * (other[along] - one[along]))
    return [min(found), max(found)] if found else []
