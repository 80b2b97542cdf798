# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The push between two shells, and between a shell and a plane, comes from the potential."""

from contact_poses import (
    by_polygons,
    facing,
    first_touch,
    floor_by_polygons,
    half_spaces,
    KINDS,
    moments,
    NORMALS,
    pose,
    RHO,
    SCRATCH,
    touch,
    touch_floor,
    turned,
    VERTICES,
    wrench,
)
from icofabric_sim.terms.contacts.pair import OUT_SIZE, touch_pair_again
from icofabric_sim.terms.contacts.surface import add_all, M0, M1, P1, S0, S1, SUM_COUNT, SUMS, T0
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

ORIGIN = np.zeros(3)


def overlapping(kind, rng, low=-4.0, high=-1.3):
    """Two bodies (xa, ra, xb, rb) that overlap by 10^low to 10^high half edges or less."""
    ra, rb, way = pose(kind, rng)
    place = 3.0 * rng.normal(size=3)
    depth = 10.0 ** rng.uniform(low, high)
    return place, ra, place + (first_touch(ra, rb, way) - depth) * way, rb


def slope(function, parts, step):
    """
    Minus the gradient of an energy of (xa, ra, xb, rb) by places and rotation vectors, (12,).
    """
    answer = np.zeros(3 * len(parts))
    for k in range(len(answer)):
        move = step * np.eye(3)[k % 3]
        ends = []
        for sign in (1.0, -1.0):
            moved = list(parts)
            if k // 3 % 2:
                moved[k // 3] = Rotation.from_rotvec(sign * move).as_matrix() @ parts[k // 3]
            else:
                moved[k // 3] = parts[k // 3] + sign * move
            ends.append(function(*moved))
        answer[k] = (ends[1] - ends[0]) / (2.0 * step)
    return answer


@pytest.mark.parametrize('kind', KINDS)
def test_force_is_minus_the_gradient_of_the_energy(kind):
    rng = np.random.default_rng(1)
    for _ in range(12):
        parts = overlapping(kind, rng, low=-3.0)
        touching, out = touch(*parts)
        assert touching and out[10] > 1e-4
        # Where faces change over the second derivative jumps: an error of first order.
        step = 1e-4 * out[10]
        found = slope(lambda *moved: touch(*moved)[1][9], parts, step)
        assert np.abs(wrench(out) - found).max() < 3.0 * step + 1e-9


@pytest.mark.parametrize('kind', KINDS)
def test_moments_of_the_overlap_are_those_of_its_cells(kind):
    rng = np.random.default_rng(2)
    for _ in range(2):
        xa, ra, xb, rb = overlapping(kind, rng, low=-1.3, high=-0.6)
        assert by_polygons(xa, ra, xb, rb)[0]
        found = SCRATCH.room[SUMS + M0], SCRATCH.room[SUMS + M1]
        assert found == pytest.approx(moments(half_spaces(xa, ra), half_spaces(xb, rb)), rel=1e-7)


@pytest.mark.parametrize('kind', KINDS)
def test_walk_over_polygons_leaves_none_out(kind):
    rng = np.random.default_rng(13)
    for _ in range(60):
        xa, ra, xb, rb = overlapping(kind, rng, low=-5.0, high=-0.7)
        assert by_polygons(xa, ra, xb, rb)[0]
        sums = SCRATCH.room[SUMS:SUMS + SUM_COUNT]
        walked = sums.copy()
        sums[:] = 0.0
        add_all(SCRATCH.room, *(ra.T @ (xb - xa)))
        # Areas give the scale of torques, which may be 0.
        zeroth, first = np.abs(sums[S0:S1]).max(), np.abs(sums[S1:T0]).max()
        scales = [sums[M0], sums[M1]] + 2 * (3 * [zeroth] + 3 * [first]) + 4 * [sums[P1]]
        assert (np.abs(walked - sums) <= 1e-9 * np.array(scales)).all() and sums[M1] > 0.0


@pytest.mark.parametrize('kind', KINDS)
def test_closed_forms_are_what_all_polygons_say(kind):
    rng = np.random.default_rng(17)
    numbered = 0
    for _ in range(100):
        parts = overlapping(kind, rng, low=-6.0)
        touching, out = touch(*parts)
        wanted = by_polygons(*parts)[1]
        assert touching and np.abs(wrench(out) - wrench(wanted)).max() < 1e-13
        assert np.abs(out[9:11] - wanted[9:11]).max() < 1e-13
        # These are lengths beside the depth, whose last bits are those of the places.
        assert np.abs(out[15:18] - wanted[15:18]).max() < 1e-13 / out[10]
        assert abs(np.sqrt(out[18]) - np.sqrt(wanted[18])) < 1e-13 / out[10]
        numbered += out[19] > 0.0
    if kind in ('random', 'tilted face', 'vertex on face', 'edge on edge'):
        assert numbered > 90


def test_closed_forms_of_planes_are_what_all_polygons_say():
    rng = np.random.default_rng(18)
    for number in range(200):
        ra = Rotation.random(random_state=rng).as_matrix()
        own = (VERTICES[number % 12] / np.linalg.norm(VERTICES[0]), NORMALS[number % 20],
               np.eye(3)[number % 3])[number % 3]
        normal = -(ra @ own) + rng.choice([0.0, 1e-3, 0.1, 1.0]) * rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        xa = rng.normal(size=3)
        offset = ((VERTICES @ ra.T + xa) @ normal).min() + 10.0 ** rng.uniform(-6.0, -1.0)
        touching, out = touch_floor(normal, offset, xa, ra)
        wanted = floor_by_polygons(normal, offset, xa, ra)
        assert touching and np.abs(out[0:6] - wanted[0:6]).max() < 1e-13
        assert np.abs(out[9:11] - wanted[9:11]).max() < 1e-13
        assert np.abs(out[15:18] - wanted[15:18]).max() < 1e-13 / out[10]
        assert abs(np.sqrt(out[18]) - np.sqrt(wanted[18])) < 1e-13 / out[10]


@pytest.mark.parametrize('kind', KINDS)
def test_whatever_facet_was_kept_the_bits_are_the_same(kind):
    rng = np.random.default_rng(19)
    # Edges have numbers to 29, in 32 places.
    edges = [number for number in range(1, 959) if (number - 1) % 32 < 30]
    numbers = [*edges, *range(1024, 1044), *range(2048, 2068)]
    for _ in range(6):
        parts = overlapping(kind, rng, low=-8.0)
        wanted = touch(*parts)[1]
        for number in {int(wanted[19]), *rng.choice(numbers, 300)}:
            out = np.full(OUT_SIZE, np.nan)
            out[19] = number
            assert touch_pair_again(1.0, 1.0, *parts, SCRATCH, out)
            assert (out == wanted).all()


@pytest.mark.parametrize('kind', KINDS)
def test_bodies_push_each_other_alike(kind):
    rng = np.random.default_rng(3)
    for _ in range(20):
        xa, ra, xb, rb = overlapping(kind, rng, low=-9.0)
        touching, out = touch(xa, ra, xb, rb)
        assert touching
        # Nothing turns the pair as a whole.
        force, torque = out[0:3], out[3:6] + out[6:9] - np.cross(xb - xa, out[0:3])
        assert np.abs(torque).max() <= 1e-15 * np.abs(out[3:9]).max() + 1e-15 * out[10]
        assert force @ (xa - xb) > 0.4 * np.linalg.norm(force) * np.linalg.norm(xa - xb)
        swapped = touch(xb, rb, xa, ra)[1]
        assert (swapped[0:3] == -force).all() and (swapped[12:15] == -out[12:15]).all()
        assert (swapped[3:6] == out[6:9]).all() and (swapped[6:9] == out[3:6]).all()
        assert (swapped[9:12] == out[9:12]).all() and (swapped[15:18] == out[15:18]).all()


def test_motion_as_a_whole_turns_the_push_with_it():
    rng = np.random.default_rng(4)
    for kind in KINDS:
        xa, ra, xb, rb = overlapping(kind, rng)
        out = touch(xa, ra, xb, rb)[1]
        for _ in range(5):
            turn = Rotation.random(random_state=rng).as_matrix()
            shift = rng.normal(size=3)
            moved = touch(turn @ xa + shift, turn @ ra, turn @ xb + shift, turn @ rb)[1]
            assert moved[9:11] == pytest.approx(out[9:11], abs=1e-13)
            for k in (0, 3, 6):
                assert moved[k:k + 3] == pytest.approx(turn @ out[k:k + 3], abs=1e-13)
            # As well as it is known where there is little overlap.
            assert moved[15:18] == pytest.approx(turn @ out[15:18], abs=1e-14 / out[10])


@pytest.mark.parametrize('scale', [4.0 ** -5, 4.0 ** 5, 4.0 ** -40])
def test_lengths_times_a_power_of_two_give_the_same_bits(scale):
    rng = np.random.default_rng(5)
    for kind in KINDS:
        xa, ra, xb, rb = overlapping(kind, rng, low=-10.0)
        out = touch(xa, ra, xb, rb)[1]
        other = touch(scale * xa, ra, scale * xb, rb, half_edge=scale)[1]
        powers = np.array([1] * 3 + [2] * 7 + [1] * 2 + [0] * 3 + [1] * 3 + [4, 0])
        assert (other == out * scale ** powers).all() and out[10] > 0.0
        floor = touch_floor((0.0, 0.0, 1.0), -1.4, ORIGIN, ra)[1]
        other = touch_floor((0.0, 0.0, 1.0), -1.4 * scale, ORIGIN, ra, half_edge=scale)[1]
        assert (other == floor * scale ** powers).all() and floor[10] > 0.0


def test_face_on_face_is_a_spring_of_the_overlap():
    rng = np.random.default_rng(6)
    for overlap in (0.03, 1e-3, 1e-6, 1e-10):
        for _ in range(5):
            ra = Rotation.random(random_state=rng).as_matrix()
            normal = ra @ NORMALS[rng.integers(20)]
            rb = turned(facing(ra, NORMALS[rng.integers(20)], -normal), normal, rng.random())
            out = touch(ORIGIN, ra, (2.0 * RHO - overlap) * normal, rb)[1]
            # Beside the faces the shells fall back: a strip as wide as the overlap.
            assert out[10] == pytest.approx(overlap, rel=2.0 * overlap, abs=1e-14)
            assert out[11] == pytest.approx(overlap, abs=1e-14)
            assert out[9] == 0.5 * out[10] ** 2
            assert out[0:3] == pytest.approx(-overlap * normal, abs=4.0 * overlap ** 2 + 2e-14)
            floor = touch_floor(normal, 0.0, (RHO - overlap) * normal, facing(
                ra, NORMALS[3], -normal))[1]
            assert floor[10] == pytest.approx(overlap, rel=2.0 * overlap, abs=1e-14)
            assert floor[0:3] == pytest.approx(overlap * normal, abs=4.0 * overlap ** 2 + 2e-14)


def test_vertex_on_a_plane():
    # At height y above the vertex the shell is a pentagon in which the depth below the faces
    # falls from y sin(alpha) on the axis to 0, alpha between axis and faces; a part s^2 of
    # its area has less than s of the way to the rim.
    axis = VERTICES[0] / np.linalg.norm(VERTICES[0])
    sine = RHO / np.linalg.norm(VERTICES[0])

    def slice_of(y):
        kink = min(1.0, max(0.0, 1.0 - (1.0 - y) / (y * sine)))
        # Depth below the plane within the kink, below the faces outside.
        inner = (1.0 - y) * kink ** 2
        outer = y * sine * ((1.0 - kink ** 2) - 2.0 / 3.0 * (1.0 - kink ** 3))
        return 3.0 * y ** 2 * (inner + outer)

    mean = quad(slice_of, 0.0, 1.0, points=[1.0 / (1.0 + sine)], epsabs=1e-13)[0]
    ratio = 4.0 * mean
    assert 0.4 < ratio < 0.5
    for overlap in (0.2, 1e-3, 1e-9):
        place = np.array([3.0, -2.0, 5.0])
        offset = -axis @ (place + VERTICES[0]) + overlap
        touching, out = touch_floor(-axis, offset, place, np.eye(3))
        assert touching and out[11] == pytest.approx(overlap, abs=1e-14)
        assert out[10] == pytest.approx(ratio * overlap, abs=1e-14)
        # U = (ratio overlap)^2 / 2, so the plane pushes with ratio^2 overlap.
        assert out[0:3] == pytest.approx(-ratio ** 2 * overlap * axis, abs=1e-13)
        assert np.abs(out[3:6]).max() < 1e-13


def test_edge_across_edge_pushes_along_their_common_normal():
    rng = np.random.default_rng(7)
    for overlap in (0.05, 1e-4, 1e-8):
        for angle in (0.2, 0.9, np.pi / 2.0):
            ra = Rotation.random(random_state=rng).as_matrix()
            normal = ra @ np.array([0.0, 0.0, 1.0])
            rb = turned(turned(ra, ra @ np.array([1.0, 0.0, 0.0]), np.pi), normal, angle)
            midradius = (1.0 + np.sqrt(5.0)) / 2.0
            touching, out = touch(ORIGIN, ra, (2.0 * midradius - overlap) * normal, rb)
            assert touching and out[11] == pytest.approx(overlap, abs=1e-14)
            along = out[0:3] @ normal
            assert out[0:3] == pytest.approx(along * normal, abs=1e-12 * overlap + 1e-15)
            assert np.abs(out[3:9]).max() < 1e-12 * overlap + 1e-14
            # The energy is quadratic in the overlap as long as no other edge takes part.
            if angle > 0.5:
                assert along == pytest.approx(-out[10] ** 2 / overlap, rel=1e-6, abs=1e-14)


def test_plane_pushes_as_its_energy_says():
    rng = np.random.default_rng(8)
    for _ in range(40):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        xa, ra = rng.normal(size=3), Rotation.random(random_state=rng).as_matrix()
        low = (VERTICES @ ra.T + xa) @ normal
        offset = low.min() + 10.0 ** rng.uniform(-3.0, -0.3)
        touching, out = touch_floor(normal, offset, xa, ra)
        assert touching and out[11] == pytest.approx(offset - low.min(), abs=1e-13)
        step = 1e-4 * out[10]
        found = slope(lambda *moved, n=normal, o=offset: touch_floor(n, o, *moved)[1][9],
                      (xa, ra), step)
        assert np.abs(out[0:6] - found).max() < 3.0 * step + 1e-9
        if offset - low.min() > 0.1:
            floor_by_polygons(normal, offset, xa, ra)
            plane = np.append(normal, -offset)[None]
            found = SCRATCH.room[SUMS + M0], SCRATCH.room[SUMS + M1]
            assert found == pytest.approx(moments(half_spaces(xa, ra), plane), rel=1e-7)


def test_sliding_and_first_touch_are_smooth():
    # Second derivatives are below 7 (docs/contact.md), so forces change by no more than that times
    # the step, whichever features pass each other; those along the way are below 5.
    rng = np.random.default_rng(9)
    step = 1e-3
    for _ in range(6):
        ra, rb, way = pose('tilted face', rng)
        side = np.cross(way, rng.normal(size=3))
        side /= np.linalg.norm(side)
        before, pushed, parted = None, 0, 0
        for k in range(-2600, 2600):
            place = (2.0 * RHO - 0.02) * way + step * k * side
            touching, out = touch(ORIGIN, ra, place, turned(rb, side, 0.3 * step * k))
            now = wrench(out)
            if before is not None:
                assert np.abs(now - before).max() < 5.0 * 1.6 * step
            pushed, parted = pushed + touching, parted + (not touching)
            before = now
        assert pushed > 300 and parted > 300
    # First touch: the force grows from nothing.
    for kind in KINDS:
        ra, rb, way = pose(kind, rng)
        touched = first_touch(ra, rb, way)
        for depth in 10.0 ** np.arange(-15.0, -2.0):
            out = touch(ORIGIN, ra, (touched - depth) * way, rb)[1]
            assert np.isfinite(out).all()
            assert np.abs(out[0:9]).max() < 5.0 * (depth + 1e-15)


def test_second_derivatives_are_bounded_whatever_touches():
    rng = np.random.default_rng(10)
    largest, ratio = 0.0, 0.0
    for kind in KINDS:
        for _ in range(15):
            parts = overlapping(kind, rng, low=-6.0)
            touching, out = touch(*parts)
            assert touching
            step = 1e-4 * out[10]
            hessian = np.zeros((12, 12))
            for k in range(12):
                ends = []
                for sign in (1.0, -1.0):
                    moved = list(parts)
                    move = sign * step * np.eye(3)[k % 3]
                    moved[k // 3] = (Rotation.from_rotvec(move).as_matrix() @ parts[k // 3]
                                     if k // 3 % 2 else parts[k // 3] + move)
                    ends.append(wrench(touch(*moved)[1]))
                hessian[k] = (ends[1] - ends[0]) / (2.0 * step)
            found = np.linalg.eigvalsh((hessian + hessian.T) / 2.0)[-1]
            largest = max(largest, found)
            # The part that is known from the push: |grad delta|^2.
            ratio = max(ratio, found * out[10]**2 / (wrench(out)**2).sum())
    # Steps that run through contacts count 1.75; 1.65 is the largest of 1,350.
    assert 1.0 < ratio < 1.75
    # 4.6 is the largest of 9,500, a face that lies on a face and rocks; climbing found 6.7.
    assert 2.0 < largest < 5.0


def test_coinciding_centres_are_reported_as_deep_and_push_nowhere():
    rng = np.random.default_rng(11)
    ra, rb = (Rotation.random(random_state=rng).as_matrix() for _ in range(2))
    for place in (ORIGIN, np.array([1e-9, 0.0, 0.0])):
        touching, out = touch(ORIGIN, ra, place, rb)
        assert touching and (out[0:9] == 0.0).all()
        assert out[10] == pytest.approx(RHO) and out[11] == pytest.approx(2.0 * RHO)
    for distance in 10.0 ** np.arange(-5.0, 0.4, 0.2):
        touching, out = touch(ORIGIN, ra, distance * np.array([0.6, 0.0, -0.8]), rb)
        assert touching and np.isfinite(out).all()
        assert out[11] > 2.0 * RHO - 1.1 * distance - 1e-9
