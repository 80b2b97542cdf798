# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Loads in time: impulses, orders, energy, and what a run does not depend on."""

import math

from fabrics import changed, make_scene, RANDOM, same_state
import icofabric_sim as ico
from icofabric_sim.scene.profiles import make_profile
from icofabric_sim.simulation.inputs.timetable import Timetable
import numpy as np
import pytest

FORCE = np.array([0.3, -1.1, 2.0])
TABLE = 'time, factor\n# a push and a pull\n0.0, 0.0\n0.03, 2.0\n0.05, -1.0\n0.11, 0.25\n'


def one_body(changes):
    return make_scene((1, 1, 1), {
        'groups.tip': 'all', 'loads.tip.group': 'tip', 'loads.tip.force': FORCE.tolist(),
        'contact.mode': 'never', 'solver.method': 'srkn4', **changes})


def profile(kind, start, duration):
    return {'loads.tip.profile': kind, 'loads.tip.start': start, 'loads.tip.duration': duration}


def impulse(scene, time=1.0):
    simulation = ico.compile_scene(scene)
    simulation.advance_to(time)
    return simulation.snapshot().linear_velocity[0] * scene.shell.mass / FORCE


@pytest.fixture
def table(tmp_path):
    path = tmp_path / 'push.csv'
    path.write_text(TABLE)
    return f'table {path}'


@pytest.mark.parametrize('step', [0.0, 1e-3, 0.0137, 0.75])
@pytest.mark.parametrize('start', [0.0, 0.123])
def test_push_for_two_seconds_gives_twice_the_force_whatever_the_step(step, start):
    scene = one_body({**profile('steady', start, 2.0), 'solver.step': step})
    assert impulse(scene, 3.0) == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize('step', [0.0, 0.0137])
def test_straight_pieces_give_exact_impulses(step, table):
    scene = one_body({**profile('ramp', 0.1, 0.7), 'solver.step': step})
    assert impulse(scene) == pytest.approx(0.35 + 0.2, rel=1e-12)
    area = 0.5 * (2.0 * 0.03 + 1.0 * 0.02 - 0.75 * 0.06)
    held = 0.25 * (1.0 - 0.2 - 0.11)
    scene = one_body({**profile(table, 0.2, 0.0), 'solver.step': step})
    assert impulse(scene) == pytest.approx(area + held, rel=1e-12)


def test_table_is_straight_between_its_times(table):
    curve = make_profile(one_body(profile(table, 0.2, 0.0)).parameters, 'loads.tip')
    times = np.linspace(0.2, 0.4, 300)
    expected = np.interp(times - 0.2, [0.0, 0.03, 0.05, 0.11], [0.0, 2.0, -1.0, 0.25])
    assert [curve.at(time) for time in times] == pytest.approx(expected, abs=1e-13)
    assert curve.at(0.19) == 0.0


@pytest.mark.parametrize('duration', [1e-4, 0.02, 0.5])
def test_half_sine_gives_two_over_pi(duration):
    scene = one_body(profile('half_sine', 0.1, duration))
    expected = 2.0 * duration / math.pi
    # No more than the tolerance adds in the end: 1e-6 a or 1e-6 of the way in a second.
    assert impulse(scene) == pytest.approx(expected, rel=1e-6)
    adaptive = changed(scene, {'solver.method': 'dop8'})
    assert impulse(adaptive) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize('method', [*ico.METHODS, 'auto'])
@pytest.mark.parametrize('ratio', [1.0, 2.0, 1.37, 40.0])
def test_pulse_acts_whole_however_long_the_given_steps(method, ratio):
    duration = 0.005
    scene = one_body({
        **profile('half_sine', 0.1, duration), 'solver.step': ratio * duration,
        'solver.method': method})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.5)
    velocity = simulation.snapshot().linear_velocity[0]
    assert velocity == pytest.approx(
        2.0 * duration / math.pi * FORCE / scene.shell.mass, rel=1e-5)
    expected = velocity * (0.5 - 0.1 - 0.5 * duration)
    error = np.abs(simulation.snapshot().position[0] - scene.position[0] - expected).max()
    # What is left of it is in the estimate, which says nothing of how errors grow.
    assert 0.0 < error / scene.shell.half_edge < 10.0 * simulation.status.error_estimate + 1e-12
    assert simulation.status.error_estimate < 1e-2
    pieces = ico.compile_scene(scene)
    for time in (0.1002, 0.1013, 0.104, 0.1049, 0.3):
        pieces.advance_to(time)
        pieces.snapshot()
        pieces.restore(pieces.checkpoint())
    pieces.advance_to(0.5)
    assert same_state(simulation.snapshot(), pieces.snapshot())


@pytest.mark.parametrize('changes, pushed', [
    ({'groups.b': 'all', 'tractions.b.group': 'b', 'tractions.b.faces': 'numbers 1',
      'tractions.b.pressure': 1e4, 'tractions.b.profile': 'half_sine',
      'tractions.b.start': 0.1, 'tractions.b.duration': 0.005}, 0),
    ({'charge.per_body': 1e-6, 'field.electric': [1e6, 0.0, 0.0], 'field.profile': 'half_sine',
      'field.start': 0.1, 'field.duration': 0.005}, 0)])
def test_pulses_of_tractions_and_fields_act_whole(changes, pushed):
    def velocity(step):
        simulation = ico.compile_scene(make_scene((1, 1, 1), {
            'contact.mode': 'never', 'solver.method': 'leapfrog', **changes, 'solver.step': step}))
        simulation.advance_to(0.2)
        return np.linalg.norm(simulation.snapshot().linear_velocity[pushed])

    assert velocity(0.01) == pytest.approx(velocity(5e-6), rel=1e-4) != 0.0


def test_pulse_of_enough_given_steps_is_passed_by_them():
    scene = one_body({**profile('half_sine', 0.1, 0.008), 'solver.step': 1e-3,
                      'solver.method': 'leapfrog'})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.2)
    assert simulation.status.step_count == pytest.approx(200, abs=2)


@pytest.mark.parametrize('changes, words', [
    (profile('sine 100', 0.1, 0.0), 'the sine of loads.tip, whose period is 0.01 s'),
    (profile('sine 100', 0.1, 1.0), 'at most 0.00318 s'),
    ({'loads.tip.force': [0.0, 0.0, 0.0], 'drives.d.group': 'tip', 'drives.d.motion': 'sine',
      'drives.d.frequency': 100.0, 'drives.d.linear': [1e-3, 0.0, 0.0]}, 'sine of drives.d')])
def test_sine_that_given_steps_cannot_follow_is_refused(changes, words):
    scene = one_body({**changes, 'solver.method': 'leapfrog', 'solver.step': 0.01})
    with pytest.raises(ValueError, match='solver.step 0.01 s is too long') as caught:
        ico.compile_scene(scene)
    assert words in str(caught.value)
    # At 0.19 s, when the energy is checked first, what this load moves is at rest.
    ico.compile_scene(changed(scene, {'solver.step': 0.003})).advance_to(0.2)


def test_rounding_of_a_load_is_no_error_of_the_energy(monkeypatch):
    # Steps end where the pulse is 0 but for rounding: all that moves is rounded.
    monkeypatch.setattr(Timetable, 'follow', lambda *_: None)
    simulation = ico.compile_scene(one_body({
        **profile('half_sine', 0.1, 0.005), 'solver.method': 'leapfrog', 'solver.step': 0.005}))
    simulation.advance_to(1.0)
    assert 0.0 < np.abs(simulation.snapshot().linear_velocity).max() < 1e-14
    assert simulation.balance.scale > 0.0


def driven_fabric(table, **changes):
    """Fabric in motion under every kind of profile, in both frames, off centre."""
    return make_scene((2, 2, 2), {
        'groups.tip': 'ids 0 3', 'groups.side': 'ids 1', 'contact.mode': 'never',
        'loads.pulse.group': 'tip', 'loads.pulse.profile': 'half_sine',
        'loads.pulse.start': 0.001, 'loads.pulse.duration': 0.006,
        'loads.pulse.frame': 'body', 'loads.pulse.point': [0.004, -0.007, 0.011],
        'loads.pulse.force': [5.0, -2.0, 3.0], 'loads.pulse.torque': [0.01, 0.02, -0.01],
        'loads.rise.group': 'side', 'loads.rise.profile': 'ramp', 'loads.rise.duration': 0.004,
        'loads.rise.force': [-6.0, 1.0, 2.0], 'loads.rise.point': [0.0, 0.016, -0.003],
        'loads.read.group': 'side', 'loads.read.profile': table, 'loads.read.start': 0.002,
        'loads.read.torque': [0.01, -0.02, 0.03], **changes}, **RANDOM)


@pytest.fixture
def short_table(tmp_path):
    path = tmp_path / 'short.csv'
    path.write_text('0, 1\n0.0013, -1\n0.003, 0.5\n')
    return f'table {path}'


def test_order_holds_across_the_edges_of_profiles(short_table):
    end = 0.009
    scene = driven_fabric(short_table, **{
        'solver.method': 'dop8', 'solver.tolerance': 1e-10})
    reference = ico.compile_scene(scene)
    reference.advance_to(end)
    exact = reference.snapshot()
    assert abs(exact.energy['work_in']) > 0.1 * exact.energy['kinetic'] > 0.0
    assert reference.balance.worst < 1e-12
    errors, balances = [], []
    steps = np.array([4e-5, 2e-5])
    for step in steps:
        simulation = ico.compile_scene(changed(scene, {
            'solver.method': 'srkn4', 'solver.step': float(step), 'solver.tolerance': 1e-6}))
        simulation.advance_to(end)
        snapshot = simulation.snapshot()
        errors.append(np.abs(snapshot.position - exact.position).max() / scene.shell.half_edge)
        balances.append(abs(snapshot.energy['balance_error']) / snapshot.energy['kinetic'])
        work = snapshot.energy['work_in'] / exact.energy['work_in'] - 1.0
        assert abs(work) < 1e-5
    # Fourth order; where an edge fell into a step it would be the first.
    assert 12.0 < errors[0] / errors[1] < 22.0
    assert errors[0] < 1e-5 and balances[0] < 1e-5 and balances[1] < balances[0] / 8.0


@pytest.mark.parametrize('method', ['srkn4', 'dop8'])
def test_bits_do_not_depend_on_pieces_threads_or_a_restart(method, short_table):
    scene = driven_fabric(short_table, **{'solver.method': method, 'solver.threads': 1})
    whole, pieces = ico.compile_scene(scene), ico.compile_scene(scene)
    whole.advance_to(0.01)
    for time in np.linspace(0.0, 0.01, 38)[1:]:
        pieces.advance_to(float(time))
        pieces.snapshot()
    assert same_state(whole.snapshot(), pieces.snapshot())
    assert whole.snapshot().energy == pieces.snapshot().energy
    shared = ico.compile_scene(changed(scene, {'solver.threads': 2}))
    shared.advance_to(0.01)
    assert same_state(whole.snapshot(), shared.snapshot())
    # In the middle of the pulse, and on the very edge of a piece.
    for time in (0.0035, 0.002 + 0.0013):
        first, second = ico.compile_scene(scene), ico.compile_scene(scene)
        first.advance_to(time)
        second.restore(first.checkpoint())
        second.advance_to(0.01)
        assert same_state(whole.snapshot(), second.snapshot())
        assert second.snapshot().energy == whole.snapshot().energy


def test_received_wrench_replaces_a_profile_for_good():
    scene = one_body({**profile('half_sine', 0.1, 0.4), 'solver.step': 0.01})
    simulation = ico.compile_scene(scene)
    assert not simulation.status.active_loads
    simulation.advance_to(0.05)
    simulation.apply_wrench('tip', 2.0 * FORCE)
    simulation.apply_wrench('tip', time=0.3)
    simulation.advance_to(1.0)
    got = simulation.snapshot().linear_velocity[0] * scene.shell.mass / FORCE
    assert got == pytest.approx(2.0 * 0.25, rel=1e-12)
    assert not simulation.status.active_loads
    # After a reset the profile is counted from then.
    simulation.reset()
    simulation.advance_to(2.0)
    got = simulation.snapshot().linear_velocity[0] * scene.shell.mass / FORCE
    assert got == pytest.approx(0.8 / math.pi, rel=1e-4)


def test_profile_goes_on_where_a_change_keeps_the_motion():
    scene = one_body({**profile('ramp', 0.1, 0.5), 'solver.step': 0.01})
    before = ico.compile_scene(scene)
    before.advance_to(0.25)
    after = ico.compile_scene(changed(scene, {'solver.tolerance': 1e-7}))
    after.continue_from(before, keep_motion=True)
    after.advance_to(1.0)
    got = after.snapshot().linear_velocity[0] * scene.shell.mass / FORCE
    assert got == pytest.approx(0.25 + 0.4, rel=1e-12)
    # Other bodies begin at rest, and so does what acts on them.
    anew = ico.compile_scene(scene)
    anew.continue_from(before, keep_motion=False)
    anew.advance_to(1.25)
    got = anew.snapshot().linear_velocity[0] * scene.shell.mass / FORCE
    assert got == pytest.approx(0.25 + 0.4, rel=1e-12)


@pytest.mark.parametrize('changes, name, words', [
    ({'loads.tip.profile': 'sine'}, 'loads.tip.profile',
     'steady, ramp, half_sine, sine FREQUENCY or table FILE'),
    ({'loads.tip.profile': 'table'}, 'loads.tip.profile', 'table FILE'),
    ({'loads.tip.profile': 'ramp up', 'loads.tip.duration': 1.0}, 'loads.tip.profile', 'ramp up'),
    ({'loads.tip.profile': 'ramp'}, 'loads.tip.duration', 'above 0 s'),
    ({'loads.tip.profile': 'table no_such.csv'}, 'loads.tip.profile', 'no_such.csv'),
    ({'loads.tip.profile': 'table x.csv', 'loads.tip.duration': 1.0}, 'loads.tip.duration', '0 s'),
    ({'loads.tip.start': -1.0}, 'loads.tip.start', 'at least 0'),
])
def test_bad_profiles_are_refused_by_name(changes, name, words):
    with pytest.raises(ico.ParameterError, match=name) as caught:
        one_body(changes)
    assert words in str(caught.value)


@pytest.mark.parametrize('text, words', [
    ('0, 1\n1, 2\n1, 3\n', 'must increase'), ('0, 1\n2, 2\n1, 3\n', 'line 3'),
    ('-1, 1\n1, 2\n', 'from 0 s'), ('0, 1\n', 'at least two lines'), ('0, 1\n1\n', 'line 2'),
    ('0, 1\n1, nan\n', 'finite'), ('0, 1\n1, word\n', 'line 2'), ('0 1\n1 2\n', 'two columns')])
def test_bad_tables_are_refused_with_file_and_line(text, words, tmp_path):
    path = tmp_path / 'bad.csv'
    path.write_text(text)
    with pytest.raises(ico.ParameterError, match=r'loads\.tip\.profile') as caught:
        one_body({'loads.tip.profile': f'table {path}'})
    assert words in str(caught.value) and 'bad.csv' in str(caught.value)


@pytest.mark.parametrize(('content', 'words'), [
    (TABLE.encode('utf-16'), 'UTF-16'), (TABLE.encode('utf-16-le'), 'UTF-16'),
    (TABLE.replace('push', 'pu\u00dfh').encode('latin-1'), 'byte 0xdf in line 2')])
def test_a_table_in_another_encoding_is_refused_by_its_name(content, words, tmp_path):
    path = tmp_path / 'push.csv'
    path.write_bytes(content)
    with pytest.raises(ValueError) as caught:
        one_body({'loads.tip.profile': f'table {path}'})
    assert words in str(caught.value) and 'save it as UTF-8' in str(caught.value)
    assert 'codec' not in str(caught.value) and 'push.csv' in str(caught.value)
