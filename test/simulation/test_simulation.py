# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0

import math

from analytical import free_rotation, quaternion_product, rotation_quaternion
from fabrics import changed, FORMS, LOADED, make_scene, RANDOM, same_state, STATE, SUPPORTED
import icofabric_sim as ico
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

START = make_scene((2, 2, 2), {'solver.step': 2e-4}, **RANDOM)


@pytest.mark.parametrize('form', FORMS)
def test_first_snapshot_is_the_initial_state(form):
    simulation = ico.compile_scene(START, rotation=form)
    s = simulation.snapshot()
    assert s.time == 0.0 == simulation.time
    for name in STATE:
        np.testing.assert_allclose(
            getattr(s, name), getattr(START.initial, name), rtol=0, atol=1e-15
        )
    assert np.abs(s.linear_velocity).min() > 0.0


def test_snapshots_are_copies_that_nobody_can_change():
    simulation = ico.compile_scene(START)
    first = simulation.snapshot()
    kept = first.position.copy()
    simulation.advance_to(0.01)
    second = simulation.snapshot()
    assert np.array_equal(first.position, kept)
    assert not np.array_equal(second.position, kept)
    for name in STATE:
        with pytest.raises(ValueError, match='read-only'):
            getattr(second, name)[0] = 0.0
    assert second.intact.all() and second.intact.shape == (START.connector_count,)
    assert np.isnan(second.break_time).all()
    assert second.energy['total'] == pytest.approx(
        sum(second.energy[name] for name in ('kinetic', 'connectors', 'gravity'))
    )


def test_energy_of_a_snapshot():
    scene = make_scene(
        (2, 2, 1),
        {
            'gravity': [0.0, 0.0, -9.81],
            'connector.natural_length': 0.03,
            'initial.i.group': 'all',
            'initial.i.linear_velocity': [3.0, 0.0, 4.0],
            'initial.i.angular_velocity': [0.0, 5.0, 0.0],
            'initial.i.displacement': [0.0, 0.0, 0.7],
        },
    )
    energy = ico.compile_scene(scene).snapshot().energy
    mass, inertia = scene.shell.mass, scene.shell.inertia
    stretch = scene.geometry.connector_length - 0.03
    assert energy['kinetic'] == pytest.approx(
        2 * (0.5 * mass * 25.0 + 0.5 * inertia * 25.0), rel=1e-14
    )
    assert energy['connectors'] == pytest.approx(0.5 * 500.0 * stretch**2, rel=1e-12)
    assert energy['gravity'] == pytest.approx(2 * mass * 9.81 * 0.7, rel=1e-14)


def test_connector_ends_and_lengths_of_a_snapshot():
    simulation = ico.compile_scene(START)
    np.testing.assert_allclose(
        simulation.snapshot().connector_length, START.geometry.connector_length, rtol=1e-14
    )
    simulation.advance_to(0.01)
    s = simulation.snapshot()
    assert s.connector_ends.shape == (START.connector_count, 2, 3)
    assert np.abs(s.connector_length / START.geometry.connector_length - 1.0).max() > 0.01
    bare = ico.compile_scene(make_scene((2, 2, 2), {'weave.connected': False})).snapshot()
    assert bare.connector_ends.shape == (0, 2, 3) and bare.connector_length.shape == (0,)


@pytest.mark.parametrize('time', [-1.0, 0.009, math.nan, math.inf])
def test_advance_to_refuses_times_that_make_no_sense(time):
    simulation = ico.compile_scene(START)
    simulation.advance_to(0.01)
    before = simulation.snapshot()
    with pytest.raises(ValueError, match='cannot advance to .* from 0.01 s|time must be a finite'):
        simulation.advance_to(time)
    assert simulation.snapshot() is before
    simulation.advance_to(0.01)
    assert simulation.time == 0.01


@pytest.mark.parametrize('form', FORMS)
def test_steps_one_by_one_are_the_steps_of_advance_to(form):
    one, other = (ico.compile_scene(START, rotation=form) for _ in range(2))
    one.advance_steps(100)
    assert one.status.step_count == 100
    assert one.time == 100 * 2e-4
    other.advance_to(one.time)
    assert same_state(one.snapshot(), other.snapshot())
    for count in (0, -3):
        with pytest.raises(ValueError, match='count must be an integer of at least 1'):
            one.advance_steps(count)
    # From within a step the next step end comes first.
    one.advance_to(100.3 * 2e-4)
    one.advance_steps(1)
    assert one.time == 101 * 2e-4


@pytest.mark.parametrize('method', ['leapfrog', 'srkn4', 'dop8'])
def test_rounding_of_step_ends_costs_no_step(method):
    scene = make_scene((2, 2, 2), {
        'solver.method': method, 'solver.step': 1e-3, 'solver.energy_limit': 1e3}, **RANDOM)
    whole = ico.compile_scene(scene)
    whole.advance_to(0.7)
    assert whole.status.step_count == 700 and whole.time == 0.7
    # 3 steps of 0.1 s are above 0.3 s, too; inputs and checkpoints there change nothing.
    pieces = ico.compile_scene(scene)
    for time in (0.003, 0.1, 0.3, 0.6, 0.7):
        pieces.advance_to(time)
        pieces.restore(pieces.checkpoint())
    assert same_state(whole.snapshot(), pieces.snapshot())
    assert pieces.status.step_count == 700
    for simulation in (whole, pieces):
        simulation.apply_body_wrench(0, [1.0, 0.0, 0.0], time=0.7)
        simulation.advance_to(0.9)
    assert same_state(whole.snapshot(), pieces.snapshot())
    assert whole.status.step_count == 900


def test_steps_stop_at_inputs():
    scene = changed(START, {'groups.tip': 'ids 0', 'loads.tip.group': 'tip'})
    simulation = ico.compile_scene(scene)
    simulation.apply_wrench('tip', (1.0, 0.0, 0.0), time=5e-4)
    times = []
    for _ in range(5):
        simulation.advance_steps(1)
        times.append(simulation.time)
    assert times == pytest.approx([2e-4, 4e-4, 5e-4, 7e-4, 9e-4], rel=1e-12)


@pytest.mark.parametrize('form', FORMS)
def test_set_state_goes_on_from_a_snapshot(form):
    whole, first = (ico.compile_scene(START, rotation=form) for _ in range(2))
    whole.advance_to(0.02)
    first.advance_to(0.01)
    middle = first.snapshot()
    second = ico.compile_scene(START, rotation=form)
    second.set_state(**{name: getattr(middle, name) for name in STATE})
    second.advance_to(0.01)
    s, expected = second.snapshot(), whole.snapshot()
    for name in STATE:
        np.testing.assert_allclose(
            getattr(s, name),
            getattr(expected, name),
            rtol=0,
            atol=1e-11 * np.abs(getattr(expected, name)).max(),
        )
    assert not np.allclose(s.position, middle.position, rtol=0, atol=1e-4)


def test_set_state_replaces_only_what_is_given():
    simulation = ico.compile_scene(START)
    simulation.advance_to(0.003)
    before = simulation.snapshot()
    position = before.position + 0.001
    simulation.set_state(position=position)
    after = simulation.snapshot()
    assert after.time == before.time == 0.003
    assert np.array_equal(after.position, position)
    for name in STATE[1:]:
        assert np.array_equal(getattr(after, name), getattr(before, name))
    # The caller's array is not held on to.
    position[:] = 0.0
    assert np.array_equal(simulation.snapshot().position, before.position + 0.001)


@pytest.mark.parametrize(
    'changes, message',
    [
        ({'position': np.zeros((3, 3))}, r'position must be .* \(4, 3\), got .* \(3, 3\)'),
        (
            {'orientation': np.zeros((4, 3))},
            r'orientation must be .* \(4, 4\), got .* \(4, 3\)',
        ),
        ({'linear_velocity': np.full((4, 3), np.nan)}, 'linear_velocity of body 0 must be finite'),
        (
            {'angular_velocity': np.array([[0, 0, 0], [0, 0, 0], [0, np.inf, 0], [0, 0, 0]])},
            'angular_velocity of body 2 must be finite',
        ),
        (
            {'orientation': np.array([[0, 0, 0, 1]] * 3 + [[0, 0, 0.5, 0.5]])},
            'orientation of body 3 must be a unit quaternion',
        ),
        ({'orientation': np.zeros((4, 4))}, 'orientation of body 0 must be a unit quaternion'),
    ],
)
def test_set_state_refuses_what_is_no_state(changes, message):
    simulation = ico.compile_scene(START)
    simulation.advance_to(0.003)
    with pytest.raises(ValueError, match=message):
        simulation.set_state(**changes)
    untouched = ico.compile_scene(START)
    for each in (simulation, untouched):
        each.advance_to(0.01)
    assert same_state(simulation.snapshot(), untouched.snapshot())


def test_set_state_scales_nearly_unit_quaternions():
    simulation = ico.compile_scene(START)
    orientation = simulation.snapshot().orientation * 1.0005
    simulation.set_state(orientation=orientation)
    np.testing.assert_allclose(
        np.linalg.norm(simulation.snapshot().orientation, axis=1), 1.0, rtol=0, atol=1e-15
    )


@pytest.mark.parametrize('form', FORMS)
def test_quaternions_have_unit_length_however_loose_the_tolerance(form):
    # Most of these states come from dense output, whose quaternions are off by 1e-7.
    scene = changed(
        START, {'solver.method': 'dop8', 'solver.step': 0.0, 'solver.tolerance': 3.0})
    seen, unseen = (ico.compile_scene(scene, rotation=form) for _ in range(2))
    for k in range(1, 41):
        seen.advance_to(5e-4 * k)
        length = np.linalg.norm(seen.snapshot().orientation, axis=1)
        assert np.abs(length - 1.0).max() <= 4e-16
    assert seen.status.step_count < 10
    unseen.advance_to(seen.time)
    assert same_state(seen.snapshot(), unseen.snapshot())
    # What is shown is a state from which a run can go on as it is.
    shown = seen.snapshot()
    unseen.set_state(**{name: getattr(shown, name) for name in STATE})
    if form == 'quaternion':
        assert same_state(unseen.snapshot(), shown)


def test_reset_starts_again():
    simulation = ico.compile_scene(START)
    simulation.advance_to(0.01)
    moved = simulation.snapshot()
    simulation.reset()
    assert simulation.time == 0.01
    s = simulation.snapshot()
    assert s.time == 0.01
    assert np.array_equal(s.position, START.initial.position)
    simulation.advance_to(0.02)
    # The steps begin at 0.01 now, so the last bits may differ.
    np.testing.assert_allclose(simulation.snapshot().position, moved.position, rtol=0, atol=1e-12)
    simulation.reset_time()
    assert simulation.time == 0.0
    simulation.advance_to(0.01)
    assert same_state(simulation.snapshot(), moved)
    assert not np.array_equal(moved.position, START.initial.position)


def test_unknown_rotation_form_is_refused():
    with pytest.raises(
        ValueError, match="rotation must be one of quaternion, direction_cosines, got 'euler'"
    ):
        ico.compile_scene(START, rotation='euler')


def test_scene_chooses_the_form_of_the_rotation():
    scene = changed(START, {'solver.rotation': 'direction_cosines'})
    runs = [ico.compile_scene(scene), ico.compile_scene(START, rotation='direction_cosines'),
            ico.compile_scene(START), ico.compile_scene(scene, rotation='quaternion')]
    for run in runs:
        run.advance_to(0.05)
    assert [run.rotation for run in runs] == [*['direction_cosines'] * 2, *['quaternion'] * 2]
    given, asked, own, back = (run.snapshot() for run in runs)
    assert same_state(given, asked) and same_state(own, back)
    difference = np.abs(given.position - own.position).max()
    assert 0.0 < difference < 1e-12  # other roundings, the same motion


def test_spin_in_body_axes():
    simulation = ico.compile_scene(START)
    simulation.advance_to(0.05)
    state = simulation.snapshot()
    # By SciPy's rotations, which know nothing of ours.
    turns = Rotation.from_quat(state.orientation.copy())
    wanted = turns.inv().apply(state.angular_velocity.copy())
    np.testing.assert_allclose(state.angular_velocity_body, wanted, rtol=0, atol=1e-13)
    assert np.abs(wanted - state.angular_velocity).max() > 0.1
    assert state.table()['wz_body_rad_s'] == state.angular_velocity_body[:, 2].tolist()


def test_state_that_is_no_longer_finite_stops_the_run():
    scene = changed(START, {'groups.tip': 'ids 2', 'loads.tip.group': 'tip'})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.001)
    simulation.apply_wrench('tip', (1e308, 1e308, 1e308))
    with pytest.raises(
        ico.SimulationError,
        match='of body [0-3], at connector .* is no longer finite at t = .* Start again: '
    ):
        simulation.advance_to(1.0)
    assert simulation.time < 1.0
    assert simulation.snapshot().time == simulation.time
    simulation.reset()
    simulation.advance_to(simulation.time + 0.01)
    assert np.isfinite(simulation.snapshot().position).all()


@pytest.mark.parametrize('advance', ['advance_to', 'advance_steps'])
def test_failed_run_can_be_looked_at_and_started_anew(advance):
    rough = {'solver.method': 'leapfrog', 'solver.energy_limit': 1e3}
    limit = ico.compile_scene(changed(START, {**rough, 'solver.step': 0.0})).status.stability_limit
    scene = changed(
        START, {**rough, 'solver.step': 0.9 * limit, 'initial_random.velocity_sigma': 8.0})
    simulation = ico.compile_scene(scene)
    with pytest.raises(ico.SimulationError, match='has become unsafe at t = '):
        simulation.advance_to(10.0) if advance == 'advance_to' else simulation.advance_steps(
            100_000
        )
    s = simulation.snapshot()
    assert (
        s.time
        == simulation.time
        == pytest.approx(simulation.status.step_count * simulation.status.step, rel=1e-12)
    )
    assert s.time > 0.0
    assert not np.array_equal(s.position, scene.initial.position)
    # It stays stopped, until it is given another state.
    with pytest.raises(ico.SimulationError, match='has become unsafe'):
        simulation.advance_to(10.0)
    simulation.set_state(
        position=scene.position,
        orientation=scene.orientation,
        linear_velocity=np.zeros((4, 3)),
        angular_velocity=np.zeros((4, 3)),
    )
    simulation.advance_to(s.time + 1.0)
    np.testing.assert_allclose(simulation.snapshot().position, scene.position, rtol=0, atol=1e-12)


def test_set_state_beyond_the_fixed_step_is_refused_and_seen():
    scene = changed(
        START,
        {
            'solver.method': 'leapfrog',
            'solver.step': 1.9
            / ico.compile_scene(changed(START, {'solver.step': 0.0})).status.largest_frequency,
        },
    )
    simulation = ico.compile_scene(scene)
    stretched = 4.0 * scene.position
    with pytest.raises(ico.SimulationError, match='solver.step .* has become unsafe'):
        simulation.set_state(position=stretched)
    # Either the state was taken, or it was not; what is shown must be what is there.
    there = simulation.packed.layout.unpack(simulation._driver.trajectory.state)
    assert np.array_equal(simulation.snapshot().position, there.position)


def test_huge_numbers_end_in_a_plain_error():
    simulation = ico.compile_scene(changed(START, {'solver.step': 0.0}))
    position = START.position.copy()
    position[1] = 1e200
    # Which of them depends on the processor's rounding.
    plain = 'body 1|finite|too fast|short enough'
    with pytest.raises((ValueError, ico.SimulationError), match=plain):
        simulation.set_state(position=position)
        simulation.advance_to(1.0)


def test_all_terms_together_run_in_both_forms():
    sections = {**SUPPORTED, **LOADED, 'groups': {**SUPPORTED['groups'], **LOADED['groups']}}
    results = []
    for form in FORMS:
        simulation = ico.compile_scene(make_scene((3, 3, 3), **RANDOM, **sections), rotation=form)
        simulation.advance_to(0.03)
        results.append(simulation.snapshot())
    np.testing.assert_allclose(results[0].position, results[1].position, rtol=0, atol=1e-9)
    assert np.abs(results[0].position - simulation.scene.initial.position).max() > 0.01


def test_changed_scene_takes_over_the_motion():
    old = ico.compile_scene(START)
    old.advance_to(0.01)
    new = ico.compile_scene(changed(START, {'gravity': [0.0, 0.0, -9.81]}))
    new.continue_from(old, keep_motion=True)
    assert new.time == 0.01
    assert same_state(new.snapshot(), old.snapshot())
    for each in (old, new):
        each.advance_to(0.02)
    fallen = (old.snapshot().position - new.snapshot().position)[:, 2]
    assert fallen.mean() == pytest.approx(0.5 * 9.81 * 0.01**2, rel=1e-3)
    with pytest.raises(ValueError, match='motion of 4 bodies cannot continue with 14'):
        ico.compile_scene(make_scene((3, 3, 3))).continue_from(old, keep_motion=True)
    fresh = ico.compile_scene(make_scene((3, 3, 3)))
    fresh.continue_from(old, keep_motion=False)
    assert fresh.time == 0.02 and np.array_equal(fresh.snapshot().position, fresh.scene.position)
    fresh.advance_to(0.03)


def test_energy_of_gravity_refers_to_the_origin_whatever_the_orientation():
    turn = rotation_quaternion(np.array([0.2, 0.5, -0.4]))
    scene = make_scene(
        (1, 1, 1),
        {
            'gravity': [0.0, 0.0, -9.81],
            'initial.i.group': 'all',
            'initial.i.rotation': [0.2, 0.5, -0.4],
        },
    )
    s = ico.compile_scene(scene).snapshot()
    np.testing.assert_allclose(
        s.orientation[0], quaternion_product(turn, scene.orientation[0]), atol=1e-15
    )
    np.testing.assert_allclose(
        free_rotation(scene.orientation, np.array([[0.2, 0.5, -0.4]]), 1.0), s.orientation
    )
    assert s.energy['gravity'] == 0.0


@pytest.mark.parametrize('seed', [26, 30, 32, 34])
def test_steps_one_by_one_show_what_one_go_shows(seed):
    """Also where a step leads back and steps are taken again, whose number says that."""
    scene = ico.Scene.from_parameters({
        'weave.size': [2, 3, 4], 'weave.connector_angle': 0.66, 'connector.stiffness': 910.4,
        'shell.density': 1682.4, 'contact.mode': 'never', 'gravity': [0.0, 0.0, -9.81],
        'groups.wall': 'x_min', 'supports.wall.group': 'wall', 'groups.tip': 'x_max',
        'loads.tip.group': 'tip', 'solver.tolerance': 1e-6})
    generator = np.random.default_rng(seed)
    by_steps = ico.compile_scene(scene)
    by_steps.advance_to(float(generator.uniform(0.05, 0.3)))
    force = generator.standard_normal(3) * 10.0 ** generator.uniform(-2.0, 1.0)
    by_steps.apply_wrench('tip', force=tuple(force.tolist()))
    begun, most = by_steps.checkpoint(), 0
    for _ in range(20):
        before = by_steps.status.step_count
        by_steps.advance_steps(1)
        most = max(most, by_steps.status.step_count - before)
        # As the node does, which stands on whole nanoseconds.
        time = max(math.ceil(by_steps.time * 1e9) / 1e9, by_steps.time)
        by_steps.advance_to(time)
        in_one_go = ico.compile_scene(scene)
        in_one_go.restore(begun)
        in_one_go.advance_to(time)
        assert same_state(by_steps.snapshot(), in_one_go.snapshot()), time
        # A checkpoint there can be gone on from.
        in_one_go.restore(by_steps.checkpoint())
    assert most > 1
