# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
What stands around a fabric: floors and walls with shadows, and the plates that hold or move it.
"""

import math
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import circumscribed_radius
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.messages.markers import held_bodies
from icofabric_sim.pictures.camera import Camera
from icofabric_sim.pictures.light import Lighting
from icofabric_sim.pictures.moment import Moment
from icofabric_sim.scene.planes import planes_at
from icofabric_sim.scene.scene import Scene
import numpy as np

# A plane is shown this many times as far from its middle as what is shown reaches.
_REACH = 2.4
# Lines are some pitches apart, but at most so many in each direction.
_MOST_LINES = 24
_RIM_CORNERS = 96
# Plates: how thick they are, and how far they stand out around the bodies [half edges].
_THICKNESS, _MARGIN = 0.8, 1.6


class Ground(NamedTuple):
    """Drawn rectangle of a plane."""

    rim: np.ndarray  # (k, 3) [m]
    lines: np.ndarray  # (m, 2, 3) [m]
    normal: np.ndarray  # (3,) unit, towards the free side
    offset: float  # [m]
    faces_viewer: bool  # then what is on its free side is nearer than the plane

    def shadows(self, points: np.ndarray, lighting: Lighting) -> np.ndarray:
        """Return the shadows of points (..., 3) [m] on the plane; NaN without a shadow."""
        height = points @ self.normal - self.offset
        falls = float(lighting.lamp @ self.normal)
        if falls <= 0.05:
            return np.full(points.shape, np.nan)
        cast = points - (height / falls)[..., None] * lighting.lamp
        return np.where((height >= 0.0)[..., None], cast, np.nan)


def grounds(
    scene: Scene, camera: Camera, middle: np.ndarray, reach: float, time: float = 0.0
) -> list[Ground]:
    """
    Planes of a scene at a `time` [s] around a `middle` (3,) within `reach` [m], without far ones.
    """
    found = []
    for row in planes_at(scene.parameters, scene.platens, time):
        normal, offset = row[:3], float(row[3])
        height = float(normal @ middle) - offset
        if abs(height) > 3.0 * reach:
            continue
        foot = middle - height * normal
        first, second = _axes_in(normal)
        angle = np.arange(_RIM_CORNERS) * (2.0 * math.pi / _RIM_CORNERS)
        radius = _REACH * reach
        rim = foot + radius * (
            np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second)
        found.append(Ground(
            rim, _grid(foot, first, second, radius, scene.geometry.pitch), normal, offset,
            float(normal @ camera.eye) > offset))
    return sorted(found, key=lambda ground: not ground.faces_viewer)


def _axes_in(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Two unit vectors across a normal and each other, along the frame's own as far as possible.
    """
    least = np.eye(3)[np.argmin(np.abs(normal))]
    first = least - (least @ normal) * normal
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def _grid(
    foot: np.ndarray, first: np.ndarray, second: np.ndarray, radius: float, pitch: float
) -> np.ndarray:
    """Lines along the plane's own axes, a multiple of two pitches apart: (m, 2, 3)."""
    spacing = 2.0 * pitch * max(math.ceil(radius / (pitch * _MOST_LINES)), 1)
    lines = []
    for along, across in ((first, second), (second, first)):
        place = float(foot @ across)
        for number in range(math.ceil((place - radius) / spacing),
                            math.floor((place + radius) / spacing) + 1):
            away = number * spacing - place
            half = math.sqrt(max(radius**2 - away**2, 0.0))
            begin = foot + away * across
            lines.append([begin - half * along, begin + half * along])
    return np.array(lines).reshape(-1, 2, 3)


class Plate(NamedTuple):
    """Plate that holds or moves a layer of bodies at a side of the fabric."""

    bodies: np.ndarray  # (m,)
    corners: np.ndarray  # (8, 3) [m] at rest: four towards the fabric, four away from it
    normal: np.ndarray  # (3,) unit, towards the fabric at rest
    held: bool  # else driven


def plates(scene: Scene) -> list[Plate]:
    """Plates under, over or beside the layers that supports hold and drives move."""
    found = []
    for name in scene.parameters.names('supports'):
        bodies = scene.groups[scene.parameters[f'supports.{name}.group']]
        # Bodies that are free to turn hang on hooks, not on a plate.
        if held_bodies(scene)[bodies].all() and scene.supports is not None and (
                scene.supports.rotation[bodies].all()):
            found += _plate(scene, bodies, held=True)
    for drive in scene.drives.values():
        found += _plate(scene, drive.bodies, held=False)
    return found


def _plate(scene: Scene, bodies: np.ndarray, *, held: bool) -> list[Plate]:
    """Return the plate of a group that is most of an outermost layer; empty for other groups."""
    places, half_edge = scene.position[bodies], scene.shell.half_edge
    others = np.delete(scene.position, bodies, axis=0)
    if len(bodies) < 3 or not len(others):
        return []
    low, high = places.min(axis=0), places.max(axis=0)
    away = circumscribed_radius(half_edge)
    for axis in np.argsort(high - low):
        if high[axis] - low[axis] > 0.5 * half_edge:
            break
        for sign in (1.0, -1.0):
            inwards = sign * (others[:, axis] - places[:, axis].mean())
            beside = np.abs(inwards) <= 0.5 * half_edge
            if not (inwards.min() > -0.5 * half_edge and inwards.max() > half_edge
                    and beside.sum() <= len(bodies)):
                continue
            across = [other for other in range(3) if other != axis]
            if min(high[across] - low[across]) < half_edge:
                continue
            margin = away + (_MARGIN - 1.0) * half_edge
            corners = np.empty((8, 3))
            for number in range(8):
                first, second = (0, 0, 1, 1)[number % 4], (0, 1, 1, 0)[number % 4]
                corners[number, across[0]] = (low - margin, high + margin)[first][across[0]]
                corners[number, across[1]] = (low - margin, high + margin)[second][across[1]]
                corners[number, axis] = places[:, axis].mean() - sign * (
                    away + (_THICKNESS * half_edge if number >= 4 else 0.0))
            normal = np.zeros(3)
            normal[axis] = sign
            return [Plate(bodies, corners, normal, held)]
    return []


class PlacedPlate(NamedTuple):
    """A plate in one state."""

    faces: np.ndarray  # (k, 4, 3) [m] those towards the viewer
    normals: np.ndarray  # (k, 3)
    before: bool  # it hides the fabric


_FACES = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))


def moved_plate(plate: Plate, moment: Moment) -> tuple[np.ndarray, np.ndarray]:
    """Corners (8, 3) [m] and normal (3,) of a plate: it moves with its bodies as one of them."""
    scene, first = moment.scene, plate.bodies[0]
    # From rest to now, of the first body.
    rest, now = (cosines_from_quaternions(turns[first:first + 1])[0]
                 for turns in (scene.orientation, moment.orientation))
    turn = rest.T @ now
    corners = moment.position[first] + (plate.corners - scene.position[first]) @ turn
    return corners, plate.normal @ turn


def place_plate(plate: Plate, moment: Moment, camera: Camera) -> PlacedPlate:
    """Return the plate at the present position of its bodies."""
    corners, towards = moved_plate(plate, moment)
    middle = corners.mean(axis=0)
    faces, normals = [], []
    for numbers in _FACES:
        face = corners[list(numbers)]
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        normal /= np.linalg.norm(normal)
        if normal @ (face.mean(axis=0) - middle) < 0.0:
            normal = -normal
        if normal @ (camera.eye - face[0]) > 0.0:
            faces.append(face)
            normals.append(normal)
    inner = float((camera.eye - corners[0]) @ towards)
    return PlacedPlate(np.array(faces).reshape(-1, 4, 3), np.array(normals), inner < 0.0)
