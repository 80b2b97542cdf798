# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The largest frequency of a fabric in a configuration: the step of an explicit method follows it.
"""

from collections.abc import Callable
import math
from typing import NamedTuple

from icofabric_sim.kernels.hessian import hessian_product
from icofabric_sim.kernels.monitor import frequency_bound
from icofabric_sim.kernels.records import Model
from icofabric_sim.kernels.rotations import fill_arms
import numpy as np
from scipy.linalg import eigh_tridiagonal

Operator = Callable[[np.ndarray], np.ndarray]

# Relative accuracy of the squared frequency at which the Lanczos iteration stops. A slightly
# larger one that the start hardly contains may hide within the residual: at 1e-3 the frequency
# came out up to 0.6 % low in turned fabrics, at 1e-4 at most 0.01 %. The top of the spectrum of a
# large fabric is dense and takes hundreds of iterations to resolve: 30 s at 100,000 bodies, where
# 0.6 s give it at most 1.5 % too high.
ACCURACY = 1e-4
_LARGE_ACCURACY = 0.03
_SMALL = 2_000  # bodies
LARGEST_ITERATION_COUNT = 300


class Frequency(NamedTuple):
    """
    The largest frequency and where it lives.
    """

    rate: float  # [rad/s]
    bodies: tuple[int, ...]  # bodies that take the largest part in it, at most four
    iterations: int


def largest_frequency(
    model: Model, position: np.ndarray, orientation: np.ndarray, *, locate: bool = False
) -> Frequency:
    """
    Largest frequency [rad/s] of small motions about a configuration, supports respected.

    The largest eigenvalue of M^-1/2 H M^-1/2 by the Lanczos iteration with a fixed start, H the
    Hessian of the connector energy (kernels/hessian.py), M the masses and inertias. `locate`
    also finds the bodies.
    """
    if model.connectors is None or not model.connectors.stiffness > 0.0:
        return Frequency(0.0, (), 0)
    count = len(position)
    arms = np.empty((count, 3, 3))
    fill_arms(orientation, model.connectors.half_width, arms)
    if model.supports is None:
        scale = np.repeat([[model.inverse_mass] * 3 + [model.inverse_inertia] * 3], count, axis=0)
    else:
        scale = np.hstack(
            [
                model.supports.inverse_mass,
                np.repeat(model.supports.inverse_inertia[:, None], 3, axis=1),
            ]
        )
    scale = np.ascontiguousarray(np.sqrt(scale).T.reshape(2, 3, count).transpose(0, 2, 1))
    force, torque = np.empty((count, 3)), np.empty((count, 3))

    def apply(vector: np.ndarray) -> np.ndarray:
        motion = scale * vector.reshape(2, count, 3)
        hessian_product(model.connectors, position, arms, motion[0], motion[1], force, torque)
        return (scale * np.stack([force, torque])).ravel()

    # Noise has a part of every mode and no symmetry that could hide one.
    start = np.random.RandomState(1).standard_normal(6 * count)
    start *= scale.ravel() > 0.0
    if not start.any():
        return Frequency(0.0, (), 0)
    inverses = model.inverse_mass, model.inverse_inertia
    upper, _ = frequency_bound(model.connectors, model.adjacency, *inverses, position, arms)
    accuracy = ACCURACY if count <= _SMALL else _LARGE_ACCURACY
    with np.errstate(over='ignore', invalid='ignore'):
        value, weights, iterations = _lanczos(apply, start, upper, accuracy)
    bodies: tuple[int, ...] = ()
    if locate:
        shape = _combine(apply, start, weights).reshape(2, count, 3)
        share = (shape**2).sum(axis=(0, 2))
        bodies = tuple(int(b) for b in np.argsort(-share, kind='stable')[:4] if share[b] > 0.0)
    return Frequency(float(np.sqrt(max(value, 0.0))), bodies, iterations)


def _lanczos(
    apply: Operator, start: np.ndarray, upper: float, accuracy: float
) -> tuple[float, np.ndarray, int]:
    """
    Largest eigenvalue of the symmetric `apply`, at most `upper`, and its weights in the basis.

    From three-term recurrences: two vectors are kept, not a basis. The Ritz value approaches from
    below, and an eigenvalue lies within the residual of it; the nearer of that and of `upper` is
    returned once they agree to the relative `accuracy`.
    """
    diagonal: list[float] = []
    off: list[float] = []
    previous, current = np.zeros_like(start), start / _norm(start)
    beta = 0.0
    value, weights = 0.0, np.ones(1)
    for iteration in range(1, min(LARGEST_ITERATION_COUNT, len(start)) + 1):
        product = apply(current)
        alpha = _dot(current, product)
        product -= alpha * current + beta * previous
        diagonal.append(alpha)
        beta = _norm(product)
        if not math.isfinite(beta):
            # Numbers too large to multiply: nothing is safe.
            return math.inf, np.ones(iteration), iteration
        values, vectors = eigh_tridiagonal(
            diagonal, off, select='i', select_range=(iteration - 1, iteration - 1)
        )
        ritz, weights = float(values[0]), vectors[:, 0]
        value = min(ritz + beta * abs(float(weights[-1])), max(upper, ritz))
        if value - ritz <= accuracy * abs(ritz):
            return value, weights, iteration
        off.append(beta)
        previous, current = current, product / beta
    return value, weights, iteration


def _combine(apply: Operator, start: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """
    Run the recurrences of `_lanczos` again and sum up the eigenvector.
    """
    previous, current = np.zeros_like(start), start / _norm(start)
    beta = 0.0
    total = np.zeros_like(start)
    for k, weight in enumerate(weights):
        total += weight * current
        if k + 1 < len(weights):
            product = apply(current)
            product -= _dot(current, product) * current + beta * previous
            beta = _norm(product)
            previous, current = current, product / beta
    return total


def _dot(left: np.ndarray, right: np.ndarray) -> float:
    """
    Scalar product by NumPy's pairwise sum: unlike BLAS, the same bits for any number of threads.
    """
    return float(np.sum(left * right))


def _norm(vector: np.ndarray) -> float:
    return float(np.sqrt(_dot(vector, vector)))
