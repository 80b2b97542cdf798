# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Charges of a density in the shell: total, dipole and second moment."""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import outer_triangles, volume_quadrature
from icofabric_sim.simulation.model.packing import pack_scene
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial import ConvexHull, Delaunay

SHELL = make_scene((1, 1, 1)).shell
# Of a density of 1: the integrals of 1 and of x x.
VOLUME, SQUARE = SHELL.volume, 0.5 * SHELL.inertia / SHELL.density


def charges(changes, prefix='charge'):
    """The charges of two bodies."""
    return make_scene((2, 2, 1), {
        f'{prefix}.{name}': value for name, value in changes.items()}).electric


def test_an_even_density_is_a_charge_distributed_like_the_mass():
    found = charges({'expression': '2e-3'})
    assert found.charge == pytest.approx([2e-3 * VOLUME], rel=1e-12, abs=0.0)
    assert np.abs(found.dipole).max() < 1e-12 * found.charge[0] * SHELL.half_edge
    assert found.second == pytest.approx([2e-3 * SQUARE], rel=1e-12, abs=0.0)
    field = {'field.magnetic': [0.0, 1.0, 2.0]}
    even, plain = (
        pack_scene(make_scene((2, 2, 1), {**field, **charge})).model.magnet for charge in (
            {'charge.expression': '2e-3'}, {'charge.per_body': 2e-3 * VOLUME}))
    assert even.second == pytest.approx(plain.second, rel=1e-12, abs=0.0) and even.second.any()


def test_a_linear_density_has_the_dipole_of_its_slope():
    found = charges({'expression': '0.2*x - 0.1*z'})
    assert found.dipole == pytest.approx(
        SQUARE * np.array([[0.2, 0.0, -0.1]]), rel=1e-6, abs=1e-18)
    assert abs(found.charge[0]) < 1e-6 * VOLUME * 0.2 * SHELL.half_edge


def test_a_smooth_density_by_gauss_points():
    points, weights = volume_quadrature(SHELL.half_edge, SHELL.inner_half_edge, degree=24)
    points, weights = points.reshape(-1, 3), np.broadcast_to(
        weights, points.shape[:-1]).ravel()
    x, y, z = points.T
    density = 1e-3 * np.exp(x / 0.01) * np.cos(300.0 * y) + z
    found = charges({'expression': '1e-3*exp(x/0.01)*cos(300*y) + z'})
    size = float((weights * np.abs(density)).sum())
    assert found.charge[0] == pytest.approx(float((weights * density).sum()), abs=1e-6 * size)
    assert found.dipole[0] == pytest.approx(
        (weights * density) @ points, abs=1e-6 * size * SHELL.half_edge)


def test_halves_of_opposite_charge():
    # The first moment of half an icosahedron, from tetrahedra.
    triangles = outer_triangles(1.0)
    corners = np.unique(triangles.reshape(-1, 3).round(12), axis=0)
    cut = []
    for one in triangles:
        for a, b in ((0, 1), (1, 2), (2, 0)):
            if one[a, 0] * one[b, 0] < 0.0:
                share = one[a, 0] / (one[a, 0] - one[b, 0])
                cut.append(one[a] + share * (one[b] - one[a]))
    half = np.concatenate([corners[corners[:, 0] >= 0.0], cut])
    half = half[ConvexHull(half).vertices]
    parts = half[Delaunay(half).simplices]
    volumes = np.abs(np.linalg.det(parts[:, 1:] - parts[:, :1])) / 6.0
    first = float(volumes @ parts.mean(axis=1)[:, 0])
    wanted = 2.0 * 3e-3 * first * (SHELL.half_edge**4 - SHELL.inner_half_edge**4)
    found = charges({'expression': 'where(x > 0, 3e-3, -3e-3)'})
    assert found.dipole[0] == pytest.approx([wanted, 0.0, 0.0], abs=1e-6 * wanted)
    assert abs(found.charge[0]) < 1e-9 * 3e-3 * VOLUME


def test_layers_of_charge(tmp_path):
    outside = 1.511522628 * SHELL.half_edge
    path = tmp_path / 'charge.csv'
    path.write_text(f'distance, density\n{outside - SHELL.thickness}, 2e-3\n{outside}, 2e-3\n')
    found = charges({'layers': str(path)})
    assert found.charge == pytest.approx([2e-3 * VOLUME], rel=1e-8, abs=0.0)
    assert found.second == pytest.approx([2e-3 * SQUARE], rel=1e-8, abs=0.0)
    assert not found.dipole.any()
    # A density that changes its sign, over icosahedra of the distance d.
    ends, densities = [0.0, outside / 2.0, outside], [-1e-3, -1e-3, 1e-3]
    path.write_text(''.join(f'{d}, {value}\n' for d, value in zip(ends, densities)))
    found = charges({'layers': str(path)})
    solid = tmp_path / 'solid.csv'
    solid.write_text(f'0, 1\n{outside}, 1\n')
    full = make_scene((1, 1, 1), {'shell.layers': str(solid)})
    for value, whole, power in (
            (found.charge[0], full.shell.mass, 3), (found.second[0], 0.5 * full.shell.inertia, 5)):
        wanted = whole * power / outside**power * quad(
            lambda d, power=power: np.interp(d, ends, densities) * d**(power - 1), 0.0, outside,
            points=[outside / 2.0])[0]
        assert value == pytest.approx(wanted, rel=1e-8, abs=0.0)
    path.write_text('0, 1e-3\n0.5, 1e-3\n')
    with pytest.raises(ico.ParameterError, match=r'charge\.layers: .*beyond the faces'):
        charges({'layers': str(path)})


def test_a_group_has_its_own_density():
    found = make_scene((2, 2, 1), {
        'charge.per_body': 1e-9, 'groups.one': 'ids 1', 'charges.own.group': 'one',
        'charges.own.expression': '2e-3 + 0.1*y'}).electric
    assert found.charge == pytest.approx([1e-9, 2e-3 * VOLUME], rel=1e-6, abs=0.0)
    assert found.dipole[1] == pytest.approx([0.0, 0.1 * SQUARE, 0.0], rel=1e-6, abs=1e-18)
    assert np.isnan(found.second[0]) and found.second[1] == pytest.approx(
        2e-3 * SQUARE, rel=1e-6, abs=0.0)


def test_the_dipole_of_a_density_acts_like_one_that_is_given():
    moment = make_scene((1, 1, 1), {'charge.expression': '0.3*x'}).electric.dipole[0]
    one, other = (
        pack_scene(make_scene((1, 1, 1), {
            **charge, 'field.electric': [0.0, 1e6, 0.0]})).model.dipole
        for charge in ({'charge.expression': '0.3*x'}, {'charge.dipole': moment.tolist()}))
    assert np.array_equal(one.moment, other.moment) and one.largest == other.largest > 0.0


@pytest.mark.parametrize(('changes', 'words'), [
    ({'expression': '1e-3', 'per_body': 1e-9}, 'charge.expression and charge.per_body both'),
    ({'expression': '1e-3', 'dipole': [0.0, 1e-9, 0.0]}, 'and charge.dipole both'),
    ({'expression': '1e-3', 'layers': 'a.csv'}, 'charge.expression and charge.layers both'),
    ({'expression': '1e-3, 2'}, 'must have 1 components'),
    ({'expression': 't'}, "unknown name 't'"),
    ({'expression': 'log(x)'}, r"charge.expression 'log\(x\)' is not finite at x, y, z ="),
    ({'expression': '1e-3/(x - 0.005)**2'}, 'does not converge'),
    ({'expression': 'sin(1e5*x)*sin(2e5*y)'}, 'does not converge')])
def test_densities_that_are_refused(changes, words):
    with pytest.raises(ico.ParameterError, match=words):
        charges(changes)


def test_uneven_second_moments_are_refused_in_a_magnetic_field():
    with pytest.raises(ico.ParameterError, match=r'charge\.expression .*field\.magnetic'):
        make_scene((1, 1, 1), {
            'charge.expression': '1 + x**2/1e-4', 'field.magnetic': [0.0, 0.0, 1.0]})
