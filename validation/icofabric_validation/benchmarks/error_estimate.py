# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
How near `simulation.error_estimate` comes to what a run's method really adds.

Random scenes of six kinds, by every method that can, with chosen steps and with given ones of 0.2
to 0.8 of the stability limit; each window of one shortest period is repeated by a far tighter run.
Says how the ratios are spread, for each method and in all, and names the worst. Each kind has its
kernels compiled once, which takes up to a few minutes.

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
from icofabric_validation.benchmarks.added_errors import draw_scene, judge, Judged, KINDS
from icofabric_validation.benchmarks.machine import machine_lines
import numpy as np

# The range within which an estimate is as good as was asked for.
_FACTOR = 3.0


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """
    Raise TimeoutError after so many `seconds` [s] of processor time, between two compiled calls.

    Time that the compiler takes does not count.
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
) -> list[tuple[Judged, float]]:
    """
    All runs of a scene, of so many periods at `longest`, and tolerances.

    Runs that take more than `seconds` [s] are left out, and those that would begin after the
    `deadline` (Unix time) [s].
    """
    logging.disable(logging.WARNING)
    found: list[tuple[Judged, float]] = []
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
                # A step below the limit at the start may be beyond it with what may touch;
                # some runs would take hours; and not every method chooses steps around shells.
                print(f'{name}: refused: {error}', flush=True)
            except TimeoutError as error:
                print(f'{name}: left out: {error}', flush=True)
    return found


def judge_all(
    kinds: Sequence[str], count: int, methods: Sequence[str], longest: float, *, in_turn: bool,
    seconds: float, minutes: float, jobs: int
) -> list[tuple[Judged, float]]:
    """
    Judge so many scenes of each kind in `jobs` processes, kinds in turn; see `judge_scene`.

    `in_turn`: each by one of the methods, the next by the next.
    """
    deadline = time.time() + 60.0 * minutes
    tasks = []
    for seed in range(count):
        for number, kind in enumerate(kinds):
            some = [methods[(seed + number) % len(methods)]] if in_turn else methods
            if kind == 'damped':
                some = ['dop8']
            tasks.append((kind, seed, some, longest, seconds, deadline))
    found: list[tuple[Judged, float]] = []
    with ProcessPoolExecutor(jobs, multiprocessing.get_context('spawn')) as pool:
        futures = [pool.submit(judge_scene, *task) for task in tasks]
        for done, future in enumerate(as_completed(futures), 1):
            found += future.result()
            print(f'scene {done} of {len(tasks)}', file=sys.stderr, flush=True)
    return sorted(found, key=lambda one: (one[0].kind, one[0].seed, one[0].method, one[0].given))


def describe(name: str, found: list[Judged]) -> str:
    """One line on how the ratios of some runs are spread."""
    ratios = np.array([judged.ratio for judged in found])
    if not len(ratios):
        return f'{name:24} none'
    low, middle, high = np.quantile(ratios, (0.05, 0.5, 0.95))
    inside = np.mean((ratios > 1.0 / _FACTOR) & (ratios < _FACTOR))
    return (
        f'{name:24} {len(ratios):5} runs: estimate / added {ratios.min():.2g} to '
        f'{ratios.max():.2g}, 5 % below {low:.2g}, median {middle:.2g}, 5 % above {high:.2g}; '
        f'{100.0 * inside:.1f} % within {_FACTOR:g} times')


def main() -> int:
    """Judge, and print; 1 where an estimate fell with time or is off by more than three times."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--scenes', type=int, default=17, help='scenes of each kind (17)')
    parser.add_argument('--kinds', nargs='+', choices=KINDS, default=KINDS)
    parser.add_argument(
        '--methods', nargs='+', choices=('auto', *ico.METHODS), default=tuple(ico.METHODS),
        help='all but auto; where scenes are damped dop8 alone')
    parser.add_argument(
        '--periods', type=float, default=math.inf, help='shortest periods of a run, at most')
    parser.add_argument(
        '--in-turn', action='store_true',
        help='each scene by one of the methods, the next by the next; else by all')
    parser.add_argument(
        '--seconds', type=float, default=math.inf,
        help='leave out runs that take more processor time than this')
    parser.add_argument(
        '--minutes', type=float, default=math.inf, help='begin no run after so long a wall time')
    parser.add_argument('--jobs', type=int, default=1, help='processes (1)')
    arguments = parser.parse_args()
    print('\n'.join(machine_lines(())))
    runs = judge_all(
        arguments.kinds, arguments.scenes, arguments.methods, arguments.periods,
        in_turn=arguments.in_turn, seconds=arguments.seconds, minutes=arguments.minutes,
        jobs=arguments.jobs)
    found = [judged for judged, _ in runs]
    told = [judged for judged in found if judged.tells]
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
    falling = [judged for judged in found if judged.falls]
    worst = sorted(told, key=lambda judged: -abs(np.log(judged.ratio)))[:10]
    for judged in worst:
        print(
            f'  {judged.kind} {judged.seed}, {judged.method} at {judged.given:.2f} for '
            f'{judged.periods:.1f} periods: {judged.ratio:.3g} of {judged.added[-1]:.2g}'
            + (f', ended: {judged.ended}' if judged.ended else ''))
    kept = sorted((
        (float(judged.added[-1]) / (tolerance * float(judged.times[-1])), judged)
        for judged, tolerance in runs if judged.tells and not judged.given > 0.0),
        key=lambda one: -one[0])
    if kept:
        print(f'chosen steps added up to {kept[0][0]:.3g} of what the tolerance allows')
    for part, judged in kept:
        if part > 1.0:
            print(
                f'  {judged.kind} {judged.seed}, {judged.method}: {part:.3g}, estimate '
                f'{judged.ratio:.3g} of {judged.added[-1]:.2g}'
                + (f', ended: {judged.ended}' if judged.ended else ''))
    print(f'estimates that fell with time: {len(falling)}')
    outside = [judged for judged in told if not 1.0 / _FACTOR < judged.ratio < _FACTOR]
    return 1 if falling or outside else 0


if __name__ == '__main__':
    sys.exit(main())
