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
A fabric as flat, coloured polygons in drawing order: shells and connectors seen from far away.

The projection is orthographic, so lengths across the line of sight keep one scale. Whatever is
nearer is drawn later; shells are convex, so that of one shell only the faces towards the viewer
are drawn, in any order.
"""

import math
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import circumscribed_radius, face_geometry, outer_triangles
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.messages.markers import held_bodies, SHELL_CLASSES, STRAIN_CLASSES
from icofabric_sim.scene.scene import Scene
import numpy as np

BACKGROUND = np.array([1.0, 1.0, 1.0])
FREE_COLOR, HELD_COLOR = (np.array(entry.color[:3]) for entry in SHELL_CLASSES)
# Above this many bodies a shell is drawn as a disc: its faces would be a pixel or two wide.
LARGEST_SHELL_COUNT = 10_000
# From the viewer's upper left; the rest of the light comes from everywhere.
_LIGHT = np.array([-0.45, 0.60, 0.66])
_AMBIENT = 0.45
# Part of the background's colour in what is farthest away.
_HAZE = 0.45
# A connector is cut into pieces, so that each is drawn in front of and behind the right shells.
_PIECES = 4
_DISC_CORNERS = 12


class View(NamedTuple):
    """Where the viewer stands, as seen from the fabric."""

    azimuth: float = math.radians(-65.0)  # [rad] from +x towards +y
    elevation: float = math.radians(12.0)  # [rad] above the horizontal plane

    @property
    def axes(self) -> np.ndarray:
        """Rows: unit vectors to the right, upwards and towards the viewer, world components."""
        ca, sa = math.cos(self.azimuth), math.sin(self.azimuth)
        ce, se = math.cos(self.elevation), math.sin(self.elevation)
        return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])


class Bounds(NamedTuple):
    """What all pictures of a run show, so that they share one scale [m]."""

    low: np.ndarray  # (3,) right, up, towards the viewer
    high: np.ndarray

    def joined(self, other: 'Bounds') -> 'Bounds':
        """Bounds of both."""
        return Bounds(np.minimum(self.low, other.low), np.maximum(self.high, other.high))


class Polygons(NamedTuple):
    """Quadrilaterals (a triangle repeats a corner) in drawing order."""

    corners: np.ndarray  # (m, k, 2) [m], right and up
    colors: np.ndarray  # (m, 3)


def bounds_of(position: np.ndarray, half_edge: float, view: View) -> Bounds:
    """Bounds of shells at `position` (n, 3)."""
    seen = position @ view.axes.T
    radius = circumscribed_radius(half_edge)
    return Bounds(seen.min(axis=0) - radius, seen.max(axis=0) + radius)


def connector_ends(scene: Scene, position: np.ndarray, orientation: np.ndarray) -> np.ndarray:
    """World positions [m] of the ends of all connectors, (c, 2, 3)."""
    bodies = scene.connectors.bodies
    cosines = cosines_from_quaternions(orientation)[bodies]
    arms = np.einsum('cea,ceai->cei', scene.connectors.points_body, cosines)
    return np.asarray(position[bodies] + arms)


def strain_classes(scene: Scene, ends: np.ndarray) -> np.ndarray:
    """Number of the class in `markers.STRAIN_CLASSES` of each connector."""
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    strain = length / scene.connectors.natural_length - 1.0
    return np.searchsorted([entry.above for entry in STRAIN_CLASSES[1:]], strain, side='left')


def fabric_polygons(
    scene: Scene,
    position: np.ndarray,
    orientation: np.ndarray,
    *,
    view: View,
    bounds: Bounds,
    line_width: float,
    broken: np.ndarray | None = None,
) -> Polygons:
    """
    All that is to be drawn of a fabric in one state; connectors are `line_width` [m] wide.

    Without those whose numbers are `broken`.
    """
    axes = view.axes
    if scene.body_count > LARGEST_SHELL_COUNT:
        parts = [_discs(scene, position, axes)]
    else:
        parts = [_shells(scene, position, orientation, axes)]
    if scene.connector_count:
        parts.append(_connectors(scene, position, orientation, axes, line_width, broken))
    corners, colors, depth = (np.concatenate(column) for column in zip(*_padded(parts)))
    span = max(float(bounds.high[2] - bounds.low[2]), np.finfo(float).tiny)
    haze = _HAZE * np.clip((bounds.high[2] - depth) / span, 0.0, 1.0)[:, None]
    order = np.argsort(depth, kind='stable')
    return Polygons(corners[order], ((1.0 - haze) * colors + haze * BACKGROUND)[order])


_Part = tuple[np.ndarray, np.ndarray, np.ndarray]  # corners, colours, depth


def _padded(parts: list[_Part]) -> list[_Part]:
    most = max(corners.shape[1] for corners, _, _ in parts)
    result = []
    for corners, colors, depth in parts:
        missing = np.repeat(corners[:, -1:], most - corners.shape[1], axis=1)
        result.append((np.concatenate([corners, missing], axis=1), colors, depth))
    return result


def _body_colors(scene: Scene) -> np.ndarray:
    return np.where(held_bodies(scene)[:, None], HELD_COLOR, FREE_COLOR)


def _shells(
    scene: Scene, position: np.ndarray, orientation: np.ndarray, axes: np.ndarray
) -> _Part:
    half_edge = scene.shell.half_edge
    turned = np.einsum('nab,vb->nav', cosines_from_quaternions(orientation), axes)
    normals = np.einsum('fa,nav->nfv', face_geometry(half_edge).normals, turned)
    body, face = np.nonzero(normals[:, :, 2] > 0.0)
    corners = np.einsum('fka,nav->nfkv', outer_triangles(half_edge), turned)[body, face]
    centre = position @ axes.T
    corners += centre[body][:, None]
    light = np.clip(normals[body, face] @ _LIGHT, 0.0, 1.0)[:, None]
    colors = _body_colors(scene)[body] * (_AMBIENT + (1.0 - _AMBIENT) * light)
    return corners[:, :, :2], colors, centre[body, 2]


def _discs(scene: Scene, position: np.ndarray, axes: np.ndarray) -> _Part:
    angle = np.arange(_DISC_CORNERS) * (2.0 * np.pi / _DISC_CORNERS)
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    centre = position @ axes.T
    radius = 0.5 * scene.geometry.cube_width
    return centre[:, None, :2] + radius * rim, 0.85 * _body_colors(scene), centre[:, 2]


def _connectors(
    scene: Scene, position: np.ndarray, orientation: np.ndarray, axes: np.ndarray, width: float,
    broken: np.ndarray | None
) -> _Part:
    ends = connector_ends(scene, position, orientation)
    palette = np.array([entry.color[:3] for entry in STRAIN_CLASSES])
    colors = palette[strain_classes(scene, ends)]
    if broken is not None and len(broken):
        ends, colors = np.delete(ends, broken, axis=0), np.delete(colors, broken, axis=0)
    seen = ends @ axes.T
    pieces = 1 if scene.body_count > LARGEST_SHELL_COUNT else _PIECES
    at = np.linspace(0.0, 1.0, pieces + 1)[:, None, None]
    points = (1.0 - at) * seen[:, 0] + at * seen[:, 1]  # (pieces + 1, c, 3)
    start, stop = points[:-1].reshape(-1, 3), points[1:].reshape(-1, 3)
    along = (stop - start)[:, :2]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.divide(along, length, out=np.zeros_like(along), where=length > 0.0)
    side = 0.5 * width * np.stack([-along[:, 1], along[:, 0]], axis=1)
    first, last = start[:, :2], stop[:, :2]
    corners = np.stack([first - side, last - side, last + side, first + side], axis=1)
    return corners, np.tile(colors, (pieces, 1)), 0.5 * (start + stop)[:, 2]
