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


def test_node_moves_a_plane_and_reports_the_wrench_on_it(tmp_path):
    path = write_scene(tmp_path / 'scene.yaml', {
        'weave': {'size': [1, 1, 1]}, 'contact': {'stiffness': 1e4, 'friction': 0.3},
        'gravity': [0.0, 0.0, -9.81], 'planes': {'floor': {
            'normal': [0.0, 0.0, 1.0], 'offset': -0.01618, 'motion': 'hold'}}})
    with NodeProcess(tmp_path / 'log', scene=path) as node, Client(node) as client:
        poses = client.listen('~/poses')
        wrenches = []
        client.node.create_subscription(
            ros_class('geometry_msgs/msg/WrenchStamped'), '/icofabric/planes/floor/wrench',
            wrenches.append, 10)
        publisher = client.publisher('~/planes/floor', 'geometry_msgs/msg/TwistStamped')
        client.wait_for(lambda: wrenches, 'wrenches')
        message = ros_class('geometry_msgs/msg/TwistStamped')()
        message.twist.angular.x = 1.0
        publisher.publish(message)
        client.wait_for(lambda: node.lines('a plane does not rotate'), 'the warning')
        message.twist.angular.x, message.twist.linear.z = 0.0, 0.01
        before = poses[-1].values[0, 2]
        publisher.publish(message)
        client.wait_for(lambda: poses[-1].values[0, 2] > before + 1e-3, 'the plane to lift')
        assert min(wrench.wrench.force.z for wrench in wrenches) < -0.01
        assert node.stop() == 0
