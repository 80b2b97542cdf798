# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Falling piles by steps that run through contacts and by steps that end at contacts.

Processor times of `leapfrog` and `dop8`, alternating, with largest overlaps and error estimates
for several tolerances; the same pile, one thread.

    .venv/bin/python -m icofabric_validation.benchmarks.steps_through_contacts --size 3 3 6
"""

import argparse
import time

import icofabric_sim as ico
from icofabric_validation.benchmarks.machine import describe_machine
from icofabric_validation.benchmarks.pile import A, pile

METHODS = ('leapfrog', 'dop8')


def run(scene: ico.Scene, until: float) -> tuple[float, ico.Simulation]:
    """Return the processor time [s] of a run to `until` [s], and the simulation."""
    simulation = ico.compile_scene(scene)
    begun = time.process_time()
    simulation.advance_to(until)
    return time.process_time() - begun, simulation


def main() -> None:
    """Run each method once for its kernels, then alternate, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--size', type=int, nargs=3, default=(4, 4, 8), help='weave.size')
    parser.add_argument('--until', type=float, default=0.2, help='simulated time [s]')
    parser.add_argument('--stiffness', type=float, default=1e6, help='of contacts [N/m]')
    parser.add_argument('--damping', type=float, default=5.0, help='[s/m]')
    parser.add_argument('--friction', type=float, default=0.4)
    parser.add_argument('--tolerances', type=float, nargs='*', default=(1.0, 0.1, 0.01))
    parser.add_argument('--rounds', type=int, default=3)
    given = parser.parse_args()

    def scene(method: str, tolerance: float) -> ico.Scene:
        return pile(tuple(given.size), **{
            'contact.stiffness': given.stiffness, 'contact.damping': given.damping,
            'contact.friction': given.friction, 'solver.method': method,
            'solver.tolerance': tolerance, 'solver.threads': 1})

    print(describe_machine())
    for method in METHODS:
        run(scene(method, 1.0), 0.5 * given.until)
    print(f'{scene("auto", 1.0).body_count} bodies to {given.until:g} s, K = '
          f'{given.stiffness:g} N/m, c = {given.damping:g} s/m, friction {given.friction:g}')
    print(f'{"tolerance":>10}{"":10}{"seconds":>9}{"steps":>9}{"overlap":>9}{"error said":>12}')
    for tolerance in given.tolerances:
        least: dict[str, float] = {}
        for turn in range(given.rounds):
            for method in METHODS:
                seconds, simulation = run(scene(method, tolerance), given.until)
                if seconds < least.get(method, float('inf')):
                    least[method] = seconds
                if turn == given.rounds - 1:
                    status = simulation.status
                    print(f'{tolerance:10g} {method:9}{least[method]:9.2f}{status.step_count:9}'
                          f'{100.0 * status.deepest_overlap / A:8.2f}%'
                          f'{simulation.error_estimate:12.2g}')
        print(f'{"":10} {METHODS[1]} over {METHODS[0]}: {least["dop8"] / least["leapfrog"]:.2f}')


if __name__ == '__main__':
    main()
