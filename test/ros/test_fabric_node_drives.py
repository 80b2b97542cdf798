# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0

from recorded_runs import DRIVEN_SCENE
from ros_helpers import Client, NodeProcess, ros_class, write_scene


def test_node_moves_a_drive_by_its_topic(tmp_path):
    path = write_scene(tmp_path / 'scene.yaml', DRIVEN_SCENE)
    with NodeProcess(tmp_path / 'log', scene=path) as node, Client(node) as client:
        poses = client.listen('~/poses')
        publisher = client.publisher('~/drives/top', 'geometry_msgs/msg/TwistStamped')

        def send(frame='', x=0.01):
            message = ros_class('geometry_msgs/msg/TwistStamped')()
            message.header.frame_id = frame
            message.twist.linear.x = x
            publisher.publish(message)

        client.wait_for(lambda: poses, 'poses')
        for problem, said in (
                ({'frame': 'elsewhere'}, "a drive moves in the world frame, so it must be ''"),
                ({'x': float('nan')}, 'not finite')):
            send(**problem)
            client.wait_for(lambda: node.lines(said), said)  # noqa: B023
        # The driven bodies are the last; nothing has moved them yet.
        before = poses[-1].values[-1, 0]
        assert poses[0].values[-1, 0] == before
        send()
        client.wait_for(lambda: poses[-1].values[-1, 0] > before + 1e-3, 'the drive to move')
        assert node.stop() == 0
