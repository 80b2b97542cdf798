# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors that attach elsewhere than at edge midpoints: scaled, or at any point of a body."""

from analytical import quaternion_product, rotation_quaternion
from fabrics import changed, FORMS, make_scene, packed_state, RANDOM, snapshot_of, wrenches
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import vertices
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.frequency_bound import frequency_bound
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.model.stability import hessian_product, largest_frequency
import numpy as np
import pytest
from references import axes_of, resultants

A = 0.01
# A vertex, the centre of a face, points beside an edge; the others stay at their edges.
POINTS = {
    'connector.attachment.up': (A * vertices(1.0)[0]).tolist(),
    'connector.attachment.south': (A * vertices(1.0)[[2, 4, 0]].mean(axis=0)).tolist(),
    'connector.attachment.west': [0.002, 0.017, -0.001],
    'connector.attachment_scale': 1.1}
MOMENTS = {'connector.bending_stiffness': 0.05, 'connector.twisting_stiffness': 0.02}
CASES = {
    'scaled': {'connector.attachment_scale': 0.8}, 'points': POINTS,
    'turned': {**POINTS, 'weave.kind': 'bias', 'weave.variant': 3, 'weave.azimuth': 0.4},
    'bending': {**POINTS, **MOMENTS}}


def disturbed(scene, amplitude, seed=1):
    """Positions and orientations away from the woven ones."""
    generator = np.random.default_rng(seed)
    shape = (scene.body_count, 3)
    shift = 0.3 * amplitude * scene.geometry.cube_width * generator.standard_normal(shape)
    turn = rotation_quaternion(amplitude * generator.standard_normal(shape))
    return scene.position + shift, quaternion_product(turn, scene.orientation)


@pytest.mark.parametrize('name', CASES)
def test_the_weave_is_at_rest_with_its_own_lengths(name):
    scene = make_scene((3, 3, 3), CASES[name])
    work = wrenches(scene, scene.position, scene.orientation)
    unit = scene.parameters['connector.stiffness'] * scene.geometry.cube_width
    assert np.abs(work.force).max() < 1e-14 * unit
    assert np.abs(work.torque).max() < 1e-14 * unit * A
    snapshot = snapshot_of(scene, scene.position, scene.orientation)
    np.testing.assert_allclose(
        snapshot.connector_length, np.broadcast_to(scene.connectors.woven_length, len(
            scene.connectors)), rtol=1e-13)
    # Also as they are drawn, and not those of edge midpoints.
    ends = [
        scene.position[scene.connectors.bodies[:, end]] + np.einsum(
            'cj,cji->ci', scene.connectors.points_body[:, end],
            axes_of(scene.orientation)[scene.connectors.bodies[:, end]]) for end in range(2)]
    np.testing.assert_allclose(
        snapshot.connector_ends, np.stack(ends, axis=1), rtol=0, atol=1e-15)
    plain = scene.geometry.connector_length
    assert np.abs(scene.connectors.woven_length / plain - 1.0).max() > 0.01


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('name', ['scaled', 'points', 'turned'])
def test_wrenches_are_those_of_a_loop_over_connectors(name, form):
    scene = make_scene((3, 3, 3), CASES[name])
    position, orientation = disturbed(scene, 0.8)
    force, moment = resultants(scene, position, axes_of(orientation))
    work = wrenches(scene, position, orientation, cosines=form != 'quaternion')
    size = np.abs(force).max()
    assert np.abs(work.force - force).max() < 1e-13 * size
    assert np.abs(work.torque - moment).max() < 1e-13 * size * A
    assert np.abs(work.force.sum(axis=0)).max() < 1e-13 * size


@pytest.mark.parametrize('name', CASES)
def test_hessian_is_the_derivative_of_the_forces_and_below_its_bound(name):
    scene = make_scene((3, 3, 3), CASES[name])
    packed = pack_scene(scene)
    position, orientation = disturbed(scene, 0.5)
    generator = np.random.default_rng(2)
    shift = A * generator.standard_normal((scene.body_count, 3))
    turn = generator.standard_normal((scene.body_count, 3))
    other = [A * generator.standard_normal(shift.shape), generator.standard_normal(shift.shape)]

    def force_along(h):
        work = wrenches(scene, position + h * shift, quaternion_product(
            rotation_quaternion(h * turn), orientation))
        return -(work.force * shift).sum() - (work.torque * turn).sum()

    state = packed_state(packed, position, orientation)
    product = np.array(hessian_product(packed, state, shift, turn))
    errors = [
        (force_along(h) - force_along(-h)) / (2.0 * h) - (product * [shift, turn]).sum()
        for h in (2e-3, 1e-3)]
    assert abs(4.0 * errors[1] - errors[0]) < 1e-8 * np.abs(product * [shift, turn]).sum()
    back = np.array(hessian_product(packed, state, *other))
    assert (product * other).sum() == pytest.approx((back * [shift, turn]).sum(), rel=1e-11)
    work = packed.layout.room(packed.model.links)
    place_all(packed.model, state, work, 0, len(packed.model.blocks.slot))
    bound = np.sqrt(frequency_bound(packed.model, state, work))
    assert bound >= largest_frequency(packed, state).rate > 0.0


@pytest.mark.parametrize('method', [
    pytest.param('srkn6', marks=pytest.mark.long), 'dop8'])
def test_energy_and_momenta_stay(method):
    scene = make_scene((4, 3, 3), {
        **POINTS, 'solver.method': method, 'contact.mode': 'never'}, **RANDOM)
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.1)
    s, first = simulation.snapshot(), scene.initial
    assert abs(s.energy['balance_error']) < 1e-5 * s.energy['kinetic']
    assert s.energy['connectors'] > 0.05 * s.energy['kinetic']
    linear = scene.shell.mass * np.array([first.linear_velocity, s.linear_velocity])
    turning = scene.shell.inertia * np.array([first.angular_velocity, s.angular_velocity])
    turning += np.cross(np.array([first.position, s.position]), linear)
    for one, other in (linear, turning):
        assert np.abs((other - one).sum(axis=0)).max() < 1e-9 * np.abs(one).sum()


def test_scaled_points_are_the_edges_of_another_shell():
    # Midpoints of a shell 1.25 times as large, at the same pitch: the same forces and lengths.
    large = make_scene((3, 3, 3), {'shell.edge_length': 0.025, 'weave.connector_angle': 0.2})
    small = make_scene((3, 3, 3), {'connector.attachment_scale': 1.25})
    pitch = large.geometry.pitch
    small = changed(small, {'weave.connector_length': float(np.hypot(
        pitch, pitch - small.geometry.cube_width))})
    assert small.geometry.pitch == pytest.approx(pitch, rel=1e-12)
    assert small.connectors.natural_length == pytest.approx(
        large.connectors.natural_length, rel=1e-12)
    position, orientation = disturbed(large, 0.6)
    one, other = (wrenches(scene, position, orientation) for scene in (large, small))
    np.testing.assert_allclose(one.force, other.force, rtol=0, atol=1e-9)
    np.testing.assert_allclose(one.torque, other.torque, rtol=0, atol=1e-11)
    assert np.abs(one.force).max() > 1.0


@pytest.mark.parametrize('changes, words', [
    ({'connector.attachment_scale': 0.0}, ['connector.attachment_scale', 'above 0']),
    ({'connector.attachment.up': [0.017, 0.0, 0.017], 'connector.attachment.down': [
        -0.01536067977499790, 0.0, -0.01536067977499790]},
     ['connector.attachment.', 'coincide', 'no length']),
    ({'connector.attachment_scale': 1e200}, ['connector.attachment_scale', '1e+200', 'pitches']),
    ({'connector.attachment.west': [0.0, -1e308, 0.0]}, ['connector.attachment.west', 'pitches']),
])
def test_points_that_leave_no_length_or_lie_beyond_all_bodies_are_refused(changes, words):
    with pytest.raises(ParameterError) as caught:
        make_scene((3, 3, 3), changes)
    for word in words:
        assert word in str(caught.value)
