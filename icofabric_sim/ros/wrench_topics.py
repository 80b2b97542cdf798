# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Wrenches and twists from topics: judged at the edge, then handed to the runner or dropped.

What is dropped is counted, and told with its reason.
"""

from collections.abc import Callable
import math
import re
from typing import Any

from geometry_msgs.msg import TwistStamped, WrenchStamped
from icofabric_sim.messages import decode_twist_stamped, decode_wrench_stamped
from icofabric_sim.running.complaints import Complaints
from icofabric_sim.running.run_records import WrenchInput
from icofabric_sim.running.runner import Runner
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.driving import PREFIX
from icofabric_sim.simulation.inputs import Key
import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

# Loads are reliable, and deep enough for a burst while the node does something else.
_QUALITY = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
# So many more are taken out of the queue at once: one turn of the executor for each message would
# be too slow for ten thousand a second.
_BURST = 200
_KIND_LENGTH = 16
_LONGEST_SHOWN = 100
_BODY = re.compile(r'icosahedron_(0|[1-9][0-9]{0,9})')
# A wrench that moves a body by its own size, or turns it, at a larger rate [1/s] takes steps of
# less than a microsecond to follow: one such message would bring the simulation to a standstill.
_LARGEST_RATE = 1e6


Judge = Callable[[bytes, str, Callable[[str], Key]], WrenchInput]


def shown(text: str) -> str:
    """A text that somebody sent, as a log may hold it."""
    return repr(text if len(text) <= _LONGEST_SHOWN else f'{text[:_LONGEST_SHOWN]}...')


class Dropped(ValueError):
    """An input that cannot be taken; the message says why."""


class WrenchTopics:
    """
    Subscriptions `~/wrench`, `~/loads/NAME` and `~/drives/NAME`; all but one follow the scene.
    """

    def __init__(self, node: Node, runner: Runner, scene: Scene) -> None:
        """Subscribe for `node` and pass on to `runner`."""
        self._node, self._runner = node, runner
        self._channels: dict[str, Any] = {}
        self._complaints = Complaints(node.get_logger().warning)
        self.dropped = 0
        self._frame_id = scene.parameters['frame_id']
        self.set_scene(scene)
        self._body = self._subscribe('~/wrench', self._body_key)

    def set_scene(self, scene: Scene) -> None:
        """Follow a changed scene: channels come and go."""
        self._scene = scene
        wanted = {f'~/loads/{name}': name for name in scene.loads}
        wanted |= {f'~/drives/{name}': PREFIX + name for name in scene.drives}
        for topic in set(self._channels) - set(wanted):
            self._node.destroy_subscription(self._channels.pop(topic))
        for topic in sorted(set(wanted) - set(self._channels)):
            key = wanted[topic]
            if key.startswith(PREFIX):
                self._channels[topic] = self._subscribe(
                    topic, self._drive_key(key), TwistStamped, self._judge_twist)
            else:
                self._channels[topic] = self._subscribe(topic, self._channel_key(key))

    def _subscribe(
        self, topic: str, find_key: Callable[[str], Key], message_type: Any = WrenchStamped,
        judge: Judge | None = None,
    ) -> Any:
        judge = judge or self._judge
        resolved = self._node.resolve_topic_name(topic)
        # A record names channels as they are here, however the topic was renamed outside.
        recorded = self._node.get_fully_qualified_name() + topic.removeprefix('~')

        def take(data: bytes) -> None:
            try:
                self._runner.receive(judge(data, recorded, find_key))
            except ValueError as error:
                self._drop(resolved, str(error))

        def receive(data: bytes) -> None:
            take(data)
            with subscription.handle:
                for _ in range(_BURST):
                    more = subscription.handle.take_message(message_type, True)
                    if more is None:
                        break
                    take(more[0])

        subscription = self._node.create_subscription(
            message_type, topic, receive, _QUALITY, raw=True)
        return subscription

    def _judge(self, data: bytes, topic: str, find_key: Callable[[str], Key]) -> WrenchInput:
        wrench = decode_wrench_stamped(data)
        key = find_key(wrench.frame_id)
        force, torque = np.array(wrench.first), np.array(wrench.second)
        if not (np.isfinite(force).all() and np.isfinite(torque).all()):
            raise Dropped(
                f'it is not finite (force {force.tolist()} N, torque {torque.tolist()} N m)'
            )
        if not self._rate(key, force, torque) <= _LARGEST_RATE:
            raise Dropped(
                f'it is too large to follow (force {force.tolist()} N, torque {torque.tolist()} '
                f'N m on {"a body" if isinstance(key, int) else "bodies"} of '
                f'{self._scene.shell.mass:.3g} kg)'
            )
        return WrenchInput(topic, key, wrench.nanoseconds, force, torque, bytes(data))

    def _judge_twist(self, data: bytes, topic: str, find_key: Callable[[str], Key]) -> WrenchInput:
        twist = decode_twist_stamped(data)
        key = find_key(twist.frame_id)
        linear, angular = np.array(twist.first), np.array(twist.second)
        if not (np.isfinite(linear).all() and np.isfinite(angular).all()):
            raise Dropped(
                f'it is not finite (linear {linear.tolist()} m/s, angular {angular.tolist()} '
                'rad/s)')
        rate = math.hypot(*linear) / self._scene.geometry.cube_width + math.hypot(*angular)
        if not rate <= _LARGEST_RATE:
            raise Dropped(
                f'it is too fast to follow (linear {linear.tolist()} m/s, angular '
                f'{angular.tolist()} rad/s)')
        return WrenchInput(topic, key, twist.nanoseconds, linear, angular, bytes(data))

    def _drive_key(self, key: str) -> Callable[[str], Key]:
        def find(frame_id: str) -> Key:
            if key.removeprefix(PREFIX) not in self._scene.drives:
                raise Dropped(f'{key} is no longer part of the scene')
            if frame_id not in ('', self._frame_id):
                raise Dropped(
                    f'its header.frame_id is {shown(frame_id)}; a drive moves in the world, so it '
                    f"must be '' or {self._frame_id!r}")
            return key

        return find

    def _rate(self, key: Key, force: np.ndarray, torque: np.ndarray) -> float:
        """How fast [1/s] a wrench alone would move a body by its size, or turn it."""
        scene, push, turn = self._scene, math.hypot(*force), math.hypot(*torque)
        shell = scene.shell
        if not isinstance(key, int):
            channel = scene.loads[key]
            turn += math.hypot(*channel.point) * push
            if channel.total:
                push, turn = push / len(channel.bodies), turn / len(channel.bodies)
        square = push / (shell.mass * scene.geometry.cube_width) + turn / shell.inertia
        return math.sqrt(square)

    def _body_key(self, frame_id: str) -> Key:
        match = _BODY.fullmatch(frame_id)
        if match is None:
            raise Dropped(
                f"its header.frame_id is {shown(frame_id)}, and must be 'icosahedron_K' with the "
                'number K of the body'
            )
        count = self._scene.body_count
        if int(match[1]) >= count:
            raise Dropped(f'there is no body {match[1]}; bodies are 0 to {count - 1}')
        return int(match[1])

    def _channel_key(self, name: str) -> Callable[[str], Key]:
        def find(frame_id: str) -> Key:
            channel = self._scene.loads.get(name)
            if channel is None:
                raise Dropped(f'loads.{name} is no longer part of the scene')
            allowed = ['', 'icosahedron'] if channel.in_body_axes else ['', self._frame_id]
            if frame_id not in allowed:
                axes = 'body' if channel.in_body_axes else 'world'
                raise Dropped(
                    f'its header.frame_id is {shown(frame_id)}; loads.{name}.frame is {axes}, '
                    f'so it must be {allowed[0]!r} or {allowed[1]!r}'
                )
            return name

        return find

    def _drop(self, topic: str, reason: str) -> None:
        self.dropped += 1
        # The first words tell the kind of reason.
        self._complaints.add(
            f'{topic} {reason[:_KIND_LENGTH]}',
            f'a {"twist" if "/drives/" in topic else "wrench"} on {topic} was dropped: {reason}')
