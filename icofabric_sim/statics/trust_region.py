# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Steps of a trust region method for a function with a Hessian that may be singular or indefinite.

Steihaug 1983, SIAM J. Numer. Anal. 20, 626: conjugate gradients on the quadratic model, which end
at the border of the region, or along a direction of negative curvature on it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Step(NamedTuple):
    """
    A step and what the quadratic model expects of it.
    """

    step: np.ndarray
    product: np.ndarray  # Hessian times the step
    iterations: int
    curved: bool  # it follows a direction of negative curvature
    on_border: bool

    def expected(self, gradient: np.ndarray) -> float:
        """
        Change of the function by the model; negative.
        """
        return float(np.vdot(gradient, self.step) + 0.5 * np.vdot(self.step, self.product))


def steihaug(
    times: Callable[[np.ndarray], np.ndarray], gradient: np.ndarray, radius: float,
    accuracy: float, largest: int
) -> Step:
    """
    Approximate minimiser of g.s + s.H s / 2 with |s| <= radius.

    `times` multiplies by H. Ends where the residual is below `accuracy` times that at 0, or after
    `largest` products. Directions in which nothing resists and nothing pushes are never entered:
    all are combinations of H^k g.
    """
    step, product = np.zeros_like(gradient), np.zeros_like(gradient)
    residual = -gradient
    direction = residual.copy()
    square = float(np.vdot(residual, residual))
    goal = accuracy**2 * square
    most = 0.0  # the largest curvature seen
    for iteration in range(1, largest + 1):
        image = times(direction)
        curvature, length = float(np.vdot(direction, image)), float(np.vdot(direction, direction))
        most = max(most, abs(curvature) / length)
        # What rounding leaves of a mechanism is no curvature.
        if curvature <= 1e-14 * most * length:
            along = _to_border(step, direction, radius)
            curved = curvature < -1e-10 * most * length
            return Step(
                step + along * direction, product + along * image, iteration, curved, True)
        along = square / curvature
        longer = step + along * direction
        if float(np.vdot(longer, longer)) >= radius**2:
            along = _to_border(step, direction, radius)
            return Step(
                step + along * direction, product + along * image, iteration, False, True)
        step, product = longer, product + along * image
        residual -= along * image
        before, square = square, float(np.vdot(residual, residual))
        if not square > goal:
            break
        direction = residual + (square / before) * direction
    return Step(step, product, iteration, False, False)


def _to_border(step: np.ndarray, direction: np.ndarray, radius: float) -> float:
    """
    How far along the direction the border is; the positive root of a quadratic equation.
    """
    a, b = float(np.vdot(direction, direction)), float(np.vdot(step, direction))
    c = float(np.vdot(step, step)) - radius**2
    root = np.sqrt(max(b * b - a * c, 0.0))
    return float(-c / (b + root)) if b > 0.0 else float((root - b) / a)
