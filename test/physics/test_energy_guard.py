# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
What the energy balance stops, and what it lets pass: every term, by size, stiffness and motion.

The many kinds of scenes run in plain Python, in a process of their own: a few bodies and hundreds
of steps take less than to compile them, and a force can be falsified there.
"""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from unittest import mock

import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import inscribed_radius
from icofabric_sim.kernels import flows
from icofabric_sim.simulation.stepping.accuracy_probe import AccuracyProbe
from icofabric_sim.simulation.stepping.controllers import measured
from icofabric_sim.simulation.stepping.methods import METHODS
from icofabric_sim.terms.anchors import kick
from icofabric_sim.terms.gravity.record import Gravity
import numpy as np
import pytest

# Half edges [m]; amplitudes beside that, or beside a radian.
SIZES = {'1 mm': 1e-3, '1 m': 1.0}
AMPLITUDES = {'cold': 1e-7, 'hot': 0.1}
STIFFNESS = {'soft': 1e-3, 'stiff': 1e6}  # [N/m]
TERMS = ('springs', 'table', 'bending', 'twisting', 'anchor', 'tight anchors', 'dipole',
         'charges', 'contact', 'plane', 'weight')
RUNS = ('right', 'wrong force', 'wrong step', 'rest')
# Terms without a force where a scene begins.
CALM = ('springs', 'bending', 'twisting', 'contact', 'plane')


def describe(term: str, a: float, k: float, amplitude: float, folder: str) -> dict:
    """
    Parameters of one or two bodies of half edge `a` [m] with one term of stiffness `k` [N/m].
    """
    single = term not in ('springs', 'table', 'bending', 'twisting')
    face = np.ones(3) / np.sqrt(3.0)
    moment = k * a**2
    changes: dict = {
        'shell.edge_length': 2.0 * a, 'shell.thickness': 0.2 * a, 'contact.mode': 'never',
        'weave.size': [1, 1, 1] if single else [2, 2, 1],
        'connector.stiffness': 0.0 if term in ('bending', 'twisting') else k}
    if term == 'table':
        # Pulls everywhere, the less the longer: no natural length, and energies below zero.
        path = os.path.join(folder, f'{a}_{k}.csv')
        with open(path, 'w', encoding='utf-8') as file:
            file.write(f'{9 * a}, {2 * k * a}\n{12 * a}, {k * a}\n')
        changes['connector.law'] = path
    elif term in ('bending', 'twisting'):
        changes[f'connector.{term}_stiffness'] = moment
    elif term == 'anchor':
        changes |= {'anchors.x.body': 0, 'anchors.x.edge': 'up',
                    'anchors.x.position': [0.0, 0.0, 4.0 * a], 'connector.natural_length': 2.0 * a}
    elif term == 'tight anchors':
        # Pre-stress holds 100 times the energy of a hot motion.
        tip = a * (1.0 + np.sqrt(5.0)) / 2.0
        changes['connector.natural_length'] = 2.0 * a
        for edge, side in (('up', 1.0), ('down', -1.0)):
            changes |= {f'anchors.{edge}.body': 0, f'anchors.{edge}.edge': edge,
                        f'anchors.{edge}.position': [0.0, 0.0, side * (tip + 22.0 * a)]}
    elif term == 'dipole':
        changes |= {'charge.dipole': [moment, 0.0, 0.0], 'field.electric': [1.0, 1.0, 0.0]}
    elif term == 'charges':
        changes |= {'charge.per_body': float(np.sqrt(k * a**3 / 8.9875517923e9)),
                    'charge.mutual': True, 'bodies.other.position': [4.0 * a, 0.0, 0.0]}
    elif term == 'contact':
        away = (2.0 * inscribed_radius(a) - 0.1 * amplitude * a) * face
        changes |= {'contact.mode': 'always', 'contact.stiffness': k,
                    'bodies.other.position': away.tolist()}
    elif term == 'plane':
        below = 0.1 * amplitude * a - inscribed_radius(a)
        changes |= {'contact.mode': 'always', 'contact.stiffness': k,
                    'planes.floor.normal': face.tolist(), 'planes.floor.offset': below}
    elif term == 'weight':
        changes['gravity'] = [0.0, 0.0, -9.81]
    return changes


def build(changes: dict, **more: float | str) -> ico.Simulation:
    return ico.compile_scene(ico.Scene.from_parameters({**changes, **{
        f'solver.{name}': value for name, value in more.items()}}))


def run(term: str, kind: str, a: float, k: float, amplitude: float, folder: str) -> dict:
    """Take steps; says why they ended, and what the balance was."""
    if kind == 'rest':
        amplitude = 0.0
    changes = describe(term, a, k, amplitude, folder)
    # Given, because a step that is chosen is tried out first, which takes longer than the run.
    short = max(1e-4 * a * float(np.sqrt(1e3 * a / k)), 2e-9)
    probe = build(changes, method='leapfrog', step=short)
    rate = probe.status.largest_frequency
    if term in ('contact', 'plane'):
        rate = METHODS['leapfrog'].stability / probe.status.stability_limit
    rate = rate if 0.0 < rate < np.inf else float(np.sqrt(9.81 / a))
    if amplitude and term in ('springs', 'table'):
        # Stretched: two bodies in any motion hardly stretch their connector.
        position = probe.scene.position
        line = position[0] - position[1]
        line *= amplitude * a / np.linalg.norm(line)
        changes |= {'groups.first': 'ids 0', 'initial.x.group': 'first',
                    'initial.x.displacement': line.tolist()}
    elif amplitude and term not in ('contact', 'plane'):
        changes |= {'initial_random.velocity_sigma': amplitude * a * rate,
                    'initial_random.spin_sigma': amplitude * rate}
    if kind == 'wrong step':
        step = 1.3 * METHODS['leapfrog'].stability / rate
        loose = {'leapfrog': METHODS['leapfrog']._replace(stability=1e3)}
        with mock.patch.dict(METHODS, loose):
            simulation = build(changes, method='leapfrog', step=step)
    else:
        simulation = build(changes, method='srkn4', step=(0.1 if term == 'table' else 0.23) / rate)
    said = ''
    try:
        for _ in range(4):
            simulation.advance_steps(15 if kind == 'wrong step' else 10)
    except ico.SimulationError as error:
        said = str(error)
    energy, books = simulation.snapshot().energy, simulation._driver.trajectory.ledger
    return {'said': said, 'worst': simulation.balance.worst, 'kinetic': energy['kinetic'],
            'scale': simulation.balance.scale, 'moved': books.scale,
            'noise': books.noise, 'error': simulation.balance.error}


def falsify(stack: contextlib.ExitStack) -> None:
    """Let every force be a tenth larger than the slope of its energy."""
    accelerate, kick_by = flows.accelerate, kick.kick_by
    # Without compilation a composed function finds the functions of terms in its namespace.
    terms = flows.add_accelerations.__globals__
    add_gravity = terms['gravity_add_acceleration']
    more = 1.1

    def stronger(supports, mass, inertia, force, s):
        return accelerate(supports, mass, inertia, tuple(more * part for part in force), s)

    def heavier(gravity, supports, alive, s, a):
        if gravity is not None:
            gravity = Gravity(more * gravity.acceleration)
        return add_gravity(gravity, supports, alive, s, a)

    def harder(supports, mass, inertia, loads, velocity, spin, m, s, h, force, torque):
        return kick_by(
            supports, mass, inertia, loads, velocity, spin, m, s, more * h, force, torque)

    stack.enter_context(mock.patch.object(flows, 'accelerate', stronger))
    stack.enter_context(mock.patch.dict(terms, gravity_add_acceleration=heavier))
    stack.enter_context(mock.patch.object(kick, 'kick_by', harder))


def combinations() -> dict:
    """
    Arguments of all runs but the folder, by name; small stiff scenes and large soft ones.

    Cold and hot ones of springs; else small scenes are cold, and large ones hot.
    """
    found = {}
    for term in TERMS:
        for size, hard in (('1 mm', 'stiff'), ('1 m', 'soft')):
            for warmth, amplitude in AMPLITUDES.items():
                if term != 'springs' and (size == '1 mm') != (warmth == 'cold'):
                    continue
                # Beside the pre-stress a cold motion is rounding.
                if term == 'tight anchors' and warmth == 'cold':
                    continue
                for kind in RUNS:
                    # A body at rest has no amplitude, and is at rest only in these; weight is
                    # integrated exactly, and what pushes off is gone before a step is too long.
                    if kind == 'rest' and (warmth == 'hot' or term not in CALM):
                        continue
                    if kind == 'wrong step' and term in ('weight', 'contact', 'plane'):
                        continue
                    found[f'{term}, {size}, {hard}, {warmth}, {kind}'] = (
                        term, kind, SIZES[size], STIFFNESS[hard], amplitude)
    return found


def fall(folder: str) -> dict:
    """
    Rough steps of a slab whose connectors pull the more the shorter they are: energies below zero.
    """
    path = os.path.join(folder, 'falling.csv')
    with open(path, 'w', encoding='utf-8') as file:
        file.write('0.09, 2.0\n0.12, 1.0\n')
    changes = {'weave.size': [3, 3, 3], 'contact.mode': 'never', 'connector.law': path}
    step = 0.2 * build(changes, method='leapfrog', step=1e-4).status.stability_limit
    simulation, said = build(changes, method='leapfrog', step=step), ''
    try:
        simulation.advance_to(0.3)
    except ico.SimulationError as error:
        said = str(error)
    return {'said': said, 'time': simulation.time, 'scale': simulation.balance.scale,
            **simulation.snapshot().energy}


def flee(folder: str) -> dict:
    """Fine steps of two bodies that push each other the more the farther they are."""
    path = os.path.join(folder, 'fleeing.csv')
    with open(path, 'w', encoding='utf-8') as file:
        file.write('0.03, 0.0\n0.04, -10.0\n')
    simulation = build({
        'weave.size': [2, 2, 1], 'contact.mode': 'never', 'connector.law': path,
        'initial_random.velocity_sigma': 1e-4}, method='srkn4', step=1e-4)
    start = simulation.snapshot().energy['kinetic']
    simulation.advance_steps(150)
    balance = simulation.balance
    return {'said': '', 'start': start, 'scale': balance.scale, 'error': balance.error,
            **simulation.snapshot().energy}


def touch() -> list:
    """Steps that are chosen for a woven and a loose shell that just touch: what the runs say."""
    said, half_edge = [], 0.01
    for more in (0.0, -1e-17):
        away = (2.0 * inscribed_radius(half_edge) + more) / np.sqrt(3.0)
        simulation = build({'weave.size': [1, 1, 1], 'bodies.other.position': [away] * 3})
        try:
            simulation.advance_steps(12)
            energy = simulation.snapshot().energy
            said.append(['', simulation.balance.error, energy['kinetic'] + energy['contact']])
        except ico.SimulationError as error:
            said.append([str(error), 0.0, 0.0])
    return said


def advise() -> str:
    """
    What a run says that stops although its steps are chosen: its energy is falsified on the way.
    """
    simulation = build({
        'weave.size': [2, 2, 1], 'contact.mode': 'never', 'connector.bending_stiffness': 10.0,
        'initial_random.spin_sigma': 1.0}, method='srkn4')
    simulation.advance_steps(10)
    simulation._driver.trajectory.ledger.base += 1.0
    with pytest.raises(ico.SimulationError) as caught:
        simulation.advance_steps(100)
    return str(caught.value)


def unmeasured(
    accuracy: AccuracyProbe, step: float, fastest: float, *, least: int = 1, given: bool = False,
    brief: bool = False
) -> float:
    """Stand in for the measurement of an error, in no time."""
    accuracy._span = step
    return 0.0


def results() -> dict:
    """Run all; results by name."""
    found = {}
    # Errors of trajectories are of no interest here, and to measure them takes longer than the
    # runs.
    with tempfile.TemporaryDirectory() as folder, (
            mock.patch.object(AccuracyProbe, 'measured', unmeasured)):
        found['falling'], found['fleeing'] = fall(folder), flee(folder)
        found['touching'], found['advice'] = touch(), advise()
        for name, arguments in combinations().items():
            with contextlib.ExitStack() as stack:
                if arguments[1] == 'wrong force':
                    falsify(stack)
                found[name] = run(*arguments, folder)
    return found


@pytest.fixture(scope='module')
def found() -> dict:
    ended = subprocess.run(
        [sys.executable, __file__], env={**os.environ, 'NUMBA_DISABLE_JIT': '1'},
        capture_output=True, text=True, check=True)
    return json.loads(ended.stdout)


@pytest.mark.parametrize('name', combinations())
def test_only_wrong_runs_are_stopped(found, name):
    result = found[name]
    print(result)
    if name.endswith(('wrong force', 'wrong step')):
        assert 'does not balance' in result['said']
        # Steps are given here.
        assert 'give a smaller solver.step, or 0 to have it chosen' in result['said']
    else:
        assert result['said'] == ''
        # By far, whether it moves or stands.
        assert result['worst'] < (1e-3 if name.endswith('right') else 1e-6)
        # And something did move; not by rounding alone, so the guard has looked at it.
        if name.endswith('right'):
            assert result['moved'] > 1e4 * result['noise'] > 0.0


def test_a_wrong_run_with_energies_below_zero_is_stopped(found):
    result = found['falling']
    print(result)
    # Kinetic energy and connectors together are below zero all the time.
    assert result['total'] < -result['scale'] < 0.0
    assert 'does not balance' in result['said'] and result['time'] < 0.3


def test_shells_that_just_touch_are_not_stopped_for_rounding(found):
    for said, error, energy in found['touching']:
        assert said == ''
        # They do touch, or the run says nothing: rounding moves them.
        assert 0.0 < abs(error) < 1e-25 and 0.0 < energy < 1e-25


def test_a_stop_of_chosen_steps_says_what_they_follow(found):
    text = found['advice']
    assert 'does not balance' in text and 'solver.step' not in text
    assert 'a smaller solver.tolerance makes steps shorter' in text
    assert 'solver.tolerance 1e-06 per second' in text
    assert 'bending connectors (connector.bending_stiffness), up to ' in text


def test_a_right_run_in_which_large_energies_cancel_goes_on(found):
    result = found['fleeing']
    print(result)
    assert result['said'] == '' and result['kinetic'] > 1e6 * result['start']
    # Beside the sum of the energies, which stays what it was, the error would be too large.
    assert abs(result['error']) > 0.01 * result['start'] > 0.0
    assert result['scale'] >= 1.9 * result['kinetic']


@pytest.mark.parametrize('limit', [1e-3, 1e-2])
def test_chosen_steps_of_leapfrog_swing_less_than_the_limit(limit):
    # Not found where this file is a script.
    from fabrics import make_scene
    # A step that the tolerance alone would allow swings by 1 % of what vibrates.
    simulation = ico.compile_scene(make_scene((2, 2, 2), {
        'solver.method': 'leapfrog', 'solver.tolerance': 1e3, 'solver.energy_limit': limit,
        'initial_random.velocity_sigma': 1e-3, 'initial_random.spin_sigma': 0.1}))
    simulation.advance_to(100.0 / simulation.status.largest_frequency)
    status = simulation.status
    ratio = status.step * status.largest_frequency
    assert 0.5 * np.sqrt(2.0 * limit) < ratio < 1.3 * np.sqrt(2.0 * limit)
    assert 1e-3 * limit < abs(simulation.balance.worst) < limit


@pytest.mark.parametrize(('method', 'limit'), [('leapfrog', 1e-15), ('srkn6', 1e-8)])
def test_a_stop_for_rounding_names_the_limit_and_not_the_step(method, limit, monkeypatch):
    # Not found where this file is a script.
    from fabrics import make_scene
    if method == 'srkn6':
        # Steps that do not follow the limit, as where more than vibrations swings the energy.
        monkeypatch.setattr(measured, '_largest_ratio', lambda method, limit: np.inf)
    simulation = ico.compile_scene(make_scene((2, 2, 2), {
        'solver.method': method, 'solver.tolerance': 1e3, 'solver.energy_limit': limit,
        'initial_random.velocity_sigma': 0.1, 'initial_random.spin_sigma': 10.0}))
    with pytest.raises(ico.SimulationError, match='energy does not balance') as caught:
        simulation.advance_to(1.0)
    balance, text = simulation.balance, str(caught.value)
    is_rounding = abs(balance.error) < 1e-11 * balance.scale
    assert is_rounding == (method == 'leapfrog')
    assert ('a solver.energy_limit of 1e-11 or more' in text) == is_rounding
    assert ('a smaller solver.tolerance makes steps shorter' in text) != is_rounding


if __name__ == '__main__':
    print(json.dumps(results()))
