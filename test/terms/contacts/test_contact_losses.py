# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Contacts that take energy from the motion: damping and friction in simulations."""

from contact_poses import facing, NORMALS, RHO, touch_floor, VERTICES
from contact_scenes import A, crowd, loose, momenta, OBLIQUE
from fabrics import changed, same_state
import icofabric_sim as ico
from icofabric_sim import contact
from icofabric_sim.commands.run_summary import step_reason
from icofabric_sim.kernels.runtime.team import flag_count
from icofabric_sim.messages import decode_diagnostic_array
from icofabric_sim.running.diagnostics import HealthReport
from icofabric_sim.running.runner import Runner
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.stepping import thread_team
from icofabric_sim.terms.contacts.force import part_of, touch_some
from icofabric_validation.benchmarks import pile
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

UP = np.array([0.0, 0.0, 1.0])
ON_VERTEX = facing(np.eye(3), VERTICES[0], -UP)
ON_FACE = facing(np.eye(3), NORMALS[0], -UP)
GRAVITY = 9.81
FLOOR = {'planes__floor__normal': [0.0, 0.0, 1.0], 'planes__floor__offset': -0.05}


def dropped_on_vertex(speed, **changes):
    """A shell that comes down on a vertex, 1 mm above the floor."""
    height = A * np.linalg.norm(VERTICES[0])
    return loose(
        ((0.2, 0.0, -0.049 + height), (0.0, 0.0, -speed), (0.0, 0.0, 0.0),
         Rotation.from_matrix(ON_VERTEX)), **FLOOR, **changes)


@pytest.mark.parametrize('wanted, speed', [(0.98, 1.0), (0.8, 0.3), (0.5, 1.0), (0.1, 2.0)])
def test_a_collision_in_one_point_has_the_restitution_that_its_damping_is_for(wanted, speed):
    out = touch_floor(UP, 0.0, (np.linalg.norm(VERTICES[0]) - 1e-3) * UP, ON_VERTEX)[1]
    share = out[10] / 1e-3
    damping = contact.damping_for(wanted, share * speed)
    simulation = ico.compile_scene(dropped_on_vertex(speed, contact__damping=damping))
    before = simulation.snapshot().energy['total']
    simulation.advance_to(0.03 / speed)
    snapshot = simulation.snapshot()
    assert snapshot.linear_velocity[1, 2] == pytest.approx(wanted * speed, rel=1e-7)
    assert np.abs(snapshot.linear_velocity[1, :2]).max() < 1e-12 * speed
    energy = snapshot.energy
    # Next to the formula, the slider that damps slow contacts takes 7e-8 of the energy.
    assert energy['dissipated'] == pytest.approx(
        (1.0 - wanted**2) * before, abs=1e-7 * before)
    # The kink at first touch, sharper with damping: velocities may err by solver.tolerance, 1e-6 a
    # per second, so energies by twice that over the speed.
    assert abs(energy['balance_error']) < (1e-7 if wanted < 0.5 else 2e-6 * A / speed) * before
    assert energy['contact'] == 0.0 and simulation.status.deepest_overlap > 1e-3 * A


def test_damped_collisions_keep_momenta_and_lose_what_the_meter_shows():
    scene = loose(OBLIQUE, contact__damping=1.0)
    simulation = ico.compile_scene(scene)
    before, start = momenta(scene, simulation.snapshot()), simulation.snapshot().energy
    lost = [0.0]
    for time in np.linspace(0.0, 0.07, 300):
        simulation.advance_to(time)
        energy = simulation.snapshot().energy
        # Also within steps, and nothing is ever gained.
        assert abs(energy['balance_error']) < 1e-9 * start['total']
        assert energy['dissipated'] >= lost[-1] - 1e-9 * start['total']
        lost.append(energy['dissipated'])
    after = momenta(scene, simulation.snapshot())
    size = [scene.shell.mass * 1.0, scene.shell.mass * 1.0 * 0.06]
    for one, other, scale in zip(before, after, size):
        assert np.abs(one - other).max() < 1e-12 * scale
    assert lost[-1] > 0.05 * start['total'] and simulation.status.contact_count == 0


def test_auto_and_always_are_the_same_bits_also_in_pieces_and_from_checkpoints():
    scene = loose(OBLIQUE, contact__damping=1.0)
    auto, always = (
        ico.compile_scene(changed(scene, {'contact.mode': mode})) for mode in ('auto', 'always'))
    auto.advance_to(0.06)
    checkpoints = []
    for time in np.linspace(0.0, 0.06, 37):
        always.advance_to(time)
        always.snapshot()
        checkpoints.append(always.checkpoint())
    assert same_state(auto.snapshot(), always.snapshot())
    assert auto.snapshot().energy == always.snapshot().energy
    touching = 0
    for checkpoint in checkpoints[::4]:
        again = ico.compile_scene(changed(scene, {'contact.mode': 'always'}))
        again.restore(Checkpoint.from_bytes(checkpoint.to_bytes()))
        touching += again.snapshot().energy['contact'] > 0.0
        again.advance_to(0.06)
        assert same_state(again.snapshot(), always.snapshot())
        assert again.checkpoint().difference(always.checkpoint()) == ''
    assert always.snapshot().energy['dissipated'] > 0.0


@pytest.mark.long
def test_a_damped_press_does_work_that_is_found_again():
    # Driven down onto a loose shell that lies on the floor, and up again.
    scene = loose(
        ((0.0, 0.0, 0.0335), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        planes__floor__normal=[0.0, 0.0, 1.0], planes__floor__offset=-0.0165,
        groups__press='ids 1', drives__press__group='press', drives__press__motion='sine',
        drives__press__linear=[0.0, 0.0, 1.7e-3], drives__press__frequency=40.0,
        contact__damping=3.0)
    simulation = ico.compile_scene(scene)
    touched, lost = 0, 0.0
    for time in np.linspace(0.0, 0.05, 60):
        simulation.advance_to(time)
        energy = simulation.snapshot().energy
        touched += energy['contact'] > 0.0
        assert energy['dissipated'] >= lost - 1e-12
        lost = energy['dissipated']
        assert abs(energy['balance_error']) < 5e-8 * max(energy['work_in'], 1e-4)
    assert touched > 3 and lost > 1e-5


def test_methods_that_cannot_are_refused():
    with pytest.raises(ico.ParameterError) as caught:
        ico.compile_scene(loose(OBLIQUE, contact__damping=1.0, solver__method='srkn4'))
    for part in ('solver.method', 'contact.damping', 'dop8, leapfrog or auto'):
        assert part in str(caught.value)
    simulation = ico.compile_scene(loose(OBLIQUE, contact__damping=1.0, solver__method='auto'))
    assert simulation.status.method_name == 'dop8'
    assert 'contact.damping' in simulation.status.method_reason
    # Where nothing touches nothing is damped.
    ico.compile_scene(loose(
        OBLIQUE, contact__damping=1.0, contact__mode='never', solver__method='srkn4'))
    with pytest.raises(ico.ParameterError, match='contact.friction'):
        ico.compile_scene(loose(OBLIQUE, contact__friction=0.5, solver__method='srkn6'))
    # No method of order 2 can follow what connectors lose.
    with pytest.raises(ico.ParameterError, match='drag.linear'):
        ico.compile_scene(loose(
            OBLIQUE, contact__friction=0.5, drag__linear=1.0, solver__method='leapfrog'))
    for name in ('contact__damping', 'contact__friction'):
        with pytest.raises(ico.ParameterError, match=name.replace('__', '.')):
            loose(OBLIQUE, **{name: -1.0})


def test_what_is_not_damped_has_no_losses():
    free, damped = (
        ico.compile_scene(loose(
            ((0.0323, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), contact__damping=damping))
        for damping in (0.0, 1.0))
    contacts = [each._driver.trajectory.model.contacts for each in (free, damped)]
    assert contacts[0].losses is None and contacts[1].losses is not None
    assert free._driver.trajectory.work.spent is None
    # A given step knows its damping.
    assert damped.status.stability_limit < free.status.stability_limit


def block(tilt, friction, *, spin=0.0, **changes):
    """Simulation of a shell on a face, on a plane that is inclined by `tilt` [rad]: gravity is."""
    scene = loose(
        contact__friction=friction, contact__stiffness=1e4,
        gravity=[GRAVITY * np.sin(tilt), 0.0, -GRAVITY * np.cos(tilt)],
        **{**FLOOR, 'contact__damping': 100.0, 'solver__tolerance': 1e-6, **changes})
    simulation = ico.compile_scene(scene)
    simulation.set_state(
        position=np.array([[0.0, 0.0, A * RHO - 0.05]]),
        orientation=Rotation.from_matrix(ON_FACE).as_quat()[None],
        angular_velocity=np.array([[0.0, 0.0, spin]]))
    return simulation


@pytest.mark.parametrize('part', [0.5, 0.95])
def test_a_block_on_an_incline_stays_and_does_not_creep(part):
    simulation = block(np.arctan(part * 0.4), 0.4)
    simulation.advance_to(2.1)
    first = simulation.snapshot()
    simulation.advance_to(3.1)
    last = simulation.snapshot()
    # It has moved by what the spring gives, and moves no more.
    weight = simulation.scene.shell.mass * GRAVITY * np.sin(np.arctan(part * 0.4))
    assert 0.0 < weight / (2e4 / 7.0) < first.position[0, 0] < 2e-4
    assert np.abs(last.position - first.position).max() < 1e-10 * A
    assert np.abs(last.linear_velocity).max() < 1e-10
    assert np.abs(last.angular_velocity).max() < 1e-8
    assert abs(last.energy['balance_error']) < 1e-6 * last.energy['dissipated']
    # The springs of friction hold some of the energy.
    losses = simulation._driver.trajectory.model.contacts.losses
    assert weight == pytest.approx(
        losses.friction_stiffness * np.linalg.norm(losses.stretch[:, :3]), rel=1e-3)


def test_a_return_to_the_saved_state_returns_the_springs_of_friction():
    simulation = block(np.arctan(0.2), 0.4, solver__method='leapfrog', solver__step=1e-4)
    trajectory, seen = simulation._driver.trajectory, {}
    while len(seen) < 30 or not 0.0 < trajectory.saved_time < simulation.time:
        assert simulation.advance_steps(1) == 1
        seen[simulation.time] = trajectory.state.position.copy(), trajectory.stretches().copy()
    (place, stretch), (_, last) = seen[trajectory.saved_time], seen[simulation.time]
    assert np.abs(last - stretch).max() > 1e-3 * np.abs(stretch).max() > 0.0
    trajectory.return_to_saved()
    np.testing.assert_array_equal(trajectory.state.position, place)
    np.testing.assert_array_equal(trajectory.stretches(), stretch)


@pytest.mark.parametrize('part', [1.05, 2.0])
def test_above_the_limit_it_slides_with_what_is_left_of_its_weight(part):
    tilt = np.arctan(part * 0.4)
    simulation = block(tilt, 0.4)
    simulation.advance_to(0.3)
    before = simulation.snapshot()
    simulation.advance_to(0.5)
    after = simulation.snapshot()
    found = (after.linear_velocity[0] - before.linear_velocity[0]) / 0.2
    expected = GRAVITY * (np.sin(tilt) - 0.4 * np.cos(tilt))
    assert found == pytest.approx([expected, 0.0, 0.0], abs=1e-6 * GRAVITY)
    way = after.position[0, 0] - before.position[0, 0]
    lost = 0.4 * simulation.scene.shell.mass * GRAVITY * np.cos(tilt) * way
    assert after.energy['dissipated'] - before.energy['dissipated'] == pytest.approx(
        lost, rel=1e-6)
    assert abs(after.energy['balance_error']) < 1e-9 * lost


def test_a_block_that_spins_on_its_face_stops():
    simulation = block(0.0, 0.4, spin=30.0)
    scene = simulation.scene
    radius = 2.0 / 3.0 * np.sqrt(np.sqrt(3.0) / np.pi) * A
    deceleration = 0.4 * scene.shell.mass * GRAVITY * radius / scene.shell.inertia
    spins = []
    for time in (0.05, 0.1, 30.0 / deceleration + 1.0):
        simulation.advance_to(time)
        spins.append(simulation.snapshot().angular_velocity[0, 2])
    assert (spins[0] - spins[1]) / 0.05 == pytest.approx(deceleration, rel=2e-3)
    assert 5.0 < spins[1] < spins[0] < 30.0 and abs(spins[2]) < 2e-3
    energy = simulation.snapshot().energy
    assert abs(energy['balance_error']) < 1e-8 * energy['dissipated']


def test_steps_of_one_length_in_pieces_give_the_same_bits():
    ends = []
    for pieces in (1, 7):
        simulation = block(np.arctan(0.3), 0.4, spin=5.0, solver__step=4e-5, contact__damping=10.0)
        for piece in range(pieces):
            simulation.advance_to(0.02 * (piece + 1) / pieces)
            energy = simulation.snapshot().energy
            assert abs(energy['balance_error']) < 1e-6 * energy['dissipated']
        ends.append(simulation.snapshot())
    assert same_state(*ends) and ends[0].energy == ends[1].energy
    assert ends[0].energy['dissipated'] > 0.0


def test_what_slides_through_a_collision_is_pushed_back_by_its_part():
    # The impulse along the floor is mu times that across it.
    simulation = ico.compile_scene(loose(
        contact__friction=0.1, contact__damping=0.3, **FLOOR))
    height = A * np.linalg.norm(VERTICES[0])
    simulation.set_state(
        position=np.array([[0.0, 0.0, height - 0.049]]),
        orientation=Rotation.from_matrix(ON_VERTEX).as_quat()[None],
        linear_velocity=np.array([[1.2, -0.5, -1.0]]))
    simulation.advance_to(0.004)
    change = simulation.snapshot().linear_velocity[0] - [1.2, -0.5, -1.0]
    assert change[2] > 1.2
    assert np.linalg.norm(change[:2]) == pytest.approx(0.1 * change[2], rel=1e-6)
    assert change[:2] / np.linalg.norm(change[:2]) == pytest.approx(
        np.array([-1.2, 0.5]) / 1.3, abs=1e-3)
    assert simulation.status.contact_count == 0
    # Nothing is left of the stretch once it has gone.
    losses = simulation._driver.contact.phase.stretches.state_tree()
    assert not losses['rows'].any()
    turned = simulation.snapshot().angular_velocity[0]
    arm = -height * UP
    expected = simulation.scene.shell.mass * np.cross(arm, change) / (
        simulation.scene.shell.inertia)
    assert turned == pytest.approx(expected, rel=0.04, abs=0.04 * np.linalg.norm(expected))


STICKY = {'contact__damping': 0.5, 'contact__friction': 0.6}


def test_collisions_with_friction_keep_momenta_and_never_gain():
    scene = loose(OBLIQUE, **STICKY)
    simulation = ico.compile_scene(scene)
    before, start = momenta(scene, simulation.snapshot()), simulation.snapshot().energy
    lost, most = 0.0, 0.0
    for time in np.linspace(0.0, 0.07, 600):
        simulation.advance_to(time)
        energy = simulation.snapshot().energy
        assert abs(energy['balance_error']) < 1e-8 * start['total']
        assert energy['dissipated'] >= lost - 1e-9 * start['total']
        lost, most = max(lost, energy['dissipated']), max(most, energy['contact'])
    after = momenta(scene, simulation.snapshot())
    size = [scene.shell.mass * 1.0, scene.shell.mass * 1.0 * 0.06]
    for one, other, scale in zip(before, after, size):
        assert np.abs(one - other).max() < 1e-12 * scale
    assert lost > 0.05 * start['total'] and most > 0.05 * start['total']
    # Without friction it ends elsewhere.
    smooth = ico.compile_scene(changed(scene, {'contact.friction': 0.0}))
    smooth.advance_to(0.07)
    spin = smooth.snapshot().angular_velocity - simulation.snapshot().angular_velocity
    assert np.abs(spin).max() > 1.0


def test_a_collision_with_friction_is_the_same_seen_from_another_frame():
    ends = []
    frame, drift = Rotation.from_rotvec([0.4, -1.1, 0.7]), np.array([0.3, -0.2, 0.5])
    for turn, add in ((Rotation.identity(), np.zeros(3)), (frame, drift)):
        place, velocity, spin, turned = OBLIQUE
        simulation = ico.compile_scene(loose(
            ((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), **STICKY))
        simulation.set_state(
            position=turn.apply([(0.0, 0.0, 0.0), place]),
            orientation=np.array([turn.as_quat(), (turn * turned).as_quat()]),
            linear_velocity=turn.apply([(0.0, 0.0, 0.0), velocity]) + add,
            angular_velocity=turn.apply([(0.0, 0.0, 0.0), spin]))
        simulation.advance_to(0.04)
        snapshot = simulation.snapshot()
        ends.append((
            turn.inv().apply(snapshot.linear_velocity - add),
            A * turn.inv().apply(snapshot.angular_velocity.copy()), snapshot.energy['dissipated']))
    for one, other in zip(*ends):
        assert one == pytest.approx(other, rel=1e-5, abs=1e-5)


def test_stretches_are_part_of_checkpoints_and_forgotten_by_a_reset():
    scene = loose(OBLIQUE, **STICKY)
    auto, always = (
        ico.compile_scene(changed(scene, {'contact.mode': mode})) for mode in ('auto', 'always'))
    auto.advance_to(0.045)
    checkpoints = []
    for time in np.linspace(0.0, 0.045, 73):
        always.advance_to(time)
        always.snapshot()
        checkpoints.append(always.checkpoint())
    assert same_state(auto.snapshot(), always.snapshot())
    assert auto.snapshot().energy == always.snapshot().energy
    stretched = 0
    for checkpoint in checkpoints[::4]:
        again = ico.compile_scene(changed(scene, {'contact.mode': 'always'}))
        again.restore(Checkpoint.from_bytes(checkpoint.to_bytes()))
        stretched += bool(again._driver.contact.phase.stretches.state_tree()['rows'].any())
        again.advance_to(0.045)
        assert same_state(again.snapshot(), always.snapshot())
        assert again.snapshot().energy == always.snapshot().energy
        assert again.status.contact_tests == always.status.contact_tests > 0
        assert again.checkpoint().difference(always.checkpoint()) == ''
    assert stretched > 0
    stuck = next(
        checkpoint for checkpoint in checkpoints
        if any(name.endswith('stretches.rows') and rows.any()
               for name, rows in checkpoint.arrays.items()))
    again.restore(stuck)
    again.reset()
    assert not again._driver.contact.phase.stretches.state_tree()['rows'].any()
    # A checkpoint with pairs that are not there is refused.
    arrays = {name: rows + 7.0 if name.endswith('stretches.pairs') else rows
              for name, rows in stuck.arrays.items()}
    with pytest.raises(ValueError, match='stretches'):
        again.restore(Checkpoint(stuck.header, arrays))


@pytest.mark.parametrize('changes, until, least', [
    ({'contact__damping': 2.0}, 0.06, 0.1), (STICKY, 0.04, 0.05)])
def test_a_crowd_that_loses_energy_is_the_same_bits_for_any_threads(
        changes, until, least, monkeypatch):
    scene, ends = crowd(**changes), []
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1)
    for count in (1, 2):
        monkeypatch.setattr(thread_team, 'core_count', lambda count=count: count)
        simulation = ico.compile_scene(scene)
        before, start = momenta(scene, simulation.snapshot()), simulation.snapshot().energy
        simulation.advance_to(until)
        ends.append(simulation.snapshot())
        for one, other, size in zip(before, momenta(scene, ends[-1]), (1.0, 0.1)):
            assert np.abs(one - other).max() < 1e-12 * 27 * scene.shell.mass * size
        assert abs(ends[-1].energy['balance_error']) < 1e-6 * start['total']
        assert ends[-1].energy['dissipated'] > least * start['total']
    assert same_state(*ends) and ends[0].energy == ends[1].energy


def test_a_thread_knows_the_parts_it_took_and_no_other():
    # What another thread holds may still bear the note of an evaluation before.
    simulation = ico.compile_scene(crowd(contact__damping=2.0, solver__threads=1))
    simulation.advance_to(0.03)
    driver = simulation._driver
    contacts, state = driver.trajectory.model.contacts, driver.trajectory.state
    count, flags = len(contacts.pairs), np.zeros(flag_count(2), np.int64)
    parts = -(-count // part_of(count, 2))
    assert parts > 2

    def taken():
        touch_some(
            contacts, state.position, state.orientation, contacts.scratch, contacts.result.copy(),
            contacts.sleep.until.copy(), 0.0, flags, 0, 2)
        chain, number = [], contacts.latest[0]
        while number >= 0:
            chain.append(int(number))
            number = contacts.earlier[number]
        return sorted(chain)

    assert taken() == list(range(parts))
    # The second thread has taken the first part of its run, and no more.
    flags[:] = 0
    flags[40 + 8] = 1
    assert taken() == [number for number in range(parts) if number != parts // 2]
    assert taken() == []


@pytest.mark.parametrize('size, friction, damping, drag, calm', [
    ((3, 3, 4), 0.4, 5.0, 0.0, 0.0),
    # Without friction only the drag [1/s] ends that bodies slide along each other.
    pytest.param((1, 1, 10), 0.0, 10.0, 20.0, 1e-3, marks=pytest.mark.long)],
    ids=['friction', 'walls'])
def test_a_pile_comes_to_rest(size, friction, damping, drag, calm):
    shell = pile.pile(size).shell
    simulation = ico.compile_scene(pile.pile(size, **{
        'contact.friction': friction, 'contact.damping': damping,
        'drag.linear': drag * shell.mass, 'drag.angular': drag * shell.inertia}))
    seen, simulation = pile.come_to_rest(simulation, calm, 2.5)
    assert seen['rested'] and seen['kinetic'] < 1e-6
    assert 1e-3 < seen['deepest'] < 0.01 and abs(seen['balance']) < 0.01
    # Nothing has passed through anything.
    snapshot = simulation.snapshot()
    first, second = np.triu_indices(simulation.scene.body_count, 1)
    gaps = contact.separation(
        A, (snapshot.position[first], snapshot.orientation[first]),
        (snapshot.position[second], snapshot.orientation[second])).distance
    assert gaps.min() > -0.01 * A and seen['outside'] < 0.01
    assert simulation.status.contact_count > simulation.scene.body_count


def test_a_pile_without_losses_keeps_its_energy():
    simulation = ico.compile_scene(pile.pile(
        (3, 3, 4), **{'contact.friction': 0.0, 'contact.damping': 0.0, 'contact.stiffness': 1e7,
                      'solver.tolerance': 1e-6}))
    peak, met = 0.0, 0
    for time in np.linspace(0.01, 0.4, 40):
        simulation.advance_to(time)
        energy = simulation.snapshot().energy
        peak = max(peak, energy['kinetic'])
        met += energy['contact'] > 0.0
        assert abs(energy['balance_error']) < 1e-6 * peak
    # They still bounce.
    assert met > 5 and energy['kinetic'] > 0.3 * peak
    assert 0.0 < simulation.status.deepest_overlap < 0.01 * A and pile.outside(simulation) < 0.01


def test_no_limit_is_said_of_steps_that_follow_their_error():
    scene = dropped_on_vertex(1.0, contact__damping=1000.0, contact__mode='always')
    simulation = ico.compile_scene(scene)
    # What a contact might ask for some time is far shorter than steps that are right.
    assert simulation.status.method_name == 'dop8'
    assert simulation.status.step > 100.0 * simulation.status.stability_limit
    said = step_reason(simulation)
    assert 'limit' not in said and 'adapted to the error' in said
    status = Runner(simulation, []).status()
    _, [reported] = decode_diagnostic_array(HealthReport('/icofabric').bytes(status))
    assert 'beyond the stability limit' not in reported.values['reasons']
    assert dict(reported.values)['stability margin'] == 'inf'
    # A given step has one.
    given = ico.compile_scene(changed(scene, {'solver.step': 1e-7}))
    assert f'the limit is {given.status.stability_limit:.6g} s' in step_reason(given)
    assert Runner(given, []).status().limit == given.status.stability_limit


def test_errors_of_given_steps_are_measured_while_what_is_near_changes():
    """Springs of friction are those of pairs; the list of pairs is another one a moment later."""
    scene = ico.Scene.from_parameters({
        'weave.size': [3, 1, 3], 'weave.variant': 2, 'weave.connector_angle': 0.29,
        'shell.edge_length': 0.0173, 'shell.thickness': 0.0092, 'shell.density': 675.0,
        'connector.stiffness': 36.0, 'connector.natural_length': 0.0385, 'contact.mode': 'always',
        'contact.stiffness': 580.0, 'contact.damping': 0.043, 'contact.friction': 0.5,
        'initial_random.velocity_sigma': 0.00016, 'initial_random.spin_sigma': 0.142,
        'initial_random.seed': 1514814881, 'solver.method': 'dop8', 'solver.threads': 1,
        'solver.step': 1e-3})
    simulation, most = ico.compile_scene(scene), 0
    for end in np.linspace(0.0, 0.8, 81)[1:]:
        simulation.advance_to(float(end))
        most = max(most, len(simulation.status.touching().bodies))
    energy = simulation.snapshot().energy
    assert most >= 2 and energy['dissipated'] > 0.1 * energy['total']
    assert 1e-6 < simulation.error_estimate < 1e-2
    assert abs(energy['balance_error']) < 1e-3 * energy['total']
