# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Anchors at any point of a body, with damping and sine motion, against SciPy."""

from fabrics import make_scene, same_state
import icofabric_sim as ico
from icofabric_sim.geometry.rotations import cosines_from_quaternions
import numpy as np
import pytest
from scipy.integrate import solve_ivp

POINTS = {'a': np.array([0.004, -0.011, 0.013]), 'b': np.array([-0.009, 0.002, -0.012])}
PLACES = {'a': np.array([0.01, -0.02, 0.06]), 'b': np.array([-0.05, 0.01, -0.01])}
STIFFNESS, DAMPING, REST = {'a': 60.0, 'b': 90.0}, {'a': 0.02, 'b': 0.0}, 0.03
SIZE, RATE, PHASE = np.array([0.004, -0.003, 0.006]), 2.0 * np.pi * 11.0, 0.4
SCENE = {
    'contact.mode': 'never', 'solver.tolerance': 1e-9, 'connector.natural_length': REST,
    'anchors.a.motion': 'sine', 'anchors.a.linear': SIZE.tolist(), 'anchors.a.frequency': 11.0,
    'anchors.a.phase': PHASE, **{
        f'anchors.{name}.{field}': value for name in 'ab' for field, value in (
            ('body', 0), ('point', POINTS[name].tolist()), ('position', PLACES[name].tolist()),
            ('stiffness', STIFFNESS[name]), ('damping', DAMPING[name]))}}


def pulls(time, y):
    """Return forces [N], arms [m], velocities of points [m/s] and rates of lengths [m/s]."""
    axes = cosines_from_quaternions(y[None, 3:7] / np.linalg.norm(y[3:7]))[0]
    for name in 'ab':
        wave = name == 'a'
        point = PLACES[name] + wave * SIZE * (np.sin(RATE * time + PHASE) - np.sin(PHASE))
        speed = wave * SIZE * RATE * np.cos(RATE * time + PHASE)
        arm = POINTS[name] @ axes
        reach = point - y[:3] - arm
        length = np.linalg.norm(reach)
        along = reach / length
        rate = along @ (speed - y[7:10] - np.cross(y[10:13], arm))
        yield along * (STIFFNESS[name] * (length - REST) + DAMPING[name] * rate), arm, speed, (
            DAMPING[name] * rate**2)


def slope(scene, time, y):
    force, torque, work, lost = np.zeros(3), np.zeros(3), 0.0, 0.0
    for pull, arm, speed, power in pulls(time, y):
        force += pull
        torque += np.cross(arm, pull)
        work, lost = work + pull @ speed, lost + power
    x, w = y[3:6], y[10:13]
    turn = 0.5 * np.append(w * y[6] + np.cross(w, x), -w @ x)
    return np.concatenate([
        y[7:10], turn, force / scene.shell.mass, torque / scene.shell.inertia, [work, lost]])


@pytest.fixture(scope='module')
def scene():
    return make_scene((1, 1, 1), SCENE)


@pytest.fixture(scope='module')
def simulation(scene):
    found = ico.compile_scene(scene)
    found.advance_to(0.2)
    return found


def test_motion_work_and_losses_are_those_of_scipy(scene, simulation):
    start = np.concatenate([scene.position[0], scene.orientation[0], np.zeros(8)])
    expected = solve_ivp(
        lambda t, y: slope(scene, t, y), (0.0, 0.2), start, 'DOP853', rtol=1e-11,
        atol=1e-13).y[:, -1]
    found = simulation.snapshot()
    assert np.linalg.norm(found.position[0] - start[:3]) > 1e-3
    assert found.position[0] == pytest.approx(expected[:3], abs=1e-9)
    assert abs(found.orientation[0] @ expected[3:7]) == pytest.approx(1.0, abs=1e-9)
    assert found.angular_velocity[0] == pytest.approx(expected[10:13], abs=1e-5)
    assert found.energy['work_in'] == pytest.approx(expected[13], rel=1e-6)
    assert found.energy['dissipated'] == pytest.approx(expected[14], rel=1e-6)
    assert expected[14] > 1e-5
    assert simulation.balance.worst < 1e-7
    assert 'dop8' in repr(simulation)


def test_reactions_and_markers_follow_the_moving_points(simulation):
    found = simulation.snapshot()
    y = np.concatenate([
        found.position[0], found.orientation[0], found.linear_velocity[0],
        found.angular_velocity[0]])
    expected = [force for force, _, _, _ in pulls(0.2, y)]
    reactions = simulation.reactions()
    assert reactions.names == ('anchors.a', 'anchors.b')
    np.testing.assert_allclose(reactions.force, expected, rtol=1e-9)
    np.testing.assert_allclose(
        found.anchor_ends[0, 1],
        PLACES['a'] + SIZE * (np.sin(RATE * 0.2 + PHASE) - np.sin(PHASE)), atol=1e-15)
    axes = cosines_from_quaternions(found.orientation)[0]
    np.testing.assert_allclose(
        found.anchor_ends[:, 0], found.position[0] + np.array(list(POINTS.values())) @ axes)


def test_bits_do_not_depend_on_pieces_or_a_restart(scene, simulation):
    pieces, restored = ico.compile_scene(scene), ico.compile_scene(scene)
    for time in (0.013, 0.08, 0.11):
        pieces.advance_to(time)
    restored.restore(pieces.checkpoint())
    for other in (pieces, restored):
        other.advance_to(0.2)
        assert same_state(simulation.snapshot(), other.snapshot())
        assert simulation.snapshot().energy == other.snapshot().energy


def test_equilibrium_holds_the_point_of_a_sine():
    """At the crest of the sine the centre hangs below the point, stretched by M g / k."""
    scene = make_scene((1, 1, 1), {
        'anchors.a.edge': 'centre', 'anchors.a.position': [0.0, 0.0, 0.1],
        'anchors.a.motion': 'sine', 'anchors.a.linear': [0.0, 0.0, 0.01],
        'anchors.a.frequency': 5.0, 'anchors.a.stiffness': 40.0,
        'anchors.a.natural_length': 0.05, 'gravity': [0.0, 0.0, -9.81]})
    with pytest.raises(ValueError, match='anchors.a.motion: changes with time'):
        ico.solve_equilibrium(scene)
    found = ico.solve_equilibrium(scene, time=0.05)
    assert found.snapshot.position[0] == pytest.approx(
        [0.0, 0.0, 0.06 - scene.shell.mass * 9.81 / 40.0], abs=1e-12)


def test_a_broken_dashpot_dissipates_nothing():
    scene = make_scene((1, 1, 1), {
        'anchors.a.position': [0.0, 0.0, 0.05], 'anchors.a.edge': 'centre',
        'anchors.a.stiffness': 0.0, 'anchors.a.damping': 0.01, 'anchors.a.natural_length': 0.05,
        'anchors.a.break_length_extension': 0.06, 'anchors.a.motion': 'ramp',
        'anchors.a.linear': [0.0, 0.0, 1.0], 'anchors.a.duration': 1e-3})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.1)
    first = simulation.snapshot()
    assert not first.anchor_intact.any() and first.energy['dissipated'] > 1e-7
    simulation.advance_to(0.2)
    assert simulation.snapshot().energy['dissipated'] == first.energy['dissipated']
    assert simulation.snapshot().linear_velocity[0] == pytest.approx(first.linear_velocity[0])


@pytest.mark.parametrize('changes, name, words', [
    ({'linear': [0.0, 0.0, 1.0]}, 'anchors.a.linear', 'set anchors.a.motion to ramp or sine'),
    ({'motion': 'sine', 'frequency': 1.0, 'velocity': [1.0, 0.0, 0.0]}, 'anchors.a.velocity',
     'give anchors.a.linear'),
    ({'motion': 'sine', 'linear': [0.0, 0.0, 1.0]}, 'anchors.a.frequency', 'above 0 Hz'),
    ({'motion': 'sine', 'frequency': 1.0, 'file': 'some.csv'}, 'anchors.a.file', 'be empty'),
    ({'edge': 'middle'}, 'anchors.a.edge', 'centre'),
    ({'damping': -1.0}, 'anchors.a.damping', 'at least 0'),
])
def test_bad_motions_are_refused_by_name(changes, name, words):
    with pytest.raises(ico.ParameterError, match=name) as caught:
        make_scene((1, 1, 1), {
            'anchors.a.position': [0.0, 0.0, 0.1],
            **{f'anchors.a.{field}': value for field, value in changes.items()}})
    assert words in str(caught.value)


def test_splitting_methods_refuse_damped_anchors():
    with pytest.raises(ico.ParameterError, match='solver.method srkn4'):
        ico.compile_scene(make_scene((1, 1, 1), {**SCENE, 'solver.method': 'srkn4'}))


@pytest.mark.parametrize('field', ['start', 'duration', 'phase'])
def test_fields_of_motions_without_a_motion_are_refused(field):
    with pytest.raises(ico.ParameterError, match=f'anchors.tie.{field} 0.5 has no effect'):
        make_scene((1, 1, 1), {
            'anchors.tie.body': 0, 'anchors.tie.edge': 'up',
            'anchors.tie.position': [0.0, 0.0, 0.1], f'anchors.tie.{field}': 0.5})
