# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Cost of the choice of method and step by `auto`, for S1 and random smooth fabrics.

Each fabric moves freely for 500 radians of its fastest vibration. Every method runs with given
steps from the stability limit down, and `dop8` and `auto` with tolerances; all alternate in every
round. For an error at the end (positions over a, angles) the time of each method is interpolated
between its runs. The result is the median over rounds of the time of `auto` over that of the
fastest other method.

If connectors may collapse (`WILD` in method_selection.py), `auto` takes `dop8` for safety; these
fabrics are counted separately. A target is left out if the uncertainty of the reference exceeds a
fifth of the target.

    .venv/bin/python -m icofabric_validation.benchmarks.automatic_method [--scenes 20] [--rounds 5]
    .venv/bin/python -m icofabric_validation.benchmarks.automatic_method --scenes 0 --parts
"""

import argparse
from collections.abc import Callable
import logging
import math
import statistics
import sys
from time import process_time
from typing import Any, NamedTuple

import icofabric_sim as ico
from icofabric_sim.simulation.reports.divergence import distance_between
from icofabric_sim.simulation.stepping.accuracy_probe import AccuracyProbe
from icofabric_sim.simulation.stepping.method_calls import MethodCalls
from icofabric_sim.simulation.stepping.methods import METHODS
from icofabric_sim.simulation.stepping.motion_rates import MotionRates
from icofabric_validation.benchmarks.added_errors import draw_scene
from icofabric_validation.benchmarks.machine import machine_lines
from icofabric_validation.benchmarks.scenes import DURATION, FABRIC, SIZES
import numpy as np

_TARGETS = (1e-3, 1e-6, 1e-9)
_RADIANS = 500.0
# Largest given step over the stability limit, ratio of successive steps, and largest number of
# steps.
_MAX_STEP_RATIO, _STEP_RATIO, _MAX_STEPS = 0.95, 2.0**-0.25, 40_000
# Decades of tolerances times the duration.
_DECADES = range(0, 13)
# Largest and smallest errors of interest.
_MAX_ERROR, _MIN_ERROR = 0.3, 2e-10
# Runs shorter than this time [s] are repeated within a round, up to this number of times.
_MIN_BLOCK_S, _MAX_REPEATS = 0.02, 5


class Fabric(NamedTuple):
    """A scene with its duration [s], final state and uncertainty."""

    name: str
    changes: dict[str, Any]
    duration: float
    rate: float  # [rad/s]
    wild: bool
    end: ico.Snapshot
    uncertain: float


class Run(NamedTuple):
    """One setting of a method, with its error and times [s] in the rounds."""

    setting: float
    error: float
    times: list[float]


def make(fabric: dict[str, Any], **solver: Any) -> ico.Simulation:
    """Compile a fabric for one thread."""
    simulation = ico.compile_scene(ico.Scene.from_parameters(fabric | {
        f'solver.{name}': value for name, value in solver.items()}))
    simulation.warm_up()
    return simulation


def prepare(name: str, changes: dict[str, Any], duration: float) -> Fabric:
    """Find the final state by two methods."""
    run = make(changes, tolerance=1e-6)
    rate = run.status.largest_frequency
    duration = duration or _RADIANS / rate
    ends = []
    for solver in (
            {'method': 'dop8', 'tolerance': max(3e-13, 3e-11 / rate) * rate},
            {'method': 'srkn8', 'step': duration / math.ceil(duration * rate / 0.2)}):
        reference = make(changes, **solver)
        reference.advance_to(duration)
        ends.append(reference.snapshot())
    half_edge = run.scene.geometry.half_edge
    return Fabric(
        name, changes, duration, rate, run.status.method_name == 'dop8', ends[0],
        distance_between(ends[0], ends[1], half_edge))


def contestants(fabric: Fabric) -> dict[str, list[tuple[float, dict[str, Any]]]]:
    """Return settings from coarse to fine, with parameters of the solver, by name."""
    found: dict[str, list[tuple[float, dict[str, Any]]]] = {}
    for name, method in METHODS.items():
        if method.symplectic:
            first = math.ceil(fabric.duration * fabric.rate / (_MAX_STEP_RATIO * method.stability))
            growth = _STEP_RATIO ** (1 if method.order > 2 else 4)
            counts = dict.fromkeys(math.ceil(first * growth**-k) for k in range(48))
            found[name] = [
                (count, {'method': name, 'step': fabric.duration / count})
                for count in counts if count <= _MAX_STEPS]
    for name in ('dop8', 'auto'):
        found[name] = [
            (10.0**-k, {'method': name, 'tolerance': 10.0**-k * fabric.rate / _RADIANS})
            for k in _DECADES]
    return found


def run_once(fabric: Fabric, solver: dict[str, Any]) -> tuple[float, ico.Simulation]:
    """Return the time [s] of the steps, without compiling and the choice of the first step."""
    times: list[float] = []
    while not times or (sum(times) < _MIN_BLOCK_S and len(times) < _MAX_REPEATS):
        simulation = make(fabric.changes, **solver)
        began = process_time()
        if 'step' in solver:
            simulation.advance_steps(round(fabric.duration / solver['step']))
        else:
            simulation.advance_to(fabric.duration)
        times.append(process_time() - began)
    return statistics.median(times), simulation


def trace(fabric: Fabric, settings: list[tuple[float, dict[str, Any]]]) -> list[
        tuple[Run, dict[str, Any]]]:
    """Run from coarse to fine until the error is small enough."""
    found = []
    for setting, solver in settings:
        try:
            _, simulation = run_once(fabric, solver)
        except (ValueError, ico.SimulationError):
            continue
        error = distance_between(
            simulation.snapshot(), fabric.end, simulation.scene.geometry.half_edge)
        if error < _MAX_ERROR:
            found.append((Run(setting, error, []), solver))
        if error < _MIN_ERROR:
            break
    return found


def time_at(runs: list[Run], target: float, time_of: Callable[[Run], float]) -> float:
    """
    Return the time [s] for a target error, or infinity if no run reaches it.

    The time is interpolated on logarithmic scales between the coarsest run below the target and
    the run before, unless a finer run takes less.
    """
    good = [k for k, run in enumerate(runs) if run.error <= target]
    if not good:
        return math.inf
    best = min(time_of(runs[k]) for k in good)
    if good[0] == 0:
        return best
    before, last = runs[good[0] - 1], runs[good[0]]
    part = math.log(before.error / target) / math.log(before.error / last.error)
    between = time_of(before) ** (1.0 - part) * time_of(last) ** part
    return min(best, between)


def measure(fabric: Fabric, rounds: int, *, verbose: bool) -> dict[float, float]:
    """Return the time of `auto` over the fastest other method at each target, by median."""
    curves = {name: trace(fabric, settings) for name, settings in contestants(fabric).items()}
    tasks = [pair for curve in curves.values() for pair in curve]
    for turn in range(rounds):
        for run, solver in tasks if turn % 2 == 0 else reversed(tasks):
            run.times.append(run_once(fabric, solver)[0])
    runs = {name: [run for run, _ in curve] for name, curve in curves.items()}
    if verbose:
        for name, curve in runs.items():
            for run in curve:
                print(
                    f'  {name:9} {run.setting:9.4g}: error {run.error:.2e}, '
                    f'{1e3 * statistics.median(run.times):.2f} ms '
                    f'({1e3 * min(run.times):.2f}-{1e3 * max(run.times):.2f})')
    found = {}
    for target in _TARGETS:
        if 5.0 * fabric.uncertain > target:
            continue
        medians = {
            name: time_at(curve, target, lambda run: statistics.median(run.times))
            for name, curve in runs.items()}
        best = min((name for name in runs if name != 'auto'), key=lambda name: medians[name])
        ratios = []
        for turn in range(rounds):
            def time_of(run: Run, turn: int = turn) -> float:
                return run.times[turn]
            ratios.append(
                time_at(runs['auto'], target, time_of) / time_at(runs[best], target, time_of))
        found[target] = statistics.median(ratios)
        good = [run for run in runs['auto'] if run.error <= target]
        print(
            f'{fabric.name:12} at {target:g}: {best:8} {1e3 * medians[best]:.2f} ms, auto '
            f'{1e3 * medians["auto"]:.2f} ms, {found[target]:.2f} '
            f'({min(ratios):.2f}-{max(ratios):.2f}) times'
            + (f', auto from {good[0].setting:g} on' if good else ''), flush=True)
    return found


def show_parts(fabric: Fabric) -> None:
    """Print the distribution of times of runs by tolerance [ms], the least of nine."""
    watched = {
        'steps and health checks': (MethodCalls, 'timed'),
        'measurements': (AccuracyProbe, 'measured'),
        'largest frequency': (MotionRates, 'measure')}
    spent: dict[str, float] = {}

    def follow(owner: type, method: str, label: str) -> Callable[..., Any]:
        plain = getattr(owner, method)

        def timed(*arguments: Any, **named: Any) -> Any:
            began = process_time()
            try:
                return plain(*arguments, **named)
            finally:
                spent[label] = spent.get(label, 0.0) + process_time() - began
        setattr(owner, method, timed)
        return plain

    kept = {label: follow(*place, label) for label, place in watched.items()}
    try:
        for _, solver in contestants(fabric)['auto']:
            best: dict[str, float] = {}
            for _ in range(9):
                try:
                    simulation = make(fabric.changes, **solver)
                except ValueError:
                    return
                spent.clear()
                began = process_time()
                simulation.advance_to(fabric.duration)
                whole = process_time() - began
                if whole < best.get('all', math.inf):
                    best = {'all': whole, **spent}
                    best['rest'] = whole - sum(spent.values())
            status = simulation.status
            print(
                f'  auto {solver["tolerance"]:.1e}: {status.method_name}, {status.step_count} '
                f'steps of {status.step * fabric.rate:.3g} rad; ' + ', '.join(
                    f'{label} {1e3 * value:.2f} ms' for label, value in best.items()))
    finally:
        for label, (owner, method) in watched.items():
            setattr(owner, method, kept[label])


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--scenes', type=int, default=20, help='random fabrics (20)')
    parser.add_argument('--first', type=int, default=0, help='seed of the first one (0)')
    parser.add_argument('--rounds', type=int, default=5)
    parser.add_argument('--points', action='store_true', help='print every run')
    parser.add_argument('--parts', action='store_true', help='print where the time of S1 goes')
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    print('\n'.join(machine_lines(())))
    plain = {
        **{f'{room}.{name}': value for room, names in FABRIC.items()
           for name, value in names.items()},
        'weave.size': list(SIZES['S1']), 'solver.threads': 1}
    fabric = prepare('S1', plain, DURATION)
    measure(fabric, arguments.rounds, verbose=arguments.points)
    if arguments.parts:
        show_parts(fabric)
    found: dict[float, list[float]] = {target: [] for target in _TARGETS}
    wild: dict[float, list[float]] = {target: [] for target in _TARGETS}
    seed, count = arguments.first, 0
    while count < arguments.scenes:
        changes, _, _ = draw_scene('free', seed)
        changes.pop('solver.tolerance')
        del changes['solver.energy_limit']
        fabric = prepare(f'free {seed}', changes, 0.0)
        ratios = measure(fabric, arguments.rounds, verbose=arguments.points)
        for target, ratio in ratios.items():
            (wild if fabric.wild else found)[target].append(ratio)
        count += not fabric.wild and bool(ratios)
        seed += 1
    for label, group in (('smooth', found), ('wild', wild)):
        for target, values in group.items():
            if values:
                print(
                    f'{label}, {len(values)} fabrics at {target:g}: median '
                    f'{np.median(values):.2f}, largest {max(values):.2f}, '
                    f'{sum(value <= 1.3 for value in values)} up to 1.3')
    return 0


if __name__ == '__main__':
    sys.exit(main())
