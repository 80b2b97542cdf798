# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Draws the figures of docs/concepts.md from the functions that weaves are built from.

    .venv/bin/python docs/draw_concepts.py docs
"""

import argparse
import math
from pathlib import Path
from typing import Any

from icofabric_sim.geometry.icosahedron import NAMED_EDGE_VERTICES, NAMED_EDGES, vertices
from icofabric_sim.pictures.document_figures import (
    Camera,
    CONNECTOR_ANGLE,
    CONNECTOR_COLOR,
    corners_of,
    draw_fabric,
    EDGE_COLOR,
    ends_of,
    GAP_COLOR,
    MARK_COLOR,
    new_figure,
    SHELL_COLOR,
    woven,
)
from matplotlib.collections import LineCollection
import numpy as np
from scipy.spatial import ConvexHull

UP, DOWN = NAMED_EDGES.index('up'), NAMED_EDGES.index('down')


def arrow(axes: Any, start: tuple[float, float], end: tuple[float, float], text: str,
          shift: tuple[float, float]) -> None:
    """Draw a dimension line between two points, with its name beside the middle."""
    axes.annotate('', start, end, arrowprops={'arrowstyle': '<->', 'color': MARK_COLOR, 'lw': 1.3})
    axes.text((start[0] + end[0]) / 2 + shift[0], (start[1] + end[1]) / 2 + shift[1], text,
              color=MARK_COLOR, ha='center', va='center', fontsize=12)


def draw_lengths(axes: Any) -> None:
    """Two shells, seen along y: the six lengths of a weave."""
    scene = woven(size=[3, 3, 3])
    pitch, width = scene.geometry.pitch, scene.geometry.cube_width
    first = 0
    offset = scene.position - scene.position[first]
    second = int(np.argmin(np.linalg.norm(offset - [pitch, 0.0, pitch], axis=1)))
    for body in (first, second):
        seen = corners_of(scene, body)[:, [0, 2]] - scene.position[first][[0, 2]]
        outline = seen[ConvexHull(seen).vertices]
        axes.fill(*outline.T, facecolor=SHELL_COLOR, edgecolor=EDGE_COLOR, lw=1.2)
        centre = offset[body][[0, 2]]
        axes.plot(*centre, '.', color=EDGE_COLOR)
    a, b = np.array([0.0, width / 2]), np.array([pitch, pitch - width / 2])
    axes.plot(*np.stack([a, b]).T, color=CONNECTOR_COLOR, lw=3.0, solid_capstyle='round')
    length = float(np.hypot(*(b - a)))
    axes.text(a[0] + 0.4 * (b - a)[0], a[1] + 0.4 * (b - a)[1] + 0.003, 'connector, length L',
              color=CONNECTOR_COLOR, ha='center', fontsize=11,
              rotation=math.degrees(CONNECTOR_ANGLE))
    axes.plot([a[0], pitch], [a[1], a[1]], ':', color=MARK_COLOR, lw=1.0)
    turn = np.linspace(0.0, CONNECTOR_ANGLE, 20)
    axes.plot(*(a[:, None] + 0.55 * length * np.array([np.cos(turn), np.sin(turn)])),
              color=MARK_COLOR, lw=1.3)
    axes.text(a[0] + 0.72 * length, a[1] + 0.0025, r'angle $\theta$', color=MARK_COLOR,
              fontsize=12)
    low = -0.66 * width
    arrow(axes, (0.0, low), (pitch, low), 'W = L cos(angle), the pitch', (0.0, -0.004))
    side = -0.72 * width
    arrow(axes, (side, -width / 2), (side, width / 2), 'w', (-0.004, 0.0))
    right = pitch + 0.72 * width
    arrow(axes, (right, 0.0), (right, pitch), 'W', (0.004, 0.0))
    axes.plot([0.0, right], [0.0, 0.0], ':', color=MARK_COLOR, lw=1.0)
    axes.plot([pitch, right], [pitch, pitch], ':', color=MARK_COLOR, lw=1.0)
    for name, edge, centre, shift in (
            ('up', UP, np.zeros(2), -0.012), ('down', DOWN, np.array([pitch, pitch]), 0.014)):
        ends = vertices(scene.shell.half_edge)[NAMED_EDGE_VERTICES[edge]][:, [0, 2]]
        middle = centre + ends.mean(axis=0)
        axes.plot(*middle, 'o', color=CONNECTOR_COLOR, ms=7)
        axes.text(middle[0] + shift, middle[1] - math.copysign(0.003, shift), f'edge {name}',
                  color=CONNECTOR_COLOR, ha='center', va='center', fontsize=11)
    axes.text(0.0, -0.3 * width, 'w = 2 x 1.618 a, edge 2a', ha='center', fontsize=10)
    axes.set_xlim(-0.95 * width, right + 0.4 * width)
    axes.set_ylim(low - 0.25 * width, pitch + 0.6 * width)
    axes.set_aspect('equal')
    axes.set_axis_off()
    axes.set_title('Two shells and the connector between them, seen along y')


def draw_variant(axes: Any, variant: int) -> None:
    """Draw the lowest level of a slab from above, with the numbers of its shells."""
    scene = woven(size=[5, 4, 2], variant=variant)
    pitch = scene.geometry.pitch
    places = scene.position / pitch
    grid = np.rint(places - places.min(axis=0)).astype(int)
    for i in range(5):
        for j in range(4):
            axes.plot(i, j, 's', color=GAP_COLOR, ms=4)
    for (i, j, k), body in zip(grid.tolist(), range(scene.body_count)):
        if k == 0:
            seen = corners_of(scene, body)[:, :2]
            outline = (seen[ConvexHull(seen).vertices] - scene.position.min(axis=0)[:2]) / pitch
            axes.fill(*outline.T, facecolor=SHELL_COLOR, edgecolor=EDGE_COLOR, lw=1.0)
            axes.text(i, j, str(body), ha='center', va='center', fontsize=9)
    ends = ends_of(scene)
    level = grid[scene.connectors.bodies][:, :, 2]
    shown = (level == 0).all(axis=1)
    first = scene.position.min(axis=0)[:2]
    axes.add_collection(LineCollection(
        (ends[shown][:, :, :2] - first) / pitch, colors=CONNECTOR_COLOR, lw=1.5, zorder=1))
    turned = '' if variant < 2 else ', shells turned by 90 degrees'
    corner = 'shell' if variant % 2 == 0 else 'gap'
    axes.set_title(f'variant {variant}: {corner} in the corner{turned}', fontsize=9)
    axes.set_xlim(-0.7, 4.7)
    axes.set_ylim(-0.7, 3.7)
    axes.set_aspect('equal')
    axes.set_axis_off()


def draw(folder: Path) -> list[Path]:
    """Draw all figures into a folder; returns their paths."""
    lengths = new_figure(8.0, 6.4)
    draw_lengths(lengths.add_axes((0.02, 0.02, 0.96, 0.9)))
    variants = new_figure(8.6, 7.0)
    for variant in range(4):
        draw_variant(variants.add_subplot(2, 2, variant + 1), variant)
    variants.subplots_adjust(0.02, 0.02, 0.98, 0.94, 0.06, 0.12)
    weaves = new_figure(8.6, 4.4)
    for place, kind in enumerate(('orthogonal', 'bias')):
        draw_fabric(
            weaves.add_subplot(1, 2, place + 1), woven(kind=kind, size=[4, 3, 4]),
            Camera(-68.0, 14.0), kind)
    weaves.subplots_adjust(0.02, 0.02, 0.98, 0.92, 0.04, 0.1)
    paths = []
    for name, figure in (('lengths', lengths), ('variants', variants), ('weaves', weaves)):
        paths.append(folder / f'concepts_{name}.png')
        figure.savefig(paths[-1], metadata={'Software': None})
    return paths


def main() -> None:
    parser = argparse.ArgumentParser(description='Draw the figures of docs/concepts.md.')
    parser.add_argument('folder', type=Path, help='where they go')
    for path in draw(parser.parse_args().folder):
        print(path)


if __name__ == '__main__':
    main()
