# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Draws the figures of docs/weave.md: those of `pictures/document_figures.py`, and how alpha counts.

    .venv/bin/python docs/draw_weave.py docs
"""

import argparse
from pathlib import Path
from typing import Any

from icofabric_sim.pictures.document_figures import (
    Camera,
    corners_of,
    draw_edges,
    draw_fabric,
    draw_neighbours,
    EDGE_COLOR,
    GAP_COLOR,
    MARK_COLOR,
    new_figure,
    SHELL_COLOR,
    woven,
)
from scipy.spatial import ConvexHull


def draw_count(axes: Any, variant: int, level: int) -> None:
    """One level of a slab from above: numbers alpha of its shells, in their order."""
    size = [4, 3, 2]
    scene = woven(size=size, variant=variant)
    grid = scene.weave.grid
    for i in range(size[0]):
        for j in range(size[1]):
            axes.plot(i, j, 's', color=GAP_COLOR, ms=4)
    places = []
    for body, (i, j, k) in enumerate(grid.tolist()):
        if k != level:
            continue
        seen = corners_of(scene, body)[:, :2] - scene.position[body][:2]
        outline = seen[ConvexHull(seen).vertices] / scene.geometry.pitch
        axes.fill(*(outline + [i, j]).T, facecolor=SHELL_COLOR, edgecolor=EDGE_COLOR, lw=1.0,
                  zorder=2)
        axes.text(i, j, str(body), ha='center', va='center', fontsize=9, zorder=4)
        places.append((i, j))
    for start, end in zip(places, places[1:]):
        axes.annotate('', end, start, zorder=3, arrowprops={
            'arrowstyle': '->', 'color': MARK_COLOR, 'lw': 1.2, 'shrinkA': 11, 'shrinkB': 11})
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
    for place, (camera, title) in enumerate((
            (Camera(-35.0, 20.0), 'Figure 6: from the front and the left'),
            (Camera(0.0, 0.0), 'from the front, along x'))):
        draw_fabric(slab.add_subplot(1, 2, place + 1), woven(size=[3, 3, 3]), camera, title)
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
