# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Surface forces by a function of face, place and time, against parameters, closed forms and SciPy.
"""

import math

from fabrics import changed, make_scene
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import face_geometry, integrate_face
from icofabric_sim.geometry.rotations import cosines_from_quaternions
import numpy as np
import pytest

SLAB = {
    'groups.tip': 'x_max', 'groups.wall': 'x_min', 'supports.wall.group': 'wall',
    'solver.method': 'dop8', 'solver.tolerance': 1e-9}


def run(scene, time, **given):
    simulation = ico.compile_scene(scene, **given)
    simulation.advance_to(time)
    return simulation.snapshot()


def bent(face, xi, eta, time):
    """300 Pa (1 + 2 xi - 3 eta^2) of pressure, and two shears, by the face coordinates."""
    shape = 1.0 + 2.0 * xi - 3.0 * eta**2
    return np.column_stack([300.0 * shape, 80.0 * shape, -50.0 * shape])


@pytest.mark.parametrize('direction', [
    pytest.param('follower', marks=pytest.mark.long), 'fixed'])
def test_polynomials_are_those_of_tractions(direction):
    """A scene's own traction, and the same as a function; those of the world along its axes."""
    scene = make_scene((3, 2, 2), {
        **SLAB, 'tractions.t.group': 'tip', 'tractions.t.pressure': 300.0,
        'tractions.t.shear': [80.0, -50.0], 'tractions.t.variation': '1 2 0 0 0 -3',
        'tractions.t.faces': 'toward 1 0 0', 'tractions.t.direction': direction})
    bare = make_scene((3, 2, 2), SLAB)
    if direction == 'follower':
        force = ico.surface_force(bare, bent, group='tip', faces='toward 1 0 0')
    else:
        geometry = face_geometry(bare.geometry.half_edge)
        first = geometry.frames[:, :, 1] / np.linalg.norm(
            geometry.frames[:, :, 1], axis=1)[:, None]
        axes = cosines_from_quaternions(bare.orientation[:1])[0]

        def in_world(face, xi, eta, time):
            normal, along = geometry.normals[face - 1] @ axes, first[face - 1] @ axes
            p, one, two = bent(face, xi, eta, time).T[..., None]
            return -p * normal + one * along + two * np.cross(normal, along)

        force = ico.surface_force(
            bare, in_world, group='tip', faces='toward 1 0 0', axes='world')
    one, two = run(scene, 0.05), run(bare, 0.05, body_force=force)
    assert np.abs(one.position - bare.position).max() > 1e-4
    assert np.abs(one.orientation - bare.orientation).max() > 1e-3
    assert two.position == pytest.approx(one.position, abs=1e-10)
    assert two.orientation == pytest.approx(one.orientation, abs=1e-8)
    assert two.energy['work_in'] == pytest.approx(one.energy['work_in'], rel=1e-7)


def test_pressure_alike_on_all_faces_does_nothing():
    scene = make_scene((1, 1, 1), {'solver.method': 'dop8'})
    force = ico.surface_force(
        scene, lambda face, xi, eta, time: 1e5 * np.eye(3)[np.zeros(len(face), int)],
        faces='all')
    state = run(scene, 0.1, body_force=force)
    assert np.abs(state.position - scene.position).max() < 1e-12


def test_any_function_is_integrated_over_the_face():
    """Beside `integrate_face`, a rule of higher degree, over a face of a turned body."""
    scene = make_scene((1, 1, 1), {
        'groups.g': 'all', 'initial.i.group': 'g', 'initial.i.rotation': [0.4, -0.7, 0.2]})
    half_edge = scene.geometry.half_edge
    axes = cosines_from_quaternions(scene.initial.orientation)[0]

    def wild(face, xi, eta, time):
        return np.column_stack([
            np.exp(xi) * (1.0 + time), np.cos(2.0 * eta), xi * eta * (face == 7)])

    force = ico.surface_force(scene, wild, faces='numbers 7 12', axes='body', degree=12).force
    found, moment = force(
        0.5, scene.initial.position, scene.initial.orientation, None, None)
    total, torque = np.zeros((2, 3))
    for face in (7, 12):
        geometry = face_geometry(half_edge)
        corner, sides = geometry.frames[face - 1][:, 0], geometry.frames[face - 1][:, 1:]

        def at(points, face=face, corner=corner, sides=sides):
            # lambda1 w1 + lambda2 w2 + lambda3 w3, where lambda1 is 1 on the face.
            xi, eta = np.linalg.lstsq(sides, (points - corner).T, rcond=None)[0]
            here = wild(np.full(len(points), face), xi, eta, 0.5)
            return np.hstack([here, np.cross(points, here)])

        whole = np.asarray(integrate_face(at, face, half_edge, degree=20))
        total, torque = total + whole[:3], torque + whole[3:]
    assert found[0] == pytest.approx(total @ axes, rel=1e-9)
    assert moment[0] == pytest.approx(torque @ axes, rel=1e-9)


def test_it_may_swing_in_time():
    """A central push of one face: the velocity is A p (1 - cos w t) / (w M), and no spin."""
    scene = make_scene((1, 1, 1), {'solver.method': 'dop8', 'solver.tolerance': 1e-10})
    rate = 2.0 * math.pi * 4.0
    force = ico.surface_force(
        scene, lambda face, xi, eta, time: np.column_stack(
            [50.0 * math.sin(rate * time) + 0.0 * xi, 0.0 * xi, 0.0 * xi]), faces='numbers 3')
    state = run(scene, 0.3, body_force=force)
    geometry = face_geometry(scene.geometry.half_edge)
    area = math.sqrt(3.0) / 4.0 * scene.shell.edge_length**2
    normal = geometry.normals[2] @ cosines_from_quaternions(scene.orientation)[0]
    push = -50.0 * area * normal / scene.shell.mass
    assert state.linear_velocity[0] == pytest.approx(
        push * (1.0 - math.cos(rate * 0.3)) / rate, rel=1e-8)
    assert np.abs(state.angular_velocity).max() < 1e-9


def test_what_is_no_surface_force_is_refused():
    scene = make_scene((2, 2, 2), {'groups.tip': 'x_max'})

    def flat(face, xi, eta, time):
        return np.zeros((len(xi), 3))

    with pytest.raises(ico.ParameterError, match="no group 'top'; known: all, tip"):
        ico.surface_force(scene, flat, group='top')
    with pytest.raises(ico.ParameterError, match='faces'):
        ico.surface_force(scene, flat, faces='numbers 21')
    with pytest.raises(ValueError, match='axes must be one of face, body, world'):
        ico.surface_force(scene, flat, axes='sky')
    with pytest.raises(ValueError, match='degree must be at most 20'):
        ico.surface_force(scene, flat, degree=40)
    force = ico.surface_force(changed(scene, {}), lambda face, xi, eta, time: xi)
    with pytest.raises(ValueError, match='one row for each point'):
        ico.compile_scene(scene, body_force=force)
