# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Errors and times of given steps on S1, with one and with two connector stiffnesses.

S1 is the fabric of `icofabric benchmark work-precision`. The kinked connectors have 100 N/m in
compression and 500 N/m in extension. For each method the errors of steps from 0.05 to 1.7 radians
of the fastest vibration are printed, compared with `dop8` at its smallest tolerance. Then follow
the processor times per simulated second for errors of 1e-6 and 1e-9, kinked over smooth. `--long`
adds the energy over long runs.

    .venv/bin/python -m icofabric_validation.benchmarks.kinked_steps [--duration 0.1] \
        [--long 100000]
"""

import argparse
import logging
import sys
from time import process_time

import icofabric_sim as ico
from icofabric_sim.simulation.reports.divergence import distance_between
from icofabric_validation.benchmarks.machine import machine_lines
from icofabric_validation.benchmarks.scenes import FABRIC, SIZES
import numpy as np

_RADIANS = (1.7, 1.2, 0.8, 0.6, 0.4, 0.3, 0.2, 0.14, 0.1, 0.07, 0.05)
_PLAIN = (0.1, 0.05, 0.025, 0.0125, 0.006, 0.003)
_TARGETS = (1e-6, 1e-9)
_REPEATS = 3
# Tolerance of the reference [1/s], limited by round-off.
_REFERENCE_TOLERANCE = 3e-11


def make(changes: dict[str, object]) -> ico.Scene:
    """Return S1 with changes, for one thread."""
    scene = ico.Scene.from_parameters(
        {**FABRIC, 'weave': {**FABRIC['weave'], 'size': list(SIZES['S1'])}})
    return scene.with_changes({'solver.threads': 1, 'solver.energy_limit': 1e9, **changes})


def measure(
    changes: dict[str, object], method: str, duration: float, rate: float, radians: float,
    target: ico.Snapshot, half_edge: float
) -> tuple[float, float]:
    """Return the final error, and the least processor time [s] per simulated second."""
    count = max(1, round(duration * rate / radians))
    best, error = np.inf, np.inf
    for _ in range(_REPEATS):
        run = ico.compile_scene(make(changes | {
            'solver.method': method, 'solver.step': duration / count}))
        began = process_time()
        run.advance_steps(count)
        best = min(best, process_time() - began)
        error = distance_between(run.snapshot(), target, half_edge)
    return error, best / duration


def time_at(target: float, errors: list[float], times: list[float]) -> float:
    """Interpolate the time at an error; NaN if no step is so accurate."""
    for k in range(1, len(errors)):
        if errors[k] <= target < errors[k - 1]:
            part = np.log(errors[k - 1] / target) / np.log(errors[k - 1] / errors[k])
            return float(times[k - 1] * (times[k] / times[k - 1]) ** part)
    return float('nan')


def keep_energy(changes: dict[str, object], rate: float, count: int, cost: float) -> None:
    """Print the energy of long runs by srkn4, and by leapfrog with steps of equal cost."""
    for method, radians in (('srkn4', 1.0), ('leapfrog', 1.0 / cost)):
        run = ico.compile_scene(make(changes | {
            'solver.method': method, 'solver.step': radians / rate}))
        first, found = 0.0, []
        for part in range(101):
            run.advance_to(0.01 * part * count / rate)
            energy = run.snapshot().energy
            total = energy['kinetic'] + energy['connectors']
            first = first or total
            found.append(total / first - 1.0)
        means = np.array(found[1:]).reshape(10, 10).mean(axis=1)
        print(
            f'{method} at {radians:.3g} rad for {count:,} rad: relative error of the energy in '
            f'tenths of the run {" ".join(f"{mean:.1e}" for mean in means)}')


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--duration', type=float, default=0.1, help='[s] (0.1)')
    parser.add_argument('--long', type=int, default=0, help='radians of a long run (0: none)')
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    print('\n'.join(machine_lines(())))
    best: dict[tuple[str, float], float] = {}
    for name, push in (('smooth', 500.0), ('kinked', 100.0)):
        changes: dict[str, object] = {'connector.stiffness_compression': push}
        exact = ico.compile_scene(make(changes | {
            'solver.method': 'dop8', 'solver.tolerance': _REFERENCE_TOLERANCE}))
        rate, half_edge = exact.status.largest_frequency, exact.scene.geometry.half_edge
        exact.advance_to(arguments.duration)
        target = exact.snapshot()
        for method in ('leapfrog', 'srkn4', 'srkn6'):
            errors, times = [], []
            for radians in _PLAIN if method == 'leapfrog' else _RADIANS:
                error, time = measure(
                    changes, method, arguments.duration, rate, radians, target, half_edge)
                errors.append(error)
                times.append(time)
                print(f'{name} {method:8} {radians:6.3g} rad: error {error:.2e}, {time:.4f} s/s')
            order = np.polyfit(
                np.log(_PLAIN if method == 'leapfrog' else _RADIANS), np.log(errors), 1)[0]
            print(f'{name} {method}: order {order:.2f}')
            for goal in _TARGETS:
                least = best.get((name, goal), np.inf)
                best[name, goal] = float(np.nanmin([least, time_at(goal, errors, times)]))
        if push < 500.0 and arguments.long:
            keep_energy(changes, rate, arguments.long, 12.0)
    for goal in _TARGETS:
        kinked, smooth = best['kinked', goal], best['smooth', goal]
        print(
            f'at {goal:g}: smooth {smooth:.4f} s, kinked {kinked:.4f} s for each second, '
            f'{kinked / smooth:.1f} times')
    return 0


if __name__ == '__main__':
    sys.exit(main())
