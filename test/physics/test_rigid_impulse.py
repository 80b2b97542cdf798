# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Two shells that meet in one point leave as rigid bodies by one impulse of restitution 1 do."""

from contact_scenes import A, loose
import icofabric_sim as ico
from icofabric_sim import contact
from icofabric_sim.geometry.icosahedron import vertices
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

CORNERS = vertices(A)
STIFFNESSES = (1.6e6, 2.56e7, 4.096e8)


def vertex_on_face():
    """
    Point and normal on the first body, and orientation and arm of the second, at first touch.
    """
    hull = ConvexHull(CORNERS)
    normal = hull.equations[7, :3]
    corners = CORNERS[hull.simplices[7]]
    # Not in the middle of the face, and not above the centre of either body.
    point = np.array([0.5, 0.3, 0.2]) @ corners
    aligned, _ = Rotation.align_vectors([-normal], [CORNERS[0]])
    turned = Rotation.from_rotvec(0.3 * corners[0] / np.linalg.norm(corners[0])) * aligned
    return point, normal, turned, turned.apply(CORNERS[0])


def edge_across_edge():
    """The same of an edge on another, off the middle of both."""
    ends = sorted(np.flatnonzero(np.linalg.norm(CORNERS - CORNERS[0], axis=1) < 2.1 * A))
    one, other = CORNERS[0], CORNERS[[end for end in ends if end][0]]
    point = 0.4 * one + 0.6 * other
    outward = (one + other) / np.linalg.norm(one + other)
    # The same edge from the other side, turned by 70 degrees and tilted.
    along = (other - one) / np.linalg.norm(other - one)
    over = Rotation.from_rotvec(np.pi * along)
    turned = Rotation.from_rotvec([0.05, -0.1, 0.08]) * Rotation.from_rotvec(1.2 * outward) * over
    normal = np.cross(along, turned.apply(along))
    normal *= np.sign(normal @ outward) / np.linalg.norm(normal)
    return point, normal, turned, turned.apply(0.7 * one + 0.3 * other)


@pytest.mark.parametrize('meet', [vertex_on_face, edge_across_edge])
@pytest.mark.parametrize('across, spins', [
    ((0.0, 0.0, 0.0), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))),
    ((0.5, -0.7, 0.3), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))),
    ((0.2, 0.1, -0.3), ((30.0, -15.0, 40.0), (-20.0, 35.0, 10.0)))],
    ids=['head-on', 'oblique', 'spinning'])
def test_what_bodies_do_in_one_point_is_one_impulse(meet, across, spins):
    point, normal, turned, arm = meet()
    place = point - arm
    # They touch there, in that point alone, and along that normal.
    still = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    for gap in (1e-3, 1e-2):
        seen = contact.separation(
            A, still, (place + gap * A * normal, turned.as_quat()))
        assert seen.distance == pytest.approx(gap * A, rel=1e-6)
    across = np.array(across) - (np.array(across) @ normal) * normal
    velocity = np.array([0.25 * normal, across - 0.75 * normal])
    spin = np.array(spins)
    scene = loose((place + A, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    mass, inertia = scene.shell.mass, scene.shell.inertia
    levers = np.cross([point, arm], normal)
    approach = (velocity[0] - velocity[1]) @ normal + (
        spin[0] @ levers[0] - spin[1] @ levers[1])
    assert approach > 0.5
    push = 2.0 * approach / (2.0 / mass + (levers**2).sum() / inertia)
    sides = np.array([-1.0, 1.0])[:, None]
    expected = velocity + sides * push / mass * normal
    expected_spin = spin + sides * push * levers / inertia
    assert np.abs(expected_spin - spin).max() > 1.0

    # They come from 1 mm apart, so that they would be in this pose at first touch.
    way, errors = 1e-3, []
    before = [Rotation.from_rotvec(-way * turn) * pose for turn, pose in zip(
        spin, (Rotation.identity(), turned))]
    for stiffness in STIFFNESSES:
        simulation = ico.compile_scene(loose(
            (place + A, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), contact__stiffness=stiffness))
        simulation.set_state(
            position=np.array([-way * velocity[0], place - way * velocity[1]]),
            orientation=np.array([pose.as_quat() for pose in before]),
            linear_velocity=velocity, angular_velocity=spin)
        simulation.advance_to(1.5 * way)
        snapshot = simulation.snapshot()
        assert simulation.status.deepest_overlap > 0.0 and snapshot.energy['contact'] == 0.0
        errors.append(max(
            np.abs(snapshot.linear_velocity - expected).max(),
            A * np.abs(snapshot.angular_velocity - expected_spin).max()) / approach)
    # They turn and slide while they touch, for a time that falls as the root of the stiffness.
    orders = np.log2(np.array(errors[:-1]) / errors[1:]) / 4.0
    assert orders == pytest.approx(0.5, abs=0.02)
    assert errors[-1] < 1e-3
