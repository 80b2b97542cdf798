# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Location of the first time within a step at which one of several quantities reaches zero."""

from collections.abc import Callable
from typing import NamedTuple

from icofabric_sim.kernels.breakage import DOUBT, TOGETHER
import numpy as np

# The place of a crossing is divided no further than this, in parts of the step.
_FINEST = 1e-15
# Roots of a cubic are places to try next, no more.
_STEPS, _CLOSE = 60, 1e-12
_NEAREST = 1e-9


class Moment(NamedTuple):
    """Values of event functions at a fraction of a step, and their slopes."""

    x: float  # part of the step
    value: np.ndarray  # (m,), at zero or above: reached
    slope: np.ndarray  # (m,) change in a whole step

    def reached(self, close: np.ndarray) -> np.ndarray:
        """
        Return which quantities reached zero, (m,) bool, or rise and are as `close` (m,) to zero.
        """
        return (self.value >= 0.0) | ((self.value >= -close) & (self.slope > 0.0))


def first_crossing(
    moment_at: Callable[[float], Moment], close: np.ndarray, doubt: float = DOUBT
) -> Moment | None:
    """
    Return the first moment at which a quantity is as `close` (m,) to zero, or above; None: never.

    `moment_at` returns the quantities at a fraction 0 to 1 of the step. A crossing is detected by
    a value above zero, or by a value that rose before and falls after while zero is possible in
    between. The latter test uses the fraction `doubt` of the distance from a cubic to its
    tangents.
    """
    start, end = moment_at(0.0), moment_at(1.0)
    if start.reached(close).any():
        return start
    waiting = [(start, end)]
    while waiting:
        before, after = waiting.pop()
        reached = after.reached(close).any()
        x = _likely_place(before, after, doubt, humps_only=bool(
            reached and (after.value <= close).all()))
        if x is None or after.x - before.x <= _FINEST:
            if reached:
                return after
            continue
        middle = moment_at(x)
        if not middle.reached(close).any():
            waiting.append((middle, after))
        waiting.append((before, middle))
    return None


def first_limit(
    lengths_at: Callable[[float], tuple[np.ndarray, np.ndarray]], longest: np.ndarray,
    shortest: np.ndarray, duration: float, doubt: float = DOUBT
) -> tuple[float, np.ndarray] | None:
    """
    Return the fraction of a step at which lengths first reach a limit, and which, (m,) bool.

    `lengths_at` returns lengths [m] and their rates [m/s], (m,) each, at a fraction 0 to 1. Limits
    are `longest` (infinite: none) and `shortest` (0: none) [m]; `duration` is that of the step
    [s]. All lengths that have reached their limits, or nearly, are included: see `TOGETHER`. The
    result is None without any.
    """
    close = TOGETHER * np.concatenate([np.where(longest < np.inf, longest, 0.0), shortest])

    def at(part: float) -> Moment:
        length, rate = lengths_at(part)
        return Moment(
            part, np.concatenate([length - longest, shortest - length]),
            duration * np.concatenate([rate, -rate]))

    moment = first_crossing(at, close, doubt)
    if moment is None:
        return None
    reached = moment.reached(close)
    return moment.x, reached[:len(longest)] | reached[len(longest):]


def _likely_place(
    before: Moment, after: Moment, doubt: float, *, humps_only: bool = False
) -> float | None:
    """
    Return the likely place of the first zero between two moments; None without one.

    `humps_only`: and be below it again at the second.
    """
    width = after.x - before.x
    low, high = before.value, after.value
    rise, fall = width * before.slope, -width * after.slope
    places = []
    above = high > 0.0
    if above.any() and not humps_only:
        places.append(_root(*(part[above] for part in (low, rise, high, fall))))
    # What has no limit is infinitely far from it.
    turning = (rise > 0.0) & (fall > 0.0) & ~above & np.isfinite(low)
    if turning.any():
        low, high, rise, fall = (part[turning] for part in (low, high, rise, fall))
        x = rise / (rise + fall)
        cubic = _cubic(x, low, rise, high, fall)
        tangent = np.minimum(low + rise * x, high + fall * (1.0 - x))
        places.append(x[cubic + doubt * (tangent - cubic) >= 0.0])
    every = np.concatenate(places) if places else np.zeros(0)
    if not len(every):
        return None
    # Not an end itself: the step is divided there.
    return before.x + width * min(max(float(every.min()), _NEAREST), 1.0 - _NEAREST)


def _cubic(
    x: np.ndarray, low: np.ndarray, rise: np.ndarray, high: np.ndarray, fall: np.ndarray
) -> np.ndarray:
    """
    Return the cubic from `low` to `high` with slopes `rise` at its start and -`fall` at its end.
    """
    y = 1.0 - x
    cubic = low * y * y * (1.0 + x + x) + high * x * x * (1.0 + y + y)
    return np.asarray(cubic + x * y * (rise * y + fall * x))


def _root(low: np.ndarray, rise: np.ndarray, high: np.ndarray, fall: np.ndarray) -> np.ndarray:
    """
    Return the zero of that rising cubic, as a fraction of the interval.

    By Newton's method, halved where it leaves the interval that is left.
    """
    left, right = np.zeros_like(low), np.ones_like(low)
    x = low / (low - high)
    for _ in range(_STEPS):
        value, y = _cubic(x, low, rise, high, fall), 1.0 - x
        below = value < 0.0
        left, right = np.where(below, x, left), np.where(below, right, x)
        slope = 6.0 * x * y * (high - low) + rise * y * (y - 2.0 * x) + fall * x * (2.0 * y - x)
        following = x - value / np.where(slope == 0.0, np.inf, slope)
        inside = (following > left) & (following < right)
        following = np.where(inside, following, 0.5 * (left + right))
        done = np.abs(following - x).max() <= _CLOSE
        x = following
        if done:
            break
    return x
