# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Cost of `contact.mode: auto` over `never` without contacts, and the number of tested pairs.

Example scenes to t = 1 s, and a slab within a degree of the least connector angle, whose bounding
spheres overlap, that moves gently. Times of the processor, both in turn in every round.

    .venv/bin/python -m icofabric_validation.benchmarks.contact_cost
"""

import argparse
import logging
import statistics
import time
from typing import Any

import icofabric_sim as ico
from icofabric_sim.parameters.example_scenes import example_scenes
from icofabric_sim.parameters.file import load_parameter_file
from icofabric_validation.benchmarks.machine import describe_machine
import numpy as np

NAMES = ('free_slab', 'pressed_slab', 'hanging_slab', 'bias_column', 'woven_ball')
# Smallest connector angle [rad], below which neighbours overlap as woven.
MIN_ANGLE = np.arccos(np.sqrt(0.6) ** -1 / np.sqrt(2.0)) - np.pi / 4.0
GENTLE: dict[str, Any] = {
    'weave.size': [5, 5, 5], 'weave.connector_angle': MIN_ANGLE + np.radians(1.0),
    'initial_random.velocity_sigma': 0.001, 'initial_random.spin_sigma': 0.1}


def measure(flat: dict[str, Any], until: float, rounds: int) -> tuple[list[float], Any]:
    """Return the times with `auto` over those with `never`, and the simulation with `auto`."""
    runs = {mode: ico.compile_scene(ico.Scene.from_parameters({**flat, 'contact.mode': mode}))
            for mode in ('never', 'auto')}
    for simulation in runs.values():
        simulation.warm_up()
    ratios = []
    for turn in range(rounds):
        taken = {}
        for mode in sorted(runs, reverse=turn % 2 == 0):
            runs[mode].reset_time()
            began = time.process_time()
            runs[mode].advance_to(until)
            taken[mode] = time.process_time() - began
        ratios.append(taken['auto'] / taken['never'])
    return ratios, runs['auto']


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--rounds', type=int, default=9)
    given = parser.parse_args()
    logging.disable(logging.WARNING)
    print(describe_machine())
    scenes = [(name, load_parameter_file(example_scenes()[name]), 1.0) for name in NAMES]
    # Later shells come close to contact.
    scenes.append(('within 1 degree of the least angle', GENTLE, 0.06))
    for name, flat, until in scenes:
        ratios, simulation = measure(dict(flat), until, given.rounds)
        status = simulation.status
        tests = status.contact_tests / simulation.scene.body_count / status.step_count
        print(f'{name:35} {status.method_name:9} time {statistics.median(ratios):.2f} '
              f'({min(ratios):.2f}-{max(ratios):.2f}), pair tests for each body and step '
              f'{tests:g}, {simulation.status.step_count} steps', flush=True)


if __name__ == '__main__':
    main()
