# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0

import itertools
import math

from icofabric_sim.geometry.icosahedron import FACES, TAU, vertices
from icofabric_sim.scene.weave import (
    body_orientation,
    build_weave,
    fabric_orientation,
    rotation_matrix,
)
from icofabric_sim.scene.weave_connect import connect_grid
from icofabric_sim.scene.weave_geometry import geometry_from_angle
from icofabric_sim.scene.weave_lattice import turned_box_grid
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

VARIANTS = (0, 1, 2, 3)
AZIMUTHS = (0.0, 0.3, math.pi / 2, -2.0, 7.0)
GEOMETRY = geometry_from_angle(0.01, 0.2)


@pytest.mark.parametrize('azimuth', AZIMUTHS)
@pytest.mark.parametrize('variant', VARIANTS)
def test_bias_has_a_face_up_and_tilts_the_gaps(azimuth, variant):
    fabric = Rotation.from_quat(fabric_orientation('bias', azimuth))
    assert fabric.apply([1, 1, 1]) == pytest.approx([0, 0, math.sqrt(3)], abs=1e-15)
    # Gaps lie along the fabric's axes.
    for axis in np.eye(3):
        tilt = math.degrees(math.acos(fabric.apply(axis)[2]))
        assert tilt == pytest.approx(54.735610317, abs=1e-8)
    # The smallest rotation, then the azimuth.
    unturned = Rotation.from_quat(fabric_orientation('bias', 0.0))
    assert unturned.magnitude() == pytest.approx(math.acos(1 / math.sqrt(3)), rel=1e-14)
    about_vertical = Rotation.from_euler('z', azimuth)
    assert (about_vertical * unturned).as_matrix() == pytest.approx(fabric.as_matrix(), abs=1e-15)
    # A face of the body is up and the opposite one down: three vertices each at r_in = 1.5115 a.
    body = Rotation.from_quat(body_orientation('bias', variant, azimuth))
    height = np.sort(body.apply(vertices(1.0))[:, 2])
    assert height[-3:] == pytest.approx(TAU**2 / math.sqrt(3), rel=1e-14)
    assert height[:3] == pytest.approx(-TAU**2 / math.sqrt(3), rel=1e-14)
    top = set(np.argsort(body.apply(vertices(1.0))[:, 2])[-3:].tolist())
    assert top in [set(face) for face in FACES.tolist()]
    assert rotation_matrix(body.as_quat()) == pytest.approx(body.as_matrix(), abs=1e-15)


@pytest.mark.parametrize('variant', VARIANTS)
def test_bias_with_fabric_boundary_is_the_turned_slab(variant):
    flat = build_weave('orthogonal', variant, (3, 4, 5), GEOMETRY)
    turned = build_weave('bias', variant, (3, 4, 5), GEOMETRY, azimuth=0.7, boundary='fabric')
    turn = Rotation.from_quat(fabric_orientation('bias', 0.7))
    assert turned.position == pytest.approx(turn.apply(flat.position), abs=1e-15)
    assert np.array_equal(turned.grid, flat.grid)
    assert np.array_equal(turned.connector_bodies, flat.connector_bodies)
    assert np.array_equal(turned.connector_edges, flat.connector_edges)
    body = turn * Rotation.from_quat(flat.orientation)
    assert Rotation.from_quat(turned.orientation).as_matrix() == pytest.approx(
        body.as_matrix(), abs=1e-15)


@pytest.mark.parametrize('variant', VARIANTS)
@pytest.mark.parametrize('azimuth', AZIMUTHS)
def test_upright_bias_fills_its_box(variant, azimuth):
    # Against every grid point of a cube that is surely large enough.
    turn = Rotation.from_quat(fabric_orientation('bias', azimuth))
    reach = np.arange(-9, 10)
    z, y, x = (index.ravel() for index in np.meshgrid(reach, reach, reach, indexing='ij'))
    points = np.stack((x, y, z), axis=1)[(x + y + z) % 2 == variant % 2]
    for size in ((2, 2, 2), (3, 5, 4), (9, 1, 2), (1, 1, 16), (4, 4, 4)):
        half = 0.5 * np.array(size)
        inside = np.all(np.abs(turn.apply(points)) <= half * (1 + 1e-9), axis=1)
        weave = build_weave('bias', variant, size, GEOMETRY, azimuth=azimuth)
        assert weave.grid.tolist() == points[inside].tolist()
        centre = 0.5 * (np.array(size) - 1) * GEOMETRY.pitch
        assert weave.position == pytest.approx(
            centre + GEOMETRY.pitch * turn.apply(weave.grid), abs=1e-15)
        low, high = -0.5 * GEOMETRY.pitch, (np.array(size) - 0.5) * GEOMETRY.pitch
        assert np.all(weave.position >= low - 1e-12) and np.all(weave.position <= high + 1e-12)
        # The corner of the variant is in the middle: an icosahedron or a gap.
        assert bool(np.any(np.all(weave.grid == 0, axis=1))) == (variant in (0, 2))
        expected = connect_grid(points[inside], variant)
        assert np.array_equal(weave.connector_bodies, expected.bodies)
        assert np.array_equal(weave.connector_edges, expected.edges)


def test_centres_on_the_border_belong_to_the_box():
    # Level planes of the bias fabric are 2/sqrt(3) W apart; a box exactly two of these high.
    W = GEOMETRY.pitch
    exact = build_weave(
        'bias', 0, (1, 1, 1), GEOMETRY, box=(8 * W, 8 * W, 4 / math.sqrt(3) * W), azimuth=0.2)
    less = build_weave(
        'bias', 0, (1, 1, 1), GEOMETRY, box=(8 * W, 8 * W, 3.999 / math.sqrt(3) * W), azimuth=0.2)
    assert len(np.unique(np.round(exact.position[:, 2] / W, 6))) == 3
    assert len(np.unique(np.round(less.position[:, 2] / W, 6))) == 1
    assert exact.size == (8, 8, 2)


@pytest.mark.parametrize('azimuth', [0.0, 0.3])
def test_turned_box_of_any_rotation(azimuth):
    # Also with the axes of box and fabric aligned, where lines are parallel to its sides.
    turns = [Rotation.identity(), Rotation.from_euler('z', math.pi / 2),
             Rotation.from_euler('xyz', [azimuth, 0.0, 0.0]),
             Rotation.from_euler('xyz', [0.3, -1.2, 2.0])]
    reach = np.arange(-12, 13)
    z, y, x = (index.ravel() for index in np.meshgrid(reach, reach, reach, indexing='ij'))
    points = np.stack((x, y, z), axis=1)
    for turn, parity in itertools.product(turns, (0, 1)):
        half = np.array([3.0, 5.5, 2.2])
        inside = np.all(np.abs(turn.apply(points)) <= half * (1 + 1e-9), axis=1)
        inside &= points.sum(axis=1) % 2 == parity
        found = turned_box_grid(parity, turn.as_matrix(), half)
        assert found.tolist() == points[inside].tolist()


def test_azimuth_turns_the_fabric_in_its_box():
    # A third of a turn about (1, 1, 1) is a symmetry; a tenth is not.
    first = build_weave('bias', 0, (6, 6, 6), GEOMETRY)
    third = build_weave('bias', 0, (6, 6, 6), GEOMETRY, azimuth=2 * math.pi / 3)
    tenth = build_weave('bias', 0, (6, 6, 6), GEOMETRY, azimuth=2 * math.pi / 10)

    def places(weave):
        return {tuple(point) for point in np.round(weave.position / GEOMETRY.pitch, 6).tolist()}

    assert places(third) == places(first)
    assert len(places(first) & places(tenth)) < 0.3 * first.body_count


@pytest.mark.parametrize('boundary', ['upright', 'fabric'])
def test_density(boundary):
    # One body in two cells, and six connectors; a level plane of the turned fabric more or less
    # is 1/35 of this box.
    weave = build_weave('bias', 1, (40, 40, 40), GEOMETRY, azimuth=0.1, boundary=boundary)
    assert weave.body_count == pytest.approx(40**3 / 2, rel=1 / 35)
    assert weave.connector_count / weave.body_count == pytest.approx(6, rel=0.05)


def test_slender_turned_columns_stay_cheap():
    # The cube around this column has 2e10 grid places.
    weave = build_weave('bias', 0, (3, 3, 5000), GEOMETRY)
    assert weave.body_count == pytest.approx(3 * 3 * 5000 / 2, rel=0.15)
    assert np.ptp(weave.position[:, 2]) == pytest.approx(5000 * GEOMETRY.pitch, rel=1e-3)
