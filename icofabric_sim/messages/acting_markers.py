# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
MarkerArray of loads, supports, planes and contacts for viewers.

A list marker for each kind replaces a marker for each arrow. Empty lists are sent as removals, so
that the display does not depend on earlier messages.
"""

from collections.abc import Iterator, Mapping
from typing import ClassVar, NamedTuple

from icofabric_sim.messages.cdr import CdrBuilder, split_nanoseconds
from icofabric_sim.messages.marker import append_fields_after_points, MarkerAction
from icofabric_sim.scene.planes import make_planes
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.contact.broad_phase import Touching
from icofabric_sim.simulation.inputs.input_types import Wrench
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.reports.load_cells import contact_arrows
import numpy as np

_LINE_LIST, _CUBE_LIST, _SPHERE_LIST, _TRIANGLE_LIST = 5, 6, 7, 11
# Largest number of arrows of one load; with more bodies, evenly spread ones get an arrow.
_MAX_ARROWS = 1000
# Largest number of lines of a plane in each direction.
_MAX_LINES = 60


class _List(NamedTuple):
    """Marker that is a list of points [m] in the frame of the fabric."""

    namespace: str
    number: int
    kind: int
    color: tuple[float, float, float, float]
    scale: tuple[float, float, float]  # [m]
    points: np.ndarray  # (n, 3)


class ActingMarkers:
    """Markers of one scene."""

    TYPE: ClassVar[str] = 'visualization_msgs/msg/MarkerArray'

    def __init__(self, scene: Scene) -> None:
        """Build the constant markers."""
        self._scene, self._frame_id = scene, scene.parameters['frame_id']
        # Points of each plane.
        self._planes, self._surfaces = _plane_lines(scene), _plane_triangles(scene)
        supports = scene.supports
        self._held = np.zeros(0, np.int64) if supports is None else np.flatnonzero(
            supports.translation.any(axis=1) | supports.rotation)

    def message(
        self, snapshot: Snapshot, nanoseconds: int, acting: Mapping[str | int, Wrench],
        touching: Touching, displaced: np.ndarray | None = None
    ) -> bytes:
        """
        Return the message at a time, with the active wrenches by channel or body number.

        Planes have moved by `displaced` (k, 3) [m]; None: not at all.
        `touching` contacts get a point, the normal of one edge length, and the forces on both
        shells, friction included; the largest force is two edges long.
        """
        edge = self._scene.shell.edge_length
        size = np.linalg.norm(touching.force, axis=1, keepdims=True)
        normal = touching.force / np.where(size > 0.0, size, 1.0)
        normals = np.stack(
            [touching.point, touching.point + edge * normal], axis=1).reshape(-1, 3)
        forces, torques = self._arrows(snapshot, acting)
        lists = (
            _List('forces', 0, _LINE_LIST, (0.90, 0.10, 0.10, 1.0), (0.1 * edge, 0, 0), forces),
            _List('torques', 0, _LINE_LIST, (0.95, 0.75, 0.10, 1.0), (0.1 * edge, 0, 0), torques),
            _List('supports', 0, _CUBE_LIST, (0.20, 0.30, 0.50, 0.8), (0.5 * edge,) * 3,
                  snapshot.position[self._held]),
            _List('planes', 0, _LINE_LIST, (0.45, 0.45, 0.45, 1.0), (0.04 * edge, 0, 0),
                  _moved(self._planes, displaced)),
            _List('plane_surfaces', 0, _TRIANGLE_LIST, (0.60, 0.60, 0.60, 0.4), (1.0,) * 3,
                  _moved(self._surfaces, displaced)),
            _List('contacts', 0, _SPHERE_LIST, (0.60, 0.10, 0.70, 1.0), (0.2 * edge,) * 3,
                  touching.point),
            _List('contact_normals', 0, _LINE_LIST, (0.60, 0.10, 0.70, 1.0),
                  (0.06 * edge, 0, 0), normals),
            _List('contact_forces', 0, _LINE_LIST, (0.00, 0.51, 0.41, 1.0),
                  (0.1 * edge, 0, 0), self._lines(contact_arrows(
                      touching.bodies, touching.point, touching.force + touching.spring))))
        layout = CdrBuilder()
        layout.numbers('I', len(lists))
        for item in lists:
            _append(layout, item, self._frame_id, nanoseconds)
        return bytes(layout.data)

    def _arrows(
        self, snapshot: Snapshot, acting: Mapping[str | int, Wrench]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the ends of force and torque lines; the largest of each is two edges long."""
        ends: list[list[np.ndarray]] = [[], []]
        for target, wrench in acting.items():
            channel = None if isinstance(target, int) else self._scene.loads[target]
            bodies = np.array([target]) if channel is None else channel.bodies
            bodies = bodies[:: max(1, len(bodies) // _MAX_ARROWS)]
            place, turn = snapshot.position[bodies], snapshot.orientation[bodies]
            if channel is not None and channel.is_divided:
                wrench = Wrench(*(part / len(channel.bodies) for part in wrench))
            point = np.zeros(3) if channel is None else np.asarray(channel.point)
            begin = place + _turned(turn, point)
            for kind, part in enumerate(wrench):
                if part.any():
                    along = _turned(turn, part) if channel is None or channel.in_body_axes else (
                        np.broadcast_to(part, begin.shape))
                    ends[kind].append(np.stack([begin, along], axis=1))
        forces, torques = (self._lines(
            np.concatenate(found) if found else np.zeros((0, 2, 3))) for found in ends)
        return forces, torques

    def _lines(self, arrows: np.ndarray) -> np.ndarray:
        """
        Return the ends of lines for points and vectors (k, 2, 3); the largest is two edges long.
        """
        size = np.linalg.norm(arrows[:, 1], axis=1).max(initial=0.0)
        scale = 2.0 * self._scene.shell.edge_length / size if size > 0.0 else 0.0
        return np.stack(
            [arrows[:, 0], arrows[:, 0] + scale * arrows[:, 1]], axis=1).reshape(-1, 3)


def _turned(orientation: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Rotate a vector from body axes, with `orientation` (n, 4) x y z w, to the world: (n, 3)."""
    axis, real = orientation[:, :3], orientation[:, 3:]
    twice = 2.0 * np.cross(axis, vector)
    return np.asarray(vector + real * twice + np.cross(axis, twice))


def _moved(points: list[np.ndarray], displaced: np.ndarray | None) -> np.ndarray:
    """Return the points (m, 3) of all planes, moved by their displacements."""
    shifts = np.zeros((len(points), 3)) if displaced is None else displaced
    return np.concatenate([np.zeros((0, 3)), *(
        part + shift for part, shift in zip(points, shifts))])


def _plane_lines(scene: Scene) -> list[np.ndarray]:
    """Return ends (m, 3) of lines two pitches apart on each plane, below or beside the fabric."""
    gap, reach = _plane_size(scene)
    offsets = np.arange(-reach, reach + 0.5 * gap, gap)
    lines = []
    for foot, first, second in _plane_frames(scene):
        own = []
        for along, across in ((first, second), (second, first)):
            begins = foot + offsets[:, None] * across
            own.append(np.stack([begins - reach * along, begins + reach * along], axis=1))
        lines.append(np.concatenate(own).reshape(-1, 3))
    return lines


def _plane_triangles(scene: Scene) -> list[np.ndarray]:
    """Return corners of triangles that fill the same squares, visible from both sides, (12, 3)."""
    _, reach = _plane_size(scene)
    corners = []
    for foot, first, second in _plane_frames(scene):
        square = foot + reach * np.array([
            -first - second, first - second, first + second, second - first])
        corners.append(square[[0, 1, 2, 0, 2, 3, 2, 1, 0, 3, 2, 0]])
    return corners


def _plane_size(scene: Scene) -> tuple[float, float]:
    """Return the line distance [m] and half the width [m] of the square shown of a plane."""
    span = scene.position.max(axis=0) - scene.position.min(axis=0)
    gap = 2.0 * scene.geometry.pitch
    return gap, float(gap * min(np.ceil(np.linalg.norm(span) / gap) + 1.0, _MAX_LINES / 2))


def _plane_frames(scene: Scene) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield a point of each plane, below or beside the fabric, and two unit vectors along it."""
    middle = 0.5 * (scene.position.min(axis=0) + scene.position.max(axis=0))
    for *normal, offset in make_planes(scene.parameters):
        normal = np.array(normal)
        foot = middle - (normal @ middle - offset) * normal
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        first /= np.linalg.norm(first)
        yield foot, first, np.cross(normal, first)


def _append(layout: CdrBuilder, item: _List, frame_id: str, nanoseconds: int) -> None:
    """Append a visualization_msgs/Marker."""
    layout.numbers('I', *split_nanoseconds(nanoseconds))
    layout.string(frame_id)
    layout.string(item.namespace)
    action = MarkerAction.ADD if len(item.points) else MarkerAction.DELETE
    layout.numbers('i', item.number, item.kind, action)
    layout.numbers('d', 0, 0, 0, 0, 0, 0, 1, *item.scale)
    layout.numbers('f', *item.color)
    layout.numbers('I', 0, 0)  # lifetime 0: until replaced
    layout.numbers('B', 0)  # frame_locked
    layout.numbers('I', len(item.points))
    if len(item.points):
        layout.align(8)
        layout.data.extend(np.ascontiguousarray(item.points, '<f8').tobytes())
    append_fields_after_points(layout)
