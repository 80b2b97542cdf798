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
"""Publishers of the node as a sink of the runner."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
import math
import threading
import time
from typing import Any

from icofabric_sim.messages.topics import Topic
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.running.run_records import Status
from icofabric_sim.simulation.simulation import Simulation
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# How long the last messages may take to be delivered [s].
_LAST_WORDS = 0.3
# Subscribers are asked to confirm messages about once for every full queue of the publisher, and
# every three seconds. A healthy one does so before the next message, unless that follows within
# this time [s]; so a moment comes at which everything is confirmed.
_ANSWER = 0.01
# Without such a moment for this long [s], in so many checks, a subscriber is stuck.
_STUCK_AFTER, _STUCK_LOOKS = 5.0, 20
# A check costs a tenth of a millisecond; it is left out below so many messages.
_FEW = 10


def quality(topic: Topic) -> QoSProfile:
    """
    Reliable for every topic: best effort loses large messages. Latched ones are transient local.
    """
    durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
    return QoSProfile(
        depth=topic.depth, reliability=ReliabilityPolicy.RELIABLE, durability=durability
    )


def message_class(type_name: str) -> Any:
    """Class of a message type such as `std_msgs/msg/String`."""
    package, _, name = type_name.split('/')
    return getattr(import_module(f'{package}.msg'), name)


class _Outlet:
    """
    A publisher, and how many messages it sent since all subscribers had confirmed all of them.
    """

    def __init__(self, publisher: Publisher, depth: int) -> None:
        self.publisher = publisher
        self.depth = max(depth, _FEW)
        self.unconfirmed, self.looks = 0, 0  # checks that found no such moment
        self.waits_since, self.sent_at = 0.0, 0.0


class LiveSink:
    """
    Publishes bytes as they are; a topic without subscribers is not wanted.

    Publishing never waits for a subscriber: the queue of a reliable publisher keeps its last
    messages, and one that is full loses the oldest, which is counted.
    """

    def __init__(self, node: Node, topics: Iterable[Topic]) -> None:
        """Create the publishers of `node`."""
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
        self._lock, self._busy_since = threading.Lock(), math.inf

    @property
    def is_bag(self) -> bool:
        """Whether messages are kept."""
        return False

    @property
    def busy_since(self) -> float:
        """When a thread began a call of the middleware, by time.monotonic(); inf: none has."""
        return self._busy_since

    def wants(self, topic: Topic) -> bool:
        """Whether there are subscribers; a latched message is kept for later ones."""
        with self._calling():
            return self._wants(topic)

    def send(self, topic: Topic, nanoseconds: int, data: bytes) -> None:
        """Publish."""
        with self._calling():
            self._send(topic, data)

    def offer(self, topic: Topic, build: Callable[[], bytes]) -> None:
        """Publish what `build` makes, if it is wanted and no other thread is about to publish."""
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
        return topic.latched or bool(self._guarded(outlet.publisher.get_subscription_count))

    def _send(self, topic: Topic, data: bytes) -> None:
        if self._closed:
            return
        outlet = self._outlets[topic.name]
        self._look(outlet)
        self._guarded(lambda: outlet.publisher.publish(data))
        outlet.unconfirmed += 1

    def _look(self, outlet: _Outlet) -> None:
        """Count what the next message displaces while a subscriber is stuck."""
        now = time.monotonic()
        passed, outlet.sent_at = now - outlet.sent_at, now
        if outlet.unconfirmed >= outlet.depth and passed > _ANSWER:
            if self._guarded(lambda: outlet.publisher.wait_for_all_acked(Duration())):
                outlet.unconfirmed, outlet.looks = 0, 0
            else:
                outlet.looks += 1
                outlet.waits_since = now if outlet.looks == 1 else outlet.waits_since
        if outlet.looks > _STUCK_LOOKS and now - outlet.waits_since > _STUCK_AFTER:
            self.not_taken += 1

    def _guarded(self, call: Callable[[], Any]) -> Any:
        """Result of `call`; None once an interrupt has ended the context under the simulation."""
        try:
            return call()
        except rclpy_implementation.RCLError:
            if self._context.ok():
                raise
            self._closed = True
            return None

    def send_input(self, topic: str, type_name: str, nanoseconds: int, data: bytes) -> None:
        """Inputs came from the graph and are not sent back."""

    def time_jumped_back(
        self, simulation: Simulation, parameters: Parameters, ended: Status
    ) -> None:
        """Nothing to do here: subscribers see the jump in /clock."""

    def close(self) -> None:
        """Publish no more, once listeners have what was sent: the context is about to end."""
        deadline = time.monotonic() + _LAST_WORDS
        # Not so where the middleware holds the run's thread.
        free = self._lock.acquire(timeout=_LAST_WORDS)
        try:
            for outlet in self._outlets.values() if free else ():
                rest = Duration(seconds=max(deadline - time.monotonic(), 0.0))
                self._guarded(partial(outlet.publisher.wait_for_all_acked, rest))
            self._closed = True
        finally:
            if free:
                self._lock.release()
