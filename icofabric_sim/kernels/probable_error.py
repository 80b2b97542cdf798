# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Probable error of a step of the embedded pair, beside the conservative estimate that accepts it.
"""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, maximum, rsqrt, splat, sqrt, Vector, where

# Ratio of the two errors of an oscillation, over x^2 (0.0033 to 0.0041 for x up to 1).
SMOOTH_RATIO = 0.0042
# Error of a step due to a kink, over its contribution to the error of order 5: 0.3 to 7 in single
# steps, depending on the time of the kink within the step.
_KINK = 1.7


@compiled
def probable_error(square_5: Vector, square_3: Vector, smooth: float) -> Vector:
    """
    Estimate the error of a step from the squares of its errors of order 5 and 3.

    See docs/decisions/. In x, step times frequency, these errors are as x^6 and x^4, the error
    itself as x^9: with their ratio r it is e5 r^1.5. The constants are those of an oscillation,
    within a factor of 1.3 for x up to 4. If a force has a kink, r is larger than `smooth`, the
    ratio of the fastest oscillation; the excess in e5 is about as large as the error. 1e300: no
    force has a kink.
    """
    error_5, error_3 = sqrt(square_5), sqrt(square_3)
    ratio = error_5 * rsqrt(maximum(square_3, splat(1e-300)))
    ratio = where(ratio < splat(1.0), ratio, splat(1.0))
    scale = rsqrt(fma(splat(20.0), ratio, splat(1.0)))
    kink = splat(_KINK) * fma(splat(-smooth), error_3, error_5)
    return maximum(splat(26.0) * ratio * sqrt(ratio) * scale * scale * error_5, kink)
