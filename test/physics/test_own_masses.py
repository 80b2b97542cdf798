# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Bodies with a mass and an inertia of their own: closed forms, conservation, and modes.
"""

import math

from fabrics import changed, make_scene
import icofabric_sim as ico
from icofabric_sim.running.run_monitor import RunMonitor
import numpy as np
import pytest

HEAVY = {'masses.heavy.group': 'heavy', 'masses.heavy.mass': 0.05}
# A slab whose upper layer is heavy, hung by its lower one.
SLAB = {
    'groups.heavy': 'z_max', 'groups.low': 'z_min', 'supports.floor.group': 'low',
    'connector.bending_stiffness': 0.02, 'connector.twisting_stiffness': 0.02, **HEAVY}


# Kernels with masses are compiled for these alone.
LONG = [pytest.param(method, marks=pytest.mark.long) for method in ('srkn6', 'dop8')]


def run(scene, time):
    simulation = ico.compile_scene(scene)
    simulation.advance_to(time)
    return simulation.snapshot()


def test_masses_come_from_groups_and_bodies():
    scene = make_scene((3, 3, 3), {
        'groups.heavy': 'z_max', 'groups.one': 'ids 0', **HEAVY, 'masses.slow.group': 'one',
        'masses.slow.inertia': 1.5e-6, 'bodies.ball.position': [1.0, 0.0, 0.0],
        'bodies.ball.mass': 0.3, 'bodies.ball.inertia': 1e-5})
    shell, heavy = scene.shell, scene.groups['heavy']
    expected = np.full(scene.body_count, shell.mass)
    expected[heavy], expected[-1] = 0.05, 0.3
    assert scene.masses.mass == pytest.approx(expected, rel=1e-15)
    inertia = np.full(scene.body_count, shell.inertia)
    inertia[heavy], inertia[-1], inertia[0] = 0.05 * shell.inertia / shell.mass, 1e-5, 1.5e-6
    assert scene.masses.inertia == pytest.approx(inertia, rel=1e-15)
    assert scene.masses.total(scene.body_count) == pytest.approx(expected.sum(), rel=1e-15)
    plain = make_scene((3, 3, 3))
    assert plain.masses.all_equal and plain.masses.total(14) == 14 * plain.shell.mass


@pytest.mark.long
@pytest.mark.parametrize('method', ['leapfrog', 'srkn6', 'dop8'])
def test_the_shell_s_own_mass_by_name_changes_nothing(method):
    changes = {
        'groups.heavy': 'z_max', 'gravity': [0.0, 1.0, -9.81], 'solver.method': method,
        'groups.low': 'z_min', 'supports.floor.group': 'low',
        'initial_random.velocity_sigma': 0.1, 'initial_random.spin_sigma': 5.0}
    plain = make_scene((3, 3, 3), changes)
    named = changed(plain, {
        'masses.heavy.group': 'heavy', 'masses.heavy.mass': float(plain.shell.mass)})
    one, two = run(plain, 0.1), run(named, 0.1)
    assert np.abs(one.position - plain.position).max() > 1e-3
    assert two.position == pytest.approx(one.position, abs=1e-12)
    for name in ('kinetic', 'connectors', 'gravity'):
        assert two.energy[name] == pytest.approx(one.energy[name], rel=1e-9)


@pytest.mark.long
@pytest.mark.parametrize('method', ['leapfrog', 'srkn6', 'dop8'])
def test_momenta_and_energy_are_kept(method):
    scene = make_scene((3, 3, 3), {
        'groups.heavy': 'z_max', **HEAVY, 'solver.method': method, 'solver.tolerance': 1e-8,
        'initial_random.velocity_sigma': 0.3, 'initial_random.spin_sigma': 20.0,
        'connector.bending_stiffness': 0.01})
    simulation = ico.compile_scene(scene)
    first = simulation.snapshot()
    simulation.advance_to(0.5)
    last = simulation.snapshot()
    monitor = RunMonitor(simulation)
    one, two = monitor.momentum(first), monitor.momentum(last)
    # By hand: M v, and x cross M v + Lambda omega.
    mass, inertia = (values[:, None] for values in scene.masses)
    assert two.linear == pytest.approx((mass * last.linear_velocity).sum(axis=0), rel=1e-12)
    assert two.angular == pytest.approx((
        np.cross(last.position, mass * last.linear_velocity)
        + inertia * last.angular_velocity).sum(axis=0), rel=1e-12)
    assert np.abs(two.linear - one.linear).max() < 1e-11 * two.linear_scale
    assert np.abs(two.angular - one.angular).max() < 1e-10 * two.angular_scale
    kinetic = 0.5 * (mass * last.linear_velocity**2 + inertia * last.angular_velocity**2).sum()
    assert last.energy['kinetic'] == pytest.approx(kinetic, rel=1e-12)
    assert abs(last.energy['balance_error']) < (
        3e-3 if method == 'leapfrog' else 1e-6) * first.energy['total']


@pytest.mark.long
@pytest.mark.parametrize('ratio', [0.1, 10.0, 1000.0])
@pytest.mark.parametrize('method', ['leapfrog', 'dop8'])
def test_unequal_bodies_collide_elastically(method, ratio):
    """Face against face: v1 = (m1 - m2) v / (m1 + m2), v2 = 2 m1 v / (m1 + m2)."""
    shell = make_scene((1, 1, 1)).shell
    along = np.ones(3) / math.sqrt(3.0)
    apart = 2.0 * shell.half_edge * (3.0 + math.sqrt(5.0)) / (2.0 * math.sqrt(3.0)) * 1.05
    scene = make_scene((1, 1, 1), {
        'contact.mode': 'auto', 'solver.method': method, 'solver.tolerance': 1e-4,
        'bodies.ball.position': (-apart * along).tolist(),
        'bodies.ball.linear_velocity': (0.5 * along).tolist(),
        'bodies.ball.mass': ratio * float(shell.mass)})
    state = run(scene, 0.05)
    expected = 0.5 * np.array([2.0 * ratio, ratio - 1.0]) / (ratio + 1.0)
    assert state.linear_velocity @ along == pytest.approx(
        expected, abs=2e-3 if method == 'leapfrog' else 1e-5)
    assert np.abs(state.angular_velocity).max() < 1e-6 * 0.5 / shell.half_edge


@pytest.mark.long
def test_modes_are_those_of_the_motion():
    """A mode of the heavy slab swings at its frequency, and keeps its shape."""
    scene = make_scene((3, 3, 3), SLAB)
    spectrum = ico.solve_modes(scene)
    light = ico.solve_modes(make_scene((3, 3, 3), {
        name: value for name, value in SLAB.items() if not name.startswith('masses')}))
    assert spectrum.frequencies[0] < 0.5 * light.frequencies[0]
    number = 2
    rate, shape = spectrum.frequencies[number], spectrum.shapes[number]
    # Mass-scaled shapes are orthonormal: with the masses of each body.
    weights = np.repeat(np.column_stack(scene.masses), 3, axis=1)
    grams = np.einsum('inf,nf,jnf->ij', spectrum.shapes[:5], weights, spectrum.shapes[:5])
    assert grams / grams[0, 0] == pytest.approx(np.eye(5), abs=1e-9)
    small = 1e-6 * scene.geometry.half_edge / np.abs(shape[:, :3]).max()
    simulation = ico.compile_scene(changed(scene, {'solver.tolerance': 1e-10}))
    simulation.set_state(
        position=scene.position, orientation=scene.orientation,
        linear_velocity=small * rate * shape[:, :3], angular_velocity=small * rate * shape[:, 3:])
    time = 0.3 * 2.0 * math.pi / rate
    simulation.advance_to(time)
    moved = simulation.snapshot().position - scene.position
    expected = small * math.sin(rate * time) * shape[:, :3]
    assert moved == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())


@pytest.mark.long
def test_weight_at_rest_is_that_of_each_body():
    scene = make_scene((3, 3, 3), {**SLAB, 'gravity': [0.0, 0.0, -9.81]})
    found = ico.solve_equilibrium(scene)
    assert found.converged
    weight = 9.81 * scene.masses.total(scene.body_count)
    assert found.reaction[:, 2].sum() == pytest.approx(weight, rel=1e-9)
    slow = run(changed(scene, {
        'drag.linear': 0.5, 'drag.angular': 5e-5, 'solver.tolerance': 1e-8}), 4.0)
    assert slow.position == pytest.approx(found.snapshot.position, abs=1e-8)
    assert ico.compile_scene(scene).reactions().force[0, 2] == pytest.approx(
        9.81 * scene.masses.mass[scene.groups['low']].sum(), rel=1e-9)


def test_each_body_is_moved_by_its_own_mass_and_inertia():
    """Loads, fields of both kinds, drag and drives, on loose bodies far from each other."""
    masses, inertias = np.array([0.01, 0.04]), np.array([1e-6, 3e-6])
    base = {
        'groups.every': 'all', 'bodies.b.position': [1.0, 0.0, 0.0],
        'bodies.b.mass': 0.04, 'bodies.b.inertia': 3e-6, 'shell.mass': 0.01,
        'shell.inertia': 1e-6, 'solver.tolerance': 1e-10}
    loaded = run(make_scene((1, 1, 1), {
        **base, 'loads.l.group': 'every', 'loads.l.force': [0.0, 0.002, 0.0],
        'loads.l.torque': [0.0, 0.0, 1e-6], 'gravity': [0.0, 0.0, -2.0]}), 0.5)
    assert loaded.linear_velocity[:, 1] == pytest.approx(0.001 / masses, rel=1e-10)
    assert loaded.linear_velocity[:, 2] == pytest.approx([-1.0, -1.0], rel=1e-12)
    assert loaded.angular_velocity[:, 2] == pytest.approx(5e-7 / inertias, rel=1e-10)
    assert loaded.energy['gravity'] == pytest.approx(2.0 * float(
        masses @ loaded.position[:, 2]), rel=1e-12)
    field = run(make_scene((1, 1, 1), {
        **base, 'charge.per_body': 1e-7, 'field.electric': [0.0, 1e4, 0.0]}), 0.5)
    assert field.linear_velocity[:, 1] == pytest.approx(5e-4 / masses, rel=1e-10)
    magnet = run(make_scene((1, 1, 1), {
        **base, 'charge.per_body': 1e-2, 'field.magnetic': [0.0, 0.0, 1.0],
        # Next to nothing, so that both have the kernels of the next run.
        'drag.linear': 1e-15, 'drag.angular': 1e-19,
        'initial.i.group': 'every', 'initial.i.linear_velocity': [1.0, 0.0, 0.0],
        'initial.i.angular_velocity': [1.0, 0.0, 0.0]}), 0.5)
    angle = -0.5 * 1e-2 / masses
    assert magnet.linear_velocity[:, 1] == pytest.approx(np.sin(angle), abs=1e-8)
    # Spins turn at half that rate, whatever the inertia: s / Lambda = q / (2 M).
    assert magnet.angular_velocity[:, 1] == pytest.approx(np.sin(0.5 * angle), abs=1e-8)
    slowed = run(make_scene((1, 1, 1), {
        **base, 'charge.per_body': 1e-15, 'field.magnetic': [0.0, 0.0, 1.0],
        'drag.linear': 0.02, 'drag.angular': 2e-6, 'initial.i.group': 'every',
        'initial.i.linear_velocity': [1.0, 0.0, 0.0],
        'initial.i.angular_velocity': [0.0, 0.0, 1.0]}), 0.5)
    assert slowed.linear_velocity[:, 0] == pytest.approx(np.exp(-0.01 / masses), abs=1e-9)
    assert slowed.angular_velocity[:, 2] == pytest.approx(np.exp(-1e-6 / inertias), abs=1e-9)
    driven = run(make_scene((1, 1, 1), {
        **base, 'drives.d.group': 'every', 'drives.d.motion': 'ramp', 'drives.d.duration': 0.1,
        'drives.d.linear': [0.0, 0.0, 0.6]}), 0.5)
    assert driven.energy['work_in'] == pytest.approx(0.5 * masses.sum() * 0.36, rel=1e-9)


@pytest.mark.long
def test_a_slab_stops_a_heavy_body():
    """
    A heavy body falls on a slab: momentum goes to the floor, the energy balances with contact.
    """
    scene = make_scene((4, 4, 3), {
        'weave.connector_angle': 0.2, 'contact.mode': 'auto', 'groups.low': 'z_min',
        'supports.floor.group': 'low', 'bodies.ball.position': [0.0, 0.0, 0.12],
        'bodies.ball.linear_velocity': [0.0, 0.0, -1.0], 'bodies.ball.mass': 0.1,
        'connector.bending_stiffness': 0.02, 'solver.tolerance': 1e-4})
    simulation = ico.compile_scene(scene)
    lowest = np.inf
    for step in range(1, 31):
        simulation.advance_to(0.004 * step)
        lowest = min(lowest, simulation.snapshot().linear_velocity[-1, 2])
    state = simulation.snapshot()
    assert lowest == pytest.approx(-1.0, abs=1e-12)
    assert state.linear_velocity[-1, 2] > -0.8
    assert abs(state.energy['balance_error']) < 1e-3 * 0.05


@pytest.mark.parametrize('changes, words', [
    ({'bodies.b.mass': 0.1, 'bodies.b.inertia': 1.0},
     ['bodies.b.inertia', 'the largest possible', 'at the vertices']),
    ({'groups.g': 'all', 'masses.m.group': 'g', 'masses.m.inertia': 1.0}, ['masses.m.inertia']),
    ({'masses.m.group': 'nowhere', 'masses.m.mass': 1.0}, ['masses.m.group', "'nowhere'"]),
    ({'bodies.b.mass': -1.0}, ['bodies.b.mass', 'at least 0']),
    ({'bodies.b.mass': 1e-22}, ['at a rate']),
])
def test_masses_that_no_body_has_are_refused(changes, words):
    with pytest.raises(ico.ParameterError) as caught:
        make_scene((2, 2, 2), {'bodies.b.position': [1.0, 0.0, 0.0], **changes})
    for word in words:
        assert word in str(caught.value)


@pytest.mark.long
def test_implicit_steps_move_each_body_by_its_own_mass():
    """As those of dop8 do, where connectors are damped and drag acts."""
    scene, duration = make_scene((3, 3, 2), {
        **SLAB, 'groups.heavy': 'z_max', 'gravity': [0.0, 0.0, -9.81], 'connector.damping': 20.0,
        'drag.linear': 0.05, 'drag.angular': 1e-6, 'contact.mode': 'never'}), 0.02
    found = [
        run(changed(scene, {'solver.method': method, 'solver.tolerance': tolerance}), duration)
        for method, tolerance in (('dop8', 1e-6), ('sdirk4', 1e-4))]
    alike = run(changed(scene, {
        'masses.heavy.mass': scene.shell.mass, 'solver.method': 'sdirk4'}), duration)
    away = [np.abs(snapshot.position - found[0].position).max() / scene.geometry.half_edge
            for snapshot in (found[1], alike)]
    assert away[0] < 1e-4 * duration and away[1] > 1e3 * away[0]
