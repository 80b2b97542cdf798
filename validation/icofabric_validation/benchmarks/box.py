# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Loose icosahedra that collide in a box without losses, and the energy that should stay.

Prints the error of the energy over so many collisions, pairs and bodies on walls counted as they
begin to touch, and what it takes.

    .venv/bin/python -m icofabric_validation.benchmarks.box  # 1,000 bodies, 10,000 collisions
    .venv/bin/python -m icofabric_validation.benchmarks.box --size 6 6 6 --collisions 1000
"""

import argparse
import time
from typing import Any

import icofabric_sim as ico
from icofabric_validation.benchmarks.machine import describe_machine
from icofabric_validation.named.crowds import crowd
from icofabric_validation.named.loose_bodies import A
import numpy as np


def box(size: tuple[int, int, int], **changes: Any) -> ico.Scene:
    """Return a scene of separate bodies with random velocities and spins between six walls."""
    return crowd(size, within='walls', parameters={
        'weave.connector_length': 0.03, 'initial_random.velocity_sigma': 0.5,
        'initial_random.spin_sigma': 20.0, 'initial_random.seed': 2, 'solver.threads': 0,
        'solver.energy_limit': 1.0, **changes})


def touching(simulation: ico.Simulation) -> set[tuple[int, int]]:
    """Return pairs in contact at the last evaluation of forces; walls are negative numbers."""
    contacts = simulation._driver.trajectory.model.contacts
    if contacts is None:
        return set()
    return {(int(one), int(other)) for one, other in contacts.pairs[contacts.result[:, 9] > 0.0]}


def main() -> None:
    """Run until the requested number of collisions."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--size', type=int, nargs=3, default=(20, 10, 10), help='weave.size')
    parser.add_argument('--collisions', type=int, default=10_000)
    parser.add_argument('--tolerance', type=float, default=1e-6, help='solver.tolerance')
    parser.add_argument('--stiffness', type=float, default=0.0, help='[N/m]; 0: automatic')
    parser.add_argument('--seconds', type=float, default=1e9, help='limit of wall time')
    given = parser.parse_args()
    scene = box(tuple(given.size), **{
        'contact.stiffness': given.stiffness, 'solver.tolerance': given.tolerance})
    print(describe_machine())
    simulation = ico.compile_scene(scene)
    simulation.warm_up()
    setup = simulation.packed.contact
    assert setup is not None
    print(f'{scene.body_count} bodies, {simulation.status.method_name}, '
          f'tolerance {given.tolerance:g}, K = {setup.stiffness:.3g} N/m')
    first = simulation.snapshot().energy['total']
    before, count, worst, shown = touching(simulation), 0, 0.0, 0
    started = time.perf_counter()
    while count < given.collisions and time.perf_counter() < started + given.seconds:
        simulation.advance_steps(1)
        now = touching(simulation)
        count += len(now - before)
        before = now
        if count >= shown + given.collisions // 10:
            shown = count
            energy = simulation.snapshot().energy
            worst = max(worst, abs(energy['balance_error']) / first)
            print(f'{count:6d} collisions  t = {simulation.time:.4f} s  energy off by '
                  f'{energy["balance_error"] / first:9.2e}  '
                  f'{simulation.status.step_count:7d} steps  '
                  f'{time.perf_counter() - started:6.0f} s', flush=True)
    velocity = np.linalg.norm(simulation.snapshot().linear_velocity, axis=1)
    print(f'{count} collisions in {simulation.time:.4f} s: energy off by at most {worst:.1e}, '
          f'deepest overlap {100.0 * simulation.status.deepest_overlap / A:.2f} % of a, '
          f'{simulation.status.step_count} steps, '
          f'{simulation.status.contact_tests} pairs looked at, '
          f'mean speed {velocity.mean():.3f} m/s, {time.perf_counter() - started:.0f} s')


if __name__ == '__main__':
    main()
