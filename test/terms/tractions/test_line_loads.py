# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Line loads on edges, against their resultants in closed form and an independent integral."""

import math

from fabrics import changed, make_scene, wrenches
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import (
    edge_midpoints,
    EDGES,
    NAMED_EDGE_TANGENTS,
    NAMED_EDGES,
    vertices,
)
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.scene.line_loads import select_edges
from icofabric_sim.scene.summary import describe_scene
from icofabric_sim.simulation.devices import refusals
from icofabric_sim.simulation.model.expression_force import with_expressions
from icofabric_sim.simulation.model.layout import make_layout
from icofabric_sim.terms.body_force.external_force import call_function
import numpy as np
import pytest

A = 0.01
FORCE = np.array([3.0, -2.0, 5.0])
TURNED = {'initial.turned.group': 'g', 'initial.turned.rotation': [0.4, -0.7, 0.2]}


def scene_with(changes, size=(1, 1, 1)):
    return make_scene(size, {
        'groups.g': 'all', 'line_loads.l.group': 'g', 'line_loads.l.edges': 'north',
        'line_loads.l.force': FORCE.tolist(), 'solver.method': 'srkn4', **TURNED,
        **{f'line_loads.l.{name}': value for name, value in changes.items()}})


def acting(scene):
    """Forces and torques of the kernels on bodies in the initial state."""
    bare = changed(scene, {'weave.connected': False})
    return wrenches(bare, scene.initial.position, scene.initial.orientation, loaded=True)


@pytest.mark.parametrize('frame', ['world', 'body'])
@pytest.mark.parametrize('text, total, middle', [
    # Integrals over s of the factor, and of the factor times s - 1/2.
    ('', 1.0, 0.0), ('2', 2.0, 0.0), ('s', 1.0 / 2.0, 1.0 / 12.0), ('s - 1/2', 0.0, 1.0 / 12.0),
    ('sin(pi*s)', 2.0 / math.pi, 0.0), ('exp(s)', math.e - 1.0, 1.0 - 0.5 * (math.e - 1.0))])
def test_resultants_are_those_of_the_closed_form(frame, text, total, middle):
    """A uniform load is its total at the middle of the edge; others add a first moment."""
    scene = scene_with({'frame': frame, 'expression': text})
    axes = cosines_from_quaternions(scene.initial.orientation)[0]
    edge = NAMED_EDGES.index('north')
    tangent, place = NAMED_EDGE_TANGENTS[edge], edge_midpoints(A)[edge]
    force = 2.0 * A * FORCE @ (np.eye(3) if frame == 'world' else axes)
    moment = np.cross(total * place @ axes + 2.0 * A * middle * tangent @ axes, force)
    got = acting(scene)
    assert got.force[0] == pytest.approx(total * force, rel=1e-9, abs=1e-15)
    assert got.torque[0] == pytest.approx(moment, rel=1e-9, abs=1e-16)
    assert np.linalg.norm(moment) > 1e-5


@pytest.mark.parametrize('frame', ['world', 'body'])
@pytest.mark.parametrize('text', ['3*s, cos(s) - 2, 4', '3*s*t, cos(s - 20*y), 4 + exp(9*x)*z'])
def test_components_are_integrated_over_several_edges(frame, text):
    """Without place and time by the kernels of tractions, else by a compiled function."""
    scene = scene_with({
        'edges': 'up 3-4', 'frame': frame, 'force': [0.0, 0.0, 0.0], 'expression': text})
    state, time = np.hstack(scene.initial), 0.37
    axes = cosines_from_quaternions(scene.initial.orientation)[0]
    expected, nodes = np.zeros(6), np.polynomial.legendre.leggauss(40)
    for corners in ((0, 1), (0, 4)):
        start, end = vertices(A)[list(corners)]
        for node, weight in zip(*nodes):
            s = 0.5 + 0.5 * node
            arm = (start + s * (end - start)) @ axes
            x, y, z = scene.initial.position[0] + arm
            push = np.array([3.0 * s, math.cos(s) - 2.0, 4.0] if 'x' not in text else [
                3.0 * s * time, math.cos(s - 20.0 * y), 4.0 + math.exp(9.0 * x) * z])
            push = push @ (axes if frame == 'body' else np.eye(3))
            expected += A * weight * np.hstack([push, np.cross(arm, push)])
    if scene.expression_loads:
        force = with_expressions(scene, None)
        external = force.prepare(make_layout(scene.weave.grid, 1), state)
        assert call_function(
            external.address, time, external.numbers, external.result) == 0
        found = external.result[0]
    else:
        got = acting(scene)
        found = np.hstack([got.force[0], got.torque[0]])
    assert bool(scene.expression_loads) == ('x' in text)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-15)


def test_edges_have_names_and_faces():
    assert select_edges('edges', '1-2').tolist() == select_edges('edges', 'up').tolist()
    assert len(select_edges('edges', 'all')) == len(EDGES) == 30
    for text in ('', 'top', '1-7', '0-1', '1-21', '1', '1-2-3', 'up down 1-1'):
        with pytest.raises(ico.ParameterError, match='line_loads.l.edges'):
            scene_with({'edges': text})


def test_a_free_body_gains_the_momentum_of_the_load():
    scene = scene_with({'profile': 'ramp', 'duration': 0.02})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.05)
    state = simulation.snapshot()
    assert state.linear_velocity[0] == pytest.approx(
        2.0 * A * FORCE * 0.04 / scene.shell.mass, rel=1e-9)
    assert np.abs(state.angular_velocity).max() > 1.0
    assert state.energy['work_in'] == pytest.approx(state.energy['kinetic'], rel=1e-6)
    lines = '\n'.join(text for _, text in describe_scene(scene))
    assert 'l: on g (1 body), edges north, [3, -2, 5] N/m, world axes; from the start as' in lines


@pytest.mark.parametrize('frame, text', [('world', ''), ('body', '1 + s'), ('world', '1 - 30*z')])
def test_statics_balances_line_loads(frame, text):
    scene = make_scene((3, 2, 2), {
        'groups.wall': 'x_min', 'groups.tip': 'x_max', 'supports.w.group': 'wall',
        'connector.bending_stiffness': 0.02, 'line_loads.l.group': 'tip',
        'line_loads.l.edges': 'east', 'line_loads.l.force': [0.0, 0.0, -4.0],
        'line_loads.l.frame': frame, 'line_loads.l.expression': text})
    result, tip = ico.solve_equilibrium(scene), scene.groups['tip']
    assert result.converged
    axes = cosines_from_quaternions(result.snapshot.orientation)
    edge = NAMED_EDGES.index('east')
    force = np.zeros(3)
    for body in tip:
        # The integral of a linear factor is its value at the middle of the edge.
        z = result.snapshot.position[body, 2] + (edge_midpoints(A)[edge] @ axes[body])[2]
        size = 2.0 * A * {'': 1.0, '1 + s': 1.5, '1 - 30*z': 1.0 - 30.0 * z}[text]
        force += size * np.array([0.0, 0.0, -4.0]) @ (axes[body] if frame == 'body' else np.eye(3))
    assert result.reaction[:, :3].sum(axis=0) == pytest.approx(-force, abs=1e-9)
    assert np.abs(result.snapshot.position - scene.position).max() > 1e-4


def test_what_opposes_a_line_load_is_refused():
    for changes, words in (
            ({'expression': 's, 0, 0'}, 'line_loads.l.force'),
            ({'expression': 'xi'}, "unknown name 'xi'"),
            ({'expression': '1/s'}, 'do not converge'),
            ({'expression': 'log(s - 1/2)'}, 'converge|not a finite number at s = ')):
        with pytest.raises(ico.ParameterError, match=words):
            scene_with(changes)
    with pytest.raises(ico.ParameterError, match='line_loads.l with a surface force is not comp'):
        refusals.require_on_device(
            scene_with({}), cosines=False, body_force=False, shared=False)
