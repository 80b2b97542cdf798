# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A pile of loose icosahedra in a box, with damping, with and without friction: until they rest.

Prints how deep they overlap, how the kinetic energy falls beside its largest, and what it takes.

    .venv/bin/python -m icofabric_validation.benchmarks.pile  # 216 bodies, with friction
    .venv/bin/python -m icofabric_validation.benchmarks.pile --size 3 3 6  # 27
    .venv/bin/python -m icofabric_validation.benchmarks.pile --friction 0 --damping 10 \
        --calm 3e-4 --longest 5

Without friction shells slide and roll freely until they meet, and slow meetings take little: what
a loose tolerance adds would keep them going, so the last part has its own.
"""

import argparse
import math
import time
from typing import Any

import icofabric_sim as ico
from icofabric_validation.benchmarks.machine import describe_machine
import numpy as np

# Half edge [m]; room beside the outermost bodies and below the lowest [m].
A, BESIDE, BELOW = 0.01, 0.004, 0.02
# Radii of a shell [m]; regression.py builds piles for commits that lay functions elsewhere.
TAU = (1.0 + math.sqrt(5.0)) / 2.0
CIRCUMSCRIBED, INSCRIBED = A * math.sqrt(1.0 + TAU * TAU), A * (TAU * TAU / math.sqrt(3.0))
# They rest once their kinetic energy is this part of the largest at ten looks, SPACING [s] apart.
REST, LOOKS, SPACING = 1e-6, 10, 0.01
# The last part begins where it is this: more than what errors of a loose tolerance keep alive.
CALM = 1e-2


def pile(size: tuple[int, int, int], **changes: Any) -> ico.Scene:
    """
    Bodies at woven places that do not touch, a little displaced by their velocities, in a box.
    """
    flat: dict[str, Any] = {
        'weave.size': list(size), 'weave.connected': False, 'weave.connector_length': 0.027,
        'gravity': [0.0, 0.0, -9.81], 'contact.stiffness': 2e6, 'contact.damping': 5.0,
        'contact.friction': 0.4, 'initial_random.velocity_sigma': 0.1,
        'initial_random.spin_sigma': 20.0, 'initial_random.seed': 1, 'solver.tolerance': 1.0,
        **changes}
    place = ico.Scene.from_parameters(flat).position
    low, high = place.min(axis=0), place.max(axis=0)
    room = CIRCUMSCRIBED + BESIDE
    for name, axis, side in (('west', 0, 1.0), ('east', 0, -1.0), ('south', 1, 1.0),
                             ('north', 1, -1.0), ('floor', 2, 1.0)):
        flat[f'planes.{name}.normal'] = [side if k == axis else 0.0 for k in range(3)]
        edge = low[axis] - room if side > 0.0 else -(high[axis] + room)
        flat[f'planes.{name}.offset'] = float(edge - (BELOW if name == 'floor' else 0.0))
    return ico.Scene.from_parameters(flat)


def settle(
    simulation: ico.Simulation, longest: float, *, show: bool = False, rest: float = REST,
    peak: float = 0.0
) -> dict[str, float]:
    """
    Let a pile come to `rest`, or run for `longest` [s]; what was seen.

    `peak`: the largest kinetic energy [J] so far.
    """
    start, calm, begun = time.perf_counter(), 0, simulation.time
    while calm < LOOKS and simulation.time < begun + longest:
        simulation.advance_to(simulation.time + SPACING)
        energy = simulation.snapshot().energy
        peak = max(peak, energy['kinetic'])
        calm = calm + 1 if energy['kinetic'] < rest * peak else 0
        if show and round(simulation.time / SPACING) % 10 == 0:
            print(f't = {simulation.time:5.2f} s  kinetic energy {energy["kinetic"] / peak:8.1e} '
                  f'of its largest  {simulation.status.step_count:7d} steps  '
                  f'{time.perf_counter() - start:6.0f} s', flush=True)
    return {
        'time': simulation.time, 'rested': float(calm == LOOKS),
        'steps': simulation.status.step_count,
        'kinetic': energy['kinetic'] / peak, 'peak': peak,
        'balance': energy['balance_error'] / peak,
        'deepest': simulation.status.deepest_overlap / A, 'wall': time.perf_counter() - start,
        'outside': outside(simulation)}


def come_to_rest(
    simulation: ico.Simulation, calm: float, longest: float, *, show: bool = False
) -> tuple[dict[str, float], ico.Simulation]:
    """
    As `settle`, the last part with the tolerance `calm` (0: the same); and what is then there.
    """
    seen = settle(simulation, longest, show=show, rest=CALM if calm else REST)
    if not (calm and seen['rested']):
        return seen, simulation
    calmer = ico.compile_scene(ico.Scene.from_parameters(
        {**simulation.scene.parameters, 'solver.tolerance': calm}))
    calmer.take_over(simulation, keep_motion=True)
    last = settle(calmer, longest - simulation.time, show=show, peak=seen['peak'])
    last['steps'] += seen['steps']
    last['wall'] += seen['wall']
    last['deepest'] = max(last['deepest'], seen['deepest'])
    return last, calmer


def outside(simulation: ico.Simulation) -> float:
    """How far a centre is nearer to a plane than the inscribed radius, over a, at most."""
    place, values = simulation.snapshot().position, simulation.scene.parameters
    heights = [
        place @ np.array(values[f'planes.{name}.normal']) - values[f'planes.{name}.offset']
        for name in values.names('planes')]
    return (INSCRIBED - float(np.min(heights))) / A


def main() -> None:
    """Run one pile and print what was seen."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--size', type=int, nargs=3, default=(6, 6, 12), help='weave.size')
    parser.add_argument('--friction', type=float, default=0.4)
    parser.add_argument('--damping', type=float, default=5.0, help='[s/m]')
    parser.add_argument('--stiffness', type=float, default=2e6, help='of contacts [N/m]')
    parser.add_argument('--tolerance', type=float, default=1.0, help='solver.tolerance')
    parser.add_argument('--method', default='auto', help='solver.method')
    parser.add_argument('--threads', type=int, default=0, help='solver.threads')
    parser.add_argument('--calm', type=float, default=0.0, help='solver.tolerance at the end')
    parser.add_argument('--longest', type=float, default=3.0, help='simulated time at most [s]')
    given = parser.parse_args()
    scene = pile(tuple(given.size), **{
        'contact.friction': given.friction, 'contact.damping': given.damping,
        'contact.stiffness': given.stiffness, 'solver.tolerance': given.tolerance,
        'solver.threads': given.threads, 'solver.method': given.method})
    print(describe_machine())
    simulation = ico.compile_scene(scene)
    print(f'{scene.body_count} bodies, friction {given.friction:g}, damping {given.damping:g} s/m')
    seen, _ = come_to_rest(simulation, given.calm, given.longest, show=True)
    print('at rest' if seen['rested'] else 'not at rest', end=': ')
    print(f't = {seen["time"]:.2f} s, kinetic energy {seen["kinetic"]:.1e} of its largest, '
          f'deepest overlap {100.0 * seen["deepest"]:.2f} % of a, beyond planes '
          f'{100.0 * max(seen["outside"], 0.0):.2f} %, energy off by {seen["balance"]:.1e}, '
          f'{seen["steps"]:.0f} steps, {seen["wall"]:.0f} s')


if __name__ == '__main__':
    main()
