# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0

import math

from icofabric_sim.geometry.icosahedron import EDGES, vertices
from icofabric_sim.scene.weave_geometry import (
    cube_width,
    geometry_from_angle,
    geometry_from_length,
    LIMIT_ANGLE,
    MINIMUM_ANGLE,
    MINIMUM_LENGTH_RATIO,
    size_for_box,
    slab_depth,
)
import numpy as np
import pytest

HALF_EDGES = (1e-3, 0.01, 1.0)
ANGLES = np.concatenate((
    np.linspace(MINIMUM_ANGLE, 0.78, 41), LIMIT_ANGLE - np.logspace(-12, -3, 10)))


def test_cube_width_is_that_of_the_icosahedron():
    # Eq 50: the cube around the vertices, w = (1 + sqrt 5) a.
    points = vertices(0.37)
    assert len(EDGES) == 30
    assert np.ptp(points, axis=0) == pytest.approx([cube_width(0.37)] * 3, rel=1e-15)
    assert cube_width(0.37) == pytest.approx((1 + math.sqrt(5)) * 0.37, rel=1e-15)


@pytest.mark.parametrize('half_edge', HALF_EDGES)
def test_figure_5_from_the_angle(half_edge):
    # Figure 5: L over theta, eq 53, and the quadratic equation, eq 51.
    lengths = []
    for theta in ANGLES:
        geometry = geometry_from_angle(half_edge, theta)
        w, L, W = geometry.cube_width, geometry.connector_length, geometry.pitch
        s = math.sin(theta)
        quadratic = 2 * (L * s)**2 + 2 * w * L * s - (L**2 - w**2)
        assert quadratic / L**2 == pytest.approx(0, abs=1e-15)
        if theta < 0.78:
            printed = (s + math.cos(theta)) / math.cos(2 * theta) * w
            assert L == pytest.approx(printed, rel=1e-13)
        assert W == pytest.approx(w + L * s, rel=2e-16 * (1 + L / w))
        assert W == pytest.approx(L * math.cos(theta), rel=1e-15)
        lengths.append(L)
    order = np.argsort(ANGLES)
    assert np.all(np.diff(np.array(lengths)[order]) > 0)
    assert min(lengths) == pytest.approx(0.774596669 * w, rel=1e-9)
    assert max(lengths) > 1e11 * w


@pytest.mark.parametrize('half_edge', HALF_EDGES)
def test_length_and_angle_are_inverse(half_edge):
    for theta in ANGLES:
        given = geometry_from_angle(half_edge, theta)
        back = geometry_from_length(half_edge, given.connector_length)
        assert back.connector_angle == pytest.approx(theta, abs=1e-15)
        assert back.pitch == pytest.approx(given.pitch, rel=1e-14)
        assert back.connector_length == given.connector_length


@pytest.mark.parametrize('ratio', [0.7745967, 0.9, 1.0, 1 + 1e-9, 1.5, 1e3, 1e9, 1e150, 1e200])
def test_angle_from_length_is_accurate(ratio):
    # Against eq 52 in exact arithmetic of whole numbers scaled by 10^400.
    digits = 400
    unit = 10**digits
    length = int(ratio * 10**17) * 10**(digits - 17)
    root = math.isqrt(2 * length * length - unit * unit)
    rise, run = (root - unit) // 2, (root + unit) // 2  # L sin theta, L cos theta = W
    L = length / unit
    geometry = geometry_from_length(1 / (1 + math.sqrt(5)), L)
    assert geometry.cube_width == pytest.approx(1, rel=3e-16)
    assert geometry.pitch == pytest.approx(run / unit, rel=2e-15)
    assert geometry.connector_angle == pytest.approx(
        math.atan2(rise / unit, run / unit), rel=1e-12 if ratio - 1 > 1e-6 else 1e-9, abs=5e-16)


def test_special_values():
    # Eq 54 and the sentence after it.
    assert MINIMUM_ANGLE == pytest.approx(-0.364863828, abs=5e-10)
    assert math.degrees(MINIMUM_ANGLE) == pytest.approx(-20.90515745, abs=5e-9)
    assert MINIMUM_LENGTH_RATIO == pytest.approx(0.774596669, abs=5e-10)
    shortest = geometry_from_angle(0.01, MINIMUM_ANGLE)
    assert shortest.connector_length == pytest.approx(
        math.sqrt(3 / 5) * shortest.cube_width, rel=1e-15)
    level = geometry_from_angle(0.01, 0.0)
    assert level.connector_length == level.pitch == pytest.approx(level.cube_width, rel=1e-15)
    # The angle of the faces at a named edge: the connector then lies in a face.
    a, tau = 1.0, (1 + math.sqrt(5)) / 2
    normal = np.cross([tau * a, -a, a - tau * a], [tau * a, a, a - tau * a])
    normal /= np.linalg.norm(normal)
    assert math.asin(-abs(normal[0])) == pytest.approx(MINIMUM_ANGLE, rel=1e-15)


@pytest.mark.parametrize('half_edge', HALF_EDGES)
def test_limits_hold_to_rounding(half_edge):
    shortest = MINIMUM_LENGTH_RATIO * cube_width(half_edge)
    for length in (shortest, shortest * (1 - 4e-16), 0.774596669 * cube_width(half_edge)):
        assert geometry_from_length(half_edge, length).connector_length == length
    for angle in (MINIMUM_ANGLE, math.radians(-20.90515745), math.nextafter(LIMIT_ANGLE, 0)):
        assert geometry_from_angle(half_edge, angle).connector_angle == angle
    for length in (shortest * (1 - 1e-8), cube_width(half_edge) / math.sqrt(2), 0.0, -1.0,
                   math.nan, math.inf):
        with pytest.raises(ValueError, match=r'weave\.connector_length is .* m: .*sqrt\(3/5\)'):
            geometry_from_length(half_edge, length)
    for angle in (MINIMUM_ANGLE - 1e-8, LIMIT_ANGLE, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match=r'weave\.connector_angle is .* rad: .*-0\.36486'):
            geometry_from_angle(half_edge, angle)


def test_messages_help():
    with pytest.raises(ValueError, match='10 degrees are 0.174532925 rad'):
        geometry_from_angle(0.01, 10)
    # What is no angle of a weave in degrees either gets no such hint.
    with pytest.raises(ValueError, match=r'less than pi/4 = 0\.785398163 rad \(eq 54\)$'):
        geometry_from_angle(0.01, -21)
    with pytest.raises(ValueError, match=r'at least sqrt\(3/5\) w = 0.0250664'):
        geometry_from_length(0.01, 0.02)
    for half_edge in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match=r'shell\.edge_length'):
            geometry_from_angle(half_edge, 0.0)
    with pytest.raises(ValueError, match='not finite'):
        geometry_from_angle(1e308, math.nextafter(LIMIT_ANGLE, 0))


@pytest.mark.parametrize('half_edge', HALF_EDGES)
@pytest.mark.parametrize('angle', [MINIMUM_ANGLE, 0.0, 0.3, 0.78])
def test_box_fit_is_the_inverse_of_slab_depth(half_edge, angle):
    geometry = geometry_from_angle(half_edge, angle)
    for size in ((1, 1, 1), (5, 5, 5), (1, 7, 1000), (3, 123456, 2)):
        depth = slab_depth(size, geometry)
        expected = [geometry.cube_width + (n - 1) * geometry.pitch for n in size]
        assert depth.tolist() == pytest.approx(expected, rel=1e-15)
        assert size_for_box(depth, geometry) == size
        assert size_for_box(depth * (1 - 1e-12), geometry) == size
        assert size_for_box(depth + 0.999 * geometry.pitch, geometry) == size
        assert size_for_box(depth + geometry.pitch, geometry) == tuple(n + 1 for n in size)
    below = slab_depth((5, 5, 5), geometry) * (1 - 1e-7)
    assert size_for_box(below, geometry) == (4, 4, 4)


def test_boxes_that_nothing_fits_are_refused():
    geometry = geometry_from_angle(0.01, 0.1)
    w = geometry.cube_width
    assert size_for_box([w, w, w], geometry) == (1, 1, 1)
    bad = ([w, 0.9 * w, w], [0, w, w], [-1, w, w], [math.nan, w, w], [math.inf, w, w], [w, w])
    for box in bad:
        with pytest.raises(ValueError, match=r'weave\.box is \[.*\] m'):
            size_for_box(box, geometry)
    assert min(size_for_box([1e300, 1e300, 1e300], geometry)) > 2**60
