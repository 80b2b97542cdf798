# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Contact sees what a general collision library sees (coal, the successor of FCL)."""

from contact_poses import first_touch, half_spaces, KINDS, pose
from icofabric_sim import contact
from icofabric_sim.geometry.icosahedron import FACES, vertices
import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

coal = pytest.importorskip('coal', reason='make test installs it')
COUNT = 200_000
# Lengths over a; its own searches end at this. In a few degenerate poses they fail altogether.
ACCURACY = 1e-6


def many_pairs(rng):
    """Half of the pairs at random near each other, half in and about degenerate poses."""
    half = COUNT // 2
    turns = Rotation.random(COUNT, random_state=rng)
    others = Rotation.random(half, random_state=rng).as_matrix()
    ways = rng.normal(size=(half, 3))
    ways *= (rng.uniform(2.6, 4.2, size=half) / np.linalg.norm(ways, axis=1))[:, None]
    first, second, shift = [np.eye(3)[None].repeat(half, axis=0)], [others], [ways]
    bases = half // 250
    for k in range(bases):
        ra, rb, way = pose(KINDS[k % len(KINDS)], rng)
        touched = first_touch(ra, rb, way)
        depth = 10.0 ** rng.uniform(-15.0, -0.3, size=250) * rng.choice([-1.0, 1.0], size=250)
        depth[:10] = 0.0
        first.append(ra[None].repeat(250, axis=0))
        second.append(rb[None].repeat(250, axis=0))
        shift.append((touched + depth)[:, None] * way)
    # All are turned and shifted as a whole, the degenerate ones half of the time.
    turn = turns.as_matrix()
    turn[half::2] = np.eye(3)
    ra, rb = turn @ np.concatenate(first), turn @ np.concatenate(second)
    xa = rng.normal(size=(COUNT, 3))
    xa[half::4] = 0.0
    xb = xa + np.einsum('nij,nj->ni', turn, np.concatenate(shift))
    return xa, ra, xb, rb


def test_no_touching_pair_is_missed_and_distances_agree():
    xa, ra, xb, rb = many_pairs(np.random.default_rng(12))
    qa, qb = (Rotation.from_matrix(r).as_quat() for r in (ra, rb))
    ra, rb = (Rotation.from_quat(q).as_matrix() for q in (qa, qb))
    found = contact.separation(1.0, (xa, qa), (xb, qb))
    push = contact.contact_force(1.0, (xa, qa), (xb, qb), 1.0)
    expected = coal_distances(xa, ra, xb, rb)
    difference = np.abs(found.distance - expected)
    good = difference < 3.0 * ACCURACY
    assert np.percentile(difference[:COUNT // 2], 99.0) < 1e-13 and good.mean() > 0.998
    assert push.in_contact[good & (expected < -3.0 * ACCURACY)].all()
    assert not push.in_contact[good & (expected > 3.0 * ACCURACY)].any()
    # Where it fails a linear program decides.
    for k in np.flatnonzero(~good):
        depth = ball_inside_both(xa[k], ra[k], xb[k], rb[k])
        assert (depth > 0.0) == (found.distance[k] < 0.0) or abs(found.distance[k]) < 1e-8
    # Between those, by our own distance, to rounding.
    assert push.in_contact[found.distance < -1e-13].all()
    assert not push.in_contact[found.distance > 1e-13].any()
    assert 0.3 < push.in_contact.mean() < 0.7
    assert (np.abs(found.distance) < 1e-9).sum() > 10_000
    # The axis is what the distance says.
    low = np.einsum('nij,vj->nvi', rb[:2000], vertices(1.0)) + xb[:2000, None]
    high = np.einsum('nij,vj->nvi', ra[:2000], vertices(1.0)) + xa[:2000, None]
    gap = (np.einsum('nvi,ni->nv', low, found.axis[:2000]).min(axis=1)
           - np.einsum('nvi,ni->nv', high, found.axis[:2000]).max(axis=1))
    assert gap == pytest.approx(found.distance[:2000], abs=1e-10)


def ball_inside_both(xa, ra, xb, rb):
    """Radius of the largest ball inside two shells; negative: what each lacks in thickness."""
    rows = np.concatenate([half_spaces(xa, ra), half_spaces(xb, rb)])
    found = linprog([0, 0, 0, -1.0], A_ub=np.c_[rows[:, :3], np.ones(40)], b_ub=-rows[:, 3],
                    bounds=[(None, None)] * 4, method='highs')
    assert found.status == 0
    return found.x[3]


def coal_distances(xa, ra, xb, rb):
    """Signed distances by the library's own searches (GJK and EPA)."""
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in vertices(1.0):
        points.append(vertex)
    for face in FACES:
        triangles.append(coal.Triangle(*map(int, face)))
    shell = coal.Convex(points, triangles)
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = request.epa_tolerance = ACCURACY
    request.gjk_max_iterations = request.epa_max_iterations = 1000
    measure = coal.ComputeDistance(shell, shell)
    answer = np.zeros(len(xa))
    for k in range(len(xa)):
        result.clear()
        answer[k] = measure(coal.Transform3s(ra[k], xa[k]), coal.Transform3s(rb[k], xb[k]),
                            request, result)
    return answer
