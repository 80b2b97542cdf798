# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Speed in numbers that are the same on a busy machine; speed_ceilings.yaml has a ceiling for each.

Instructions in the loops of a step of a bare fabric, evaluations of the forces in short runs, and
bytes of the arrays of a simulation. What they leave out, `make bench` times.
"""

import json
import os
from pathlib import Path
import pickle
import subprocess
import sys

from fabrics import changed, make_scene
import icofabric_sim as ico
from icofabric_sim.kernels.integrators import bodies, embedded, sweep
from icofabric_sim.kernels.runtime.target import choose, LEVELS
from icofabric_sim.simulation.model.packing import pack_loads, pack_scene
from icofabric_sim.simulation.stepping.thread_team import ThreadTeam
from icofabric_validation.benchmarks.bare_kernels import fresh
from icofabric_validation.benchmarks.held_arrays import arrays_of
import llvmlite
import numba
import numpy as np
import pytest
import yaml

FILE = Path(__file__).with_name('speed_ceilings.yaml')
CEILINGS = yaml.safe_load(FILE.read_text(encoding='utf-8'))
# A figure below this part of its ceiling is an improvement that the file does not know.
LEAST_RATIO = 0.85
S1 = {
    'shell.edge_length': 0.02, 'shell.thickness': 0.002, 'shell.density': 1200.0,
    'connector.stiffness': 500.0, 'solver.threads': 1, 'solver.tolerance': 1e-6,
    'initial_random.velocity_sigma': 0.05, 'initial_random.spin_sigma': 2.0,
    'initial_random.seed': 1}
# Changes to S1 or the name of an example scene, and the simulated time [s].
RUNS = {
    'leapfrog': ({'solver.method': 'leapfrog', 'solver.step': 1e-4}, 0.05),
    'srkn6': ({'solver.method': 'srkn6', 'solver.step': 1.25e-3}, 0.125),
    'srkn8': ({'solver.method': 'srkn8', 'solver.step': 2e-3}, 0.2),
    'dop8': ({'solver.method': 'dop8'}, 0.1),
    'auto at 1e-3': ({'solver.tolerance': 1e-3}, 0.1),
    'auto at 1e-6': ({}, 0.1),
    'auto at 1e-9': ({'solver.tolerance': 1e-9}, 0.1),
    'damped': ({'solver.method': 'dop8', 'connector.damping': 0.02}, 0.1),
    'kinked': ({'connector.stiffness_compression': 100.0}, 0.05),
    'contact': ('folded_slab', 0.2)}
# Compiles the kernels on standard input for the processor that Numba is told, and counts. None is
# called, so the processor at hand may lack its instructions.
COUNT = """
import importlib, json, pickle, sys
from icofabric_validation.benchmarks.instructions import functions_in_loops, recompiled
counts = {}
for name, (module, function, kinds) in pickle.load(sys.stdin.buffer).items():
    kernel = recompiled(getattr(importlib.import_module(module), function))
    kernel.compile(kinds)
    counts[name] = functions_in_loops(next(iter(kernel.inspect_asm().values())))
print(json.dumps(counts))
"""


def check(name, value, ceiling, details=''):
    """Require a figure to be below its ceiling, and not far below."""
    place = f'{name} ({FILE.name}): {value:g}'
    assert value <= ceiling, (
        f'{place} is above the ceiling of {ceiling:g}. Make the change cheaper; if the cost is '
        f'intended, raise the ceiling and say why in the commit. {details}')
    assert value >= LEAST_RATIO * ceiling, (
        f'{place} is far below the ceiling of {ceiling:g}, an improvement: lower the ceiling to '
        f'the present figure, so that it is not lost again. {details}')


def compile_run(name, **changes):
    start, duration = RUNS[name]
    if isinstance(start, str):
        scene = changed(ico.load_scene(start), {'solver.threads': 1})
    else:
        scene = make_scene((5, 5, 5), {**S1, **start, **changes})
    return ico.compile_scene(scene), duration


def check_run(simulation, name):
    row, status = CEILINGS['runs'][name], simulation.status
    assert {*row} == {'evaluations', 'estimation', 'bytes'}
    figures = {
        'evaluations': status.evaluation_count, 'estimation': status.estimation_count,
        'bytes': round(sum(arrays_of(simulation).values()) / simulation.scene.body_count)}
    for figure, value in figures.items():
        check(f'runs, {name}, {figure}', value, row[figure], f'All figures: {figures}')


@pytest.mark.parametrize('name', RUNS)
def test_evaluations_and_bytes_of_a_run(name):
    simulation, duration = compile_run(name)
    simulation.advance_to(duration)
    assert simulation.status.step_count > 10
    assert (simulation.status.deepest_overlap > 0.0) is (name == 'contact')
    check_run(simulation, name)


def test_twice_the_evaluations_are_found():
    simulation, duration = compile_run('leapfrog', **{'solver.step': 0.5e-4})
    simulation.advance_to(duration)
    with pytest.raises(AssertionError, match='leapfrog, evaluations.* is above the ceiling'):
        check_run(simulation, 'leapfrog')


def bare_steps():
    """Return the kernels that take steps of a bare fabric, with the types of their arguments."""
    scene = make_scene((2, 2, 2), S1)
    packed = pack_scene(scene)
    model, team, weights = packed.model, ThreadTeam(1, packed).team(0), np.zeros(2)
    state, work = fresh(packed, scene)
    pair = packed.layout.room(model.links, state)
    loads = pack_loads((), packed.layout)
    steps = {
        'splitting': (sweep.steps, (
            weights, weights, model, None, None, state, work, team, None, 0.0, 0, 0.0, 1)),
        'dop8': (bodies.slope_at, (
            model, loads, state, pair, pair.trail, 0, team, None, 0.0, 0, 1)),
        'stages of dop8': (bodies.try_step, (
            bodies.bodies_of(model, loads, state, state, pair, team, None, is_called=False),
            embedded.DOP8, 0.0, 0.0, False))}
    return {name: (kernel.__module__, kernel.__name__, tuple(map(numba.typeof, arguments)))
            for name, (kernel, arguments) in steps.items()}


def count_instructions(level):
    """Return instructions in loops by kernel and function, compiled for a level of x86-64."""
    target = choose(dict.fromkeys(LEVELS[level], True), {}, numba_was_first=False)
    assert target.level == level
    done = subprocess.run(
        [sys.executable, '-c', COUNT], input=pickle.dumps(bare_steps()), capture_output=True,
        check=False, env={**os.environ, 'NUMBA_CPU_NAME': level,
                          'NUMBA_CPU_FEATURES': target.features})
    assert done.returncode == 0, done.stderr.decode()
    return json.loads(done.stdout)


@pytest.mark.parametrize('level', LEVELS)
def test_instructions_in_the_loops_of_a_bare_step(level):
    measured_with = CEILINGS['measured_with']
    if measured_with != {'numba': numba.__version__, 'llvmlite': llvmlite.__version__}:
        pytest.skip(f'{FILE.name} counts instructions of {measured_with}')
    counts = count_instructions(level)
    assert {*counts} == {*CEILINGS['loop_instructions'][level]}
    for name, functions in counts.items():
        check(f'loop_instructions, {level}, {name}', sum(functions.values()),
              CEILINGS['loop_instructions'][level][name], f'By function: {functions}')


@pytest.mark.parametrize('value, said', [
    (101, 'above the ceiling of 100. Make'), (100, ''), (85, ''), (84, 'lower the ceiling')])
def test_figures_far_from_their_ceilings_fail(value, said):
    try:
        check('bytes', value, 100)
    except AssertionError as error:
        assert said and said in str(error)
    else:
        assert not said
