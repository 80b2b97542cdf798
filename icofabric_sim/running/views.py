# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Rate limits of updates for viewer pages, by the wall clock.

A run at full speed has hundreds of outputs in a second of wall time, of which a page draws a few.
Building and sending the others would reduce its speed by up to two thirds. The cost of a message
is its processor time, because wall time is longer while other programs compute.
"""

import time as wall

from icofabric_sim.messages import topics
from icofabric_sim.messages.topics import Topic

# Wall time between two messages [s], and the largest ratio of their processor time to wall time.
_INTERVALS = {topics.POSES: 1.0 / 60.0}
_INTERVAL = 0.1
_SHARES = {topics.POSES: 0.012, topics.CONNECTORS: 0.008}
_SHARE = 0.004
# Poses that take at most this processor time [s] are sent at this interval [s], independent of the
# ratio: every second output at 60 Hz, also if outputs are slightly early.
_CHEAP_S, _CHEAP_INTERVAL_S = 1.5e-3, 1.0 / 36.0


class Views:
    """Schedule of the topics in `VIEWS`."""

    def __init__(self) -> None:
        """Allow all topics at first."""
        self._next = dict.fromkeys(topics.VIEWS, 0.0)
        self._costs = dict.fromkeys(topics.VIEWS, 0.0)  # processor time of the last message [s]

    def due(self) -> list[tuple[Topic, Topic]]:
        """Return pairs of a topic and its view that may be sent now."""
        now = wall.monotonic()
        return [(topic, view) for topic, view in topics.VIEWS.items() if now >= self._next[topic]]

    def sent(self, topic: Topic, began: float, cost: float) -> None:
        """Record the start (time.monotonic()) and the processor time of a message."""
        # A single measurement may include an interruption.
        cost, self._costs[topic] = min(cost, self._costs[topic]), cost
        interval = cost / _SHARES.get(topic, _SHARE)
        if topic is topics.POSES and cost <= _CHEAP_S:
            interval = min(interval, _CHEAP_INTERVAL_S)
        # From its start, so that frames are on time.
        self._next[topic] = began + max(interval, _INTERVALS.get(topic, _INTERVAL))
