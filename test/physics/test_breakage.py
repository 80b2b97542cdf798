# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors that break (eq 3): when, what is lost, and what comes of it."""

import analytical
from fabrics import BOTH_FORMS, changed, make_scene, pair_face_to_face, same_state
import icofabric_sim as ico
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.stepping.event_location import first_crossing, first_limit, Moment
import numpy as np
import pytest

L = make_scene((2, 2, 1)).geometry.connector_length
DOP8 = {'solver.method': 'dop8', 'contact.mode': 'never'}


def cascade(changes=None, size=(5, 5, 4)):
    """Fabric torn apart along x, in slight random motion."""
    return make_scene(
        size, {**DOP8, 'connector.break_length_extension': 1.02 * L, **(changes or {})},
        groups={'foot': 'x_min', 'head': 'x_max'},
        initial={
            'foot': {'group': 'foot', 'linear_velocity': [-2.0, 0.0, 0.0]},
            'head': {'group': 'head', 'linear_velocity': [2.0, 0.0, 0.0]}},
        initial_random={'velocity_sigma': 0.3, 'seed': 3})


def swinging_pair(changes, amplitude, form='quaternion'):
    """
    Two bodies whose connector lies on their line of centres, longer by `amplitude` of D.

    Returns the simulation and the frequency of their vibration [rad/s].
    """
    scene = make_scene((2, 2, 1), {**DOP8, **changes})
    simulation = ico.compile_scene(scene, rotation=form)
    position, orientation = pair_face_to_face(
        scene, scene.geometry.cube_width + L * (1.0 + amplitude))
    simulation.set_state(position=position, orientation=orientation)
    return simulation, analytical.axial_frequency(500.0, scene.shell.mass)


@pytest.mark.parametrize('form', BOTH_FORMS)
@pytest.mark.parametrize('side, amplitude', [('extension', -0.1), ('compression', 0.1)])
def test_a_connector_breaks_when_it_is_as_long_as_its_limit(form, side, amplitude):
    limit = L * (1.0 - 0.5 * amplitude)
    simulation, frequency = swinging_pair(
        {f'connector.break_length_{side}': limit, 'solver.tolerance': 1e-9}, amplitude, form)
    # l = D (1 + A cos(wt)), eq 1 for two masses.
    exact = np.arccos(-0.5) / frequency
    simulation.advance_to(exact * (1.0 - 1e-6))
    assert simulation.snapshot().intact.all()
    simulation.advance_to(exact * (1.0 + 1e-6))
    s = simulation.snapshot()
    assert not s.intact.any() and s.break_time == pytest.approx([exact], rel=1e-10)
    assert s.connector_length == pytest.approx([limit], rel=1e-5)
    lost = 0.5 * 500.0 * (limit - L) ** 2
    assert s.energy['lost_at_breaks'] == pytest.approx(lost, rel=1e-9)
    assert s.energy['connectors'] == 0.0
    assert abs(s.energy['balance_error']) < 1e-10 * lost
    # Nothing pulls any more: free flight, for good, also where it would break the other way.
    simulation.advance_to(10.0 * exact)
    end = simulation.snapshot()
    np.testing.assert_allclose(
        end.position, s.position + (end.time - s.time) * s.linear_velocity, rtol=0,
        atol=1e-12 * L)
    assert np.array_equal(end.break_time, s.break_time)


def test_the_moment_converges_at_the_order_of_the_method():
    errors = []
    parts = np.array([1.0, 0.75, 0.5, 0.375])
    frequency = analytical.axial_frequency(500.0, make_scene((2, 2, 1)).shell.mass)
    for part in parts:
        simulation, _ = swinging_pair({
            'connector.break_length_extension': 1.05 * L, 'solver.step': part / frequency}, -0.1)
        exact = np.arccos(-0.5) / frequency
        simulation.advance_to(1.5 * exact)
        errors.append(abs(simulation.snapshot().break_time[0] / exact - 1.0))
    slopes = np.diff(np.log(errors)) / np.diff(np.log(parts))
    print(errors, slopes)
    assert np.mean(slopes) > 7.5 and errors[0] > 1e-11


def test_hundreds_break_in_a_cascade_each_at_its_moment():
    scene = cascade(size=(7, 7, 6))
    frequency = ico.compile_scene(scene).status.largest_frequency
    duration, runs = 0.01, {}
    parts = (1.6, 1.1, 0.8, 0.1)
    for part in parts:
        simulation = ico.compile_scene(changed(scene, {'solver.step': part / frequency}))
        simulation.advance_to(duration)
        runs[part] = simulation.snapshot()
    exact = runs[0.1]
    gone = ~exact.intact
    assert gone.sum() > 200
    errors = []
    for part in parts[:-1]:
        s = runs[part]
        assert np.array_equal(s.intact, exact.intact)
        error = np.abs(s.break_time - exact.break_time)[gone] * frequency
        errors.append([error.max(), np.median(error)])
        assert abs(s.energy['balance_error']) < 1e-9 * s.energy['lost_at_breaks']
    slopes = np.diff(np.log(errors), axis=0) / np.diff(np.log(parts[:-1]))[:, None]
    print(gone.sum(), errors, slopes)
    # Most steps end at a break and are shorter than asked, so there is less left to gain.
    assert np.mean(slopes[:, 0]) > 5.0 and errors[-1][0] < 1e-6
    # One after the other, in no step's rhythm.
    times = np.sort(exact.break_time[gone])
    assert len(np.unique(times)) > 0.9 * len(times)


@pytest.mark.parametrize('tolerance', [1e-5, 1e-8])
def test_the_energy_balances_while_a_fabric_breaks(tolerance):
    simulation = ico.compile_scene(cascade({
        'solver.tolerance': tolerance, 'connector.break_length_compression': 0.98 * L,
        'gravity': [0.0, 0.0, -9.81]}))
    simulation.advance_to(0.02)
    s = simulation.snapshot()
    assert (~s.intact).sum() > 40
    lost = s.energy['lost_at_breaks']
    assert lost > 0.02 * s.energy['kinetic']
    assert abs(s.energy['balance_error']) < tolerance * lost
    assert simulation.balance.worst < tolerance
    momentum = s.linear_velocity.sum(axis=0) - simulation.scene.initial.linear_velocity.sum(axis=0)
    fall = len(s.position) * np.array([0.0, 0.0, -9.81]) * s.time
    assert np.abs(momentum - fall).max() < 1e-10 * np.abs(s.linear_velocity).sum()


def test_pieces_threads_and_checkpoints_give_the_same_bits(monkeypatch):
    from icofabric_sim.simulation.stepping import thread_team
    scene, duration = cascade(), 0.01
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1)
    ends = []
    for threads, pieces in ((1, 1), (2, 1), (3, 37)):
        monkeypatch.setattr(thread_team, 'core_count', lambda threads=threads: threads)
        simulation = ico.compile_scene(scene)
        for piece in range(pieces):
            simulation.advance_to(duration * (piece + 1) / pieces)
            simulation.snapshot()
            # Outputs know no break that is still to come.
            assert not np.nanmax(np.append(simulation.snapshot().break_time, 0.0)) > (
                simulation.time)
        ends.append(simulation.snapshot())
    monkeypatch.setattr(thread_team, 'core_count', lambda: 1)
    for part in (0.11, 0.52):
        simulation = ico.compile_scene(scene)
        simulation.advance_to(part * duration)
        kept = simulation.checkpoint()
        assert 0 < (~simulation.snapshot().intact).sum() < (~ends[0].intact).sum()
        other = ico.compile_scene(scene)
        other.advance_to(duration)  # has broken more already
        other.restore(type(kept).from_bytes(kept.to_bytes()))
        assert np.array_equal(
            other.snapshot().break_time, simulation.snapshot().break_time, equal_nan=True)
        other.advance_to(duration)
        ends.append(other.snapshot())
    for end in ends[1:]:
        assert same_state(ends[0], end)
        assert np.array_equal(ends[0].break_time, end.break_time, equal_nan=True)
        assert ends[0].energy == end.energy


def test_a_checkpoint_holds_what_is_about_to_break():
    # At every stage of a step that ends at a break.
    scene = cascade()
    simulation = ico.compile_scene(scene)
    for time in np.linspace(0.0, 0.004, 60):
        simulation.advance_to(time)
        other = ico.compile_scene(scene)
        other.restore(simulation.checkpoint())
        other.advance_to(0.005)
        if time == 0.0:
            first = other.snapshot()
        assert same_state(first, other.snapshot())
    assert (~first.intact).sum() > 10


def test_what_is_alike_breaks_at_once():
    # A ring of four bodies pulled outwards alike, so that its sides differ by rounding alone.
    scene = make_scene((3, 3, 1), {
        **DOP8, 'weave.variant': 1, 'connector.break_length_extension': 1.1 * L})
    outwards = scene.position - scene.position.mean(axis=0)
    simulation = ico.compile_scene(scene)
    simulation.set_state(linear_velocity=200.0 * outwards)
    simulation.advance_to(0.01)
    s = simulation.snapshot()
    gone = s.break_time[~s.intact]
    assert len(gone) == scene.connector_count > 2 and len(np.unique(gone)) == 1


def test_size_does_not_matter():
    runs = []
    for scale in (1e-3 / 0.01, 1.0, 100.0):
        # a, D, L_e ~ s; m ~ s^3 and k ~ s give a frequency ~ 1/s.
        simulation = ico.compile_scene(cascade({
            'shell.edge_length': 0.02 * scale, 'shell.thickness': 0.002 * scale,
            'connector.stiffness': 500.0 * scale, 'solver.step': 5e-4 * scale,
            'connector.break_length_extension': 1.02 * L * scale}, size=(4, 3, 3)))
        simulation.advance_to(0.01 * scale)
        runs.append(simulation.snapshot().break_time / scale)
    assert np.isfinite(runs[0]).sum() > 10
    for run in runs[1:]:
        np.testing.assert_allclose(run, runs[0], rtol=1e-10)


def test_reset_mends_and_a_given_state_does_not():
    simulation = ico.compile_scene(cascade(size=(4, 3, 3)))
    simulation.advance_to(0.005)
    first = simulation.snapshot()
    assert not first.intact.all()
    simulation.set_state(linear_velocity=np.zeros_like(first.linear_velocity))
    assert np.array_equal(simulation.snapshot().intact, first.intact)
    energy = simulation.snapshot().energy
    assert abs(energy['balance_error']) < 1e-14 * energy['connectors']
    simulation.reset_time()
    assert simulation.snapshot().intact.all()
    assert np.isnan(simulation.snapshot().break_time).all()
    simulation.advance_to(0.005)
    again = simulation.snapshot()
    assert same_state(first, again)
    assert np.array_equal(first.break_time, again.break_time, equal_nan=True)


@pytest.mark.parametrize('change', [
    {'connector.stiffness': 600.0}, {'connector.break_length_extension': 0.0},
    {'connector.break_length_extension': 0.0, 'solver.method': 'leapfrog'}])
def test_a_change_that_keeps_the_motion_keeps_what_is_broken(change):
    scene = cascade(size=(4, 3, 3))
    old = ico.compile_scene(scene)
    old.advance_to(0.005)
    new = ico.compile_scene(changed(scene, change))
    new.continue_from(old, keep_motion=True)
    before = old.snapshot()
    assert not before.intact.all()
    assert np.array_equal(new.snapshot().break_time, before.break_time, equal_nan=True)
    new.advance_to(0.02)
    s, gone = new.snapshot(), ~before.intact
    assert np.array_equal(s.break_time[gone], before.break_time[gone])
    assert abs(s.energy['balance_error']) < 1e-4 * s.energy['kinetic']
    # Checkpoints of either kind of run know it.
    kept = new.checkpoint()
    new.reset()
    assert new.snapshot().intact.all()
    new.restore(kept)
    assert np.array_equal(new.snapshot().break_time, s.break_time, equal_nan=True)
    fresh = ico.compile_scene(changed(scene, change))
    fresh.continue_from(old, keep_motion=False)
    assert fresh.snapshot().intact.all()


def test_groups_break_by_limits_of_their_own():
    scene = cascade({
        'groups.low': 'z_min', 'connector_groups.tough.between': 'low low',
        'connector_groups.tough.break_length_extension': 0.0,
        'connector_groups.weak.between': 'foot all',
        'connector_groups.weak.break_length_extension': 1.005 * L})
    limits, bodies = scene.connectors.limits, scene.connectors.bodies
    weak = np.isin(bodies, scene.groups['foot']).any(axis=1)
    tough = np.isin(bodies, scene.groups['low']).all(axis=1) & ~weak
    assert (limits.longest[weak] == 1.005 * L).all() and (limits.longest[tough] == np.inf).all()
    assert (limits.longest[~weak & ~tough] == 1.02 * L).all() and not limits.shortest.any()
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.01)
    s = simulation.snapshot()
    assert s.intact[tough].all() and (~s.intact[weak]).any()
    assert (s.connector_length[tough] > 1.02 * L).any()


@pytest.mark.parametrize('side, amplitude', [('extension', -0.1), ('compression', 0.1)])
def test_a_length_that_turns_round_within_a_step_breaks_where_it_was_beyond(side, amplitude):
    # A step of 1.9 rad around the longest or shortest moment, at which the limit is just passed.
    limit = L * (1.0 - amplitude * (1.0 - 1e-3))
    frequency = analytical.axial_frequency(500.0, make_scene((2, 2, 1)).shell.mass)
    step = 0.6 * np.pi / frequency
    simulation, _ = swinging_pair(
        {f'connector.break_length_{side}': limit, 'solver.step': step}, amplitude)
    exact = np.arccos((limit / L - 1.0) / amplitude) / frequency
    simulation.advance_to(1.4 * np.pi / frequency)
    assert simulation.snapshot().break_time == pytest.approx([exact], rel=1e-3)


def test_what_is_too_long_from_the_start_breaks_when_the_motion_begins():
    simulation, frequency = swinging_pair({'connector.break_length_extension': 1.05 * L}, 0.1)
    simulation.advance_to(0.0)
    assert simulation.snapshot().intact.all()
    simulation.advance_to(0.1 / frequency)
    assert np.array_equal(simulation.snapshot().break_time, [0.0])


@pytest.mark.parametrize('changes, words', [
    ({'connector.break_length_extension': L}, ['connector.break_length_extension', 'natural']),
    ({'connector.break_length_extension': 0.95 * L, 'connector.natural_length': 0.9 * L},
     ['connector.break_length_extension', 'woven length', 'at once']),
    ({'connector.break_length_extension': 1.1 * L, 'connector.natural_length': 1.2 * L},
     ['break_length_extension', 'natural length']),
    ({'connector.break_length_compression': 1.1 * L}, ['break_length_compression', 'below', '0']),
    ({'connector.break_length_compression': 0.9 * L, 'connector.natural_length': 0.8 * L},
     ['break_length_compression', 'natural length']),
    ({'groups.low': 'z_min', 'connector_groups.g.between': 'low low',
      'connector_groups.g.break_length_extension': 0.5 * L},
     ['connector_groups.g.break_length_extension', 'natural length']),
    ({'connector.break_length_extension': -1.0}, ['at least 0']),
])
def test_limits_that_make_no_sense_are_refused(changes, words):
    with pytest.raises(ParameterError) as caught:
        make_scene((3, 3, 3), changes)
    for word in words:
        assert word in str(caught.value)


def test_a_method_without_events_is_refused():
    scene = make_scene((3, 3, 3), {
        'connector.break_length_extension': 1.1 * L, 'solver.method': 'leapfrog'})
    with pytest.raises(ParameterError, match='solver.method leapfrog.*break.*dop8'):
        ico.compile_scene(scene)
    simulation = ico.compile_scene(changed(scene, {'solver.method': 'auto'}))
    assert simulation.status.method_name == 'dop8' and 'break' in simulation.status.method_reason


@pytest.mark.parametrize('top', [0.3, 0.999999, 1e-9])
def test_first_crossing_finds_humps(top):
    # A vibration below its limit at two moments, above it by `top` of its height in between.
    width, limit = 1.8, np.cos(0.9) + (1.0 - np.cos(0.9)) * (1.0 - top)

    def look(x):
        angle = width * (x - 0.5)
        value, slope = np.cos(angle) - limit, -width * np.sin(angle)
        return Moment(x, np.array([value, -1.0]), np.array([slope, 0.0]))

    moment = first_crossing(look, np.array([1e-12, 1e-12]))
    assert moment.x == pytest.approx(0.5 - np.arccos(limit) / width, abs=1e-9 + 1e-6 * (
        top < 1e-6))
    assert moment.reached(np.array([1e-12, 1e-12])).tolist() == [True, False]


def test_what_turns_round_below_no_limit_does_not_break():
    # pytest takes a warning for a failure: infinite numbers are not to be computed with.
    def lengths_at(x):
        return np.array([0.5 + x * (1.0 - x), 0.5]), np.array([1.0 - 2.0 * x, 0.0])

    none, shortest = np.full(2, np.inf), np.array([0.1, 0.4])
    assert first_limit(lengths_at, none, shortest, 1.0) is None
    part, reached = first_limit(lengths_at, np.array([0.6, np.inf]), shortest, 1.0)
    assert part == pytest.approx(0.5 - np.sqrt(0.15), abs=1e-9)
    assert reached.tolist() == [True, False]
