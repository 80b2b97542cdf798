# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A raw subscriber in a separate process, which reports received messages with checksums.

Started by live_delivery.py with the arguments TOPIC TYPE [TOPIC TYPE ...].

Each line on standard input gets one line of JSON: `clock` the simulated time [ns], `listen` an
answer after subscribing to topics that are all published, `end` the received messages after the
last one has arrived.
"""

from collections.abc import Callable
import json
import sys
import threading
import time
from typing import Any
import zlib

from icofabric_sim.messages import decode_clock, decode_marker_points, decode_pose_array
from icofabric_sim.ros.live_sink import message_class
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy

_DECODERS = {
    'geometry_msgs/msg/PoseArray': decode_pose_array,
    'visualization_msgs/msg/Marker': decode_marker_points,
}
_QUALITY = QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)
# Time without messages before the end.
_SILENCE_S = 1.0


class Listener:
    """Subscriptions and received messages."""

    def __init__(self, node: Any, topics: list[tuple[str, str]]) -> None:
        """Listen to /clock, and to the (name, type) pairs on request."""
        self._node, self._topics = node, topics
        self._clock, self._last = 0, 0.0
        self._received: dict[str, list[list[int]]] = {name: [] for name, _ in topics}
        node.create_subscription(
            message_class('rosgraph_msgs/msg/Clock'), '/clock', self._take_clock, _QUALITY,
            raw=True)

    def answer(self, word: str) -> Any:
        """Execute a request, and return the answer."""
        if word == 'clock':
            before = self._clock
            while self._clock == before:
                time.sleep(0.001)
            return self._clock
        if word == 'listen':
            for name, type_name in self._topics:
                self._node.create_subscription(
                    message_class(type_name), name, self._taker(name, type_name), _QUALITY,
                    raw=True)
                while not self._node.count_publishers(name):
                    time.sleep(0.01)
            return 'ready'
        while time.monotonic() - self._last < _SILENCE_S:
            time.sleep(0.05)
        return self._received

    def _take_clock(self, data: bytes) -> None:
        self._clock = decode_clock(data)

    def _taker(self, name: str, type_name: str) -> Any:
        decode: Callable[[bytes], Any] = _DECODERS[type_name]
        kept = self._received[name]

        def take(data: bytes) -> None:
            self._last = time.monotonic()
            message = decode(data)
            number = getattr(message, 'marker_id', 0)
            kept.append([message.nanoseconds, number, len(data), zlib.crc32(data)])

        return take


def main() -> None:
    words = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node('listener', enable_rosout=False)
    listener = Listener(node, list(zip(words[::2], words[1::2])))
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            pass

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    for line in sys.stdin:
        print(json.dumps(listener.answer(line.strip())), flush=True)
        if line == 'end\n':
            break
    rclpy.try_shutdown()
    thread.join()


if __name__ == '__main__':
    main()
