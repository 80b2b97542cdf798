# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Far out, for long, alone, torn, driven at resonance, damped to the limit: closed forms."""

import math

import analytical
from fabrics import make_scene, pair_face_to_face, RANDOM
import icofabric_sim as ico
from moved_frames import apart, copied, displaced, EPS, Frame, rounding
import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

GRAVITY = np.array([1.0, -2.0, -9.81])


def test_each_part_of_a_torn_fabric_keeps_its_own_momenta():
    scene = make_scene(
        (5, 3, 3), {'solver.method': 'dop8', 'connector.break_length_extension': 0.034},
        groups={'foot': 'x_min', 'head': 'x_max'},
        initial={
            'foot': {'group': 'foot', 'linear_velocity': [-3.0, 0.0, 0.0]},
            'head': {'group': 'head', 'linear_velocity': [3.0, 0.0, 0.0]}},
        initial_random={'velocity_sigma': 0.1, 'seed': 3})
    simulation = ico.compile_scene(scene)
    seen = []
    for time in np.linspace(0.0, 0.03, 31):
        simulation.advance_to(time)
        seen.append(simulation.snapshot())
    compared = 0
    for one, other in zip(seen[1:], seen[2:]):
        if not np.array_equal(one.intact, other.intact):
            continue
        pairs = scene.connectors.bodies[one.intact]
        graph = coo_matrix(
            (np.ones(len(pairs)), pairs.T), shape=(scene.body_count, scene.body_count))
        count, part = connected_components(graph, directed=False)
        for number in range(count):
            bodies = part == number
            if bodies.sum() < 2:
                continue
            momenta = []
            for snapshot in (one, other):
                linear = scene.shell.mass * snapshot.linear_velocity[bodies]
                angular = np.cross(snapshot.position[bodies], linear) + (
                    scene.shell.inertia * snapshot.angular_velocity[bodies])
                momenta.append([linear.sum(axis=0), angular.sum(axis=0)])
            size = scene.shell.mass * np.abs(one.linear_velocity).sum()
            assert np.abs(momenta[1][0] - momenta[0][0]).max() < 1e-13 * size
            # Of angular momentum dop8 errs as it does of places: by the tolerance times a times t.
            errs = scene.parameters['solver.tolerance'] * scene.geometry.half_edge * (
                other.time - one.time)
            assert np.abs(momenta[1][1] - momenta[0][1]).max() < errs * size
            compared += count > 1
    assert compared > 3 and 0 < (~seen[-1].intact).sum() < scene.connector_count


def test_a_mode_driven_at_its_frequency_grows_with_time():
    # x'' = -w^2 (x - A sin(w t)) from rest: x = (A / 2) (sin(w t) - w t cos(w t)).
    flat = make_scene((2, 2, 1))
    position, orientation = pair_face_to_face(
        flat, flat.geometry.cube_width + flat.connectors.natural_length)
    rate, amplitude = math.sqrt(flat.connectors.stiffness / flat.shell.mass), 1e-5
    changes = {
        'groups.a': 'ids 0', 'groups.b': 'ids 1', 'drives.d.group': 'a',
        'drives.d.motion': 'sine', 'drives.d.linear': [amplitude, 0.0, 0.0],
        'drives.d.frequency': rate / (2.0 * math.pi), 'solver.method': 'srkn4',
        'solver.tolerance': 1e-8}
    for k, name in enumerate('ab'):
        vector = Rotation.from_quat(orientation[k]) * Rotation.from_quat(
            flat.orientation[k]).inv()
        changes |= {
            f'initial.{name}.group': name, f'initial.{name}.rotation': vector.as_rotvec().tolist(),
            f'initial.{name}.displacement': (position[k] - flat.position[k]).tolist()}
    changes['initial.b.linear_velocity'] = [0.0, 0.0, 0.0]
    changes['initial.a.linear_velocity'] = [rate * amplitude, 0.0, 0.0]
    simulation = ico.compile_scene(make_scene((2, 2, 1), changes))
    largest = 0.0
    for angle in np.linspace(0.7, 60.0, 40):
        simulation.advance_to(angle / rate)
        found = simulation.snapshot().position[1, 0] - position[1, 0]
        expected = 0.5 * amplitude * (math.sin(angle) - angle * math.cos(angle))
        assert abs(found - expected) < 1e-4 * amplitude * max(angle, 1.0)
        largest = max(largest, abs(found))
    assert largest > 20.0 * amplitude


@pytest.mark.parametrize('method', ['leapfrog', 'srkn6', 'dop8'])
@pytest.mark.parametrize('size', [
    (1, 1, 1), pytest.param((3, 3, 3), marks=pytest.mark.long)])
def test_an_hour_of_free_fall_ends_where_it_should(method, size):
    # Of one body alone, and of a fabric without connectors, each body of which turns.
    scene = make_scene(size, {
        'weave.connected': False, 'gravity': GRAVITY.tolist(), 'solver.method': method}, **RANDOM)
    simulation, first, time = ico.compile_scene(scene), scene.initial, 3600.0
    simulation.advance_to(time)
    s = simulation.snapshot()
    exact = analytical.projectile(first.position, first.linear_velocity, GRAVITY, time)
    steps = simulation.status.step_count
    assert np.abs(s.position - exact).max() < EPS * steps * np.abs(exact).max()
    assert np.abs(s.linear_velocity - first.linear_velocity - GRAVITY * time).max() < (
        EPS * steps * np.abs(s.linear_velocity).max())
    print(f'{np.abs(s.position - exact).max() / np.abs(exact).max():.2g} after {steps} steps')
    assert np.array_equal(s.angular_velocity, first.angular_velocity)
    assert np.abs(exact).max() > 6e7 and np.abs(s.energy['balance_error']) < (
        1e-9 * s.energy['kinetic'])


def test_a_thousand_kilometres_out_rounding_of_places_is_all_that_is_lost():
    scene = make_scene((4, 3, 2), {'solver.method': 'srkn6', 'solver.step': 2e-4}, **RANDOM)
    runs = []
    out = Frame(shift=np.array([1e6, -1e6, 1e6]))
    near = displaced(scene.initial, 1e-7 * scene.geometry.half_edge)
    for state in (copied(scene.initial), near, out.state(scene.initial)):
        simulation = ico.compile_scene(scene)
        simulation.set_state(**state._asdict())
        simulation.advance_to(0.05)
        runs.append(simulation.snapshot())
    growth = apart(runs[0], runs[1], simulation) / 1e-7
    found = apart(out.state(runs[0]), runs[2], simulation)
    allowed = rounding(simulation, growth, runs[2].position)
    print(f'{found:.2g} of {allowed:.2g}: one rounding is {EPS * 1e8:.2g}')
    assert 0.1 * EPS * 1e8 < found < allowed < 1e-3
    assert np.abs(runs[0].position - scene.initial.position).max() > scene.geometry.half_edge


@pytest.mark.parametrize('part', [1.0, 100.0])
def test_critical_and_hundredfold_damping(part):
    # mu x'' = -k x - c x', mu = M / 2; at c = 2 mu w: x = A (1 + w t) e^(-w t).
    flat = make_scene((2, 2, 1))
    mass, stiffness = flat.shell.mass, flat.connectors.stiffness
    rate = analytical.axial_frequency(stiffness, mass)
    scene = make_scene((2, 2, 1), {
        'connector.damping': part * mass * rate, 'solver.method': 'dop8',
        'solver.tolerance': 1e-9})
    simulation = ico.compile_scene(scene)
    rest = scene.geometry.cube_width + scene.connectors.natural_length
    amplitude = 1e-3 * rest
    position, orientation = pair_face_to_face(scene, rest + amplitude)
    simulation.set_state(position=position, orientation=orientation)
    for turns in (0.5, 1.0, 4.0):
        time = turns * part / rate
        simulation.advance_to(time)
        if part == 1.0:
            expected = (1.0 + rate * time) * math.exp(-rate * time)
        else:
            root = math.sqrt(part**2 - 1.0)
            slow, fast = -rate / (part + root), -rate * (part + root)
            expected = (slow * math.exp(fast * time) - fast * math.exp(slow * time)) / (
                slow - fast)
        s = simulation.snapshot()
        found = np.linalg.norm(s.position[1] - s.position[0]) - rest
        assert abs(found - expected * amplitude) < 2e-7 * amplitude
    assert expected < 0.2
