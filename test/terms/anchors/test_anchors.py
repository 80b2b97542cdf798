# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Anchors to points of the world: forces, frequency, work, what a run does not depend on."""

import math

from analytical import rotation_quaternion
from balance_orders import require_fourth_order
from fabrics import make_scene, packed_state, RANDOM, same_state
import icofabric_sim as ico
from icofabric_sim.kernels.loads import look_at_anchors
from icofabric_sim.messages import decode_marker_points
from icofabric_sim.messages.markers import ConnectorMarkers
from icofabric_sim.simulation.inputs.inputs import Inputs
from icofabric_sim.simulation.model.anchor_stiffness import anchors_eigenvalue, stiffness_of
from icofabric_sim.simulation.model.packing import pack_scene
import numpy as np
import pytest

LAW = {'connector.stiffness_extension': 700.0, 'connector.stiffness_compression': 300.0,
       'connector.natural_length': 0.03}


def tied(changes, size=(1, 1, 1), **sections):
    return make_scene(size, {
        'contact.mode': 'never', 'solver.method': 'srkn4',
        **{name if '.' in name else f'anchors.a.{name}': value
           for name, value in changes.items()}}, **sections)


TWO = {
    'anchors.a.body': 0, 'anchors.a.edge': 'up', 'anchors.a.position': [0.01, -0.02, 0.05],
    'anchors.b.body': 0, 'anchors.b.edge': 'south', 'anchors.b.position': [-0.03, 0.01, 0.01],
    'anchors.b.stiffness': 200.0, 'anchors.b.stiffness_extension': 900.0,
    'anchors.b.natural_length': 0.02,
    **LAW}
# k_e, k_c [N/m] and D [m].
LAWS = {'a': (700.0, 300.0, 0.03), 'b': (900.0, 200.0, 0.02)}


def body_energy(scene, shift, turn, more=(0.0, 0.0, 0.0)):
    """The energy by NumPy alone, eq 2 with the far end at rest; `more`: turned on by so much."""
    axes = _axes(turn) @ _axes(more)
    total = 0.0
    for name, anchor in scene.anchors.items():
        pull, push, natural = LAWS[name]
        end = scene.position[0] + shift + anchor.arm @ axes
        stretch = np.linalg.norm(anchor.path.pieces[0].at(0.0)[:3] - end) - natural
        total += 0.5 * (pull if stretch > 0.0 else push) * stretch**2
    return total


def all_stretched(scene, shift, turn):
    ends = [scene.position[0] + shift + anchor.arm @ _axes(turn)
            for anchor in scene.anchors.values()]
    return all(np.linalg.norm(anchor.path.pieces[0].at(0.0)[:3] - end) > LAWS[name][2]
               for (name, anchor), end in zip(scene.anchors.items(), ends))


def _axes(turn):
    x, y, z, w = rotation_quaternion(np.array([turn]))[0]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return (np.eye(3) + 2.0 * (w * cross + cross @ cross)).T


def test_energy_and_frequency_of_anchors():
    """
    The energy is the sum of eq 2's; the bound holds for the largest eigenvalue, and is close.
    """
    scene = tied(TWO)
    mass, inertia = scene.shell.mass, scene.shell.inertia
    generator, seen = np.random.default_rng(3), 0
    for _ in range(5):
        shift, turn = generator.normal(0.0, 0.005, 3), generator.normal(0.0, 1.0, 3)
        packed = pack_scene(scene)
        state = packed_state(
            packed, scene.position + shift, rotation_quaternion(np.array([turn])))
        loads, pose = Inputs(scene).pack(packed.layout), (scene.position[0] + shift, _axes(turn))
        bound, energy = look_at_anchors(packed.model, loads, state, 0.0)
        assert energy == pytest.approx(body_energy(scene, shift, turn), rel=1e-12)
        # Second differences along small motions about this pose, scaled by mass and inertia.
        root = np.repeat([mass**-0.5, inertia**-0.5], 3)
        h, unit, hessian = 1e-5 * mass**0.5, np.eye(6), np.zeros((6, 6))
        for i in range(6):
            for k in range(6):
                corners = [
                    body_energy(scene, shift + y[:3], turn, y[3:])
                    for y in (h * root * (p * unit[i] + q * unit[k])
                              for p in (1.0, -1.0) for q in (1.0, -1.0))]
                hessian[i, k] = (corners[0] - corners[1] - corners[2] + corners[3]) / (
                    4.0 * h * h)
        largest = float(np.linalg.eigvalsh(0.5 * (hessian + hessian.T))[-1])
        assert largest < bound < 10.0 * largest
        exact = stiffness_of(loads.anchors, 0, *pose, 0.0) + stiffness_of(
            loads.anchors, 1, *pose, 0.0)
        if all_stretched(scene, shift, turn):
            np.testing.assert_allclose(
                exact * np.outer(root, root), hessian, atol=1e-5 * largest)
            assert anchors_eigenvalue(packed.model, loads, state, 0.0) == pytest.approx(
                largest, rel=1e-5)
            seen += 1
        else:
            # The larger stiffness counts on either side of the natural length.
            assert anchors_eigenvalue(packed.model, loads, state, 0.0) > largest
    assert seen


def test_a_slack_anchor_counts_for_the_frequency_as_when_it_pulls():
    # A step has to be stable on both sides, wherever the anchor is now.
    scene = tied({
        'body': 0, 'edge': 'up', 'position': [0.01, -0.02, 0.05], 'natural_length': 0.5,
        'stiffness_extension': 700.0, 'stiffness_compression': 0.0})
    packed = pack_scene(scene)
    state, loads = packed.layout.pack(scene.initial), Inputs(scene).pack(packed.layout)
    bound, energy = look_at_anchors(packed.model, loads, state, 0.0)
    assert energy == 0.0
    eigenvalue = anchors_eigenvalue(packed.model, loads, state, 0.0)
    assert bound > (1.0 - 1e-9) * eigenvalue > 0.9 * 700.0 / scene.shell.mass


def test_force_is_minus_the_gradient_of_the_energy():
    """In a step as short as can be, v = - h grad E / M and omega = - h grad E / Lambda."""
    scene = tied({**TWO, 'groups.g': 'all', 'initial.i.group': 'g',
                  'initial.i.rotation': [0.5, -0.8, 0.3],
                  'initial.i.displacement': [0.002, 0.003, -0.001], 'solver.step': 1e-9})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(1e-9)
    snapshot = simulation.snapshot()
    shift, turn = np.array([0.002, 0.003, -0.001]), np.array([0.5, -0.8, 0.3])
    h = 1e-6

    def energy(dx, dtheta):
        return body_energy(scene, shift + dx, turn, dtheta)

    zero = np.zeros(3)
    for k, unit in enumerate(np.eye(3)):
        force = -(energy(h * unit, zero) - energy(-h * unit, zero)) / (2.0 * h)
        torque = -(energy(zero, h * unit) - energy(zero, -h * unit)) / (2.0 * h)
        assert snapshot.linear_velocity[0, k] * scene.shell.mass == pytest.approx(
            1e-9 * force, rel=1e-6)
        assert snapshot.angular_velocity[0, k] * scene.shell.inertia == pytest.approx(
            1e-9 * torque, rel=1e-6)


def test_body_on_a_spring_that_is_pulled_away():
    """
    The point leaves with v: x'' = -w^2 (x - v t), from rest x = v t - (v / w) sin(w t), w^2 = k/M.
    """
    scene = make_scene((1, 1, 1))
    length, arm = scene.geometry.connector_length, 0.5 * scene.geometry.cube_width
    place = scene.position[0] + np.array([arm + length, 0.0, 0.0])
    speed = 0.02
    scene = tied({'position': place.tolist(), 'edge': 'north', 'velocity': [speed, 0.0, 0.0],
                  'solver.tolerance': 1e-8})
    simulation = ico.compile_scene(scene)
    own = math.sqrt(500.0 / scene.shell.mass)
    assert simulation.status.largest_frequency == pytest.approx(own, rel=1e-12)
    for time in np.linspace(0.0, 0.1, 9)[1:]:
        simulation.advance_to(float(time))
        snapshot = simulation.snapshot()
        x = speed * time - speed / own * math.sin(own * time)
        assert snapshot.position[0, 0] - scene.position[0, 0] == pytest.approx(x, abs=1e-8)
        stretch = speed * time - x
        assert snapshot.energy['connectors'] == pytest.approx(250.0 * stretch**2, abs=1e-9)
        # Work is the integral of k (v t - x) v.
        work = 500.0 * speed**2 / own**2 * (1.0 - math.cos(own * time))
        assert snapshot.energy['work_in'] == pytest.approx(work, rel=1e-5, abs=1e-10)
    assert simulation.balance.worst < 1e-7
    ends = snapshot.anchor_ends
    assert ends[0, 1] == pytest.approx(place + [speed * 0.1, 0.0, 0.0], abs=1e-14)
    messages = list(ConnectorMarkers(scene).messages(snapshot, 100_000_000))
    assert len(messages) == 1
    assert decode_marker_points(messages[0]).points == pytest.approx(ends.reshape(-1, 3))


@pytest.fixture
def table(tmp_path):
    path = tmp_path / 'point.csv'
    path.write_text('0.001, 0, 0, 0\n0.004, 0.003, 0.001, 0\n0.009, -0.002, 0, 0.002\n')
    return str(path)


def hung(table, **changes):
    return tied({
        'anchors.a.body': 0, 'anchors.a.edge': 'up', 'anchors.a.position': [0.0, 0.0, 0.05],
        'anchors.a.file': table, 'anchors.b.body': 1, 'anchors.b.edge': 'east',
        'anchors.b.position': [0.05, -0.05, 0.0], 'anchors.b.velocity': [0.2, 0.0, -0.1],
        'anchors.c.body': 0, 'anchors.c.edge': 'west', 'anchors.c.position': [0.0, 0.06, 0.0],
        **changes}, size=(2, 2, 1), **RANDOM)


def test_balance_and_motion_converge_with_the_order_of_the_method(table):
    require_fourth_order(hung(table), 0.012, (8e-5, 4e-5), 1e-3)


@pytest.mark.parametrize('method', ['srkn4', 'dop8'])
def test_bits_do_not_depend_on_pieces_or_a_restart(method, table):
    scene = hung(table, **{'solver.method': method})
    whole, pieces = ico.compile_scene(scene), ico.compile_scene(scene)
    whole.advance_to(0.012)
    for time in np.linspace(0.0, 0.012, 31)[1:]:
        pieces.advance_to(float(time))
        pieces.snapshot()
    assert same_state(whole.snapshot(), pieces.snapshot())
    assert whole.snapshot().energy == pieces.snapshot().energy
    for time in (0.0007, 0.004, 0.0101):
        first, second = ico.compile_scene(scene), ico.compile_scene(scene)
        first.advance_to(time)
        second.restore(first.checkpoint())
        second.advance_to(0.012)
        assert same_state(whole.snapshot(), second.snapshot())
        assert second.snapshot().energy == whole.snapshot().energy


@pytest.mark.parametrize('changes, name, words', [
    ({'body': 1}, 'anchors.a.body', 'no body 1'),
    ({'body': -1}, 'anchors.a.body', 'at least 0'),
    ({'edge': 'top'}, 'anchors.a.edge', 'up, down, north, south, west, east'),
    ({'file': 'none.csv'}, 'anchors.a.file', 'none.csv'),
    ({'file': 'none.csv', 'velocity': [1.0, 0.0, 0.0]}, 'anchors.a.file', 'give one of them'),
    ({'groups.g': 'all', 'drives.d.group': 'g'}, 'anchors.a.body', 'moved by drives.d'),
])
def test_bad_anchors_are_refused_by_name(changes, name, words):
    with pytest.raises(ico.ParameterError, match=name) as caught:
        tied({'position': [0.0, 0.0, 0.1], **changes})
    assert words in str(caught.value)


def test_anchors_without_a_law_of_their_own_have_that_of_connectors():
    scene = tied(TWO)
    assert {name: anchor.law for name, anchor in scene.anchors.items()} == LAWS
    plain = tied({'position': [0.0, 0.0, 0.1]}, size=(2, 2, 2))
    rest = plain.geometry.connector_length
    assert plain.anchors['a'].law == (500.0, 500.0, rest)
    # One stiffness of its own rules both directions, whatever connectors have.
    own = tied({'position': [0.0, 0.0, 0.1], 'stiffness': 40.0, **LAW})
    assert own.anchors['a'].law == (40.0, 40.0, 0.03)


@pytest.mark.parametrize('method', [
    'leapfrog', *(pytest.param(name, marks=pytest.mark.long) for name in ('srkn6', 'dop8'))])
def test_bodies_on_ropes_of_their_own_swing_each_at_its_rate(method):
    """X'' = -(k / m) (x - D): three loose shells, each on a spring along z through its centre."""
    stiffness, names = (40.0, 160.0, 640.0), ('a', 'b', 'c')
    half = 0.02 * (1.0 + math.sqrt(5.0)) / 4.0
    sections = {'weave': {'size': [1, 1, 1]}, 'bodies': {
        'b': {'position': [1.0, 0.0, 0.0]}, 'c': {'position': [2.0, 0.0, 0.0]}}}
    changes = {}
    for body, (name, k) in enumerate(zip(names, stiffness)):
        changes |= {
            f'anchors.{name}.body': body, f'anchors.{name}.edge': 'up',
            f'anchors.{name}.position': [float(body), 0.0, half + 0.11],
            f'anchors.{name}.stiffness': k, f'anchors.{name}.natural_length': 0.1}
    scene = make_scene((1, 1, 1), {
        'solver.method': method, 'solver.tolerance': 1e-7 if method == 'leapfrog' else 1e-9,
        'solver.energy_limit': 1.0, **changes}, **sections)
    simulation = ico.compile_scene(scene)
    time = 0.3
    simulation.advance_to(time)
    state = simulation.snapshot()
    rates = np.sqrt(np.array(stiffness) / scene.shell.mass)
    # All were pulled by 0.01 m.
    expected = 0.01 * (1.0 - np.cos(rates * time))
    found = state.position[:, 2] - scene.position[:, 2]
    assert np.ptp(expected) > 1e-3
    assert found == pytest.approx(expected, abs=1e-5 if method == 'leapfrog' else 1e-9)
    assert np.abs(state.angular_velocity).max() < 1e-9


def test_statics_knows_the_law_of_each_anchor():
    """A shell between a stiff spring above and a soft one below sinks by m g / (k1 + k2)."""
    half = 0.02 * (1.0 + math.sqrt(5.0)) / 4.0
    scene = tied({
        'anchors.a.edge': 'up', 'anchors.a.position': [0.0, 0.0, half + 0.1],
        'anchors.a.stiffness': 30.0, 'anchors.a.natural_length': 0.1,
        'anchors.b.edge': 'down', 'anchors.b.position': [0.0, 0.0, -half - 0.05],
        'anchors.b.stiffness': 20.0, 'anchors.b.natural_length': 0.05}, gravity=[0.0, 0.0, -9.81])
    found = ico.solve_equilibrium(scene)
    sunk = scene.shell.mass * 9.81 / 50.0
    assert found.converged
    assert found.snapshot.position[0] == pytest.approx([0.0, 0.0, -sunk], abs=1e-12)
    assert found.snapshot.energy['connectors'] == pytest.approx(25.0 * sunk**2, rel=1e-9)
    pull = ico.compile_scene(scene).reactions()
    assert pull.names == ('anchors.a', 'anchors.b')


@pytest.mark.parametrize('step', [0.0, 1e-4])
def test_an_anchor_may_be_all_that_is_there_also_where_connectors_have_a_table(step, tmp_path):
    table = tmp_path / 'law.csv'
    table.write_text('0.02,-1\n0.03,0\n0.05,2\n')
    scene = make_scene((1, 1, 1), {
        'connector.law': str(table), 'anchors.tie.body': 0, 'anchors.tie.edge': 'up',
        'anchors.tie.position': [0.0, 0.0, 0.05], 'anchors.tie.stiffness': 20.0,
        'anchors.tie.natural_length': 0.03, 'solver.step': step})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.05)
    assert np.linalg.norm(simulation.snapshot().position[0]) > 1e-4
