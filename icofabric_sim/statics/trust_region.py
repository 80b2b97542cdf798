# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps of a trust-region method for a function with a possibly singular or indefinite Hessian.

Steihaug 1983, SIAM J. Numer. Anal. 20, 626: conjugate gradients on the quadratic model, which end
at the boundary of the region, or follow a direction of negative curvature to the boundary. Lengths
of steps and directions follow from the recurrences of Conn, Gould and Toint 2000 (Trust-Region
Methods, SIAM, 7.5), so an iteration needs one scalar product in addition to that of the residual.
"""

from collections.abc import Callable
import math
from typing import NamedTuple

from icofabric_sim.kernels.conjugate import add_along, advance, product_of, weighted_square
from icofabric_sim.simulation.model.layout import aligned_empty
import numpy as np


class Step(NamedTuple):
    """Step of a trust-region method, and the change that the quadratic model predicts."""

    step: np.ndarray  # (6, s)
    length: float  # in the metric of the weights
    expected: float  # change of the function by the model; negative
    iterations: int
    on_border: bool


def steihaug(
    times: Callable[[np.ndarray, np.ndarray], None], weight: np.ndarray, gradient: np.ndarray,
    radius: float, accuracy: float, largest: int
) -> Step:
    """
    Return an approximate minimiser of g.s + s.H s / 2 with s.W^-1 s <= radius^2, vectors (6, s).

    `times` writes H times its first argument to its second; W is the diagonal `weight`, 0 for held
    degrees of freedom. Ends if the residual is below `accuracy` times the initial one, or after
    `largest` products. The step has no component without stiffness and force, because it is a
    combination of (W H)^k W g.
    """
    step, product, residual, direction, image = (
        aligned_empty(gradient.shape) for _ in range(5))
    step[:] = product[:] = image[:] = 0.0
    residual[:] = -gradient
    direction[:] = weight * residual
    square = weighted_square(weight, residual)
    goal = accuracy**2 * square
    # Squares of the step and of the direction, and their product, in the metric W^-1.
    long, ahead, mixed = 0.0, square, 0.0
    most = 0.0  # the largest curvature seen
    iteration, on_border = 0, False
    while iteration < largest and square > goal:
        iteration += 1
        times(direction, image)
        curvature = product_of(direction, image)
        most = max(most, abs(curvature) / ahead)
        # The round-off of a mechanism does not count as curvature.
        along = square / curvature if curvature > 1e-14 * most * ahead else math.inf
        if not long + along * (2.0 * mixed + along * ahead) < radius**2:
            along = _to_border(long, mixed, ahead, radius)
            add_along(along, direction, step)
            add_along(along, image, product)
            long, on_border = radius**2, True
            break
        after = advance(along, square, weight, step, product, residual, direction, image)
        long += along * (2.0 * mixed + along * ahead)
        ratio = after / square
        mixed = ratio * (mixed + along * ahead)
        ahead, square = after + ratio**2 * ahead, after
    expected = product_of(gradient, step) + 0.5 * product_of(step, product)
    return Step(step, math.sqrt(long), expected, iteration, on_border)


def _to_border(long: float, mixed: float, ahead: float, radius: float) -> float:
    """Return the factor of the direction at the boundary: a positive root of a quadratic."""
    rest = max(radius**2 - long, 0.0)
    root = math.sqrt(mixed * mixed + ahead * rest)
    return rest / (mixed + root) if mixed > 0.0 else (root - mixed) / ahead
