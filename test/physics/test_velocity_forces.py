# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Damping along connectors and drag: closed forms, invariance, and the energy that they take."""

import analytical
from balance_orders import require_balance_order
from fabrics import (
    changed,
    make_scene,
    packed_state,
    pair_face_to_face,
    RANDOM,
    same_state,
    SUPPORTED,
)
import icofabric_sim as ico
from icofabric_sim.kernels.rhs import find_slopes, place_blocks
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.model.packing import pack_loads, pack_scene
from icofabric_sim.simulation.stepping import thread_team
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

PLAIN = make_scene((2, 2, 1))
MASS, INERTIA, STIFFNESS = PLAIN.shell.mass, PLAIN.shell.inertia, PLAIN.connectors.stiffness
# Of the axial vibration of a pair, whose reduced mass is M / 2.
CRITICAL = MASS * analytical.axial_frequency(STIFFNESS, MASS)
DAMPED = {'connector.damping': 0.05, 'contact.mode': 'never', 'solver.method': 'dop8'}
DRAGGED = {
    'drag.linear': 2e-3, 'drag.angular': 3e-7, 'contact.mode': 'never', 'solver.method': 'dop8'}


@pytest.mark.parametrize('part', [0.05, 0.7, 3.0, 300.0])
def test_damped_oscillator(part):
    # mu x'' = -k x - c x' with mu = M / 2: x = A (a e^(b t) - b e^(a t)) / (a - b), where a and b
    # solve mu z^2 + c z + k = 0.
    damping = part * CRITICAL
    scene = make_scene((2, 2, 1), {
        **DAMPED, 'connector.damping': damping, 'solver.tolerance': 1e-9})
    simulation = ico.compile_scene(scene)
    rest = scene.geometry.cube_width + scene.connectors.natural_length
    amplitude = 1e-3 * rest
    position, orientation = pair_face_to_face(scene, rest + amplitude)
    simulation.set_state(position=position, orientation=orientation)
    start = simulation.snapshot().energy['total']
    roots = np.roots([0.5 * MASS, damping, STIFFNESS]).astype(complex)
    if part < 1.0:
        times = np.array([0.1, 0.5, 1.0, 2.0]) / abs(roots[0])
    else:
        times = np.array([0.01, 0.1, 0.3]) / abs(roots).min()
    for time in times:
        simulation.advance_to(float(time))
        s = simulation.snapshot()
        a, b = roots
        expected = (amplitude * (a * np.exp(b * time) - b * np.exp(a * time)) / (a - b)).real
        found = np.linalg.norm(s.position[1] - s.position[0]) - rest
        assert abs(found - expected) < 2e-7 * amplitude
        assert s.energy['dissipated'] == pytest.approx(start - s.energy['total'], rel=1e-5)
    assert s.energy['dissipated'] > 0.1 * start
    # An explicit method follows the fast decay of a stiff damper, with steps as short as that.
    assert simulation.status.step * abs(roots).max() < 10.0


def test_drag_decays_and_falls_at_its_own_speed():
    # v' = g - (gamma / M) v, omega' = -(gamma' / Lambda) omega.
    gravity = np.array([0.3, -0.2, -9.81])
    scene = make_scene((2, 2, 2), {
        **DRAGGED, 'weave.connected': False, 'gravity': gravity.tolist(),
        'solver.tolerance': 1e-9}, **RANDOM)
    simulation, first = ico.compile_scene(scene), scene.initial
    rate, turning = 2e-3 / MASS, 3e-7 / INERTIA
    terminal = gravity / rate
    for time in (0.3 / rate, 2.0 / rate, 30.0 / rate):
        simulation.advance_to(time)
        s = simulation.snapshot()
        left = np.exp(-rate * time)
        expected = terminal + (first.linear_velocity - terminal) * left
        np.testing.assert_allclose(s.linear_velocity, expected, rtol=0, atol=1e-7)
        way = terminal * time + (first.linear_velocity - terminal) * (1.0 - left) / rate
        np.testing.assert_allclose(s.position - first.position, way, rtol=0, atol=1e-7)
        spin = first.angular_velocity * np.exp(-turning * time)
        np.testing.assert_allclose(s.angular_velocity, spin, rtol=0, atol=1e-5)
        angle = first.angular_velocity * (1.0 - np.exp(-turning * time)) / turning
        exact = analytical.free_rotation(first.orientation, angle, 1.0)
        assert analytical.rotation_distance(s.orientation, exact).max() < 1e-6
        assert abs(s.energy['balance_error']) < 1e-8 * s.energy['dissipated']
    np.testing.assert_allclose(s.linear_velocity, [terminal] * 4, rtol=1e-9)


def slopes(scene, position, orientation, velocity, spin, *, cosines=False):
    """
    Forces and torques on all bodies, and what is spent [W], at one moment; supports left out.
    """
    packed = pack_scene(scene, cosines=cosines)
    layout, model = packed.layout, packed.model._replace(supports=None)
    state = packed_state(packed, position, orientation, velocity, spin)
    work = layout.room(
        model.links, state, damped=model.damping is not None, metered=packed.spends)
    last, slope = len(model.blocks.slot), work.trail.slopes[0]
    loads = pack_loads((), layout, stages=1)
    place_blocks(model, loads, state, work, 0.0, 0, last)
    find_slopes(model, loads, state, work, 0.0, slope, 0, 0, last)
    rates = layout.gather(slope)
    spent = 0.0 if work.spent is None else float(work.spent.power[0].sum())
    return MASS * rates[:, -6:-3], INERTIA * rates[:, -3:], spent


def random_motion(scene, seed):
    """Any places, orientations, velocities and spins."""
    random, count = np.random.RandomState(seed), scene.body_count
    half_edge = scene.geometry.half_edge
    return (
        scene.position + 0.3 * half_edge * random.standard_normal((count, 3)),
        Rotation.random(count, random_state=seed).as_quat(),
        random.standard_normal((count, 3)), 50.0 * random.standard_normal((count, 3)))


@pytest.mark.parametrize('cosines', [False, True])
def test_damping_against_its_formula(cosines):
    groups = {'groups.low': 'z_min', 'connector_groups.g.between': 'low all',
              'connector_groups.g.damping': 0.2}
    free = make_scene((3, 3, 3))
    for changes in ({}, groups):
        scene = make_scene((3, 3, 3), {**DAMPED, **changes})
        x, q, v, w = random_motion(scene, 3)
        force, torque, spent = slopes(scene, x, q, v, w, cosines=cosines)
        others = slopes(free, x, q, v, w, cosines=cosines)
        force, torque = force - others[0], torque - others[1]
        expected, moments, power = np.zeros_like(x), np.zeros_like(x), 0.0
        c = np.broadcast_to(scene.connectors.damping, scene.connector_count)
        for k, (i, j) in enumerate(scene.connectors.bodies):
            arms = [Rotation.from_quat(q[b]).apply(scene.connectors.points_body[k, end])
                    for end, b in enumerate((i, j))]
            u = x[j] + arms[1] - x[i] - arms[0]
            n = u / np.linalg.norm(u)
            rate = n @ (v[j] + np.cross(w[j], arms[1]) - v[i] - np.cross(w[i], arms[0]))
            for b, arm, pull in ((i, arms[0], c[k] * rate * n), (j, arms[1], -c[k] * rate * n)):
                expected[b] += pull
                moments[b] += np.cross(arm, pull)
            power += c[k] * rate**2
        np.testing.assert_allclose(force, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
        np.testing.assert_allclose(torque, moments, rtol=0, atol=1e-10 * np.abs(moments).max())
        assert spent == pytest.approx(power, rel=1e-12)
        # What is spent is what the bodies lose; nothing pushes or turns the whole.
        assert spent == pytest.approx(-float((force * v).sum() + (torque * w).sum()), rel=1e-11)
        scale = np.abs(force).sum()
        assert np.abs(force.sum(axis=0)).max() < 1e-13 * scale
        turn = (np.cross(x, force) + torque).sum(axis=0)
        assert np.abs(turn).max() < 1e-12 * scale * np.abs(x).max()
    assert len(scene.connectors.damping) == scene.connector_count
    assert set(scene.connectors.damping) == {0.05, 0.2}


def test_a_common_rigid_motion_is_not_damped():
    scene = make_scene((3, 3, 3), DAMPED)
    x, q, _, _ = random_motion(scene, 5)
    spin = np.array([30.0, -20.0, 50.0])
    v = np.array([3.0, 1.0, -2.0]) + np.cross(spin, x)
    rigid = slopes(scene, x, q, v, np.broadcast_to(spin, x.shape))
    free = slopes(make_scene((3, 3, 3)), x, q, v, np.broadcast_to(spin, x.shape))
    scale = 0.05 * np.abs(v).max()
    assert np.abs(rigid[0] - free[0]).max() < 1e-12 * max(scale, np.abs(free[0]).max())
    assert rigid[2] < 1e-24 * scale * np.abs(v).max() / 1e-3


def test_the_balance_closes_at_the_order_of_the_method():
    require_balance_order(make_scene(
        (3, 3, 2), {**DAMPED, 'drag.linear': 1e-3, 'drag.angular': 1e-7}, **RANDOM))


def test_states_within_an_adaptive_step_balance_too():
    scene = make_scene((3, 3, 2), {**DAMPED, 'drag.linear': 1e-3, 'drag.angular': 1e-7}, **RANDOM)
    simulation, worst = ico.compile_scene(scene), 0.0
    for time in np.linspace(0.0, 0.02, 101):
        simulation.advance_to(float(time))
        energy = simulation.snapshot().energy
        worst = max(worst, abs(energy['balance_error']))
    assert worst < 1e-6 * energy['dissipated']
    assert simulation.balance.worst < 1e-6


def test_held_freedoms_stay_held():
    scene = make_scene((3, 3, 3), DAMPED, **SUPPORTED, **RANDOM)
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.05)
    s, first, held = simulation.snapshot(), scene.initial, scene.supports
    assert np.array_equal(s.position[held.translation], first.position[held.translation])
    assert np.array_equal(s.orientation[held.rotation], first.orientation[held.rotation])
    assert s.energy['dissipated'] > 1e-3
    assert abs(s.energy['balance_error']) < 1e-6 * s.energy['dissipated']


def test_threads_pieces_and_checkpoints_give_the_same_bits(monkeypatch):
    scene = make_scene((4, 3, 3), DAMPED, **RANDOM)
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1)
    ends, spent = [], []
    for threads, pieces in ((1, 1), (2, 1), (2, 5)):
        monkeypatch.setattr(thread_team, 'core_count', lambda threads=threads: threads)
        simulation = ico.compile_scene(scene)
        for piece in range(pieces):
            simulation.advance_to(0.03 * (piece + 1) / pieces)
            simulation.snapshot()
        ends.append(simulation.snapshot())
        spent.append(ends[-1].energy['dissipated'])
    half = ico.compile_scene(scene)
    half.advance_to(0.0123)
    rest = ico.compile_scene(scene)
    rest.restore(half.checkpoint())
    assert rest.snapshot().energy == half.snapshot().energy
    rest.advance_to(0.03)
    ends.append(rest.snapshot())
    spent.append(ends[-1].energy['dissipated'])
    assert all(same_state(ends[0], end) for end in ends[1:])
    assert len(set(spent)) == 1 and spent[0] > 0.0


def test_a_jump_begins_a_new_balance():
    simulation = ico.compile_scene(make_scene((3, 3, 2), DAMPED, **RANDOM))
    simulation.advance_to(0.02)
    assert simulation.snapshot().energy['dissipated'] > 0.0
    simulation.reset()
    energy = simulation.snapshot().energy
    assert energy['dissipated'] == 0.0
    assert abs(energy['balance_error']) < 1e-14 * energy['total']


def test_one_dimensionless_run_for_all_sizes():
    ends = []
    for scale in (1.0, 1000.0):
        # Lengths by 1000; mass by its cube, k by its square, so times by its root, c by 1000^2.5.
        scene = make_scene((3, 2, 2), {
            'shell.edge_length': 2e-3 * scale, 'shell.thickness': 2e-4 * scale,
            'connector.stiffness': 5e-2 * scale**2, 'connector.damping': 2e-5 * scale**2.5,
            'drag.linear': 1e-6 * scale**2.5, 'drag.angular': 1e-13 * scale**4.5,
            'initial_random.velocity_sigma': 0.05 * scale**0.5,
            'initial_random.spin_sigma': 20.0 * scale**-0.5, 'initial_random.seed': 1,
            'contact.mode': 'never', 'solver.method': 'dop8',
            'solver.tolerance': 1e-8 * scale**-0.5})
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.05 * scale**0.5)
        s = simulation.snapshot()
        ends.append((
            s.position / scale, s.linear_velocity / scale**0.5,
            s.energy['dissipated'] / scale**4))
    size = np.abs(ends[0][0]).max()
    np.testing.assert_allclose(ends[0][0], ends[1][0], rtol=0, atol=1e-9 * size)
    assert ends[0][2] == pytest.approx(ends[1][2], rel=1e-7) and ends[0][2] > 0.0


def test_methods_that_cannot_are_refused():
    for changes, word in (
            ({'connector.damping': 1.0}, 'damped'), ({'drag.linear': 1.0}, 'drag.linear'),
            ({'drag.angular': 1.0}, 'drag.angular')):
        scene = make_scene((2, 2, 2), {**changes, 'solver.method': 'srkn6'})
        with pytest.raises(ParameterError) as caught:
            ico.compile_scene(scene)
        for part in ('solver.method', word, 'dop8'):
            assert part in str(caught.value)
    simulation = ico.compile_scene(make_scene((2, 2, 2), {'connector.damping': 1.0}))
    assert simulation.status.method_name == 'dop8' and 'damped' in simulation.status.method_reason
    with pytest.raises(ParameterError, match='connector.damping'):
        make_scene((2, 2, 2), {'connector.damping': -1.0})


def test_a_fixed_step_knows_the_limit_of_its_damping():
    # Twenty times critical: the limit follows the decay, not the vibration.
    scene = make_scene((2, 2, 2), {**DAMPED, 'connector.damping': 20.0 * CRITICAL})
    limit = ico.compile_scene(scene).status.stability_limit
    assert limit < 0.1 * ico.compile_scene(make_scene((2, 2, 2), {
        'solver.method': 'dop8'})).status.stability_limit
    with pytest.raises(ValueError, match='stability limit'):
        ico.compile_scene(changed(scene, {'solver.step': 1.01 * limit}))
