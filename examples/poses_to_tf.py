# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Broadcasts chosen bodies as TF frames icosahedron_K, from the poses of a running node.

    python3 examples/poses_to_tf.py 0 5 7

So RViz can show a wrench with frame_id icosahedron_K. Needs tf2_ros, of a ROS installation.
"""

import signal
import sys
import threading

from geometry_msgs.msg import PoseArray, TransformStamped
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions


def transforms_of(poses, bodies):
    """Return the frames of `bodies` in a PoseArray, which has all bodies in order."""
    frames = []
    for body in bodies:
        frame, pose = TransformStamped(header=poses.header), poses.poses[body]
        frame.child_frame_id = f'icosahedron_{body}'
        place, frame.transform.rotation = frame.transform.translation, pose.orientation
        place.x, place.y, place.z = pose.position.x, pose.position.y, pose.position.z
        frames.append(frame)
    return frames


def main():
    """Broadcast until Ctrl-C."""
    bodies = [int(word) for word in sys.argv[1:]]
    try:
        from tf2_ros import TransformBroadcaster
    except ImportError:
        sys.exit('this needs tf2_ros: source a ROS installation that has it')
    # Noted, and looked at between messages: see damp_live.py.
    over = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: over.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = Node('poses_to_tf')
    broadcaster = TransformBroadcaster(node)
    node.create_subscription(
        PoseArray, '/icofabric/poses',
        lambda poses: broadcaster.sendTransform(transforms_of(poses, bodies)), 10)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not over.is_set():
        executor.spin_once(timeout_sec=0.1)
    rclpy.shutdown()


if __name__ == '__main__':
    main()
