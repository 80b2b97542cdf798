# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Evaluations of the forces: `evaluation_count` and `estimation_count` of the status.

An independent counter, in plain Python, counts the calls of the force function itself.
"""

import json
import math
import os
from pathlib import Path
import subprocess
import sys
from unittest import mock

from fabrics import same_state
import icofabric_sim as ico
from icofabric_sim.kernels import flows, rhs
from icofabric_sim.kernels.integrators import embedded
import pytest

ROOT = Path(__file__).parents[2]
SIZE = {
    'weave.size': [2, 2, 2], 'initial_random.velocity_sigma': 0.1,
    'initial_random.spin_sigma': 10.0, 'initial_random.seed': 1, 'contact.mode': 'never'}
KINKED = {'connector.stiffness_extension': 600.0, 'connector.stiffness_compression': 400.0}
DAMPED = {'connector.damping': 1.0, 'solver.energy_limit': 1.0}
TOUCHING = {
    'weave.connected': False, 'weave.size': [2, 1, 1], 'gravity': [0.0, 0.0, -9.81],
    'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.023,
    'contact.friction': 0.3,
    'initial_random.velocity_sigma': 0.5, 'contact.mode': 'always', 'contact.stiffness': 3e3}
RUNS = {
    'leapfrog given': ({'solver.method': 'leapfrog', 'solver.step': 1e-3}, 0.02),
    'leapfrog chosen': ({'solver.method': 'leapfrog', 'solver.tolerance': 0.1}, 0.004),
    'srkn6 given': ({'solver.method': 'srkn6', 'solver.step': 4e-3}, 0.03),
    'srkn6 chosen': ({'solver.method': 'srkn6'}, 0.005),
    'srkn6 kinked': (KINKED | {'solver.method': 'srkn6', 'solver.step': 2e-3}, 0.012),
    'srkn8 chosen': ({'solver.method': 'srkn8'}, 0.005),
    'dop8 given': ({'solver.method': 'dop8', 'solver.step': 4e-3}, 0.03),
    'dop8 adaptive': ({'solver.method': 'dop8'}, 0.03),
    'dop8 kinked': (KINKED | {'solver.method': 'dop8', 'solver.tolerance': 1e-3}, 3e-3),
    'dop8 damped': (DAMPED | {'solver.method': 'dop8', 'solver.tolerance': 1e-3}, 0.02),
    'sdirk4 given': (DAMPED | {'solver.method': 'sdirk4', 'solver.step': 1e-3}, 2e-3),
    'sdirk4 adaptive': (DAMPED | {'solver.method': 'sdirk4', 'solver.tolerance': 0.1}, 4e-3),
    'leapfrog touching': (TOUCHING | {
        'solver.method': 'leapfrog', 'solver.tolerance': 0.1}, 0.02),
    'dop8 touching': (TOUCHING | {'solver.method': 'dop8', 'solver.tolerance': 0.1}, 0.01),
    'leapfrog touching given': (TOUCHING | {
        'solver.method': 'leapfrog', 'solver.step': 2e-4}, 0.02),
    'leapfrog falling': ({
        'weave.connected': False, 'gravity': [0.0, 0.0, -9.81], 'solver.method': 'leapfrog',
        'solver.step': 2e-3}, 0.02),
}


def scene_of(name: str, **changes) -> ico.Scene:
    parameters, _ = RUNS[name]
    return ico.Scene.from_parameters(SIZE | parameters | changes)


class Counter:
    """Counts evaluations of the first block; a call of kernels that repeats one counts once."""

    def __init__(self) -> None:
        self.count = 0

    def accelerations(self, *arguments):
        self.count += int(arguments[-2] == 0)
        return ACCELERATIONS(*arguments)

    def find_slope(self, *arguments):
        FIND_SLOPE(*arguments)
        caller = sys._getframe(1)
        self.count -= int(
            caller.f_code.co_name == 'fixed_pair' and 'done' not in caller.f_locals)


ACCELERATIONS, FIND_SLOPE = flows.accelerations, embedded.find_slope


def counted() -> dict[str, list[int]]:
    """Counts of the status, and the counter, after each run and after a state within a step."""
    found = {}
    for name, (_, time) in RUNS.items():
        counter = Counter()
        with (
            mock.patch.object(flows, 'accelerations', counter.accelerations),
            mock.patch.object(rhs, 'accelerations', counter.accelerations),
            mock.patch.object(embedded, 'find_slope', counter.find_slope)
        ):
            run = ico.compile_scene(scene_of(name))
            numbers = []
            for part in (0.61, 1.0):
                run.advance_to(part * time)
                numbers += [
                    run.status.evaluation_count, run.status.estimation_count, counter.count]
                run.snapshot()
                numbers += [
                    run.status.evaluation_count, run.status.estimation_count, counter.count]
            numbers += [run.status.step_count, run.status.stage_count]
        found[name] = numbers
    return found


@pytest.fixture(scope='module')
def plain() -> dict[str, list[int]]:
    environment = {**os.environ, 'NUMBA_DISABLE_JIT': '1'}
    environment['PYTHONPATH'] = os.pathsep.join([
        str(ROOT), str(ROOT / 'test'), environment.get('PYTHONPATH', '')])
    ended = subprocess.run(
        [sys.executable, __file__], env=environment, capture_output=True, text=True, check=True)
    return json.loads(ended.stdout)


@pytest.mark.parametrize('name', RUNS)
def test_both_counts_are_all_calls_of_the_force_function(plain, name):
    *numbers, steps, stages = plain[name]
    print(name, plain[name])
    for taken, others, called in zip(numbers[::3], numbers[1::3], numbers[2::3]):
        assert taken + others == called
    assert numbers[-3] >= steps
    if name.endswith('given') and 'sdirk4' not in name:
        # Each step, and the forces at the start.
        assert numbers[-3] == stages * steps + 1
    # A state that is shown changes no trajectory.
    assert numbers[0] == numbers[3] and numbers[6] == numbers[9]
    assert numbers[4] >= numbers[1] > 0 or 'dop8' in name or 'sdirk4' in name


def counts(run: ico.Simulation) -> tuple[int, int]:
    return run.status.evaluation_count, run.status.estimation_count


@pytest.mark.parametrize('name', ['leapfrog given', 'srkn6 chosen', 'dop8 given', 'dop8 damped'])
def test_counts_are_the_same_in_pieces_and_go_on_from_a_checkpoint(name):
    whole, pieces = (ico.compile_scene(scene_of(name)) for _ in range(2))
    end = 5.0 * RUNS[name][1]
    whole.advance_to(end)
    for part in (0.1, 0.43, 0.7003):
        pieces.advance_to(part * end)
    other = ico.compile_scene(scene_of(name, **{'solver.threads': 1}))
    # What is shown belongs to the run that showed it.
    pieces.snapshot()
    other.restore(pieces.checkpoint())
    for run in (pieces, other):
        run.advance_to(end)
    assert counts(whole) == counts(other) and counts(whole)[0] == counts(pieces)[0]
    assert min(counts(whole)) > 0 and counts(pieces)[1] > counts(whole)[1]
    whole.reset_time()
    again = ico.compile_scene(scene_of(name))
    assert counts(whole) == counts(again)


QUIET = {'solver.error_estimate': False}


@pytest.mark.parametrize('name', [
    'leapfrog given', 'srkn6 kinked', 'dop8 given', 'dop8 kinked', 'dop8 damped',
    'sdirk4 adaptive', 'leapfrog touching', 'leapfrog touching given', 'dop8 touching'])
def test_steps_are_the_same_where_errors_are_not_estimated(name):
    runs = [ico.compile_scene(scene_of(name, **changes)) for changes in ({}, QUIET)]
    estimated, quiet = runs
    for run in runs:
        run.advance_to(3.0 * RUNS[name][1])
    evaluations = [run.status.evaluation_count for run in runs]
    assert evaluations[0] == evaluations[1] > 0
    if name != 'leapfrog touching':
        assert quiet.status.estimation_count == 0
        # Room for trial steps and companions was not made.
        assert quiet._driver.trials._room is None and quiet._driver.trials._earlier is None
    assert estimated.error_estimate > 0.0 and estimated.status.error_rate >= 0.0
    assert math.isnan(quiet.error_estimate) and math.isnan(quiet.status.error_rate)
    assert 'solver.error_estimate' in quiet.status.error_estimate_lacks
    assert same_state(*(run.snapshot() for run in runs))
    assert estimated.status.step_count == quiet.status.step_count
    # It goes on from a checkpoint, too.
    other = ico.compile_scene(scene_of(name, **QUIET))
    other.restore(quiet.checkpoint())
    for run in (quiet, other):
        run.advance_to(4.0 * RUNS[name][1])
    assert quiet.checkpoint().difference(other.checkpoint()) == ''


if __name__ == '__main__':
    print(json.dumps(counted()))
