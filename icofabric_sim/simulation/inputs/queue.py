# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Queue of a run's inputs: inputs given ahead of their time, ends of holds, and received messages.

Checkpoints leave the messages out, and a restored checkpoint leaves them in place. They belong to
the run that received them, which records each one after it has acted and can drop waiting ones.
"""

from collections.abc import Callable, Iterable, Iterator
import heapq
import math
from typing import Any, NamedTuple

from icofabric_sim.simulation.inputs.input_types import Target, Value


class Event(NamedTuple):
    """Start of an input, or (`value` None) the end of its hold time."""

    time: float  # [s]
    rank: int  # at one time, holds end before inputs begin
    sequence: int
    target: Target
    value: Value | None
    message: Any = None  # what was received, for the caller that records it


class InputQueue:
    """Events by time; at equal times ends of holds first, then in the order of arrival."""

    def __init__(self) -> None:
        """Start empty."""
        self._heap: list[Event] = []
        self._sequence = 0
        self.message_count = 0

    def __len__(self) -> int:
        """Count the events."""
        return len(self._heap)

    def __iter__(self) -> Iterator[Event]:
        """Iterate over the events in their order."""
        return iter(sorted(self._heap, key=lambda event: event[:3]))

    @property
    def next_time(self) -> float:
        """Time [s] of the next event; infinite without any."""
        return self._heap[0].time if self._heap else math.inf

    def put(
        self, time: float, target: Target, value: Value | None, message: Any = None
    ) -> None:
        """Add an event at `time` [s]."""
        rank = 0 if value is None else 1
        heapq.heappush(self._heap, Event(time, rank, self._sequence, target, value, message))
        self._sequence += 1
        self.message_count += message is not None

    def take(self) -> Event:
        """Remove and return the next event."""
        event = heapq.heappop(self._heap)
        self.message_count -= event.message is not None
        return event

    def refill(self, events: Iterable[Event]) -> None:
        """Replace all events; events of equal times and ranks keep the order given."""
        kept = list(events)
        self._heap.clear()
        self.message_count = 0
        for event in kept:
            self.put(event.time, event.target, event.value, event.message)

    def drop_messages(self, is_lost: Callable[[Target], bool]) -> list[Event]:
        """Remove and return the messages whose target is lost, in their order."""
        lost = [event for event in self if event.message is not None and is_lost(event.target)]
        if lost:
            gone = {event.sequence for event in lost}
            self.refill([event for event in self if event.sequence not in gone])
        return lost
