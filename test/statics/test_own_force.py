# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Body forces and surface functions at rest: closed forms, the scene's own loads, and runs."""

import math

from fabrics import changed, make_scene
import icofabric_sim as ico
from icofabric_sim.statics.present import capture_run_state, solve_run_equilibrium
import numpy as np
import pytest

HELD = {
    'connector.bending_stiffness': 0.02, 'groups.wall': 'x_min', 'groups.tip': 'x_max',
    'supports.wall.group': 'wall'}
LOOSE = {'weave.connected': False}
STIFFNESS = 3.0  # [N/m]


def constant(force):
    def push(time, position, orientation, linear_velocity, angular_velocity):
        return np.zeros_like(position) + force, 0.0 * angular_velocity
    return push


def spring_to(places, turning=0.0):
    """Pull every body to its place, and turn it back with `turning` [N m/rad]."""
    def pull(time, position, orientation, linear_velocity, angular_velocity):
        return -STIFFNESS * (position - places), (
            -2.0 * turning * orientation[:, 3:] * orientation[:, :3])
    return ico.BodyForce(pull, compiled=False)


def potential_of(force):
    return lambda time, position, orientation: -(position * force).sum(axis=-1)


@pytest.mark.parametrize('has_potential', [False, True])
def test_a_uniform_force_is_weight(has_potential):
    bare = make_scene((4, 3, 3), HELD)
    weighed = changed(bare, {'gravity': [0.0, 0.0, -9.81]})
    weight = bare.shell.mass * np.array([0.0, 0.0, -9.81])
    force = ico.BodyForce(
        constant(weight), potential=potential_of(weight) if has_potential else None)
    one = ico.solve_equilibrium(weighed)
    two = ico.solve_equilibrium(bare, body_force=force)
    a = bare.geometry.half_edge
    assert np.abs(one.snapshot.position - bare.position).max() > 0.1 * a
    assert np.abs(two.snapshot.position - one.snapshot.position).max() < 1e-9 * a
    assert two.verdict == one.verdict and two.reactions.force == pytest.approx(
        one.reactions.force, rel=1e-9, abs=1e-10)
    if has_potential:
        assert two.snapshot.energy['total'] == pytest.approx(
            one.snapshot.energy['total'], rel=1e-12)
    # Parts of it, and vibrations about what is found, are alike too.
    halves = [[found.snapshot.position for _, found in ico.step_loads(
        scene, [0.5, 1.0], body_force=own)] for scene, own in ((weighed, None), (bare, force))]
    assert np.abs(halves[0][0] - halves[0][1]).max() > 0.01 * a
    assert np.abs(halves[0][0] - halves[1][0]).max() < 1e-9 * a
    modes = [ico.solve_modes(scene, at=one.snapshot, body_force=own).frequencies
             for scene, own in ((weighed, None), (bare, force))]
    assert modes[1] == pytest.approx(modes[0], rel=1e-9)


def test_a_field_of_springs_adds_its_stiffness_over_the_mass_to_squared_frequencies():
    scene = make_scene((3, 3, 2), {'connector.bending_stiffness': 0.02})
    shell = scene.shell
    own = spring_to(scene.position, STIFFNESS * shell.inertia / shell.mass)
    plain, held = ico.solve_modes(scene), ico.solve_modes(scene, body_force=own)
    assert plain.mechanism_count >= 6 and held.mechanism_count == held.rigid_count == 0
    squares = np.concatenate([np.zeros(plain.mechanism_count), plain.frequencies**2])
    assert held.frequencies**2 == pytest.approx(squares + STIFFNESS / shell.mass, rel=1e-9)
    assert held.largest_frequency == pytest.approx(held.frequencies[-1], rel=1e-6)


def test_a_field_of_springs_holds_what_nothing_else_does():
    scene = make_scene((2, 2, 2), {
        **LOOSE, 'groups.it': 'all', 'loads.push.group': 'it',
        'loads.push.force': [0.3, 0.0, -0.6]})
    with pytest.raises(ValueError, match='nothing holds this fabric'):
        ico.solve_equilibrium(scene, body_force=constant([0.1, 0.0, 0.0]))
    found = ico.solve_equilibrium(scene, body_force=spring_to(scene.position))
    moved = found.snapshot.position - scene.position
    expected = np.array([0.3, 0.0, -0.6]) / STIFFNESS
    assert found.converged and np.abs(moved - expected).max() < 1e-11


def test_a_field_with_a_hill_and_a_valley():
    """A pendulum's force F = -F0 sin(x / l) rests at asin, unstable beyond."""
    length, largest = 0.05, 2.0

    def wave(time, position, orientation, linear_velocity, angular_velocity):
        force = np.zeros_like(position)
        force[..., 0] = -largest * np.sin(position[..., 0] / length)
        return force, 0.0 * angular_velocity

    scene = make_scene((1, 1, 1), {
        'groups.it': 'all', 'supports.rail.group': 'it', 'supports.rail.fix': 'ty tz rotation',
        'loads.push.group': 'it', 'loads.push.force': [1.2, 0.0, 0.0]})
    found = ico.solve_equilibrium(scene, body_force=wave)
    place = length * math.asin(0.6)
    assert found.verdict == 'equilibrium, stable'
    assert found.snapshot.position[0, 0] == pytest.approx(place, rel=1e-9)
    modes = ico.solve_modes(scene, at=found.snapshot, body_force=wave)
    assert modes.frequencies == pytest.approx(
        [math.sqrt(largest * 0.8 / length / scene.shell.mass)], rel=1e-9)
    top = found.snapshot
    top = ico.solve_equilibrium(
        changed(scene, {'loads.push.force': [0.0, 0.0, 0.0]}), body_force=lambda *state: tuple(
            -part for part in wave(*state)))
    assert top.unstable_count == 1


def test_surface_functions_are_tractions():
    scene = make_scene((3, 3, 2), HELD)
    pressed = changed(scene, {
        'tractions.t.group': 'tip', 'tractions.t.pressure': 100.0,
        'tractions.t.faces': 'toward 1 0 0'})
    own = ico.surface_force(
        scene, lambda face, xi, eta, time: np.column_stack([100.0 + 0.0 * xi, 0.0 * xi, 0.0 * xi]),
        group='tip', faces='toward 1 0 0')
    one, two = ico.solve_equilibrium(pressed), ico.solve_equilibrium(scene, body_force=own)
    a = scene.geometry.half_edge
    assert one.converged and two.converged
    assert np.abs(one.snapshot.position - scene.position).max() > 0.01 * a
    assert np.abs(two.snapshot.position - one.snapshot.position).max() < 1e-7 * a
    with pytest.raises(ValueError, match='has no potential'):
        ico.solve_modes(scene, at=two.snapshot, body_force=own)


def test_curves_take_a_body_force():
    """Bodies without connectors on springs: the end bears k times its displacement."""
    scene = make_scene((5, 3, 3), LOOSE)
    own, length = spring_to(scene.position), float(np.ptp(scene.position[:, 0]))
    end = int(np.count_nonzero(scene.position[:, 0] > scene.position[:, 0].max() - 1e-9))
    points = ico.measure_curve(scene, 'pull', [0.01, 0.02], body_force=own)
    for point in points:
        assert point.end_force[0] == pytest.approx(
            end * STIFFNESS * point.strain * length, rel=1e-9)
    [cycle] = ico.measure_cycles(scene, 'pull', [0.02], body_force=own)
    assert cycle.loading_work == pytest.approx(
        0.5 * end * STIFFNESS * (0.02 * length)**2, rel=1e-9)
    [turn] = ico.measure_moment_curve(scene, 'twist', [0.1], body_force=own)
    arm = scene.position[scene.position[:, 0] > scene.position[:, 0].max() - 1e-9][:, 1:]
    arm = arm - arm.mean(axis=0)
    assert turn.moment == pytest.approx(
        STIFFNESS * math.sin(0.1) * float((arm**2).sum()), rel=1e-9)


def test_a_run_stays_where_its_body_force_rests():
    scene = make_scene((3, 2, 2), HELD)
    own = ico.BodyForce(constant([0.0, 0.02, -0.05]))
    simulation = ico.compile_scene(scene, body_force=own)
    found = solve_run_equilibrium(capture_run_state(simulation))
    assert np.abs(found.snapshot.position - scene.position).max() > 1e-4
    simulation.set_state(
        position=found.snapshot.position, orientation=found.snapshot.orientation)
    simulation.advance_to(0.01)
    assert np.abs(simulation.snapshot().linear_velocity).max() < 1e-9


def swirl(time, position, orientation, linear_velocity, angular_velocity):
    return np.cross(position, [0.0, 0.0, 1.0]), 0.0 * angular_velocity


def attract(time, position, orientation, linear_velocity, angular_velocity):
    return position.mean(axis=0) - position, 0.0 * angular_velocity


def gust(time, position, orientation, linear_velocity, angular_velocity):
    return np.full_like(position, 0.01 * np.sin(9.0 * time)), 0.0 * angular_velocity


def test_what_cannot_be_done_is_refused_with_a_way_out():
    scene = make_scene((2, 2, 2), HELD)
    with pytest.raises(ValueError, match='no potential.*simulate the motion'):
        ico.solve_modes(scene, body_force=ico.BodyForce(swirl, compiled=False))
    # An equilibrium there is all the same.
    assert ico.solve_equilibrium(scene, body_force=ico.BodyForce(swirl, compiled=False)).converged
    with pytest.raises(ValueError, match='acts between bodies.*run with drag'):
        ico.solve_equilibrium(scene, body_force=ico.BodyForce(attract, compiled=False))
    with pytest.raises(ValueError, match='changes with time.*time='):
        ico.solve_equilibrium(scene, body_force=gust)
    found = ico.solve_equilibrium(scene, time=0.1, body_force=gust)
    assert found.reactions.force[0] == pytest.approx(
        np.full(3, -0.01 * scene.body_count * math.sin(0.9)), rel=1e-8)
    with pytest.raises(TypeError, match='body_force must be'):
        ico.solve_modes(scene, body_force=3.0)
    with pytest.raises(ValueError, match='ZeroDivisionError'):
        ico.solve_equilibrium(scene, body_force=lambda *state: 1 / 0)
