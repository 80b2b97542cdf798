# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions for inputs; messages are passed to the run as serialised bytes."""

from typing import Any

from geometry_msgs.msg import PointStamped, TwistStamped, WrenchStamped
from icofabric_sim.messages import PointStampedBytes, TwistStampedBytes, WrenchStampedBytes
from icofabric_sim.messages.input_topics import input_topics
from icofabric_sim.running.received_inputs import ReceivedInputs
from icofabric_sim.scene.scene import Scene
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

# Large enough for a burst while the node is busy.
_DEPTH = 1000
# Number of further messages taken from the queue in one callback: one executor cycle for each
# message is too slow for 10,000 messages a second.
_BURST = 200
_CLASSES = {
    WrenchStampedBytes.TYPE: WrenchStamped, TwistStampedBytes.TYPE: TwistStamped,
    PointStampedBytes.TYPE: PointStamped}


class InputTopics:
    """
    Subscriptions `~/wrench` and `~/pull`, and those that depend on the scene.

    The latter are `~/loads/NAME`, `~/drives/NAME` and `~/planes/NAME`.
    """

    def __init__(
        self, node: Node, inputs: ReceivedInputs, scene: Scene, *, reliable: bool = True
    ) -> None:
        """
        Subscribe for `node` and pass messages to `inputs`.

        A best effort subscription (not `reliable`) also receives from best effort publishers.
        """
        self._node, self._inputs = node, inputs
        self._quality = QoSProfile(
            depth=_DEPTH, reliability=ReliabilityPolicy.RELIABLE if reliable else (
                ReliabilityPolicy.BEST_EFFORT))
        if not reliable:
            node.get_logger().warning(
                'wrenches and twists are received best effort (input_reliability): a lost '
                'message is neither resent nor counted, and ~/advance does not wait '
                'for messages that were sent before it')
        self._subscriptions: dict[str, Any] = {}
        self.set_scene(scene)

    def set_scene(self, scene: Scene) -> None:
        """
        Update the subscriptions for a changed scene: channels, drives and planes may change.
        """
        wanted = input_topics(scene)
        for topic in set(self._subscriptions) - set(wanted):
            self._node.destroy_subscription(self._subscriptions.pop(topic))
        for topic in sorted(set(wanted) - set(self._subscriptions)):
            self._subscriptions[topic] = self._subscribe(topic, _CLASSES[wanted[topic]])

    def take_all(self) -> None:
        """
        Pass on all messages that have arrived on every topic; call from the executor's thread.

        An acknowledged message of a reliable publisher has arrived: the middleware acknowledges a
        message once it is in the queue of the subscription.
        """
        for topic, subscription in self._subscriptions.items():
            # Limited to the queue depth: messages that arrive during the call are left for later.
            self._take(topic, subscription, _DEPTH)

    def _take(self, topic: str, subscription: Any, most: int) -> None:
        with subscription.handle:
            for _ in range(most):
                more = subscription.handle.take_message(subscription.msg_type, True)
                if more is None:
                    break
                self._inputs.receive(topic, more[0])

    def _subscribe(self, topic: str, message_type: Any) -> Any:
        def receive(data: bytes) -> None:
            self._inputs.receive(topic, data)
            self._take(topic, subscription, _BURST)

        subscription = self._node.create_subscription(
            message_type, topic, receive, self._quality, raw=True)
        return subscription
