# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The largest eigenvalue of a symmetric tridiagonal matrix of the Lanczos iteration."""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
import numpy as np

# Bisections of the interval of the eigenvalue; they end early at the accuracy of rounding.
_HALVINGS = 120
# The vector has positive numbers, so a start of ones always has a component along it. Each
# solution divides the remainder by the gap over the shift, some 1e-14 of the matrix.
_SOLUTIONS = 3
_SHIFT = 4e-15


@compiled
def is_above(diagonal: np.ndarray, off: np.ndarray, value: float, smallest: float) -> bool:
    """Check that all eigenvalues lie below `value`: no pivot of T - value is positive (Sturm)."""
    pivot = diagonal[0] - value
    if pivot > 0.0:
        return False
    for i in range(1, diagonal.shape[0]):
        pivot = min(pivot, -smallest)
        pivot = diagonal[i] - value - off[i - 1] * off[i - 1] / pivot
        if pivot > 0.0:
            return False
    return True


@compiled
def largest_eigenvalue(diagonal: np.ndarray, off: np.ndarray, vector: np.ndarray) -> float:
    """
    Return the largest eigenvalue; write its unit vector with positive numbers into `vector` (n,).

    `diagonal` (n,), `off` (n - 1,) > 0. See `largest_of_scaled`; all numbers are first divided by
    the largest, because squares could overflow.
    """
    scale = 0.0
    for i in range(diagonal.shape[0]):
        # True for NaN, too.
        if not abs(diagonal[i]) <= scale:
            scale = abs(diagonal[i])
    for i in range(off.shape[0]):
        scale = max(scale, off[i])
    if not scale > 0.0:
        vector[:] = 0.0
        vector[0] = 1.0
        return 0.0
    return scale * largest_of_scaled(diagonal / scale, off / scale, vector)


@compiled
def largest_of_scaled(diagonal: np.ndarray, off: np.ndarray, vector: np.ndarray) -> float:
    """
    Return the largest eigenvalue and write its vector, for numbers of at most 1.

    The value by bisection (Barth, Martin and Wilkinson 1967), to rounding; the vector by inverse
    iteration from above, where T - value is negative definite and needs no pivoting.
    """
    size = diagonal.shape[0]
    low, high = diagonal[0], diagonal[0]
    scale = 0.0
    for i in range(size):
        reach = 0.0
        if i > 0:
            reach += off[i - 1]
        if i + 1 < size:
            reach += off[i]
        low = max(low, diagonal[i])
        high = max(high, diagonal[i] + reach)
        scale = max(scale, abs(diagonal[i]) + reach)
    smallest = max(1e-300, 1e-30 * scale)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if is_above(diagonal, off, middle, smallest):
            high = middle
        else:
            low = middle
    value = 0.5 * (low + high)
    shifted = high + _SHIFT * scale
    pivots = np.empty(size)
    pivots[0] = min(diagonal[0] - shifted, -smallest)
    for i in range(1, size):
        pivots[i] = min(
            diagonal[i] - shifted - off[i - 1] * off[i - 1] / pivots[i - 1], -smallest)
    vector[:] = 1.0
    for _ in range(_SOLUTIONS):
        for i in range(1, size):
            vector[i] -= off[i - 1] / pivots[i - 1] * vector[i - 1]
        vector[size - 1] /= pivots[size - 1]
        for i in range(size - 2, -1, -1):
            vector[i] = (vector[i] - off[i] * vector[i + 1]) / pivots[i]
        total = 0.0
        for i in range(size):
            total += vector[i] * vector[i]
        length = math.sqrt(total)
        for i in range(size):
            vector[i] = abs(vector[i]) / length
    return value
