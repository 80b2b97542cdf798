# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Connectors that resist bending at their ends, and twisting of their bodies against each other.
"""


from analytical import quaternion_product, rotation_quaternion
from fabrics import BOTH_FORMS, changed, make_scene, packed_state, RANDOM, same_state, wrenches
import icofabric_sim as ico
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.frequency_bound import frequency_bound
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.model.stability import hessian_product, largest_frequency
from icofabric_sim.simulation.stepping import thread_team
from icofabric_validation.benchmarks.shear_stiffness import moduli
import numpy as np
import pytest
from references import axes_of
from scipy.special import ellipk

BENT, TWISTED = {'connector.bending_stiffness': 0.05}, {'connector.twisting_stiffness': 0.04}
GROUPED = {
    'groups.low': 'z_min', 'connector_groups.g.between': 'low all',
    'connector_groups.g.bending_stiffness': 0.2, 'connector_groups.g.twisting_stiffness': 0.0}
# Moments alone, and all at once in turned bodies and with groups.
CASES = {
    'bending': {**BENT, 'connector.stiffness': 0.0},
    'twisting': {**TWISTED, 'connector.stiffness': 0.0},
    'turned': {**BENT, **TWISTED, 'weave.kind': 'bias', 'weave.azimuth': 0.3, 'weave.variant': 2},
    'grouped': {**BENT, **TWISTED, **GROUPED, 'weave.variant': 1}}


def disturbed(scene, amplitude, seed=1):
    """
    Positions and orientations away from the woven ones by about `amplitude` rad and parts of w.
    """
    generator = np.random.default_rng(seed)
    shape = (scene.body_count, 3)
    shift = 0.3 * amplitude * scene.geometry.cube_width * generator.standard_normal(shape)
    turn = rotation_quaternion(amplitude * generator.standard_normal(shape))
    return scene.position + shift, quaternion_product(turn, scene.orientation)


def energy(scene, position, orientation):
    """Stored energy [J] as a snapshot reports it."""
    rest = np.zeros_like(position)
    ledger = {'work_in': 0.0, 'start': 0.0, 'spent': 0.0, 'potential': 0.0}
    return Snapshot(
        0.0, position, orientation, rest, rest, scene.connector_count, pack_scene(scene),
        ledger).energy['connectors']


def moment_energy(scene, position, orientation):
    """The same but for springs, written down connector by connector."""
    axes, rest = axes_of(orientation), axes_of(scene.orientation)
    connectors, total = scene.connectors, 0.0
    kappa_b, kappa_t = (
        np.broadcast_to(values, len(connectors))
        for values in (connectors.bending_stiffness, connectors.twisting_stiffness))
    for c, (pair, points) in enumerate(zip(connectors.bodies, connectors.points_body)):
        ends, woven = (
            [x[body] + point @ turn[body] for body, point in zip(pair, points)]
            for x, turn in ((position, axes), (scene.position, rest)))
        d = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        n = (woven[1] - woven[0]) / np.linalg.norm(woven[1] - woven[0])
        # Rotations since the woven state.
        first, second = (axes[body].T @ rest[body] for body in pair)
        total += kappa_b[c] * (1.0 - d @ first @ n) + kappa_b[c] * (1.0 - d @ second @ n)
        total += kappa_t[c] * 0.5 * (3.0 - np.trace(second @ first.T))
    return total


@pytest.mark.parametrize('form', BOTH_FORMS)
@pytest.mark.parametrize('name', CASES)
def test_wrench_is_minus_the_gradient_and_the_hessian_its_derivative(name, form):
    scene = make_scene((3, 3, 3), CASES[name])
    packed = pack_scene(scene, cosines=form != 'quaternion')
    generator = np.random.default_rng(3)
    shift = scene.geometry.half_edge * generator.standard_normal((scene.body_count, 3))
    turn = generator.standard_normal((scene.body_count, 3))
    for amplitude in (0.1, 1.0):
        position, orientation = disturbed(scene, amplitude)

        def along(h, position=position, orientation=orientation):
            return energy(scene, position + h * shift, quaternion_product(
                rotation_quaternion(h * turn), orientation))

        work = wrenches(scene, position, orientation, cosines=form != 'quaternion')
        expected = -(work.force * shift).sum() - (work.torque * turn).sum()
        # Central differences of order 2; halving the step takes a quarter of the error.
        errors = [(along(h) - along(-h)) / (2.0 * h) - expected for h in (4e-3, 2e-3)]
        assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.1)
        assert abs((4.0 * errors[1] - errors[0]) / 3.0) < 1e-7 * abs(along(0.0))
        force, torque = hessian_product(
            packed, packed_state(packed, position, orientation), shift, turn)
        expected = (force * shift).sum() + (torque * turn).sum()
        errors = [
            (along(h) - 2.0 * along(0.0) + along(-h)) / (h * h) - expected for h in (8e-3, 4e-3)]
        assert abs((4.0 * errors[1] - errors[0]) / 3.0) < 1e-5 * (abs(expected) + along(0.0))
        if scene.parameters['connector.stiffness'] == 0.0:
            assert along(0.0) == pytest.approx(
                moment_energy(scene, position, orientation), rel=1e-12)
            assert along(0.0) > 0.05 * amplitude**2


@pytest.mark.parametrize('name', CASES)
def test_hessian_product_is_symmetric(name):
    scene = make_scene((3, 3, 3), CASES[name])
    packed = pack_scene(scene)
    state = packed_state(packed, *disturbed(scene, 0.8))
    first, second = np.random.default_rng(5).standard_normal((2, 2, scene.body_count, 3))
    one = (np.array(hessian_product(packed, state, *first)) * second).sum()
    other = (np.array(hessian_product(packed, state, *second)) * first).sum()
    assert one == pytest.approx(other, rel=1e-12)


@pytest.mark.parametrize('name', CASES)
def test_actions_are_reactions_and_the_weave_is_at_rest(name):
    scene = make_scene((4, 3, 3), CASES[name])
    still = wrenches(scene, scene.position, scene.orientation)
    position, orientation = disturbed(scene, 1.0)
    work = wrenches(scene, position, orientation)
    size = np.abs(work.torque).max() / scene.geometry.half_edge + np.abs(work.force).max()
    assert np.abs(still.force).max() < 1e-14 * size
    assert np.abs(still.torque).max() < 1e-14 * size * scene.geometry.half_edge
    assert energy(scene, scene.position, scene.orientation) < 1e-25
    assert np.abs(work.force.sum(axis=0)).max() < 1e-14 * size
    moment = (np.cross(position, work.force) + work.torque).sum(axis=0)
    assert np.abs(moment).max() < 1e-13 * size * scene.geometry.half_edge
    # A common rigid motion changes nothing.
    turn = rotation_quaternion(np.array([[0.7, -2.0, 1.1]]))
    axes = axes_of(turn)[0]
    moved = wrenches(
        scene, position @ axes + [0.1, -0.2, 0.05], quaternion_product(turn, orientation))
    np.testing.assert_allclose(moved.force, work.force @ axes, rtol=0, atol=1e-12 * size)
    np.testing.assert_allclose(
        moved.torque, work.torque @ axes, rtol=0, atol=1e-12 * size * scene.geometry.half_edge)


def test_bound_is_above_the_frequency():
    ratios = {}
    for name, changes in CASES.items():
        scene = make_scene((3, 3, 3), changes)
        for amplitude in (0.0, 0.1, 0.5, 1.0, 2.0):
            packed = pack_scene(scene)
            state = packed_state(packed, *disturbed(scene, amplitude, seed=7))
            work = packed.layout.room(packed.model.links)
            place_all(packed.model, state, work, 0, len(packed.model.blocks.slot))
            bound = frequency_bound(packed.model, state, work)
            ratios[name, amplitude] = np.sqrt(bound) / largest_frequency(packed, state).rate
    print({key: round(float(value), 3) for key, value in ratios.items()})
    assert min(ratios.values()) >= 1.0
    assert max(value for (_, amplitude), value in ratios.items() if amplitude == 0.0) < 1.5


def test_a_connector_across_has_the_angle_of_its_ends():
    # Two bodies shifted across their connector by t: both ends bend by atan(t / L).
    scene = make_scene((2, 2, 1), {**BENT, 'connector.stiffness': 0.0})
    length = scene.geometry.connector_length
    along = np.array([1.0, 0.0, 0.0])
    points = scene.connectors.points_body[0]
    span = scene.position[1] + points[1] - scene.position[0] - points[0]
    across = np.cross(span, along if abs(span[0]) < 0.5 * length else [0.0, 1.0, 0.0])
    for t in (1e-6, 0.5, 3.0):
        position = scene.position.copy()
        position[1] += t * length * across / np.linalg.norm(across)
        half = np.sin(0.5 * np.arctan(t))
        assert energy(scene, position, scene.orientation) == pytest.approx(
            2.0 * 0.05 * 2.0 * half**2, rel=1e-9)


def test_twisting_is_a_pendulum_of_any_amplitude():
    # Two free bodies: psi'' = -2 kappa / Lambda sin psi, with the period 4 K(sin^2(psi_0 / 2)) /
    # omega, psi_0 the largest angle: Lambda / 4 psi'^2 = kappa (1 - cos psi_0).
    scene = make_scene((2, 2, 1), {
        **TWISTED, 'connector.stiffness': 0.0, 'solver.method': 'srkn6',
        'solver.tolerance': 1e-9, 'contact.mode': 'never'})
    kappa, inertia = 0.04, scene.shell.inertia
    largest = 2.5
    spin = np.sqrt(kappa * (1.0 - np.cos(largest)) / inertia)
    axis = np.array([0.6, -0.48, 0.64])
    simulation = ico.compile_scene(scene)
    simulation.set_state(angular_velocity=np.array([axis, -axis]) * spin)
    period = 4.0 * ellipk(np.sin(0.5 * largest) ** 2) / np.sqrt(2.0 * kappa / inertia)
    simulation.advance_to(0.25 * period)
    turned = simulation.snapshot()
    assert turned.energy['connectors'] == pytest.approx(
        kappa * (1.0 - np.cos(largest)), rel=1e-6)
    assert np.abs(turned.angular_velocity).max() < 1e-5 * spin
    simulation.advance_to(period)
    np.testing.assert_allclose(
        simulation.snapshot().angular_velocity, np.array([axis, -axis]) * spin, rtol=0,
        atol=1e-5 * spin)


@pytest.mark.parametrize('method', [
    'leapfrog', 'srkn6', pytest.param('dop8', marks=pytest.mark.long)])
def test_energy_and_momenta_stay(method):
    scene = make_scene((4, 3, 3), {
        **BENT, **TWISTED, 'solver.method': method, 'contact.mode': 'never'}, **RANDOM)
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.1)
    s, first = simulation.snapshot(), scene.initial
    assert abs(s.energy['balance_error']) < 1e-5 * s.energy['kinetic']
    assert s.energy['connectors'] > 0.1 * s.energy['kinetic']

    def momenta(state):
        linear = scene.shell.mass * state.linear_velocity
        turning = np.cross(state.position, linear) + scene.shell.inertia * state.angular_velocity
        return linear, turning

    for before, after in zip(momenta(first), momenta(s)):
        change = (after - before).sum(axis=0)
        assert np.abs(change).max() < 1e-9 * np.abs(before).sum()


def test_same_bits_in_pieces_and_threads(monkeypatch):
    scene = make_scene((5, 5, 5), {
        **BENT, **TWISTED, 'solver.method': 'leapfrog', 'solver.threads': 2}, **RANDOM)
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 20)
    ends = []
    for threads, pieces in ((1, 1), (2, 1), (1, 5)):
        monkeypatch.setattr(thread_team, 'core_count', lambda threads=threads: threads)
        simulation = ico.compile_scene(scene)
        assert simulation.status.thread_count == threads
        for piece in range(pieces):
            simulation.advance_to(0.004 * (piece + 1) / pieces)
        ends.append(simulation.snapshot())
    assert same_state(ends[0], ends[1]) and same_state(ends[0], ends[2])
    assert np.abs(ends[0].position - scene.initial.position).max() > 1e-3 * (
        scene.geometry.half_edge)


def test_a_fabric_of_millimetres_moves_like_one_of_metres():
    ends = []
    for a, k in ((1e-3, 40.0), (1.0, 9e4)):
        scene = make_scene((3, 3, 3), {
            'shell.edge_length': 2.0 * a, 'shell.thickness': 0.2 * a,
            'shell.mass': 1e-3 * k, 'connector.stiffness': k,
            'connector.bending_stiffness': 0.3 * k * a * a, 'solver.step': 1e-4,
            'connector.twisting_stiffness': 0.2 * k * a * a, 'solver.method': 'srkn6',
            'initial_random.velocity_sigma': 3.0 * a, 'initial_random.spin_sigma': 5.0})
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.05)
        s = simulation.snapshot()
        ends.append(np.hstack([s.position / a, s.orientation]))
    assert np.abs(ends[0] - ends[1]).max() < 1e-10


def test_groups_have_their_own():
    scene = make_scene((3, 3, 3), CASES['grouped'])
    low = np.isin(scene.connectors.bodies, scene.groups['low']).any(axis=1)
    assert 0 < low.sum() < len(low)
    assert np.array_equal(scene.connectors.bending_stiffness, np.where(low, 0.2, 0.05))
    assert np.array_equal(scene.connectors.twisting_stiffness, np.where(low, 0.0, 0.04))
    with pytest.raises(ParameterError, match='connector.bending_stiffness.*at least 0'):
        changed(scene, {'connector.bending_stiffness': -1.0})


def test_point_springs_alone_do_not_resist_shear():
    plain = make_scene((3, 3, 3))
    k, width = plain.parameters['connector.stiffness'], plain.geometry.pitch
    small = 0.1 * k * plain.geometry.half_edge**2
    found = [moduli(changed(plain, changes)) for changes in (
        {}, {'connector.bending_stiffness': small}, {'connector.twisting_stiffness': small})]
    print(np.array(found) * width / k)
    assert abs(found[0][0]) * width / k < 1e-12 and found[0][1] * width / k > 0.1
    assert found[1][0] * width / k > 0.01 and found[2][0] * width / k > 0.003
