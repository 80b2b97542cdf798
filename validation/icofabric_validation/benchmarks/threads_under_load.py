# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Gain or loss of a second thread while other programs run.

    .venv/bin/python -m icofabric_validation.benchmarks.threads_under_load [--others 0 1 4] \
        [--rounds 5]

Wall times of a leapfrog step of woven shells, of colliding separate shells and of a settling pile
in a box, by one thread and by two, alternating. `arithmetic` has sums in registers, twice by one
thread over once by two threads, which is the largest possible gain on this machine.
"""

import argparse
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
import logging
import statistics
import subprocess
import sys
import time

import icofabric_sim as ico
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_validation.benchmarks.machine import describe_machine
from icofabric_validation.benchmarks.pile import pile
import numpy as np

THREADS = 2
# Smallest wall time of a measurement [s], above time slices of the system, and number of steps.
_MIN_TIME_S, _STEPS = 0.5, 500
# Steps before, and simulated time [s] until a pile of 1,000 has 1,600 contacts.
_WARM_UP, _SETTLING_TIME_S = 200, 0.25
PILE = 'pile, 1,000'
SCENES = {
    'woven': {
        'weave': {'size': [17, 17, 17]}, 'contact': {'mode': 'never'},
        'solver': {'method': 'leapfrog', 'step': 1e-4},
        'initial_random': {'velocity_sigma': 0.01}},
    'loose, touching': {
        'weave': {'size': [16, 16, 8], 'connected': False, 'connector_angle': -0.3},
        'contact': {'mode': 'always', 'stiffness': 1e6},
        'solver': {'method': 'leapfrog', 'step': 5e-6},
        'initial_random': {'velocity_sigma': 0.3, 'spin_sigma': 20.0}},
    PILE: {}}


@compiled
def add_reciprocals(count: int) -> float:
    """Return a sum that needs no memory."""
    total = 0.0
    for k in range(count):
        total += 1.0 / (k + 1.0)
    return total


@contextmanager
def others(count: int) -> Iterator[None]:
    """Run `count` other programs that compute."""
    running = [
        subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(count)]
    try:
        time.sleep(0.5 * bool(count))
        yield
    finally:
        for one in running:
            one.kill()
            one.wait()


def arithmetic() -> float:
    """Return the gain of two threads in independent sums."""
    count = 50_000_000
    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(add_reciprocals, [10] * THREADS))
        began = time.perf_counter()
        for _ in range(THREADS):
            add_reciprocals(count)
        alone, began = time.perf_counter() - began, time.perf_counter()
        list(pool.map(add_reciprocals, [count] * THREADS))
        return alone / (time.perf_counter() - began)


def compiled_scene(name: str, threads: int) -> ico.Simulation:
    """Return a run with moving bodies, or a settled pile."""
    if name == PILE:
        simulation = ico.compile_scene(pile((10, 10, 20), **{
            'contact.stiffness': 1e6, 'solver.method': 'leapfrog', 'solver.threads': threads}))
        simulation.advance_to(_SETTLING_TIME_S)
    else:
        scene = ico.Scene.from_parameters(SCENES[name]).with_changes({'solver.threads': threads})
        simulation = ico.compile_scene(scene)
    simulation.advance_steps(_WARM_UP)
    return simulation


def seconds_each(simulation: ico.Simulation) -> float:
    """Return the wall time [s] of a step, always of the same steps."""
    start, count, taken = simulation.checkpoint(), 0, 0.0
    while taken < _MIN_TIME_S:
        began = time.perf_counter()
        simulation.advance_steps(_STEPS)
        taken += time.perf_counter() - began
        count += _STEPS
        simulation.restore(start)
    return taken / count


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--others', type=int, nargs='+', default=[0, 1, 4])
    parser.add_argument('--rounds', type=int, default=5)
    arguments = parser.parse_args()
    logging.getLogger('icofabric_sim').setLevel(logging.ERROR)
    print(describe_machine())
    print('scene              others   one [us]   two [us]   gain (range)')
    for name in SCENES:
        one, two = (compiled_scene(name, threads) for threads in (1, THREADS))
        for count in arguments.others:
            with others(count):
                rounds = np.array([
                    (seconds_each(one), seconds_each(two)) for _ in range(arguments.rounds)])
            gains = sorted(rounds[:, 0] / rounds[:, 1])
            alone, shared = 1e6 * np.median(rounds, axis=0)
            print(f'{name:18} {count:6} {alone:10.0f} {shared:10.0f}   '
                  f'{statistics.median(gains):.2f} ({gains[0]:.2f}-{gains[-1]:.2f})', flush=True)
    gains = sorted(arithmetic() for _ in range(arguments.rounds))
    print(f'{"arithmetic":18} {0:6} {"":21}   '
          f'{statistics.median(gains):.2f} ({gains[0]:.2f}-{gains[-1]:.2f})')


if __name__ == '__main__':
    main()
