# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Times of contestants, measured in rounds in which all take part, so that a drift hits all alike.
"""

from collections.abc import Callable, Sequence
import statistics
import time
from typing import NamedTuple

# A run shorter than this [s] is repeated within its round, at most so often.
_BLOCK, _REPEATS = 0.03, 9
# The same for plain steps, whose differences are smaller.
STEPS_BLOCK = 0.15


class Spread(NamedTuple):
    """Median and range."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> 'Spread':
        """Of at least one value."""
        return cls(statistics.median(values), min(values), max(values))

    def text(self, digits: int = 3) -> str:
        """Median (low-high)."""
        low, high = (_figures(value, digits) for value in (self.low, self.high))
        return f'{_figures(self.median, digits)} ({low}-{high})'


def timed(
    prepare: Callable[[], object], run: Callable[[], object], *, block: float = _BLOCK
) -> float:
    """
    Median time [s] of `run`, repeated while it is short; `prepare` comes before each, untimed.

    So a fast machine repeats one motion more often, and never follows it farther than others do.
    """
    times: list[float] = []
    while not times or (sum(times) < block and len(times) < _REPEATS):
        prepare()
        started = time.perf_counter()
        run()
        times.append(time.perf_counter() - started)
    return statistics.median(times)


def in_rounds(
    tasks: Sequence[Callable[[], float]], rounds: int,
    progress: Callable[[int], None] = lambda done: None
) -> list[list[float]]:
    """Results of every task, one for each round; every other round runs them backwards."""
    results: list[list[float]] = [[] for _ in tasks]
    done = 0
    for turn in range(rounds):
        order = range(len(tasks))
        for k in order if turn % 2 == 0 else reversed(order):
            results[k].append(tasks[k]())
            done += 1
            progress(done)
    return results


def _figures(value: float, digits: int) -> str:
    """A number with so many digits that count, never as a power of ten."""
    if value >= 10.0 ** (digits - 1):
        return f'{value:,.0f}'
    return f'{float(f"{value:.{digits}g}"):.{digits}g}' if value >= 1e-4 else f'{value:.1e}'
