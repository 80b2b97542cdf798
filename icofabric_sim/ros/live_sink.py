# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""ROS publishers as a sink of the runner."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
import math
import threading
import time
from typing import Any

from icofabric_sim.messages.topics import Topic, wrench_topics
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.running.run_records import Status
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import Simulation
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# Time for delivery of the last messages [s].
_LAST_DELIVERY_S = 0.3
# Subscribers acknowledge messages about once per full queue of the publisher, and at least every
# three seconds. A healthy subscriber acknowledges a message before the next one if they are this
# time [s] apart, so some check finds no unacknowledged message.
_CONFIRMATION_S = 0.01
# A subscriber is stuck if its backlog was never empty for this time [s] and this number of checks.
_STUCK_AFTER_S, _STUCK_CHECKS = 5.0, 20
# A check costs 0.1 ms; it is skipped while fewer messages than this are unacknowledged.
_MIN_CHECKED_COUNT = 10


def quality(topic: Topic) -> QoSProfile:
    """
    Return the QoS profile of a topic: always reliable, transient local if latched.

    Best effort delivery loses large messages.
    """
    durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
    return QoSProfile(
        depth=topic.depth, reliability=ReliabilityPolicy.RELIABLE, durability=durability
    )


def message_class(type_name: str) -> Any:
    """Return the class of a message type such as `std_msgs/msg/String`."""
    package, _, name = type_name.split('/')
    return getattr(import_module(f'{package}.msg'), name)


class _Outlet:
    """Publisher, and number of messages since subscribers had last acknowledged all."""

    def __init__(self, publisher: Publisher, depth: int) -> None:
        self.publisher = publisher
        self.depth = max(depth, _MIN_CHECKED_COUNT)
        self.unconfirmed, self.failed_checks = 0, 0  # checks with unconfirmed messages, in a row
        self.waits_since, self.sent_at = 0.0, 0.0


class LiveSink:
    """
    Publishers of serialised messages, which are built only for topics with subscribers.

    Publishing never waits for a subscriber. The queue of a reliable publisher keeps the last
    messages; a full queue drops the oldest one, which is counted.
    """

    def __init__(self, node: Node, topics: Iterable[Topic]) -> None:
        """Create the publishers of `node`."""
        self._node = node
        self._outlets = {topic.name: self._open(topic) for topic in topics}
        self._of_scene: set[str] = set()
        # Messages overwritten before every subscriber had received them.
        self.not_taken = 0
        self._context = node.context
        self._closed = False
        self._lock, self._busy_since = threading.Lock(), math.inf

    def _open(self, topic: Topic) -> _Outlet:
        """Create the publisher of a topic."""
        return _Outlet(
            self._node.create_publisher(message_class(topic.type), topic.name, quality(topic)),
            topic.depth)

    def set_scene(self, scene: Scene) -> None:
        """Create the publishers of the topics of a scene, and remove those of an earlier scene."""
        wanted = {topic.name: topic for topic in wrench_topics(scene)}
        with self._lock:
            for name in self._of_scene - set(wanted):
                self._node.destroy_publisher(self._outlets.pop(name).publisher)
            self._outlets |= {
                name: self._open(topic) for name, topic in wanted.items()
                if name not in self._outlets}
            self._of_scene = set(wanted)

    @property
    def is_bag(self) -> bool:
        """Return whether the sink stores messages."""
        return False

    @property
    def busy_since(self) -> float:
        """Return when the current call of the middleware started (time.monotonic()), or inf."""
        return self._busy_since

    def wants(self, topic: Topic) -> bool:
        """Return whether a topic has subscribers or is latched for later ones."""
        with self._calling():
            return self._wants(topic)

    def send(self, topic: Topic, nanoseconds: int, data: bytes) -> None:
        """Publish a message."""
        with self._calling():
            self._send(topic, data)

    def offer(self, topic: Topic, build: Callable[[], bytes]) -> None:
        """
        Publish the result of `build` if `topic` has subscribers and no other thread is publishing.
        """
        if not self._lock.acquire(blocking=False):
            return
        try:
            if self._wants(topic):
                self._send(topic, build())
        finally:
            self._lock.release()

    @contextmanager
    def _calling(self) -> Iterator[None]:
        with self._lock:
            self._busy_since = time.monotonic()
            try:
                yield
            finally:
                self._busy_since = math.inf

    def _wants(self, topic: Topic) -> bool:
        outlet = self._outlets.get(topic.name)
        if self._closed or outlet is None:
            return False
        return topic.latched or bool(self._guard(outlet.publisher.get_subscription_count))

    def _send(self, topic: Topic, data: bytes) -> None:
        outlet = self._outlets.get(topic.name)
        if self._closed or outlet is None:
            return
        self._count_displaced(outlet)
        self._guard(lambda: outlet.publisher.publish(data))
        outlet.unconfirmed += 1

    def _count_displaced(self, outlet: _Outlet) -> None:
        """Count the message that the next one overwrites while a subscriber is stuck."""
        now = time.monotonic()
        passed, outlet.sent_at = now - outlet.sent_at, now
        if outlet.unconfirmed >= outlet.depth and passed > _CONFIRMATION_S:
            if self._guard(lambda: outlet.publisher.wait_for_all_acked(Duration())):
                outlet.unconfirmed, outlet.failed_checks = 0, 0
            else:
                outlet.failed_checks += 1
                outlet.waits_since = now if outlet.failed_checks == 1 else outlet.waits_since
        if outlet.failed_checks > _STUCK_CHECKS and now - outlet.waits_since > _STUCK_AFTER_S:
            self.not_taken += 1

    def _guard(self, call: Callable[[], Any]) -> Any:
        """
        Return the result of `call`, or None after an interrupt has shut down the ROS context.
        """
        try:
            return call()
        except rclpy_implementation.RCLError:
            if self._context.ok():
                raise
            self._closed = True
            return None

    def send_input(self, topic: str, type_name: str, nanoseconds: int, data: bytes) -> None:
        """Ignore inputs: they came from the graph."""

    def time_jumped_back(
        self, simulation: Simulation, parameters: Parameters, ended: Status
    ) -> None:
        """Do nothing: subscribers see the jump in /clock."""

    def close(self) -> None:
        """Stop publishing after subscribers have received the last messages."""
        deadline = time.monotonic() + _LAST_DELIVERY_S
        # Do not wait if the middleware blocks the run's thread.
        free = self._lock.acquire(timeout=_LAST_DELIVERY_S)
        try:
            for outlet in self._outlets.values() if free else ():
                rest = Duration(seconds=max(deadline - time.monotonic(), 0.0))
                self._guard(partial(outlet.publisher.wait_for_all_acked, rest))
            self._closed = True
        finally:
            if free:
                self._lock.release()
