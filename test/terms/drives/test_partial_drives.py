# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Drives that move some freedoms of their bodies and leave the others free.
"""

import math

from fabrics import make_scene, same_state
import icofabric_sim as ico
import numpy as np
import pytest

METHODS = ['leapfrog', 'srkn6', pytest.param('dop8', marks=pytest.mark.long)]
# A slab whose far side is sheared while a constant weight presses on it.
SHEARED = {
    'weave.connector_angle': 0.3, 'groups.low': 'z_min', 'supports.floor.group': 'low',
    'groups.high': 'z_max', 'drives.shear.group': 'high', 'drives.shear.freedoms': 'tx ty',
    'drives.shear.motion': 'sine', 'drives.shear.linear': [0.004, 0.0, 0.0],
    'drives.shear.frequency': 3.0, 'drives.shear.phase': -0.5 * math.pi,
    'loads.press.group': 'high', 'loads.press.force': [0.3, 0.2, -0.5],
    'loads.press.point': [0.002, 0.001, 0.003], 'loads.press.torque': [1e-4, 2e-4, 0.0],
    'connector.bending_stiffness': 0.02, 'connector.twisting_stiffness': 0.02}


def run(scene, time):
    simulation = ico.compile_scene(scene)
    simulation.advance_to(time)
    return simulation.snapshot()


@pytest.mark.parametrize('method', METHODS)
def test_what_is_not_driven_falls(method):
    """Along y as the path says, x by its own velocity, z by weight, and it spins on."""
    scene = make_scene((1, 1, 1), {
        'solver.method': method, 'groups.g': 'all', 'drives.d.group': 'g',
        'drives.d.freedoms': 'ty', 'drives.d.motion': 'ramp', 'drives.d.duration': 0.2,
        'drives.d.linear': [0.0, 0.3, 0.0], 'gravity': [0.0, 0.0, -9.81],
        'initial.i.group': 'g', 'initial.i.linear_velocity': [0.1, 0.0, 0.0],
        'initial.i.angular_velocity': [0.0, 0.0, 2.0], 'solver.energy_limit': 1.0})
    state = run(scene, 0.5)
    assert state.position[0] == pytest.approx(
        [0.05, 0.3 * 0.4, -0.5 * 9.81 * 0.25], abs=1e-12)
    assert state.angular_velocity[0] == pytest.approx([0.0, 0.0, 2.0], abs=1e-12)
    assert state.orientation[0] == pytest.approx(
        [0.0, 0.0, math.sin(0.5), math.cos(0.5)], abs=1e-7)
    # What the path has put in is the energy of the motion along it.
    assert state.energy['work_in'] == pytest.approx(0.5 * scene.shell.mass * 0.09, rel=1e-9)
    assert abs(state.energy['balance_error']) < 1e-12


@pytest.mark.parametrize('method', METHODS)
def test_a_plate_is_sheared_under_a_constant_load(method):
    """The path holds x and y, the load moves z; the energy balances to the order of the method."""
    errors = []
    for step in (4e-5, 2e-5):
        scene = make_scene((3, 3, 3), {
            **SHEARED, 'solver.method': method, 'solver.step': step, 'solver.energy_limit': 1.0})
        state, time = run(scene, 0.25), 0.25
        high = scene.groups['high']
        moved = state.position[high] - scene.position[high]
        assert moved[:, 0] == pytest.approx(
            0.004 * (math.sin(6.0 * math.pi * time - 0.5 * math.pi) + 1.0), abs=1e-15)
        assert np.abs(moved[:, 1]).max() < 1e-15
        assert np.abs(moved[:, 2]).max() > 1e-4
        assert np.abs(state.angular_velocity[high]).max() > 1e-3
        errors.append(abs(state.energy['balance_error']) / state.energy['work_in'])
    assert abs(state.energy['work_in']) > 1e-4
    if method == 'leapfrog':
        assert errors[0] < 1e-3 and errors[1] < 0.35 * errors[0]
    else:
        assert max(errors) < 1e-7


@pytest.mark.parametrize('frame', ['world', 'body'])
@pytest.mark.parametrize('method', METHODS)
def test_a_load_on_what_a_path_turns(method, frame):
    """Its force moves the bodies, its torque does nothing; the energy balances."""
    scene = make_scene((3, 3, 3), {
        **{name: value for name, value in SHEARED.items() if not name.startswith('drives')},
        'drives.turn.group': 'high', 'drives.turn.freedoms': 'rotation',
        'drives.turn.motion': 'velocity', 'drives.turn.angular': [0.0, 0.0, 3.0],
        'loads.press.frame': frame, 'solver.method': method, 'solver.tolerance': 1e-8})
    state, high = run(scene, 0.2), scene.groups['high']
    turned = np.array([0.0, 0.0, math.sin(0.3), math.cos(0.3)])
    assert state.orientation[high] == pytest.approx(
        np.broadcast_to(turned, (len(high), 4)), abs=1e-12)
    assert np.abs(state.position - scene.position)[high].max() > 1e-3
    assert state.energy['work_in'] > 1e-3
    # That of leapfrog swings with its steps.
    assert abs(state.energy['balance_error']) < (
        1e-3 if method == 'leapfrog' else 1e-6) * state.energy['work_in']


def test_methods_agree():
    scenes = [make_scene((3, 3, 3), {**SHEARED, 'solver.method': method, 'solver.tolerance': 1e-8})
              for method in ('srkn6', 'dop8')]
    one, two = (run(scene, 0.2) for scene in scenes)
    assert one.position == pytest.approx(two.position, abs=1e-10)
    assert one.orientation == pytest.approx(two.orientation, abs=1e-8)


def test_all_freedoms_named_are_all():
    """A drive that names every freedom is one that names none, to the bit."""
    changes = {
        'groups.high': 'z_max', 'drives.d.group': 'high', 'drives.d.motion': 'velocity',
        'drives.d.linear': [0.01, 0.0, 0.02], 'drives.d.angular': [0.0, 0.3, 0.0]}
    ends = [run(make_scene((3, 3, 3), {**changes, **more}), 0.1) for more in (
        {}, {'drives.d.freedoms': 'rotation tz ty tx'})]
    assert same_state(*ends)


def test_two_paths_share_bodies():
    """Along x by one, z and the rotation by another; y stays free."""
    scene = make_scene((3, 3, 3), {
        'groups.high': 'z_max', 'groups.low': 'z_min', 'supports.floor.group': 'low',
        'drives.a.group': 'high', 'drives.a.freedoms': 'tx', 'drives.a.motion': 'velocity',
        'drives.a.linear': [0.02, 0.0, 0.0], 'drives.b.group': 'high',
        'drives.b.freedoms': 'tz rotation', 'drives.b.motion': 'ramp', 'drives.b.duration': 0.1,
        'drives.b.linear': [0.0, 0.0, 0.01], 'drives.b.angular': [0.0, 0.0, 0.5],
        'loads.l.group': 'high', 'loads.l.force': [0.0, 0.05, 0.0]})
    time = 0.2
    state, high = run(scene, time), scene.groups['high']
    moved = state.position[high] - scene.position[high]
    assert moved[:, 0] == pytest.approx(0.02 * time, abs=1e-15)
    assert moved[:, 2] == pytest.approx(0.01 * (time - 0.05), abs=1e-15)
    half = 0.5 * 0.5 * (time - 0.05)
    turned = np.array([0.0, 0.0, math.sin(half), math.cos(half)])
    assert state.orientation[high] == pytest.approx(
        np.broadcast_to(turned, (len(high), 4)), abs=1e-12)
    assert np.abs(moved[:, 1]).min() > 1e-4
    assert abs(state.energy['balance_error']) < 1e-5 * state.energy['work_in']


def test_at_rest_a_held_freedom_is_a_support():
    changes = {
        'groups.low': 'z_min', 'supports.floor.group': 'low', 'groups.high': 'z_max',
        'loads.l.group': 'high', 'loads.l.force': [0.05, 0.02, 0.0],
        'connector.bending_stiffness': 0.02, 'connector.twisting_stiffness': 0.02}
    by_path = ico.solve_equilibrium(make_scene((3, 3, 3), {
        **changes, 'drives.d.group': 'high', 'drives.d.freedoms': 'tz rotation'}))
    by_support = ico.solve_equilibrium(make_scene((3, 3, 3), {
        **changes, 'supports.s.group': 'high', 'supports.s.fix': 'tz rotation'}))
    assert by_path.converged and by_support.converged
    high = make_scene((3, 3, 3), changes).groups['high']
    assert by_path.snapshot.position == pytest.approx(by_support.snapshot.position, abs=1e-12)
    assert by_path.reaction == pytest.approx(by_support.reaction, abs=1e-9)
    assert np.abs(by_path.reaction[high, 2]).max() > 1e-3


def test_reactions_are_those_of_driven_freedoms():
    """A rig's load cell: the path bears the load along x, and the weight along z falls."""
    scene = make_scene((1, 1, 1), {
        'groups.g': 'all', 'drives.d.group': 'g', 'drives.d.freedoms': 'tx',
        'loads.l.group': 'g', 'loads.l.force': [0.3, 0.0, 0.0], 'gravity': [0.0, 0.0, -1.0]})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.1)
    found = simulation.reactions()
    assert found.force[0] == pytest.approx([-0.3, 0.0, 0.0], abs=1e-12)
    assert simulation.snapshot().position[0] == pytest.approx([0.0, 0.0, -0.005], abs=1e-12)


@pytest.mark.parametrize('changes, words', [
    ({'drives.d.freedoms': 'tx up'}, ['drives.d.freedoms', 'tx ty tz rotation']),
    ({'drives.d.freedoms': ''}, ['drives.d.freedoms']),
    ({'drives.d.freedoms': 'tx', 'drives.d.motion': 'velocity',
      'drives.d.linear': [0.0, 1.0, 0.0]}, ['drives.d.linear', 'not in drives.d.freedoms']),
    ({'drives.d.freedoms': 'tx', 'drives.d.motion': 'velocity',
      'drives.d.angular': [0.0, 1.0, 0.0]}, ['drives.d.angular']),
    ({'drives.d.freedoms': 'tx', 'drives.e.group': 'high', 'drives.e.freedoms': 'tx ty'},
     ['drives.e.group', 'already moved by drives.d', 'different freedoms']),
    ({'drives.d.freedoms': 'tx', 'drives.e.group': 'corner', 'drives.e.freedoms': 'ty'},
     ['drives.e.group', 'must have the same bodies']),
    ({'drives.d.freedoms': 'tx', 'anchors.a.body': 13, 'anchors.a.position': [0.0, 0.0, 1.0]},
     ['anchors.a.body', 'drives.d']),
    ({'drives.d.freedoms': 'tx rotation', 'tractions.t.group': 'corner',
      'tractions.t.pressure': 1.0}, ['tractions.t.group', 'drives.d', 'rotates']),
    ({'drives.d.freedoms': 'tx', 'supports.s.group': 'corner', 'supports.s.fix': 'tx'},
     ['held by a support', 'drives.d.freedoms']),
])
def test_what_contradicts_itself_is_refused(changes, words):
    with pytest.raises(ico.ParameterError) as caught:
        make_scene((3, 3, 3), {
            'groups.high': 'z_max', 'groups.corner': 'z_max and x_min', 'drives.d.group': 'high',
            **changes})
    for word in words:
        assert word in str(caught.value)


def test_a_support_may_hold_what_a_path_leaves():
    scene = make_scene((1, 1, 1), {
        'groups.g': 'all', 'drives.d.group': 'g', 'drives.d.freedoms': 'tx',
        'drives.d.motion': 'velocity', 'drives.d.linear': [0.2, 0.0, 0.0],
        'supports.s.group': 'g', 'supports.s.fix': 'tz', 'gravity': [0.0, -1.0, -9.81]})
    assert run(scene, 0.4).position[0] == pytest.approx([0.08, -0.08, 0.0], abs=1e-12)
