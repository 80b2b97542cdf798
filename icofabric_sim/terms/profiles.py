# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Factors of wrenches in time, and how they are averaged over a drift."""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.record import Record
import numpy as np

# Gauss-Legendre on (0, 1), exact up to degree 9: beyond the order of every method.
NEAR_OFFSET, FAR_OFFSET = 0.269234655052841545, 0.453089922969331996
NEAR_WEIGHT, FAR_WEIGHT, MIDDLE_WEIGHT = (
    0.239314335249683234, 0.118463442528094544, 64.0 / 225.0)
# The five points of this rule in their order, as fractions of the interval.
NODES = (0.5 - FAR_OFFSET, 0.5 - NEAR_OFFSET, 0.5, 0.5 + NEAR_OFFSET, 0.5 + FAR_OFFSET)

# Factors at these points.
Five = tuple[float, float, float, float, float]
# Factors before the first wrench.
ONES: Five = (1.0, 1.0, 1.0, 1.0, 1.0)


class Varying(Record):
    """
    Time profiles of the wrenches of a scene.

    A wrench is multiplied by s(t) = value + slope (t - start) + height sin(rate (t - start)).
    """

    start: np.ndarray  # (w,) [s]
    value: np.ndarray  # (w,)
    slope: np.ndarray  # (w,) [1/s]
    height: np.ndarray  # (w,)
    rate: np.ndarray  # (w,) [rad/s]
    peak: np.ndarray  # (w,) the largest |s|; not for kernels

    @classmethod
    def absent(cls) -> 'Varying':
        """Return the record that stands for None."""
        return cls(*(np.zeros(0) for _ in range(6)))


@compiled
def factor_of(varying: Varying | None, w: int, time: float) -> float:
    """Return the factor of wrench `w` at `time` [s]."""
    if varying is None:
        return 1.0
    else:
        after = time - varying.start[w]
        return float(
            varying.value[w] + varying.slope[w] * after
            + varying.height[w] * math.sin(varying.rate[w] * after))


@compiled
def factors_over(varying: Varying | None, w: int, time: float, h: float) -> Five:
    """
    Return the factors of wrench `w` at the five points of a drift of `h` [s] from `time` on.

    The factors are equal for all rows of a wrench, so callers keep them from row to row: a sine
    takes half as long as the other work for a block.
    """
    if is_steady(varying, w):
        factor = factor_of(varying, w, time)
        return factor, factor, factor, factor, factor
    return (
        factor_of(varying, w, time + NODES[0] * h), factor_of(varying, w, time + NODES[1] * h),
        factor_of(varying, w, time + NODES[2] * h), factor_of(varying, w, time + NODES[3] * h),
        factor_of(varying, w, time + NODES[4] * h))


@compiled
def is_steady(varying: Varying | None, w: int) -> bool:
    """Check that the factor of a wrench is constant."""
    if varying is None:
        return True
    else:
        return bool(varying.slope[w] == 0.0 and varying.height[w] == 0.0)
