# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Pulls: a hand's spring and damper, its law, its limits, and that a run with them repeats."""

from fabrics import changed, make_scene
import icofabric_sim as ico
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.inputs.pulls import LARGEST_ACCELERATION, LARGEST_DISTANCE, STIFFNESS
import numpy as np
import pytest
from runner_helpers import SCENE

BODY, MASS_RATIO = 1, 2.0  # sqrt(4 bodies)


@pytest.fixture
def simulation():
    return ico.compile_scene(ico.Scene.from_parameters(SCENE))


def bits(simulation):
    found = simulation.snapshot()
    return b''.join(getattr(found, name).tobytes() for name in (
        'position', 'orientation', 'linear_velocity', 'angular_velocity'))


def test_pulled_body_rests_where_the_force_balances_the_load(simulation):
    place = simulation.snapshot().position[BODY].copy()
    mass = MASS_RATIO * simulation.scene.shell.mass
    load = np.array([0.0, 0.0, -0.1])
    simulation.apply_wrench('tip', force=load)
    simulation.pull(BODY, place)
    simulation.advance_to(5.0)
    found, force = [], []
    for time in np.linspace(5.0, 6.0, 101):
        simulation.advance_to(time)
        found.append(simulation.snapshot().position[BODY] - place)
        force.append(simulation.inputs.pulls.forces[BODY])
    assert simulation.inputs.pulls.mass(BODY) == pytest.approx(mass, rel=1e-12)
    # The spring alone, K = 100 / s^2 times the mass, and the same from the forces themselves.
    sag = load[2] / (STIFFNESS * mass)
    assert np.mean(found, axis=0)[2] == pytest.approx(sag, rel=0.03)
    assert np.mean(force, axis=0) == pytest.approx(-load, abs=0.03 * 0.1)
    assert abs(simulation.snapshot().energy['balance_error']) < 1e-4


def test_pull_takes_energy_out_of_what_swings(simulation):
    place = simulation.snapshot().position[BODY].copy()
    simulation.pull(BODY, place + [0.0, 0.0, 0.05])
    energies = []
    for time in (0.2, 1.0, 2.0, 3.0):
        simulation.advance_to(time)
        energy = simulation.snapshot().energy
        energies.append(energy['kinetic'] + energy['connectors'])
    # A fabric that turns about the pulled body goes on turning: only that is left.
    assert energies[0] > 2.0 * energies[1] and energies == sorted(energies, reverse=True)


@pytest.mark.parametrize('strength', [1.0, 10.0])
def test_force_is_capped(strength):
    scene = ico.Scene.from_parameters({**SCENE, 'pull': {'strength': strength}})
    simulation = ico.compile_scene(scene)
    simulation.pull(BODY, (1000.0, 0.0, 0.0))
    largest = strength * LARGEST_ACCELERATION * MASS_RATIO * scene.shell.mass
    forces = []
    for time in (1e-6, 0.01, 0.1):
        simulation.advance_to(time)
        forces.append(np.linalg.norm(simulation.inputs.pulls.forces[BODY]))
    assert forces[0] == pytest.approx(largest) and max(forces) <= largest * (1.0 + 1e-12)
    # A body that is thrown is braked by no more.
    simulation.set_state(linear_velocity=np.tile([300.0, 0.0, 0.0], (4, 1)))
    simulation.advance_to(0.2)
    force = simulation.inputs.pulls.forces[BODY]
    assert force[0] < 0.0 and np.linalg.norm(force) == pytest.approx(largest)


def free_body(mass_ratio=1.0, strength=1.0, **changes):
    """Return the simulation of one free body that weighs so many masses of a shell."""
    scene = make_scene((1, 1, 1), {
        'weave.connected': False, 'pull.strength': strength})
    return ico.compile_scene(changed(scene, {
        'groups.own': 'all', 'masses.own.group': 'own',
        'masses.own.mass': mass_ratio * scene.shell.mass, **changes}))


def pulled_path(simulation, shift, times):
    """Return the positions [m] of body 0, (k, 3), that is pulled by `shift` from its place."""
    place = simulation.snapshot().position[0].copy()
    simulation.pull(0, place + shift)
    path = []
    for time in times:
        simulation.advance_to(time)
        path.append(simulation.snapshot().position[0] - place)
    return np.array(path)


@pytest.mark.parametrize('strength', [1.0, 100.0])
@pytest.mark.parametrize('mass_ratio', [1e-3, 0.01, 1.0, 1e3])
def test_free_body_of_any_mass_follows_the_damped_oscillator_and_rests(mass_ratio, strength):
    rate = np.sqrt(STIFFNESS * strength)
    phase = np.linspace(0.0, 40.0, 801)
    path = pulled_path(free_body(mass_ratio, strength), [0.01, 0.0, 0.0], phase / rate)
    turn = np.sqrt(0.75)  # damped frequency over the undamped one, of damping ratio 1/2
    exact = 1.0 - np.exp(-0.5 * phase) * (
        np.cos(turn * phase) + 0.5 / turn * np.sin(turn * phase))
    found = path[:, 0] / 0.01
    # The lag of half the hold, 0.05 rad, of rates of at most 0.55.
    assert np.abs(found - exact).max() < 0.05
    assert 1.1 < found.max() < 1.25
    assert found[-1] == pytest.approx(1.0, abs=1e-7)
    assert np.abs(path[:, 1:]).max() < 1e-12


def test_a_hand_that_is_far_away_makes_no_larger_overshoot():
    path = pulled_path(free_body(1e-3), [10.0, 0.0, 0.0], np.linspace(0.0, 6.0, 601))[:, 0]
    assert 10.0 < path.max() < 10.0 + 0.5 * LARGEST_DISTANCE
    assert path[-1] == pytest.approx(10.0, abs=1e-9)


def test_the_inertia_of_a_body_has_no_part_in_its_pull():
    """A force at the centre; the body tumbles on, by Euler's equations."""
    times, plain = np.linspace(0.0, 2.0, 41), free_body()
    moments = plain.scene.shell.mass * np.array([2e-5, 5e-5, 6e-5])
    simulation = free_body(**{'masses.own.principal_inertia': moments.tolist()})
    simulation.set_state(angular_velocity=np.array([[1.0, 20.0, 3.0]]))
    energy = simulation.snapshot().energy['kinetic']
    path = pulled_path(simulation, [0.02, 0.01, 0.0], times)
    assert path == pytest.approx(pulled_path(plain, [0.02, 0.01, 0.0], times), abs=2e-4)
    assert path[-1] == pytest.approx([0.02, 0.01, 0.0], abs=1e-5)
    assert simulation.snapshot().energy['kinetic'] == pytest.approx(energy, rel=1e-6)


@pytest.mark.parametrize('mass_ratio', [1e-2, 1e3])
def test_a_light_or_heavy_body_of_a_fabric_comes_to_rest_where_it_is_drawn(mass_ratio):
    """Held at the far end and damped: the spring of the hand against that of the fabric."""
    shell = ico.Scene.from_parameters(SCENE).shell.mass
    scene = make_scene((3, 1, 2), {
        'contact.mode': 'never', 'connector.damping': 0.1, 'connector.stiffness': 20.0,
        'groups.own': 'ids 0', 'masses.own.group': 'own', 'masses.own.mass': mass_ratio * shell,
        'groups.rest': 'x_max', 'supports.rest.group': 'rest'})
    simulation = ico.compile_scene(scene)
    whole = scene.masses.total(scene.body_count)
    path = pulled_path(simulation, [0.0, 0.0, 0.004], np.linspace(0.0, 6.0, 61))
    assert simulation.inputs.pulls.mass(0) == pytest.approx(
        np.sqrt(mass_ratio * shell * whole), rel=1e-12)
    assert 1e-4 < path[-1, 2] < path[:, 2].max() < 0.004 * 1.25
    assert np.abs(simulation.snapshot().linear_velocity[0]).max() < 1e-4


@pytest.mark.parametrize('point', [(1.7e308, -1.7e308, 0.0), (1e307, 1e307, 1e307)])
def test_points_beyond_all_numbers_pull_with_what_the_cap_allows(point):
    scene = ico.Scene.from_parameters({**SCENE, 'pull': {'strength': 1000.0}})
    simulation = ico.compile_scene(scene)
    simulation.pull(BODY, point)
    simulation.advance_to(1e-9)
    largest = 1000.0 * LARGEST_ACCELERATION * MASS_RATIO * scene.shell.mass
    assert np.linalg.norm(simulation.inputs.pulls.forces[BODY]) == pytest.approx(largest)


def test_what_acts_on_single_bodies_goes_on_in_another_simulation():
    """Also in one that was not prepared for it."""
    scene = make_scene((2, 2, 1), {'contact.mode': 'never'})
    first = ico.compile_scene(scene)
    first.pull(BODY, (1.0, 0.0, 0.0))
    first.advance_to(0.01)
    other = ico.compile_scene(scene)
    other.continue_from(first, keep_motion=True)
    before = other.snapshot().position[BODY, 0]
    other.advance_to(0.1)
    assert other.inputs.pulls.bodies == [BODY]
    assert other.snapshot().position[BODY, 0] > before + 1e-3


def test_release_ends_it(simulation):
    simulation.pull(BODY, (0.1, 0.0, 0.0))
    simulation.advance_to(0.02)
    simulation.release(BODY)
    assert not simulation.inputs.pulls.bodies
    simulation.advance_to(0.03)
    momentum = simulation.snapshot().linear_velocity.sum(axis=0)
    simulation.advance_to(0.05)
    assert np.linalg.norm(momentum) > 1e-3
    assert simulation.snapshot().linear_velocity.sum(axis=0) == pytest.approx(momentum, rel=1e-9)
    simulation.release(BODY)  # nothing to let go
    simulation.pull(BODY, (0.1, 0.0, 0.0))
    simulation.reset()
    assert not simulation.inputs.pulls.bodies


def test_broken_off_part_is_pulled_by_its_own_mass(simulation):
    broken = np.full(simulation.scene.connector_count, 0.5)
    simulation._driver.trajectory.broken._since = broken
    simulation.pull(BODY, (0.1, 0.0, 0.0))
    simulation.advance_to(1e-6)
    assert simulation.inputs.pulls.mass(BODY) == pytest.approx(simulation.scene.shell.mass)


@pytest.mark.parametrize('method', ['srkn4', 'dop8'])
def test_same_bits_in_pieces_and_from_a_checkpoint(method):
    scene = ico.Scene.from_parameters({**SCENE, 'solver': {'method': method}})
    whole, pieces, restored = (
        ico.compile_scene(scene) for _ in range(3))
    for simulation in (whole, pieces):
        simulation.advance_to(0.001)
        simulation.pull(BODY, (0.1, 0.02, 0.0))
        simulation.pull(2, (-0.1, 0.0, 0.05))
    whole.advance_to(0.02)
    for number in range(2, 21):
        pieces.advance_to(number * 1e-3)
        if number == 10:
            restored.restore(Checkpoint.from_bytes(pieces.checkpoint().to_bytes()))
    restored.advance_to(0.02)
    for simulation in (whole, pieces, restored):
        simulation.release(2)
        simulation.advance_to(0.03)
    assert bits(whole) == bits(pieces) == bits(restored)
    untouched = ico.compile_scene(scene)
    untouched.advance_to(0.03)
    assert bits(untouched) != bits(whole)


@pytest.mark.parametrize(('name', 'change', 'words'), [
    ('due', {'due': -1.0}, 'due must not be before'),
    ('mass', {'pulled': [[1, [0.0, 0.0, 0.0], -1.0]]}, 'the mass -1.0'),
    ('body', {'pulled': [[9, [0.0, 0.0, 0.0], 1.0]]}, 'a body 9, which the scene lacks'),
    ('vector', {'forces': [[1, [0.0, 'x', 0.0]]]}, 'three finite numbers')])
def test_damaged_checkpoint_is_refused(simulation, name, change, words):
    from icofabric_sim.simulation.checkpoints.state_tree import StateTree
    simulation.pull(BODY, (0.1, 0.0, 0.0))
    pulls = simulation.inputs.pulls
    tree = pulls.state_tree()
    pulls.load_state(StateTree(tree), 0.0)
    with pytest.raises(ValueError, match=words):
        pulls.load_state(StateTree({**tree, **change}), 0.0)
