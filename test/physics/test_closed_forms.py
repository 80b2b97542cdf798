# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Motions that are known exactly."""

import analytical
from fabrics import BOTH_FORMS, changed, FORMS, make_scene, pair_face_to_face, RANDOM
import icofabric_sim as ico
import numpy as np
import pytest

STEPS = (0.0, 1e-4, 0.0137, 2.5)
# What is exact of it here is the leapfrog's own closed form.
PAIR = make_scene(
    (2, 2, 1), {'solver.step': 1e-5, 'solver.method': 'leapfrog', 'solver.energy_limit': 0.1})
MASS, INERTIA, STIFFNESS = PAIR.shell.mass, PAIR.shell.inertia, PAIR.connectors.stiffness
ARM = 0.5 * PAIR.geometry.cube_width
LENGTH = PAIR.connectors.natural_length


def two_bodies(scene, *, distance=None, rotation='quaternion', **state):
    """Simulation of two bodies; with a `distance`, their connector is on the line of centres."""
    simulation = ico.compile_scene(scene, rotation=rotation)
    if distance is not None:
        position, orientation = pair_face_to_face(scene, distance)
        simulation.set_state(position=position, orientation=orientation, **state)
    return simulation


@pytest.mark.parametrize('form', BOTH_FORMS)
@pytest.mark.parametrize('step', STEPS)
def test_free_flight_and_free_spin_are_exact_for_any_step(form, step):
    scene = make_scene((2, 2, 2), {'weave.connected': False, 'solver.step': step}, **RANDOM)
    start = scene.initial
    simulation = ico.compile_scene(scene, rotation=form)
    time = 3.7
    simulation.advance_to(time)
    s = simulation.snapshot()
    expected = analytical.projectile(start.position, start.linear_velocity, np.zeros(3), time)
    np.testing.assert_allclose(s.position, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    assert np.array_equal(s.linear_velocity, start.linear_velocity)
    assert np.array_equal(s.angular_velocity, start.angular_velocity)
    # Every step adds rounding of the angle it turns by; up to 37,000 steps and 300 rad here.
    expected = analytical.free_rotation(start.orientation, start.angular_velocity, time)
    assert analytical.rotation_distance(s.orientation, expected).max() < 1e-11
    np.testing.assert_allclose(np.linalg.norm(s.orientation, axis=1), 1.0, rtol=0, atol=4e-16)
    assert np.linalg.norm(start.angular_velocity * time, axis=1).min() > 100.0
    assert np.abs(s.position - start.position).min() > 0.1


@pytest.mark.parametrize('spin', [1e-9, 1e-3, 1.0, 1e5])
def test_free_spin_at_any_rate(spin):
    # The smooth factors near zero and those of large angles meet at 2e-4 rad for each step.
    scene = make_scene(
        (1, 1, 1),
        {
            'solver.step': 0.01,
            'initial.i.group': 'all',
            'initial.i.angular_velocity': [0.6 * spin, -0.48 * spin, 0.64 * spin],
        },
    )
    simulation = ico.compile_scene(scene)
    simulation.advance_to(1.0)
    turn = 2.0 * np.linalg.norm(simulation.snapshot().orientation[:, :3])
    expected = analytical.free_rotation(
        scene.initial.orientation, scene.initial.angular_velocity, 1.0
    )
    error = analytical.rotation_distance(simulation.snapshot().orientation, expected)[0]
    # A hundred products of quaternions, and the rounding of the angle of each step.
    assert error <= 1e-14 + 4e-16 * spin
    if spin < 0.01:
        assert turn == pytest.approx(spin, rel=1e-6)


@pytest.mark.parametrize('step', STEPS)
@pytest.mark.parametrize('size', [(1, 1, 1), (3, 2, 2)])
def test_gravity_parabola(size, step):
    gravity = [0.3, -1.7, -9.81]
    scene = make_scene(
        size, {'gravity': gravity, 'solver.step': min(step, 1e-4) if size[0] > 1 else step}
    )
    simulation = ico.compile_scene(scene)
    time = 1.3
    simulation.advance_to(time)
    s = simulation.snapshot()
    expected = analytical.projectile(scene.position, 0.0, gravity, time)
    np.testing.assert_allclose(s.position, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    velocity = np.broadcast_to(np.array(gravity) * time, s.linear_velocity.shape)
    np.testing.assert_allclose(s.linear_velocity, velocity, rtol=1e-11, atol=1e-11)
    # A fabric at rest falls without stretching or turning.
    np.testing.assert_allclose(s.orientation, scene.orientation, atol=1e-11)
    assert (s.position - scene.position)[:, 2].max() < -8.0


@pytest.mark.parametrize('form', BOTH_FORMS)
def test_two_bodies_along_their_connector(form):
    amplitude = 0.1 * LENGTH
    frequency = analytical.axial_frequency(STIFFNESS, MASS)
    step = 0.2 / frequency
    # Sideways there is no stiffness when the connector is too short, but no force either.
    simulation = two_bodies(
        changed(PAIR, {'solver.step': step}),
        rotation=form,
        distance=2.0 * ARM + LENGTH + amplitude,
    )
    discrete = analytical.leapfrog_frequency(frequency, step)
    lengths, expected = [], []
    for count in range(0, 2000, 37):
        simulation.advance_to(count * step)
        s = simulation.snapshot()
        lengths.append(s.position[1, 0] - s.position[0, 0] - 2.0 * ARM - LENGTH)
        expected.append(amplitude * np.cos(discrete * simulation.status.step_count * step))
    # The leapfrog's own closed form, to rounding; it tends to the true one as (omega h)^2 / 24.
    np.testing.assert_allclose(lengths, expected, rtol=0, atol=1e-9 * amplitude)
    assert discrete / frequency - 1.0 == pytest.approx(0.2**2 / 24.0, rel=0.01)
    assert min(lengths) < -0.9 * amplitude
    assert np.abs(s.angular_velocity).max() * step < 1e-9


def test_two_bodies_along_their_connector_tend_to_the_exact_solution():
    amplitude = 0.1 * LENGTH
    frequency = analytical.axial_frequency(STIFFNESS, MASS)
    time = 5.0 / frequency
    errors = []
    for count in (50, 100, 200):
        simulation = two_bodies(
            changed(PAIR, {'solver.step': time / count}), distance=2.0 * ARM + LENGTH + amplitude
        )
        simulation.advance_to(time)
        s = simulation.snapshot()
        length = s.position[1, 0] - s.position[0, 0] - 2.0 * ARM - LENGTH
        errors.append(abs(length - amplitude * np.cos(frequency * time)) / amplitude)
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.02)
    assert errors[-1] < 2e-4


@pytest.mark.parametrize('form', FORMS)
def test_woven_pair_rocks_in_its_only_mode(form):
    # The connector of a woven pair passes beside the centres: bodies rock as it stretches.
    arms = PAIR.connectors.points_body[0]
    ends = PAIR.position + arms
    direction = (ends[1] - ends[0]) / LENGTH
    mode = analytical.pair_mode(STIFFNESS, MASS, INERTIA, arms, direction)
    step = 0.05 / mode.frequency
    simulation = ico.compile_scene(changed(PAIR, {'solver.step': step}), rotation=form)
    assert simulation.status.largest_frequency == pytest.approx(mode.frequency, rel=1e-9)
    amplitude = 1e-6 * LENGTH
    simulation.set_state(
        position=PAIR.position + amplitude * mode.shift,
        orientation=analytical.free_rotation(PAIR.orientation, amplitude * mode.turn, 1.0),
    )
    discrete = analytical.leapfrog_frequency(mode.frequency, step)
    lengths, turns, expected = [], [], []
    for count in range(0, 500, 13):
        simulation.advance_to(count * step)
        s = simulation.snapshot()
        lengths.append(s.connector_length[0] - LENGTH)
        turns.append(2.0 * s.orientation[:, :3])
        expected.append(amplitude * np.cos(discrete * simulation.status.step_count * step))
    # The mode leaves out quadratic terms, which are smaller by the amplitude.
    np.testing.assert_allclose(lengths, expected, rtol=0, atol=1e-4 * amplitude)
    np.testing.assert_allclose(
        turns,
        np.multiply.outer(expected, mode.turn),
        rtol=0,
        atol=1e-4 * amplitude * np.abs(mode.turn).max(),
    )
    assert np.ptp(expected) > 1.9 * amplitude
    assert np.abs(mode.turn).max() * LENGTH > 0.5


@pytest.mark.parametrize('opposite', [False, True])
def test_rocking_about_held_centres(opposite):
    scene = changed(PAIR, {'supports.hold.group': 'all', 'supports.hold.fix': 'tx ty tz'})
    distance = 2.0 * ARM + 1.3 * LENGTH
    frequency = analytical.rocking_frequencies(STIFFNESS, LENGTH, ARM, distance, INERTIA)[
        int(opposite)
    ]
    step = 0.02 / frequency
    scene = changed(scene, {'solver.step': step})
    position, orientation = pair_face_to_face(scene, distance)
    amplitude = 1e-5
    turn = (
        amplitude * np.array([[0, 0.6, 0.8], [0, 0.6, 0.8]]) * [[1.0], [-1.0 if opposite else 1.0]]
    )
    simulation = ico.compile_scene(scene)
    simulation.set_state(
        position=position, orientation=analytical.free_rotation(orientation, turn, 1.0)
    )
    discrete = analytical.leapfrog_frequency(frequency, step)
    worst, low = 0.0, 0.0
    for count in range(0, 700, 13):
        simulation.advance_to(count * step)
        s = simulation.snapshot()
        cosine = np.cos(discrete * simulation.status.step_count * step)
        expected = analytical.free_rotation(orientation, turn * cosine, 1.0)
        worst = max(worst, analytical.rotation_distance(s.orientation, expected).max())
        low = min(low, cosine)
    assert worst < 1e-4 * amplitude
    assert low < -0.99
    assert np.array_equal(s.position, position)
    # The faster of the two is what limits the step.
    equal, other = analytical.rocking_frequencies(STIFFNESS, LENGTH, ARM, distance, INERTIA)
    simulation.set_state(position=position, orientation=orientation)
    assert simulation.status.largest_frequency == pytest.approx(equal, rel=1e-6)
    assert equal > 1.2 * other
