# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Charged shells in uniform fields and beside each other: closed forms and invariance."""

import math

from fabrics import make_scene, packed_state, RANDOM, same_state, SUPPORTED, wrenches
import icofabric_sim as ico
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.frequency_bound import frequency_bound
from icofabric_sim.kernels.rhs import find_slopes, place_blocks
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.electric import MAX_MUTUAL_BODIES
from icofabric_sim.simulation.model.electric import COULOMB_CONSTANT
from icofabric_sim.simulation.model.packing import pack_loads, pack_scene
from icofabric_sim.simulation.model.stability import largest_frequency
from icofabric_sim.simulation.stepping import thread_team
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import ellipk

SHELL = make_scene((1, 1, 1)).shell
MASS, INERTIA = SHELL.mass, SHELL.inertia
LOOSE = {'weave.connected': False, 'contact.mode': 'never'}
# Torques of these are about as strong as those of the connectors.
DIPOLE = {'charge.dipole': [2e-6, -1e-6, 3e-6], 'field.electric': [1e4, 2e4, -1.5e4]}
# Weaker dipoles in a stronger field: their mutual forces do not overcome connectors.
WEAK = {'charge.dipole': [4e-10, -2e-10, 6e-10], 'field.electric': [2e5, 4e5, -3e5]}
MUTUAL = {'charge.per_body': 1e-7, 'charge.mutual': True, 'contact.mode': 'never'}


def test_a_uniform_field_is_gravity_for_equal_charges():
    charge, field = -3e-6, [200.0, -5000.0, 900.0]
    gravity = [charge * e / MASS for e in field]
    method = {'solver.method': 'srkn4', 'contact.mode': 'never'}
    charged = make_scene((3, 3, 3), {
        **method, 'charge.per_body': charge, 'field.electric': field}, **RANDOM)
    heavy = make_scene((3, 3, 3), {**method, 'gravity': gravity}, **RANDOM)
    ends = []
    for scene in (charged, heavy):
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.1)
        ends.append(simulation.snapshot())
    # One rounding of the acceleration apart.
    np.testing.assert_allclose(ends[0].position, ends[1].position, rtol=0, atol=1e-11)
    energies = [end.energy for end in ends]
    assert energies[0]['field'] == pytest.approx(energies[1]['gravity'], rel=1e-9)
    assert energies[0]['gravity'] == energies[1]['field'] == 0.0 != energies[0]['field']
    assert abs(energies[0]['balance_error']) < 1e-6 * energies[0]['kinetic']


def test_cyclotron_motion_and_larmor_precession():
    # v' = (q / M) v x B: circles of radius M v / (q B). omega' = (s / Lambda) omega x B with
    # s = q Lambda / (2 M): a precession at half of that rate (Larmor).
    charge, field = 4e-4, np.array([0.0, 30.0, 40.0])
    scene = make_scene((2, 2, 2), {
        **LOOSE, 'charge.per_body': charge, 'field.magnetic': field.tolist(),
        'solver.tolerance': 1e-9}, **RANDOM)
    simulation, first = ico.compile_scene(scene), scene.initial
    assert simulation.status.method_name == 'dop8'
    assert 'field.magnetic' in simulation.status.method_reason
    rate = charge * 50.0 / MASS
    axis = field / 50.0
    for time in (0.3 / rate, 2.0 * math.pi / rate):
        simulation.advance_to(time)
        s = simulation.snapshot()
        turn = Rotation.from_rotvec(-rate * time * axis)
        np.testing.assert_allclose(
            s.linear_velocity, turn.apply(first.linear_velocity), rtol=0, atol=1e-7)
        half = Rotation.from_rotvec(-0.5 * rate * time * axis)
        np.testing.assert_allclose(
            s.angular_velocity, half.apply(first.angular_velocity), rtol=0, atol=1e-5)
        assert abs(s.energy['balance_error']) < 1e-9 * s.energy['kinetic']
    # After one turn only the motion along the field is left.
    along = np.outer(first.linear_velocity @ axis, axis) * time
    np.testing.assert_allclose(s.position - first.position, along, rtol=0, atol=1e-9)
    assert s.energy['work_in'] == s.energy['dissipated'] == 0.0


@pytest.mark.parametrize('cosines', [False, True])
def test_magnetic_force_and_torque_are_those_of_moving_charges(cosines):
    # Six charges on the axes have the second moment of the shell's, two close ones the dipole.
    charge, moment = 3e-3, np.array([2e-4, -1e-4, 3e-4])
    field = np.array([3.0, -4.0, 5.0])
    scene = make_scene((2, 2, 2), {
        **LOOSE, 'charge.per_body': charge, 'charge.dipole': moment.tolist(),
        'field.magnetic': field.tolist()})
    random, count = np.random.RandomState(2), scene.body_count
    v, w = random.standard_normal((count, 3)), 50.0 * random.standard_normal((count, 3))
    q = Rotation.random(count, random_state=2).as_quat()
    packed = pack_scene(scene, cosines=cosines)
    state = packed_state(packed, scene.position, q, v, w)
    work, last = packed.layout.room(None, state), len(packed.model.blocks.slot)
    loads = pack_loads((), packed.layout, stages=1)
    place_blocks(packed.model, loads, state, work, 0.0, 0, last)
    find_slopes(packed.model, loads, state, work, 0.0, work.trail.slopes[0], 0, 0, last)
    rates = packed.layout.gather(work.trail.slopes[0])
    force, torque = MASS * rates[:, -6:-3], INERTIA * rates[:, -3:]
    second = 0.5 * charge * INERTIA / MASS
    arm = math.sqrt(3.0 * second / charge)
    strong = 1e3 * charge
    places = np.vstack([arm * np.eye(3), -arm * np.eye(3), 0.5 * moment / strong * np.array(
        [[1.0], [-1.0]])])
    charges = np.array([charge / 6.0] * 6 + [strong, -strong])
    for b in range(count):
        r = Rotation.from_quat(q[b]).apply(places)
        f = charges[:, None] * np.cross(v[b] + np.cross(w[b], r), field)
        size = np.abs(f[:6]).sum()
        np.testing.assert_allclose(force[b], f.sum(axis=0), rtol=0, atol=1e-10 * size)
        np.testing.assert_allclose(
            torque[b], np.cross(r, f).sum(axis=0), rtol=0, atol=1e-10 * size * arm)
        # No work is done.
        power = force[b] @ v[b] + torque[b] @ w[b]
        assert abs(power) < 1e-13 * size * np.abs(v[b]).max()
    assert np.abs(torque).min() > 0.0


def test_a_dipole_swings_like_a_pendulum():
    # Lambda theta'' = -p E sin(theta): a period of 4 K(sin^2(theta_0 / 2)) sqrt(Lambda / (p E)).
    moment, field = 2e-6, 5e4
    scene = make_scene((1, 1, 1), {
        **LOOSE, 'charge.dipole': [moment, 0.0, 0.0], 'field.electric': [field, 0.0, 0.0],
        'solver.method': 'srkn6', 'solver.tolerance': 1e-9})
    simulation = ico.compile_scene(scene)
    rate = math.sqrt(moment * field / INERTIA)
    # The bound of the frequency is that of small swings.
    assert simulation.status.largest_frequency == pytest.approx(rate, rel=1e-12)
    for angle in (1e-3, 1.0, 3.0):
        turn = Rotation.from_rotvec([0.0, 0.6 * angle, 0.8 * angle])
        simulation.reset_time()
        simulation.set_state(orientation=turn.as_quat()[None])
        start = simulation.snapshot()
        assert start.energy['field'] == pytest.approx(
            moment * field * (1.0 - math.cos(angle)), rel=1e-9)
        period = 4.0 * ellipk(math.sin(0.5 * angle)**2) / rate
        simulation.advance_to(0.5 * period)
        far = Rotation.from_quat(simulation.snapshot().orientation[0])
        assert far.as_rotvec() == pytest.approx([0, -0.6 * angle, -0.8 * angle], abs=1e-6 * angle)
        simulation.advance_to(period)
        s = simulation.snapshot()
        assert Rotation.from_quat(s.orientation[0]).as_rotvec() == pytest.approx(
            [0.0, 0.6 * angle, 0.8 * angle], abs=2e-6 * angle)
        assert np.array_equal(s.position, start.position)


def field_potential(scene, position, orientation):
    """Energy [J] of dipoles and of charges on each other, pair by pair."""
    parameters = scene.parameters
    moment = Rotation.from_quat(orientation).apply(parameters['charge.dipole'])
    energy = -float((moment @ parameters['field.electric']).sum())
    if parameters['charge.mutual']:
        kappa = COULOMB_CONSTANT * parameters['charge.per_body']**2
        for i in range(len(position)):
            apart, after = position[i + 1:] - position[i], moment[i + 1:]
            distance = np.linalg.norm(apart, axis=1)
            energy += kappa * float((1.0 / distance).sum())
            # The field of each of the others at this one.
            mixed = parameters['charge.per_body'] * ((moment[i] - after) * apart).sum(axis=1)
            both = after @ moment[i] - 3.0 * (apart @ moment[i]) * (
                (after * apart).sum(axis=1)) / distance**2
            energy += COULOMB_CONSTANT * float(((mixed + both) / distance**3).sum())
    return energy


@pytest.mark.parametrize('cosines', [False, True])
def test_force_is_minus_the_gradient_of_energy(cosines):
    # Connectors stay out of it: what is left is the field alone.
    scene = make_scene((3, 3, 2), {
        **WEAK, **MUTUAL, **LOOSE, 'charge.per_body': 1e-6})
    random, count = np.random.RandomState(4), scene.body_count
    x = scene.position + 2e-3 * random.standard_normal((count, 3))
    q = Rotation.random(count, random_state=4).as_quat()
    field = scene.electric.force
    found = wrenches(scene, x, q, cosines=cosines)
    scale = np.abs(found.force).max(), np.abs(found.torque).max()
    for b in range(0, count, 2):
        for k in range(3):
            for way in range(2):
                h, ends = 1e-5, []
                for sign in (1.0, -1.0, 0.5, -0.5):
                    y, p = x.copy(), q.copy()
                    if way == 0:
                        y[b, k] += sign * h
                    else:
                        step = Rotation.from_rotvec(100.0 * sign * h * np.eye(3)[k])
                        p[b] = (step * Rotation.from_quat(q[b])).as_quat()
                    ends.append(field_potential(scene, y, p))
                h *= 1.0 if way == 0 else 100.0
                # Two steps of central differences, extrapolated.
                whole, half = (ends[0] - ends[1]) / (2.0 * h), (ends[2] - ends[3]) / h
                slope = (4.0 * half - whole) / 3.0
                assert abs(found[way][b, k] + slope) < 2e-7 * scale[way]
    # Action is reaction, up to the rounding of a sum in another order.
    assert np.abs(found.force.sum(axis=0)).max() < 1e-13 * np.abs(found.force).sum()
    # So is the torque, but for that of the uniform field.
    moment = Rotation.from_quat(q).apply(scene.parameters['charge.dipole'])
    torque = np.cross(x, found.force) + found.torque - np.cross(
        moment, scene.parameters['field.electric'])
    assert np.abs(torque.sum(axis=0)).max() < (
        1e-13 * np.abs(found.force).sum() * np.abs(x).max())
    assert scale[0] > 0.0 < scale[1] and field.any()


def test_two_charges_fly_apart():
    # Radial motion from rest at r_0: with x = r / r_0 and u = sqrt(x (x - 1)),
    # t = sqrt(M r_0^3 / (4 kappa)) (u + arsinh(sqrt(x - 1))).
    scene = make_scene((2, 2, 1), {
        **LOOSE, **MUTUAL, 'solver.method': 'srkn6', 'solver.tolerance': 1e-9})
    simulation = ico.compile_scene(scene)
    start = simulation.snapshot()
    kappa = COULOMB_CONSTANT * 1e-14
    near = np.linalg.norm(start.position[1] - start.position[0])
    for x in (1.01, 1.7, 6.0):
        time = math.sqrt(MASS * near**3 / (4.0 * kappa)) * (
            math.sqrt(x * (x - 1.0)) + math.asinh(math.sqrt(x - 1.0)))
        simulation.advance_to(time)
        s = simulation.snapshot()
        gap = s.position[1] - s.position[0]
        assert np.linalg.norm(gap) == pytest.approx(x * near, rel=1e-7)
        assert s.energy['field'] == pytest.approx(kappa / (x * near), rel=1e-7)
        assert abs(s.energy['balance_error']) < 1e-8 * start.energy['field']
        np.testing.assert_allclose(
            s.linear_velocity.sum(axis=0), 0.0, rtol=0,
            atol=1e-14 * np.abs(s.linear_velocity).max())


@pytest.mark.parametrize('method', [
    pytest.param('leapfrog', marks=pytest.mark.long), 'dop8'])
def test_a_fabric_with_everything_keeps_its_balance_and_its_bits(method, monkeypatch):
    scene = make_scene((4, 3, 3), {
        **WEAK, **MUTUAL, 'charge.per_body': 2e-7, 'solver.method': method,
        'solver.step': 4e-5}, **SUPPORTED, **RANDOM)
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1)
    ends = []
    for threads, pieces in ((1, 1), (2, 1), (2, 4)):
        monkeypatch.setattr(thread_team, 'core_count', lambda threads=threads: threads)
        simulation = ico.compile_scene(scene)
        for piece in range(pieces):
            simulation.advance_to(0.04 * (piece + 1) / pieces)
        ends.append(simulation.snapshot())
    # All places are those of one moment, whichever thread computes them.
    assert all(same_state(ends[0], end) for end in ends[1:])
    energy, held = ends[0].energy, scene.supports
    size = max(abs(energy[name]) for name in ('kinetic', 'connectors', 'field'))
    assert abs(energy['balance_error']) < (1e-3 if method == 'leapfrog' else 1e-9) * size
    assert simulation.balance.worst < (3e-3 if method == 'leapfrog' else 1e-9)
    first = scene.initial
    assert np.array_equal(ends[0].position[held.translation], first.position[held.translation])
    assert abs(energy['field']) > 1e-2 * energy['kinetic']
    other = ico.compile_scene(scene)
    other.advance_to(0.0123)
    rest = ico.compile_scene(scene)
    rest.restore(other.checkpoint())
    rest.advance_to(0.04)
    assert same_state(rest.snapshot(), ends[0])


def test_the_frequency_is_not_below_that_of_all_forces():
    for changes in (DIPOLE, MUTUAL, {**WEAK, **MUTUAL, 'charge.per_body': 3e-6}):
        scene = make_scene((2, 3, 2), {**changes, 'contact.mode': 'never'})
        random, count = np.random.RandomState(7), scene.body_count
        x = scene.position + 1e-3 * random.standard_normal((count, 3))
        q = Rotation.random(count, random_state=7).as_quat()
        h, columns = 1e-6, []
        for b in range(count):
            for k in range(6):
                ends = []
                for sign in (1.0, -1.0):
                    y, p = x.copy(), q.copy()
                    if k < 3:
                        y[b, k] += sign * h * math.sqrt(1.0 / MASS) * 1e-2
                    else:
                        turn = sign * h * math.sqrt(1.0 / INERTIA) * 1e-2 * np.eye(3)[k - 3]
                        p[b] = (Rotation.from_rotvec(turn) * Rotation.from_quat(q[b])).as_quat()
                    found = wrenches(scene, y, p)
                    ends.append(np.hstack([
                        found.force / math.sqrt(MASS), found.torque / math.sqrt(INERTIA)]))
                columns.append((ends[1] - ends[0]).ravel() / (2e-2 * h))
        matrix = np.array(columns)
        largest = float(np.linalg.eigvalsh(0.5 * (matrix + matrix.T)).max())
        packed = pack_scene(scene)
        state = packed_state(packed, x, q)
        work = packed.layout.room(packed.model.links)
        place_all(packed.model, state, work, 0, len(packed.model.blocks.slot))
        rate = largest_frequency(packed, state).rate
        bound = math.sqrt(frequency_bound(packed.model, state, work))
        assert math.sqrt(largest) * (1.0 - 1e-4) < rate
        assert rate < bound * (1.0 + 1e-9) and rate < 2.0 * math.sqrt(largest)
        bare = largest_frequency(pack_scene(make_scene((2, 3, 2))), state).rate
        assert rate > bare
        if packed.model.coulomb is not None:
            # Two charges at one place: numbers are too large, and no step is safe.
            x[0], x[1] = 0.0, 1e-130
            assert largest_frequency(packed, packed_state(packed, x, q)).rate == math.inf


def test_too_many_charges_are_refused():
    size = [22, 22, 22]
    assert make_scene(size).body_count > MAX_MUTUAL_BODIES
    with pytest.raises(ParameterError) as caught:
        make_scene(size, {'charge.mutual': True})
    for word in ('charge.mutual', f'{MAX_MUTUAL_BODIES:,}', 'square'):
        assert word in str(caught.value)


def test_fields_without_charges_cost_nothing():
    for changes in ({'field.electric': [1.0, 0.0, 0.0]}, {'field.magnetic': [0.0, 0.0, 1.0]},
                    {'charge.per_body': 1e-6}, {'charge.dipole': [1e-6, 0.0, 0.0]},
                    {'charge.mutual': True}):
        model = pack_scene(make_scene((2, 2, 2), changes)).model
        assert model.gravity is model.dipole is model.magnet is model.coulomb is None
    scene = make_scene((2, 2, 2), {'field.magnetic': [0.0, 0.0, 1.0]})
    assert ico.compile_scene(scene).status.method_name != 'dop8'


def test_a_step_follows_charges_that_come_close():
    # Shot at each other: the bound of the frequency sees them coming, and the step follows.
    scene = make_scene((2, 2, 1), {
        **LOOSE, **MUTUAL, 'solver.method': 'srkn4', 'solver.tolerance': 1e-7})
    simulation = ico.compile_scene(scene)
    start = simulation.snapshot()
    way = start.position[1] - start.position[0]
    speed = 6.0 * way / np.linalg.norm(way)
    simulation.set_state(linear_velocity=np.array([speed, -speed]))
    energy = simulation.snapshot().energy['total']
    closest = np.inf
    for time in np.linspace(1e-4, 0.02, 60):
        simulation.advance_to(float(time))
        s = simulation.snapshot()
        closest = min(closest, np.linalg.norm(s.position[1] - s.position[0]))
    assert closest < 0.8 * np.linalg.norm(way)
    assert (s.linear_velocity[0] @ way) < 0.0
    assert abs(s.energy['total'] - energy) < 1e-5 * energy
