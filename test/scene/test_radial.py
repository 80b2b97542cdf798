# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The radial weave of docs/radial.md: an orthogonal weave bent round a cylinder."""

from analytical import quaternion_product, rotation_quaternion
from fabrics import changed, make_scene, RANDOM, snapshot_of, wrenches
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import circumscribed_radius
from icofabric_sim.parameters.table import with_kind
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.model.snapshot import Snapshot
import numpy as np
import pytest
from references import axes_of
from scipy.spatial import cKDTree

MOMENTS = {'connector.bending_stiffness': 0.05, 'connector.twisting_stiffness': 0.02}


def radial(size=(7, 4, 4), changes=None):
    return make_scene(size, {'weave.kind': 'radial', **(changes or {})})


@pytest.mark.parametrize('variant', range(4))
def test_connectors_are_those_of_the_orthogonal_weave(variant):
    scene = radial(changes={'weave.variant': variant})
    plain = make_scene((7, 4, 4), {'weave.variant': variant})
    assert scene.weave.kind == 'radial' and scene.body_count == plain.body_count
    assert np.array_equal(scene.connectors.bodies, plain.connectors.bodies)
    assert np.array_equal(scene.connectors.edges, plain.connectors.edges)
    assert np.array_equal(scene.weave.grid, plain.weave.grid)


def test_levels_are_cylinders_and_bodies_turn_with_their_rows():
    scene = radial(changes={'weave.radius': 0.3, 'weave.variant': 1})
    pitch = scene.geometry.pitch
    axis = np.array([3.0 * pitch, 0.0, -0.3])
    out = (scene.position - axis)[:, [0, 2]]
    distance = np.hypot(*out.T)
    np.testing.assert_allclose(distance, 0.3 + pitch * scene.weave.grid[:, 2], rtol=1e-14)
    angle = np.arctan2(*out.T)
    np.testing.assert_allclose(
        angle, (scene.weave.grid[:, 0] - 3) * pitch / 0.3, rtol=0, atol=1e-14)
    # The body's z looks outward, its y along the axis of the cylinder.
    axes = axes_of(scene.orientation)
    np.testing.assert_allclose(
        axes[:, 2, [0, 2]], out / distance[:, None], rtol=0, atol=1e-15)
    np.testing.assert_allclose(axes[:, 1], np.tile([0.0, 1.0, 0.0], (len(axes), 1)), atol=1e-15)
    # Along the lowest level rows are a pitch apart, measured round the arc.
    assert np.ptp(angle[scene.weave.grid[:, 2] == 0]) * 0.3 == pytest.approx(
        pitch * np.ptp(scene.weave.grid[scene.weave.grid[:, 2] == 0, 0]), rel=1e-13)


def test_a_large_radius_is_the_orthogonal_weave():
    plain, scene = make_scene((5, 4, 3)), radial((5, 4, 3), {'weave.radius': 1e9})
    np.testing.assert_allclose(scene.position, plain.position, rtol=0, atol=1e-10)
    np.testing.assert_allclose(scene.orientation, plain.orientation, rtol=0, atol=1e-10)
    np.testing.assert_allclose(
        scene.connectors.natural_length, plain.connectors.natural_length, rtol=1e-8)


@pytest.mark.parametrize('variant', [0, 3])
def test_default_spans_a_quarter_circle_and_no_shells_meet(variant):
    scene = radial((9, 4, 5), {'weave.variant': variant})
    z = axes_of(scene.orientation)[:, 2]
    angle = np.arctan2(z[:, 0], z[:, 2])
    assert np.ptp(angle) == pytest.approx(0.5 * np.pi, rel=1e-12)
    tightest = radial((6, 4, 5), {'weave.variant': variant, 'weave.radius': float(
        scene.geometry.pitch)})
    for one in (scene, tightest):
        nearest = cKDTree(one.position).query(one.position, 2)[0][:, 1].min()
        assert nearest > 2.0 * circumscribed_radius(one.geometry.half_edge)


@pytest.mark.parametrize('changes', [{}, MOMENTS, {
    **MOMENTS, 'weave.variant': 2, 'connector.attachment_scale': 1.05,
    'connector.attachment.up': [0.003, 0.0, 0.017]}])
def test_the_weave_is_an_equilibrium_without_pre_stress(changes):
    scene = radial(changes=changes)
    work = wrenches(scene, scene.position, scene.orientation)
    unit = 500.0 * scene.geometry.cube_width
    assert np.abs(work.force).max() < 1e-13 * unit
    assert np.abs(work.torque).max() < 1e-13 * unit * scene.geometry.half_edge
    start = snapshot_of(scene, scene.position, scene.orientation)
    assert start.energy['connectors'] < 1e-25
    np.testing.assert_allclose(
        start.connector_length, scene.connectors.natural_length, rtol=1e-13)
    assert np.ptp(start.connector_length) > 0.1 * scene.geometry.connector_length


def test_moments_come_from_their_energy_and_do_not_see_rigid_motions():
    scene = radial((5, 3, 3), MOMENTS)
    packed, rest = pack_scene(scene), np.zeros_like(scene.position)
    generator = np.random.default_rng(1)
    shape = (scene.body_count, 3)
    position = scene.position + 0.002 * generator.standard_normal(shape)
    orientation = quaternion_product(
        rotation_quaternion(0.4 * generator.standard_normal(shape)), scene.orientation)
    shift, turn = 0.01 * generator.standard_normal(shape), generator.standard_normal(shape)

    def along(h):
        turned = quaternion_product(rotation_quaternion(h * turn), orientation)
        return Snapshot(
            0.0, position + h * shift, turned, rest, rest, scene.connector_count, packed,
            {'work_in': 0.0, 'start': 0.0, 'spent': 0.0, 'potential': 0.0}).energy['connectors']

    work = wrenches(scene, position, orientation)
    for cosines in (False, True):
        other = wrenches(scene, position, orientation, cosines=cosines)
        np.testing.assert_allclose(other.torque, work.torque, rtol=0, atol=1e-13)
    expected = -(work.force * shift).sum() - (work.torque * turn).sum()
    errors = [(along(h) - along(-h)) / (2.0 * h) - expected for h in (2e-3, 1e-3)]
    assert abs(4.0 * errors[1] - errors[0]) < 1e-6 * abs(expected)
    common = rotation_quaternion(np.array([[0.7, -2.0, 1.1]]))
    axes = axes_of(common)[0]
    turned = wrenches(scene, position @ axes, quaternion_product(common, orientation))
    np.testing.assert_allclose(turned.force, work.force @ axes, rtol=0, atol=1e-11)
    np.testing.assert_allclose(turned.torque, work.torque @ axes, rtol=0, atol=1e-12)
    rigid = wrenches(scene, scene.position @ axes, quaternion_product(common, scene.orientation))
    assert np.abs(rigid.torque).max() < 1e-12 < 1e-6 < np.abs(work.torque).max()


def test_it_moves_and_keeps_its_energy():
    scene = radial((5, 4, 3), {**MOMENTS, 'solver.method': 'srkn6', 'contact.mode': 'never'})
    scene = ico.Scene.from_parameters(scene.parameters.with_changes(
        {f'initial_random.{name}': value for name, value in RANDOM['initial_random'].items()}))
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.05)
    s = simulation.snapshot()
    assert abs(s.energy['balance_error']) < 1e-6 * s.energy['kinetic']
    assert s.energy['connectors'] > 0.1 * s.energy['kinetic']


def test_a_radius_with_no_room_is_refused():
    with pytest.raises(ParameterError, match=r'weave\.radius 0\.05 m is too small for 31 rows'):
        radial((31, 2, 2), {'weave.radius': 0.05})
    with pytest.raises(ParameterError, match=r'weave\.radius.*shells meet'):
        radial((3, 2, 2), {'weave.radius': 0.01})
    assert changed(radial((3, 2, 2)), {'weave.radius': 0.05}).weave.kind == 'radial'


@pytest.mark.parametrize('name, value, kind', [
    ('weave.azimuth', 0.3, 'bias'), ('weave.boundary', 'fabric', 'bias'),
    ('weave.radius', 0.3, 'radial')])
def test_what_is_of_another_kind_of_weave_is_refused(name, value, kind):
    scene = make_scene((3, 2, 2), {'weave.kind': kind, name: value})
    for other in {'orthogonal', 'bias', 'radial'} - {kind}:
        with pytest.raises(ParameterError, match=(
                f'{name} {value!r} is for weave.kind {kind} only, and weave.kind is {other}'
                )) as caught:
            changed(scene, {'weave.kind': other})
        assert caught.value.name == name
        # As the page and its node change the kind.
        assert changed(scene, with_kind('weave.kind', other)).weave.kind == other
