# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Publishers of the node as a sink of the runner.
"""

from collections.abc import Callable, Iterable
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
# Subscribers are asked to confirm messages about once for every full queue of the publisher, and
# between two answers there is no moment at which everything is confirmed. So looking, which costs
# a tenth of a millisecond, begins after so many messages at least.
_FEW = 10
# Without any such moment for this long [s] a subscriber may be stuck. That is the case where none
# comes within the second time either, for which publishing then waits, once in that long.
_SUSPICIOUS, _PROBE = 3.0, 0.02


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


class _Outlet:
    """
    A publisher, and how many messages it sent since all subscribers had confirmed all of them.
    """

    def __init__(self, publisher: Publisher, depth: int) -> None:
        self.publisher = publisher
        self.depth = max(depth, _FEW)
        self.unconfirmed = 0
        self.confirmed_at, self.probed_at = 0.0, 0.0
        self.is_stuck = False


class LiveSink:
    """
    Publishes bytes as they are; a topic without subscribers is not wanted.

    Publishing never waits for a subscriber: the queue of a reliable publisher keeps its last
    messages, and one that is full loses the oldest, which is counted.
    """

    def __init__(self, node: Node, topics: Iterable[Topic] = TOPICS) -> None:
        """
        Create the publishers of `node`.
        """
        self._outlets = {
            topic.name: _Outlet(
                node.create_publisher(message_class(topic.type), topic.name, quality(topic)),
                topic.depth,
            )
            for topic in topics
        }
        # Messages overwritten before every subscriber had them.
        self.not_taken = 0
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
            outlet = self._outlets.get(topic.name)
            if self._closed or outlet is None:
                return False
            if topic.latched:
                return True
            return bool(self._guarded(outlet.publisher.get_subscription_count))

    def send(self, topic: Topic, nanoseconds: int, data: bytes) -> None:
        """
        Publish.
        """
        with self._lock:
            if self._closed:
                return
            outlet = self._outlets[topic.name]
            if outlet.unconfirmed == 0:
                outlet.confirmed_at = time.monotonic()
            self._look(outlet)
            self._guarded(lambda: outlet.publisher.publish(data))
            outlet.unconfirmed += 1

    def _look(self, outlet: _Outlet) -> None:
        """
        Count what the next message displaces while a subscriber is stuck.
        """
        if outlet.unconfirmed < outlet.depth:
            return
        now, wait = time.monotonic(), 0.0
        if now - outlet.confirmed_at > _SUSPICIOUS:
            if now - outlet.probed_at > _SUSPICIOUS:
                outlet.probed_at, wait = now, _PROBE
            elif outlet.unconfirmed % 7:  # most are not looked at, and in no fixed rhythm
                self.not_taken += outlet.is_stuck
                return
        if self._guarded(lambda: outlet.publisher.wait_for_all_acked(Duration(seconds=wait))):
            outlet.unconfirmed, outlet.is_stuck = 0, False
        elif wait:
            outlet.is_stuck = True
        self.not_taken += outlet.is_stuck

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
            for outlet in self._outlets.values():
                rest = Duration(seconds=max(deadline - time.monotonic(), 0.0))
                self._guarded(partial(outlet.publisher.wait_for_all_acked, rest))
            self._closed = True
