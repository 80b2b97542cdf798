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
"""
Finds other nodes of the same name: their topics and services cannot be told apart.

A node that finds one before it has topics of its own does not start. That takes the middleware up
to some seconds on a busy machine, for which a start does not wait: who finds it later says so in
the log and with every report on /diagnostics.
"""

import time

from icofabric_sim.messages.topics import POSES
from icofabric_sim.running.complaints import Complaints
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

_INTERVAL = 2.0  # [s] of wall time
# Time [s] in the graph in which nodes of this machine are found.
_LOOK_AROUND = 0.4


class NameWatch:
    """Refuses to be the second node of a name; says it of one that comes later, in `note` too."""

    def __init__(self, node: Node, begun: float | None = None) -> None:
        """Look around for `node`; since `begun`, by time.monotonic(), where that was earlier."""
        self._node, self._begun = node, time.monotonic() if begun is None else begun
        self._name = node.get_fully_qualified_name()
        self._complaints = Complaints(node.get_logger().warning)
        self.note = ''

    def require_first(self) -> None:
        """
        Raise ValueError where another fabric has the name; before any topic of the own is there.

        Two that start at once find each other once they run.
        """
        while not self._is_taken():
            if time.monotonic() - self._begun > _LOOK_AROUND:
                return
            time.sleep(0.02)
        raise ValueError(
            f'another node {self._name} runs already, and topics and services of the two could '
            'not be told apart: end it, or give this one a name or namespace of its own '
            '(-r __node:=NAME, -r __ns:=/NAME) or another ROS_DOMAIN_ID')

    def begin(self) -> None:
        """Watch for others while the node runs."""
        # A steady clock: with use_sim_time the node's own stands still while time is paused.
        self._node.create_timer(
            _INTERVAL, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _is_taken(self) -> bool:
        topic = self._node.resolve_topic_name(POSES.name)
        return any(
            _full(info.node_name, info.node_namespace) == self._name
            for info in self._node.get_publishers_info_by_topic(topic))

    def _look(self) -> None:
        count = sum(
            _full(name, namespace) == self._name
            for name, namespace in self._node.get_node_names_and_namespaces())
        note = '' if count < 2 else (
            f'{count} nodes are named {self._name}: their topics and services cannot be told '
            'apart; end one of them')
        if note:
            self._complaints.add(self._name, note)
        self.note = note


def _full(name: str, namespace: str) -> str:
    return f'{namespace.rstrip("/")}/{name}'
