# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A pile of separate icosahedra that settles in a box, with damping, with and without friction.

Prints overlaps, the kinetic energy over its largest value, steps and times.

    .venv/bin/python -m icofabric_validation.benchmarks.pile  # 216 bodies, with friction
    .venv/bin/python -m icofabric_validation.benchmarks.pile --size 3 3 6  # 27
    .venv/bin/python -m icofabric_validation.benchmarks.pile --friction 0 --damping 10 \
        --calm 3e-4 --longest 5

Without friction shells slide and roll freely until they collide, and slow collisions dissipate
little. Errors of a large tolerance would sustain the motion, so the last part has a smaller one.
"""

import argparse
import math
import time
from typing import Any

import icofabric_sim as ico
from icofabric_validation.benchmarks.machine import describe_machine
import numpy as np

# Half edge, and gaps beside the outermost and below the lowest bodies [m].
A, SIDE_GAP, BOTTOM_GAP = 0.01, 0.004, 0.02
# Radii of a shell [m]; regression.py builds piles for commits with other modules.
TAU = (1.0 + math.sqrt(5.0)) / 2.0
CIRCUMSCRIBED, INSCRIBED = A * math.sqrt(1.0 + TAU * TAU), A * (TAU * TAU / math.sqrt(3.0))
# A pile is at rest if its kinetic energy is below this fraction of the largest in ten samples with
# this interval [s].
REST_RATIO, REST_SAMPLES, SAMPLE_INTERVAL_S = 1e-6, 10, 0.01
# Energy ratio at the start of the last part, above the level that errors of a large tolerance
# sustain.
CALM_RATIO = 1e-2


def pile(size: tuple[int, int, int], **changes: Any) -> ico.Scene:
    """Return a scene of separate bodies in a box, slightly displaced by their velocities."""
    flat: dict[str, Any] = {
        'weave.size': list(size), 'weave.connected': False, 'weave.connector_length': 0.027,
        'gravity': [0.0, 0.0, -9.81], 'contact.stiffness': 2e6, 'contact.damping': 5.0,
        'contact.friction': 0.4, 'initial_random.velocity_sigma': 0.1,
        'initial_random.spin_sigma': 20.0, 'initial_random.seed': 1, 'solver.tolerance': 1.0,
        **changes}
    place = ico.Scene.from_parameters(flat).position
    low, high = place.min(axis=0), place.max(axis=0)
    room = CIRCUMSCRIBED + SIDE_GAP
    for name, axis, side in (('west', 0, 1.0), ('east', 0, -1.0), ('south', 1, 1.0),
                             ('north', 1, -1.0), ('floor', 2, 1.0)):
        flat[f'planes.{name}.normal'] = [side if k == axis else 0.0 for k in range(3)]
        edge = low[axis] - room if side > 0.0 else -(high[axis] + room)
        flat[f'planes.{name}.offset'] = float(edge - (BOTTOM_GAP if name == 'floor' else 0.0))
    return ico.Scene.from_parameters(flat)


def settle(
    simulation: ico.Simulation, longest: float, *, show: bool = False, rest: float = REST_RATIO,
    peak: float = 0.0
) -> dict[str, float]:
    """
    Let a pile settle to the energy ratio `rest`, or run for `longest` [s]; return results.

    `peak` is the largest kinetic energy [J] so far.
    """
    start, calm, begun = time.perf_counter(), 0, simulation.time
    while calm < REST_SAMPLES and simulation.time < begun + longest:
        simulation.advance_to(simulation.time + SAMPLE_INTERVAL_S)
        energy = simulation.snapshot().energy
        peak = max(peak, energy['kinetic'])
        calm = calm + 1 if energy['kinetic'] < rest * peak else 0
        if show and round(simulation.time / SAMPLE_INTERVAL_S) % 10 == 0:
            print(f't = {simulation.time:5.2f} s  kinetic energy {energy["kinetic"] / peak:8.1e} '
                  f'of its largest  {simulation.status.step_count:7d} steps  '
                  f'{time.perf_counter() - start:6.0f} s', flush=True)
    return {
        'time': simulation.time, 'rested': float(calm == REST_SAMPLES),
        'steps': simulation.status.step_count,
        'kinetic': energy['kinetic'] / peak, 'peak': peak,
        'balance': energy['balance_error'] / peak,
        'deepest': simulation.status.deepest_overlap / A, 'wall': time.perf_counter() - start,
        'outside': outside(simulation)}


def come_to_rest(
    simulation: ico.Simulation, calm: float, longest: float, *, show: bool = False
) -> tuple[dict[str, float], ico.Simulation]:
    """Settle, the last part with tolerance `calm` (0: the same); return results and simulation."""
    seen = settle(simulation, longest, show=show, rest=CALM_RATIO if calm else REST_RATIO)
    if not (calm and seen['rested']):
        return seen, simulation
    calmer = ico.compile_scene(ico.Scene.from_parameters(
        {**simulation.scene.parameters, 'solver.tolerance': calm}))
    calmer.continue_from(simulation, keep_motion=True)
    last = settle(calmer, longest - simulation.time, show=show, peak=seen['peak'])
    last['steps'] += seen['steps']
    last['wall'] += seen['wall']
    last['deepest'] = max(last['deepest'], seen['deepest'])
    return last, calmer


def outside(simulation: ico.Simulation) -> float:
    """Return the largest penetration of planes by inscribed spheres, over a."""
    place, values = simulation.snapshot().position, simulation.scene.parameters
    heights = [
        place @ np.array(values[f'planes.{name}.normal']) - values[f'planes.{name}.offset']
        for name in values.names('planes')]
    return (INSCRIBED - float(np.min(heights))) / A


def main() -> None:
    """Run one pile and print results."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--size', type=int, nargs=3, default=(6, 6, 12), help='weave.size')
    parser.add_argument('--friction', type=float, default=0.4)
    parser.add_argument('--damping', type=float, default=5.0, help='[s/m]')
    parser.add_argument('--stiffness', type=float, default=2e6, help='of contacts [N/m]')
    parser.add_argument('--tolerance', type=float, default=1.0, help='solver.tolerance')
    parser.add_argument('--method', default='auto', help='solver.method')
    parser.add_argument('--threads', type=int, default=0, help='solver.threads')
    parser.add_argument('--calm', type=float, default=0.0, help='solver.tolerance at the end')
    parser.add_argument('--longest', type=float, default=3.0, help='limit of simulated time [s]')
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
