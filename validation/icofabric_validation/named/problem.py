# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What a problem with a known answer is, and how errors against steps are judged."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

# A slope through few points is known about so well.
_SLACK = 0.5


class PremiseError(Exception):
    """A run did not come to where its answer is known: nothing moved, parted or came to rest."""


class Point(NamedTuple):
    """What was found with one step, tolerance or stiffness."""

    refined: float  # value of what is made finer
    error: float  # in the measure of the problem
    steps: int = 0  # that the run took; 0: not counted


@dataclass(frozen=True)
class Curve:
    """
    Errors of one method or one case, from coarse to fine.

    The last error must be `allowed` at most, and where an `order` is expected the slope through
    all errors above `floor` must not be less. Where nothing is made finer the points are cases
    and each error must be allowed. Curves of other tools stand beside and are not judged.
    """

    of: str  # method and case
    refined: str  # what is made finer, with its unit, or what tells the cases apart
    points: tuple[Point, ...]
    allowed: float = math.inf
    order: float | None = None
    floor: float = 0.0
    is_refined: bool = True
    is_beside: bool = False

    @property
    def observed_order(self) -> float | None:
        """Slope of the logarithm of the error; None where fewer than two errors tell it."""
        told = [point for point in self.points if point.error > self.floor and point.refined > 0.0]
        if not self.is_refined or len(told) < 2:
            return None
        refined, error, _ = zip(*told)
        return float(np.polyfit(np.log(refined), np.log(error), 1)[0])

    @property
    def fault(self) -> str:
        """What is wrong with it; '': nothing."""
        if self.is_beside:
            return ''
        judged = self.points[-1:] if self.is_refined else self.points
        worst = max((point.error for point in judged), key=lambda error: (error != error, error))
        # NaN is not allowed.
        if not worst <= self.allowed:
            return f'the error is {worst:.3g}, allowed are {self.allowed:.3g}'
        if self.order is None:
            return ''
        slope = self.observed_order
        if slope is None:
            return f'order {self.order:g} is expected, and no two errors show one'
        if not slope >= self.order - _SLACK:
            return f'the order is {slope:.2f}, expected is {self.order:g}'
        return ''

    def order_before(self, index: int) -> float | None:
        """Order between the point before and this one."""
        if index == 0 or not self.is_refined:
            return None
        one, other = self.points[index - 1], self.points[index]
        if not (min(one.error, other.error) > self.floor and one.refined != other.refined > 0.0):
            return None
        return math.log(one.error / other.error) / math.log(one.refined / other.refined)


@dataclass(frozen=True)
class Problem:
    """
    A scene, its known answer, and what is compared.

    `solve(long)` runs it, in its short form or as long as the source asks for, and yields curves.
    """

    name: str
    title: str
    source: str
    compared: str  # what the error is
    solve: Callable[[bool], Iterator[Curve]]
    has_long_form: bool = False


@dataclass(frozen=True)
class Answer:
    """What was found of one problem."""

    number: int
    problem: Problem
    curves: tuple[Curve, ...]
    seconds: float  # processor time
    failure: str = ''  # the error that ended it, if one did

    @property
    def faults(self) -> list[str]:
        """A sentence for all that is wrong."""
        found = [f'{curve.of}: {curve.fault}' for curve in self.curves if curve.fault]
        return [*found, self.failure] if self.failure else found
