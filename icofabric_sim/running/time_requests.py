# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Requests that advance simulated time: solver steps, and advances by a duration."""

from collections import deque
from concurrent.futures import Future
import logging
from typing import Any

from icofabric_sim.messages.schedule import seconds

_LOGGER = logging.getLogger('icofabric_sim')


class StepRequest:
    """Number of solver steps, taken in portions."""

    def __init__(self, count: int | None = None) -> None:
        """Request `count` steps; None: the `step_count` in force when they start."""
        self._wanted, self.count, self.taken = count, count or 0, 0
        self.is_shown = False  # whether the state at its end is published
        self.future: Future[Any] = Future()

    def begin(self, step_count: int) -> None:
        """Set the number of steps, unless the request has one."""
        self.count = step_count if self._wanted is None else self._wanted

    @property
    def done(self) -> bool:
        """Return whether all steps are taken."""
        return self.taken >= self.count

    def reached(self, now: int) -> str:
        """Return the progress at time `now` [ns] as text."""
        return f'{self.taken} of {self.count} solver steps taken'


class AdvanceRequest:
    """Duration of simulated time in whole nanoseconds."""

    def __init__(self, duration: int | None = None) -> None:
        """Request a `duration` [ns]; None: the `advance_duration` when it is processed."""
        self.duration, self.start, self.end = duration, 0, 0
        self.is_shown = False  # whether the state at its end is published
        self.future: Future[Any] = Future()

    @property
    def has_begun(self) -> bool:
        """Return whether the end of the advance is known."""
        return self.end > 0

    def begin(self, now: int) -> None:
        """Start at time `now` [ns]."""
        assert self.duration is not None
        self.start, self.end = now, now + self.duration

    def reached(self, now: int) -> str:
        """Return the progress at time `now` [ns] as text."""
        if not self.has_begun:
            return 'not advanced'
        return (f'advanced by {seconds(now - self.start):.9f} of '
                f'{seconds(self.end - self.start):.9f} s')


class TimeRequests:
    """
    Queue of requests that advance the time; answers include the reason of an early end.

    Advances requested while time runs only wait for their end, in a separate list.
    """

    def __init__(self) -> None:
        """Create an empty queue."""
        self._queue: deque[StepRequest | AdvanceRequest] = deque()
        self._waiting: list[AdvanceRequest] = []

    def add(self, request: StepRequest | AdvanceRequest) -> None:
        """Queue a request."""
        self._queue.append(request)

    @property
    def current(self) -> StepRequest | AdvanceRequest | None:
        """Return the request that advances the time."""
        return self._queue[0] if self._queue else None

    def finish(self, now: int) -> None:
        """Answer the current request with the time [ns] reached."""
        self._queue.popleft().future.set_result(now)

    def wait(self, request: AdvanceRequest) -> None:
        """Answer a started request once its end is reached."""
        self._waiting.append(request)

    def next_time(self) -> int | None:
        """Return the earliest time [ns] that a request waits for, or None."""
        return min((request.end for request in self._waiting), default=None)

    def answer(self, now: int) -> None:
        """Answer the requests that waited for the time `now` [ns]."""
        for request in [item for item in self._waiting if item.end <= now]:
            self._waiting.remove(request)
            request.future.set_result(now)

    def end(self, reason: str, now: int) -> None:
        """Answer all pending requests with the `reason` why they end at time `now` [ns]."""
        pending = [*self._queue, *self._waiting]
        self._queue.clear()
        self._waiting.clear()
        for request in pending:
            text = f'{request.reached(now)}: {reason}'
            _LOGGER.warning('%s', text)
            request.future.set_exception(RuntimeError(text))
