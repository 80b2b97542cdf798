# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Elastic constants of the periodic fabric over the connector angle: a table, and a plot.

    .venv/bin/python examples/sweep_angle.py runs/sweep_angle.png
"""

import argparse
import math
from pathlib import Path

import icofabric_sim as ico
from matplotlib.figure import Figure
import numpy as np

BASE = {'weave.size': [3, 3, 3], 'connector.stiffness': 500.0,
        'connector.bending_stiffness': 0.02}
AXIS, DIAGONAL = np.array([1.0, 0.0, 0.0]), np.array([1.0, 1.0, 1.0])


def sweep(angles):
    """Rows of angle [rad], Young's modulus along x and along xyz, and shear modulus [Pa]."""
    rows = []
    for angle in angles:
        scene = ico.Scene.from_parameters({**BASE, 'weave.connector_angle': float(angle)})
        found = ico.homogenise(scene)
        rows.append((angle, found.young_modulus(AXIS), found.young_modulus(DIAGONAL),
                     found.stiffness[3, 3]))
    return np.array(rows, float)


def draw(rows, path):
    """Draw the moduli over the angle."""
    figure = Figure(figsize=(6.4, 4.0), layout='constrained')
    axes = figure.add_subplot()
    for column, label, style in (
            (1, 'E along x', '-'), (2, 'E along xyz', '--'), (3, 'shear yz', ':')):
        axes.semilogy(np.degrees(rows[:, 0]), rows[:, column], style, marker='o', label=label)
    axes.set_xlabel('connector angle [degrees]')
    axes.set_ylabel('modulus [Pa]')
    axes.legend()
    axes.grid(alpha=0.3)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)


def main():
    """Sweep, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('picture', type=Path, help='a file that ends in .png or .svg')
    path = parser.parse_args().picture
    rows = sweep(np.linspace(0.1, 0.7, 13))
    print('angle [rad]  E along x [Pa]  E along xyz [Pa]  shear yz [Pa]')
    for angle, *moduli in rows.tolist():
        print(f'{angle:11.3f}  {moduli[0]:14.5g}  {moduli[1]:16.5g}  {moduli[2]:13.5g}')
    draw(rows, path)
    stiffest = float(rows[np.argmax(rows[:, 1]), 0])
    print(f'stiffest along x at {stiffest:.3g} rad = {math.degrees(stiffest):.3g} degrees; {path}')


if __name__ == '__main__':
    main()
