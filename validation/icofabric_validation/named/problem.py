# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Problems with known answers, and the judgement of errors against steps."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

# Largest deficit of an observed order, for slopes through few points.
_ORDER_TOLERANCE = 0.5


class PremiseError(Exception):
    """A run did not reach the state with the known answer, for example rest or separation."""


class Point(NamedTuple):
    """The error for one step, tolerance or stiffness."""

    refined: float  # value of the refined quantity
    error: float  # in the measure of the problem
    steps: int = 0  # number of steps of the run; 0: not counted


@dataclass(frozen=True)
class Curve:
    """
    Errors of one method or case, from coarse to fine.

    The last error must be at most `allowed`. If there is an expected `order`, the slope through
    all errors above `floor` must not be less. Without refinement, points are cases, and each error
    must be at most `allowed`. Curves of other tools are for comparison only.
    """

    label: str  # method and case
    refined: str  # refined quantity with its unit, or the quantity that differs between cases
    points: tuple[Point, ...]
    allowed: float = math.inf
    order: float | None = None
    floor: float = 0.0
    is_refined: bool = True
    is_comparison: bool = False

    @property
    def observed_order(self) -> float | None:
        """Slope of the logarithm of the error; None with fewer than two errors above the floor."""
        used = [point for point in self.points if point.error > self.floor and point.refined > 0.0]
        if not self.is_refined or len(used) < 2:
            return None
        refined, error, _ = zip(*used)
        return float(np.polyfit(np.log(refined), np.log(error), 1)[0])

    @property
    def fault(self) -> str:
        """Reason why the curve is not as expected, or an empty string."""
        if self.is_comparison:
            return ''
        judged = self.points[-1:] if self.is_refined else self.points
        worst = max((point.error for point in judged), key=lambda error: (error != error, error))
        # NaN is not allowed.
        if not worst <= self.allowed:
            return f'the error is {worst:.3g}, at most {self.allowed:.3g} is allowed'
        if self.order is None:
            return ''
        slope = self.observed_order
        if slope is None:
            return f'order {self.order:g} is expected, but fewer than two errors show one'
        if not slope >= self.order - _ORDER_TOLERANCE:
            return f'the order is {slope:.2f}, but {self.order:g} is expected'
        return ''

    def order_before(self, index: int) -> float | None:
        """Return the order between a point and the one before."""
        if index == 0 or not self.is_refined:
            return None
        one, other = self.points[index - 1], self.points[index]
        if not (min(one.error, other.error) > self.floor and one.refined != other.refined > 0.0):
            return None
        return math.log(one.error / other.error) / math.log(one.refined / other.refined)


@dataclass(frozen=True)
class Problem:
    """
    A scene with a known answer.

    `solve(long)` runs the short form, or the full duration of the source, and yields curves.
    """

    name: str
    title: str
    source: str
    compared: str  # definition of the error
    solve: Callable[[bool], Iterator[Curve]]
    has_long_form: bool = False


@dataclass(frozen=True)
class Answer:
    """The result of one problem."""

    number: int
    problem: Problem
    curves: tuple[Curve, ...]
    seconds: float  # processor time
    failure: str = ''  # error that ended the problem; '': none

    @property
    def faults(self) -> list[str]:
        """Sentences about all faults."""
        found = [f'{curve.label}: {curve.fault}' for curve in self.curves if curve.fault]
        return [*found, self.failure] if self.failure else found
