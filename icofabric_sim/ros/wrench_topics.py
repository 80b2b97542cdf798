# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Wrenches from topics: judged at the edge, then handed to the runner or dropped with a reason.
"""

from collections.abc import Callable
import math
import re
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
from icofabric_sim.inputs import Key
from icofabric_sim.messages import decode_wrench_stamped
from icofabric_sim.run_records import WrenchInput
from icofabric_sim.runner import Runner
from icofabric_sim.scene import Scene
import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

# Loads are reliable, and deep enough for a burst while one step is computed.
_QUALITY = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
_KIND_LENGTH = 16
_BODY = re.compile(r'icosahedron_(0|[1-9][0-9]{0,9})')


class Dropped(ValueError):
    """
    A wrench that cannot be taken; the message says which and why.
    """


class WrenchTopics:
    """
    Subscriptions `~/wrench` and `~/loads/NAME`; the latter follow the scene.
    """

    def __init__(self, node: Node, runner: Runner, scene: Scene) -> None:
        """
        Subscribe for `node` and pass on to `runner`.
        """
        self._node, self._runner = node, runner
        self._channels: dict[str, Any] = {}
        self._warned: dict[str, float] = {}
        self.dropped = 0
        self._frame_id = scene.parameters['frame_id']
        self.set_scene(scene)
        self._body = self._subscribe('~/wrench', self._body_key)

    def set_scene(self, scene: Scene) -> None:
        """
        Follow a changed scene: channels come and go.
        """
        self._scene = scene
        for name in set(self._channels) - set(scene.loads):
            self._node.destroy_subscription(self._channels.pop(name))
        for name in sorted(set(scene.loads) - set(self._channels)):
            self._channels[name] = self._subscribe(f'~/loads/{name}', self._channel_key(name))

    def _subscribe(self, topic: str, find_key: Callable[[str], Key]) -> Any:
        resolved = self._node.resolve_topic_name(topic)

        def receive(data: bytes) -> None:
            try:
                self._runner.receive(self._judge(data, resolved, find_key))
            except ValueError as error:
                self._drop(resolved, str(error))

        return self._node.create_subscription(WrenchStamped, topic, receive, _QUALITY, raw=True)

    def _judge(self, data: bytes, topic: str, find_key: Callable[[str], Key]) -> WrenchInput:
        wrench = decode_wrench_stamped(data)
        key = find_key(wrench.frame_id)
        force, torque = np.array(wrench.first), np.array(wrench.second)
        if not (np.isfinite(force).all() and np.isfinite(torque).all()):
            raise Dropped(
                f'it is not finite (force {force.tolist()} N, torque {torque.tolist()} N m)'
            )
        return WrenchInput(topic, key, wrench.nanoseconds, force, torque, bytes(data))

    def _body_key(self, frame_id: str) -> Key:
        match = _BODY.fullmatch(frame_id)
        if match is None:
            raise Dropped(
                f"its header.frame_id is {frame_id!r}, and must be 'icosahedron_K' with the "
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
                    f'its header.frame_id is {frame_id!r}; loads.{name}.frame is {axes}, so it '
                    f'must be {allowed[0]!r} or {allowed[1]!r}'
                )
            return name

        return find

    def _drop(self, topic: str, reason: str) -> None:
        self.dropped += 1
        # Ten thousand bad messages a second must not become ten thousand lines: one a second for
        # each topic and kind of reason, which its first words tell.
        kind, now = f'{topic} {reason[:_KIND_LENGTH]}', time.monotonic()
        if now - self._warned.get(kind, -math.inf) < 1.0:
            return
        self._warned[kind] = now
        self._node.get_logger().warning(f'a wrench on {topic} was dropped: {reason}')
