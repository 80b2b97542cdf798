# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A user's script, not a test: pushes a fabric over ROS 2 and watches it, with plain message objects.

It prints what it sent and every pose array that it saw, as JSON.
"""
import json
import sys
import time

from geometry_msgs.msg import PoseArray, WrenchStamped
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time

TOPIC = '/icofabric/loads/all_of_it'
AHEAD = 0.5  # s of simulated time, well within input_horizon
LAST_WATCHED = 0.3  # s of simulated time after the last push


class Pusher(Node):

    def __init__(self):
        super().__init__('pusher', parameter_overrides=[Parameter('use_sim_time', value=True)])
        self.poses = []
        self.sent = []
        self.create_subscription(PoseArray, '/icofabric/poses', self.poses.append, 1000)
        self.publisher = self.create_publisher(WrenchStamped, TOPIC, 10)

    def wait(self, condition):
        deadline = time.monotonic() + 60.0
        while not condition():
            rclpy.spin_once(self, timeout_sec=0.02)
            if time.monotonic() > deadline:
                sys.exit(f'gave up after {len(self.sent)} wrenches and {len(self.poses)} poses')

    def now(self):
        return self.get_clock().now().nanoseconds

    def push(self, stamp, x=0.0, y=0.0, z=0.0):
        message = WrenchStamped()
        message.header.stamp = Time(nanoseconds=stamp).to_msg()
        message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = x, y, z
        self.sent.append({'stamp': stamp, 'sent_at': self.now(), 'force': [x, y, z]})
        self.publisher.publish(message)

    def watch(self, seconds):
        end = self.now() + int(seconds * 1e9)
        self.wait(lambda: self.now() >= end)


def main():
    rclpy.init()
    node = Pusher()
    node.wait(lambda: node.publisher.get_subscription_count() and len(node.poses) > 5)
    node.push(0, x=0.02)
    node.watch(0.1)
    node.push(node.now() + int(AHEAD * 1e9), y=0.02)
    node.watch(AHEAD + 0.1)
    node.push(time.time_ns(), z=-0.03)
    node.watch(0.1)
    node.push(time.time_ns())
    node.watch(LAST_WATCHED)
    seen = [
        {
            'stamp': Time.from_msg(message.header.stamp).nanoseconds,
            'frame': message.header.frame_id,
            'positions': [[p.position.x, p.position.y, p.position.z] for p in message.poses],
        }
        for message in node.poses
    ]
    print(json.dumps({'sent': node.sent, 'seen': seen}))
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
