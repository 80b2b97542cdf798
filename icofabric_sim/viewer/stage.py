# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Scene graph of the page: shells, connectors and loads as nodes of viser.

Shells are one batched mesh with flat shading, so that facets show. Connectors are one line list
for each strain class. Only changes are sent. The scene is scaled up, because the shadows of viser
suit rooms: an object of a shell's size would be entirely in its own shadow.
"""

from collections.abc import Sequence
from typing import Any

from icofabric_sim.geometry import icosahedron
from icofabric_sim.messages import MarkerPoints
from icofabric_sim.messages.marker import MarkerAction
from icofabric_sim.messages.markers import OBSTRUCTED, SHELL_CLASSES, STRAIN_CLASSES
from icofabric_sim.viewer.sight import Fabric, Sight
import numpy as np

# Colours of anchors, of broken connectors and of drag lines.
_ANCHOR, _BROKEN, _PULL = (50, 165, 75), (30, 30, 30), (230, 60, 160)
_LINE_LIST, _TRIANGLE_LIST = 5, 11
# Half edge of a shell on the page.
_HALF_EDGE_UNITS = 0.1
_AXES = {'off': None, 'x': 0, 'y': 1, 'z': 2}


def _light(scene: Any) -> None:
    """
    Light the scene from the upper left, as in docs/gallery.md: the lamps of viser bleach colours.
    """
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map(None)
    scene.add_light_hemisphere(
        '/lamps/sky', sky_color=(255, 255, 255), ground_color=(150, 145, 140), intensity=0.9)
    scene.add_light_directional(
        '/lamps/sun', intensity=2.6, cast_shadow=True, position=(-0.2, -0.4, 1.0))


def rgb(color: Sequence[float] | np.ndarray) -> tuple[int, int, int]:
    """Return a colour of RViz (0 to 1) as bytes."""
    red, green, blue = (round(255 * part) for part in color[:3])
    return red, green, blue


class ClipPlane:
    """Clip plane: nothing beyond it is shown."""

    def __init__(self) -> None:
        """Show everything."""
        self.axis, self.place, self.number = 'off', 0.0, 0

    def set(self, axis: str, place: float) -> None:
        """Clip normal to a world axis at a `place` [m]."""
        self.axis, self.place = axis, place
        self.number += 1

    def shows(self, points: np.ndarray) -> np.ndarray:
        """Return which of the points (n, 3) [m] are shown."""
        axis = _AXES[self.axis]
        if axis is None:
            return np.ones(len(points), bool)
        return np.asarray(points[:, axis] <= self.place)


class Stage:
    """Nodes of a page's scene; use from one thread."""

    def __init__(self, scene: Any, sight: Sight) -> None:
        """Draw the data of `sight` into the `scene` of a viser server."""
        self._scene, self._sight = scene, sight
        self.section = ClipPlane()
        self.scale = 1.0  # page units per metre
        self.shells: Any = None
        self._lines: dict[str, Any] = {}
        self._others: dict[str, Any] = {}
        self._done = dict.fromkeys(('fabric', 'pose', 'line', 'marker', 'section', 'broken'), -1)
        self.frames = 0  # number of pose frames sent
        scene.set_up_direction('+z')
        _light(scene)

    def update(self, pulls: np.ndarray, poses: np.ndarray) -> bool:
        """Send changes and return whether the shells are new; `pulls` (m, 2, 3) are drag lines."""
        sight, fabric, done = self._sight, self._sight.fabric, self._done
        if fabric is None or len(poses) != fabric.scene.body_count:
            return False
        renewed = done['fabric'] != sight.fabric_number
        if renewed:
            self._begin(fabric, poses)
            done.update(fabric=sight.fabric_number, line=-1, marker=-1, broken=-1)
        cut = done['section'] != self.section.number
        if renewed or cut or done['pose'] != sight.pose_number:
            done['pose'] = sight.pose_number
            self._move(poses, fabric, cut=cut or self.section.axis != 'off')
        if cut or done['line'] != sight.line_number:
            done['line'] = sight.line_number
            for number, ends in sorted(sight.lines.items()):
                self._draw(f'connectors/{number}', ends, *self._look(number))
        if done['marker'] != sight.marker_number:
            done['marker'] = sight.marker_number
            for item in sight.markers.values():
                self._show(item)
        broken = sight.broken_ends(poses)
        if len(broken) or done['broken'] > 0:
            self._draw('broken', broken, _BROKEN, 0.5 * self._width)
        done['broken'] = len(broken)
        self._draw('pull', pulls, _PULL, 2.0 * self._width)
        done['section'] = self.section.number
        return renewed

    def _begin(self, fabric: Fabric, poses: np.ndarray) -> None:
        """Build the nodes of a weave."""
        half_edge = fabric.scene.shell.half_edge
        self.scale = _HALF_EDGE_UNITS / half_edge
        self._width = 0.16 * half_edge
        for handle in (*self._lines.values(), *self._others.values()):
            handle.remove()
        if self.shells is not None:
            self.shells.remove()
        self._lines, self._others = {}, {}
        colors = np.array([rgb(item.color) for item in SHELL_CLASSES], np.uint8)
        self.shells = self._scene.add_batched_meshes_simple(
            '/shells', icosahedron.vertices(_HALF_EDGE_UNITS), icosahedron.FACES,
            batched_wxyzs=_wxyz(poses), batched_positions=self._drawn(poses[:, :3]),
            batched_scales=self._shown(poses[:, :3], fabric),
            batched_colors=colors[fabric.held.astype(int)], flat_shading=True, lod='off')

    def _shown(self, positions: np.ndarray, fabric: Fabric) -> np.ndarray:
        """Return the size of each shell relative to the fabric's, 0 if hidden."""
        sizes = fabric.scene.body_half_edges / fabric.scene.shell.half_edge
        return (sizes * (self.section.shows(positions) & fabric.seen)).astype(np.float32)

    def _move(self, poses: np.ndarray, fabric: Fabric, *, cut: bool) -> None:
        positions = poses[:, :3]
        self.shells.batched_positions = self._drawn(positions)
        self.shells.batched_wxyzs = _wxyz(poses)
        if cut:
            self.shells.batched_scales = self._shown(positions, fabric)
        self.frames += 1

    def _drawn(self, points: np.ndarray) -> np.ndarray:
        """Return points [m] in page coordinates."""
        return (self.scale * points).astype(np.float32)

    def _look(self, number: int) -> tuple[tuple[int, int, int], float]:
        """Return the colour and thickness [m] of a list of connectors."""
        if number < len(STRAIN_CLASSES):
            return rgb(STRAIN_CLASSES[number].color), self._width
        if number == len(STRAIN_CLASSES):
            return _ANCHOR, self._width
        return rgb(OBSTRUCTED.color), self._width

    def _show(self, item: MarkerPoints) -> None:
        """Draw a list of `~/markers`: lines, triangles, or boxes at its points."""
        name = f'{item.namespace}/{item.marker_id}'
        there = item.action == MarkerAction.ADD
        if item.marker_type == _LINE_LIST:
            ends = item.points if there else np.zeros((0, 3))
            self._draw(name, ends.reshape(-1, 2, 3), rgb(item.color), max(item.scale[0], 1e-4))
            return
        old = self._others.pop(name, None)
        if old is not None:
            old.remove()
        if there and len(item.points) and item.marker_type == _TRIANGLE_LIST:
            self._others[name] = self._scene.add_mesh_simple(
                f'/{name}', self._drawn(item.points),
                np.arange(len(item.points)).reshape(-1, 3), color=rgb(item.color),
                opacity=float(item.color[3]), side='double', flat_shading=True, cast_shadow=False)
        elif there and len(item.points):
            # Cubes; any other list of points is drawn as marks of its size.
            corners = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
            self._others[name] = self._scene.add_batched_meshes_simple(
                f'/{name}', self.scale * corners * item.scale, _CUBE,
                batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (len(item.points), 1)),
                batched_positions=self._drawn(item.points),
                batched_colors=rgb(item.color), opacity=float(item.color[3]), side='double',
                flat_shading=True, cast_shadow=False)

    def _draw(
        self, name: str, ends: np.ndarray, color: tuple[int, int, int], width: float
    ) -> None:
        """Draw lines (m, 2, 3) [m] under a name, replacing earlier ones."""
        shown = ends[self.section.shows(ends[:, 0]) & self.section.shows(ends[:, 1])]
        handle = self._lines.get(name)
        if not len(shown):
            if handle is not None:
                handle.remove()
                del self._lines[name]
        elif handle is None:
            self._lines[name] = self._scene.add_line_segments(
                f'/{name}', self._drawn(shown), color, thickness=float(self.scale * width))
        else:
            handle.points = self._drawn(shown)


# Corners of a cube in the order of np.meshgrid.
_CUBE = np.array([
    [0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])


def _wxyz(poses: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(poses[:, [6, 3, 4, 5]], np.float32)
