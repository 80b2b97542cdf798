# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Queue between the recording thread and the caller: bounded in bytes, in order."""
from __future__ import annotations

from collections import deque
import threading
import time
from typing import Literal, NamedTuple

from icofabric_sim.bag.storage import TopicEntry


class RecorderStatistics(NamedTuple):
    """Counts of the received messages, and the lag of the writer."""

    written: int  # messages passed to the file
    written_bytes: int
    dropped: int  # rejected because the queue was full
    lost: int  # queued at a disk error, or received after the error or the end
    queued: int
    queued_bytes: int
    lag: float  # [s] since the oldest queued message was received


class Heading(NamedTuple):
    """Custom entry for files that are opened after this item."""

    key: str
    value: str


class Message(NamedTuple):
    """Message and its simulated time [ns]."""

    topic: str
    nanoseconds: int
    data: bytes


class End(NamedTuple):
    """Last item: finish the bag."""


Item = TopicEntry | Heading | Message | End


class MessageQueue:
    """
    Queue of items for the writing thread.

    A message counts as queued until the next one is taken, because only then is it written.
    """

    def __init__(self, capacity: int, overflow: Literal['wait', 'drop']) -> None:
        self._capacity = capacity  # bytes
        self._overflow = overflow
        # One lock guards all; the writing thread waits on `_filled`, callers on `_drained`.
        self._lock = threading.Lock()
        self._filled = threading.Condition(self._lock)
        self._drained = threading.Condition(self._lock)
        self._items: deque[Item] = deque()
        self._in_hand: Message | None = None
        self._arrivals: deque[float] = deque()  # [s], one for each unwritten message
        self._stopped = False
        self._written = self._written_bytes = self._dropped = self._lost = 0
        self._queued_bytes = 0

    def put_control(self, item: TopicEntry | Heading) -> None:
        """Append a topic or custom entry, which does not count towards the capacity."""
        with self._lock:
            if not self._stopped:
                self._items.append(item)
                self._filled.notify()

    def has_room(self, size: int) -> bool:
        """
        Return whether a message of `size` [bytes] that is not essential would be accepted now.
        """
        with self._lock:
            return not (self._stopped or 0 < self._queued_bytes > self._capacity - size)

    def put(self, topic: str, nanoseconds: int, data: bytes, *, essential: bool) -> bool:
        """
        Append a message, waiting if the overflow rule requires it; return False if rejected.

        Raise TimeoutError if an essential message exceeds the limit and waiting is not allowed.
        """
        limit = 2 * self._capacity if essential else self._capacity
        with self._lock:
            # A message larger than the queue is accepted when the queue is empty.
            while not self._stopped and 0 < self._queued_bytes > limit - len(data):
                if self._overflow == 'drop' and essential:
                    self._lost += 1
                    raise TimeoutError
                if self._overflow == 'drop':
                    self._dropped += 1
                    return False
                self._drained.wait()
            if self._stopped:
                self._lost += 1
                return False
            self._queued_bytes += len(data)
            self._arrivals.append(time.monotonic())
            self._items.append(Message(topic, nanoseconds, data))
            self._filled.notify()
        return True

    def take(self, until: float | None) -> Item | None:
        """Count the last message as written and return the next item, or None after a timeout."""
        with self._lock:
            if self._in_hand is not None:
                size = len(self._in_hand.data)
                self._in_hand = None
                self._arrivals.popleft()
                self._written += 1
                self._written_bytes += size
                self._queued_bytes -= size
                self._drained.notify_all()
            while not self._items:
                wait = None if until is None else until - time.monotonic()
                if wait is not None and not wait > 0.0:
                    return None
                self._filled.wait(wait)
            item = self._items.popleft()
            if isinstance(item, Message):
                self._in_hand = item
            return item

    def end(self) -> None:
        """Reject further messages; queued ones are still written."""
        with self._lock:
            if not self._stopped:
                self._stopped = True
                self._items.append(End())
                self._filled.notify()
                self._drained.notify_all()

    def give_up(self, *, written: int | None = None) -> None:
        """
        Reject further messages and drop the queued ones.

        When called from the writing thread, `written` is the number of messages that reached the
        file. Otherwise the message being written may still reach it.
        """
        with self._lock:
            self._stopped = True
            self._lost += sum(isinstance(item, Message) for item in self._items)
            if written is not None:
                self._lost += self._written + (self._in_hand is not None) - written
                self._written = written
                self._in_hand = None
            self._items.clear()
            if self._in_hand is None:
                self._arrivals.clear()
                self._queued_bytes = 0
            else:
                self._arrivals = deque([self._arrivals[0]])
                self._queued_bytes = len(self._in_hand.data)
            self._items.append(End())
            self._filled.notify()
            self._drained.notify_all()

    @property
    def statistics(self) -> RecorderStatistics:
        with self._lock:
            lag = time.monotonic() - self._arrivals[0] if self._arrivals else 0.0
            return RecorderStatistics(
                self._written, self._written_bytes, self._dropped, self._lost,
                len(self._arrivals), self._queued_bytes, lag)
