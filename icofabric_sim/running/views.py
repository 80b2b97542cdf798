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
When a page that draws a run is sent what is new: by the wall clock, and not too often.

A run as fast as possible has hundreds of outputs in a second of wall time, of which a page draws a
few; to lay out and to send the others would cost the run up to two thirds of its pace. What a
message costs is its processor time: wall time is longer where other programs compute.
"""

import time as wall

from icofabric_sim.messages import topics
from icofabric_sim.messages.topics import Topic

# Wall time between two messages [s], and the largest ratio of their processor time to wall time.
_INTERVALS = {topics.POSES: 1.0 / 60.0}
_INTERVAL = 0.1
_SHARES = {topics.POSES: 0.012, topics.CONNECTORS: 0.008}
_SHARE = 0.004
# Poses that take no more processor time [s] are sent at this interval [s], whatever their share:
# every second output of 60 Hz, also of outputs that are a little early.
_CHEAP_S, _CHEAP_INTERVAL_S = 1.5e-3, 1.0 / 36.0


class Views:
    """The topics of `VIEWS`: which of them may be sent now."""

    def __init__(self) -> None:
        """All may be sent at first."""
        self._next = dict.fromkeys(topics.VIEWS, 0.0)
        self._costs = dict.fromkeys(topics.VIEWS, 0.0)  # of the last message [s]

    def due(self) -> list[tuple[Topic, Topic]]:
        """Pairs of a topic, and its view, that may be sent now."""
        now = wall.monotonic()
        return [(topic, view) for topic, view in topics.VIEWS.items() if now >= self._next[topic]]

    def sent(self, topic: Topic, began: float, cost: float) -> None:
        """Note a message that was begun at `began` of time.monotonic(), and its processor time."""
        # One alone may have been interrupted.
        cost, self._costs[topic] = min(cost, self._costs[topic]), cost
        interval = cost / _SHARES.get(topic, _SHARE)
        if topic is topics.POSES and cost <= _CHEAP_S:
            interval = min(interval, _CHEAP_INTERVAL_S)
        # From its beginning, so that frames come in time.
        self._next[topic] = began + max(interval, _INTERVALS.get(topic, _INTERVAL))
