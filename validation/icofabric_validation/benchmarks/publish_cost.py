# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Cost of messages as bytes and as objects of rclpy, and cost of a subscriber for the node.

    .venv/bin/python -m icofabric_validation.benchmarks.publish_cost [--rounds 5] \
        [--only messages|listeners]

Needs rclpy. In the first part the publisher has no subscriber, so that the middleware only accepts
messages. In the second part a node, a raw subscriber and this process check each other.
"""

import argparse
from collections.abc import Callable
import os
import statistics
import time

from geometry_msgs.msg import Point, Pose, PoseArray
import icofabric_sim as ico
from icofabric_sim.messages import decode_pose_array
from icofabric_sim.messages.topics import Outputs
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_validation.benchmarks.live_delivery import CASES, measure, report
from icofabric_validation.benchmarks.machine import describe_machine
import rclpy
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from visualization_msgs.msg import Marker

SIZES = ((5, 5, 5), (21, 21, 21), (58, 58, 60))
NANOSECONDS = 1_500_000_000


def pose_objects(snapshot: Snapshot) -> PoseArray:
    message = PoseArray()
    message.header.frame_id = 'world'
    message.header.stamp.sec, message.header.stamp.nanosec = 1, 500_000_000
    for position, orientation in zip(snapshot.position.tolist(), snapshot.orientation.tolist()):
        pose = Pose()
        pose.position.x, pose.position.y, pose.position.z = position
        (pose.orientation.x, pose.orientation.y, pose.orientation.z,
         pose.orientation.w) = orientation
        message.poses.append(pose)
    return message


def marker_objects(snapshot: Snapshot) -> Marker:
    message = Marker(type=Marker.LINE_LIST, action=Marker.ADD)
    message.header.frame_id = 'world'
    message.points = [Point(x=x, y=y, z=z)
                      for x, y, z in snapshot.connector_ends.reshape(-1, 3).tolist()]
    return message


def median_time(call: Callable[[], object], rounds: int) -> float:
    times = []
    for _ in range(rounds):
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return statistics.median(times) * 1e3


def compare(size: tuple[int, int, int], poses: Publisher, lines: Publisher, rounds: int) -> None:
    scene = ico.Scene.from_parameters({'weave': {'size': list(size)}})
    snapshot = ico.compile_scene(scene).snapshot()
    outputs = Outputs(scene)
    ours = decode_pose_array(outputs.poses(snapshot, NANOSECONDS))
    theirs = decode_pose_array(serialize_message(pose_objects(snapshot)))
    assert (ours.values == theirs.values).all() and snapshot.connector_length.any()

    def lines_by_bytes() -> None:
        for message in outputs.connectors(snapshot, NANOSECONDS):
            lines.publish(message)

    rows = (
        ('PoseArray', lambda: poses.publish(outputs.poses(snapshot, NANOSECONDS)),
         lambda: poses.publish(pose_objects(snapshot))),
        ('Marker', lines_by_bytes, lambda: lines.publish(marker_objects(snapshot))))
    for name, fast, slow in rows:
        fast()
        quick, long = median_time(fast, rounds), median_time(slow, max(1, rounds // 2))
        print(f'{scene.body_count:8,} {name:>11} {quick:10.3f} {long:12.1f} '
              f'{long / quick:8.0f}')


def compare_ways(rounds: int) -> None:
    rclpy.init()
    node = rclpy.create_node('publish_cost')
    poses = node.create_publisher(PoseArray, 'poses', 10)
    lines = node.create_publisher(Marker, 'connectors', 10)
    print(f'milliseconds, median of {rounds}')
    print(f'{"bodies":>8} {"message":>11} {"bytes way":>10} {"objects way":>12} {"ratio":>8}')
    for size in SIZES:
        compare(size, poses, lines, rounds)
    node.destroy_node()
    rclpy.try_shutdown()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--rounds', type=int, default=5)
    parser.add_argument('--only', choices=('messages', 'listeners'))
    arguments = parser.parse_args()
    # Only processes of this machine.
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(os.getpid() % 102))
    print(describe_machine())
    if arguments.only != 'listeners':
        compare_ways(arguments.rounds)
    if arguments.only != 'messages':
        for case in CASES:
            print('\n'.join(report(case, measure(case))), flush=True)


if __name__ == '__main__':
    main()
