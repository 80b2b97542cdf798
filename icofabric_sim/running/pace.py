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
"""Keeps simulated time in step with wall time, and measures how well that goes and why."""

from collections import deque
import math
import time as wall
from typing import NamedTuple

from icofabric_sim.messages.schedule import NANOSECONDS

# A lag beyond this is given up instead of made up for later [s].
_LARGEST_LAG = 0.1
# The factor is reported over about this much wall time [s].
_WINDOW = 2.0
# A thread that gets less of the processor than this part of the time in which it wants to work
# shares it with others.
_SHARED = 0.75
# A run that waits for this part of the time can do other things.
_SPARE = 0.2


class Mark(NamedTuple):
    """How far everything was at one moment; seconds since the start, but for `time`."""

    wall: float
    time: int  # simulated [ns]
    computed: float  # in the steps
    waited: float  # for the wanted pace
    processor: float  # that this thread got


class Pace:
    """Wanted and achieved ratio of simulated to wall time."""

    def __init__(self, factor: float) -> None:
        """Aim at `factor`; 0 is as fast as possible."""
        self._factor = factor
        self._speed = 0.0  # simulated nanoseconds for each second of computing
        self._computed, self._waited = 0.0, 0.0
        self._waits_since: float | None = None
        self._marks: deque[Mark] = deque()
        self.restart(0)

    def set_factor(self, factor: float, now: int) -> None:
        """Aim at another `factor` from simulated time `now` [ns] on."""
        self._factor = factor
        self.restart(now)

    def restart(self, now: int) -> None:
        """Count from here: simulated time stood still, or jumped to `now` [ns]."""
        self._start_wall, self._start_time = wall.monotonic(), now
        self._waits_since = None
        mark = self._mark(self._start_wall, now)
        # Never empty: other threads read the marks.
        self._marks = deque([mark])

    def forget_speed(self) -> None:
        """Measure the speed of computing again: the fabric was replaced."""
        self._speed = 0.0

    def learn(self, simulated: int, seconds: float) -> None:
        """Note that `simulated` nanoseconds took `seconds` to compute."""
        self._computed += seconds
        if seconds > 0.0 and simulated > 0:
            speed = simulated / seconds
            self._speed = speed if self._speed == 0.0 else 0.8 * self._speed + 0.2 * speed

    def chunk(self, seconds: float, step: float) -> int:
        """
        Simulated nanoseconds that take about `seconds` to compute, at least one solver `step` [s].

        At a wanted pace no more than pass in `seconds`, even if that is less than a step.
        """
        chunk = max(math.ceil(step * NANOSECONDS), int(self._speed * seconds))
        if self._factor > 0.0:
            chunk = min(chunk, int(self._factor * seconds * NANOSECONDS))
        return max(chunk, 1)

    def delay(self, now: int) -> float:
        """
        Wall time [s] to wait at simulated time `now` [ns] for the wanted pace.

        To be asked again after the wait, which ends with that.
        """
        clock = wall.monotonic()
        if self._waits_since is not None:
            self._waited += clock - self._waits_since
            self._waits_since = None
        if clock - self._marks[-1].wall > 0.05:
            self._marks.append(self._mark(clock, now))
            while clock - self._marks[0].wall > _WINDOW and len(self._marks) > 2:
                self._marks.popleft()
        if not self._factor > 0.0:
            return 0.0
        ahead = (now - self._start_time) / NANOSECONDS / self._factor - (clock - self._start_wall)
        if ahead < -_LARGEST_LAG:
            self._start_wall, self._start_time = clock, now
        if ahead > 0.0:
            self._waits_since = clock
        return max(ahead, 0.0)

    def factor(self, now: int) -> float:
        """Achieved ratio over the last while."""
        first = self._marks[0]
        passed = wall.monotonic() - first.wall
        return (now - first.time) / NANOSECONDS / passed if passed > 0.0 else 0.0

    def has_time(self) -> bool:
        """Whether it waits for the wanted pace in a part of the last while; for any thread."""
        marks = self._marks
        first, last = marks[0], marks[-1]
        return last.waited - first.waited >= _SPARE * (last.wall - first.wall)

    def cause(self) -> str:
        """Describe what the last wall time was spent on: why a run is not faster."""
        marks = self._marks
        first, last = marks[0], marks[-1]
        passed = last.wall - first.wall
        busy = passed - (last.waited - first.waited)
        if not busy > 0.0:
            return 'nothing was computed'
        steps = (last.computed - first.computed) / passed
        rest = max(busy / passed - steps, 0.0)
        text = f'{steps:.0%} of the time goes into the steps, {rest:.0%} into messages and changes'
        got = (last.processor - first.processor) / busy
        if got < _SHARED:
            text += f'; the processor is shared: this thread got {got:.0%} of one'
        return text

    def _mark(self, clock: float, now: int) -> Mark:
        return Mark(clock, now, self._computed, self._waited, wall.thread_time())
