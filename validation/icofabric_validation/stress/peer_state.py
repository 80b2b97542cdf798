# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""State of a run in another program, in our units and frames, and its steps."""

from bisect import bisect_right
from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

# Part of a step by which a stretch of time may be longer than whole steps.
_ROUNDING = 1e-9


class State(NamedTuple):
    """Where all bodies are, and how they move; world frame, SI units."""

    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) x y z w, body to world
    linear_velocity: np.ndarray  # (n, 3) [m/s]
    angular_velocity: np.ndarray  # (n, 3) [rad/s]
    intact: np.ndarray  # (c,) bool: nothing breaks


class Steps:
    """
    Steps of one length, or a little shorter ones where a stretch of time must end with a step.

    So no step leads over the end of a piece of a load, beyond which no method keeps its order.
    """

    def __init__(self, longest: float, ends: Sequence[float]) -> None:
        """Have steps of at most `longest` [s], and one that ends at each of the `ends` [s]."""
        self._starts, self._firsts, self._lengths = [0.0], [0], []
        for end in ends:
            stretch = end - self._starts[-1]
            count = max(math.ceil(stretch / longest - _ROUNDING), 1)
            self._lengths.append(stretch / count)
            self._starts.append(end)
            self._firsts.append(self._firsts[-1] + count)
        self._lengths.append(longest)

    def time(self, count: int) -> float:
        """Time [s] after so many steps."""
        part = self.part(count)
        return self._starts[part] + (count - self._firsts[part]) * self._lengths[part]

    def length(self, count: int) -> float:
        """Length [s] of the step after so many."""
        return self._lengths[self.part(count)]

    def alike(self, count: int, most: int) -> int:
        """How many of the `most` steps after so many have its length, in its stretch of time."""
        firsts, part = self._firsts, self.part(count) + 1
        return min(firsts[part] - count, most) if part < len(firsts) else most

    def within(self, count: int) -> float:
        """A time [s] inside the stretch of time of the step after so many."""
        return self.time(count) + 0.5 * self.length(count)

    def until(self, count: int, time: float, most: int) -> int:
        """Count steps after so many to a later `time` [s] or beyond it: from one to `most`."""
        return int(min(max(math.ceil(
            (time - self.time(count)) / self.length(count)), 1), self.alike(count, most)))

    def part(self, count: int) -> int:
        """Number of the stretch of time of the step after so many."""
        return bisect_right(self._firsts, count) - 1
