# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""State and steps of a run in another program, in SI units and the world frame."""

from bisect import bisect_right
from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

# Fraction of a step by which an interval may exceed whole steps.
_ROUND_OFF_RATIO = 1e-9


class State(NamedTuple):
    """Poses and velocities of all bodies in the world frame, in SI units."""

    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) x y z w, body to world
    linear_velocity: np.ndarray  # (n, 3) [m/s]
    angular_velocity: np.ndarray  # (n, 3) [rad/s]
    intact: np.ndarray  # (c,) bool; no connector breaks


class Steps:
    """
    Steps of one length, or slightly shorter ones in intervals that must end with a step.

    No step crosses a time at which a load jumps, where methods lose their order.
    """

    def __init__(self, longest: float, ends: Sequence[float]) -> None:
        """Divide time into steps of at most `longest` [s]; steps end at each of `ends` [s]."""
        self._starts, self._firsts, self._lengths = [0.0], [0], []
        for end in ends:
            interval = end - self._starts[-1]
            count = max(math.ceil(interval / longest - _ROUND_OFF_RATIO), 1)
            self._lengths.append(interval / count)
            self._starts.append(end)
            self._firsts.append(self._firsts[-1] + count)
        self._lengths.append(longest)

    def time(self, count: int) -> float:
        """Return the time [s] after `count` steps."""
        interval = self.interval(count)
        return self._starts[interval] + (count - self._firsts[interval]) * self._lengths[interval]

    def length(self, count: int) -> float:
        """Return the length [s] of the step after `count` steps."""
        return self._lengths[self.interval(count)]

    def count_equal(self, count: int, most: int) -> int:
        """Count the steps of equal length and interval after `count` steps, at most `most`."""
        firsts, interval = self._firsts, self.interval(count) + 1
        return min(firsts[interval] - count, most) if interval < len(firsts) else most

    def middle(self, count: int) -> float:
        """Return the middle [s] of the step after `count` steps, which is inside its interval."""
        return self.time(count) + 0.5 * self.length(count)

    def count_until(self, count: int, time: float, most: int) -> int:
        """Count equal steps after `count` steps until a later `time` [s], from 1 to `most`."""
        return int(min(max(math.ceil(
            (time - self.time(count)) / self.length(count)), 1), self.count_equal(count, most)))

    def interval(self, count: int) -> int:
        """Return the number of the interval that has the step after `count` steps."""
        return bisect_right(self._firsts, count) - 1
