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
Draws the figures of docs/weave.md from the functions and tables that weaves are built from.

Figures 4, 6 and 7 of the document, the diagram of edges and connector ends that it wishes for,
and how the index alpha counts.

    .venv/bin/python docs/draw_weave.py docs
"""

import argparse
import math
from pathlib import Path
from typing import Any

from draw_concepts import (
    CONNECTOR,
    corners_of,
    EDGE,
    ends_of,
    GAP,
    new_figure,
    SHELL,
    woven,
)
from icofabric_sim.geometry.icosahedron import (
    FACES,
    NAMED_EDGE_VERTICES,
    NAMED_EDGES,
    vertices,
)
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.pictures.weave_diagram import connector_stubs, PAIR_COLORS
from icofabric_sim.scene.weave_tables import TABLE_5
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
import numpy as np
from scipy.spatial import ConvexHull

ANGLE = 0.25  # [rad]
# Pieces of a connector, so that near ones cover far ones along it.
PIECES = 8
LIGHT = np.array([0.35, -0.45, 0.82])
PATH = '#d55e00'


class Camera:
    """Parallel projection from a direction, given by two angles [degrees]."""

    def __init__(self, azimuth: float, elevation: float) -> None:
        turn, rise = math.radians(azimuth), math.radians(elevation)
        self.toward = np.array([
            math.cos(rise) * math.cos(turn), math.cos(rise) * math.sin(turn), math.sin(rise)])
        right = np.array([-math.sin(turn), math.cos(turn), 0.0])
        self.plane = np.stack([right, np.cross(self.toward, right)])

    def flat(self, points: np.ndarray) -> np.ndarray:
        """Places (..., 2) on the picture."""
        return np.asarray(points @ self.plane.T)


class Drawing:
    """Shells and lines, the far ones first."""

    def __init__(self, axes: Any, camera: Camera) -> None:
        self.axes, self.camera = axes, camera
        self._things: list[tuple[float, Any]] = []
        self._seen: list[np.ndarray] = []

    def shell(self, centre: np.ndarray, corners: np.ndarray, color: str,
              alpha: float = 1.0) -> None:
        self._seen.append(self.camera.flat(corners))
        faces = corners[FACES]
        normals = faces.mean(axis=1) - centre
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        front = normals @ self.camera.toward > 0.0
        shade = 0.66 + 0.34 * np.clip(normals[front] @ LIGHT, 0.0, 1.0)
        self._add(centre, PolyCollection(
            self.camera.flat(faces[front]), facecolors=shade[:, None] * np.array(to_rgb(color)),
            edgecolors=EDGE, lw=0.6, alpha=alpha))

    def line(self, ends: np.ndarray, color: str, width: float) -> None:
        self._seen.append(self.camera.flat(ends))
        stops = ends[0] + np.linspace(0.0, 1.0, PIECES + 1)[:, None] * (ends[1] - ends[0])
        for piece in zip(stops[:-1], stops[1:]):
            self._add(np.mean(piece, axis=0), LineCollection(
                [self.camera.flat(np.array(piece))], colors=color, lw=width,
                capstyle='round'))

    def text(self, place: np.ndarray, words: str, color: str, size: float = 9.0,
             weight: str = 'normal') -> None:
        self.axes.text(
            *self.camera.flat(place), words, color=color, fontsize=size, fontweight=weight,
            ha='center', va='center', zorder=10_000,
            bbox={'facecolor': 'white', 'alpha': 0.75, 'edgecolor': 'none', 'pad': 0.6})

    def finish(self, title: str) -> None:
        for order, (_, thing) in enumerate(sorted(self._things, key=lambda each: each[0])):
            thing.set_zorder(order)
            self.axes.add_collection(thing, autolim=False)
        self.axes.update_datalim(np.concatenate(self._seen))
        self.axes.autoscale_view()
        self.axes.set_aspect('equal')
        self.axes.set_axis_off()
        self.axes.set_title(title, fontsize=11)

    def _add(self, place: np.ndarray, thing: Any) -> None:
        self._things.append((float(place @ self.camera.toward), thing))


def draw_edges(axes: Any, variant: int, title: str) -> None:
    """One shell in the axes of the world: named edges, connector ends 1 to 12, body axes."""
    scene = woven(size=[2, 2, 2], variant=variant)
    turn = cosines_from_quaternions(scene.orientation[:1])[0]  # rows: body axes in the world
    drawing = Drawing(axes, Camera(30.0, 24.0))
    corners = vertices(1.0) @ turn
    drawing.shell(np.zeros(3), corners, '#f1ead9', 0.72)
    for letter, axis in zip('xyz', turn):
        drawing.line(np.array([1.62 * axis, 3.5 * axis]), '0.45', 1.0)
        drawing.text(3.72 * axis, f'body {letter}', '0.35')
    for edge, name in enumerate(NAMED_EDGES):
        color = PAIR_COLORS[edge // 2]
        ends = vertices(1.0)[NAMED_EDGE_VERTICES[edge]] @ turn
        # In front of the faces that meet there.
        drawing.line(1.01 * ends, color, 5.0)
        # Beside the end of the edge that is farther from the middle of the picture.
        outer = ends[np.argmax(np.linalg.norm(drawing.camera.flat(ends), axis=1))]
        drawing.text(1.3 * outer, name, color, 10.0, 'bold')
    for number, ((edge, _), stub) in enumerate(
            zip(TABLE_5, connector_stubs(1.0, ANGLE)), 1):
        near, far = stub @ turn
        end = near + 0.62 * (far - near)
        drawing.line(np.array([1.01 * near, end]), PAIR_COLORS[edge // 2], 2.2)
        drawing.text(end + 0.13 * (far - near), str(number), PAIR_COLORS[edge // 2], 10.0)
    drawing.finish(title)
    axes.set_xlim(-4.3, 4.3)
    axes.set_ylim(-4.3, 4.3)


def draw_neighbours(axes: Any, kind: str, title: str) -> None:
    """One shell and the twelve that connect to it."""
    scene = woven(kind=kind, size=[5, 5, 5])
    bodies = scene.connectors.bodies
    full = np.flatnonzero(np.bincount(bodies.ravel(), minlength=scene.body_count) == 12)
    middle = scene.position.mean(axis=0)
    body = int(full[np.argmin(np.linalg.norm(scene.position[full] - middle, axis=1))])
    own = np.flatnonzero((bodies == body).any(axis=1))
    drawing = Drawing(axes, Camera(-68.0, 24.0))
    for other in np.unique(bodies[own]).tolist():
        drawing.shell(scene.position[other], corners_of(scene, other),
                      *(('#e9c46a', 0.8) if other == body else (SHELL, 0.5)))
    ends = ends_of(scene)
    for number in own.tolist():
        edge = int(scene.connectors.edges[number][int(bodies[number, 1] == body)])
        drawing.line(ends[number], PAIR_COLORS[edge // 2], 2.2)
    drawing.finish(title)


def draw_slab(axes: Any, azimuth: float, elevation: float, title: str) -> None:
    """Figure 6: the slab of 3 x 3 x 3 in variant 0."""
    scene = woven(size=[3, 3, 3])
    drawing = Drawing(axes, Camera(azimuth, elevation))
    for body in range(scene.body_count):
        drawing.shell(scene.position[body], corners_of(scene, body), SHELL)
    for ends in ends_of(scene):
        drawing.line(ends, CONNECTOR, 1.8)
    drawing.finish(title)


def draw_count(axes: Any, variant: int, level: int) -> None:
    """One level of a slab from above: numbers alpha of its shells, in their order."""
    size = [4, 3, 2]
    scene = woven(size=size, variant=variant)
    grid = scene.weave.grid
    for i in range(size[0]):
        for j in range(size[1]):
            axes.plot(i, j, 's', color=GAP, ms=4)
    places = []
    for body, (i, j, k) in enumerate(grid.tolist()):
        if k != level:
            continue
        seen = corners_of(scene, body)[:, :2] - scene.position[body][:2]
        outline = seen[ConvexHull(seen).vertices] / scene.geometry.pitch
        axes.fill(*(outline + [i, j]).T, facecolor=SHELL, edgecolor=EDGE, lw=1.0, zorder=2)
        axes.text(i, j, str(body), ha='center', va='center', fontsize=9, zorder=4)
        places.append((i, j))
    for start, end in zip(places, places[1:]):
        axes.annotate('', end, start, zorder=3, arrowprops={
            'arrowstyle': '->', 'color': PATH, 'lw': 1.2, 'shrinkA': 11, 'shrinkB': 11})
    axes.set_title(f'variant {variant}, level {level}', fontsize=9)
    axes.set_xlim(-0.7, size[0] - 0.3)
    axes.set_ylim(-0.7, size[1] - 0.3)
    axes.set_aspect('equal')
    axes.set_axis_off()


def draw(folder: Path) -> list[Path]:
    """Draw all figures into a folder; returns their paths."""
    edges = new_figure(9.6, 5.4)
    for place, (variant, title) in enumerate((
            (0, 'variants 0 and 1: body axes are those of the world'),
            (2, 'variants 2 and 3: turned by 90 degrees about z'))):
        draw_edges(edges.add_subplot(1, 2, place + 1), variant, title)
    edges.subplots_adjust(0.01, 0.01, 0.99, 0.93, 0.02, 0.1)
    neighbours = new_figure(9.0, 4.6)
    draw_neighbours(neighbours.add_subplot(1, 2, 1), 'orthogonal', 'Figure 4: orthogonal')
    draw_neighbours(neighbours.add_subplot(1, 2, 2), 'bias', 'Figure 7: bias')
    neighbours.subplots_adjust(0.01, 0.01, 0.99, 0.93, 0.02, 0.1)
    slab = new_figure(9.0, 4.5)
    draw_slab(slab.add_subplot(1, 2, 1), -35.0, 20.0, 'Figure 6: from the front and the left')
    draw_slab(slab.add_subplot(1, 2, 2), 0.0, 0.0, 'from the front, along x')
    slab.subplots_adjust(0.01, 0.01, 0.99, 0.93, 0.02, 0.1)
    count = new_figure(8.6, 4.2)
    for variant in range(4):
        for level in range(2):
            draw_count(count.add_subplot(2, 4, 4 * level + variant + 1), variant, level)
    count.subplots_adjust(0.01, 0.01, 0.99, 0.93, 0.04, 0.16)
    paths = []
    for name, figure in (('edges', edges), ('neighbours', neighbours), ('slab', slab),
                         ('count', count)):
        paths.append(folder / f'weave_{name}.png')
        figure.savefig(paths[-1], metadata={'Software': None})
    return paths


def main() -> None:
    parser = argparse.ArgumentParser(description='Draw the figures of docs/weave.md.')
    parser.add_argument('folder', type=Path, help='where they go')
    for path in draw(parser.parse_args().folder):
        print(path)


if __name__ == '__main__':
    main()
