# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Another process sees the bodies that a node is told to publish, and what is drawn of them."""

import icofabric_sim as ico
import numpy as np
from ros_helpers import Client, NodeProcess, ros_class, SCENES, write_scene
from scipy.spatial.transform import Rotation

CHOSEN = {'publish.group': 'tip', 'publish.stride': 2}


def test_poses_and_numbers_of_the_chosen_bodies_arrive(tmp_path):
    path, at_rest = SCENES / 'hanging_slab.yaml', {**CHOSEN, 'gravity': [0.0, 0.0, 0.0]}
    scene = ico.load_scene(path).with_changes(at_rest)
    with NodeProcess(tmp_path / 'log', scene=path, parameters=at_rest, offset=3) as node, (
            Client(node, offset=3)) as client:
        poses = client.next('~/poses').values
        assert len(poses) == len(scene.published_bodies) < scene.body_count
        numbers = client.next('~/bodies', latched=True).values
        assert np.array_equal(numbers, scene.published_bodies)
        start = scene.position[scene.published_bodies]
        # Nothing moves them, however late the message is.
        assert np.abs(poses[:, :3] - start).max() < 1e-6 * scene.geometry.pitch
        assert node.stop() == 0


def test_connectors_around_shells_and_spins_in_body_axes_arrive(tmp_path):
    """With the fields that RViz and Foxglove need to draw a line list."""
    sections = {
        'weave': {'size': [3, 3, 3]}, 'contact': {'mode': 'never'}, 'frame_id': 'lab',
        'connector': {'obstruction': 'wrap'}, 'groups': {'turned': 'level 1'},
        'initial': {'it': {'group': 'turned', 'rotation': [0.5, 0.4, 0.9],
                           'angular_velocity': [1.0, 2.0, 3.0]}},
        'start_paused': True}
    scene = ico.Scene.from_parameters(sections)
    snapshot = ico.compile_scene(scene).snapshot()
    segments = snapshot.connector_segments
    assert len(segments.of) > scene.connector_count + 5
    path = write_scene(tmp_path / 'scene.yaml', sections)
    with NodeProcess(tmp_path / 'log', scene=path, offset=3) as node, (
            Client(node, offset=3)) as client:
        markers, kind = {}, ros_class('visualization_msgs/msg/Marker')
        client.node.create_subscription(
            kind, '/icofabric/connectors', lambda marker: markers.update({marker.id: marker}), 20)
        client.wait_for(lambda: len(markers) == 6, lambda: f'markers; got {sorted(markers)}')
        spins = client.next('~/angular_velocity_body').values
        state = np.array(client.next('~/state').values)
        assert node.stop() == 0
    points = []
    for marker in markers.values():
        assert marker.header.frame_id == 'lab' and marker.ns == 'connectors'
        assert marker.type == kind.LINE_LIST and marker.pose.orientation.w == 1.0
        assert marker.action == (kind.ADD if marker.points else kind.DELETE)
        assert marker.scale.x > 0.0 and marker.color.a == 1.0 and not marker.colors
        assert (marker.lifetime.sec, marker.lifetime.nanosec) == (0, 0)
        assert len(marker.points) % 2 == 0
        points += [[point.x, point.y, point.z] for point in marker.points]
    lines, expected = (np.reshape(each, (-1, 6)) for each in (points, segments.ends))
    assert len(lines) == len(expected)
    assert np.array_equal(lines[np.lexsort(lines.T)], expected[np.lexsort(expected.T)])
    assert spins.shape == (scene.body_count, 3) and np.abs(spins).max() > 1.0
    np.testing.assert_allclose(
        spins, Rotation.from_quat(state[:, 3:7]).inv().apply(state[:, 10:]), atol=1e-14)
    assert np.abs(spins - state[:, 10:]).max() > 0.1
