# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What a structure at rest has to sustain: the force and moment of each contact."""

import csv
import math

import icofabric_sim as ico
from icofabric_sim.commands.main import main
from icofabric_sim.geometry.icosahedron import edge_midpoints
from icofabric_sim.geometry.rotations import cosines_from_quaternions
import numpy as np
import pytest

HALF = 0.02 * (1.0 + math.sqrt(5.0)) / 4.0
ANGLE = 0.3


def test_a_shell_on_an_incline_is_held_by_its_weight_turned_round():
    """Push and friction together: mg upwards, and only along the normal without friction."""
    scene = ico.Scene.from_parameters({
        'weave.size': [1, 1, 1], 'contact.stiffness': 1e5, 'contact.friction': 0.5,
        'groups.it': 'all', 'supports.it.group': 'it', 'supports.it.fix': 'rotation',
        'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -HALF,
        'gravity': [9.81 * math.sin(ANGLE), 0.0, -9.81 * math.cos(ANGLE)]})
    *_, (_, found) = ico.step_loads(scene, [0.5, 1.0])
    contacts, weight = found.contacts, 9.81 * scene.shell.mass
    assert found.converged and contacts.table()['second'] == ['planes.floor']
    expected = [-weight * math.sin(ANGLE), 0.0, weight * math.cos(ANGLE)]
    assert contacts.force[0] == pytest.approx(expected, rel=1e-6, abs=1e-9 * weight)
    arm = contacts.point[0] - found.snapshot.position[0]
    assert contacts.point[0, 2] == pytest.approx(-HALF, abs=1e-6)
    assert contacts.wrench_on_first[0, 3:] == pytest.approx(
        np.cross(arm, contacts.force[0]), abs=1e-4 * weight * HALF)
    # The support, which keeps it from turning, takes what the contact turns.
    assert contacts.resultants(1)[0, 3:] == pytest.approx(
        -found.reaction[0, 3:], abs=1e-9 * weight * HALF)


def squeezed():
    """Parameters of a slab whose connectors press its shells together."""
    dense = {'weave.size': [3, 3, 3], 'weave.connector_angle': -0.36}
    length = ico.Scene.from_parameters(dense).geometry.connector_length
    return {**dense, 'contact.stiffness': 2e4, 'connector.natural_length': 0.9 * length}


def test_connectors_and_contacts_balance_on_each_shell():
    """Connector forces from their ends and tensions."""
    scene = ico.Scene.from_parameters(squeezed())
    found = ico.solve_equilibrium(scene)
    contacts, snapshot = found.contacts, found.snapshot
    assert found.converged and len(contacts.bodies) > 10
    sizes = np.linalg.norm(contacts.force, axis=1)
    assert sizes.min() > 1e-3 * found.force_scale
    ends = scene.connectors.bodies
    axes, own = cosines_from_quaternions(snapshot.orientation), edge_midpoints(
        scene.geometry.half_edge)
    wrenches = contacts.resultants(scene.body_count)
    points = [
        snapshot.position[ends[:, end]] + np.einsum(
            'cij,ci->cj', axes[ends[:, end]], own[scene.connectors.edges[:, end]])
        for end in range(2)]
    along = points[1] - points[0]
    pull = found.tension[:, None] * along / np.linalg.norm(along, axis=1, keepdims=True)
    for end, sign in ((0, 1.0), (1, -1.0)):
        arm = points[end] - snapshot.position[ends[:, end]]
        np.add.at(wrenches, ends[:, end], np.hstack([sign * pull, np.cross(arm, sign * pull)]))
    left = np.abs(wrenches) / np.repeat([1.0, scene.geometry.half_edge], 3)
    assert left.max() < 1e-8 * found.force_scale
    # The two bodies of a contact are pushed apart by equal forces.
    assert np.array_equal(contacts.wrench_on_first[:, :3], -contacts.wrench_on_second[:, :3])


def test_the_command_writes_contacts_and_resultants(tmp_path):
    changes = [part for name, value in squeezed().items() for part in ('-p', f'{name}:={value}')]
    assert main(['statics', 'free_slab', *changes, '--output', str(tmp_path / 'rest')]) == 0
    with open(tmp_path / 'rest' / 'contacts.csv', encoding='utf-8') as file:
        contacts = list(csv.DictReader(file))
    with open(tmp_path / 'rest' / 'bodies.csv', encoding='utf-8') as file:
        bodies = list(csv.DictReader(file))
    assert len(contacts) > 10 and len(bodies) > 5
    whole = np.zeros(len(bodies))
    for row in contacts:
        whole[int(row['first'])] += float(row['force_x_n'])
        whole[int(row['second'])] -= float(row['force_x_n'])
    assert np.abs(whole).max() > 1e-3
    assert whole == pytest.approx([float(row['contact_force_x_n']) for row in bodies], abs=1e-12)


def test_a_scene_without_contact_has_none_of_it():
    scene = ico.Scene.from_parameters({'weave.size': [2, 2, 2], 'contact.mode': 'never'})
    assert ico.solve_equilibrium(scene).contacts is None
