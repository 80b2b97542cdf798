# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Shells that meet: what is kept, what a rigid body would do, and what stops a run."""

from contact_scenes import A, crowd, loose, momenta, OBLIQUE
from fabrics import changed, make_scene, same_state
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import midradius, vertices
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.stepping import thread_team
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

# Leapfrog takes a step of its own, one for many radians of a contact.
METHODS = ('leapfrog', 'dop8')
# tsit5 is refused where shells may touch.
THROUGH_CONTACTS = [name for name in ico.METHODS if name != 'tsit5']


@pytest.mark.parametrize('method', METHODS)
def test_a_collision_keeps_momenta_to_rounding_and_energy(method):
    step = {'leapfrog': 2e-6, 'dop8': 0.0}[method]
    scene = loose(OBLIQUE, solver__method=method, solver__step=step)
    simulation = ico.compile_scene(scene)
    before = momenta(scene, simulation.snapshot())
    start, deepest, most = simulation.snapshot().energy['total'], 0.0, 0.0
    for time in np.linspace(0.0, 0.07, 300):
        simulation.advance_to(time)
        energy = simulation.snapshot().energy
        most = max(most, energy['contact'])
        assert abs(energy['balance_error']) < {'leapfrog': 1e-3, 'dop8': 1e-9}[method] * start
    deepest = simulation.status.deepest_overlap
    after = momenta(scene, simulation.snapshot())
    size = [scene.shell.mass * 1.0, scene.shell.mass * 1.0 * 0.06]
    for one, other, scale in zip(before, after, size):
        assert np.abs(one - other).max() < 1e-12 * scale
    assert 1e-4 * A < deepest < 0.05 * A and most > 0.1 * start
    assert simulation.status.contact_count == 0
    assert 'a contact that begins and ends' in simulation.status.error_estimate_lacks
    velocity = simulation.snapshot().linear_velocity
    assert velocity[0, 0] < -0.1 and abs(simulation.balance.error) < 1e-3 * start


@pytest.mark.parametrize('method', METHODS)
def test_auto_and_always_are_the_same_bits_also_in_pieces_and_from_checkpoints(method):
    step = {'leapfrog': 5e-6, 'dop8': 0.0}[method]
    scene = loose(OBLIQUE, solver__method=method, solver__step=step)
    auto, always = (
        ico.compile_scene(changed(scene, {'contact.mode': mode})) for mode in ('auto', 'always'))
    auto.advance_to(0.06)
    checkpoints = []
    for time in np.linspace(0.0, 0.06, 37):
        always.advance_to(time)
        always.snapshot()
        checkpoints.append(always.checkpoint())
    assert same_state(auto.snapshot(), always.snapshot())
    assert auto.status.step_count == always.status.step_count and auto.status.contact_tests > 0
    touching = 0
    for checkpoint in checkpoints[::4]:
        again = ico.compile_scene(changed(scene, {'contact.mode': 'always'}))
        again.restore(Checkpoint.from_bytes(checkpoint.to_bytes()))
        touching += again.snapshot().energy['contact'] > 0.0
        again.advance_to(0.06)
        assert same_state(again.snapshot(), always.snapshot())
        assert again.status.contact_tests == always.status.contact_tests > 0
        assert again.checkpoint().difference(always.checkpoint()) == ''


@pytest.mark.parametrize('method', THROUGH_CONTACTS)
def test_pairs_that_steps_look_at_do_not_depend_on_pieces_or_on_who_is_shown_what(method):
    scene = loose(
        OBLIQUE, contact__mode='always', solver__method=method, solver__step=1e-5,
        solver__energy_limit=10.0)
    whole, pieces = ico.compile_scene(scene), ico.compile_scene(scene)
    whole.advance_to(0.03)
    for time in np.linspace(0.0, 0.03, 14):
        pieces.advance_to(time + 3e-6)
        pieces.snapshot()
    whole.advance_to(pieces.time)
    assert whole.status.contact_tests == pieces.status.contact_tests > 10


@pytest.mark.parametrize('method', [
    pytest.param(name, marks=pytest.mark.long if name in ('srkn4', 'srkn6') else ())
    for name in THROUGH_CONTACTS])
def test_energy_errs_by_the_square_of_the_step_through_contacts(method):
    # The force has a kink at first touch, wherever in a step that is: a mean over eight places.
    # Given steps do not end there, also those of dop8.
    steps, errors = 4e-5 / 2.0 ** np.arange(4), []
    for step in steps:
        scene = loose(
            OBLIQUE, solver__method=method, solver__step=step, solver__energy_limit=10.0)
        simulation, squares = ico.compile_scene(scene), []
        for place in range(8):
            position = scene.initial.position.copy()
            position[1, 0] = 0.04 + place * step / 8.0
            simulation.set_state(
                position=position, orientation=scene.initial.orientation,
                linear_velocity=scene.initial.linear_velocity,
                angular_velocity=scene.initial.angular_velocity)
            start = simulation.snapshot().energy['total']
            simulation.advance_to(simulation.time + 0.03)
            squares.append((simulation.snapshot().energy['total'] / start - 1.0) ** 2)
        errors.append(np.sqrt(np.mean(squares)))
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.4)
    assert 1e-8 < errors[-1] < errors[0] < 3e-3


def impulse(arm, normal, approach, mass, inertia):
    """Frictionless impulse of restitution 1 on one body from a wall, by its speed of approach."""
    lever = np.cross(arm, normal)
    return 2.0 * approach / (1.0 / mass + (lever @ lever) / inertia)


@pytest.mark.parametrize('velocity, spin', [
    ((0.0, 0.0, -1.0), (0.0, 0.0, 0.0)), ((0.5, -0.3, -1.0), (0.0, 0.0, 0.0)),
    ((0.2, 0.1, -1.0), (10.0, -15.0, 40.0))])
def test_a_vertex_on_a_floor_is_hit_as_a_rigid_body_is(velocity, spin):
    # A vertex is lowest, and the centre not above it.
    turned = Rotation.from_euler('xyz', [0.35, 0.2, 0.1])
    arms = turned.apply(vertices(A))
    arm = arms[np.argmin(arms[:, 2])]
    assert np.hypot(*arm[:2]) > 0.1 * A
    errors = []
    for stiffness in (1.6e6, 2.56e7, 4.096e8):
        scene = make_scene((1, 1, 1), {
            'weave.connected': False, 'solver.method': 'dop8', 'solver.tolerance': 1e-8,
            'contact.mode': 'auto', 'contact.stiffness': stiffness,
            'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.1})
        simulation = ico.compile_scene(scene)
        # It begins so high that it would be in this pose at first touch.
        way = -1e-3 / velocity[2] * 1.0
        before = Rotation.from_rotvec(-way * np.array(spin)) * turned
        place = np.array([0.0, 0.0, -0.1 - arm[2]]) - way * np.array(velocity)
        simulation.set_state(
            position=place[None], orientation=before.as_quat()[None],
            linear_velocity=np.array([velocity]), angular_velocity=np.array([spin]))
        simulation.advance_to(3.0 * way)
        snapshot = simulation.snapshot()
        mass, inertia = scene.shell.mass, scene.shell.inertia
        normal = np.array([0.0, 0.0, 1.0])
        approach = -(np.array(velocity) + np.cross(spin, arm)) @ normal
        push = impulse(arm, normal, approach, mass, inertia)
        expected = np.array(velocity) + push / mass * normal
        turning = np.array(spin) + push * np.cross(arm, normal) / inertia
        error = np.abs(snapshot.linear_velocity[0] - expected).max()
        error = max(error, A * np.abs(snapshot.angular_velocity[0] - turning).max())
        errors.append(error / abs(approach))
    # The body turns while it touches, for a time that falls as the root of the stiffness.
    orders = np.log2(np.array(errors[:-1]) / errors[1:]) / 4.0
    assert orders == pytest.approx(0.5, abs=0.02)
    assert errors[-1] < 1e-3


def test_a_drop_comes_back_to_its_height():
    scene = make_scene((1, 1, 1), {
        'weave.connected': False, 'solver.method': 'dop8', 'solver.tolerance': 1e-8,
        'contact.mode': 'auto', 'gravity': [0.0, 0.0, -9.81],
        'planes.floor.normal': [0.0, 0.0, 2.0], 'planes.floor.offset': -0.1})
    simulation = ico.compile_scene(scene)
    start = simulation.snapshot().energy
    # The edge below is flat on the floor at first touch: it does not turn.
    touch = 0.05 - midradius(A)
    height, lowest = [], 1.0
    for time in np.linspace(0.0, 2.0 * np.sqrt(2.0 * touch / 9.81), 200):
        simulation.advance_to(time)
        height.append(simulation.snapshot().position[0, 2])
        lowest = min(lowest, height[-1])
    assert lowest < -0.98 * touch and simulation.status.deepest_overlap < 0.01 * A
    assert abs(height[-1]) < 1e-3 * touch
    energy = simulation.snapshot().energy
    assert abs(energy['balance_error']) < 1e-9 * abs(touch * 9.81 * scene.shell.mass)
    assert start['contact'] == 0.0


@pytest.mark.parametrize('speed', [1.0, 30.0, 1000.0])
def test_a_fast_body_is_caught(speed):
    # Of a stiffness that can catch it: K = M v^2 / (0.05 a)^2.
    scene = loose(
        ((0.06, 0.0, 0.0), (-speed, 0.0, 0.0), (0.0, 0.0, 0.0)),
        contact__stiffness=0.0073 * speed**2 / (0.05 * A)**2, solver__tolerance=1e-4 * speed)
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.06 / speed)
    velocity = simulation.snapshot().linear_velocity[:, 0] / speed
    # A head-on collision of equal bodies: they change their velocities.
    assert velocity == pytest.approx([-1.0, 0.0], abs=1e-3)
    assert simulation.status.deepest_overlap > 1e-3 * A


def test_too_deep_an_overlap_stops_the_run_with_both_names():
    scene = loose(
        ((0.06, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 0.0)), contact__stiffness=300.0)
    simulation = ico.compile_scene(scene)
    with pytest.raises(ico.SimulationError, match='body 0 and body 1 overlap') as caught:
        simulation.advance_to(0.2)
    assert 'contact.stiffness' in str(caught.value)
    snapshot = simulation.snapshot()
    assert np.isfinite(snapshot.position).all() and 0.0 < snapshot.time < 0.06
    with pytest.raises(ValueError, match='cannot start: body 0 and body 1 overlap'):
        ico.compile_scene(loose(((0.01, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))))
    with pytest.raises(ValueError, match='body 1 and plane floor overlap'):
        ico.compile_scene(loose(
            ((0.0, 0.0, 0.2), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
            planes__floor__normal=[0.0, 0.0, -1.0], planes__floor__offset=-0.19))


def test_a_step_too_long_for_contacts_stops_the_run_when_they_come():
    scene = loose(
        ((0.06, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 0.0)), solver__method='leapfrog',
        solver__step=5e-4)
    simulation = ico.compile_scene(scene)
    with pytest.raises(ico.SimulationError, match='too long for present or possible contacts'):
        simulation.advance_to(0.2)
    assert 0.01 < simulation.time < 0.06


@pytest.mark.parametrize('method', METHODS)
def test_no_state_beyond_a_contact_is_shown_within_a_given_step(method, caplog):
    # In each step it moves by six times its width: no force is evaluated where the shells touch.
    scene = loose(
        ((0.5, 0.0, 0.0), (-200.0, 0.0, 0.0), (0.0, 0.0, 0.0)), contact__stiffness=20.0,
        solver__method=method, solver__step=1e-3)
    seen, unseen = ico.compile_scene(scene), ico.compile_scene(scene)
    for time in (1.5e-3, 2.3e-3):
        seen.advance_to(time)
        assert seen.snapshot().position[1, 0] == pytest.approx(0.5 - 200.0 * time, abs=1e-12)
    messages = []
    for simulation, time in ((seen, 2.7e-3), (unseen, 0.01)):
        with pytest.raises(ico.SimulationError, match='body 0 and body 1 may pass') as caught:
            simulation.advance_to(time)
        messages.append(str(caught.value))
        kept = simulation.snapshot()
        # The step end before the contact, which is at 2.35e-3 s.
        assert kept.time == simulation.time == 2e-3
        assert kept.position[1, 0] == pytest.approx(0.1, abs=1e-12)
        assert 'solver.step' in messages[-1] and 't = 0.002 s, is kept' in messages[-1]
    assert same_state(seen.snapshot(), unseen.snapshot())
    with pytest.raises(ico.SimulationError, match='may pass'):
        seen.advance_to(0.02)
    # What passes by at a distance, or moves away, goes on without a word.
    caplog.clear()
    for place, speed in (((0.5, 0.05, 0.0), -200.0), ((0.5, 0.0, 0.0), 200.0)):
        free = ico.compile_scene(changed(scene, {
            'bodies.b0.position': list(place), 'bodies.b0.linear_velocity': [speed, 0.0, 0.0]}))
        free.advance_to(5.5e-3)
        assert free.snapshot().position[1] == pytest.approx(
            [0.5 + 5.5e-3 * speed, place[1], 0.0], abs=1e-12)
    assert not caplog.records


@pytest.mark.parametrize('place', [0.0, 0.1])
def test_no_state_beyond_a_contact_is_shown_where_bodies_become_fast_between_checks(place, caplog):
    # At rest at the last search, so displacements are asked for after 32 steps; it is pulled
    # through the other one in the sixth.
    force = 0.5 / (0.5 * 5.5e-3**2) * loose(OBLIQUE).shell.mass
    scene = changed(loose(
        ((0.5, place, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), contact__stiffness=20.0,
        solver__method='leapfrog', solver__step=1e-3), {
            'groups.pulled': 'ids 1', 'loads.pull.group': 'pulled',
            'loads.pull.force': [-force, 0.0, 0.0]})
    for times in ((0.02,), (4.1e-3, 5.2e-3, 5.7e-3, 0.02), np.arange(1, 41) * 5e-4):
        simulation = ico.compile_scene(scene)
        if place:
            for time in times:
                simulation.advance_to(time)
            assert simulation.snapshot().position[1, 0] == pytest.approx(
                0.5 - 0.5 * (force / scene.shell.mass) * 0.02**2)
            continue
        with pytest.raises(ico.SimulationError, match='body 0 and body 1 may pass') as caught:
            for time in times:
                simulation.advance_to(time)
        assert 'between t = 0.005 s' in str(caught.value)
        kept = simulation.snapshot()
        assert kept.time == simulation.time <= 5e-3 and kept.position[1, 0] > 0.08
        assert kept.energy['work_in'] == pytest.approx(kept.energy['kinetic'], abs=1e-9)
    assert not caplog.records


@pytest.mark.parametrize('method', ['leapfrog', 'srkn4'])
def test_chosen_steps_in_which_bodies_become_fast_meet_what_is_on_their_way(method, caplog):
    # At rest at the last search, so displacements are asked for after several steps; by then it
    # was beyond the other one, at 150 m/s.
    scene = changed(loose(
        ((0.2, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), contact__stiffness=1e8,
        solver__method=method, solver__tolerance=1.0), {
            'groups.pulled': 'ids 1', 'loads.pull.group': 'pulled',
            'loads.pull.force': [-400.0, 0.0, 0.0]})
    ends, checkpoints = [], []
    for times in ((0.003,), np.arange(1, 7) * 5e-4, np.arange(1, 61) * 5e-5):
        simulation = ico.compile_scene(scene)
        for time in times:
            simulation.advance_to(time)
            place = simulation.snapshot().position[:, 0]
            assert place[1] - place[0] > 2.0 * midradius(A) - 0.3 * A
        ends.append(simulation.snapshot())
        checkpoints.append(simulation.checkpoint())
    # A head-on collision of equal bodies: the one at rest has the velocity of the other now.
    touch = 0.2 - 2.0 * midradius(A)
    speed = np.sqrt(2.0 * touch * 400.0 / scene.shell.mass)
    assert ends[0].linear_velocity[0, 0] == pytest.approx(-speed, rel=0.02)
    for end, checkpoint in zip(ends, checkpoints):
        assert same_state(ends[0], end)
        assert checkpoints[0].difference(checkpoint) == ''
    assert not any('late' in record.message for record in caplog.records)


@pytest.mark.parametrize('method', ['leapfrog', 'srkn4'])
def test_checkpoints_while_steps_follow_what_became_fast_lead_to_the_same_bits(method):
    scene = changed(loose(
        ((0.2, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), contact__stiffness=1e8,
        solver__method=method, solver__tolerance=1.0), {
            'groups.pulled': 'ids 1', 'loads.pull.group': 'pulled',
            'loads.pull.force': [-400.0, 0.0, 0.0]})
    whole, kept = ico.compile_scene(scene), ico.compile_scene(scene)
    whole.advance_to(2.8e-3)
    for time in (9e-4, 1.6e-3, 2.2e-3):
        kept.advance_to(time)
        other = ico.compile_scene(scene)
        other.restore(kept.checkpoint())
        other.advance_to(2.8e-3)
        assert same_state(other.snapshot(), whole.snapshot())
        assert other.status.step == whole.status.step


def imprecise():
    """A small fabric far from a loose body; steps swing the energy by a good part of it."""
    scene = loose(
        ((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), weave__size=[2, 2, 2],
        weave__connected=True, contact__stiffness=20.0, solver__method='leapfrog')
    assert scene.connector_count > 0
    scene = changed(scene, {
        'connector.natural_length': 0.9 * scene.geometry.connector_length,
        'groups.last': f'ids {scene.body_count - 1}', 'loads.push.group': 'last',
        'loads.push.force': [1e-6, 0.0, 0.0]})
    rate = ico.compile_scene(scene).status.largest_frequency
    return changed(scene, {'solver.step': 0.5 / rate})


@pytest.mark.parametrize('inputs', [1, 3])
def test_a_state_whose_energy_does_not_balance_is_not_kept_at_an_input(inputs):
    # An input comes before the first health check, which would be the first to see it.
    scene = changed(imprecise(), {'solver.energy_limit': 1e-5})
    simulation = ico.compile_scene(scene)
    step = scene.parameters['solver.step']
    with pytest.raises(ico.SimulationError, match='energy does not balance') as caught:
        for number in range(1, inputs + 1):
            simulation.advance_to(number * 2.3 * step)
            simulation.apply_wrench('push', (1e-6 * number, 1e-6, 0.0))
        simulation.advance_to(100.0 * step)
    kept = simulation.snapshot()
    assert 't = 0 s, is kept' in str(caught.value) and kept.time == simulation.time == 0.0
    assert np.array_equal(kept.position, scene.initial.position)
    # Where it balances well enough the run goes on.
    simulation = ico.compile_scene(changed(scene, {'solver.energy_limit': 0.1}))
    for number in range(1, inputs + 1):
        simulation.advance_to(number * 2.3 * step)
        simulation.apply_wrench('push', (1e-6 * number, 1e-6, 0.0))
    simulation.advance_to(10.0 * step)
    assert simulation.snapshot().time == 10.0 * step


def test_a_state_whose_energy_does_not_balance_is_not_kept_before_a_long_step():
    scene = imprecise()
    step = scene.parameters['solver.step']
    # It flies farther in a step than contacts are known for: each begins with a state to keep.
    fast = changed(scene, {
        'bodies.b0.linear_velocity': [0.05 / step, 0.0, 0.0], 'solver.energy_limit': 1e-9})
    simulation = ico.compile_scene(fast)
    with pytest.raises(ico.SimulationError, match='energy does not balance'):
        simulation.advance_to(100.0 * step)
    assert simulation.time == simulation.snapshot().time == 0.0


@pytest.mark.parametrize('force', [(1e300, 0.0, 0.0), (-1e308, 1e308, 0.0)])
@pytest.mark.parametrize('wait', [0.0, 2.5e-3])
def test_a_force_too_large_for_numbers_stops_a_given_step_without_warnings(force, wait):
    # Warnings are errors in these tests.
    scene = changed(loose(
        ((0.5, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), contact__stiffness=20.0,
        planes__wall__normal=[-1.0, 0.0, 0.0], planes__wall__offset=-3.0,
        solver__method='leapfrog', solver__step=1e-3), {
            'groups.pulled': 'ids 1', 'loads.pull.group': 'pulled',
            'loads.pull.force': [-1e-9, 0.0, 0.0]})
    for times in ((0.3e-3, 0.1), (0.1,)):
        simulation = ico.compile_scene(scene)
        simulation.advance_to(wait)
        simulation.apply_wrench('pull', force)
        with pytest.raises(ico.SimulationError):
            for time in times:
                simulation.advance_to(wait + time)
        assert np.isfinite(simulation.snapshot().position).all()


def test_a_given_step_too_long_for_what_may_touch_is_refused_at_the_start():
    with pytest.raises(ValueError, match='cannot start: .* for present or possible contacts'):
        ico.compile_scene(loose(
            ((0.04, 0.0, 0.0), (-50.0, 0.0, 0.0), (0.0, 0.0, 0.0)), solver__method='leapfrog',
            solver__step=5e-4))


def test_a_plane_without_a_direction_is_refused():
    with pytest.raises(ico.ParameterError, match=r'planes\.floor\.normal must be a nonzero'):
        make_scene((1, 1, 1), {'planes.floor.normal': [0.0, 0.0, 0.0]})


def test_a_crowd_keeps_momenta_and_energy_with_the_same_bits_for_any_threads(monkeypatch):
    scene = crowd()
    assert scene.body_count == 27
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1)
    ends = []
    for count in (1, 3):
        monkeypatch.setattr(thread_team, 'core_count', lambda count=count: count)
        simulation = ico.compile_scene(scene)
        assert simulation.status.thread_count == count
        before, start = momenta(scene, simulation.snapshot()), simulation.snapshot().energy
        simulation.advance_to(0.08)
        ends.append(simulation.snapshot())
        after, energy = momenta(scene, ends[-1]), ends[-1].energy
        assert simulation.status.contact_tests > 1e5
        assert simulation.status.deepest_overlap > 0.01 * A
        for one, other, size in zip(before, after, (1.0, 0.1)):
            assert np.abs(one - other).max() < 1e-13 * 27 * scene.shell.mass * size
        assert abs(energy['balance_error']) < 1e-6 * start['total']
        # Much of it is in spins now.
        spin = 0.5 * scene.shell.inertia * (ends[-1].angular_velocity**2).sum()
        assert spin > 0.05 * start['total']
    assert same_state(*ends)


def test_the_first_step_after_a_jump_does_not_depend_on_what_is_listed():
    lengths, listed = [], []
    for gap in (0.030, 0.034):
        simulation = ico.compile_scene(loose(
            ((1.3 * gap, 0.0, 0.0), (-0.05, 0.0, 0.0), (0.0, 0.0, 0.0)),
            loads__push__group='all', loads__push__force=[0.0, 0.001, 0.0],
            loads__push__profile='steady', loads__push__start=0.01))
        simulation.advance_to(0.0101)
        driver = simulation._driver
        lengths.append((driver.trajectory.control.length, simulation.status.step_count))
        listed.append(driver.contact.phase.contacts is not None)
    assert listed == [True, False]
    assert lengths[0] == lengths[1] and lengths[0][0] > 0.01


def test_contact_far_from_the_origin_takes_as_many_steps_as_near(caplog):
    def bounced(offset):
        scene = make_scene((1, 1, 1), {
            'contact.mode': 'auto', 'gravity': [0.0, 0.0, -9.81], 'solver.method': 'dop8',
            'planes.floor.normal': [0.0, 0.0, 1.0], 'groups.it': 'all', 'initial.it.group': 'it',
            'initial.it.displacement': [offset] * 3,
            'planes.floor.offset': offset - (midradius(1.0) + 0.1) * A})
        simulation = ico.compile_scene(scene)
        pieces = ico.compile_scene(scene)
        simulation.advance_to(0.05)
        for time in (0.0139, 0.0143, 0.02, 0.05):
            pieces.advance_to(time)
            pieces.restore(pieces.checkpoint())
        assert same_state(simulation.snapshot(), pieces.snapshot())
        return simulation, simulation.snapshot().linear_velocity[0, 2]

    near, velocity = bounced(0.0)
    assert 'origin' not in near.status.error_estimate_lacks and not caplog.records
    far, other = bounced(1e4)
    assert velocity > 0.1 - 9.81 * 0.05  # it has bounced
    assert other == pytest.approx(velocity, abs=1e-3 * 0.14)
    assert far.status.step_count < 2 * near.status.step_count
    assert far.balance.worst < 1e-5
    assert 'up to 1e+04 m from the origin' in far.status.error_estimate_lacks
    assert 'up to 1e+04 m from the origin' in caplog.text
