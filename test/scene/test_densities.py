# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Shells whose density a scene gives by an expression."""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import volume_quadrature
from icofabric_sim.scene.summary import describe_scene
import numpy as np
import pytest

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
    assert even.shell.mass == pytest.approx(PLAIN.mass, rel=1e-12)
    assert even.shell.inertia == pytest.approx(PLAIN.inertia, rel=1e-12)
    assert even.principal_inertia is None


def test_an_uneven_density_has_its_mass_and_moments():
    scene = make_scene((2, 2, 2), {'shell.expression': UNEVEN})
    mass, squares = shell_integrals(lambda x, y, z: 900.0 + 4e6 * x**2 + 2e6 * y**2)
    assert scene.shell.mass == pytest.approx(mass, rel=1e-6)
    assert scene.principal_inertia == pytest.approx(
        np.tile(moments_of(squares), (scene.body_count, 1)), rel=1e-6)
    assert np.ptp(scene.principal_inertia[0]) > 0.02 * scene.shell.inertia
    # A given mass scales them.
    other = make_scene((2, 2, 2), {'shell.expression': UNEVEN, 'shell.mass': 0.5 * mass})
    assert other.shell.mass == 0.5 * mass
    assert other.principal_inertia == pytest.approx(0.5 * scene.principal_inertia, rel=1e-5)
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
    assert scene.masses.mass == pytest.approx([PLAIN.mass, small[0], large[0]], rel=1e-6)
    assert scene.principal_inertia == pytest.approx(np.array([
        [PLAIN.inertia] * 3, moments_of(small[1]), moments_of(large[1])]), rel=1e-6)


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


@pytest.mark.parametrize(('changes', 'words'), [
    ({'shell.expression': '1000 + 1e4*x'}, 'centre of mass at .* balance the density'),
    ({'shell.expression': '1000 + 1e6*x*y'}, 'integrals of y z, x z and x y .* principal axes'),
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
