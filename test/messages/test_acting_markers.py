# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What viewers are shown of loads, supports, planes, contacts: read back as rclpy does."""
import icofabric_sim as ico
from icofabric_sim.messages.topics import MARKERS, Outputs, Recorded
import numpy as np
import pytest
from runner_helpers import ListSink, make_runner, push, run

rclpy = pytest.importorskip('rclpy', reason='rclpy is not installed on this machine')

SCENE = {
    'weave': {'size': [3, 3, 3]}, 'groups': {'wall': 'x_min', 'tip': 'x_max'},
    'supports': {'wall': {'group': 'wall', 'fix': 'tx'}},
    'loads': {'tip': {'group': 'tip', 'share': 'total', 'point': [0.0, 0.0, 0.001]}},
    'planes': {'floor': {'normal': [0.0, 0.0, 2.0], 'offset': -0.2}},
}


def read(data):
    from rclpy.serialization import deserialize_message
    from visualization_msgs.msg import MarkerArray
    message = deserialize_message(data, MarkerArray)
    return {marker.ns: marker for marker in message.markers}


def points(marker):
    return np.array([[point.x, point.y, point.z] for point in marker.points])


def test_forces_supports_and_planes_are_where_they_act():
    scene = ico.Scene.from_parameters(SCENE)
    simulation = ico.compile_scene(scene)
    simulation.apply_wrench('tip', force=(0.0, 3.0, 0.0))
    simulation.apply_body_wrench(2, torque=(0.0, 0.0, 1.0))
    simulation.advance_to(0.0)
    snapshot = simulation.snapshot()
    shown = read(Outputs(scene).markers(
        snapshot, 1_500_000_000, simulation.status.active_loads, simulation.status.touching()))
    assert [name for name, marker in shown.items() if marker.action == 0] == [
        'forces', 'torques', 'supports', 'planes', 'plane_surfaces']
    assert list(shown)[5:] == ['contacts', 'contact_normals', 'contact_forces']
    for marker in list(shown.values())[:5]:
        assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == (1, 500_000_000)
        assert marker.header.frame_id == 'world' and marker.action == 0
        assert marker.color.a > 0.0 and marker.scale.x > 0.0 and marker.pose.orientation.w == 1.0
    lines = points(shown['forces']).reshape(-1, 2, 3)
    tip = scene.groups['tip']
    np.testing.assert_allclose(
        lines[:, 0], scene.position[tip] + np.array([0.0, 0.0, 0.001]), atol=1e-12)
    np.testing.assert_allclose(
        lines[:, 1] - lines[:, 0], np.tile([0.0, 0.04, 0.0], (len(tip), 1)), atol=1e-12)
    assert len(points(shown['torques'])) == 2
    np.testing.assert_allclose(points(shown['supports']), scene.position[scene.groups['wall']])
    floor = points(shown['planes'])
    assert len(floor) > 8
    np.testing.assert_allclose(floor[:, 2], -0.1, atol=1e-12)
    # Two triangles, seen from both sides, that fill what the lines span; RViz scales the points.
    surface = points(shown['plane_surfaces'])
    assert len(surface) == 12 and shown['plane_surfaces'].scale.x == 1.0
    np.testing.assert_allclose(surface.min(axis=0), floor.min(axis=0), atol=1e-12)
    np.testing.assert_allclose(surface.max(axis=0), floor.max(axis=0), atol=1e-12)
    corners = surface.reshape(4, 3, 3)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert sorted(np.sign(across[:, 2])) == [-1.0, -1.0, 1.0, 1.0]


def test_contacts_are_shown_where_shells_press_on_a_floor():
    scene = ico.load_scene('dropped_slab')
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.2)
    while not len(simulation.status.touching().overlap):
        assert simulation.time < 0.22
        simulation.advance_to(simulation.time + 0.0005)
    touching, snapshot = simulation.status.touching(), simulation.snapshot()
    shown = read(Outputs(scene).markers(snapshot, 0, {}, touching))
    spots = points(shown['contacts'])
    normals = points(shown['contact_normals']).reshape(-1, 2, 3)
    assert len(spots) == len(normals) == len(touching.overlap) and spots.any()
    np.testing.assert_allclose(normals[:, 0], spots)
    np.testing.assert_allclose(
        np.linalg.norm(normals[:, 1] - normals[:, 0], axis=1), scene.shell.edge_length)
    arrows = points(shown['contact_forces']).reshape(-1, 2, 3)
    shells = touching.bodies[:, 1] >= 0
    assert len(arrows) == len(spots) + shells.sum()
    np.testing.assert_allclose(arrows[:, 0], [*spots, *spots[shells]])
    along = arrows[:, 1] - arrows[:, 0]
    whole = touching.force + touching.spring
    np.testing.assert_allclose(
        along, 0.04 * np.array([*whole, *-whole[shells]]) / np.linalg.norm(whole, axis=1).max(),
        rtol=0, atol=1e-12)
    for number, (first, second) in enumerate(touching.bodies):
        assert touching.overlap[number] > 0.0 and np.linalg.norm(touching.force[number]) > 0.0
        if second < 0:
            assert touching.describe(number) == f'body {first} and plane floor'
            assert abs(spots[number, 2] + 0.05) < 1e-3
            np.testing.assert_allclose(
                normals[number, 1] - normals[number, 0], [0.0, 0.0, 0.02], atol=1e-9)
            below = snapshot.position[first] - spots[number]
            assert np.hypot(*below[:2]) < 0.02 and 0.01 < below[2] < 0.025
    assert (touching.bodies[:, 1] < 0).any()


def test_what_is_not_there_is_removed():
    scene = ico.Scene.from_parameters({'weave': {'size': [2, 2, 2]}})
    simulation = ico.compile_scene(scene)
    shown = read(Outputs(scene).markers(
        simulation.snapshot(), 0, {}, simulation.status.touching()))
    assert all(marker.action == 2 and not marker.points for marker in shown.values())


def test_they_are_built_for_a_listener_at_the_rate_of_markers():
    runner = make_runner(sink := ListSink(MARKERS), marker_rate=100.0)
    push(runner, stamp=50_000_000)
    run(runner)
    times = {time for time, _ in sink.of(MARKERS)}
    assert times == set(range(0, 100_000_001, 10_000_000))
    assert read(sink.of(MARKERS)[-1][1])['forces'].action == 0
    assert read(sink.of(MARKERS)[0][1])['forces'].action == 2
    assert MARKERS.recorded is Recorded.NEVER and not MARKERS.latched
