# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Detection of nodes with the same name: their topics and services are indistinguishable.

A node that finds another one before it creates its topics does not start. On a busy machine
discovery takes up to some seconds, which a start does not wait for. A conflict found later is
reported in the log and in every /diagnostics message.
"""

import time

from icofabric_sim.messages.topics import POSES
from icofabric_sim.running.rate_limited_log import RateLimitedLog
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

_INTERVAL_S = 2.0  # [s] of wall time
# Time [s] in the graph within which nodes of this machine are discovered.
_DISCOVERY_S = 0.4


class NameWatch:
    """
    Check of the node's name: it must be unique at the start; later a warning, also in `note`.
    """

    def __init__(self, node: Node, begun: float | None = None) -> None:
        """Search for nodes named like `node`; the search began at `begun` (time.monotonic())."""
        self._node, self._begun = node, time.monotonic() if begun is None else begun
        self._name = node.get_fully_qualified_name()
        self._warnings = RateLimitedLog(node.get_logger().warning)
        self.note = ''

    def require_first(self) -> None:
        """
        Raise ValueError if another fabric has the name; call before any topic is created.

        Two nodes that start simultaneously find each other while they run.
        """
        while not self._is_taken():
            if time.monotonic() - self._begun > _DISCOVERY_S:
                return
            time.sleep(0.02)
        raise ValueError(
            f'another node {self._name} is already running; topics and services of the two could '
            'not be distinguished: stop it, or give this node another name or namespace '
            '(-r __node:=NAME, -r __ns:=/NAME) or another ROS_DOMAIN_ID')

    def begin(self) -> None:
        """Check for other nodes periodically while the node runs."""
        # A steady clock: with use_sim_time the node's clock stands still while time is paused.
        self._node.create_timer(
            _INTERVAL_S, self._check, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _is_taken(self) -> bool:
        topic = self._node.resolve_topic_name(POSES.name)
        return any(
            _full_name(info.node_name, info.node_namespace) == self._name
            for info in self._node.get_publishers_info_by_topic(topic))

    def _check(self) -> None:
        count = sum(
            _full_name(name, namespace) == self._name
            for name, namespace in self._node.get_node_names_and_namespaces())
        note = '' if count < 2 else (
            f'{count} nodes are named {self._name}: their topics and services cannot be '
            'distinguished; stop one of them')
        if note:
            self._warnings.log(self._name, note)
        self.note = note


def _full_name(name: str, namespace: str) -> str:
    return f'{namespace.rstrip("/")}/{name}'
