# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Shells whose density a scene gives by an expression."""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import volume_quadrature
from icofabric_sim.scene.summary import describe_scene
from icofabric_sim.statics.periodic import make_cell
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

PLAIN = make_scene((1, 1, 1)).shell
UNEVEN = '900 + 4e6*x**2 + 2e6*y**2'


def shell_integrals(density, size=1.0):
    """Mass, and integrals of x x, y y and z z over the mass, by Gauss points."""
    points, weights = volume_quadrature(
        size * PLAIN.half_edge, size * PLAIN.inner_half_edge, degree=8)
    points, weights = points.reshape(-1, 3), np.broadcast_to(weights, points.shape[:-1]).ravel()
    heavy = weights * density(*points.T)
    return heavy.sum(), heavy @ points**2


def moments_of(squares):
    """Principal moments from integrals of x x, y y and z z."""
    return squares.sum() - squares


def test_an_even_density_is_that_of_the_parameter():
    even = make_scene((2, 2, 2), {'shell.expression': '1200.0'})
    assert even.shell.mass == pytest.approx(PLAIN.mass, rel=1e-12, abs=0.0)
    assert even.shell.inertia == pytest.approx(PLAIN.inertia, rel=1e-12, abs=0.0)
    assert even.principal_inertia is None


def test_an_uneven_density_has_its_mass_and_moments():
    scene = make_scene((2, 2, 2), {'shell.expression': UNEVEN})
    mass, squares = shell_integrals(lambda x, y, z: 900.0 + 4e6 * x**2 + 2e6 * y**2)
    assert scene.shell.mass == pytest.approx(mass, rel=1e-6, abs=0.0)
    assert scene.principal_inertia == pytest.approx(
        np.tile(moments_of(squares), (scene.body_count, 1)), rel=1e-6, abs=0.0)
    assert np.ptp(scene.principal_inertia[0]) > 0.02 * scene.shell.inertia
    # A given mass scales them.
    other = make_scene((2, 2, 2), {'shell.expression': UNEVEN, 'shell.mass': 0.5 * mass})
    assert other.shell.mass == 0.5 * mass
    assert other.principal_inertia == pytest.approx(
        0.5 * scene.principal_inertia, rel=1e-5, abs=0.0)
    text = dict(describe_scene(other))['shell']
    assert f'{other.shell.mass:.6g} kg' in text and f'{other.principal_inertia[0, 2]:.6g}' in text


def test_groups_and_loose_bodies_have_their_own_density():
    scene = make_scene((2, 2, 1), {
        'groups.it': 'ids 1', 'masses.own.group': 'it', 'masses.own.expression': UNEVEN,
        'bodies.ball.position': [0.0, 0.0, 1.0], 'bodies.ball.edge_length': 0.04,
        'bodies.ball.expression': '500 + 1e6*z**2'})
    small, large = (
        shell_integrals(lambda x, y, z: 900.0 + 4e6 * x**2 + 2e6 * y**2),
        shell_integrals(lambda x, y, z: 500.0 + 1e6 * z**2, 2.0))
    assert scene.masses.mass == pytest.approx([PLAIN.mass, small[0], large[0]], rel=1e-6, abs=0.0)
    assert scene.principal_inertia == pytest.approx(np.array([
        [PLAIN.inertia] * 3, moments_of(small[1]), moments_of(large[1])]), rel=1e-6, abs=0.0)


def test_a_density_moves_as_its_moments_that_are_given():
    """A free body that tumbles: both scenes have the same constants, and the same motion."""
    spin = {'groups.it': 'all', 'initial.i.group': 'it', 'initial.i.angular_velocity': [
        20.0, 0.5, 30.0]}
    by_density = make_scene((1, 1, 1), {**spin, 'shell.expression': UNEVEN})
    by_moments = make_scene((1, 1, 1), {
        **spin, 'shell.mass': by_density.shell.mass,
        'shell.principal_inertia': by_density.principal_inertia[0].tolist()})
    ends = []
    for scene in (by_density, by_moments):
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.2)
        ends.append(simulation.snapshot())
    assert np.array_equal(ends[0].angular_velocity, ends[1].angular_velocity)
    assert np.abs(ends[0].angular_velocity[0] - [20.0, 0.5, 30.0]).max() > 0.1


TILTED = '900 + 4e6*(x + 0.5*y)**2 + 2e6*(y - 0.3*z)**2'


def tilted_tensor():
    """Mass, and inertia about the body axes (3, 3) of the density `TILTED`, by Gauss points."""
    points, weights = volume_quadrature(PLAIN.half_edge, PLAIN.inner_half_edge, degree=8)
    points, weights = points.reshape(-1, 3), np.broadcast_to(weights, points.shape[:-1]).ravel()
    x, y, z = points.T
    heavy = weights * (900.0 + 4e6 * (x + 0.5 * y)**2 + 2e6 * (y - 0.3 * z)**2)
    squares = np.einsum('m,mi,mj->ij', heavy, points, points)
    return heavy.sum(), np.trace(squares) * np.eye(3) - squares


def test_tilted_axes_tumble_by_the_whole_tensor():
    """A free body against SciPy: the angular momentum stays, and omega is I^-1 of it."""
    turn = Rotation.from_rotvec([0.3, -0.5, 0.2])
    scene = make_scene((1, 1, 1), {'shell.expression': TILTED, 'solver.tolerance': 1e-9})
    mass, tensor = tilted_tensor()
    assert scene.shell.mass == pytest.approx(mass, rel=1e-6, abs=0.0)
    axes = scene.principal_axes[0]
    assert axes @ tensor @ axes.T == pytest.approx(
        np.diag(scene.principal_inertia[0]), abs=1e-6 * tensor.max())
    assert np.linalg.det(axes) == pytest.approx(1.0) and np.abs(axes).max(axis=1).min() < 0.99
    simulation = ico.compile_scene(scene)
    start = np.array([20.0, 1.0, 30.0])
    simulation.set_state(orientation=turn.as_quat()[None], angular_velocity=start[None])
    whole = turn.as_matrix() @ tensor @ turn.as_matrix().T @ start
    first = simulation.snapshot()
    assert first.spin_momentum[0] == pytest.approx(whole, rel=1e-6, abs=0.0)
    assert first.energy['kinetic'] == pytest.approx(0.5 * start @ whole, rel=1e-6, abs=0.0)

    def slope(time, q):
        pose = Rotation.from_quat(q)
        spin = pose.apply(np.linalg.solve(tensor, pose.inv().apply(whole)))
        return 0.5 * np.array([
            *(spin * q[3] + np.cross(spin, q[:3])), -spin @ q[:3]])

    end = 0.3
    wanted = Rotation.from_quat(solve_ivp(
        slope, (0.0, end), turn.as_quat(), method='DOP853', rtol=1e-11, atol=1e-12).y[:, -1])
    simulation.advance_to(end)
    s = simulation.snapshot()
    assert (Rotation.from_quat(s.orientation[0]) * wanted.inv()).magnitude() < 1e-5
    assert s.spin_momentum[0] == pytest.approx(whole, rel=1e-5, abs=0.0)
    assert abs(s.energy['balance_error']) < 1e-8 * s.energy['kinetic']
    assert np.abs(s.angular_velocity[0] - start).max() > 0.1


def test_tilted_axes_swing_at_the_frequencies_of_the_whole_tensor():
    """A dipole along the field: p E (1 - n n^T) against the tensor."""
    scene = make_scene((1, 1, 1), {
        'shell.expression': TILTED, 'charge.dipole': [1e-6, 0.0, 0.0],
        'field.electric': [1e5, 0.0, 0.0]})
    _, tensor = tilted_tensor()
    squares = eigh(0.1 * np.diag([0.0, 1.0, 1.0]), tensor, eigvals_only=True)
    found = ico.solve_modes(scene).frequencies
    assert found[-2:] == pytest.approx(np.sqrt(squares[1:]), rel=1e-6, abs=0.0)
    plain = ico.solve_modes(make_scene((1, 1, 1), {
        'charge.dipole': [1e-6, 0.0, 0.0], 'field.electric': [1e5, 0.0, 0.0]})).frequencies
    assert np.abs(found[-2:] / plain[-2:] - 1.0).max() > 0.01


def test_waves_have_the_whole_tensor():
    cell = make_cell(make_scene((2, 2, 2), {'weave.kind': 'bias', 'shell.expression': TILTED}))
    _, tensor = tilted_tensor()
    pose = Rotation.from_quat(cell.scene.orientation[cell.body]).as_matrix()
    turning = cell.inverse_sqrt_mass[3:, 3:]
    assert turning @ turning @ (pose @ tensor @ pose.T) == pytest.approx(np.eye(3), abs=1e-5)
    assert not np.array_equal(pose, np.eye(3))


def test_a_spun_body_with_tilted_axes_needs_a_torque():
    """The drive of a body that turns about z bears omega x (I omega)."""
    rate = 30.0
    scene = make_scene((1, 1, 1), {
        'shell.expression': TILTED, 'groups.it': 'all', 'drives.spin.group': 'it',
        'drives.spin.motion': 'velocity', 'drives.spin.angular': [0.0, 0.0, rate]})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.02)
    _, tensor = tilted_tensor()
    pose = Rotation.from_quat(simulation.snapshot().orientation[0]).as_matrix()
    spin = np.array([0.0, 0.0, rate])
    torque = np.cross(spin, pose @ tensor @ pose.T @ spin)
    reactions = simulation.reactions()
    found = reactions.torque[list(reactions.names).index('drives.spin')]
    assert found == pytest.approx(torque, rel=1e-5, abs=1e-5 * np.abs(torque).max())


@pytest.mark.parametrize(('changes', 'words'), [
    ({'shell.expression': '1000 + 1e4*x'}, 'centre of mass at .* balance the density'),
    ({'shell.expression': '-5'}, r"shell\.expression '-5': .* not negative, got -5\.0 kg/m"),
    ({'shell.expression': '0*x'}, 'is 0 in the whole shell'),
    ({'shell.expression': '1/x'}, 'shell.expression'),
    ({'shell.expression': 't'}, "unknown name 't'"),
    ({'shell.expression': '1e3', 'shell.inertia': 1e-6}, 'shell.inertia both give'),
    ({'shell.expression': '1e3', 'shell.principal_inertia': [1e-6] * 3}, 'both give the inertia'),
    ({'shell.expression': '1e3', 'shell.layers': 'a.csv'}, 'shell.layers both give')])
def test_densities_that_are_refused(changes, words):
    with pytest.raises(ico.ParameterError, match=words):
        make_scene((1, 1, 1), changes)


def test_what_needs_isotropic_inertia_names_the_expression():
    with pytest.raises(ico.ParameterError, match=r'shell\.expression .*field\.magnetic'):
        make_scene((1, 1, 1), {
            'shell.expression': UNEVEN, 'charge.per_body': 1e-9,
            'field.magnetic': [0.0, 0.0, 1.0]})
