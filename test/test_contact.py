# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Contact of single pairs for users: distances, pushes, and what is refused."""

from contact_poses import half_spaces, KINDS, NORMALS, pose, RHO, touch
from icofabric_sim import contact
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

HOME = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def test_faces_apart_and_in_each_other():
    half_edge, normal = 0.01, NORMALS[3].copy()
    other = Rotation.from_rotvec(np.pi * np.cross(normal, (0.0, 0.0, 1.0)) / np.linalg.norm(
        np.cross(normal, (0.0, 0.0, 1.0))))
    assert other.apply(normal) == pytest.approx(-normal)
    for gap in (0.004, 1e-9, -1e-9, -0.0005):
        place = (2.0 * RHO * half_edge + gap) * normal
        found = contact.separation(half_edge, HOME, (place, other.as_quat()))
        assert found.distance == pytest.approx(gap, abs=1e-16)
        assert found.axis == pytest.approx(normal, abs=1e-6)
        push = contact.contact_force(half_edge, HOME, (place, other.as_quat()), 2e4)
        assert push.in_contact == (gap < 0.0)
        if gap < 0.0:
            assert push.depth == pytest.approx(-gap, rel=0.1)
            assert push.energy == pytest.approx(0.5 * 2e4 * push.depth ** 2)
            assert push.force == pytest.approx(2e4 * gap * normal, rel=0.3, abs=1e-9)
        else:
            assert not push.force.any() and push.energy == 0.0 and push.depth == 0.0


@pytest.mark.parametrize('kind', KINDS)
def test_distance_is_the_least_between_points_of_both(kind):
    rng = np.random.default_rng(1)
    ra, rb, way = pose(kind, rng)
    qa, qb = Rotation.from_matrix(ra).as_quat(), Rotation.from_matrix(rb).as_quat()
    for centres in (3.85, 4.1):
        found = contact.separation(1.0, (np.zeros(3), qa), (centres * way, qb))
        one, two = half_spaces(np.zeros(3), ra), half_spaces(centres * way, rb)
        least = minimize(
            lambda x: 0.5 * np.sum((x[:3] - x[3:]) ** 2), np.r_[0.0 * way, centres * way],
            jac=lambda x: np.r_[x[:3] - x[3:], x[3:] - x[:3]], method='SLSQP', tol=1e-15,
            constraints=[
                {'type': 'ineq', 'fun': lambda x, r=rows, k=k: -(r[:, :3] @ x[k:k + 3] + r[:, 3]),
                 'jac': lambda x, r=rows, k=k: np.hstack(
                     [np.zeros((20, k)), -r[:, :3], np.zeros((20, 3 - k))])}
                for rows, k in ((one, 0), (two, 3))])
        assert found.distance == pytest.approx(np.sqrt(2.0 * least.fun), abs=1e-5)
        swapped = contact.separation(1.0, (centres * way, qb), (np.zeros(3), qa))
        assert swapped.distance == pytest.approx(found.distance, abs=1e-14)


def test_many_pairs_at_once():
    rng = np.random.default_rng(2)
    place = rng.normal(size=(50, 3))
    place *= (rng.uniform(2.9, 3.6, size=50) / np.linalg.norm(place, axis=1))[:, None]
    orientation = Rotation.random(50, random_state=rng).as_quat()
    many = contact.contact_force(1.0, HOME, (place, orientation), 3.0)
    gaps = contact.separation(1.0, HOME, (place, orientation))
    assert many.force.shape == many.torque_on_second.shape == gaps.axis.shape == (50, 3)
    assert many.energy.shape == gaps.distance.shape == (50,) and 5 < many.in_contact.sum() < 45
    assert (many.in_contact == (gaps.distance < 0.0)).all()
    assert (many.depth <= -gaps.distance + 1e-12)[many.in_contact].all()
    for k in range(0, 50, 7):
        one = contact.contact_force(1.0, HOME, (place[k], orientation[k]), 3.0)
        assert all((np.asarray(a) == b[k]).all() for a, b in zip(one, many))
        out = touch(np.zeros(3), np.eye(3), place[k], Rotation.from_quat(
            orientation[k]).as_matrix())[1]
        assert one.force == pytest.approx(3.0 * out[:3], abs=1e-14)


def test_plane_of_any_length_of_normal():
    push = contact.plane_contact_force(0.01, (0.0, 0.0, 2.0), -0.03, HOME, 1e3)
    again = contact.plane_contact_force(0.01, (0.0, 0.0, 1.0), -0.015, HOME, 1e3)
    assert push.in_contact and push.force[2] > 0.0 and (push.force == again.force).all()
    # An edge lies on the plane: symmetric.
    assert np.abs(push.force[:2]).max() < 1e-12 and np.abs(push.torque).max() < 1e-14
    away = contact.plane_contact_force(0.01, (0.0, 0.0, 1.0), -0.0170, HOME, 1e3)
    assert not away.in_contact and not away.force.any()


@pytest.mark.parametrize('arguments, words', [
    ((0.0, HOME, HOME, 1.0), 'half_edge must be a positive'),
    ((1.0, HOME, HOME, float('nan')), 'stiffness must be a positive'),
    ((1.0, ((0.0, 0.0), HOME[1]), HOME, 1.0), 'centre of first'),
    ((1.0, HOME, ((0.0, 0.0, float('inf')), HOME[1]), 1.0), 'centre of second'),
    ((1.0, HOME, (HOME[0], (0.0, 0.0, 0.0, 2.0)), 1.0), 'orientation of second'),
    ((1.0, (np.zeros((2, 3)), HOME[1]), (np.zeros((3, 3)), HOME[1]), 1.0), 'same number of rows'),
], ids=lambda value: value if isinstance(value, str) else '')
def test_what_cannot_be_a_pair_is_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        contact.contact_force(*arguments)
    with pytest.raises(ValueError, match='normal'):
        contact.plane_contact_force(1.0, (0.0, 0.0, 0.0), 0.0, HOME, 1.0)
