# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The periodic fabric: waves and elastic constants against closed forms, motion and finite slabs.
"""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.pictures.band_picture import density_of_states
from icofabric_sim.statics.periodic import (
    band_path,
    homogenise,
    make_cell,
    sample_zone,
    solve_bands,
)
import numpy as np
import pytest

K = 500.0
STIFF = {'connector': {'bending_stiffness': 0.02, 'twisting_stiffness': 0.01}}
LOOSE = {}
TENSE = {'connector': {'natural_length': 0.031}}


def woven(**sections):
    return make_scene((3, 3, 3), **{'weave': {'size': [3, 3, 3], 'connector_angle': 0.3},
                                    **sections})


@pytest.mark.parametrize('variant', [0, 1, 2, 3])
@pytest.mark.parametrize('kind', ['orthogonal', 'bias'])
def test_one_body_to_a_cell_wherever_it_is(variant, kind):
    weave = {'size': [4, 4, 4], 'kind': kind, 'connector_angle': 0.4}
    if kind == 'orthogonal':
        weave['variant'] = variant
    elif variant:
        weave['azimuth'] = 0.3 * variant
    scene = make_scene((4, 4, 4), weave=weave, **STIFF)
    cell = make_cell(scene)
    pitch = scene.geometry.pitch
    lengths = np.linalg.norm(cell.offsets[1:], axis=1)
    assert lengths == pytest.approx(np.full(12, np.sqrt(2.0) * pitch), rel=1e-12)
    # H(0, -R) is the transpose of H(0, R), and nothing pushes where all move alike.
    for offset, block in zip(cell.offsets, cell.stiffness):
        across = np.argmin(np.abs(cell.offsets + offset).sum(axis=1))
        assert np.allclose(cell.stiffness[across], block.T, atol=1e-9 * np.abs(block).max())
    assert np.abs(cell.stiffness[:, :, :3].sum(axis=0)).max() < 1e-10 * K


def test_point_springs_bear_pull_and_no_shear():
    """C11 = k / W; shear along the fabric's axes costs nothing."""
    scene = woven()
    found = homogenise(scene)
    pitch = scene.geometry.pitch
    assert np.allclose(np.diag(found.stiffness)[:3], K / pitch, rtol=1e-12)
    assert np.abs(found.stiffness[3:]).max() < 1e-9 * K / pitch
    assert len(found.zero_energy_strains) == 3
    assert np.abs(found.zero_energy_strains[:, :3]).max() < 1e-12
    c11, c12 = found.stiffness[0, 0], found.stiffness[0, 1]
    axis, diagonal = np.array([1.0, 0.0, 0.0]), np.array([1.0, 1.0, 1.0])
    assert found.young_modulus(axis) == pytest.approx(
        c11 - 2.0 * c12**2 / (c11 + c12), rel=1e-12)
    assert found.poisson_ratio(axis, np.array([0.0, 1.0, 0.0])) == pytest.approx(
        c12 / (c11 + c12), rel=1e-12)
    assert found.young_modulus(diagonal) == 0.0
    assert np.isnan(found.poisson_ratio(diagonal, np.array([1.0, -1.0, 0.0])))
    assert found.density == pytest.approx(scene.shell.mass / (2.0 * pitch**3), rel=1e-12)


def test_long_waves_travel_as_in_the_homogeneous_body():
    scene = woven(**STIFF)
    found = homogenise(scene)
    short = 1e-3 / scene.geometry.pitch
    for direction in ([1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 2.0, 3.0]):
        n = np.array(direction) / np.linalg.norm(direction)
        voigt = np.array([[n[0], 0, 0, 0, n[2], n[1]], [0, n[1], 0, n[2], 0, n[0]],
                          [0, 0, n[2], n[1], n[0], 0]])
        # Christoffel's tensor.
        speeds = np.sqrt(np.linalg.eigvalsh(voigt @ found.stiffness @ voigt.T) / found.density)
        bands = solve_bands(scene, short * n)[0]
        assert bands[:3] / short == pytest.approx(speeds, rel=1e-5)
        assert (bands[3:] > 100.0 * bands[2]).all()


def test_waves_under_pre_stress():
    """
    A transverse wave is half a shear and half a turn: rho v^2 = C44 + sigma / 2 with this C44.
    """
    scene = woven(**TENSE)
    found = homogenise(scene)
    # The stress of twelve halves of connectors, tension T along d over the cell: sum T l d d / V.
    cell = make_cell(scene)
    assert found.stress[0] == pytest.approx(found.stress[1], rel=1e-9)
    short = 1e-3 / scene.geometry.pitch
    bands = solve_bands(scene, np.array([short, 0.0, 0.0]))[0]
    speed = np.sqrt((found.stiffness[4, 4] + 0.5 * found.stress[0]) / found.density)
    assert bands[0] / short == pytest.approx(speed, rel=1e-4)
    simulation = ico.compile_scene(cell.scene)
    assert (simulation.snapshot().connector_length > 0.031).all() and found.stress[0] > 0.0


def test_waves_that_grow_have_negative_values():
    """The same closed form, where connectors push so hard that a shear gives way."""
    scene = woven(connector={'natural_length': 0.055})
    found = homogenise(scene)
    short = 1e-3 / scene.geometry.pitch
    bands = solve_bands(scene, np.array([short, 0.0, 0.0]))[0]
    square = (found.stiffness[4, 4] + 0.5 * found.stress[0]) / found.density
    assert square < 0.0
    assert bands[0] / short == pytest.approx(-np.sqrt(-square), rel=1e-4)
    assert (np.diff(bands) >= 0.0).all() and bands[-1] > 0.0


def test_a_plane_wave_in_a_real_slab():
    """Far from the borders of a slab the acceleration is - omega^2 u at its centre."""
    scene = make_scene((9, 9, 9), weave={'size': [9, 9, 9], 'connector_angle': 0.3}, **STIFF)
    wave = np.array([0.9, 0.4, -0.3]) / scene.geometry.pitch
    cell = make_cell(scene)
    phase = np.exp(1j * cell.offsets @ wave)
    scaled = np.einsum('r,rij->ij', phase, cell.stiffness / np.outer(
        cell.sqrt_mass, cell.sqrt_mass))
    values, vectors = np.linalg.eigh(scaled)
    bands = solve_bands(scene, wave)[0]
    assert bands == pytest.approx(np.sqrt(values), rel=1e-10)
    centre = int(np.argmin(np.linalg.norm(scene.position - scene.position.mean(axis=0), axis=1)))
    inner = np.flatnonzero((
        np.abs(scene.position - scene.position[centre]) < 3.1 * scene.geometry.pitch).all(axis=1))
    assert len(inner) > 100
    from icofabric_sim.statics.fabric import StaticFabric
    fabric = StaticFabric(scene)
    for number in range(6):
        travelling = np.exp(1j * (scene.position - scene.position[centre]) @ wave)
        shape = (travelling[:, None] * vectors[:, number] / fabric.root).real
        size = 1e-6 / np.abs(shape).max() * np.array([1e-2] * 3 + [1e-2] * 3)
        motion = size * shape
        force = fabric.start.moved(motion).force
        expected = -values[number] * fabric.root**2 * motion
        left = np.abs(force - expected)[inner]
        assert left[:, :3].max() < 1e-4 * np.abs(expected[inner, :3]).max() + 1e-11
        assert np.abs(expected[inner]).max() > 0.0


def test_slabs_approach_the_periodic_fabric():
    """The largest frequency of a slab grows to that of the periodic fabric, from below."""
    wanted = solve_bands(woven(**STIFF), sample_zone(woven(**STIFF), 8)).max()
    top = max(wanted, solve_bands(woven(**STIFF), band_path(woven(**STIFF))[0]).max())
    found = [
        ico.solve_modes(woven(**{**STIFF, 'weave': {'size': [n, n, n], 'connector_angle': 0.3}}),
                        count=1, which='highest').frequencies[0] for n in (3, 5, 7)]
    assert found[0] < found[1] < found[2] < top * (1.0 + 1e-9)
    assert found[2] > 0.96 * top


def test_bands_of_symmetric_points():
    scene = woven(**LOOSE)
    path, along, stops = band_path(scene)
    bands = solve_bands(scene, path)
    assert bands.shape == (len(path), 6) and len(stops) == 6
    assert (np.diff(along) > 0.0).all()
    # As many springs as freedoms: every wave along an axis has two motions without energy.
    assert (bands[1:stops[1], :2] == 0.0).all() and (bands[1:stops[1], 2] > 0.0).all()
    # Twice the reciprocal lattice away all is the same.
    shifted = solve_bands(scene, path[:5] + np.pi / scene.geometry.pitch * np.array([1, 1, 1]))
    assert np.allclose(shifted, bands[:5], atol=1e-5 * bands.max())
    # A turned fabric has the same waves in turned directions.
    turned = make_scene((4, 4, 4), weave={
        'kind': 'bias', 'size': [4, 4, 4], 'azimuth': 0.4, 'connector_angle': 0.3})
    assert np.allclose(
        solve_bands(turned, band_path(turned)[0]), bands, atol=1e-5 * bands.max())


def test_density_of_states_counts_all_freedoms():
    for scene, free in ((woven(**STIFF), 0.0), (woven(), None)):
        edges, density = density_of_states(scene, samples=6, classes=30)
        states = float((density * np.diff(edges)).sum())
        if free is None:
            # Some waves of point springs cost no energy; on even samples not all of these.
            assert 3.0 < states <= 6.0
        else:
            assert states == pytest.approx(6.0, rel=1e-12)
        assert edges[0] == 0.0 and (density >= 0.0).all()


@pytest.mark.parametrize('sections, name', [
    ({'weave': {'kind': 'radial', 'size': [3, 3, 3], 'radius': 0.5}}, 'weave.kind'),
    ({'weave': {'size': [3, 3, 3], 'connected': False}}, 'weave.connected'),
    ({'groups': {'g': 'ids 0'},
      'connector_groups': {'c': {'between': 'g all', 'stiffness': 3.0}}}, 'connector_groups')])
def test_what_does_not_repeat_is_refused(sections, name):
    with pytest.raises(ico.ParameterError, match=name):
        homogenise(make_scene((3, 3, 3), **sections))
    with pytest.raises(ValueError, match='finite'):
        solve_bands(woven(), np.array([np.nan, 0.0, 0.0]))
