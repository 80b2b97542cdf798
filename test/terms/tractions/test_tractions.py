# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Tractions on faces: closed forms on the icosahedron, both kinds of direction, friction or none.
"""

import math

from analytical import free_rotation, rotation_quaternion
from fabrics import changed, make_scene, packed_state, RANDOM, wrenches
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import face_geometry, inscribed_radius, outer_triangles
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.kernels.loads import NONE, work_row
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.inputs.inputs import Inputs
from icofabric_sim.simulation.model.packing import acting_lanes, pack_scene
from icofabric_sim.terms.profiles import ONES
import numpy as np
import pytest

A = 0.01
AREA = math.sqrt(3.0) * A * A  # of a face, whose edge is 2a
NORMALS = face_geometry(A).normals


def scene_with(changes, size=(1, 1, 1), **sections):
    return make_scene(size, {
        'groups.g': 'all', 'tractions.t.group': 'g', 'contact.mode': 'never',
        'solver.method': 'srkn4',
        **{f'tractions.t.{name}': value for name, value in changes.items()}}, **sections)


def acting(scene, orientation):
    """Forces and torques of the tractions on bodies of these orientations, by the kernels."""
    bare = changed(scene, {'weave.connected': False})
    return wrenches(bare, bare.position, orientation, loaded=True)


@pytest.mark.parametrize('face', [1, 7, 20])
def test_pressure_pushes_a_face_inwards(face):
    scene = scene_with({'faces': f'numbers {face}', 'pressure': 1000.0})
    got = acting(scene, scene.orientation)
    assert got.force[0] == pytest.approx(-1000.0 * AREA * NORMALS[face - 1], abs=1e-14)
    # It acts at the middle of the face, on the line through the centre.
    assert np.abs(got.torque).max() < 1e-15


def test_pressure_from_all_sides_does_nothing():
    scene = scene_with({'faces': 'all', 'pressure': 1000.0})
    assert scene.tractions['t'].wrenches == ()


@pytest.mark.parametrize('i, k', [(0, 0), (1, 0), (0, 1), (3, 0), (2, 2), (1, 4)])
def test_powers_of_face_coordinates_are_integrated_exactly(i, k):
    """The integral of l2^i l3^k over the unit triangle is i! k! / (i + k + 2)!."""
    def integral(i, k):
        return math.factorial(i) * math.factorial(k) / math.factorial(i + k + 2)

    degree = i + k
    coefficients = np.zeros((degree + 1) * (degree + 2) // 2)
    coefficients[degree * (degree + 1) // 2 + k] = 1.0
    face = 11
    scene = scene_with({
        'faces': f'numbers {face}', 'pressure': 3000.0, 'shear': [200.0, -500.0],
        'variation': ' '.join(map(str, coefficients))})
    got = acting(scene, scene.orientation)
    corners = outer_triangles(A)[face - 1]
    w2, w3 = corners[1] - corners[0], corners[2] - corners[0]
    e1 = w2 / np.linalg.norm(w2)
    normal = np.cross(w2, w3) / np.linalg.norm(np.cross(w2, w3))
    force = -3000.0 * normal + 200.0 * e1 - 500.0 * np.cross(normal, e1)
    moment = 2.0 * AREA * (
        integral(i, k) * corners[0] + integral(i + 1, k) * w2 + integral(i, k + 1) * w3)
    assert got.force[0] == pytest.approx(2.0 * AREA * integral(i, k) * force, rel=1e-12)
    assert got.torque[0] == pytest.approx(np.cross(moment, force), rel=1e-11, abs=1e-18)


# A twist of a face about its middle, l2 - l3 along a side, has no resultant of its own.
@pytest.mark.parametrize('variation', ['', '0 1 -1', '0.5 -1 3 0.2 0.7 -2'])
@pytest.mark.parametrize('direction', ['follower', 'fixed'])
@pytest.mark.parametrize('frictionless', [False, True])
def test_directions_follow_or_stay(direction, frictionless, variation):
    scene = scene_with({
        'faces': 'numbers 3 9', 'pressure': 700.0, 'shear': [900.0, -400.0],
        'variation': variation, 'direction': direction, 'frictionless': frictionless})
    orientation = rotation_quaternion(np.array([[0.7, -1.1, 0.4]]))
    got = acting(scene, orientation)
    axes = cosines_from_quaternions(orientation)[0]
    rest = cosines_from_quaternions(scene.orientation)[0]
    numbers = np.array([float(word) for word in (variation or '1').split()])
    powers = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)][:len(numbers)]
    # A fine midpoint rule, good to a few parts in 1e6.
    n = 500
    u, v = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n, indexing='ij')
    l2, l3, weight = u.ravel(), ((1.0 - u) * v).ravel(), ((1.0 - u) / n**2).ravel()
    g = 2.0 * AREA * weight * sum(c * l2**i * l3**k for c, (i, k) in zip(numbers, powers))
    force, torque, size = np.zeros(3), np.zeros(3), 0.0
    for face in (3, 9):
        corners = outer_triangles(A)[face - 1]
        w2, w3 = corners[1] - corners[0], corners[2] - corners[0]
        e1 = w2 / np.linalg.norm(w2)
        normal = NORMALS[face - 1]
        t = -700.0 * normal + 900.0 * e1 - 400.0 * np.cross(normal, e1)
        t = t @ (axes if direction == 'follower' else rest)
        if frictionless:
            t = (t @ (normal @ axes)) * (normal @ axes)
        points = (corners[0] + l2[:, None] * w2 + l3[:, None] * w3) @ axes
        force += g.sum() * t
        torque += np.cross(g @ points, t)
        size += np.abs(g).sum() * np.linalg.norm(t)
    assert got.force[0] == pytest.approx(force, abs=1e-5 * size)
    assert got.torque[0] == pytest.approx(torque, abs=1e-5 * size * A)
    assert np.linalg.norm(torque) > 1e-3 * size * A or frictionless


def test_faces_toward_a_direction_and_exterior_ones():
    # Around a body axis lie two faces, 20.9 degrees away; along (1, 1, 1) there is one.
    for selector, count in (
            ('toward 0 0 1', 2), ('toward 1 1 1', 1), ('within 0.8 1 1 1', 4), ('all', 20),
            ('not toward 1 1 1', 19), ('toward 0 0 1 or toward 0 0 -1', 4), ('numbers 2 5', 2),
            ('exterior', 20), ('exterior and toward 0 0 -1', 2)):
        scene = scene_with({'faces': selector, 'shear': [1.0, 0.0], 'direction': 'fixed'})
        assert len(scene.tractions['t'].wrenches) == count, selector


def test_only_the_outside_of_a_slab_is_exterior():
    pressed = scene_with(
        {'faces': 'exterior', 'pressure': 500.0}, size=(5, 5, 5), **{'weave': {'size': [5, 5, 5]}})
    bodies = np.concatenate([wrench.bodies for wrench in pressed.tractions['t'].wrenches])
    grid = pressed.weave.grid
    inner = np.flatnonzero(((grid > 0) & (grid < 4)).all(axis=1))
    assert len(inner) and not np.isin(inner, bodies).any()
    outer = np.flatnonzero(((grid == 0) | (grid == 4)).any(axis=1))
    assert np.isin(outer, bodies).all()
    # The slab is symmetric: the pressures on its sides cancel, though not on any one body.
    force = acting(pressed, pressed.orientation).force
    assert np.linalg.norm(force.sum(axis=0)) < 1e-12 < 0.1 * AREA * 500.0 < np.abs(force).max()


def test_pressure_on_top_is_a_force_in_closed_form():
    scene = scene_with({'faces': 'toward 0 0 1', 'pressure': 100.0})
    # Two faces whose normals lean by atan(1 / tau^2) to either side.
    lean = inscribed_radius(A)
    force = acting(scene, scene.orientation).force[0]
    cosine = NORMALS[0, 2]
    assert force == pytest.approx([0.0, 0.0, -200.0 * AREA * cosine], abs=1e-14)
    assert cosine == pytest.approx(math.cos(math.atan(2.0 / (3.0 + math.sqrt(5.0)))), rel=1e-14)
    assert lean > A


@pytest.mark.parametrize('direction, frictionless', [
    ('follower', False), ('fixed', False), ('fixed', True)])
def test_a_block_has_one_row_whatever_the_faces(direction, frictionless):
    scene = scene_with(
        {'faces': 'exterior', 'pressure': 500.0, 'shear': [100.0, 0.0], 'direction': direction,
         'frictionless': frictionless, 'profile': 'half_sine', 'start': 0.1, 'duration': 0.2},
        size=(4, 4, 4), **{'weave': {'size': [4, 4, 4]}})
    layout = pack_scene(scene).layout
    inputs = Inputs(scene)
    before = inputs.pack(layout)
    assert not len(before.wrench)
    while inputs.next_time <= 0.15:
        inputs.apply_next()
    loads = inputs.pack(layout)
    assert 0 < len(loads.wrench) <= len(layout.blocks.slot)
    assert len(inputs.packed_rows()) >= (20 if direction == 'fixed' else 2)
    # No kernels of their own when it begins.
    assert type(before) is type(loads)
    kinds = loads.tractions.turning, loads.tractions.fixed, loads.tractions.sliding
    assert [values is not None for values in kinds] == [
        direction == 'follower', direction == 'fixed' and not frictionless, frictionless]


def test_driven_bodies_feel_none():
    changes = {'faces': 'all', 'pressure': 500.0, 'shear': [100.0, 0.0], 'direction': 'fixed'}
    scene = scene_with(changes, size=(2, 2, 2))
    driven = changed(scene, {
        'groups.low': 'z_min', 'drives.d.group': 'low', 'drives.d.motion': 'sine',
        'drives.d.linear': [0.0, 0.0, 1e-3], 'drives.d.frequency': 5.0})
    layout = pack_scene(driven).layout
    loads = Inputs(driven).pack(layout)
    row, lane = acting_lanes(loads)
    forces = loads.tractions.force.reshape(-1, LANES)
    pushed = loads.wrench[row] == loads.tractions.first
    assert pushed.sum() == driven.body_count - len(driven.groups['low'])
    assert np.count_nonzero(forces) == pushed.sum()


# Of directions, and whether without friction: all at once, and one alone.
KINDS = (('follower', False), ('fixed', False), ('fixed', True))


@pytest.mark.parametrize('method, limit', [
    pytest.param('srkn4', 1e-6, marks=pytest.mark.long), ('dop8', 1e-7)])
@pytest.mark.parametrize('kinds', [
    KINDS, *(pytest.param((kind,), marks=pytest.mark.long) for kind in KINDS)], ids=[
        'all', 'follower', 'fixed', 'frictionless'])
def test_work_of_tractions_balances(kinds, method, limit):
    values = {
        'group': 'g', 'faces': 'toward 1 0 0', 'pressure': 2e4, 'shear': [3e4, -1e4],
        'variation': '1 0.5 -2', 'profile': 'half_sine', 'start': 0.001, 'duration': 0.005}
    scene = make_scene((2, 2, 2), {
        'groups.g': 'all', 'contact.mode': 'never', **{
            f'tractions.{direction}_{frictionless}.{name}': value
            for direction, frictionless in kinds
            for name, value in {**values, 'direction': direction,
                                'frictionless': frictionless}.items()}}, **RANDOM)
    simulation = ico.compile_scene(changed(scene, {'solver.method': method}))
    simulation.advance_to(0.008)
    energy = simulation.snapshot().energy
    assert abs(energy['work_in']) > 0.01 * energy['kinetic']
    assert abs(energy['balance_error']) < limit * energy['kinetic']
    assert simulation.balance.worst < limit


@pytest.mark.parametrize('spin', [0.0, 1e-9, 0.02, 0.9, 7.0])
@pytest.mark.parametrize('direction, frictionless', KINDS)
@pytest.mark.parametrize('profile', ['steady', 'half_sine'])
def test_work_over_free_flight_is_the_integral_of_power(spin, direction, frictionless, profile):
    """Of a body that turns by `spin` [rad] while it flies, beside a rule of 40 points."""
    h = 0.01
    scene = changed(scene_with({
        'faces': 'numbers 3 9 14', 'pressure': 700.0, 'shear': [900.0, -400.0],
        'variation': '0.5 -1 3', 'direction': direction, 'frictionless': frictionless,
        'profile': profile, **({} if profile == 'steady' else {'duration': 2.0 * h})}),
        {'weave.connected': False})
    packed = pack_scene(scene)
    orientation = rotation_quaternion(np.array([[0.7, -1.1, 0.4]]))
    v, omega = np.array([0.3, -0.2, 0.5]), spin / h * np.array([0.6, 0.0, -0.8])
    state = packed_state(packed, scene.position, orientation, v[None], omega[None])
    inputs = Inputs(scene)
    while not inputs.next_time > 0.0:
        inputs.apply_next()
    loads = inputs.pack(packed.layout)
    slot = int(packed.layout.slot[0])
    for row in range(len(loads.wrench)):
        work_row(loads, state, row, slot - slot % LANES, 0.0, h, NONE, ONES)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    steady = changed(scene, {'tractions.t.profile': 'steady'})
    expected, size = 0.0, 0.0
    for x, weight in zip(0.5 + 0.5 * nodes, 0.5 * weights):
        got = acting(steady, free_rotation(orientation, omega[None], x * h))
        power = float(v @ got.force[0] + omega @ got.torque[0])
        factor = 1.0 if profile == 'steady' else math.sin(0.5 * math.pi * x)
        expected += h * weight * factor * power
        size += h * weight * abs(factor * power)
    # A profile takes the Gauss rule of five points, of order 10 in the angle.
    limit = 1e-12 if profile == 'steady' else 1e-10 * (1.0 + spin)**10
    assert size > 1e-6
    assert loads.work.sum() == pytest.approx(expected, abs=limit * size)


@pytest.mark.parametrize('changes, name, words', [
    ({'faces': ''}, 'tractions.t.faces', 'empty'),
    ({'faces': 'numbers 21'}, 'tractions.t.faces', 'faces are numbered 1 to 20'),
    ({'faces': 'toward 0 0 0'}, 'tractions.t.faces', 'nonzero vector'),
    ({'faces': 'within 4 0 0 1'}, 'tractions.t.faces', 'pi'),
    ({'faces': 'top'}, 'tractions.t.faces', 'unknown'),
    ({'faces': 'numbers 1 and numbers 2'}, 'tractions.t.faces', 'no face'),
    ({'faces': 'all', 'variation': '1 2'}, 'tractions.t.variation', 'coefficients'),
    ({'faces': 'all', 'variation': 'x'}, 'tractions.t.variation', 'coefficients'),
    ({'faces': 'all', 'direction': 'up'}, 'tractions.t.direction', 'follower, fixed'),
    ({'faces': 'all', 'group': 'h'}, 'tractions.t.group', 'no group'),
    ({'faces': 'all', 'profile': 'ramp'}, 'tractions.t.duration', 'above 0 s'),
])
def test_bad_tractions_are_refused_by_name(changes, name, words):
    with pytest.raises(ico.ParameterError, match=name) as caught:
        scene_with(changes)
    assert words in str(caught.value)
