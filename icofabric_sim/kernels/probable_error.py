# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
What a step of the embedded pair errs by, as against the safe side that accepts or refuses it.
"""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, maximum, rsqrt, splat, sqrt, Vector, where


@compiled
def probable_error(square_5: Vector, square_3: Vector) -> Vector:
    """
    What a step errs by, from the squares of its errors of order 5 and 3; see docs/decisions/.

    In x, step times frequency, these are as x^6 and x^4, the error itself as x^9: so with their
    ratio r it is e5 r^1.5. The constants are those of an oscillation, within 1.3 for x up to 4.
    Where forces jump r is not small, and the error about as large as e5.
    """
    error_5 = sqrt(square_5)
    ratio = error_5 * rsqrt(maximum(square_3, splat(1e-300)))
    ratio = where(ratio < splat(1.0), ratio, splat(1.0))
    scale = rsqrt(fma(splat(20.0), ratio, splat(1.0)))
    return splat(26.0) * ratio * sqrt(ratio) * scale * scale * error_5
