# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Indentation and impact: a shell pressed into a slab step by step, and a heavy one that hits it.

    .venv/bin/python examples/indent.py runs/indent.csv
    .venv/bin/python examples/indent.py runs/indent.csv --size 2
"""

import argparse
import csv
from pathlib import Path

import icofabric_sim as ico
import numpy as np

# A close slab on a floor of held shells; its shells and the ball push each other.
SLAB = {
    'weave.size': [5, 5, 3], 'weave.connector_angle': 0.0, 'connector.bending_stiffness': 0.02,
    'contact.stiffness': 2e4, 'groups.low': 'z_min', 'supports.floor.group': 'low'}


def ball_above(gap, size):
    """
    Parameters of a ball over the middle of the slab, `gap` [m] above its first touch.

    `size`: its edge over that of the slab's shells.
    """
    bare = ico.Scene.from_parameters(SLAB)
    place = bare.position
    middle = 0.5 * (place.min(axis=0) + place.max(axis=0))
    top = place[place[:, 2] > place[:, 2].max() - 1e-9]
    over = top[np.argmin(np.linalg.norm(top[:, :2] - middle[:2], axis=1))]
    # Edge across edge: each is half a cube width high.
    height = 0.5 * (1.0 + size) * bare.geometry.cube_width + gap
    return {'bodies.ball.position': [float(over[0]), float(over[1]), float(over[2] + height)],
            'bodies.ball.edge_length': size * bare.shell.edge_length}


def indent(depths, size):
    """Force [N] on the ball, and of the floor, at each depth [m] below the first touch."""
    rows, last = [], None
    count = ico.Scene.from_parameters(SLAB).body_count
    for depth in depths:
        scene = ico.Scene.from_parameters({
            **SLAB, **ball_above(-depth, size), 'groups.ball': f'ids {count}',
            'supports.ball.group': 'ball'})
        found = ico.solve_equilibrium(scene, start=last)
        if not found.converged:
            print(f'{depth * 1e3:.2f} mm: {found.verdict}: {found.reason}')
            break
        last = found.snapshot
        borne = dict(zip(found.reactions.names, found.reactions.force[:, 2].tolist()))
        rows.append([
            depth, -borne['supports.ball'], borne['supports.floor'],
            len(found.contact_state.pairs), found.snapshot.energy['total']])
    return rows


def strike(mass, size, speed, duration):
    """Return the share of energy that a ball of `mass` [kg] keeps in an impact, and its speed."""
    scene = ico.Scene.from_parameters({
        **SLAB, **ball_above(1e-3, size), 'bodies.ball.mass': mass,
        'bodies.ball.linear_velocity': [0.0, 0.0, -speed], 'solver.tolerance': 1e-3})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(duration)
    velocity = simulation.snapshot().linear_velocity[-1]
    return float((velocity**2).sum() / speed**2), float(velocity[2])


def main():
    """Press, write, strike."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('output', help='CSV file of forces over depths')
    parser.add_argument('--depth', type=float, default=0.006, help='the deepest [m]')
    parser.add_argument('--steps', type=int, default=6)
    parser.add_argument('--size', type=float, default=1.0, help='edge of the ball over theirs')
    parser.add_argument('--masses', type=float, nargs='*', default=[0.01, 0.1, 1.0], metavar='KG')
    given = parser.parse_args()
    rows = indent(np.linspace(0.0, given.depth, given.steps + 1)[1:].tolist(), given.size)
    path = Path(given.output)
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, 'w', newline='', encoding='utf-8') as stream:
        table = csv.writer(stream)
        table.writerow(['depth_m', 'force_n', 'floor_n', 'touching_pairs', 'energy_j'])
        table.writerows(rows)
    for depth, force, floor, pairs, _ in rows:
        print(f'pressed {depth * 1e3:5.2f} mm: {force:8.4f} N, the floor bears {floor:8.4f} N; '
              f'{pairs} pairs touch')
    for mass in given.masses:
        kept, velocity = strike(mass, given.size, 0.5, 0.1)
        print(f'a ball of {mass:g} kg hits at 0.5 m/s: after 0.1 s it moves at {velocity:+.3f} '
              f'm/s and has {100.0 * kept:.1f} % of its energy')


if __name__ == '__main__':
    main()
