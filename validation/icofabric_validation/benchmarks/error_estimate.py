# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Accuracy of `simulation.error_estimate`, compared with the errors that the method adds.

Random scenes of six kinds run by all suitable methods, with adaptive steps and with given steps of
0.2 to 0.8 of the stability limit. A run of much smaller tolerance repeats each window of one
shortest period. The output has the distribution of the ratios by method and the worst runs. The
kernels of each kind are compiled once, which takes up to a few minutes.

    .venv/bin/python -m icofabric_validation.benchmarks.error_estimate [--scenes 17] \
        [--kinds free damped]
    .venv/bin/python -m icofabric_validation.benchmarks.error_estimate --kinds kinked \
        --methods auto srkn4 --periods 25
    .venv/bin/python -m icofabric_validation.benchmarks.error_estimate --in-turn --seconds 10 \
        --minutes 18 --jobs 2
"""

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed, ProcessPoolExecutor
from contextlib import contextmanager
import logging
import math
import multiprocessing
import signal
import sys
import time

import icofabric_sim as ico
from icofabric_sim.process.compile_notice import compile_notice
from icofabric_validation.benchmarks.added_errors import draw_scene, judge, KINDS, RunErrors
from icofabric_validation.benchmarks.machine import machine_lines
import numpy as np

# Largest ratio, either way, of a good estimate to the added error.
_MAX_ERROR_RATIO = 3.0


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """
    Raise TimeoutError after `seconds` [s] of processor time, between two compiled calls.

    Time of the compiler does not count.
    """
    compiled = compile_notice.seconds

    def give_up(number: int, frame: object) -> None:
        nonlocal compiled
        if compile_notice.is_compiling or compile_notice.seconds > compiled:
            compiled = compile_notice.seconds
            signal.setitimer(signal.ITIMER_PROF, seconds)
        else:
            raise TimeoutError(f'not done after {seconds:g} s')

    before = signal.signal(signal.SIGPROF, give_up)
    if seconds < math.inf:
        signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def judge_scene(
    kind: str, seed: int, methods: Sequence[str], longest: float, seconds: float, deadline: float
) -> list[tuple[RunErrors, float]]:
    """
    Return all runs of a scene and their tolerances, with at most `longest` periods.

    Runs that take more than `seconds` [s], or would start after the `deadline` (Unix time) [s],
    are left out.
    """
    logging.disable(logging.WARNING)
    found: list[tuple[RunErrors, float]] = []
    changes, periods, generator = draw_scene(kind, seed)
    periods = min(periods, longest)
    for method in methods:
        for given in (0.0, float(generator.uniform(0.2, 0.8))):
            name = f'{kind} {seed} {method} {given:.2f}'
            if time.time() > deadline:
                print(f'{name}: left out: no time', flush=True)
                continue
            try:
                with at_most(seconds):
                    judged = judge(changes, method, given, periods, kind=kind, seed=seed)
                found.append((judged, float(str(changes['solver.tolerance']))))
            except ValueError as error:
                # Candidate pairs may lower the limit below a given step; some runs would take
                # hours; and not every method has adaptive steps with wrapped connectors.
                print(f'{name}: refused: {error}', flush=True)
            except TimeoutError as error:
                print(f'{name}: left out: {error}', flush=True)
    return found


def judge_all(
    kinds: Sequence[str], count: int, methods: Sequence[str], longest: float, *, in_turn: bool,
    seconds: float, minutes: float, jobs: int
) -> list[tuple[RunErrors, float]]:
    """
    Judge `count` scenes of each kind in `jobs` processes, alternating kinds; see `judge_scene`.

    With `in_turn` each scene has one method, and methods alternate.
    """
    deadline = time.time() + 60.0 * minutes
    tasks = []
    for seed in range(count):
        for number, kind in enumerate(kinds):
            some = [methods[(seed + number) % len(methods)]] if in_turn else methods
            if kind == 'damped':
                some = ['dop8']
            tasks.append((kind, seed, some, longest, seconds, deadline))
    found: list[tuple[RunErrors, float]] = []
    with ProcessPoolExecutor(jobs, multiprocessing.get_context('spawn')) as pool:
        futures = [pool.submit(judge_scene, *task) for task in tasks]
        for done, future in enumerate(as_completed(futures), 1):
            found += future.result()
            print(f'scene {done} of {len(tasks)}', file=sys.stderr, flush=True)
    return sorted(found, key=lambda one: (one[0].kind, one[0].seed, one[0].method, one[0].given))


def describe(name: str, found: list[RunErrors]) -> str:
    """Return one line on the distribution of the ratios of some runs."""
    ratios = np.array([judged.ratio for judged in found])
    if not len(ratios):
        return f'{name:24} none'
    low, middle, high = np.quantile(ratios, (0.05, 0.5, 0.95))
    inside = np.mean((ratios > 1.0 / _MAX_ERROR_RATIO) & (ratios < _MAX_ERROR_RATIO))
    return (
        f'{name:24} {len(ratios):5} runs: estimate / added {ratios.min():.2g} to '
        f'{ratios.max():.2g}, 5 % below {low:.2g}, median {middle:.2g}, 5 % above {high:.2g}; '
        f'{100.0 * inside:.1f} % within {_MAX_ERROR_RATIO:g} times')


def main() -> int:
    """Judge and print; return 1 if an estimate decreased or is wrong by more than three times."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--scenes', type=int, default=17, help='scenes of each kind (17)')
    parser.add_argument('--kinds', nargs='+', choices=KINDS, default=KINDS)
    parser.add_argument(
        '--methods', nargs='+', choices=('auto', *ico.METHODS), default=tuple(ico.METHODS),
        help='all but auto; for damped scenes only dop8')
    parser.add_argument(
        '--periods', type=float, default=math.inf, help='limit of shortest periods of a run')
    parser.add_argument(
        '--in-turn', action='store_true',
        help='one method for each scene, alternating, instead of all')
    parser.add_argument(
        '--seconds', type=float, default=math.inf,
        help='leave out runs that take more processor time than this')
    parser.add_argument(
        '--minutes', type=float, default=math.inf, help='start no run after this wall time')
    parser.add_argument('--jobs', type=int, default=1, help='processes (1)')
    arguments = parser.parse_args()
    print('\n'.join(machine_lines(())))
    runs = judge_all(
        arguments.kinds, arguments.scenes, arguments.methods, arguments.periods,
        in_turn=arguments.in_turn, seconds=arguments.seconds, minutes=arguments.minutes,
        jobs=arguments.jobs)
    found = [judged for judged, _ in runs]
    told = [judged for judged in found if judged.is_measurable]
    print(
        f'{len({(judged.kind, judged.seed) for judged in told})} scenes, {len(told)} runs; '
        f'{len(found) - len(told)} more err by less than rounding and the reference')
    for method in arguments.methods:
        for word, given in (('chosen', False), ('given', True)):
            print(describe(f'{method}, step {word}', [
                judged for judged in told
                if judged.method == method and (judged.given > 0.0) == given]))
    for kind in arguments.kinds:
        print(describe(kind, [judged for judged in told if judged.kind == kind]))
    print(describe('all', told))
    falling = [judged for judged in found if judged.decreases]
    worst = sorted(told, key=lambda judged: -abs(np.log(judged.ratio)))[:10]
    for judged in worst:
        print(
            f'  {judged.kind} {judged.seed}, {judged.method} at {judged.given:.2f} for '
            f'{judged.periods:.1f} periods: {judged.ratio:.3g} of {judged.added[-1]:.2g}'
            + (f', ended: {judged.ended}' if judged.ended else ''))
    kept = sorted((
        (float(judged.added[-1]) / (tolerance * float(judged.times[-1])), judged)
        for judged, tolerance in runs if judged.is_measurable and not judged.given > 0.0),
        key=lambda one: -one[0])
    if kept:
        print(f'chosen steps added up to {kept[0][0]:.3g} of the tolerance')
    for part, judged in kept:
        if part > 1.0:
            print(
                f'  {judged.kind} {judged.seed}, {judged.method}: {part:.3g}, estimate '
                f'{judged.ratio:.3g} of {judged.added[-1]:.2g}'
                + (f', ended: {judged.ended}' if judged.ended else ''))
    print(f'estimates that fell with time: {len(falling)}')
    outside = [judged for judged in told
               if not 1.0 / _MAX_ERROR_RATIO < judged.ratio < _MAX_ERROR_RATIO]
    return 1 if falling or outside else 0


if __name__ == '__main__':
    sys.exit(main())
