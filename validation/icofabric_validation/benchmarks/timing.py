# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Times of contestants in rounds in which all take part, so that drifts affect all alike."""

from collections.abc import Callable, Sequence
import statistics
import time
from typing import NamedTuple

# Runs shorter than this time [s] are repeated within a round, up to this number of times.
_MIN_BLOCK_S, _MAX_REPEATS = 0.03, 9
# The same time for plain steps, whose differences are smaller.
STEPS_BLOCK_S = 0.15


class Spread(NamedTuple):
    """Median and range."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> 'Spread':
        """Return the spread of at least one value."""
        return cls(statistics.median(values), min(values), max(values))

    def text(self, digits: int = 3) -> str:
        """Return the text "median (low-high)"."""
        low, high = (_figures(value, digits) for value in (self.low, self.high))
        return f'{_figures(self.median, digits)} ({low}-{high})'


def timed(
    prepare: Callable[[], object], run: Callable[[], object], *, block: float = _MIN_BLOCK_S
) -> float:
    """
    Return the median time [s] of `run`, repeated while short; `prepare` is not timed.

    A fast machine thus repeats one motion more often, but never follows it longer than other
    machines.
    """
    times: list[float] = []
    while not times or (sum(times) < block and len(times) < _MAX_REPEATS):
        prepare()
        started = time.perf_counter()
        run()
        times.append(time.perf_counter() - started)
    return statistics.median(times)


def in_rounds(
    tasks: Sequence[Callable[[], float]], rounds: int,
    progress: Callable[[int, int], None] = lambda done, total: None
) -> list[list[float]]:
    """
    Return the results of every task by round; every other round runs in reverse order.

    `progress` receives the numbers of finished runs and of all runs.
    """
    results: list[list[float]] = [[] for _ in tasks]
    done = 0
    for turn in range(rounds):
        order = range(len(tasks))
        for k in order if turn % 2 == 0 else reversed(order):
            results[k].append(tasks[k]())
            done += 1
            progress(done, rounds * len(tasks))
    return results


def _figures(value: float, digits: int) -> str:
    """Return a number with significant `digits`, never as a power of ten."""
    if value >= 10.0 ** (digits - 1):
        return f'{value:,.0f}'
    return f'{float(f"{value:.{digits}g}"):.{digits}g}' if value >= 1e-4 else f'{value:.1e}'
