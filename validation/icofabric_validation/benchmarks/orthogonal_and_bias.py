# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Slabs of orthogonal and bias fabric in tension, compression and shear, up to contact.

Stress against strain as CSV and picture, for point springs, bending stiffness and breakable
connectors, with the modulus of the periodic fabric in the same direction for comparison.

    .venv/bin/python -m icofabric_validation.benchmarks.orthogonal_and_bias
"""

import argparse
from pathlib import Path
import time
from typing import Any

import icofabric_sim as ico
from icofabric_sim.commands.report import write_csv
from icofabric_sim.statics.stress_strain import CURVE_COLUMNS, CurvePoint
from icofabric_validation.benchmarks.machine import machine_lines
import numpy as np

BENDING = 0.02  # [N m/rad], 0.4 k a^2
ANGLE = 0.3  # [rad]
# Largest strains.
STRAINS = {'pull': 0.3, 'push': 0.4, 'shear': 0.3}
FABRICS: dict[str, tuple[str, dict[str, Any]]] = {
    'orthogonal, point springs': ('orthogonal', {}),
    'orthogonal, bending': ('orthogonal', {'bending_stiffness': BENDING}),
    'orthogonal, bending, breaks': (
        'orthogonal', {'bending_stiffness': BENDING, 'break_length_extension': 0.055}),
    'bias, point springs': ('bias', {}),
    'bias, bending': ('bias', {'bending_stiffness': BENDING}),
    'bias, bending, breaks': (
        'bias', {'bending_stiffness': BENDING, 'break_length_extension': 0.055}),
}


def make_slab(kind: str, connector: dict[str, Any], size: list[int], contact: bool) -> ico.Scene:
    """Return a slab that fills the same box for every weave."""
    return ico.Scene.from_parameters({
        'weave': {'kind': kind, 'size': size, 'connector_angle': ANGLE},
        'connector': {'stiffness': 500.0, **connector},
        'contact': {'mode': 'auto' if contact else 'never'}})


def main() -> None:
    """Measure, write and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--size', default='9x5x5')
    parser.add_argument('--points', type=int, default=12, help='of a curve (%(default)d)')
    parser.add_argument('--fabrics', nargs='*', choices=FABRICS, default=list(FABRICS))
    parser.add_argument('--output', default='orthogonal_and_bias', help='folder (%(default)s)')
    arguments = parser.parse_args()
    folder = Path(arguments.output)
    folder.mkdir(parents=True, exist_ok=True)
    size = [int(part) for part in arguments.size.split('x')]
    print('\n'.join(machine_lines(('scipy',), threads='threads as chosen')))
    curves: dict[tuple[str, str], list[CurvePoint]] = {}
    for name in arguments.fabrics:
        kind, connector = FABRICS[name]
        scene = make_slab(kind, connector, size, contact=True)
        endless = ico.homogenise(scene).young_modulus(np.array([1.0, 0.0, 0.0]))
        print(f'{name}: {scene.body_count} bodies, {scene.connector_count} connectors; endless '
              f'fabric {endless:.0f} Pa', flush=True)
        for motion in STRAINS if 'breaks' not in name else ['pull']:
            strains = STRAINS[motion] * np.arange(1, arguments.points + 1) / arguments.points
            strains = np.concatenate([[1e-4], strains])
            began = time.perf_counter()
            points = ico.measure_curve(scene, motion, strains.tolist())
            curves[name, motion] = points
            print(f'  {motion}: {len(points)} of {len(strains)} states, '
                  f'{time.perf_counter() - began:.0f} s', flush=True)
            for point in points:
                print(f'    {point.strain:8.4f} {point.stress:10.4g} Pa  {point.verdict}, '
                      f'{point.obstructed} obstructed, {point.contact_pairs} touch, '
                      f'{point.broken} broken', flush=True)
    path = write_csv(folder / 'curves.csv', ('fabric', 'kind', *CURVE_COLUMNS), (
        (*names, *point.row()) for names, points in curves.items() for point in points))
    print(f'written to {path}')
    draw(folder / 'curves.png', curves)


def draw(path: Path, curves: dict[tuple[str, str], list[CurvePoint]]) -> None:
    """Draw stress against strain, one panel for each load case."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 4.2), layout='constrained')
    for axes, motion in zip(figure.subplots(1, len(STRAINS)), STRAINS):
        for name, (kind, _) in FABRICS.items():
            points = [point for point in curves.get((name, motion), [])
                      if point.verdict.startswith('equilibrium')]
            axes.plot(
                [0.0, *(point.strain for point in points)],
                [0.0, *(point.stress / 1e3 for point in points)], marker='.', label=name,
                color='tab:blue' if kind == 'orthogonal' else 'tab:orange',
                linestyle=':' if 'point' in name else '--' if 'breaks' in name else '-')
        axes.set(title=motion, xlabel='strain')
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel('stress [kPa]')
    figure.axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=90, metadata={'Software': None})
    print(f'drawn to {path}')


if __name__ == '__main__':
    main()
