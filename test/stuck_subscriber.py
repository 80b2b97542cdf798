# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A user's script, not a test: listens to the topics of a fabric until it is stopped (SIGSTOP)."""
import sys

from icofabric_sim.messages.topics import CLOCK, CONNECTORS, POSES, STATE
from icofabric_sim.ros.live_sink import message_class
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy


def main():
    rclpy.init()
    node = rclpy.create_node('stuck')
    seen = set()
    quality = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
    for topic in (POSES, STATE, CLOCK, CONNECTORS):
        name = topic.name.replace('~', '/icofabric')
        node.create_subscription(message_class(topic.type), name,
                                 lambda data, name=name: seen.add(name), quality, raw=True)
    while True:
        rclpy.spin_once(node, timeout_sec=0.1)
        if len(seen) == 4:
            print('hears all', flush=True)
            seen.clear()


if __name__ == '__main__':
    sys.exit(main())
