# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Collisions, damping and friction of single pairs, by the laws of contact and nothing else."""

from contact_poses import (
    facing,
    first_touch,
    KINDS,
    NORMALS,
    pose,
    RHO,
    touch,
    touch_floor,
    turned,
    VERTICES,
)
from icofabric_sim import contact
from icofabric_sim.terms.contacts import laws
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

REST = np.zeros(3)
# Mass and inertia of the bodies here, lengths over a: about those of a thin shell.
MASS, INERTIA = 1.0, 1.7


def bounce(normal, rotation, velocity, spin, stiffness, damping=0.0):
    """Velocity and angular velocity after a shell has left a plane through the origin."""
    low = (VERTICES @ rotation.T @ normal).min()
    start = np.concatenate(
        [-low * normal, velocity, spin, Rotation.from_matrix(rotation).as_quat()])

    def rates(_, y):
        q = y[9:] / np.linalg.norm(y[9:])
        touching, out = touch_floor(normal, 0.0, y[:3], Rotation.from_quat(q).as_matrix())
        rate = laws.depth_rate(out, y[3:6], y[6:9], REST, REST)
        c = laws.effective_damping(damping, rate, out[10], 1.0 / np.sqrt(stiffness))
        push = stiffness * laws.damping_factor(c, rate) * out[:6]
        turn = 0.5 * quaternion_product(y[6:9], q)
        return np.concatenate([y[3:6], push[:3] / MASS, push[3:] / INERTIA, turn])

    def left(t, y):
        q = y[9:] / np.linalg.norm(y[9:])
        height = normal @ y[:3] + (VERTICES @ Rotation.from_quat(q).as_matrix().T @ normal).min()
        return height if t > 0.0 else -1.0

    left.terminal, left.direction = True, 1.0
    end = solve_ivp(rates, (0.0, 40.0 / np.sqrt(stiffness)), start, method='DOP853', rtol=1e-10,
                    atol=1e-13, events=left, max_step=0.1 / np.sqrt(stiffness))
    assert end.status == 1
    return end.y[3:6, -1], end.y[6:9, -1]


def quaternion_product(spin, q):
    x, y, z, w = q
    a, b, c = spin
    return np.array([a * w + b * z - c * y, b * w + c * x - a * z, c * w + a * y - b * x,
                     -(a * x + b * y + c * z)])


def rigid_bounce(normal, rotation, velocity, spin):
    """The same by one impulse at the lowest vertex, without loss."""
    arms = VERTICES @ rotation.T
    arm = arms[np.argmin(arms @ normal)]
    lever = np.cross(arm, normal)
    impulse = -2.0 * (normal @ velocity + lever @ spin) / (1.0 / MASS + lever @ lever / INERTIA)
    return velocity + impulse * normal / MASS, spin + impulse * lever / INERTIA


def test_collisions_become_those_of_rigid_bodies_as_contact_stiffens():
    normal = np.array([0.0, 0.0, 1.0])
    rotation = turned(facing(np.eye(3), VERTICES[0], -normal), (0.3, 1.0, 0.1), 0.2)
    velocity, spin = np.array([0.3, -0.2, -1.0]), np.array([0.4, 0.5, -0.3])
    rigid = np.concatenate(rigid_bounce(normal, rotation, velocity, spin))
    errors = []
    for stiffness in (1.6e5, 2.56e6, 4.096e7, 6.5536e8):
        found = np.concatenate(bounce(normal, rotation, velocity, spin, stiffness))
        # No loss, and nothing along the plane.
        assert MASS * found[:3] @ found[:3] + INERTIA * found[3:] @ found[3:] == pytest.approx(
            MASS * velocity @ velocity + INERTIA * spin @ spin, rel=1e-8)
        assert found[:2] == pytest.approx(velocity[:2], abs=1e-12)
        errors.append(np.abs(found - rigid).max())
    # It lasts as long as 1 / sqrt(K): 4 times less for 16 times the stiffness.
    ratios = np.array(errors[:-1]) / errors[1:]
    assert ratios == pytest.approx([4.0, 4.0, 4.0], rel=0.1)
    assert errors[-1] < 1e-3


@pytest.mark.parametrize('damping', [0.05, 0.5, 3.0])
def test_restitution_is_what_the_damping_says(damping):
    # A vertex straight onto a plane: delta is 0.44 times the overlap.
    normal = np.array([0.0, 0.0, 1.0])
    rotation = facing(np.eye(3), VERTICES[0], -normal)
    out = touch_floor(normal, 0.0, (np.linalg.norm(VERTICES[0]) - 1e-3) * normal, rotation)[1]
    share = out[10] / 1e-3
    for speed in (0.2, 1.0):
        velocity, spin = bounce(normal, rotation, -speed * normal, REST, 1e6, damping)
        expected = contact.restitution(damping, share * speed)
        # The slider that damps slow contacts acts here too, where delta hardly changes.
        assert velocity[2] / speed == pytest.approx(
            expected, abs=3e-5 if damping * share * speed < 0.01 else 1e-6)
        assert np.abs(velocity[:2]).max() < 1e-9 and np.abs(spin).max() < 1e-9
        assert 0.05 < expected < 0.999
        assert contact.damping_for(expected, share * speed) == pytest.approx(damping, rel=1e-9)


def test_restitution_in_its_limits():
    assert contact.restitution(0.0, 1.0) == 1.0 and contact.damping_for(1.0, 2.0) == 0.0
    # Slow collisions: the slider withholds a thousandth of the push.
    assert contact.restitution(1e-7, 1.0) == pytest.approx(np.sqrt(0.999 / 1.001), abs=1e-9)
    assert contact.restitution(2e-3, 1.0) == pytest.approx(1.0 - 2.0 * 2e-3 / 3.0, abs=2e-6)
    assert contact.restitution(1e6, 1.0) == pytest.approx(1e-6)
    with pytest.raises(ValueError, match='below 0.999, which damped contacts return at most'):
        contact.damping_for(0.9995, 1.0)
    for bad in (lambda: contact.restitution(-1.0, 1.0), lambda: contact.restitution(1.0, 0.0),
                lambda: contact.damping_for(0.0, 1.0), lambda: contact.damping_for(0.5, -1.0)):
        with pytest.raises(ValueError, match='must be'):
            bad()


@pytest.mark.parametrize('kind', KINDS)
def test_rate_of_the_depth_is_its_derivative_and_damping_takes_energy(kind):
    rng = np.random.default_rng(1)
    for _ in range(5):
        ra, rb, way = pose(kind, rng)
        xa, xb = REST, (first_touch(ra, rb, way) - 10.0 ** rng.uniform(-3.0, -1.5)) * way
        out = touch(xa, ra, xb, rb)[1]
        va, wa, vb, wb = rng.normal(size=(4, 3))
        h = 1e-5 * out[10]
        ends = [touch(xa + s * va, Rotation.from_rotvec(s * wa).as_matrix() @ ra, xb + s * vb,
                      Rotation.from_rotvec(s * wb).as_matrix() @ rb)[1][10] for s in (h, -h)]
        rate = laws.depth_rate(out, va, wa, vb, wb)
        assert rate == pytest.approx((ends[0] - ends[1]) / (2.0 * h), rel=1e-4, abs=1e-4)
        for damping in (0.1, 10.0):
            c = laws.effective_damping(damping, rate, out[10], 1e-3)
            assert c >= damping
            factor = laws.damping_factor(c, rate)
            assert factor >= 0.0
            # Power of what the damping adds to the push.
            push = (factor - 1.0) * out
            power = (push[:3] @ (va - vb) + push[3:6] @ wa + push[6:9] @ wb)
            assert power <= 0.0
    assert laws.depth_rate(np.zeros(19), va, wa, vb, wb) == 0.0


def contact_points(out, xa, xb):
    """Arms of the contact point from both centres."""
    half = (np.asarray(xb) - xa) / 2.0
    return half + out[15:18], out[15:18] - half


@pytest.mark.parametrize('kind', KINDS)
def test_contact_point_is_in_both_shells_and_slip_is_along_the_surface(kind):
    rng = np.random.default_rng(2)
    ra, rb, way = pose(kind, rng)
    xa, xb = rng.normal(size=(1, 3))[0], REST
    xb = xa + (first_touch(ra, rb, way) - 0.02) * way
    out = touch(xa, ra, xb, rb)[1]
    arm_a, arm_b = contact_points(out, xa, xb)
    assert xa + arm_a == pytest.approx(xb + arm_b)
    assert (NORMALS @ ra.T @ arm_a).max() < RHO and (NORMALS @ rb.T @ arm_b).max() < RHO
    # The push acts there, but for a small arm: it goes through the overlap.
    assert np.abs(np.cross(arm_a, out[0:3]) - out[3:6]).max() < 0.5 * out[10]
    va, wa, vb, wb = rng.normal(size=(4, 3))
    normal, slip = laws.slip(out, va, wa, arm_a, vb, wb, arm_b)
    whole = vb + np.cross(wb, arm_b) - va - np.cross(wa, arm_a)
    assert np.dot(normal, slip) == pytest.approx(0.0, abs=1e-14)
    assert np.linalg.norm(normal) == pytest.approx(1.0) and np.dot(normal, xb - xa) > 0.0
    assert whole - (whole @ normal) * np.array(normal) == pytest.approx(np.array(slip), abs=1e-14)
    # A common motion slips nowhere.
    _, slip = laws.slip(out, va + np.cross(wa, xa), wa, arm_a, va + np.cross(wa, xb), wa, arm_b)
    assert np.abs(slip).max() < 1e-14
    nothing = laws.slip(np.zeros(19), va, wa, arm_a, vb, wb, arm_b)
    assert not np.array(nothing).any()


UP = (0.0, 0.0, 1.0)


def pulled(pull, duration=40.0, friction=0.5, load=1.0, stiffness=100.0):
    """
    Place, velocity and stretch of a unit mass that is pulled along a surface and pressed onto it.
    """
    limit, lag = friction * load / stiffness, 1.0 / np.sqrt(stiffness)

    def rates(t, y):
        stretch = (y[2], 0.0, 0.0, 0.0)
        q = laws.pull(stretch, (y[1], 0.0, 0.0, 0.0), lag, UP, limit)
        rate = laws.stretch_rate(stretch, q, lag, (0.0, 0.0, 0.0))
        return [y[1], pull(t) - stiffness * q[0], rate[0]]

    end = solve_ivp(rates, (0.0, duration), [0.0, 0.0, 0.0], rtol=1e-10, atol=1e-13, max_step=0.05)
    return end.y[:, -1]


def test_friction_sticks_below_its_limit_and_slides_above():
    # 0.99 of the limit, laid on slowly: as far as the spring gives way, and no further.
    short = pulled(lambda t: 0.495 * min(1.0, t / 5.0))
    long = pulled(lambda t: 0.495 * min(1.0, t / 5.0), duration=200.0)
    assert short[0] == pytest.approx(0.495 / 100.0, rel=1e-3) and abs(short[1]) < 1e-9
    assert long[0] == pytest.approx(short[0], rel=1e-9)
    # Twice the limit: what is left of the pull accelerates.
    place, velocity, stretch = pulled(lambda t: 1.0, duration=20.0)
    assert velocity == pytest.approx(0.5 * 20.0, rel=5e-3) and place > 90.0
    assert stretch == pytest.approx(0.005, rel=1e-9)


def test_friction_loses_energy_whatever_happens():
    rng = np.random.default_rng(3)
    stretch, lag, sliding = (0.0, 0.0, 0.0, 0.0), 0.02, 0
    for k in range(20_000):
        if k % 50 == 0:
            slip, limit = rng.normal(size=3), 0.1 * rng.random()
            normal = rng.normal(size=3)
            normal /= np.linalg.norm(normal)
        v = (*laws.along(slip, normal), slip[2])
        q = laws.pull(stretch, v, lag, normal, limit)
        assert np.linalg.norm(q) <= limit * (1.0 + 1e-12)
        sliding += np.linalg.norm(q) > 0.999 * limit
        # What goes in is stored or lost; to turn with the pair costs nothing.
        for spin in ((0.0, 0.0, 0.0), (0.2, -0.5, 0.3)):
            rate = laws.stretch_rate(stretch, q, lag, spin)
            assert np.dot(q, v) - np.dot(stretch, rate) >= -1e-15
        stretch = tuple(s + 1e-4 * r for s, r in zip(stretch, rate))
    assert 2_000 < sliding < 18_000


def test_a_patch_resists_being_spun_at_two_thirds_of_its_radius():
    normal, rotation = np.array(UP), facing(np.eye(3), NORMALS[0], [0.0, 0.0, -1.0])
    for half_edge in (1.0, 1e-3):
        out = touch_floor(normal, 0.0, half_edge * (RHO - 1e-4) * normal, rotation, half_edge)[1]
        area = np.sqrt(3.0) * half_edge**2
        assert laws.patch_radius(out) == pytest.approx(
            2.0 / 3.0 * np.sqrt(area / np.pi), rel=1e-3)
    assert laws.patch_radius(np.zeros(19)) == 0.0
