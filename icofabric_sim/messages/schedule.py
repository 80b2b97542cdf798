# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Output times: output k is at round(k 1e9 / rate) nanoseconds, without drift."""

from fractions import Fraction

NANOSECONDS = 10**9


class Schedule:
    """Output times of one rate [Hz] in integer nanoseconds."""

    def __init__(self, rate: float) -> None:
        """Schedule outputs at `rate` [Hz] of simulated time, the first at 0."""
        self.rate = rate
        self._period = Fraction(NANOSECONDS) / Fraction(rate)

    def time(self, k: int) -> int:
        """Return the nanoseconds of output k."""
        return round(k * self._period)

    def after(self, now: int) -> int:
        """Return the nanoseconds of the first output after `now`."""
        k = int(now / self._period)
        while self.time(k) > now:
            k -= 1
        while self.time(k) <= now:
            k += 1
        return self.time(k)

    def is_due(self, now: int) -> bool:
        """Return whether an output is exactly at `now`."""
        return self.time(round(now / self._period)) == now


def seconds(nanoseconds: int) -> float:
    """Return integer nanoseconds in seconds, correctly rounded and therefore reproducible."""
    return nanoseconds / NANOSECONDS


def nanoseconds_not_before(time: float) -> int:
    """Return the smallest integer nanoseconds whose seconds are not before `time` [s]."""
    result = int(time * NANOSECONDS)
    while result > 0 and seconds(result - 1) >= time:
        result -= 1
    while seconds(result) < time:
        result += 1
    return result
