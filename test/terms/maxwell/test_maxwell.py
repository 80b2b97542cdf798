# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Maxwell arms of connectors: relaxation, loss in a cycle, an independent oracle, the balance."""

import math

from balance_orders import require_balance_order
from fabrics import (
    changed,
    make_scene,
    packed_state,
    pair_face_to_face,
    RANDOM,
    same_state,
)
import icofabric_sim as ico
from icofabric_sim.kernels.records import State
from icofabric_sim.kernels.rhs import find_slopes, place_blocks
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.running.run_events import do_event
from icofabric_sim.simulation.model.packing import pack_loads, pack_scene
from icofabric_sim.terms.contacts.landing import foretell
import numpy as np
import pytest
from references import axes_of, resultants
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

PLAIN = make_scene((2, 2, 1))
MASS, INERTIA, STIFFNESS = PLAIN.shell.mass, PLAIN.shell.inertia, PLAIN.connectors.stiffness
# Of the axial vibration of a pair, whose reduced mass is M / 2.
RATE = math.sqrt(2.0 * STIFFNESS / MASS)
ARM = 0.8 * STIFFNESS
ARMS = {'connector.maxwell_stiffness': ARM, 'connector.maxwell_time': 0.7 / RATE}
GROUPED = {
    'groups.low': 'z_min', 'connector_groups.g.between': 'low all',
    'connector_groups.g.maxwell_stiffness': 0.3 * STIFFNESS,
    'connector_groups.g.maxwell_time': 3.0 / RATE}


def pair(changes, stretch):
    """
    A simulation of two bodies with their connector on one line, pulled by `stretch` [m].

    Its dashpot is as long as it was before that. With the distance of the bodies at rest [m].
    """
    scene = make_scene((2, 2, 1), {**ARMS, 'solver.tolerance': 1e-9, **changes})
    simulation = ico.compile_scene(scene)
    at_rest = scene.geometry.cube_width + scene.connectors.natural_length
    position, orientation = pair_face_to_face(scene, at_rest)
    simulation.set_state(position=position, orientation=orientation, relaxed=True)
    position, orientation = pair_face_to_face(scene, at_rest + stretch)
    simulation.set_state(position=position, orientation=orientation)
    return simulation, at_rest


@pytest.mark.parametrize('part', [0.02, 0.7, 20.0])
def test_a_pair_vibrates_and_relaxes_as_a_standard_linear_solid(part):
    # mu x'' = -k x - s, s' = k_1 x' - s / tau, with mu = M / 2: a linear system of three.
    time = part / RATE
    amplitude = 1e-3 * PLAIN.geometry.pitch
    simulation, at_rest = pair({'connector.maxwell_time': time}, amplitude)
    start = simulation.snapshot()
    assert start.maxwell_tension[0] == pytest.approx(ARM * amplitude, rel=1e-9)
    matrix = np.array([
        [0.0, 1.0, 0.0], [-2.0 * STIFFNESS / MASS, 0.0, -2.0 / MASS], [0.0, ARM, -1.0 / time]])
    first = np.array([amplitude, 0.0, ARM * amplitude])
    for moment in np.array([0.3, 1.0, 5.0, 12.0]) / RATE:
        simulation.advance_to(float(moment))
        s = simulation.snapshot()
        stretch, speed, pull = expm(moment * matrix) @ first
        found = np.linalg.norm(s.position[1] - s.position[0]) - at_rest
        assert abs(found - stretch) < 3e-7 * amplitude
        assert abs(s.maxwell_tension[0] - pull) < 3e-7 * ARM * amplitude
        assert simulation.tensions()[0] == pytest.approx(
            STIFFNESS * stretch + pull, abs=1e-6 * ARM * amplitude)
        energy = s.energy
        stored = 0.5 * STIFFNESS * stretch**2 + 0.5 * pull**2 / ARM
        assert energy['connectors'] == pytest.approx(stored, abs=1e-6 * start.energy['total'])
        assert abs(energy['balance_error']) < 1e-7 * start.energy['total']
    assert energy['dissipated'] > 0.02 * start.energy['total']


@pytest.mark.long
def test_a_pull_that_is_held_decays():
    time, amplitude = 3.0 / RATE, 1e-3 * PLAIN.geometry.pitch
    simulation, _ = pair({
        'connector.maxwell_time': time, 'groups.every': 'all', 'supports.hold.group': 'every'},
        amplitude)
    for part in (0.5, 1.0, 4.0, 9.0):
        simulation.advance_to(part * time)
        s = simulation.snapshot()
        assert s.maxwell_tension[0] == pytest.approx(
            ARM * amplitude * math.exp(-part), abs=1e-7 * ARM * amplitude)
        assert s.energy['dissipated'] == pytest.approx(
            0.5 * ARM * amplitude**2 * (1.0 - math.exp(-2.0 * part)), rel=1e-6)


@pytest.mark.parametrize('part', [0.1, 1.0, 10.0])
def test_a_cycle_loses_what_it_should(part):
    # Driven by A sin(w t) the arm takes pi k_1 A^2 w tau / (1 + (w tau)^2) in each cycle.
    rate, amplitude = 0.2 * RATE, 1e-3 * PLAIN.geometry.pitch
    time = part / rate
    scene = make_scene((2, 2, 1), {
        **ARMS, 'connector.maxwell_time': time, 'solver.tolerance': 1e-9,
        'groups.a': 'ids 0', 'groups.b': 'ids 1', 'supports.hold.group': 'a',
        'drives.shake.group': 'b', 'drives.shake.motion': 'sine',
        'drives.shake.linear': [0.0, 0.0, 0.0], 'drives.shake.frequency': rate / (2.0 * math.pi)})
    ends = scene.position[scene.connectors.bodies[0]] + [
        Rotation.from_quat(scene.orientation[body]).apply(point)
        for body, point in zip(scene.connectors.bodies[0], scene.connectors.points_body[0])]
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    # Along the connector, so its length follows the path exactly.
    sign = 1.0 if scene.connectors.bodies[0][1] == 1 else -1.0
    simulation = ico.compile_scene(changed(scene, {
        'drives.shake.linear': (sign * amplitude * along).tolist()}))
    period = 2.0 * math.pi / rate
    settled = math.ceil(15.0 * time / period) * period
    taken = []
    for moment in (settled, settled + period):
        simulation.advance_to(moment)
        energy = simulation.snapshot().energy
        taken.append((energy['dissipated'], energy['work_in']))
    lost = math.pi * ARM * amplitude**2 * part / (1.0 + part**2)
    assert taken[1][0] - taken[0][0] == pytest.approx(lost, rel=1e-5)
    # Path and fabric are as they were a cycle ago: all of the work was taken.
    assert taken[1][1] - taken[0][1] == pytest.approx(lost, rel=1e-5)


def test_a_quick_arm_is_a_damper_and_a_slow_one_a_spring():
    places = {}
    short, long = 1e-3 / RATE, 1e7 / RATE
    for name, changes in {
            'quick': {'connector.maxwell_stiffness': 30.0 * ARM, 'connector.maxwell_time': short},
            'damper': {'connector.damping': 30.0 * ARM * short},
            'slow': {'connector.maxwell_stiffness': ARM, 'connector.maxwell_time': long},
            'spring': {'connector.stiffness': STIFFNESS + ARM}, 'plain': {}}.items():
        simulation = ico.compile_scene(make_scene((3, 2, 2), {
            **changes, 'solver.tolerance': 1e-9, 'solver.method': 'dop8'}, **RANDOM))
        simulation.advance_to(4.0 / RATE)
        places[name] = simulation.snapshot().position
    change = np.abs(places['damper'] - places['plain']).max()
    assert np.abs(places['quick'] - places['damper']).max() < 0.02 * change
    change = np.abs(places['spring'] - places['plain']).max()
    assert np.abs(places['slow'] - places['spring']).max() < 1e-5 * change


def arm_pulls(scene, x, axes, rest):
    """Forces and torques of the arms on all bodies, (n, 3), and their stretches (c,), by numpy."""
    bodies, points = scene.connectors.bodies, scene.connectors.points_body
    arm = np.einsum('cei,ceij->cej', points, axes[bodies])
    ends = x[bodies] + arm
    u = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(u, axis=1)
    pull = (scene.connectors.arms.stiffness * (length - rest) / length)[:, None] * u
    force, torque = np.zeros((2, scene.body_count, 3))
    for end, sign in ((0, 1.0), (1, -1.0)):
        np.add.at(force, bodies[:, end], sign * pull)
        np.add.at(torque, bodies[:, end], np.cross(arm[:, end], sign * pull))
    return force, torque, length - rest


def right_hand_side(scene):
    """Rates of (x, q, v, w, rest) of a fabric of springs with arms (references.py, and above)."""
    count = scene.body_count

    def rates(_, y):
        state = y[:13 * count].reshape(count, 13)
        x, q, v, w = state[:, :3], state[:, 3:7], state[:, 7:10], state[:, 10:]
        axes = axes_of(q / np.linalg.norm(q, axis=1)[:, None])
        force, torque, stretch = arm_pulls(scene, x, axes, y[13 * count:])
        springs, moments = resultants(scene, x, axes)
        # dq/dt = omega q / 2, scalar last.
        turn = 0.5 * np.hstack([
            w * q[:, 3:] + np.cross(w, q[:, :3]), -(w * q[:, :3]).sum(axis=1)[:, None]])
        return np.concatenate([
            np.hstack([v, turn, (force + springs) / MASS, (torque + moments) / INERTIA]).ravel(),
            stretch * scene.connectors.arms.rate])

    return rates


@pytest.mark.parametrize('changes', [pytest.param({}, marks=pytest.mark.long), GROUPED])
def test_the_motion_against_an_independent_right_hand_side(changes):
    scene = make_scene((3, 2, 2), {**ARMS, **changes, 'solver.tolerance': 1e-10}, **RANDOM)
    simulation = ico.compile_scene(scene)
    first, length = simulation.snapshot(), simulation.snapshot().connector_length
    y = np.concatenate([np.hstack([
        first.position, first.orientation, first.linear_velocity,
        first.angular_velocity]).ravel(), length])
    end = 5.0 / RATE
    found = solve_ivp(
        right_hand_side(scene), (0.0, end), y, method='DOP853', rtol=1e-11, atol=1e-13).y[:, -1]
    simulation.advance_to(end)
    s = simulation.snapshot()
    state = found[:13 * scene.body_count].reshape(-1, 13)
    a = scene.geometry.half_edge
    assert np.abs(s.position - first.position).max() > 0.1 * a
    assert np.abs(s.position - state[:, :3]).max() < 1e-8 * a
    assert np.abs(s.rest_length - found[13 * scene.body_count:]).max() < 1e-8 * a
    assert np.abs(s.rest_length - length).max() > 0.01 * a
    pull = scene.connectors.arms.stiffness * (s.connector_length - s.rest_length)
    np.testing.assert_allclose(s.maxwell_tension, pull, rtol=1e-12)
    assert abs(s.energy['balance_error']) < 1e-8 * s.energy['dissipated']
    # Nothing pushes or turns the whole.
    for values in (lambda t: MASS * t.linear_velocity.sum(axis=0),
                   lambda t: (np.cross(t.position, MASS * t.linear_velocity)
                              + INERTIA * t.angular_velocity).sum(axis=0)):
        assert np.abs(values(s) - values(first)).max() < 1e-8 * (
            MASS * np.abs(first.linear_velocity).sum() * a)


@pytest.mark.parametrize('cosines', [False, True])
def test_pulls_and_power_against_their_formula(cosines):
    scene = make_scene((3, 3, 3), {**ARMS, **GROUPED})
    free, random = make_scene((3, 3, 3)), np.random.RandomState(3)
    count, a = scene.body_count, scene.geometry.half_edge
    x = scene.position + 0.3 * a * random.standard_normal((count, 3))
    q = Rotation.random(count, random_state=4).as_quat()
    rest = scene.connectors.woven_length * random.uniform(0.5, 1.5, scene.connector_count)
    found = []
    for each in (scene, free):
        packed = pack_scene(each, cosines=cosines)
        layout, model = packed.layout, packed.model
        state = packed_state(packed, x, q)
        if model.maxwell is not None:
            state = packed.pack(layout.unpack(state), rest)
        work = layout.room(model.links, state, metered=packed.spends)
        place_blocks(model, pack_loads((), layout, stages=1), state, work, 0.0, 0, len(
            model.blocks.slot))
        slope = work.trail.slopes[0]
        find_slopes(model, pack_loads((), layout, stages=1), state, work, 0.0, slope, 0, 0, len(
            model.blocks.slot))
        row = 12 if cosines else 7
        rates = layout.gather(slope[row:row + 6])
        found.append((MASS * rates[:, :3], INERTIA * rates[:, 3:]))
        if model.maxwell is not None:
            spent = float(work.spent.power[0].sum())
            creep = packed.rest_lengths(state._replace(rest=slope[row + 6:].copy()))
    force, torque = found[0][0] - found[1][0], found[0][1] - found[1][1]
    expected, moments, stretch = arm_pulls(scene, x, axes_of(q), rest)
    own = scene.connectors.arms
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    np.testing.assert_allclose(torque, moments, rtol=0, atol=1e-10 * np.abs(moments).max())
    np.testing.assert_allclose(creep, stretch * own.rate, rtol=1e-12)
    assert spent == pytest.approx(float((
        own.stiffness * stretch**2 * own.rate).sum()), rel=1e-12)
    assert len(set(own.stiffness.tolist())) == 2


def test_the_balance_closes_at_the_order_of_the_method():
    require_balance_order(make_scene(
        (3, 3, 2), {**ARMS, 'connector.maxwell_time': 2.0 / RATE}, **RANDOM))


def test_the_same_bits_by_pieces_threads_and_from_a_checkpoint():
    scene = make_scene((4, 4, 4), {**ARMS, **GROUPED, 'solver.threads': 1}, **RANDOM)
    end = 0.02
    whole = ico.compile_scene(scene)
    whole.advance_to(end)
    expected = whole.snapshot()
    pieces = ico.compile_scene(changed(scene, {'solver.threads': 2}))
    for part in (0.21, 0.5, 0.93):
        pieces.advance_to(part * end)
        pieces.snapshot()
        if part == 0.5:
            checkpoint = pieces.checkpoint()
    restored = ico.compile_scene(scene)
    restored.restore(checkpoint)
    for simulation in (pieces, restored):
        simulation.advance_to(end)
        found = simulation.snapshot()
        assert same_state(found, expected)
        assert np.array_equal(found.rest_length, expected.rest_length)
        assert found.energy == expected.energy
    assert np.abs(expected.maxwell_tension).max() > 0.0
    # Each end keeps a rest length of its own, and they stay equal.
    packed, state = whole.packed, whole._event_loop.state()
    again = packed.pack(packed.layout.unpack(state), packed.rest_lengths(state))
    assert np.array_equal(again.rest[:, packed.layout.slot], state.rest[:, packed.layout.slot])


def test_what_sets_a_state_and_what_forgets():
    scene = make_scene((2, 2, 2), ARMS, **RANDOM)
    simulation = ico.compile_scene(scene)
    length = simulation.snapshot().connector_length
    np.testing.assert_allclose(simulation.snapshot().rest_length, length, rtol=1e-14)
    simulation.advance_to(0.01)
    before = simulation.snapshot()
    assert np.abs(before.rest_length - length).max() > 1e-3 * scene.geometry.half_edge
    simulation.set_state(linear_velocity=np.zeros((scene.body_count, 3)))
    assert np.array_equal(simulation.snapshot().rest_length, before.rest_length)
    # Brought to rest, as by the service of a node, no arm pulls.
    at_rest = ico.compile_scene(scene)
    at_rest.continue_from(simulation, keep_motion=True)
    assert np.array_equal(at_rest.snapshot().rest_length, before.rest_length)
    do_event(at_rest, 0, 'equilibrium', {
        'position': before.position, 'orientation': before.orientation})
    assert np.abs(at_rest.snapshot().maxwell_tension).max() < 1e-12 * ARM * length.max()
    # Other parameters, the same motion.
    other = ico.compile_scene(changed(scene, {'connector.maxwell_stiffness': 0.5 * ARM}))
    other.continue_from(simulation, keep_motion=True)
    assert np.array_equal(other.snapshot().rest_length, before.rest_length)
    without = ico.compile_scene(changed(scene, {'connector.maxwell_stiffness': 0.0}))
    without.continue_from(other, keep_motion=True)
    assert without.snapshot().rest_length is None
    assert not without.snapshot().maxwell_tension.any()
    back = ico.compile_scene(scene)
    back.continue_from(without, keep_motion=True)
    np.testing.assert_allclose(
        back.snapshot().rest_length, before.connector_length, rtol=1e-14)
    simulation.reset()
    np.testing.assert_allclose(simulation.snapshot().rest_length, length, rtol=1e-14)


def test_what_breaks_loses_its_arm():
    scene = make_scene((3, 2, 2), {
        **ARMS, 'solver.tolerance': 1e-9,
        'connector.break_length_extension': 1.06 * PLAIN.connectors.natural_length}, **RANDOM)
    simulation = ico.compile_scene(scene)
    simulation.advance_to(8.0 / RATE)
    s = simulation.snapshot()
    assert 0 < np.count_nonzero(~s.intact) < scene.connector_count
    assert not s.maxwell_tension[~s.intact].any() and s.maxwell_tension[s.intact].all()
    assert s.energy['lost_at_breaks'] > 0.0
    assert abs(s.energy['balance_error']) < 1e-7 * s.energy['dissipated']


@pytest.mark.long
def test_shells_that_touch_with_arms_between_them():
    scene = make_scene((3, 2, 2), {**ARMS, 'contact.mode': 'auto'}, **RANDOM)
    simulation = ico.compile_scene(scene)
    simulation.advance_to(10.0 / RATE)
    s = simulation.snapshot()
    assert simulation.status.deepest_overlap > 0.0
    assert s.energy['dissipated'] > 0.1 * s.energy['total']
    assert abs(s.energy['balance_error']) < 1e-5 * s.energy['dissipated']


def test_an_arm_counts_for_the_largest_frequency():
    plain, slow = (ico.compile_scene(make_scene((3, 3, 3), changes)).status.largest_frequency
                   for changes in ({'solver.method': 'dop8'}, {
                       **ARMS, 'connector.maxwell_time': 1e9 / RATE}))
    assert slow == pytest.approx(math.sqrt(1.0 + ARM / STIFFNESS) * plain, rel=1e-3)


@pytest.mark.parametrize('changes, name, words', [
    ({'connector.maxwell_stiffness': 3.0}, 'connector.maxwell_time', 'above 0 s'),
    ({**GROUPED, 'connector_groups.g.maxwell_time': 0.0}, 'connector_groups.g.maxwell_time',
     'above 0 s'),
    ({**ARMS, 'connector.maxwell_time': 1e-10}, 'connector.maxwell_time', 'connector.damping'),
    ({**ARMS, 'connector.maxwell_stiffness': 1e20}, 'connector.maxwell_stiffness', 'at a rate'),
    ({**ARMS, 'solver.method': 'srkn6'}, 'solver.method', 'maxwell_stiffness'),
    ({**ARMS, 'solver.method': 'sdirk4'}, 'solver.method', 'maxwell_stiffness'),
    ({**ARMS, 'solver.device': 'warp_cpu'}, 'solver.method', 'connector.maxwell_stiffness')])
def test_what_does_not_go_with_arms_is_refused_by_name(changes, name, words):
    with pytest.raises(ParameterError) as refused:
        ico.compile_scene(make_scene((2, 2, 2), changes))
    assert refused.value.name == name and words in str(refused.value)


def test_contacts_are_foreseen_by_accelerations_and_not_by_rates_of_arms():
    # Rows of a slope: places 3, quaternions 4, velocities 3, spins 3, and 12 of arms.
    generator = np.random.default_rng(3)
    rows = [generator.standard_normal((count, 8)) for count in (3, 4, 3, 3)]
    rows[1] /= np.linalg.norm(rows[1], axis=0)
    state, slope = State(*rows), generator.standard_normal((25, 8))
    place, time = np.zeros((4, 3)), 0.3
    foretell(state, slope, 2, time, place)
    position, orientation, velocity, spin = (values[:, 2] for values in rows)
    assert place[0] == pytest.approx(
        position + time * (velocity + 0.5 * time * slope[7:10, 2]), rel=1e-14)
    turn = Rotation.from_rotvec(time * (spin + 0.5 * time * slope[10:13, 2]))
    assert place[1:] == pytest.approx(
        (turn * Rotation.from_quat(orientation)).as_matrix(), abs=1e-14)
