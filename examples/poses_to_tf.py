# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Broadcasts chosen bodies as TF frames icosahedron_K, from the poses of a running node.

    python3 examples/poses_to_tf.py 0 5 7
    python3 examples/poses_to_tf.py 0 5 --fabric /left/icofabric

So RViz can show a wrench with frame_id icosahedron_K. Needs tf2_ros, of a ROS installation.
"""

import argparse
import signal
import sys
import threading

from geometry_msgs.msg import PoseArray, TransformStamped
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray, String
import yaml


class Rows:
    """Where each body is in the poses, which `publish.group` and `publish.stride` choose."""

    def __init__(self):
        """Know nothing before the latched topics have come."""
        self.are_known, self._chosen = False, None

    def take_weave(self, text):
        """Take `~/weave`: all bodies are published unless its parameters choose some."""
        publish = yaml.safe_load(text)['/**']['ros__parameters'].get('publish', {})
        if not publish.get('group') and publish.get('stride', 1) == 1:
            self.are_known = True

    def take_bodies(self, numbers):
        """Take `~/bodies`: the numbers of those that are published."""
        self.are_known, self._chosen = True, {int(body): row for row, body in enumerate(numbers)}

    def of(self, body):
        """Return the row of a body; None if it is not published."""
        return body if self._chosen is None else self._chosen.get(body)


def transforms_of(poses, bodies, rows):
    """Return the frames of `bodies` in a PoseArray with these `rows`."""
    frames = []
    for body in bodies:
        row = rows.of(body)
        if row is None or not 0 <= row < len(poses.poses):
            sys.exit(f'body {body} is not among the poses (publish.group, publish.stride)')
        frame, pose = TransformStamped(header=poses.header), poses.poses[row]
        frame.child_frame_id = f'icosahedron_{body}'
        place, frame.transform.rotation = frame.transform.translation, pose.orientation
        place.x, place.y, place.z = pose.position.x, pose.position.y, pose.position.z
        frames.append(frame)
    return frames


def main():
    """Broadcast until Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('bodies', type=int, nargs='+', metavar='BODY')
    parser.add_argument('--fabric', default='/icofabric', help='full name of the node')
    given = parser.parse_args(rclpy.utilities.remove_ros_args(sys.argv)[1:])
    try:
        from tf2_ros import TransformBroadcaster
    except ImportError:
        sys.exit('this needs tf2_ros: source a ROS installation that has it')
    # Noted, and looked at between messages: see damp_live.py.
    over = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: over.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = Node('poses_to_tf')
    broadcaster, rows = TransformBroadcaster(node), Rows()

    def broadcast(poses):
        if rows.are_known:
            broadcaster.sendTransform(transforms_of(poses, given.bodies, rows))

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    for kind, name, take, quality in (
            (String, 'weave', lambda message: rows.take_weave(message.data), latched),
            (Float64MultiArray, 'bodies', lambda message: rows.take_bodies(message.data), latched),
            (PoseArray, 'poses', broadcast, 10)):
        node.create_subscription(kind, f'{given.fabric}/{name}', take, quality)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not over.is_set():
        executor.spin_once(timeout_sec=0.1)
    rclpy.shutdown()


if __name__ == '__main__':
    main()
