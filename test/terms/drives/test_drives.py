# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Driven bodies: their paths, the work that the paths do, what takes over, what is refused."""

import math

from analytical import free_rotation, rotation_quaternion
from balance_orders import require_fourth_order
from fabrics import changed, FORMS, make_scene, pair_face_to_face, RANDOM, same_state
import icofabric_sim as ico
import numpy as np
import pytest

LINEAR, ANGULAR = np.array([0.4, -0.2, 0.3]), np.array([3.0, 5.0, -2.0])


def driven(motion, changes=None, size=(3, 2, 2), **fields):
    return make_scene(size, {
        'groups.wall': 'x_min', 'drives.wall.group': 'wall', 'drives.wall.motion': motion,
        'contact.mode': 'never', 'solver.method': 'srkn4',
        **{f'drives.wall.{name}': value for name, value in fields.items()}, **(changes or {})},
        **RANDOM)


def expected(scene, shift, rotation, velocity, spin):
    """
    Places, orientations and velocities of the driven bodies after a rigid motion of the group.
    """
    drive, start = scene.drives['wall'], scene.initial
    turn = rotation_quaternion(np.array([rotation]))[0]
    first = start.orientation[drive.bodies]
    v, w = turn[:3], turn[3]
    orientation = np.hstack([
        w * first[:, :3] + first[:, 3:] * v + np.cross(v, first[:, :3]),
        w * first[:, 3:] - first[:, :3] @ v[:, None]])
    arms = start.position[drive.bodies] - start.position[drive.bodies].mean(axis=0)
    t = 2.0 * np.cross(v, arms)
    arms = arms + w * t + np.cross(v, t)
    middle = start.position[drive.bodies].mean(axis=0) + shift
    spins = np.tile(spin, (len(arms), 1))
    return middle + arms, orientation, velocity + np.cross(spin, arms), spins


def compare(scene, snapshot, *wanted, rel=1e-12):
    bodies = scene.drives['wall'].bodies
    got = snapshot.position, snapshot.orientation, snapshot.linear_velocity, (
        snapshot.angular_velocity)
    for values, wish in zip(got, wanted):
        np.testing.assert_allclose(
            values[bodies], wish, rtol=0, atol=rel * max(1.0, float(np.abs(wish).max())))


@pytest.mark.parametrize('method, form', [
    *(pytest.param('srkn4', form, marks=pytest.mark.long) for form in FORMS), ('dop8', FORMS[0])])
def test_bodies_are_where_their_path_says(method, form):
    scene = driven('velocity', {'solver.method': method}, linear=LINEAR.tolist(),
                   angular=ANGULAR.tolist(), start=0.001, duration=0.01)
    simulation = ico.compile_scene(scene, rotation=form)
    for time in (0.0007, 0.004, 0.0093, 0.02):
        simulation.advance_to(time)
        t = min(max(time - 0.001, 0.0), 0.01)
        moving = 0.001 < time < 0.011
        wanted = list(expected(
            scene, LINEAR * t, ANGULAR * t, LINEAR * moving, ANGULAR * moving))
        snapshot = simulation.snapshot()
        # A quaternion and its negative are one orientation.
        bodies = scene.drives['wall'].bodies
        wanted[1] = wanted[1] * np.sign((wanted[1] * snapshot.orientation[bodies]).sum(axis=1))[
            :, None]
        compare(scene, snapshot, *wanted)
    free = np.setdiff1d(np.arange(scene.body_count), bodies)
    still = driven('hold')
    assert np.abs(snapshot.position - still.initial.position)[free].max() > 1e-4


def test_bodies_are_on_their_path_where_connectors_cross_kinks():
    scene = driven('velocity', {
        'solver.step': 2e-4, 'connector.stiffness_extension': 800.0,
        'connector.stiffness_compression': 100.0}, linear=LINEAR.tolist(), duration=1.0)
    simulation, bodies = ico.compile_scene(scene), scene.drives['wall'].bodies
    for _ in range(40):
        simulation.advance_steps(1)
        np.testing.assert_allclose(
            simulation.snapshot().position[bodies],
            scene.position[bodies] + LINEAR * simulation.time, rtol=0, atol=1e-14)
    # Crossings add evaluations.
    status = simulation.status
    assert status.evaluation_count > status.step_count * status.stage_count + 10


def test_ramp_and_sine_move_as_their_formulas():
    scene = driven('ramp', linear=LINEAR.tolist(), duration=0.01)
    simulation = ico.compile_scene(scene)
    for time, way, part in ((0.004, 0.0008, 0.4), (0.015, 0.005 + 0.005, 1.0)):
        simulation.advance_to(time)
        compare(scene, simulation.snapshot(), *expected(
            scene, LINEAR * way, np.zeros(3), LINEAR * part, np.zeros(3)))
    amplitude, turn = np.array([0.004, 0.0, -0.002]), np.array([0.0, 0.3, 0.0])
    scene = driven('sine', linear=amplitude.tolist(), angular=turn.tolist(), frequency=40.0,
                   phase=0.3)
    simulation = ico.compile_scene(scene)
    for time in (0.0, 0.0031, 0.011):
        simulation.advance_to(time)
        x, rate = 2.0 * math.pi * 40.0 * time + 0.3, 2.0 * math.pi * 40.0
        part, speed = math.sin(x) - math.sin(0.3), rate * math.cos(x)
        compare(scene, simulation.snapshot(), *expected(
            scene, amplitude * part, turn * part, amplitude * speed, turn * speed), rel=1e-11)


def test_a_table_of_velocities_is_integrated(tmp_path):
    times = np.array([0.0, 0.003, 0.004, 0.01])
    speeds = np.array([
        [0.0, 0.0, 0.0], [0.4, 0.0, -0.2], [0.4, 0.1, 0.0], [-0.2, 0.1, 0.3]])
    axis, spins = np.array([0.6, 0.0, -0.8]), np.array([0.0, 30.0, -10.0, 5.0])
    path = tmp_path / 'velocities.csv'
    path.write_text(''.join(
        ', '.join(map(repr, [float(value) for value in (time, *speed, *(spin * axis))])) + '\n'
        for time, speed, spin in zip(times, speeds, spins)))
    scene = driven('velocity_table', file=str(path), start=0.001)
    simulation = ico.compile_scene(scene)
    for time in (0.0005, 0.0035, 0.008, 0.015):
        simulation.advance_to(time)
        # The trapezoidal rule is exact between rows.
        grid = np.unique(np.clip([*times, time - 0.001], 0.0, max(time - 0.001, 0.0)))
        rates = np.column_stack([
            np.interp(grid, times, column) for column in (*speeds.T, spins)])
        place = (0.5 * (rates[1:] + rates[:-1]) * np.diff(grid)[:, None]).sum(axis=0)
        compare(scene, simulation.snapshot(), *expected(
            scene, place[:3], place[3] * axis, rates[-1, :3], rates[-1, 3] * axis), rel=1e-11)
    for text, words in (
            ('0, 0, 0, 0, 1, 0, 0\n1, 0, 0, 0, 0, 1, 0\n', 'have several axes'),
            ('0, 1e12, 0, 0\n1, 0, 0, 0\n', 'time steps resolve')):
        path.write_text(text)
        with pytest.raises(ico.ParameterError, match=words):
            driven('velocity_table', file=str(path))


@pytest.fixture
def table(tmp_path):
    path = tmp_path / 'path.csv'
    path.write_text(
        '# t, x, y, z, rx, ry, rz\n0.002, 0, 0, 0, 0, 0, 0\n0.005, 0.002, 0, 0.001, 0, 0.2, 0.1\n'
        '0.007, 0.001, 0.001, 0.001, 0.1, 0.2, -0.4\n0.012, 0.003, 0, 0, 0.5, 0, 0\n')
    return str(path)


def test_table_is_a_smooth_path_through_its_points(table):
    scene = driven('table', file=table, start=0.001)
    simulation = ico.compile_scene(scene)
    middle = scene.drives['wall'].middle
    bodies = scene.drives['wall'].bodies
    last, speeds = None, []
    for time in np.arange(0.0, 0.0145, 2.5e-5):
        simulation.advance_to(float(time))
        snapshot = simulation.snapshot()
        where = snapshot.position[bodies].mean(axis=0) - middle
        speeds.append(snapshot.linear_velocity[bodies].mean(axis=0))
        if last is not None:
            # The velocities are those of the places.
            way = 0.5 * (speeds[-1] + speeds[-2]) * 2.5e-5
            assert where - last == pytest.approx(way, abs=2e-8)
        last = where
        for t, x, y, z in ((0.003, 0, 0, 0), (0.006, 0.002, 0, 0.001),
                           (0.008, 0.001, 0.001, 0.001), (0.013, 0.003, 0, 0)):
            if abs(time - t) < 1e-9:
                assert where == pytest.approx([x, y, z], abs=1e-8)
    # C1: no jump in the velocity, also not where it begins and ends.
    speeds = np.array(speeds)
    assert np.abs(np.diff(speeds, axis=0)).max() < 0.06 < np.abs(speeds).max()
    assert not speeds[0].any() and not speeds[-1].any()


def test_shaken_oscillator():
    """
    A body on a spring whose other end moves by A sin(W t): x'' = -w^2 (x - A sin(W t)).

    From rest: x = A (W w sin(w t) - w^2 sin(W t)) / (W^2 - w^2) with w^2 = k/M (e.g. Den Hartog,
    Mechanical Vibrations, 1956, section 2.7).
    """
    flat = make_scene((2, 2, 1))
    distance = flat.geometry.cube_width + flat.connectors.natural_length
    position, orientation = pair_face_to_face(flat, distance)
    amplitude, rate = 1e-4, 700.0
    changes = {'groups.a': 'ids 0', 'groups.b': 'ids 1', 'drives.d.group': 'a',
               'drives.d.motion': 'sine', 'drives.d.linear': [amplitude, 0.0, 0.0],
               'drives.d.frequency': rate / (2.0 * math.pi), 'solver.method': 'srkn4',
               'contact.mode': 'never', 'solver.tolerance': 1e-8}
    for k, name in enumerate('ab'):
        q = orientation[k]
        angle = 2.0 * math.atan2(np.linalg.norm(q[:3]), q[3])
        vector = angle * q[:3] / max(np.linalg.norm(q[:3]), 1e-300)
        changes |= {
            f'initial.{name}.group': name, f'initial.{name}.rotation': vector.tolist(),
            f'initial.{name}.displacement': (position[k] - flat.position[k]).tolist()}
    scene = changed(flat, changes)
    simulation = ico.compile_scene(scene)
    own = math.sqrt(500.0 / scene.shell.mass)
    for time in np.linspace(0.0, 0.05, 12)[1:]:
        simulation.advance_to(float(time))
        snapshot = simulation.snapshot()
        x = amplitude * (rate * own * math.sin(own * time) - own**2 * math.sin(rate * time)) / (
            rate**2 - own**2)
        assert snapshot.position[1, 0] - position[1, 0] == pytest.approx(x, abs=1e-4 * amplitude)
    energy = snapshot.energy
    stored = 250.0 * amplitude**2
    assert abs(energy['work_in']) > 0.1 * stored
    assert abs(energy['balance_error']) < 1e-5 * stored


def test_lifting_against_gravity_takes_the_weight_times_the_height():
    scene = make_scene((2, 2, 1), {
        'gravity': [0.0, 0.0, -9.81], 'contact.mode': 'never', 'groups.g': 'all',
        'drives.up.group': 'g', 'drives.up.motion': 'velocity',
        'drives.up.linear': [0.1, 0.0, 0.5],
        'drives.up.start': 0.25, 'drives.up.duration': 1.0, 'solver.method': 'srkn4'})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(1.0)
    energy = simulation.snapshot().energy
    mass = scene.body_count * scene.shell.mass
    # And the speed that it is given, from a jump at the start.
    moving = 0.5 * mass * 0.26
    assert energy['work_in'] == pytest.approx(mass * 9.81 * 0.375 + moving, rel=1e-12)
    assert energy['kinetic'] == pytest.approx(moving, rel=1e-12)
    simulation.advance_to(2.0)
    energy = simulation.snapshot().energy
    assert energy['work_in'] == pytest.approx(mass * 9.81 * 0.5, rel=1e-12)
    assert abs(energy['balance_error']) < 1e-12 * energy['work_in']


def shaken(**changes):
    return driven(
        'sine', {'groups.tip': 'x_max', 'loads.tip.group': 'tip',
                 'loads.tip.force': [0.5, 0.2, -0.3], **changes},
        linear=[0.002, 0.001, 0.0], angular=[0.1, 0.05, -0.2], frequency=80.0,
        phase=-0.5 * math.pi, start=0.002, duration=0.0125)


def test_balance_and_motion_converge_with_the_order_of_the_method():
    require_fourth_order(shaken(), 0.018, (4e-5, 2e-5), 1e-5)


@pytest.mark.parametrize('method', ['srkn4', 'dop8'])
def test_bits_do_not_depend_on_pieces_threads_or_a_restart(method):
    scene = shaken(**{'solver.method': method, 'solver.threads': 1})

    def run(scene, times, at=0.01):
        simulation = ico.compile_scene(scene)
        simulation.apply_twist('wall', LINEAR, ANGULAR, time=at)
        for time in times:
            simulation.advance_to(float(time))
            simulation.snapshot()
        return simulation

    whole = run(scene, [0.016]).snapshot()
    pieces = run(scene, np.linspace(0.0, 0.016, 30)[1:]).snapshot()
    assert same_state(whole, pieces) and whole.energy == pieces.energy
    assert same_state(whole, run(changed(scene, {'solver.threads': 2}), [0.016]).snapshot())
    for time in (0.001, 0.0073, 0.01, 0.0125):
        first, second = run(scene, [time]), ico.compile_scene(scene)
        second.restore(first.checkpoint())
        second.advance_to(0.016)
        assert same_state(whole, second.snapshot())
        assert second.snapshot().energy == whole.energy


def test_balance_closes_with_all_that_acts_at_once():
    """A ramp tears a supported, damped fabric that an anchor pulls, while its connectors break."""
    scene = driven('ramp', {
        'groups.east': 'x_max', 'supports.east.group': 'east', 'connector.damping': 0.05,
        'connector.break_length_extension': 0.034, 'anchors.a.body': 2,
        'anchors.a.position': [0.03, 0.03, 0.08], 'anchors.a.velocity': [0.0, 0.1, 0.0],
        'solver.method': 'dop8'}, linear=[-0.5, 0.0, 0.0], duration=0.005)
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.02)
    snapshot = simulation.snapshot()
    energy = snapshot.energy
    assert 0 < (~snapshot.intact).sum() < scene.connector_count
    for name in ('work_in', 'dissipated', 'lost_at_breaks'):
        assert abs(energy[name]) > 1e-3 * energy['kinetic']
    assert simulation.balance.worst < 1e-7
    assert abs(energy['balance_error']) < 1e-7 * energy['kinetic']


def test_twist_takes_over_until_a_reset():
    scene = driven('sine', linear=[0.002, 0.0, 0.0], angular=[0.0, 0.0, 0.2], frequency=50.0)
    simulation = ico.compile_scene(scene)
    assert simulation.apply_twist('wall', LINEAR, ANGULAR, time=0.003) == 0.003
    simulation.advance_to(0.003)
    part = math.sin(2.0 * math.pi * 50.0 * 0.003)
    before = expected(scene, np.array([0.002, 0.0, 0.0]) * part, np.array([0, 0, 0.2]) * part,
                      LINEAR, ANGULAR)
    # The velocities are still those before.
    compare(scene, simulation.snapshot(), *before[:2], rel=1e-11)
    simulation.advance_to(0.0055)
    bodies = scene.drives['wall'].bodies
    snapshot = simulation.snapshot()
    middle = scene.drives['wall'].middle + np.array([0.002, 0, 0]) * part + 0.0025 * LINEAR
    assert snapshot.position[bodies].mean(axis=0) == pytest.approx(middle, abs=1e-12)
    turned = free_rotation(before[1], np.tile(ANGULAR, (len(bodies), 1)), 0.0025)
    assert np.abs((turned * snapshot.orientation[bodies]).sum(axis=1)) == pytest.approx(1.0)
    # Zero keeps the bodies where they are then.
    simulation.apply_twist('wall')
    simulation.advance_to(0.01)
    assert simulation.snapshot().position[bodies] == pytest.approx(
        snapshot.position[bodies], abs=1e-12)
    assert not simulation.snapshot().linear_velocity[bodies].any()
    simulation.reset()
    simulation.advance_to(0.013)
    compare(scene, simulation.snapshot(), *expected(
        scene, np.array([0.002, 0, 0]) * part, np.array([0, 0, 0.2]) * part,
        np.array([0.002, 0, 0]) * 100.0 * math.pi * math.cos(0.3 * math.pi),
        np.array([0, 0, 0.2]) * 100.0 * math.pi * math.cos(0.3 * math.pi)), rel=1e-11)
    with pytest.raises(ValueError, match="no drive 'x'; known: wall"):
        simulation.apply_twist('x')
    with pytest.raises(ValueError, match='linear must be three finite numbers'):
        simulation.apply_twist('wall', (math.nan, 0.0, 0.0))


def test_hold_is_a_support_and_bears_loads():
    held = driven('hold', {'groups.l': 'ids 0', 'loads.l.group': 'l', 'loads.l.force': [9, 9, 9]})
    supported = make_scene((3, 2, 2), {
        'groups.wall': 'x_min', 'supports.wall.group': 'wall', 'contact.mode': 'never',
        'solver.method': 'srkn4'}, **RANDOM)
    ends = []
    for scene in (held, supported):
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.01)
        ends.append(simulation.snapshot())
    np.testing.assert_allclose(ends[0].position, ends[1].position, atol=1e-8)
    assert ends[0].energy['work_in'] == 0.0
    assert np.abs(ends[0].position - held.initial.position).max() > 1e-3


@pytest.mark.parametrize('fields, changes, name, words', [
    ({'motion': 'hold', 'linear': [1.0, 0, 0]}, {}, 'drives.wall.linear', 'zero for the motion'),
    ({'motion': 'spin'}, {}, 'drives.wall.motion', 'hold, velocity, ramp, sine, table'),
    ({'motion': 'ramp'}, {}, 'drives.wall.duration', 'above 0 s'),
    ({'motion': 'sine'}, {}, 'drives.wall.frequency', 'above 0 Hz'),
    ({'motion': 'velocity', 'frequency': 1.0}, {}, 'drives.wall.frequency', 'only sine'),
    ({'motion': 'sine', 'frequency': 1.0, 'start': 1.0}, {}, 'drives.wall.phase', 'would jump'),
    ({'motion': 'sine', 'frequency': 1.0, 'duration': 0.5}, {}, 'drives.wall.duration', 'jump'),
    ({'motion': 'table'}, {}, 'drives.wall.file', 'name a CSV file'),
    ({'motion': 'table', 'file': 'none.csv'}, {}, 'drives.wall.file', 'none.csv'),
    ({'motion': 'hold'}, {'supports.s.group': 'wall', 'supports.s.fix': 'tz'}, 'drives.wall.group',
     'held by a support'),
    ({'motion': 'hold'}, {'drives.other.group': 'all'}, 'drives.wall.group',
     'already moved by drives.other'),
    ({'motion': 'hold'}, {'initial.i.group': 'all', 'initial.i.linear_velocity': [1.0, 0, 0]},
     'initial.i.linear_velocity', 'disagrees with drives.wall'),
    ({'motion': 'hold', 'group': 'nobody'}, {}, 'drives.wall.group', 'no group'),
    ({'motion': 'hold', 'freedoms': 'tx rz'}, {}, 'drives.wall.freedoms', 'rz is not supported'),
])
def test_contradictions_are_found_before_the_start(fields, changes, name, words):
    with pytest.raises(ico.ParameterError, match=name) as caught:
        driven(fields.pop('motion'), changes, **fields)
    assert words in str(caught.value)


@pytest.mark.parametrize('text, words', [
    ('0, 1, 0, 0\n1, 0, 0, 0\n', 'make the first line zero'),
    ('0, 0, 0, 0\n0, 1, 0, 0\n', 'must increase'), ('0, 0\n1, 1\n', 'displacement x, y, z')])
def test_bad_tables_are_refused(text, words, tmp_path):
    path = tmp_path / 'bad.csv'
    path.write_text(text)
    with pytest.raises(ico.ParameterError, match=r'drives\.wall\.file') as caught:
        driven('table', file=str(path))
    assert words in str(caught.value)


def test_agreeing_start_is_accepted():
    scene = driven('velocity', {
        'initial.i.group': 'wall', 'initial.i.linear_velocity': LINEAR.tolist()},
        linear=LINEAR.tolist())
    assert scene.initial.linear_velocity[scene.drives['wall'].bodies] == pytest.approx(
        np.tile(LINEAR, (2, 1)))
