# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0

import math
import tracemalloc

from icofabric_sim.geometry.icosahedron import NAMED_EDGE_DIRECTIONS, TAU
from icofabric_sim.scene.weave import build_weave, estimate_weave
from icofabric_sim.scene.weave_geometry import (
    geometry_from_angle,
    MINIMUM_ANGLE,
    size_for_box,
    slab_depth,
)
from icofabric_sim.scene.weave_index import centre_rule, indices_from_alpha, slab_count
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

VARIANTS = (0, 1, 2, 3)
GEOMETRY = geometry_from_angle(0.01, 0.2)


def outward_directions(weave):
    """
    Return the directions (6, 3) from a centre to the midpoints of its named edges, in the world.
    """
    return Rotation.from_quat(weave.orientation).apply(np.array(NAMED_EDGE_DIRECTIONS))


def connector_ends(weave):
    """Return the ends (C, 2, 3) of the connectors, at the midpoints of their edges [m]."""
    points = TAU * weave.geometry.half_edge * outward_directions(weave)
    return weave.position[weave.connector_bodies] + points[weave.connector_edges]


@pytest.mark.parametrize('variant', VARIANTS)
@pytest.mark.parametrize('kind, boundary', [
    ('orthogonal', 'upright'), ('bias', 'fabric'), ('bias', 'upright')])
@pytest.mark.parametrize('half_edge', [1e-3, 1.0])
def test_connectors_have_their_length_and_angle(variant, kind, boundary, half_edge):
    for angle in (MINIMUM_ANGLE, 0.0, 0.6):
        geometry = geometry_from_angle(half_edge, angle)
        weave = build_weave(kind, variant, (4, 5, 6), geometry, azimuth=0.4, boundary=boundary)
        assert weave.connector_count > 200
        ends = connector_ends(weave)
        connector = ends[:, 1] - ends[:, 0]
        length = np.linalg.norm(connector, axis=1)
        assert length == pytest.approx(geometry.connector_length, rel=1e-12)
        # Theta is the angle to the cube's face at the edge, at both ends.
        outward = outward_directions(weave)
        for end, sign in ((0, 1), (1, -1)):
            normal = outward[weave.connector_edges[:, end]]
            sine = sign * np.einsum('ca,ca->c', connector, normal) / length
            assert sine == pytest.approx(math.sin(angle), abs=1e-12)


@pytest.mark.parametrize('variant', VARIANTS)
def test_orthogonal_slab(variant):
    size = (3, 4, 5)
    weave = build_weave('orthogonal', variant, size, GEOMETRY)
    indices = indices_from_alpha(variant, size, np.arange(slab_count(variant, size)))
    grid = centre_rule(variant, *indices.T)
    assert np.array_equal(weave.grid, grid)
    assert weave.grid.dtype == np.int32
    assert weave.position == pytest.approx(GEOMETRY.pitch * grid, rel=1e-15)
    assert (weave.kind, weave.variant, weave.size) == ('orthogonal', variant, size)
    assert weave.geometry is GEOMETRY
    assert weave.body_count == len(grid)
    # x, y, z, w: the identity, or 90 degrees about z.
    half = math.sqrt(0.5)
    expected = [0, 0, 0, 1] if variant < 2 else [0, 0, half, half]
    assert weave.orientation == pytest.approx(expected, abs=1e-16)
    # The slab, over the cubes, is as deep as it should be.
    depth = np.ptp(weave.position, axis=0) + GEOMETRY.cube_width
    assert depth == pytest.approx(slab_depth(size, GEOMETRY), rel=1e-14)
    assert np.allclose(weave.position[0], 0) == (variant in (0, 2))


@pytest.mark.parametrize('kind, boundary', [
    ('orthogonal', 'upright'), ('bias', 'fabric'), ('bias', 'upright')])
@pytest.mark.parametrize('variant', VARIANTS)
def test_order_and_dtypes(kind, boundary, variant):
    weave = build_weave(kind, variant, (5, 6, 4), GEOMETRY, azimuth=1.0, boundary=boundary)
    x, y, z = weave.grid.T
    rows = variant >= 2 and not (kind == 'bias' and boundary == 'upright')
    order = np.lexsort((y, x, z) if rows else (x, y, z))
    assert np.array_equal(order, np.arange(weave.body_count))
    first, second = weave.connector_bodies.T
    assert np.all(first < second)
    assert np.array_equal(
        np.lexsort((second, weave.connector_edges[:, 0], first)), np.arange(weave.connector_count))
    assert np.array_equal(weave.connector_edges[:, 1], weave.connector_edges[:, 0] ^ 1)
    assert weave.connector_bodies.dtype == np.int32
    assert weave.connector_edges.dtype == np.int8
    bare = build_weave(
        kind, variant, (5, 6, 4), GEOMETRY, azimuth=1.0, boundary=boundary, connected=False)
    assert np.array_equal(bare.position, weave.position)
    assert bare.connector_bodies.shape == bare.connector_edges.shape == (0, 2)
    assert weave.connector_count > 0


def test_boxes():
    # Best fit of an orthogonal slab; a box is filled with centres in an upright bias weave.
    box = (0.2, 0.3, 0.25)
    size = size_for_box(box, GEOMETRY)
    weave = build_weave('orthogonal', 0, (1, 1, 1), GEOMETRY, box=box)
    assert weave.size == size
    assert weave.body_count == slab_count(0, size) > 100
    upright = build_weave('bias', 0, (1, 1, 1), GEOMETRY, box=box)
    low, high = upright.position.min(axis=0), upright.position.max(axis=0)
    corner = -0.5 * GEOMETRY.pitch
    assert np.all(low >= corner) and np.all(high <= corner + np.array(box))
    assert np.all(high - low > np.array(box) - 2.4 * GEOMETRY.pitch)
    assert upright.body_count == pytest.approx(math.prod(box) / GEOMETRY.pitch**3 / 2, rel=0.1)
    for kind, boundary in (('orthogonal', 'upright'), ('bias', 'upright'), ('bias', 'fabric')):
        for bad in ((0, 1, 1), (1, 1), (math.nan, 1, 1)):
            with pytest.raises(ValueError, match=r'weave\.box'):
                build_weave(kind, 0, (1, 1, 1), GEOMETRY, box=bad, boundary=boundary)


def test_empty_weaves_are_refused():
    for kind, variant, size, boundary in (
            ('orthogonal', 1, (1, 1, 1), 'upright'), ('orthogonal', 3, (1, 1, 1), 'upright'),
            ('bias', 1, (1, 1, 1), 'fabric'), ('bias', 3, (1, 1, 1), 'upright'),
            # Between two level planes, however wide.
            ('bias', 1, (300, 300, 1), 'upright')):
        for function in (build_weave, estimate_weave):
            with pytest.raises(ValueError, match=r'weave\.size is \[.*variant [13], has no'):
                function(kind, variant, size, GEOMETRY, boundary=boundary)
    assert build_weave('bias', 0, (1, 1, 1), GEOMETRY).body_count == 1


def test_bad_choices_are_named():
    cases = [
        ('radial', 0, (3, 3, 3), {}, r'weave\.kind is .radial.: .*orthogonal, bias'),
        ('bias', 4, (3, 3, 3), {}, r'weave\.variant is 4'),
        ('bias', 0, (3, 0, 3), {}, r'weave\.size is \[3, 0, 3\]'),
        ('bias', 0, (3, 3, 3), {'boundary': 'round'}, r'weave\.boundary is .*upright, fabric'),
        ('bias', 0, (3, 3, 3), {'azimuth': math.nan}, r'weave\.azimuth is nan rad'),
        ('orthogonal', 0, (10**5, 10**5, 1), {}, r'weave\.size is .*5000000000 bodies'),
        ('orthogonal', 0, (1, 1, 2**31), {}, r'weave\.size is'),
        ('bias', 0, (1, 1, 1), {'box': (1e300, 1e300, 1e300)}, r'weave\.size is'),
        ('orthogonal', 0, (1, 1, 1), {'box': (1e300, 1e300, 1e300)}, r'weave\.size is')]
    for kind, variant, size, options, message in cases:
        for function in (build_weave, estimate_weave):
            with pytest.raises(ValueError, match=message):
                function(kind, variant, size, GEOMETRY, **options)


@pytest.mark.parametrize('variant', VARIANTS)
def test_estimates(variant):
    for kind, boundary, size in (
            ('orthogonal', 'upright', (3, 4, 70)), ('bias', 'fabric', (40, 5, 5)),
            ('bias', 'upright', (7, 5, 6)), ('bias', 'upright', (30, 30, 40))):
        weave = build_weave(kind, variant, size, GEOMETRY, boundary=boundary)
        guess = estimate_weave(kind, variant, size, GEOMETRY, boundary=boundary)
        exact = max(size) <= 32 or boundary == 'fabric' or kind == 'orthogonal'
        margin = 0 if exact else 0.1
        assert guess.bodies == pytest.approx(weave.body_count, rel=margin)
        assert guess.connectors == pytest.approx(weave.connector_count, rel=margin)
        bare = estimate_weave(kind, variant, size, GEOMETRY, boundary=boundary, connected=False)
        assert (bare.bodies, bare.connectors) == (guess.bodies, 0)
        assert bare.memory <= guess.memory
        if kind == 'orthogonal':
            assert bare.memory < guess.memory


def test_memory_estimate_is_about_what_building_takes():
    size = (110, 110, 110)
    guess = estimate_weave('bias', 0, size, GEOMETRY).memory
    tracemalloc.start()
    try:
        weave = build_weave('bias', 0, size, GEOMETRY)
        assert len(weave.connector_bodies) == weave.connector_count
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert weave.body_count > 600_000
    assert 0.6 * guess < peak < 1.1 * guess
