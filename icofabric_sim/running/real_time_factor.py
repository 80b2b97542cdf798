# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Synchronisation of simulated time with wall time, and measurement of the real-time factor."""

from collections import deque
import math
import time as wall
from typing import NamedTuple

from icofabric_sim.messages.schedule import NANOSECONDS

# A larger lag [s] is dropped instead of caught up.
_MAX_LAG_S = 0.1
# Averaging time of the reported real-time factor [s of wall time].
_WINDOW_S = 2.0
# A thread that gets less than this fraction of the processor while it is busy shares the
# processor.
_SHARED_RATIO = 0.75
# A run that waits for this fraction of the time has time for other work.
_SPARE_RATIO = 0.2


class Mark(NamedTuple):
    """Counters at one time; seconds since the start, except for `time`."""

    wall: float
    time: int  # simulated [ns]
    computed: float  # in steps
    waited: float  # for the target real-time factor
    processor: float  # processor time of this thread


class RealTimeFactor:
    """Target and measured real-time factor."""

    def __init__(self, factor: float) -> None:
        """Set the target `factor`; 0 is as fast as possible."""
        self._target = factor
        self._speed = 0.0  # simulated nanoseconds per second of computing
        self._computed, self._waited = 0.0, 0.0
        self._waits_since: float | None = None
        self._marks: deque[Mark] = deque()
        self.restart(0)

    def set_target(self, factor: float, now: int) -> None:
        """Set another target `factor` from simulated time `now` [ns] on."""
        self._target = factor
        self.restart(now)

    def restart(self, now: int) -> None:
        """Restart the measurement: simulated time stood still, or jumped to `now` [ns]."""
        self._start_wall, self._start_time = wall.monotonic(), now
        self._waits_since = None
        mark = self._mark(self._start_wall, now)
        # Never empty, because other threads read the marks.
        self._marks = deque([mark])

    def forget_speed(self) -> None:
        """Measure the computing speed again after the fabric was replaced."""
        self._speed = 0.0

    def record_steps(self, simulated: int, seconds: float) -> None:
        """Record that `simulated` nanoseconds took `seconds` to compute."""
        self._computed += seconds
        if seconds > 0.0 and simulated > 0:
            speed = simulated / seconds
            self._speed = speed if self._speed == 0.0 else 0.8 * self._speed + 0.2 * speed

    def chunk(self, seconds: float, step: float) -> int:
        """
        Return the simulated nanoseconds computed in about `seconds`, at least one `step` [s].

        With a target real-time factor, return at most the simulated time of `seconds`, even if
        that is less than a step.
        """
        chunk = max(math.ceil(step * NANOSECONDS), int(self._speed * seconds))
        if self._target > 0.0:
            chunk = min(chunk, int(self._target * seconds * NANOSECONDS))
        return max(chunk, 1)

    def wait_time(self, now: int) -> float:
        """
        Return the wall time [s] to wait at simulated time `now` [ns] for the target factor.

        The next call marks the end of the wait.
        """
        clock = wall.monotonic()
        if self._waits_since is not None:
            self._waited += clock - self._waits_since
            self._waits_since = None
        if clock - self._marks[-1].wall > 0.05:
            self._marks.append(self._mark(clock, now))
            while clock - self._marks[0].wall > _WINDOW_S and len(self._marks) > 2:
                self._marks.popleft()
        if not self._target > 0.0:
            return 0.0
        ahead = (now - self._start_time) / NANOSECONDS / self._target - (clock - self._start_wall)
        if ahead < -_MAX_LAG_S:
            self._start_wall, self._start_time = clock, now
        if ahead > 0.0:
            self._waits_since = clock
        return max(ahead, 0.0)

    def measure(self, now: int) -> float:
        """Return the recent real-time factor."""
        first = self._marks[0]
        passed = wall.monotonic() - first.wall
        return (now - first.time) / NANOSECONDS / passed if passed > 0.0 else 0.0

    def has_spare_time(self) -> bool:
        """Return whether the run recently had time to wait; thread-safe."""
        marks = self._marks
        first, last = marks[0], marks[-1]
        return last.waited - first.waited >= _SPARE_RATIO * (last.wall - first.wall)

    def describe_time_use(self) -> str:
        """Describe how recent wall time was spent, i.e. why a run is not faster."""
        marks = self._marks
        first, last = marks[0], marks[-1]
        passed = last.wall - first.wall
        busy = passed - (last.waited - first.waited)
        if not busy > 0.0:
            return 'no steps were computed'
        steps = (last.computed - first.computed) / passed
        rest = max(busy / passed - steps, 0.0)
        text = f'{steps:.0%} of the time is spent in steps, {rest:.0%} in messages and changes'
        got = (last.processor - first.processor) / busy
        if got < _SHARED_RATIO:
            text += f'; the processor is shared: this thread got {got:.0%} of a core'
        return text

    def _mark(self, clock: float, now: int) -> Mark:
        return Mark(clock, now, self._computed, self._waited, wall.thread_time())
