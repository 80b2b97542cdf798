# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Elastic constants of the periodic point-spring fabric in closed form (docs/material.md)."""

import math
from types import SimpleNamespace

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.scene.weave_geometry import MINIMUM_ANGLE, MINIMUM_LENGTH_RATIO
from icofabric_sim.statics.stress_strain import _middle_strain, CURVE_COLUMNS
import numpy as np
import pytest

K = 500.0
# The smallest angle (eq 54), level connectors, and up to connectors 185 times as long as w.
ANGLES = (MINIMUM_ANGLE, 0.0, *np.linspace(MINIMUM_ANGLE, 0.78, 24)[1:])
X, Y, Z = np.eye(3)


def woven(angle: float, **sections) -> ico.Scene:
    return make_scene(weave={
        'size': [3, 3, 3], 'connector_angle': float(angle), **sections.pop('weave', {})},
        connector={'stiffness': K}, **sections)


@pytest.mark.parametrize('angle', ANGLES)
def test_closed_form_from_the_least_angle_on(angle):
    scene = woven(angle)
    found = ico.homogenise(scene)
    W, w, L = (scene.geometry.pitch, scene.geometry.cube_width, scene.geometry.connector_length)
    S = math.sin(2.0 * angle)
    expected = np.zeros((6, 6))
    expected[:3, :3] = 0.5 * S * K / W
    expected[range(3), range(3)] = K / W
    # Near pi/4 rounding grows with L / w.
    rounding = 1e-14 * (L / w)
    assert np.abs(found.stiffness - expected).max() < rounding * K / W
    assert len(found.zero_energy_strains) == 3
    assert found.bulk_modulus == pytest.approx(K / (3.0 * W) * (1.0 + S), rel=1e-12)
    for along, across in ((X, Y), (Y, Z), (Z, X), (X, Z)):
        ratio = float(found.poisson_ratio(along, across))
        assert ratio == pytest.approx(S / (2.0 + S), abs=1e-12)
        assert ratio == pytest.approx((L**2 - w**2) / (3.0 * L**2 - w**2), abs=1e-12)
        assert found.young_modulus(along) == pytest.approx(
            K / W * (2.0 - S) * (1.0 + S) / (2.0 + S), rel=1e-12)
        assert abs(ratio) < 1e-14 or np.sign(ratio) == np.sign(angle)
        if ratio < 0.33:
            assert w * math.sqrt((1.0 - ratio) / (1.0 - 3.0 * ratio)) == pytest.approx(
                L, rel=1e-9)
    # Shear is in the way of any other pull.
    assert found.young_modulus(np.array([1.0, 1.0, 0.0])) == 0.0
    assert np.isnan(found.poisson_ratio(np.array([1.0, 1.0, 1.0]), np.array([1.0, -1.0, 0.0])))


@pytest.mark.parametrize('angle', [MINIMUM_ANGLE, -0.3648, -0.2, 0.0, 0.3, 0.6])
def test_moduli_by_direction_have_closed_forms_and_say_what_is_undefined(angle):
    """docs/material.md: cubic constants with C44 = 0, along an axis and along two diagonals."""
    scene = woven(angle)
    found, W, S = ico.homogenise(scene), scene.geometry.pitch, math.sin(2.0 * angle)
    axis = found.directional_moduli(X)
    assert axis.undefined == ''
    assert axis.poisson_ratio == pytest.approx([S / (2.0 + S)] * 2, abs=1e-12)
    assert axis.young_modulus == pytest.approx(
        K / W * (2.0 - S) * (1.0 + S) / (2.0 + S), rel=1e-12)
    assert axis.shear_modulus == (0.0, 0.0)
    # (C11 - C12) / 2: the only shear that costs energy, of planes across one face diagonal
    # along the other.
    shear = K / W * (2.0 - S) / 4.0
    assert found.shear_modulus(X + Y, X - Y) == pytest.approx(shear, rel=1e-12)
    assert found.shear_modulus([X, Y, X + Y], [Y, Z, Z]).tolist() == [0.0, 0.0, 0.0]
    face = found.directional_moduli(X + Y)
    assert face.shear_modulus[0] == 0.0
    assert face.shear_modulus[1] == pytest.approx(shear, rel=1e-12)
    assert np.abs(face.shear_along @ np.array([X - Y, Z]).T / [math.sqrt(2.0), 1.0]) == (
        pytest.approx(np.eye(2)[::-1], abs=1e-9))
    assert face.young_modulus == 0.0 and np.isnan(face.poisson_ratio).all()
    assert face.undefined == 'the load does work on the strain xy, which costs no energy'
    cube = found.directional_moduli(X - Y + Z)
    assert np.isnan(cube.poisson_ratio).all() and cube.shear_modulus == (0.0, 0.0)
    assert all(label in cube.undefined for label in ('yz', 'xz', 'xy'))
    with pytest.raises(ValueError, match='along must be perpendicular to normal'):
        found.shear_modulus(X, X + 0.1 * Y)


@pytest.mark.parametrize('angle', [MINIMUM_ANGLE, -0.2, 0.3])
@pytest.mark.parametrize('weave', [{}, {'kind': 'bias', 'azimuth': 0.4}])
def test_extremes_by_direction_are_those_of_all_directions_across(angle, weave):
    """Against stresses put on the stiffness one by one, where nothing is singular."""
    scene = make_scene(
        weave={'size': [3, 3, 3], 'connector_angle': float(angle), **weave},
        connector={'stiffness': K, 'bending_stiffness': 0.02})
    found = ico.homogenise(scene)
    assert not len(found.zero_energy_strains)
    for direction in ([1.0, 2.0, 3.0], [1.0, 0.0, 0.0], [-1.0, 1.0, 0.2]):
        one = found.directional_moduli(np.array(direction))
        n = one.direction
        assert n @ direction == pytest.approx(np.linalg.norm(direction))
        first = np.cross(n, [0.3, -0.5, 0.8])
        first /= np.linalg.norm(first)
        ways = np.outer(np.cos(np.linspace(0.0, np.pi, 721)), first) + np.outer(
            np.sin(np.linspace(0.0, np.pi, 721)), np.cross(n, first))
        xx, yy, zz, yz, xz, xy = np.linalg.solve(found.stiffness, [
            *(n * n), n[1] * n[2], n[0] * n[2], n[0] * n[1]])
        strain = np.array([[xx, xy / 2, xz / 2], [xy / 2, yy, yz / 2], [xz / 2, yz / 2, zz]])
        along = n @ strain @ n
        ratios = -np.einsum('ki,ij,kj->k', ways, strain, ways) / along
        assert one.young_modulus == pytest.approx(1.0 / along, rel=1e-10)
        assert one.poisson_ratio == pytest.approx([ratios.min(), ratios.max()], abs=1e-5)
        assert ratios.min() >= one.poisson_ratio[0] - 1e-12
        assert [float(found.poisson_ratio(n, m)) for m in one.poisson_across] == pytest.approx(
            one.poisson_ratio, abs=1e-12)
        moduli = []
        for m in ways:
            pair = np.outer(n, m) + np.outer(m, n)
            stress = pair[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
            moduli.append(1.0 / (stress @ np.linalg.solve(found.stiffness, stress)))
        assert one.shear_modulus == pytest.approx([min(moduli), max(moduli)], rel=1e-4)
        assert found.shear_modulus(n, ways) == pytest.approx(moduli, rel=1e-9)
        assert found.shear_modulus([n, n], one.shear_along) == pytest.approx(
            one.shear_modulus, rel=1e-9)


def test_the_ratio_is_minus_a_half_at_the_least_angle_and_nought_at_level_connectors():
    least, level = (ico.homogenise(woven(angle)) for angle in (MINIMUM_ANGLE, 0.0))
    assert least.poisson_ratio(X, Y) == pytest.approx(-0.5, abs=1e-13)
    assert level.poisson_ratio(X, Y) == pytest.approx(0.0, abs=1e-14)
    nearly = woven(0.0, weave={'connector_angle': 0.0, 'connector_length': 1e3})
    assert ico.homogenise(nearly).poisson_ratio(X, Y) == pytest.approx(1.0 / 3.0, abs=1e-7)
    # The shortest length that the document allows is that angle.
    length = MINIMUM_LENGTH_RATIO * nearly.geometry.cube_width
    shortest = woven(0.0, weave={'connector_angle': 0.0, 'connector_length': length})
    assert ico.homogenise(shortest).poisson_ratio(X, Y) == pytest.approx(-0.5, abs=1e-12)


@pytest.mark.parametrize('angle', [MINIMUM_ANGLE, -0.2, 0.3])
def test_the_energy_of_the_derivation_is_that_of_a_cell(angle):
    """Extensions of six connectors, as docs/material.md derives them, for any strain and turn."""
    scene = woven(angle)
    W, w = scene.geometry.pitch, scene.geometry.cube_width
    c, s = math.cos(angle), math.sin(angle)
    exx, eyy, ezz, eyz, exz, exy, px, py, pz = np.random.RandomState(3).normal(size=9)
    squares = 0.0
    for sign in (1.0, -1.0):
        for first, second, shear, turn in (
                (exx, ezz, exz, py), (eyy, exx, exy, pz), (ezz, eyy, eyz, px)):
            extension = W * (c * first + s * second) + sign * (
                W * (c + s) * shear - w * c * turn)
            squares += extension**2
    found = ico.homogenise(scene)
    # The engine's own form: quadratic in strains (shears as angles) and a turn, not relaxed.
    motion = np.array([exx, eyy, ezz, 2.0 * eyz, 2.0 * exz, 2.0 * exy, px, py, pz])
    energy = found.energy
    assert 0.5 * float(motion @ energy.gradient(motion)) == pytest.approx(
        0.5 * K * squares, rel=1e-9)


def test_a_turned_fabric_has_the_same_bulk_modulus_and_none_where_it_yields():
    plain, turned = (ico.homogenise(woven(-0.2, weave=weave)) for weave in (
        {}, {'kind': 'bias', 'azimuth': 0.4}))
    assert turned.bulk_modulus == pytest.approx(plain.bulk_modulus, rel=1e-9)
    assert turned.bulk_modulus == pytest.approx(float(plain.stiffness[:3, :3].sum()) / 9.0)
    slack = make_scene(weave={'size': [3, 3, 3]}, connector={
        'stiffness_extension': K, 'stiffness_compression': 0.0})
    assert ico.homogenise(slack).bulk_modulus == 0.0
    assert ico.homogenise(slack, branch='pull').bulk_modulus > 0.0


@pytest.mark.parametrize('weave', [{}, {'kind': 'bias', 'azimuth': 0.3}])
def test_strains_of_the_middle_are_those_of_a_uniform_displacement(weave):
    scene = make_scene(weave={'size': [7, 4, 3], 'connector_angle': -0.2, **weave})
    strains = np.array([0.02, -0.03, 0.005])
    moved = scene.position * (1.0 + strains) + [0.1, -0.2, 0.3]
    found = _middle_strain(scene, 0, SimpleNamespace(position=moved))
    assert found == pytest.approx(strains, rel=1e-9)
    # Those of the ends do not count.
    along = scene.position[:, 0]
    outer = np.abs(along - 0.5 * (along.min() + along.max())) > 0.2 * np.ptp(along)
    moved[outer] += 1.0
    assert _middle_strain(scene, 0, SimpleNamespace(position=moved)) == found


@pytest.mark.parametrize('angle', [-0.3, 0.3])
def test_the_middle_of_a_pulled_slab_goes_as_the_periodic_fabric_says(angle):
    """Its sign, and the ratio across y of a slab whose sides are free; both ends are held."""
    scene = make_scene(
        weave={'size': [7, 3, 3], 'connector_angle': angle},
        connector={'stiffness': K, 'bending_stiffness': 0.02})
    ratio = float(ico.homogenise(scene).poisson_ratio(X, Y))
    small, twice = ico.measure_curve(scene, 'pull', [1e-3, 2e-3])
    for point in (small, twice):
        along, *across = point.middle_strain
        assert along == pytest.approx(point.strain, rel=0.3)
        assert np.sign(across).tolist() == [-np.sign(angle)] * 2
        assert -across[0] / along == pytest.approx(ratio, rel=0.3)
        # The force that the stress is made of, and tensions on both sides of 0.
        assert point.end_force[0] > 0.0 and np.abs(point.end_force[1:]).max() < 1e-6
        assert point.tension_range[0] < 0.0 < point.tension_range[1]
    assert np.allclose(twice.middle_strain, 2.0 * np.array(small.middle_strain), rtol=0.02)
    assert len(small.row()) == len(CURVE_COLUMNS)
    row = dict(zip(CURVE_COLUMNS, small.row()))
    assert row['end_force_x_n'] == small.end_force[0]
    assert row['largest_tension_n'] == small.tension_range[1]
    flat = ico.measure_curve(make_scene(
        weave={'size': [5, 3, 1], 'connector_angle': angle},
        connector={'stiffness': K, 'bending_stiffness': 0.02}), 'pull', [1e-3])[0]
    assert np.isnan(flat.middle_strain[2]) and np.isfinite(flat.middle_strain[:2]).all()
