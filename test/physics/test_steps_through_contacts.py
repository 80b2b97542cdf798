# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Steps of the leapfrog that run through contacts, with what these take from the motion."""

from contact_poses import facing, NORMALS, RHO, touch_floor, VERTICES
from contact_scenes import A, crowd, loose, momenta, OBLIQUE
from fabrics import changed, same_state
import icofabric_sim as ico
from icofabric_sim import contact
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.stepping import thread_team
from icofabric_sim.simulation.stepping.controllers.measured import MeasuredStep
from icofabric_sim.simulation.stepping.method_selection import (
    choose_method,
    LOOSE_CONTACTS,
    LOOSE_WOVEN,
    MANY_FREE,
    MANY_WOVEN,
)
from icofabric_sim.simulation.stepping.trial_steps import TrialSteps
from icofabric_sim.terms.contacts.force import contact_look
from icofabric_sim.terms.contacts.stiffness import largest_stiffness
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

STICKY = {'contact__damping': 0.5, 'contact__friction': 0.6}
LEAPFROG = {'solver__method': 'leapfrog', 'solver__tolerance': 0.1}
UP = np.array([0.0, 0.0, 1.0])
FLOOR = {'planes__floor__normal': [0.0, 0.0, 1.0], 'planes__floor__offset': -0.05}
GRAVITY = 9.81
# 32 shells woven face to face, 0.03 a above a floor.
DENSE = {
    'weave.size': [4, 4, 4], 'weave.connector_angle': -0.36, 'contact.friction': 0.4,
    'gravity': [0.0, 0.0, -GRAVITY], 'planes.floor.normal': [0.0, 0.0, 1.0],
    'planes.floor.offset': -0.0165, 'solver.threads': 1}


def after(scene, until):
    """Numbers of the second body of a scene at `until` [s]: velocity, and a times its spin."""
    simulation = ico.compile_scene(scene)
    simulation.advance_to(until)
    snapshot = simulation.snapshot()
    return np.concatenate([snapshot.linear_velocity[1], A * snapshot.angular_velocity[1]])


@pytest.mark.parametrize('losses', [{}, STICKY], ids=['free', 'sticky'])
def test_the_order_is_2_through_contacts_that_begin_and_end(losses):
    wanted = after(loose(OBLIQUE, **losses, solver__tolerance=1e-9), 0.03)
    steps = 2e-5 * 2.0 ** -np.arange(5)
    # Where a kink lies in its step is chance: the mean of a few starts.
    errors = []
    for step in steps:
        found = [
            np.abs(after(loose(
                OBLIQUE, **losses, solver__method='leapfrog', solver__step=step * part),
                0.03) - wanted).max() for part in (1.0, 0.93, 0.87)]
        errors.append(np.mean(found))
    assert errors[0] > 100.0 * errors[-1] and errors[-1] < 1e-4
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.25)


@pytest.mark.parametrize('wanted, speed', [(0.8, 0.3), (0.5, 1.0), (0.1, 2.0)])
def test_a_collision_has_the_restitution_that_its_damping_is_for(wanted, speed):
    turned = facing(np.eye(3), VERTICES[0], -UP)
    height = A * np.linalg.norm(VERTICES[0])
    out = touch_floor(UP, 0.0, (np.linalg.norm(VERTICES[0]) - 1e-3) * UP, turned)[1]
    damping = contact.damping_for(wanted, out[10] / 1e-3 * speed)
    simulation = ico.compile_scene(loose(
        ((0.2, 0.0, -0.049 + height), (0.0, 0.0, -speed), (0.0, 0.0, 0.0),
         Rotation.from_matrix(turned)), **FLOOR, contact__damping=damping,
        solver__method='leapfrog', solver__tolerance=1e-4))
    before = simulation.snapshot().energy['total']
    simulation.advance_to(0.03 / speed)
    snapshot = simulation.snapshot()
    assert snapshot.linear_velocity[1, 2] == pytest.approx(wanted * speed, rel=2e-4)
    assert snapshot.energy['dissipated'] == pytest.approx((1.0 - wanted**2) * before, rel=2e-4)
    assert abs(snapshot.energy['balance_error']) < 2e-4 * before
    assert snapshot.energy['contact'] == 0.0


@pytest.mark.parametrize('damping', [0.0, 0.01, 3.0, 1000.0])
@pytest.mark.parametrize('first', ['face', 'as it is'])
def test_hard_collisions_keep_the_balance_wherever_they_lie_in_a_step(first, damping):
    # c v = 3000 asks for steps hundreds of times as short as those of the contact: damping that a
    # step cannot carry gives nothing back.
    turned = facing(np.eye(3), NORMALS[0], -UP) if first == 'face' else np.eye(3)
    for height in np.linspace(-0.03, -0.024, 9):
        simulation = ico.compile_scene(loose(
            ((0.2, 0.0, float(height)), (0.1, 0.0, -3.0), (0.0, 0.0, 0.0),
             Rotation.from_matrix(turned)), **FLOOR, contact__damping=damping,
            **{**LEAPFROG, 'solver__tolerance': 1.0}))
        before = simulation.snapshot().energy['total']
        simulation.advance_to(0.02)
        energy = simulation.snapshot().energy
        assert abs(energy['balance_error']) < 0.01 * before
        assert energy['kinetic'] < 1.005 * before
        assert simulation.status.contact_count == 0 or damping > 1.0
        if damping > 1.0:
            assert energy['dissipated'] > 0.7 * before


def test_losses_keep_momenta_and_are_what_the_meter_shows():
    scene = loose(OBLIQUE, **STICKY, solver__method='leapfrog', solver__step=2e-6)
    simulation = ico.compile_scene(scene)
    before, start = momenta(scene, simulation.snapshot()), simulation.snapshot().energy
    lost = 0.0
    for time in np.linspace(0.0, 0.04, 300):
        simulation.advance_to(time)
        energy = simulation.snapshot().energy
        assert abs(energy['balance_error']) < 1e-4 * start['total']
        assert energy['dissipated'] >= lost - 1e-5 * start['total']
        lost = max(lost, energy['dissipated'])
    size = [scene.shell.mass * 1.0, scene.shell.mass * 1.0 * 0.06]
    for one, other, scale in zip(before, momenta(scene, simulation.snapshot()), size):
        assert np.abs(one - other).max() < 1e-12 * scale
    assert lost > 0.05 * start['total'] and simulation.status.contact_count == 0


def block(tilt, **changes):
    """Simulation of a shell on a face, on a plane that is inclined by `tilt` [rad]: gravity is."""
    scene = loose(
        contact__friction=0.4, contact__stiffness=1e4,
        gravity=[GRAVITY * np.sin(tilt), 0.0, -GRAVITY * np.cos(tilt)],
        **{**FLOOR, 'contact__damping': 100.0, **LEAPFROG, **changes})
    simulation = ico.compile_scene(scene)
    simulation.set_state(
        position=np.array([[0.0, 0.0, A * RHO - 0.05]]),
        orientation=Rotation.from_matrix(facing(np.eye(3), NORMALS[0], -UP)).as_quat()[None])
    return simulation


def test_a_block_sticks_without_creep_below_the_limit_and_slides_above():
    simulation = block(0.98 * np.arctan(0.4))
    simulation.advance_to(2.1)
    first = simulation.snapshot()
    simulation.advance_to(3.1)
    last = simulation.snapshot()
    assert 0.0 < first.position[0, 0] < 1e-3
    assert np.abs(last.position - first.position).max() < 1e-8 * A
    assert np.abs(last.linear_velocity).max() < 1e-9
    tilt = 1.02 * np.arctan(0.4)
    simulation = block(tilt)
    simulation.advance_to(0.5)
    first = simulation.snapshot()
    simulation.advance_to(0.7)
    found = (simulation.snapshot().linear_velocity[0] - first.linear_velocity[0]) / 0.2
    assert found == pytest.approx(
        [GRAVITY * (np.sin(tilt) - 0.4 * np.cos(tilt)), 0.0, 0.0], abs=1e-5 * GRAVITY)
    energy = simulation.snapshot().energy
    assert abs(energy['balance_error']) < 1e-3 * energy['dissipated']


def test_steps_follow_what_may_touch_alone():
    simulation = ico.compile_scene(loose(OBLIQUE, **STICKY, **LEAPFROG))
    steps = set()
    for time in np.linspace(0.0, 0.03, 200):
        simulation.advance_to(time)
        if simulation.status.touching().bodies.size:
            steps.add(simulation.status.step)
    # Neither the onset nor what else is near shortens them.
    assert len(steps) == 1
    rate = np.sqrt(simulation._driver.contact.phase.least_rate)
    assert 0.1 < steps.pop() * rate <= 0.8
    assert simulation.status.error_estimate > 0.0


def face_hits(height, **changes):
    """Simulation of a shell that falls on a face, at 3 m/s."""
    return ico.compile_scene(loose(
        ((0.2, 0.0, height), (0.1, 0.0, -3.0), (0.0, 0.0, 0.0),
         Rotation.from_matrix(facing(np.eye(3), NORMALS[0], -UP))), **FLOOR,
        **{**LEAPFROG, 'solver__tolerance': 1.0, **changes}))


def test_steps_become_longer_as_less_energy_moves_and_shorter_where_a_hit_swings_much():
    simulation = face_hits(-0.026, contact__damping=0.5, gravity=[0.0, 0.0, -GRAVITY])
    rate = np.sqrt(simulation._driver.contact.phase.least_rate)
    before = simulation.snapshot().energy['kinetic']
    assert 0.75 < rate * simulation.status.step <= 0.8
    ratios = []
    for time in np.linspace(0.0, 0.03, 301):
        simulation.advance_to(time)
        ratios.append(rate * simulation.status.step)
    # A face hits with all of the energy.
    assert 0.25 < min(ratios) < 0.6
    simulation.advance_to(1.5)
    assert simulation.snapshot().energy['kinetic'] < 0.05 * before
    assert 0.8 < rate * simulation.status.step <= 1.4
    assert abs(simulation.snapshot().energy['balance_error']) < 0.01 * before


def test_steps_that_are_taken_again_lead_to_the_same_bits_in_pieces(monkeypatch):
    again = []
    follow = MeasuredStep.follow_swing
    monkeypatch.setattr(MeasuredStep, 'follow_swing', lambda self: (
        again.append(self), follow(self)))
    ends = []
    for pieces in (1, 97):
        simulation = face_hits(-0.026)
        for time in np.linspace(0.0, 0.02, pieces + 1)[1:]:
            simulation.advance_to(time)
            simulation.snapshot()
            restored = face_hits(-0.026)
            restored.restore(Checkpoint.from_bytes(simulation.checkpoint().to_bytes()))
            simulation = restored
        ends.append(simulation)
        assert again
        again.clear()
    assert same_state(ends[0].snapshot(), ends[1].snapshot())


def test_steps_follow_how_stiff_what_touches_is():
    # The same shell and plane, by a face and by a vertex.
    found = []
    for up in (NORMALS[0], VERTICES[0] / np.linalg.norm(VERTICES[0])):
        simulation = ico.compile_scene(loose(contact__stiffness=1e4, **FLOOR, **LEAPFROG))
        height = A * float((VERTICES @ up).max()) - 0.05 - 1e-3 * A
        simulation.set_state(
            position=np.array([[0.0, 0.0, height]]),
            orientation=Rotation.from_matrix(facing(np.eye(3), up, -UP)).as_quat()[None])
        driver = simulation._driver
        phase, state, model = (
            driver.contact.phase, driver.trajectory.state, driver.trajectory.model)
        assert contact_look(phase.contacts, state.position, state.orientation)[2] == 1
        found.append(largest_stiffness(
            phase.contacts, state.position, model.inverse_mass, model.inverse_inertia, 1e300, 0.0,
            np.zeros(state.position.shape[1])) / (phase.setup.stiffness * model.inverse_mass))
    # delta is the overlap below a face, and rho / (rho + R) times it below a vertex.
    assert found[0] == pytest.approx(1.75, rel=2e-2)
    assert found[1] == pytest.approx(
        1.75 * (RHO / (RHO + np.linalg.norm(VERTICES[0]))) ** 2, rel=1e-6)


def test_what_contacts_keep_short_is_measured_and_searched_for_seldom(monkeypatch):
    simulation = block(0.0)
    simulation.set_state(
        position=simulation.snapshot().position, orientation=simulation.snapshot().orientation,
        linear_velocity=np.array([[0.5, 0.0, 0.0]]))
    simulation.advance_to(0.01)
    driver, counts = simulation._driver, {'measured': 0, 'search': 0}

    def count(owner, name):
        call = getattr(owner, name)

        def counted(*words, **more):
            counts[name] += 1
            return call(*words, **more)

        monkeypatch.setattr(owner, name, counted)

    count(driver.errors.probe, 'measured')
    count(driver.contact.phase, 'search')
    before = simulation.status.step_count
    simulation.advance_to(0.5)
    checks = (simulation.status.step_count - before) / driver.monitor.interval
    assert simulation.status.contact_count == 1 and checks > 20.0
    # What is measured behind the steps says how they err.
    assert counts['measured'] < 0.5 * checks
    assert 0.0 < driver.errors.touching.rate_with(driver.trajectory.step) < np.inf
    assert 0 < counts['search'] < 0.9 * checks


def test_auto_takes_it_for_many_loose_shells_and_loose_tolerances():
    lossy = {**STICKY, 'solver__method': 'auto'}
    for scene, tolerance, name in (
            (crowd(**lossy), LOOSE_CONTACTS, 'leapfrog'),
            (crowd(**lossy), 0.5 * LOOSE_CONTACTS, 'dop8'),
            (crowd(solver__method='auto'), 1.0, 'dop8'),
            (crowd(**{**lossy, 'contact__damping': 1000.0}), 1.0, 'dop8'),
            (loose(OBLIQUE, **lossy), 1.0, 'dop8')):
        simulation = ico.compile_scene(changed(scene, {'solver.tolerance': tolerance}))
        assert simulation.status.method_name == name, (name, tolerance)
        if name == 'leapfrog':
            assert 'loose shells' in simulation.status.method_reason
    # Without losses steps that end at each contact cost less, until there are more.
    assert choose_method(1.0, 1.0, contact='c', loose=MANY_FREE).name == 'leapfrog'
    assert choose_method(1.0, 1.0, contact='c', loose=MANY_FREE - 1).name == 'dop8'
    # Connected shells begin and cease to touch as often once there are thousands.
    assert choose_method(LOOSE_WOVEN, 1.0, contact='c', woven=MANY_WOVEN).name == 'leapfrog'
    assert choose_method(LOOSE_WOVEN, 1.0, losses='l', woven=MANY_WOVEN).name == 'leapfrog'
    assert choose_method(LOOSE_WOVEN, 1.0, contact='c', woven=MANY_WOVEN - 1).name == 'dop8'
    assert choose_method(0.5 * LOOSE_WOVEN, 1.0, contact='c', woven=MANY_WOVEN).name == 'dop8'
    assert choose_method(LOOSE_WOVEN, 1.0, woven=MANY_WOVEN).name != 'leapfrog'


@pytest.mark.parametrize('changes, name', [
    ({}, 'leapfrog'), ({'solver.tolerance': 0.5 * LOOSE_CONTACTS}, 'dop8'),
    ({'weave.connector_angle': -0.3}, 'dop8'), ({'contact.friction': 0.0}, 'dop8'),
    ({'contact.friction': 0.0, 'contact.damping': 1.0}, 'leapfrog'),
    ({'weave.size': [2, 2, 2]}, 'dop8')])
def test_auto_takes_it_for_dense_weaves_that_lose_energy(changes, name):
    simulation = ico.compile_scene(ico.Scene.from_parameters(
        {**DENSE, 'solver.tolerance': LOOSE_CONTACTS, **changes}))
    status = simulation.status
    assert status.method_name == status.touching_method == name
    is_crowded = 'face to face' in status.method_reason
    assert is_crowded == (name == 'leapfrog' or 'solver.tolerance' in changes)
    assert not is_crowded or f'solver.tolerance of {LOOSE_CONTACTS:g}' in status.method_reason


def test_no_other_method_takes_over_where_it_was_chosen_for_contacts():
    folds = ico.load_scene('folded_slab').with_changes({
        'weave.size': [16, 16, 16], 'connector.damping': 0.0, 'solver.tolerance': LOOSE_WOVEN})
    assert folds.body_count >= MANY_WOVEN
    status = ico.compile_scene(folds).status
    assert status.method_name == status.touching_method == 'leapfrog'


def test_a_dense_weave_on_a_floor_costs_few_evaluations_and_states_its_error():
    loose_run, exact = (ico.compile_scene(ico.Scene.from_parameters(
        {**DENSE, 'solver.tolerance': tolerance})) for tolerance in (0.1, 1e-6))
    for simulation in (loose_run, exact):
        simulation.advance_to(0.012)
    here, there = loose_run.snapshot(), exact.snapshot()
    turns = Rotation.from_quat(here.orientation).inv() * Rotation.from_quat(there.orientation)
    error = max(
        np.linalg.norm(here.position - there.position, axis=1).max() / A,
        turns.magnitude().max())
    # Collisions make errors a hundred times as large soon after.
    assert exact.status.error_estimate < 1e-3 * error
    assert error / 3.0 < loose_run.status.error_estimate < 3.0 * error
    assert loose_run.status.error_estimate_lacks
    status = loose_run.status
    assert status.evaluation_count + status.estimation_count < 4_500
    assert exact.status.evaluation_count > 20_000
    loose_run.advance_to(0.03)
    assert status.contact_count > 4
    assert status.evaluation_count + status.estimation_count < 10_000
    assert 0.0 < status.deepest_overlap < 0.01 * A
    assert status.balance.error_in_parts < 0.01


def test_the_bits_are_the_same_in_pieces_from_checkpoints_and_for_any_mode():
    scene = loose(OBLIQUE, **STICKY, **LEAPFROG)
    auto, always = (
        ico.compile_scene(changed(scene, {'contact.mode': mode})) for mode in ('auto', 'always'))
    auto.advance_to(0.04)
    checkpoints = []
    for time in np.linspace(0.02, 0.04, 121):
        always.advance_to(time)
        always.snapshot()
        checkpoints.append(always.checkpoint())
    assert same_state(auto.snapshot(), always.snapshot())
    assert auto.snapshot().energy == always.snapshot().energy
    assert auto.status.error_estimate == always.status.error_estimate
    stretched = 0
    for checkpoint in checkpoints[::4]:
        again = ico.compile_scene(changed(scene, {'contact.mode': 'always'}))
        again.restore(Checkpoint.from_bytes(checkpoint.to_bytes()))
        stretched += bool(again._driver.contact.phase.stretches.state_tree()['rows'].any())
        again.advance_to(0.04)
        assert same_state(again.snapshot(), always.snapshot())
        assert again.snapshot().energy == always.snapshot().energy
        assert again.checkpoint().difference(always.checkpoint()) == ''
    assert stretched > 0


def test_a_crowd_is_the_same_bits_for_any_threads(monkeypatch):
    scene, ends = changed(crowd(**STICKY), {
        'solver.method': 'leapfrog', 'solver.tolerance': 0.1, 'contact.stiffness': 1e6}), []
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1)
    for count in (1, 2):
        monkeypatch.setattr(thread_team, 'core_count', lambda count=count: count)
        simulation = ico.compile_scene(scene)
        before, start = momenta(scene, simulation.snapshot()), simulation.snapshot().energy
        simulation.advance_to(0.04)
        ends.append(simulation.snapshot())
        for one, other, size in zip(before, momenta(scene, ends[-1]), (1.0, 0.1)):
            assert np.abs(one - other).max() < 1e-12 * 27 * scene.shell.mass * size
        assert abs(ends[-1].energy['balance_error']) < 0.01 * start['total']
        assert ends[-1].energy['dissipated'] > 0.05 * start['total']
    assert same_state(*ends) and ends[0].energy == ends[1].energy


def test_a_look_between_checks_leaves_springs_of_friction_as_they_are(monkeypatch):
    retraced = []
    retrace = TrialSteps.retrace
    monkeypatch.setattr(TrialSteps, 'retrace', lambda self, *given: (
        retraced.append(given), retrace(self, *given)))
    # Two that graze each other, and far away one that is pulled so fast that looks go through
    # the steps between two checks.
    scene = loose(
        ((0.0, -1.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.0)),
        ((0.0325, -1.0, 0.0), (-0.3, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, 1.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        contact__stiffness=200.0, contact__friction=0.5, groups__far='ids 3',
        loads__pull__group='far', solver__method='leapfrog', solver__step=1e-3)
    force = (0.0, 0.0, 3e4 * scene.shell.mass)
    whole, looked_at = ico.compile_scene(scene), ico.compile_scene(scene)
    for simulation in (whole, looked_at):
        simulation.apply_wrench('pull', force)
    whole.advance_to(0.03)
    known = len(retraced)
    for time in np.linspace(0.0, 0.03, 61):
        looked_at.advance_to(time)
        looked_at.snapshot()
    assert len(retraced) > known + 10
    assert same_state(whole.snapshot(), looked_at.snapshot())
    assert whole.snapshot().energy['dissipated'] > 0.0
