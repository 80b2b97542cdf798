# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""docs/errata.md: each row has a test, and those that no other file has."""

import ast
import math
from pathlib import Path
import re

from fabrics import make_scene
from icofabric_sim.geometry import icosahedron as ico
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.geometry.shell import Shell
from icofabric_sim.pictures.weave_diagram import connector_stubs
from icofabric_sim.scene.weave_index import centre_rule
from icofabric_sim.statics.fabric import StaticFabric
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / 'docs' / 'errata.md').read_text('utf-8')
TAU = ico.TAU


def test_every_row_has_a_test():
    rows = [line.strip('|').split('|') for line in TEXT.splitlines()
            if re.match(r'\| C\d', line)]
    assert [row[0].strip() for row in rows] == [f'C{number}' for number in range(1, 21)]
    for row in rows:
        assert len(row) == 6 and all(cell.strip() for cell in row)
    named = re.findall(r'`([\w/]+\.py)::(\w+)`', TEXT)
    assert len(named) >= 20 + 7
    for file, name in named:
        tree = ast.parse((ROOT / 'test' / file).read_text('utf-8'))
        assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_c1_coordinates_about_the_centre():
    """A vertex in the frame of the world less R is that vertex in the body, turned."""
    scene = make_scene(weave={'size': [2, 2, 2], 'variant': 2})
    simulated = StaticFabric(scene).start
    body = scene.body_count - 1
    R = simulated.position[body]
    turn = cosines_from_quaternions(simulated.orientation[body:body + 1])[0]
    r_body = ico.vertices(scene.shell.half_edge)
    x_0 = R + r_body @ turn
    assert np.abs(R).min() >= 0.0 and np.linalg.norm(R) > scene.shell.half_edge
    assert np.allclose((x_0 - R) @ turn.T, r_body, atol=1e-16)
    assert not np.allclose((x_0 + R) @ turn.T, r_body, atol=scene.shell.half_edge)


def test_c9_and_c10_counts():
    """Freedoms of statics; numbers of a state, of both forms of rotation."""
    scene = make_scene(weave={'size': [3, 3, 3]})
    start, bodies = StaticFabric(scene).start, scene.body_count
    assert start.force.size == 6 * bodies
    quaternions = 3 + 3 + 3 + 4  # R, R', omega, q
    cosines = 3 + 3 + 3 + 9  # R, R', omega, mu
    assert (quaternions, cosines) == (13, 18)
    # As printed: R once, q or mu, and omega.
    assert (quaternions - 3, cosines - 3) == (10, 15)


def test_c11_the_gyroscopic_term_belongs_to_the_body_frame():
    """
    Free rotation of a body with three moments: I omega is constant in the world.

    Euler's equations have I omega' + omega x I omega = 0 with the derivative of the components in
    the body; in the world d(I omega)/dt vanishes alone, and the second term does not.
    """
    moments = np.diag([1.0, 2.0, 3.5])

    def euler(_, state):
        q, spin = state[:4], state[4:]
        turned = np.array([
            -q[1:] @ spin, *(q[0] * spin + np.cross(q[1:], spin))])  # q omega, scalar first
        return [*(0.5 * turned), *np.linalg.solve(moments, -np.cross(spin, moments @ spin))]

    times = np.linspace(0.0, 3.0, 31)
    found = solve_ivp(euler, (0.0, 3.0), [1, 0, 0, 0, 0.4, 1.1, -0.7], t_eval=times, rtol=1e-11,
                      atol=1e-12).y
    momenta, gyroscopic = [], []
    for q, spin in zip(found[:4].T, found[4:].T):
        to_world = Rotation.from_quat([*q[1:], q[0]])
        momenta.append(to_world.apply(moments @ spin))
        gyroscopic.append(np.linalg.norm(np.cross(spin, moments @ spin)))
    assert np.ptp(momenta, axis=0).max() < 1e-9
    assert min(gyroscopic) > 0.1


def test_no_gyroscopic_term_of_an_isotropic_body():
    shell = Shell.from_thickness(0.02, 0.002, 1200.0)
    tensor = shell.inertia * np.eye(3)
    for spin in np.random.RandomState(2).normal(size=(20, 3)):
        assert np.abs(np.cross(spin, tensor @ spin)).max() < 1e-15 * shell.inertia * (spin @ spin)


@pytest.mark.parametrize('variant', [0, 1])
def test_c13_the_component_that_may_differ(variant):
    i, k = 2, 1
    x, y, _ = np.array([centre_rule(variant, i, j, k) for j in range(4)]).T
    assert len(set(y.tolist())) == 4
    assert x[0] != x[1] and x[0] == x[2] and x[1] == x[3]


def test_c18_the_bound_of_the_thickness():
    """The distance of opposite faces is twice the bound; the circle in a face is smaller."""
    corners = ico.outer_triangles(1.0)
    distance = np.linalg.norm(corners.mean(axis=1), axis=1)
    assert distance == pytest.approx(np.full(20, TAU**2 / math.sqrt(3.0)), rel=1e-14)
    assert distance[0] == pytest.approx(1.5115, abs=5e-5)
    assert distance[0]**2 == pytest.approx(2.0 / 3.0 + TAU, rel=1e-14)
    sides = corners.mean(axis=1)[:, None] - 0.5 * (corners + np.roll(corners, 1, axis=1))
    circle = np.linalg.norm(sides, axis=2)
    assert circle == pytest.approx(np.full((20, 3), 1.0 / math.sqrt(3.0)), rel=1e-14)


def test_c20_six_equations_do_not_determine_the_motion():
    """The same R, R' and omega, and another orientation: other forces and torques."""
    scene = make_scene(weave={'size': [2, 2, 2]})
    start = StaticFabric(scene).start
    assert np.abs(start.force).max() < 1e-12
    turn = np.zeros((scene.body_count, 6))
    turn[0, 3:] = [0.0, 0.3, 0.0]
    turned = start.moved(turn)
    assert np.array_equal(turned.position, start.position)
    assert np.linalg.norm(turned.force[0, :3]) > 0.1
    assert np.linalg.norm(turned.force[0, 3:]) > 1e-3


def test_one_frustum_gives_the_inertia():
    """Of each face alike; (8/3) tau^4 and (20/3) tau^2 are eqs 44 and 42."""
    a, b = 1.0, 0.6
    for corners in ico.outer_triangles(a):
        volume = np.linalg.det(corners) / 6.0
        assert 6.0 * volume == pytest.approx(2.0 * TAU**2, rel=1e-14)
        squares = volume / 20.0 * ((corners**2).sum() + (corners.sum(axis=0)**2).sum())
        assert squares == pytest.approx(TAU**4 / 5.0, rel=1e-14)
    shell = Shell.from_inner_edge_length(2.0 * a, 2.0 * b, 1.0)
    assert shell.inertia == pytest.approx(8.0 / 3.0 * TAU**4 * (a**5 - b**5), rel=1e-14)
    assert shell.volume == pytest.approx(20.0 / 3.0 * TAU**2 * (a**3 - b**3), rel=1e-14)
    assert TAU**4 == pytest.approx((7.0 + 3.0 * math.sqrt(5.0)) / 2.0, rel=1e-15)


@pytest.mark.parametrize('angle', [-0.3, 0.25])
def test_turns_of_the_weave(angle):
    """Connectors of a shell, as lines, after turns by 90 and 180 degrees."""
    lines = connector_stubs(1.0, angle).reshape(12, 6)

    def turned(axis: str, degrees: float) -> np.ndarray:
        turn = Rotation.from_euler(axis, degrees, degrees=True)
        found = np.hstack([turn.apply(lines[:, :3]), turn.apply(lines[:, 3:])]).round(9) + 0.0
        return found[np.lexsort(found.T)]

    plain = turned('z', 0.0)
    for axis in 'xyz':
        assert np.allclose(turned(axis, 180.0), plain, atol=1e-8)
        assert np.allclose(turned(axis, 90.0), turned('z', 90.0), atol=1e-8)
        assert not np.allclose(turned(axis, 90.0), plain, atol=0.1)
