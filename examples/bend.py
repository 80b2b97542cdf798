# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Bending: where a beam comes to rest, by statics and by a damped run, side by side.

    .venv/bin/python examples/bend.py --size 7 3 3
"""

import argparse
import time

import icofabric_sim as ico
import numpy as np

SCENE = {
    'weave.connector_angle': 0.3, 'contact.mode': 'never', 'connector.bending_stiffness': 0.02,
    'gravity': [0.0, 0.0, -9.81], 'groups.wall': 'x_min', 'groups.tip': 'x_max',
    'supports.wall.group': 'wall', 'drag.linear': 0.4, 'drag.angular': 4e-5,
    'solver.tolerance': 1e-4}


def bend(size, duration):
    """Sag [m] of the tip by statics and by motion, and the seconds of computing of each."""
    scene = ico.Scene.from_parameters({**SCENE, 'weave.size': list(size)})
    tip = scene.groups['tip']
    began = time.perf_counter()
    rest = ico.solve_equilibrium(scene)
    solved = time.perf_counter() - began
    simulation = ico.compile_scene(scene)
    began = time.perf_counter()
    simulation.advance_to(duration)
    ran = time.perf_counter() - began
    woven = scene.position[tip, 2].mean()
    sags = [woven - state.position[tip, 2].mean()
            for state in (rest.snapshot, simulation.snapshot())]
    apart = np.linalg.norm(rest.snapshot.position - simulation.snapshot().position, axis=1).max()
    return rest.verdict, sags, (solved, ran), float(apart)


def main():
    """Bend, print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--size', type=int, nargs=3, default=[7, 3, 3], metavar='N')
    parser.add_argument('--duration', type=float, default=4.0, help='of the run [s]')
    given = parser.parse_args()
    verdict, sags, seconds, apart = bend(given.size, given.duration)
    print(f'statics   the tip sags by {sags[0] * 1e3:.4f} mm; {seconds[0]:.2f} s; {verdict}')
    print(f'dynamics  the tip sags by {sags[1] * 1e3:.4f} mm after {given.duration:g} s; '
          f'{seconds[1]:.2f} s')
    print(f'apart     at most {apart * 1e3:.3g} mm')


if __name__ == '__main__':
    main()
