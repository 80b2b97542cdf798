# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Keeps simulated time in step with wall time, and measures how well that goes.
"""

from collections import deque
import math
import time as wall

from icofabric_sim.schedule import NANOSECONDS

# A lag beyond this is given up instead of made up for later [s].
_LARGEST_LAG = 0.1
# The factor is reported over about this much wall time [s].
_WINDOW = 2.0


class Pace:
    """
    Wanted and achieved ratio of simulated to wall time.
    """

    def __init__(self, factor: float) -> None:
        """
        Aim at `factor`; 0 is as fast as possible.
        """
        self._factor = factor
        self._speed = 0.0  # simulated nanoseconds for each second of computing
        self._marks: deque[tuple[float, int]] = deque()
        self.restart(0)

    def set_factor(self, factor: float, now: int) -> None:
        """
        Aim at another `factor` from simulated time `now` [ns] on.
        """
        self._factor = factor
        self.restart(now)

    def restart(self, now: int) -> None:
        """
        Count from here: simulated time stood still, or jumped to `now` [ns].
        """
        self._start_wall, self._start_time = wall.monotonic(), now
        self._marks.clear()
        self._marks.append((self._start_wall, now))

    def forget_speed(self) -> None:
        """
        Learn the speed of computing anew: another fabric has come.
        """
        self._speed = 0.0

    def learn(self, simulated: int, seconds: float) -> None:
        """
        Note that `simulated` nanoseconds took `seconds` to compute.
        """
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
        """
        clock = wall.monotonic()
        if clock - self._marks[-1][0] > 0.05:
            self._marks.append((clock, now))
            while clock - self._marks[0][0] > _WINDOW and len(self._marks) > 2:
                self._marks.popleft()
        if not self._factor > 0.0:
            return 0.0
        ahead = (now - self._start_time) / NANOSECONDS / self._factor - (clock - self._start_wall)
        if ahead < -_LARGEST_LAG:
            self._start_wall, self._start_time = clock, now
        return max(ahead, 0.0)

    def factor(self, now: int) -> float:
        """
        Achieved ratio over the last while.
        """
        since, start = self._marks[0]
        passed = wall.monotonic() - since
        return (now - start) / NANOSECONDS / passed if passed > 0.0 else 0.0
