# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Custom connectors: the fabric that a weave gives, tied by hand, and bodies at any points."""

from fabrics import make_scene, same_state
import icofabric_sim as ico
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.messages import decode_marker_points
from icofabric_sim.messages.markers import ConnectorMarkers
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.spectrum import scaled_hessian
import numpy as np
import pytest
from scipy.integrate import solve_ivp

COMMON = {
    'contact.mode': 'never', 'gravity': [0.0, 0.0, -9.81], 'supports.s.group': 'wall',
    'supports.s.fix': 'all', 'groups.wall': 'x_min', 'connector.stiffness_extension': 400.0,
    'connector.stiffness_compression': 250.0, 'connector.natural_length': 0.0295,
    'solver.tolerance': 1e-9, 'initial_random.velocity_sigma': 0.02,
    'initial_random.spin_sigma': 2.0}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Folder with the connectors of a weave as a table."""
    path = tmp_path_factory.mktemp('ties')
    woven = make_scene((3, 2, 2), COMMON)
    rows = np.hstack([
        woven.connectors.bodies, woven.connectors.points_body.reshape(-1, 6)])
    # Either end may be the first.
    rows[::2] = rows[::2][:, [1, 0, 5, 6, 7, 2, 3, 4]]
    np.savetxt(path / 'ties.csv', rows, delimiter=',', header='body, body, x, y, z, x, y, z')
    return path


def pair(folder, changes=None, **more):
    """Return a woven scene, and the same bodies with the same connectors by a table."""
    changes = {**COMMON, **(changes or {})}
    return make_scene((3, 2, 2), changes), make_scene((3, 2, 2), {
        **changes, 'weave.connected': False, 'connectors.tie.file': str(folder / 'ties.csv'),
        **more})


@pytest.mark.parametrize('changes', [
    {'connector.damping': 0.02}, {'solver.method': 'leapfrog', 'solver.step': 2e-5}])
def test_motion_is_that_of_the_weave(folder, changes):
    woven, tied = (ico.compile_scene(scene) for scene in pair(folder, changes))
    assert tied.status.largest_frequency == pytest.approx(
        woven.status.largest_frequency, rel=2e-3)
    for simulation in (woven, tied):
        simulation.advance_to(0.05)
    a, b = woven.snapshot(), tied.snapshot()
    assert np.abs(a.position - woven.scene.position).max() > 1e-3
    np.testing.assert_allclose(b.position, a.position, atol=1e-9)
    np.testing.assert_allclose(b.angular_velocity, a.angular_velocity, atol=1e-5)
    order = np.lexsort(woven.scene.connectors.bodies.T)
    other = np.lexsort(tied.scene.connectors.bodies.T)
    np.testing.assert_allclose(b.connector_length[other], a.connector_length[order], atol=1e-9)
    for name in ('connectors', 'dissipated', 'kinetic'):
        assert b.energy[name] == pytest.approx(a.energy[name], rel=1e-6)
    assert tied.balance.worst < 1e-4


def test_equilibrium_and_modes_are_those_of_the_weave(folder):
    changes = {'initial_random.velocity_sigma': 0.0, 'initial_random.spin_sigma': 0.0,
               'groups.wall': 'x_min or x_max', 'gravity': [0.0, 0.0, -0.5]}
    found = []
    for scene in pair(folder, changes):
        rest = ico.solve_equilibrium(scene)
        assert rest.converged
        modes = ico.solve_modes(scene, at=rest.snapshot)
        found.append((rest, modes))
    (one, first), (two, second) = found
    assert two.snapshot.energy['connectors'] == pytest.approx(
        one.snapshot.energy['connectors'], rel=1e-8)
    assert first.counts.mechanisms == second.counts.mechanisms
    most = first.frequencies.max()
    np.testing.assert_allclose(second.frequencies, first.frequencies, atol=1e-6 * most)


TWO = {
    'contact.mode': 'never', 'solver.tolerance': 1e-9, 'bodies.x.position': [0.05, 0.01, 0.03],
    'bodies.x.angular_velocity': [3.0, -2.0, 5.0], 'bodies.x.linear_velocity': [0.0, 0.1, 0.05],
    'connectors.a.bodies': [0, 1],
    'connectors.a.points': [0.011, 0.003, -0.007, -0.012, 0.004, 0.006],
    'connectors.a.stiffness': 80.0, 'connectors.a.natural_length': 0.03,
    'connectors.a.damping': 0.02,
    'connectors.b.bodies': [1, 0],
    'connectors.b.points': [0.0, -0.013, 0.002, 0.005, 0.0, 0.015],
    'connectors.b.stiffness': 50.0}
POINTS = [
    np.array([[0.011, 0.003, -0.007], [-0.012, 0.004, 0.006]]),
    np.array([[0.005, 0.0, 0.015], [0.0, -0.013, 0.002]])]


def slope(y, laws, scene):
    """Return dy/dt of two bodies, 13 numbers each, and the dissipated power [W]."""
    bodies = y[:26].reshape(2, 13)
    axes = cosines_from_quaternions(
        bodies[:, 3:7] / np.linalg.norm(bodies[:, 3:7], axis=1, keepdims=True))
    force, torque, lost = np.zeros((2, 3)), np.zeros((2, 3)), 0.0
    for points, (stiffness, rest, damping) in zip(POINTS, laws):
        arm = np.einsum('ei,eij->ej', points, axes)
        end = bodies[:, :3] + arm
        moving = bodies[:, 7:10] + np.cross(bodies[:, 10:], arm)
        along, length = end[1] - end[0], np.linalg.norm(end[1] - end[0])
        rate = along @ (moving[1] - moving[0]) / length
        pull = along / length * (stiffness * (length - rest) + damping * rate)
        lost += damping * rate**2
        for body, sign in ((0, 1.0), (1, -1.0)):
            force[body] += sign * pull
            torque[body] += sign * np.cross(arm[body], pull)
    x, w, spin = bodies[:, 3:6], bodies[:, 6:7], bodies[:, 10:]
    turn = 0.5 * np.hstack([spin * w + np.cross(spin, x), -(spin * x).sum(1, keepdims=True)])
    return np.append(np.hstack([
        bodies[:, 7:10], turn, force / scene.shell.mass, torque / scene.shell.inertia]), lost)


@pytest.fixture(scope='module')
def two():
    return make_scene((1, 1, 1), TWO)


def test_motion_of_two_bodies_is_that_of_scipy(two):
    simulation = ico.compile_scene(two)
    start = two.initial
    y = np.append(np.hstack(list(start)), 0.0)
    rest = two.connectors.natural_length
    # Without a natural length of its own: the length at rest.
    assert rest[1] == pytest.approx(np.linalg.norm(
        two.position[1] + POINTS[1][1] - two.position[0] - POINTS[1][0]), rel=1e-12)
    laws = [(80.0, 0.03, 0.02), (50.0, rest[1], 0.0)]
    expected = solve_ivp(
        lambda t, y: slope(y, laws, two), (0.0, 0.1), y, 'DOP853', rtol=1e-11,
        atol=1e-13).y[:, -1]
    simulation.advance_to(0.1)
    found = simulation.snapshot()
    bodies = expected[:26].reshape(2, 13)
    np.testing.assert_allclose(found.position, bodies[:, :3], atol=1e-9)
    np.testing.assert_allclose(found.angular_velocity, bodies[:, 10:], atol=1e-5)
    assert found.energy['dissipated'] == pytest.approx(expected[26], rel=1e-6)
    assert expected[26] > 1e-5 and simulation.balance.worst < 1e-7
    momentum = two.shell.mass * found.linear_velocity.sum(axis=0)
    np.testing.assert_allclose(
        momentum, two.shell.mass * start.linear_velocity.sum(axis=0), atol=1e-15)
    tension = simulation.tensions()
    assert np.abs(tension).min() > 1e-3
    ends = found.connector_ends
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) == pytest.approx(
        found.connector_length)
    drawn = np.vstack([
        decode_marker_points(message).points for message in
        ConnectorMarkers(two).messages(found, 100_000_000)])
    assert len(drawn) == 4


def test_direction_cosines_give_the_motion_of_quaternions(two):
    found = []
    for scene in (two, two.with_changes({'solver.rotation': 'direction_cosines'})):
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.05)
        found.append(simulation.snapshot())
    one, other = found
    np.testing.assert_allclose(other.position, one.position, atol=1e-9)
    np.testing.assert_allclose(other.angular_velocity, one.angular_velocity, atol=1e-5)
    assert other.energy['dissipated'] == pytest.approx(one.energy['dissipated'], rel=1e-6)


def test_bits_do_not_depend_on_pieces_restarts_or_threads(folder):
    _, scene = pair(folder, {'solver.method': 'srkn4'})
    whole = ico.compile_scene(scene)
    whole.advance_to(0.02)
    pieces, restored, threads = (ico.compile_scene(chosen) for chosen in (
        scene, scene, scene.with_changes({'solver.threads': 2})))
    for time in (0.003, 0.0111):
        pieces.advance_to(time)
    restored.restore(pieces.checkpoint())
    for other in (pieces, restored, threads):
        other.advance_to(0.02)
        assert same_state(whole.snapshot(), other.snapshot())


def test_a_connector_breaks_and_its_energy_is_lost():
    """The pull ends at L_e; the bodies then move apart with constant velocities."""
    scene = make_scene((2, 2, 1), {
        'contact.mode': 'never', 'bodies.x.position': [0.0, 0.0, 0.08],
        'bodies.x.linear_velocity': [0.0, 0.0, 2.0], 'connectors.a.bodies': [2, 0],
        'connectors.a.stiffness': 20.0, 'connectors.a.break_length_extension': 0.09})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.1)
    found = simulation.snapshot()
    number = scene.connector_count - 1
    assert np.flatnonzero(~found.intact).tolist() == [number]
    assert found.energy['lost_at_breaks'] == pytest.approx(10.0 * 0.01**2, rel=1e-6)
    assert simulation.balance.worst < 1e-6
    speed = found.linear_velocity[2]
    restored = ico.compile_scene(scene)
    restored.restore(simulation.checkpoint())
    restored.advance_to(0.15)
    after = restored.snapshot()
    np.testing.assert_allclose(after.linear_velocity[2], speed, atol=1e-15)
    assert after.break_time[number] == found.break_time[number] < 0.1
    # Another connector before this one in the order of names leaves it broken.
    later = ico.compile_scene(scene.with_changes({
        'connectors.A.bodies': [1, 2], 'connectors.A.stiffness': 1.0}))
    later.continue_from(simulation, keep_motion=True)
    assert np.flatnonzero(~later.snapshot().intact).tolist() == [number + 1]


def test_a_loose_body_hangs_on_a_fabric():
    """Below a held body it sinks by M g / k, and swings up and down with sqrt(k / M)."""
    scene = make_scene((2, 2, 1), {
        'contact.mode': 'never', 'supports.s.group': 'wall', 'groups.wall': 'ids 0 1',
        'bodies.x.position': [0.0, 0.0, -0.1], 'connectors.a.bodies': [0, 2],
        'connectors.a.stiffness': 40.0, 'gravity': [0.0, 0.0, -9.81],
        'publish.connectors': 'all loose', 'groups.loose': 'ids 2'})
    assert scene.published_connectors.tolist() == [1]
    rest = ico.solve_equilibrium(scene)
    sunk = scene.shell.mass * 9.81 / 40.0
    assert rest.converged
    assert rest.snapshot.position[2] == pytest.approx([0.0, 0.0, -0.1 - sunk], abs=1e-12)
    assert rest.tension[1] == pytest.approx(scene.shell.mass * 9.81, rel=1e-9)
    # A pendulum in x and y; free rotations about the centre have no frequency.
    modes = ico.solve_modes(scene, at=rest.snapshot)
    swing = np.sqrt(9.81 / (0.1 + sunk))
    expected = [swing, swing, np.sqrt(40.0 / scene.shell.mass)]
    np.testing.assert_allclose(modes.frequencies, expected, rtol=1e-6)


def test_derivatives_of_a_fabric_with_ties_across_are_those_of_its_energy():
    generator, ties = np.random.default_rng(5), {}
    for number, pair in enumerate(([0, 6], [1, 5], [0, 5], [2, 6], [3, 4])):
        ties |= {
            f'connectors.t{number}.bodies': pair,
            f'connectors.t{number}.points': generator.normal(0.0, 0.01, 6).tolist(),
            f'connectors.t{number}.stiffness_extension': 80.0 + 40.0 * number,
            f'connectors.t{number}.stiffness_compression': 30.0}
    scene = make_scene((3, 2, 2), {
        'contact.mode': 'never', 'bodies.x.position': [0.1, 0.03, -0.05],
        'connector.bending_stiffness': 0.01, **ties})
    fabric = StaticFabric(scene)
    count = scene.body_count

    start = fabric.start.moved(generator.normal(0.0, 1.0, (count, 6)) * (
        [3e-3] * 3 + [0.3] * 3))
    stretch = start.stretched.stretch[-5:]
    assert (stretch > 1e-4).any() and (stretch < -1e-4).any()
    units, h = np.diag([1e-2, 1e-2, 1e-2, 1.0, 1.0, 1.0] * count), 1e-5
    force, hessian = start.force.ravel(), np.zeros((6 * count, 6 * count))
    for row, unit in enumerate(units):
        ahead, behind = (
            start.moved(sign * h * unit.reshape(count, 6)) for sign in (1.0, -1.0))
        assert (ahead.energy - behind.energy) / (2.0 * h) == pytest.approx(
            -force @ unit, abs=1e-9)
        hessian[row] = units @ start.times(unit.reshape(count, 6)).ravel()
        # Second differences of the energy.
        for column in (row, (7 * row + 3) % len(units)):
            both = [start.moved(h * 100.0 * (p * unit + q * units[column]).reshape(
                count, 6)).energy for p in (1.0, -1.0) for q in (1.0, -1.0)]
            second = (both[0] - both[1] - both[2] + both[3]) / (4.0 * (100.0 * h) ** 2)
            assert second == pytest.approx(
                units[column] @ start.times(unit.reshape(count, 6)).ravel(), abs=2e-5)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-12 * np.abs(hessian).max())
    matrix = scaled_hessian(start).toarray()
    root = np.tile(np.repeat([scene.shell.mass, scene.shell.inertia], 3) ** 0.5, count)
    scaled = hessian / np.outer(units.diagonal() * root, units.diagonal() * root)
    np.testing.assert_allclose(matrix, scaled, atol=1e-10 * np.abs(scaled).max())


def test_the_periodic_fabric_refuses_custom_connectors():
    with pytest.raises(ico.ParameterError, match='connectors.a: the periodic fabric'):
        ico.homogenise(make_scene((3, 3, 3), {'connectors.a.bodies': [0, 5]}))


@pytest.mark.parametrize('changes, name, words', [
    ({'bodies': [1, 1]}, 'connectors.a.bodies', 'two different bodies'),
    ({'bodies': [0, 2]}, 'connectors.a.bodies', 'numbered 0 to 1'),
    ({'stiffness': 5.0}, 'connectors.a.bodies', 'two different bodies'),
    ({'file': 'none.csv'}, 'connectors.a.file', 'none.csv'),
    ({'file': 'none.csv', 'bodies': [0, 1]}, 'connectors.a.file', 'connectors.a.bodies is given'),
    ({'bodies': [0, 1], 'points': [0.0, 0.0, 0.1, 0.0, 0.0, 0.0]}, 'connectors.a.points',
     'coincide'),
    ({'bodies': [0, 1], 'break_length_extension': 0.05}, 'connectors.a.break_length_extension',
     'above the natural length'),
    ({'bodies': [0, 1], 'natural_length': 0.03, 'break_length_extension': 0.05},
     'connectors.a.break_length_extension', '0.1 m long at rest'),
    ({'bodies': [0, 1], 'stiffness': 1e30}, 'connectors.a.stiffness', 'choose a smaller'),
])
def test_bad_connectors_are_refused_by_name(changes, name, words):
    with pytest.raises(ico.ParameterError, match=name) as caught:
        make_scene((1, 1, 1), {
            'bodies.x.position': [0.0, 0.0, 0.1],
            **{f'connectors.a.{field}': value for field, value in changes.items()}})
    assert words in str(caught.value)


def test_bad_tables_are_refused_by_their_place(tmp_path):
    path = tmp_path / 'ties.csv'
    for text, words in (
            ('0, 1, 0, 0, 0, 0, 0\n', 'line 1'), ('# none\n', 'at least one line'),
            ('0, 0.5, 0, 0, 0, 0, 0, 0\n', r'got \[0.0, 0.5\]')):
        path.write_text(text)
        with pytest.raises(ico.ParameterError, match=words):
            make_scene((1, 1, 1), {
                'bodies.x.position': [0.0, 0.0, 0.1], 'connectors.a.file': str(path)})
