# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Least resultants under non-overlap, the document's statics, beside least energy."""

import math

import icofabric_sim as ico
from icofabric_sim.commands.main import main
from icofabric_sim.parameters.text import dump_parameters
from icofabric_sim.statics.resultants import LEAST_RESULTANTS
import numpy as np
import pytest
from scipy.optimize import least_squares

A = 0.01
HALF = A * (1.0 + math.sqrt(5.0)) / 2.0
STIFFNESS = np.array([900.0, 300.0, 100.0])  # N/m of a field of springs to the origin


def springs(time, position, orientation, linear_velocity, angular_velocity):
    """Force and torque of an anisotropic spring to the origin."""
    return -STIFFNESS * position, np.zeros_like(position)


def held_off(normal, offset):
    """One shell that cannot turn, drawn to the origin by springs, behind a plane."""
    return ico.Scene.from_parameters({
        'weave.size': [1, 1, 1], 'groups.it': 'all', 'supports.it.group': 'it',
        'supports.it.fix': 'rotation', 'contact.stiffness': 1e6, 'initial.it.group': 'all',
        'initial.it.displacement': (0.01 * np.array(normal)).tolist(),
        'planes.wall.normal': list(normal), 'planes.wall.offset': offset})


def test_a_wall_askew_to_the_springs_tells_the_two_apart():
    """
    With K the stiffness and n the normal the place x of least energy is along K^-1 n.

    That of the least resultant |K x| is along K^-2 n. Both lie on the plane n x = c of the centre.
    """
    normal = np.array([0.6, 0.8, 0.0])
    scene = held_off([0.6, 0.8, 0.0], 0.0)
    # How far the centre stays from the wall: the support of the shell along the normal.
    corners = np.array([[0, s, t * 1.618033988749895] for s in (1, -1) for t in (1, -1)])
    corners = A * np.concatenate([np.roll(corners, k, axis=1) for k in range(3)])
    distance = float((corners @ -normal).max())
    force = ico.BodyForce(springs, compiled=False)
    for objective, power in (('resultants', -2.0), ('energy', -1.0)):
        found = ico.solve_equilibrium(scene, body_force=force, objective=objective)
        along = STIFFNESS**power * normal
        wanted = along * (distance / (normal @ along))
        assert found.converged, found.reason
        # Contacts as springs give way by 4e-3 a.
        np.testing.assert_allclose(
            found.snapshot.position[0], wanted, rtol=0,
            atol=(1e-5 if objective == 'resultants' else 5e-3) * A)
        if objective == 'resultants':
            assert found.verdict == LEAST_RESULTANTS
            np.testing.assert_allclose(
                found.unbalanced_wrench[0, :3], -STIFFNESS * wanted, rtol=1e-4, atol=1e-4)
            # The wall alone cannot bear it: that takes friction.
            push = found.unbalanced_wrench[0, :3]
            assert np.linalg.norm(push - (push @ normal) * normal) > 0.1 * np.linalg.norm(push)


def test_both_agree_where_an_equilibrium_exists():
    scene = ico.load_scene('hanging_slab').with_changes({'weave.size': [4, 3, 3]})
    energy = ico.solve_equilibrium(scene)
    found = ico.solve_equilibrium(scene, objective='resultants')
    assert found.converged and found.residual < 1e-9 and found.verdict == energy.verdict
    apart = np.abs(found.snapshot.position - energy.snapshot.position).max()
    moved = np.abs(energy.snapshot.position - scene.position).max()
    assert moved > 0.01 * scene.geometry.half_edge > 1e4 * apart


def test_two_shells_and_contradicting_loads_against_an_independent_minimum():
    """Loads that nothing bears and a connector between them: SciPy on our own residual."""
    scene = ico.Scene.from_parameters({
        'weave.size': [2, 2, 1], 'contact.mode': 'never', 'connector.stiffness': 200.0,
        'groups.one': 'ids 0', 'groups.other': 'ids 1', 'groups.both': 'all',
        'supports.both.group': 'both', 'supports.both.fix': 'rotation',
        'loads.one.group': 'one', 'loads.one.force': [0.3, 0.1, 0.05],
        'loads.other.group': 'other', 'loads.other.force': [-0.1, 0.02, 0.0]})
    assert scene.body_count == 2 and scene.connector_count == 1
    found = ico.solve_equilibrium(scene, objective='resultants')
    snapshot = ico.compile_scene(scene).snapshot()
    arms = snapshot.connector_ends[0] - scene.position[scene.connectors.bodies[0]]
    loads = np.array([[0.3, 0.1, 0.05], [-0.1, 0.02, 0.0]])
    rest = float(np.ravel(scene.connectors.natural_length)[0])

    def left_over(coordinates):
        place = scene.position + coordinates.reshape(2, 3)
        ends = place[scene.connectors.bodies[0]] + arms
        along = ends[1] - ends[0]
        length = np.linalg.norm(along)
        pull = 200.0 * (length - rest) * along / length
        left = loads.copy()
        left[scene.connectors.bodies[0]] += [pull, -pull]
        return left.ravel()

    best = least_squares(left_over, np.zeros(6), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    # Whatever the connector does, half of the sum of the loads is left on each.
    squares = 2.0 * best.cost
    assert squares == pytest.approx(0.5 * float((loads.sum(axis=0)**2).sum()), rel=1e-6)
    assert found.converged and found.verdict == LEAST_RESULTANTS
    assert float((found.unbalanced_wrench[:, :3]**2).sum()) == pytest.approx(squares, rel=1e-6)
    np.testing.assert_allclose(
        found.unbalanced_wrench[:, :3], np.tile(0.5 * loads.sum(axis=0), (2, 1)), atol=1e-5)


def test_weight_that_a_floor_bears_is_what_is_left():
    scene = ico.Scene.from_parameters({
        'weave.size': [1, 1, 1], 'gravity': [0.0, 0.0, -9.81], 'contact.stiffness': 1e5,
        'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.9 * HALF})
    found = ico.solve_equilibrium(scene, objective='resultants')
    assert found.converged and found.verdict == LEAST_RESULTANTS
    np.testing.assert_allclose(
        found.unbalanced_wrench[0], [0.0, 0.0, -9.81 * scene.shell.mass, 0.0, 0.0, 0.0], atol=1e-9)
    # It began in the floor, and is moved out of it.
    assert found.contact_state.depth < 1e-5 * A


def whirl(time, position, orientation, linear_velocity, angular_velocity):
    """Force without a potential."""
    return np.cross([0.0, 0.0, 100.0], position), np.zeros_like(position)


def test_what_it_cannot_do_is_refused():
    with pytest.raises(ValueError, match="'resultants' needs forces .*body_force whirl follows"):
        ico.solve_equilibrium(
            held_off([0.6, 0.8, 0.0], 0.0), objective='resultants',
            body_force=ico.BodyForce(whirl, compiled=False))
    scene = ico.load_scene('hanging_slab').with_changes({
        'loads.it.group': 'all', 'loads.it.frame': 'body', 'loads.it.force': [0.0, 0.0, 1.0]})
    with pytest.raises(ValueError, match=r"'resultants' needs forces .*loads\.it follows"):
        ico.solve_equilibrium(scene, objective='resultants')
    with pytest.raises(ValueError, match='objective must be one of energy, resultants'):
        ico.solve_equilibrium(scene, objective='work')
    with pytest.raises(ValueError, match='equilibrium.objective must be one of energy, result'):
        scene.with_changes({'equilibrium.objective': 'work'})
    with pytest.raises(ValueError, match="equilibrium.objective is 'resultants'; set it to ene"):
        ico.step_loads(scene.with_changes({'equilibrium.objective': 'resultants'}), [1.0])


def test_the_scene_chooses_it_where_no_argument_does(tmp_path, capsys):
    scene = ico.Scene.from_parameters({
        'weave.size': [1, 1, 1], 'gravity': [0.0, 0.0, -9.81], 'contact.stiffness': 1e5,
        'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.9 * HALF,
        'equilibrium.objective': 'resultants'})
    assert ico.solve_equilibrium(scene).verdict == LEAST_RESULTANTS
    assert ico.solve_equilibrium(scene, objective='energy').verdict != LEAST_RESULTANTS
    path = tmp_path / 'scene.yaml'
    path.write_text(dump_parameters(scene.parameters.given()))
    assert main(['statics', str(path)]) == 0
    assert f'verdict    {LEAST_RESULTANTS}' in capsys.readouterr().out
    assert main(['statics', str(path), '--objective', 'energy', '--load-steps', '1']) == 0
    assert 'contact    0 pairs of shells and 1 shells on planes' in capsys.readouterr().out
    assert main(['statics', str(path), '--load-steps', '2']) == 2
    assert 'requires --objective energy' in capsys.readouterr().err
