# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Detection of other publishers of /clock: nodes can follow only one clock."""

from icofabric_sim.messages.topics import CLOCK
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

_INTERVAL_S = 1.0  # [s] of wall time
# Name that the middleware gives to a publisher whose node is not discovered yet.
_UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'


class ClockWatch:
    """
    Monitor that warns once of each other publisher of /clock and keeps the warning in `note`.
    """

    def __init__(self, node: Node) -> None:
        """Monitor /clock for `node`, which publishes it."""
        self._node = node
        self._own = node.get_fully_qualified_name()
        self._told: set[str] = set()
        self.note = ''
        # A steady clock: with use_sim_time the node's own clock stands still while time is paused.
        node.create_timer(_INTERVAL_S, self._check, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _check(self) -> None:
        others = self._find_others()
        self.note = ''
        if others:
            self.note = (
                f'/clock is also published by {", ".join(others)}: its subscribers receive two '
                'different times; set publish_clock to false on all nodes except one')
        if set(others) - self._told:
            self._node.get_logger().warning(self.note)
        self._told = set(others)

    def _find_others(self) -> list[str]:
        names = sorted(
            f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for info in self._node.get_publishers_info_by_topic(CLOCK.name)
            if info.node_name != _UNKNOWN_NODE
        )
        if self._own in names:
            names.remove(self._own)  # once: another node may have the same name
        return names
