# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What a fabric left to itself keeps, and what the numbers keep."""

import analytical
from fabrics import BOTH_FORMS, changed, LOADED, make_scene, RANDOM
import icofabric_sim as ico
import numpy as np
import pytest

CALM = {
    'initial_random': {'velocity_sigma': 0.2, 'spin_sigma': 20.0, 'seed': 3},
    'contact': {'mode': 'never'},
}


def with_own_step(scene, product=0.2, method='leapfrog'):
    """The same scene with a fixed step of `product` over the largest frequency."""
    rate = ico.compile_scene(scene).status.largest_frequency
    return changed(scene, {'solver.step': product / rate, 'solver.method': method})


@pytest.mark.parametrize('form', BOTH_FORMS)
def test_momenta_are_kept_to_rounding_over_100000_steps(form):
    scene = with_own_step(make_scene((3, 3, 3), {'contact.mode': 'never'}, **RANDOM))
    mass, inertia = scene.shell.mass, scene.shell.inertia
    simulation = ico.compile_scene(scene, rotation=form)

    def momenta(s):
        return (
            analytical.momentum(mass, s.linear_velocity),
            analytical.angular_momentum(
                mass, inertia, s.position, s.linear_velocity, s.angular_velocity
            ),
        )

    start = simulation.snapshot()
    simulation.advance_to(100_000 * simulation.status.step)
    end = simulation.snapshot()
    assert simulation.status.step_count in (99_999, 100_000)
    # What the sums are made of in the end, far from the origin: rounding is relative to this.
    sizes = (
        mass * np.abs(start.linear_velocity).sum(),
        mass * np.linalg.norm(np.cross(end.position, end.linear_velocity), axis=1).sum()
        + inertia * np.linalg.norm(end.angular_velocity, axis=1).sum(),
    )
    for before, after, size in zip(momenta(start), momenta(end), sizes):
        assert np.abs(after - before).max() < 1e-12 * size
        assert np.linalg.norm(before) > 1e-3 * size
    np.testing.assert_allclose(np.linalg.norm(end.orientation, axis=1), 1.0, rtol=0, atol=1e-15)
    # Bodies exchange both all the time.
    single = mass * (end.linear_velocity - start.linear_velocity)
    assert np.abs(single).max() > 0.01 * sizes[0]
    assert np.abs(end.angular_velocity - start.angular_velocity).max() > 10.0


@pytest.mark.parametrize('form', BOTH_FORMS)
def test_energy_is_bounded_without_trend_over_a_million_steps(form):
    product = 0.1
    scene = with_own_step(make_scene((2, 2, 2), **CALM), product)
    simulation = ico.compile_scene(scene, rotation=form)
    energies, kinetic = [], []
    for sample in range(1000):
        simulation.advance_to(1000 * sample * simulation.status.step)
        energy = simulation.snapshot().energy
        energies.append(energy['total'])
        kinetic.append(energy['kinetic'])
    assert simulation.status.step_count > 998_000
    error = np.array(energies) / energies[0] - 1.0
    # For an oscillator the leapfrog keeps m v^2 / 2 + m omega^2 x^2 (1 - (omega h)^2 / 4) / 2, so
    # even with all energy in the fastest motion the error would stay below this.
    assert 1e-6 < np.abs(error).max() < product**2 / 4.0
    # No trend: a straight line through the samples changes by less than their spread.
    slope = np.polyfit(np.linspace(-0.5, 0.5, len(error)), error, 1)[0]
    assert abs(slope) < error.std()
    # The largest of a hundred samples varies by a factor of two from run to run, their root mean
    # square does not.
    assert np.sqrt(np.mean(error[800:]**2)) < 1.5 * np.sqrt(np.mean(error[:200]**2))
    assert max(kinetic) > 1.2 * min(kinetic)


def test_energy_error_falls_with_the_square_of_the_step():
    errors = []
    for product in (0.2, 0.1, 0.05):
        simulation = ico.compile_scene(with_own_step(make_scene((2, 2, 2), **CALM), product))
        energies = []
        for sample in range(200):
            simulation.advance_to(sample * 1e-4)
            energies.append(simulation.snapshot().energy['total'])
        errors.append(np.ptp(energies) / energies[0])
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.1)


def test_gravity_trades_heights_for_motion():
    scene = make_scene(
        (3, 3, 3),
        {
            'gravity': [0.0, 0.0, -9.81],
            'groups.top': 'z_max',
            'supports.ceiling.group': 'top',
            'contact.mode': 'never',
        },
    )
    simulation = ico.compile_scene(scene)
    start = simulation.snapshot().energy
    simulation.advance_to(0.1)
    end = simulation.snapshot().energy
    fallen = start['gravity'] - end['gravity']
    assert fallen > 0.0
    assert end['kinetic'] + end['connectors'] == pytest.approx(fallen, rel=2e-3)
    assert end['connectors'] > 0.0


def test_work_of_a_steady_force_is_the_energy_gained():
    # A force on axes fixed in the world, through the centre, is the gradient of -F . R.
    scene = make_scene(
        (3, 3, 3),
        {
            'groups.left': 'x_min',
            'groups.right': 'x_max',
            'contact.mode': 'never',
            'loads.left.group': 'left',
            'loads.left.force': [-3.0, 0.0, 0.5],
            'loads.left.share': 'total',
            'loads.right.group': 'right',
            'loads.right.force': [3.0, 1.0, 0.0],
            'loads.right.share': 'total',
        },
    )
    simulation = ico.compile_scene(scene)
    start = simulation.snapshot()
    simulation.advance_to(0.1)
    end = simulation.snapshot()
    work = sum(
        ((end.position - start.position)[load.bodies] @ load.force).sum() / len(load.bodies)
        for load in scene.loads.values()
    )
    assert work > 0.0
    assert end.energy['total'] - start.energy['total'] == pytest.approx(work, rel=2e-3)


def test_common_rigid_motion_changes_nothing():
    # The same fabric seen from another frame: turned, shifted and with the turned velocities.
    scene = make_scene((2, 2, 2), {'solver.step': 1e-4}, **RANDOM, **LOADED)
    scene = changed(scene, {'loads.steady.frame': 'body'})
    start = scene.initial
    turn = analytical.rotation_quaternion(np.array([0.3, -1.1, 0.7]))

    def turned(vectors):
        pure = np.concatenate([vectors, np.zeros((len(vectors), 1))], axis=1)
        inverse = turn * [-1, -1, -1, 1]
        return analytical.quaternion_product(analytical.quaternion_product(turn, pure), inverse)[
            :, :3
        ]

    plain, seen = ico.compile_scene(scene), ico.compile_scene(scene)
    shift = np.array([0.7, -0.2, 0.4])
    seen.set_state(
        position=turned(start.position) + shift,
        orientation=analytical.quaternion_product(turn, start.orientation),
        linear_velocity=turned(start.linear_velocity),
        angular_velocity=turned(start.angular_velocity),
    )
    for simulation in (plain, seen):
        simulation.advance_to(0.02)
    one, other = plain.snapshot(), seen.snapshot()
    a = scene.geometry.half_edge
    np.testing.assert_allclose(
        other.position, turned(one.position) + shift, rtol=0, atol=1e-11 * a
    )
    expected = analytical.quaternion_product(turn, one.orientation)
    assert analytical.rotation_distance(other.orientation, expected).max() < 1e-11
    np.testing.assert_allclose(
        other.angular_velocity, turned(one.angular_velocity), rtol=0, atol=1e-8
    )
    assert np.abs(one.position - start.position).max() > 0.5 * a
    assert analytical.rotation_distance(one.orientation, start.orientation).max() > 0.5


def scaled(length, time, density_factor, method='leapfrog'):
    """
    One fabric at another `length` and `time` scale, with the powers of both that each unit has.
    """
    mass = density_factor * length**3
    force, torque = mass * length / time**2, mass * length**2 / time**2
    return make_scene(
        (2, 2, 2),
        {
            'shell.edge_length': 0.02 * length,
            'shell.thickness': 0.002 * length,
            'shell.density': 1200.0 * density_factor,
            'connector.stiffness': 500.0 * mass / time**2,
            'gravity': [0.0, 3.0 * length / time**2, -9.81 * length / time**2],
            'initial_random.velocity_sigma': 0.5 * length / time,
            'initial_random.spin_sigma': 60.0 / time,
            'initial_random.seed': 4,
            'groups.top': 'z_max',
            'supports.roof.group': 'top',
            'supports.roof.fix': 'tz',
            'groups.tip': 'ids 0',
            'loads.tip.group': 'tip',
            'loads.tip.frame': 'body',
            'loads.tip.point': [0.0, 0.01 * length, 0.0],
            'loads.tip.force': [2.0 * force, 0.0, force],
            'loads.tip.torque': [0.0, 0.01 * torque, 0.0],
            'solver.step': 1e-4 * time,
            'solver.method': method,
            # An error for each second: the same for each unit of time.
            'solver.tolerance': 1e-6 / time,
        },
    )


@pytest.mark.parametrize(
    'length, time, density',
    [(0.05, 1.0, 1.0), (50.0, 1.0, 1.0), (50.0, 7.0, 0.3), (1e-6, 1e-3, 1.0), (1e5, 1e4, 2.0)],
)
def test_dimensionless_run_is_the_same_at_any_size(length, time, density):
    # a = 0.5 mm and 0.5 m, then beyond; nothing absolute may hide anywhere.
    def run(scene, length, time):
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.02 * time)
        s = simulation.snapshot()
        return (
            s.position / length,
            s.orientation,
            s.linear_velocity * time / length,
            s.angular_velocity * time,
            np.array([simulation.status.largest_frequency * time]),
            np.array([simulation.status.step_count]),
        )

    small = scaled(1.0, 1.0, 1.0)
    expected = run(small, 1.0, 1.0)
    for one, other in zip(run(scaled(length, time, density), length, time), expected):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-10 * np.abs(other).max())
    assert np.abs(expected[0] - small.position).max() > 0.005
    assert np.abs(expected[1] - small.orientation).max() > 0.3


@pytest.mark.parametrize('length', [0.05, 50.0])
def test_chosen_step_scales_with_the_fabric(length):
    scenes = [
        changed(scaled(factor, factor, 1.0, 'auto'), {'solver.step': 0.0})
        for factor in (1.0, length)
    ]
    steps = [ico.compile_scene(scene).status.step for scene in scenes]
    # Steps have 12 bits, and the measured error of the method decides about the last.
    assert steps[1] / steps[0] == pytest.approx(length, rel=2.0**-10)
