# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A tearing test: a slab is pulled slowly until it breaks; stress, strain, and what breaks when.

    .venv/bin/python examples/tear.py runs/tear.csv --picture runs/tear.png
"""

import argparse
import csv
from pathlib import Path

import icofabric_sim as ico
from matplotlib.figure import Figure
import numpy as np

SCENE = {'weave.size': [5, 3, 3], 'weave.connector_angle': 0.3, 'contact.mode': 'never',
         'connector.bending_stiffness': 0.02}
LENGTHS = 1.06  # connectors break at so many of their woven lengths


def tear(strains):
    """Points of the curve, and for each the connectors that broke since the last."""
    woven = ico.Scene.from_parameters(SCENE).geometry.connector_length
    scene = ico.Scene.from_parameters(
        {**SCENE, 'connector.break_length_extension': LENGTHS * woven})
    points, broken = ico.measure_curve(scene, 'pull', strains), []
    before = np.ones(scene.connector_count, bool)
    for point in points:
        intact = point.snapshot.intact
        broken.append(np.flatnonzero(before & ~intact).tolist())
        before = intact
    return scene, points, broken


def draw(points, broken, path):
    """Draw stress over strain, with the number of connectors that broke at each strain."""
    figure = Figure(figsize=(6.4, 4.0), layout='constrained')
    axes = figure.add_subplot()
    strain = [100.0 * point.strain for point in points]
    stress = [point.stress for point in points]
    axes.plot(strain, stress, marker='o', color='#0072b2')
    for place, high, new in zip(strain, stress, broken):
        if new:
            axes.plot(place, high, marker='X', markersize=9, color='#d55e00')
            axes.annotate(f'{len(new)} break', (place, high), xytext=(5, 7),
                          textcoords='offset points')
    axes.set_xlabel('strain [%]')
    axes.set_ylabel('stress [Pa]')
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)


def main():
    """Tear, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('table', type=Path, help='a CSV file for strain and stress')
    parser.add_argument('--picture', type=Path, help='draw the curve: .png or .svg')
    arguments = parser.parse_args()
    path = arguments.table
    scene, points, broken = tear(np.linspace(0.02, 0.3, 15))
    for point, new in zip(points, broken):
        names = ', '.join(
            f'{number} ({"-".join(map(str, scene.connectors.bodies[number]))})' for number in new)
        print(f'strain {point.strain:.3f}  stress {point.stress:9.2f} Pa'
              + (f'  breaks: {names}' if new else ''))
    strongest = max(points, key=lambda point: point.stress)
    print(f'strength {strongest.stress:.4g} Pa at a strain of {strongest.strain:.3g}; '
          f'{points[-1].broken} of {scene.connector_count} connectors broken; '
          f'{points[-1].verdict}')
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, 'w', newline='', encoding='utf-8') as stream:
        table = csv.writer(stream)
        table.writerow(('strain', 'stress_pa', 'broken', 'broken_now'))
        table.writerows((point.strain, point.stress, point.broken, ' '.join(map(str, new)))
                        for point, new in zip(points, broken))
    if arguments.picture is not None:
        draw(points, broken, arguments.picture)


if __name__ == '__main__':
    main()
