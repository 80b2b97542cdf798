# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Publishers of the node as a sink of the runner.
"""

from collections.abc import Callable
from functools import partial
from importlib import import_module
import threading
import time
from typing import Any

from icofabric_sim.outputs import Topic, TOPICS
from icofabric_sim.parameters import Parameters
from icofabric_sim.run_records import Status
from icofabric_sim.simulation import Simulation
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# How long the last messages may take to be delivered [s].
_LAST_WORDS = 0.3


def quality(topic: Topic) -> QoSProfile:
    """
    Reliable for every topic: best effort loses large messages. Latched ones are transient local.
    """
    durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
    return QoSProfile(
        depth=topic.depth, reliability=ReliabilityPolicy.RELIABLE, durability=durability
    )


def message_class(type_name: str) -> Any:
    """
    Class of a message type such as `std_msgs/msg/String`.
    """
    package, _, name = type_name.split('/')
    return getattr(import_module(f'{package}.msg'), name)


class LiveSink:
    """
    Publishes bytes as they are; a topic without subscribers is not wanted.
    """

    def __init__(self, node: Node) -> None:
        """
        Create the publishers of `node`.
        """
        self._publishers: dict[str, Publisher] = {
            topic.name: node.create_publisher(
                message_class(topic.type), topic.name, quality(topic)
            )
            for topic in TOPICS
        }
        self._context = node.context
        self._closed = False
        self._lock = threading.Lock()

    @property
    def is_bag(self) -> bool:
        """
        Whether messages are kept.
        """
        return False

    def wants(self, topic: Topic) -> bool:
        """
        Whether anyone listens; a latched message waits for those who come later.
        """
        with self._lock:
            if self._closed:
                return False
            if topic.latched:
                return True
            return bool(self._guarded(self._publishers[topic.name].get_subscription_count))

    def send(self, topic: Topic, nanoseconds: int, data: bytes) -> None:
        """
        Publish.
        """
        with self._lock:
            if not self._closed:
                publisher = self._publishers[topic.name]
                self._guarded(lambda: publisher.publish(data))

    def _guarded(self, call: Callable[[], Any]) -> Any:
        """
        Result of `call`; None once an interrupt has ended the context under the simulation.
        """
        try:
            return call()
        except rclpy_implementation.RCLError:
            if self._context.ok():
                raise
            self._closed = True
            return None

    def send_input(self, topic: str, type_name: str, nanoseconds: int, data: bytes) -> None:
        """
        Inputs came from the graph and are not sent back.
        """

    def time_jumped_back(
        self, simulation: Simulation, parameters: Parameters, ended: Status
    ) -> None:
        """
        Publishers need not know: /clock tells everyone.
        """

    def close(self) -> None:
        """
        Publish no more, once listeners have what was sent: the context is about to end.
        """
        with self._lock:
            deadline = time.monotonic() + _LAST_WORDS
            for publisher in self._publishers.values():
                rest = Duration(seconds=max(deadline - time.monotonic(), 0.0))
                self._guarded(partial(publisher.wait_for_all_acked, rest))
            self._closed = True
