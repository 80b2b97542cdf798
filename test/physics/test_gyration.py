# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies whose inertia is not isotropic: tumbling against closed forms, and what it is part of."""

import math

from fabrics import changed, make_scene, RANDOM, same_state
import icofabric_sim as ico
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.running.run_monitor import RunMonitor
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.model.stability import hessian_product
from icofabric_sim.statics import modes, spectrum
from icofabric_sim.statics.periodic import make_cell
import numpy as np
import pytest
from references import axes_of, resultants
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, eigh
from scipy.spatial.transform import Rotation
from scipy.special import ellipj, ellipk

PLAIN = make_scene((2, 2, 1))
MASS, INERTIA, STIFFNESS = PLAIN.shell.mass, PLAIN.shell.inertia, PLAIN.connectors.stiffness
RATE = math.sqrt(2.0 * STIFFNESS / MASS)
# Of a body that is none of the symmetric ones; it obeys the triangle inequality.
MOMENTS = [0.8 * INERTIA, 1.1 * INERTIA, 1.5 * INERTIA]
TUMBLING = {'shell.principal_inertia': MOMENTS}
LONE = {'weave.size': [1, 1, 1], 'weave.connected': False, 'solver.tolerance': 1e-9}


def lone(moments, spin, **more):
    """One body with a spin [rad/s] on its axes, which are those of the world at the start."""
    scene = make_scene((1, 1, 1), {
        **LONE, 'shell.principal_inertia': list(moments), **more})
    simulation = ico.compile_scene(scene)
    axes = axes_of(scene.orientation)[0]
    simulation.set_state(angular_velocity=np.array([spin @ axes]))
    return simulation


def own_spin(snapshot):
    """Spins on the body axes, (n, 3)."""
    return np.einsum('bij,bj->bi', axes_of(snapshot.orientation), snapshot.angular_velocity)


def test_a_symmetric_top_precesses():
    # On its axes the spin turns about the third with (I_3 - I_1) / I_1 w_3; in the world both turn
    # about L, the axis of the top with |L| / I_1.
    moments, spin = np.array([1.0, 1.0, 1.6]) * INERTIA, np.array([20.0, 0.0, 35.0])
    simulation = lone(moments, spin)
    first = simulation.snapshot()
    momentum = first.spin_momentum[0]
    axis, size = axes_of(first.orientation)[0, 2], np.linalg.norm(momentum)
    for time in (0.01, 0.2, 1.0):
        simulation.advance_to(time)
        s = simulation.snapshot()
        angle = (moments[2] - moments[0]) / moments[0] * spin[2] * time
        expected = [20.0 * math.cos(angle), 20.0 * math.sin(angle), 35.0]
        assert np.abs(own_spin(s)[0] - expected).max() < 1e-6
        turned = Rotation.from_rotvec(momentum / moments[0] * time).apply(axis)
        assert np.abs(axes_of(s.orientation)[0, 2] - turned).max() < 1e-7
        assert np.abs(s.spin_momentum[0] - momentum).max() < 1e-8 * size
        assert s.energy['kinetic'] == pytest.approx(first.energy['kinetic'], rel=1e-8)


def test_a_symmetric_top_that_a_path_moves_along_one_axis_precesses_as_a_free_one():
    moments, spin = np.array([1.0, 1.0, 1.6]) * INERTIA, np.array([20.0, 0.0, 35.0])
    simulation = lone(moments, spin, **{
        'groups.g': 'all', 'drives.d.group': 'g', 'drives.d.freedoms': 'tx',
        'drives.d.motion': 'velocity', 'drives.d.linear': [0.1, 0.0, 0.0]})
    simulation.advance_to(1.0)
    s = simulation.snapshot()
    angle = (moments[2] - moments[0]) / moments[0] * spin[2]
    expected = [20.0 * math.cos(angle), 20.0 * math.sin(angle), 35.0]
    assert np.abs(own_spin(s)[0] - expected).max() < 1e-6
    assert s.position[0, 0] == pytest.approx(0.1, rel=1e-9)


@pytest.mark.parametrize('cosines', [False, pytest.param(True, marks=pytest.mark.long)])
def test_a_body_tumbles_by_jacobi_functions(cosines):
    # Landau and Lifshitz, Mechanics, section 37, for L^2 > 2 E I_2: about the middle axis it turns
    # over, again and again.
    one, two, three = MOMENTS
    spin = np.array([0.0, 30.0, 1.0])
    scene = make_scene((1, 1, 1), {**LONE, **TUMBLING})
    simulation = ico.compile_scene(
        scene, rotation='direction_cosines' if cosines else 'quaternion')
    simulation.set_state(angular_velocity=np.array([spin @ axes_of(scene.orientation)[0]]))
    start = simulation.snapshot()
    double, square = float((np.array(MOMENTS) * spin**2).sum()), float(
        ((np.array(MOMENTS) * spin)**2).sum())
    assert square > double * two
    rate = math.sqrt((three - two) * (square - double * one) / (one * two * three))
    k2 = (two - one) * (double * three - square) / ((three - two) * (square - double * one))
    sizes = np.array([
        math.sqrt((double * three - square) / (one * (three - one))),
        math.sqrt((double * three - square) / (two * (three - two))),
        math.sqrt((square - double * one) / (three * (three - one)))])
    # The middle component begins at its largest, a quarter period after it was zero.
    quarter, middle = float(ellipk(k2)), []
    for time in np.linspace(0.0, 1.5, 61):
        simulation.advance_to(float(time))
        found = own_spin(simulation.snapshot())[0]
        sn, cn, dn, _ = ellipj(rate * time + quarter, k2)
        assert np.abs(found - [sizes[0] * cn, sizes[1] * sn, sizes[2] * dn]).max() < 3e-5, time
        middle.append(found[1])
    s = simulation.snapshot()
    # It has turned over.
    assert min(middle) < -0.9 * spin[1] and max(middle[-20:]) > 0.0
    assert np.abs(s.spin_momentum - start.spin_momentum).max() < 1e-7 * np.abs(
        start.spin_momentum).max()
    assert abs(s.energy['balance_error']) < 1e-8 * s.energy['kinetic']


def right_hand_side(scene):
    """Rates of (x, q, v, w) of a fabric of springs, by forces of their own (references.py)."""
    moments = scene.principal_inertia

    def rates(_, y):
        state = y.reshape(scene.body_count, 13)
        x, q, v, w = state[:, :3], state[:, 3:7], state[:, 7:10], state[:, 10:]
        axes = axes_of(q / np.linalg.norm(q, axis=1)[:, None])
        force, torque = resultants(scene, x, axes)
        own = np.einsum('bij,bj->bi', axes, w)
        turn = (np.einsum('bij,bj->bi', axes, torque) - np.cross(own, moments * own)) / moments
        half = 0.5 * np.hstack([
            w * q[:, 3:] + np.cross(w, q[:, :3]), -(w * q[:, :3]).sum(axis=1)[:, None]])
        return np.hstack([
            v, half, force / scene.masses.mass[:, None],
            np.einsum('bi,bij->bj', turn, axes)]).ravel()

    return rates


# Bodies of two kinds.
UNEQUAL = {
    'groups.some': 'z_min', 'masses.some.group': 'some', 'masses.some.mass': 2.0 * MASS,
    'masses.some.principal_inertia': [2.5 * INERTIA, INERTIA, 2.0 * INERTIA]}


@pytest.mark.parametrize('changes', [pytest.param({}, marks=pytest.mark.long), UNEQUAL])
def test_a_fabric_moves_as_an_independent_right_hand_side_says(changes):
    scene = make_scene((3, 2, 2), {**TUMBLING, **changes, 'solver.tolerance': 1e-10}, **RANDOM)
    simulation = ico.compile_scene(scene)
    first = simulation.snapshot()
    end = 4.0 / RATE
    y = np.hstack([first.position, first.orientation, first.linear_velocity,
                   first.angular_velocity]).ravel()
    found = solve_ivp(
        right_hand_side(scene), (0.0, end), y, method='DOP853', rtol=1e-11,
        atol=1e-13).y[:, -1].reshape(-1, 13)
    simulation.advance_to(end)
    s = simulation.snapshot()
    a = scene.geometry.half_edge
    assert np.abs(s.position - first.position).max() > 0.1 * a
    assert np.abs(s.position - found[:, :3]).max() < 1e-8 * a
    assert np.abs(s.angular_velocity - found[:, 10:]).max() < 1e-7 * RATE
    assert abs(s.energy['balance_error']) < 1e-8 * s.energy['total']
    momenta = [RunMonitor(simulation).momentum(one) for one in (first, s)]
    assert np.abs(momenta[1].angular - momenta[0].angular).max() < 1e-8 * (
        momenta[0].angular_scale)
    # Not what nearly isotropic bodies do.
    round_inertia = [INERTIA, INERTIA, 1.001 * INERTIA]
    other = ico.compile_scene(changed(scene, {'shell.principal_inertia': round_inertia} | {
        name: round_inertia for name in changes if name.endswith('principal_inertia')}))
    other.advance_to(end)
    assert np.abs(other.snapshot().position - s.position).max() > 1e-3 * a


def test_equal_moments_are_the_isotropic_inertia():
    plain = ico.compile_scene(make_scene((3, 2, 2), {'solver.method': 'dop8'}, **RANDOM))
    same = make_scene((3, 2, 2), {
        'shell.principal_inertia': 3 * [INERTIA], 'solver.method': 'dop8'}, **RANDOM)
    assert same.principal_inertia is None
    other = ico.compile_scene(same)
    for simulation in (plain, other):
        simulation.advance_to(0.01)
    assert same_state(plain.snapshot(), other.snapshot())


def test_the_same_bits_by_pieces_threads_and_from_a_checkpoint():
    scene = make_scene((4, 4, 4), {**TUMBLING, **UNEQUAL, 'solver.threads': 1}, **RANDOM)
    end = 0.02
    whole = ico.compile_scene(scene)
    whole.advance_to(end)
    pieces = ico.compile_scene(changed(scene, {'solver.threads': 2}))
    for part in (0.3, 0.6):
        pieces.advance_to(part * end)
        pieces.snapshot()
    restored = ico.compile_scene(scene)
    restored.restore(pieces.checkpoint())
    for simulation in (pieces, restored):
        simulation.advance_to(end)
        assert same_state(simulation.snapshot(), whole.snapshot())
        assert simulation.snapshot().energy == whole.snapshot().energy


def test_driven_and_held_bodies():
    # A body that is turned about an axis that is none of its own needs the torque w x (I w).
    turning = [0.0, 3.0, 4.0]
    scene = make_scene((2, 2, 1), {
        **TUMBLING, 'weave.connected': False, 'groups.a': 'ids 0', 'groups.b': 'ids 1',
        'supports.hold.group': 'a', 'drives.spin.group': 'b', 'drives.spin.motion': 'velocity',
        'drives.spin.angular': turning})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.3)
    s = simulation.snapshot()
    assert np.array_equal(s.orientation[0], scene.orientation[0])
    assert s.angular_velocity[1] == pytest.approx(turning, abs=1e-12)
    reactions = simulation.reactions()
    torque = reactions.torque[list(reactions.names).index('drives.spin')]
    expected = np.cross(turning, s.spin_momentum[1])
    assert torque == pytest.approx(expected, rel=1e-6, abs=1e-9 * np.abs(expected).max())
    assert np.abs(expected).max() > 0.0
    # The path gives what the body turns with, more or less of it as it turns.
    assert abs(s.energy['balance_error']) < 1e-9 * s.energy['kinetic']


@pytest.mark.parametrize('changes, name, words', [
    ({'shell.principal_inertia': [INERTIA, INERTIA, 2.1 * INERTIA]},
     'shell.principal_inertia', 'the sum of the other two'),
    ({'shell.principal_inertia': [INERTIA, INERTIA, 0.0]}, 'shell.principal_inertia', 'above 0'),
    ({'shell.principal_inertia': 3 * [10.0 * INERTIA]}, 'shell.principal_inertia', 'vertices'),
    ({**TUMBLING, 'shell.inertia': INERTIA}, 'shell.principal_inertia', 'both given'),
    ({**TUMBLING, 'solver.method': 'srkn6'}, 'solver.method', 'principal_inertia'),
    ({**TUMBLING, 'solver.method': 'sdirk4'}, 'solver.method', 'principal_inertia'),
    ({**TUMBLING, 'solver.device': 'warp_cpu'}, 'solver.method', 'principal_inertia'),
    ({**TUMBLING, 'field.magnetic': [0.0, 0.0, 1.0]}, 'shell.principal_inertia', 'magnetic')])
def test_what_no_body_can_have_or_is_not_computed_is_refused(changes, name, words):
    with pytest.raises(ParameterError) as refused:
        ico.compile_scene(make_scene((2, 2, 2), changes))
    assert refused.value.name == name and words in str(refused.value)


def test_vibrations_know_the_moments(monkeypatch):
    # Against the general problem K v = w^2 M v, with both matrices on world axes by themselves.
    scene = make_scene((3, 2, 2), {
        **TUMBLING, **UNEQUAL, 'groups.base': 'x_min', 'supports.base.group': 'base',
        'supports.base.fix': 'tx rotation', 'connector.bending_stiffness': 0.02})
    found = ico.solve_modes(scene)
    packed, count = pack_scene(scene), scene.body_count
    state, hessian = packed.layout.pack(scene.initial), np.zeros((6 * count, 6 * count))
    for freedom in range(6 * count):
        motion = np.zeros((count, 6))
        motion.flat[freedom] = 1.0
        hessian[freedom] = np.hstack(hessian_product(
            packed, state, motion[:, :3], motion[:, 3:])).ravel()
    axes, masses = axes_of(scene.orientation), np.zeros((count, 6, 6))
    masses[:, :3, :3] = scene.masses.mass[:, None, None] * np.eye(3)
    masses[:, 3:, 3:] = np.einsum('bki,bk,bkj->bij', axes, scene.principal_inertia, axes)
    held = np.hstack([scene.supports.translation, np.repeat(
        scene.supports.rotation[:, None], 3, axis=1)]).ravel()
    free = np.flatnonzero(~held)
    expected = eigh(
        hessian[np.ix_(free, free)], block_diag(*masses)[np.ix_(free, free)], eigvals_only=True)
    assert np.abs(np.sort(found.frequencies**2) - expected[-len(found.frequencies):]).max() < (
        1e-10 * expected[-1])
    assert found.largest_frequency == pytest.approx(math.sqrt(expected[-1]), rel=1e-10)
    # Of kinetic energy 1/2 J at 1 rad/s, each by itself.
    shapes = found.shapes.reshape(len(found.shapes), -1)
    assert np.abs(shapes @ block_diag(*masses) @ shapes.T - np.eye(len(shapes))).max() < 1e-9
    plain = ico.solve_modes(changed(scene, {
        'shell.principal_inertia': [0.0, 0.0, 0.0],
        'masses.some.principal_inertia': [0.0, 0.0, 0.0]}))
    assert np.abs(plain.frequencies - found.frequencies).max() > 0.05 * found.frequencies[-1]
    # Of larger fabrics by a factorisation.
    monkeypatch.setattr(modes, 'DENSE', 10)
    monkeypatch.setattr(spectrum, 'DENSE', 10)
    monkeypatch.setattr(modes, 'ITERATED', 20)
    for which, part in (('lowest', slice(0, 5)), ('highest', slice(-5, None))):
        some = ico.solve_modes(scene, count=5, which=which)
        np.testing.assert_allclose(some.frequencies, found.frequencies[part], rtol=1e-8)
        assert some.mechanism_count == found.mechanism_count
        shapes = some.shapes.reshape(5, -1)
        assert np.abs(shapes @ block_diag(*masses) @ shapes.T - np.eye(5)).max() < 1e-8
    assert some.largest_frequency == pytest.approx(math.sqrt(expected[-1]), rel=1e-10)
    monkeypatch.setattr(modes, 'FACTORED', 10)
    with pytest.raises(ParameterError) as refused:
        ico.solve_modes(scene)
    assert refused.value.name == 'shell.principal_inertia'


@pytest.mark.parametrize('relaxed', [False, True])
def test_waves_know_the_moments(relaxed):
    # Against the general problem K(q) v = w^2 M v, with the mass matrix written anew.
    geometry = make_scene((2, 2, 2)).geometry
    scene = make_scene((3, 3, 3), {
        **TUMBLING, 'connector.bending_stiffness': 0.02, 'weave.kind': 'bias',
        'connector.natural_length': 0.97 * geometry.connector_length, 'contact.mode': 'never'})
    cell = make_cell(scene, relaxed=relaxed)
    turn = axes_of(scene.orientation[:1])[0]
    if relaxed:
        turn = turn @ Rotation.from_quat(cell.relaxed_state.turn).as_matrix().T
    masses = block_diag(scene.shell.mass * np.eye(3), turn.T @ np.diag(MOMENTS) @ turn)
    waves = np.random.default_rng(1).uniform(-3.0, 3.0, (20, 3)) / scene.geometry.pitch
    found = ico.solve_bands(scene, waves, relaxed=relaxed)
    for wave, bands in zip(waves, found):
        matrix = np.einsum('r,rij->ij', np.exp(1j * cell.offsets @ wave), cell.stiffness)
        squares = eigh(0.5 * (matrix + matrix.conj().T), masses, eigvals_only=True)
        np.testing.assert_allclose(
            np.sign(bands) * bands**2, squares, rtol=0, atol=1e-10 * squares[-1])
    plain = ico.solve_bands(changed(scene, {
        'shell.principal_inertia': [0.0, 0.0, 0.0]}), waves, relaxed=relaxed)
    assert np.abs(plain - found).max() > 0.05 * found.max()
    # Long waves move masses alone.
    slow = 1e-3 * waves[:3]
    np.testing.assert_allclose(
        ico.solve_bands(scene, slow, relaxed=relaxed)[:, :3],
        ico.solve_bands(changed(scene, {'shell.principal_inertia': [0.0, 0.0, 0.0]}), slow,
                        relaxed=relaxed)[:, :3], rtol=1e-3)
