# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Body forces that a user writes in Python: compiled or called, their work, and their errors."""

import functools
import math

from fabrics import changed, make_scene, RANDOM, same_state, SUPPORTED
import icofabric_sim as ico
from icofabric_sim.simulation.stepping import thread_team
import numba
import numpy as np
import pytest

CENTRE, PULL, TWIST, LAG = np.array([0.1, -0.05, 0.2]), 3.0, 2e-4, 1e-3
LOOSE = {'weave.connected': False, 'contact.mode': 'never', 'solver.tolerance': 1e-9}
MASS = make_scene().shell.mass


def spring(time, position, orientation, linear_velocity, angular_velocity):
    """Pull to a point; means the same for one body and for all."""
    return -PULL * (position - CENTRE), 0.0 * angular_velocity


def spring_energy(time, position, orientation):
    """Its potential, for one body or for all."""
    return 0.5 * PULL * ((position - CENTRE)**2).sum(axis=-1)


def one_body(time, position, orientation, linear_velocity, angular_velocity):
    """
    For one body only, because of its functions of a single number: pushed, held back and turned.
    """
    push = math.sin(200.0 * time) * math.exp(-position[0])
    return (push, -LAG * linear_velocity[1], 0.0), (0.0, 0.0, TWIST * push)


def all_bodies(time, position, orientation, linear_velocity, angular_velocity):
    """The same for all at once, because of its columns."""
    push = np.sin(200.0 * time) * np.exp(-position[:, 0])
    force, torque = np.zeros_like(position), np.zeros_like(position)
    force[:, 0], force[:, 1] = push, -LAG * linear_velocity[:, 1]
    torque[:, 2] = TWIST * push
    return force, torque


def imports_within(time, position, orientation, linear_velocity, angular_velocity):
    from numpy import multiply  # Numba ends with UnsupportedBytecodeError
    return multiply(-PULL, position - CENTRE), 0.0 * angular_velocity


def imports_for_one(time, position, orientation, linear_velocity, angular_velocity):
    import math
    return (math.fsum([-PULL * (position[0] - CENTRE[0])]), 0.0, 0.0), (0.0, 0.0, 0.0)


def suspends(time, position, orientation, linear_velocity, angular_velocity):
    with np.errstate(all='raise'):
        return -PULL * (position - CENTRE), {'torque': 0.0 * angular_velocity}['torque']


class CallableSpring:
    def __call__(self, time, position, orientation, linear_velocity, angular_velocity):
        return -PULL * (position - CENTRE), 0.0 * angular_velocity


@pytest.mark.parametrize('function', [
    imports_within, imports_for_one, suspends, CallableSpring(), functools.partial(spring)])
def test_any_python_function_runs(function):
    scene = make_scene((2, 2, 2), LOOSE)
    force = ico.BodyForce(function)
    simulation = ico.compile_scene(scene, body_force=force)
    assert force.is_compiled is False
    time = 1.0 / math.sqrt(PULL / MASS)
    simulation.advance_to(time)
    expected = CENTRE + (scene.initial.position - CENTRE) * math.cos(1.0)
    np.testing.assert_allclose(
        simulation.snapshot().position[:, 0], expected[:, 0], rtol=0, atol=1e-7)


def test_whatever_numba_raises_leads_to_python(monkeypatch):
    for error in (numba.core.errors.UnsupportedBytecodeError('no'), NotImplementedError(),
                  KeyError('x'), AssertionError(), RecursionError('deep')):
        def fail(function, error=error):
            raise error

        monkeypatch.setattr(numba, 'njit', fail)
        force = ico.BodyForce(spring)
        ico.compile_scene(make_scene((2, 2, 2), LOOSE), body_force=force)
        assert force.is_compiled is False
        with pytest.raises(ValueError, match=f'cannot be compiled: {type(error).__name__}'):
            ico.compile_scene(make_scene((2, 2, 2), LOOSE),
                              body_force=ico.BodyForce(spring, compiled=True))


@pytest.mark.parametrize('compiled', [None, False])
def test_a_spring_to_a_point(compiled):
    # x = c + (x_0 - c) cos(w t) + v_0 sin(w t) / w with w = sqrt(PULL / M).
    scene = make_scene((2, 2, 2), LOOSE, **RANDOM)
    force = ico.BodyForce(spring, potential=spring_energy, compiled=compiled)
    simulation = ico.compile_scene(scene, body_force=force)
    assert force.is_compiled is (compiled is None)
    assert simulation.status.method_name == 'dop8'
    assert 'body force' in simulation.status.method_reason
    first, rate = scene.initial, math.sqrt(PULL / MASS)
    energy = spring_energy(0.0, first.position, None).sum()
    assert simulation.snapshot().energy['field'] == pytest.approx(energy, rel=1e-12)
    for time in (0.3 / rate, 2.0, 2.5):
        simulation.advance_to(time)
        s = simulation.snapshot()
        expected = CENTRE + (first.position - CENTRE) * math.cos(rate * time) + (
            first.linear_velocity * math.sin(rate * time) / rate)
        np.testing.assert_allclose(s.position, expected, rtol=0, atol=1e-7)
        assert np.array_equal(s.angular_velocity, first.angular_velocity)
        # With a potential nothing is work.
        assert s.energy['work_in'] == 0.0
        assert abs(s.energy['balance_error']) < 1e-7 * energy


@pytest.mark.long
def test_steps_that_nothing_can_measure_say_so():
    lacks = []
    for step, spin in ((0.0, 0.0), (2e-3, 0.0), (2e-3, 30.0)):
        simulation = ico.compile_scene(make_scene((2, 2, 2), {
            **LOOSE, 'solver.step': step, 'initial_random.velocity_sigma': 0.5,
            'initial_random.spin_sigma': spin}), body_force=spring)
        assert simulation.status.error_estimate_lacks == ''
        simulation.advance_to(0.05)
        lacks.append(simulation.status.error_estimate_lacks)
    assert [*map(bool, lacks)] == [False, True, False]
    assert 'body force' in lacks[1] and 'solver.step' in lacks[1]


def test_compiled_and_called_are_the_same_force():
    scene = make_scene((3, 3, 3), **SUPPORTED, **RANDOM)
    ends, started = [], []
    for force in (one_body, all_bodies):
        simulation = ico.compile_scene(scene, body_force=force)
        started.append(simulation.body_force.is_compiled)
        simulation.advance_to(0.05)
        ends.append(simulation.snapshot())
    assert started == [True, False]
    size = np.abs(ends[0].position - scene.initial.position).max()
    assert np.abs(ends[0].position - ends[1].position).max() < 1e-9 * size
    energy, held, first = ends[0].energy, scene.supports, scene.initial
    # Without a potential all of it is work.
    assert abs(energy['work_in']) > 1e-4 * energy['kinetic'] and energy['field'] == 0.0
    assert abs(energy['balance_error']) < 1e-6 * energy['kinetic']
    assert np.array_equal(ends[0].position[held.translation], first.position[held.translation])
    assert np.array_equal(ends[0].orientation[held.rotation], first.orientation[held.rotation])
    bare = ico.compile_scene(scene)
    bare.advance_to(0.05)
    assert np.abs(bare.snapshot().position - ends[0].position).max() > 1e-3 * size


@pytest.mark.parametrize('force', [one_body, all_bodies])
def test_pieces_threads_and_checkpoints_give_the_same_bits(force, monkeypatch):
    scene = make_scene((3, 3, 3), **RANDOM)
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1)
    ends = []
    for threads, pieces in ((1, 1), (2, 3)):
        monkeypatch.setattr(thread_team, 'core_count', lambda threads=threads: threads)
        simulation = ico.compile_scene(scene, body_force=force)
        for piece in range(pieces):
            simulation.advance_to(0.008 * (piece + 1) / pieces)
            simulation.snapshot()
        ends.append(simulation.snapshot())
    half, rest = (ico.compile_scene(scene, body_force=force) for _ in range(2))
    half.advance_to(0.0047)
    rest.restore(half.checkpoint())
    rest.advance_to(0.008)
    ends.append(rest.snapshot())
    assert all(same_state(ends[0], end) for end in ends[1:])
    assert all(end.energy == ends[0].energy for end in ends[1:])
    assert ends[0].energy['work_in'] != 0.0
    other = ico.compile_scene(scene)
    with pytest.raises(ValueError, match='given'):
        # What was done without it cannot be known.
        ico.compile_scene(scene, body_force=force).restore(other.checkpoint())


def test_the_work_closes_at_the_order_of_the_method():
    scene = make_scene((3, 2, 2), {'solver.method': 'dop8', 'contact.mode': 'never'}, **RANDOM)
    steps, errors = 1.6e-3 * 0.5 ** np.arange(3), []
    for step in steps:
        simulation = ico.compile_scene(
            changed(scene, {'solver.step': float(step)}), body_force=driven)
        simulation.advance_to(1.6e-2)
        errors.append(abs(simulation.snapshot().energy['balance_error']))
        simulation.advance_to(1.6e-2 + 0.4 * float(step))
        assert abs(simulation.snapshot().energy['balance_error']) < 2.0 * errors[-1] + 1e-14
    print('errors of the balance', errors)
    assert np.log2(errors[0] / errors[1]) > 6.5 and scene.body_count == 6
    assert abs(simulation.snapshot().energy['work_in']) > 1e4 * errors[0]


def driven(time, position, orientation, linear_velocity, angular_velocity):
    """A smooth force and torque that depend on everything."""
    push = np.sin(300.0 * time) * (1.0 + 10.0 * position[..., 0])
    force = -1e-2 * linear_velocity + 0.1
    torque = 1e-4 * orientation[..., :3] - 1e-7 * angular_velocity
    return force * push if position.ndim == 1 else force * push[:, None], torque


def fails_late(time, position, orientation, linear_velocity, angular_velocity):
    """Compiled code that raises after a while."""
    if time > 0.011:
        raise ValueError('out of order')
    return (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)


def not_a_number(time, position, orientation, linear_velocity, angular_velocity):
    """Runs away for all bodies after a while."""
    force = np.zeros_like(position)
    if time > 0.011:
        force[:] = np.nan
    return force, force


def fails_in_python(time, position, orientation, linear_velocity, angular_velocity):
    """The same where nothing is compiled."""
    if time > 0.011:
        raise KeyError('nothing here')
    return np.zeros_like(position), np.zeros_like(position)


@pytest.mark.long
@pytest.mark.parametrize('speed', [0.0, 2000.0])
def test_a_look_within_a_given_step_leaves_no_failure_to_the_next_step(speed):
    # Shells may touch, so where the run is looked at within a step a trial step leads there; the
    # fast one flies farther in it than contacts are known for.
    scene = make_scene((2, 2, 2), {
        'solver.method': 'dop8', 'solver.step': 1e-4, 'contact.mode': 'auto',
        'contact.stiffness': 1e4,
        'bodies.away.position': [0.5, 0.0, 0.0],
        'bodies.away.linear_velocity': [speed, 0.0, 0.0]}, **RANDOM)
    failing = []

    def force(time, position, orientation, linear_velocity, angular_velocity):
        if failing:
            raise ValueError('only now')
        return np.zeros_like(position), np.zeros_like(position)

    ends = []
    for looked in (False, True):
        simulation = ico.compile_scene(
            scene, body_force=ico.BodyForce(force, compiled=False))
        simulation.advance_to(3.2e-4)
        if looked:
            failing.append(True)
            simulation.advance_to(3.7e-4)
            failing.clear()
        simulation.advance_to(1e-3)
        ends.append(simulation.snapshot())
    assert same_state(*ends)


@pytest.mark.parametrize('step', [0.0, 1e-4])
@pytest.mark.parametrize('force, compiled, words', [
    (fails_late, True, ['fails_late', 'ValueError: out of order', 'body 0']),
    (not_a_number, False, ['not_a_number', 'not finite']),
    (fails_in_python, False, ['fails_in_python', 'KeyError', 'nothing here']),
])
def test_errors_end_the_run_and_name_the_function(force, compiled, words, step):
    scene = make_scene((2, 2, 2), {
        'solver.method': 'dop8', 'contact.mode': 'never', 'solver.step': step}, **RANDOM)
    simulation = ico.compile_scene(
        scene, body_force=ico.BodyForce(force, compiled=compiled))
    with pytest.raises(ico.SimulationError) as caught:
        simulation.advance_to(0.1)
    for word in ['body_force', 't = 0.0', 'kept', *words]:
        assert word in str(caught.value)
    s = simulation.snapshot()
    assert np.isfinite(s.position).all() and s.time <= 0.012
    # The failure stays until the run is reset.
    with pytest.raises(ico.SimulationError):
        simulation.advance_to(0.2)
    simulation.reset_time()
    simulation.advance_to(0.005)
    assert simulation.time == 0.005


@pytest.mark.parametrize('force, compiled, words', [
    (lambda time, x, q, v, w: x, False, ['two arrays']),
    (lambda time, x, q, v, w: (x[:, :2], x), False, ['(4, 3)', '(4, 2)']),
    (lambda time, x, q, v, w: (x[:2], w), True, ['(3,)', '(2,)']),
    (lambda time, x, q, v, w: ({}, v), True, ['cannot be compiled']),
    (lambda time, x, q, v, w: (np.ones(4), x), False, ['two arrays']),
    (lambda time, x, q, v, w: ((x + 1.0) / np.sqrt(((x + 1.0)**2).sum()), w), None,
     ['compiled=True']),
    (lambda time: 0.0, None, ['body_force']),
])
def test_functions_that_make_no_sense_are_refused_at_once(force, compiled, words):
    scene = make_scene((2, 2, 2))
    with pytest.raises(ValueError) as caught:
        ico.compile_scene(scene, body_force=ico.BodyForce(force, compiled=compiled))
    for word in ['body_force', *words]:
        assert word in str(caught.value)


def test_what_else_is_refused():
    scene = make_scene((2, 2, 2))
    with pytest.raises(TypeError, match='function'):
        ico.compile_scene(scene, body_force=3.0)
    # Energies of all bodies, or their sum; anything else would be found at the first snapshot.
    for energies in ('x', np.zeros((4, 3)), np.nan, None):
        with pytest.raises(ValueError, match='body_force spring failed at t = 0 s: its potential'):
            ico.compile_scene(scene, body_force=ico.BodyForce(
                spring, potential=lambda *state, given=energies: given, compiled=False))
    with pytest.raises(ValueError, match='quaternion'):
        ico.compile_scene(scene, body_force=spring, rotation='direction_cosines')
    with pytest.raises(ValueError, match='body force'):
        ico.compile_scene(
            make_scene((2, 2, 2), {'solver.method': 'leapfrog'}), body_force=spring)
