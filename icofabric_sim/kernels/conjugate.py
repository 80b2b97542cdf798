# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Vectors of the method of conjugate gradients, and terms of a Hessian in blocks.

Vectors are (6, s) arrays, slots last, zero in slots without a body. Sums are always in the same
order, and no library of linear algebra divides them among threads.
"""

from icofabric_sim.kernels.records import SecondDerivatives
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lane_reductions import sum_of_lanes
from icofabric_sim.kernels.runtime.lanes import fma, LANES, load, splat, store
import numpy as np


@compiled
def product_of(left: np.ndarray, right: np.ndarray) -> float:
    """Return the scalar product."""
    total = splat(0.0)
    for k in range(6):
        for s in range(0, left.shape[1], LANES):
            total = fma(load(left, k, s), load(right, k, s), total)
    return sum_of_lanes(total)


@compiled
def weighted_square(weight: np.ndarray, vector: np.ndarray) -> float:
    """Return the sum of the squares, each times a weight."""
    total = splat(0.0)
    for k in range(6):
        for s in range(0, vector.shape[1], LANES):
            value = load(vector, k, s)
            total = fma(load(weight, k, s) * value, value, total)
    return sum_of_lanes(total)


@compiled
def add_along(along: float, direction: np.ndarray, vector: np.ndarray) -> None:
    """Add a multiple of a direction to a vector."""
    factor = splat(along)
    for k in range(6):
        for s in range(0, vector.shape[1], LANES):
            store(vector, k, s, fma(factor, load(direction, k, s), load(vector, k, s)))


@compiled
def advance(
    along: float, square: float, weight: np.ndarray, step: np.ndarray, product: np.ndarray,
    residual: np.ndarray, direction: np.ndarray, image: np.ndarray
) -> float:
    """
    Advance by `along` in the direction, and replace the direction by the next one.

    `image`: product of the direction with the Hessian. `square`: weighted square of the residual;
    return that of the next residual.
    """
    factor, total = splat(along), splat(0.0)
    for k in range(6):
        for s in range(0, step.shape[1], LANES):
            ahead = load(image, k, s)
            store(step, k, s, fma(factor, load(direction, k, s), load(step, k, s)))
            store(product, k, s, fma(factor, ahead, load(product, k, s)))
            left = load(residual, k, s) - factor * ahead
            store(residual, k, s, left)
            total = fma(load(weight, k, s) * left, left, total)
    after = sum_of_lanes(total)
    ratio = splat(after / square)
    for k in range(6):
        for s in range(0, step.shape[1], LANES):
            store(direction, k, s, fma(
                ratio, load(direction, k, s), load(weight, k, s) * load(residual, k, s)))
    return after


@compiled
def add_own_blocks(
    slots: np.ndarray, blocks: np.ndarray, vector: np.ndarray, product: np.ndarray
) -> None:
    """Add (m, 6, 6) second derivatives of single bodies in `slots` (m,) times the vector."""
    for m in range(len(slots)):
        s = slots[m]
        for i in range(6):
            total = 0.0
            for j in range(6):
                total += blocks[m, i, j] * vector[j, s]
            product[i, s] += total


@compiled
def add_pair_blocks(
    slots: np.ndarray, blocks: np.ndarray, vector: np.ndarray, product: np.ndarray
) -> None:
    """Add (m, 12, 12) second derivatives of pairs in `slots` (m, 2) times the vector."""
    for m in range(len(slots)):
        for i in range(12):
            total = 0.0
            for j in range(12):
                total += blocks[m, i, j] * vector[j % 6, slots[m, j // 6]]
            product[i % 6, slots[m, i // 6]] += total


@compiled
def add_own_terms(own: SecondDerivatives | None, vector: np.ndarray, product: np.ndarray) -> None:
    """Add the second derivatives of single bodies times the vector, if there are any."""
    if own is None:
        return
    add_own_blocks(own.slots, own.values, vector, product)


@compiled
def add_pair_terms(
    pairs: SecondDerivatives | None, vector: np.ndarray, product: np.ndarray
) -> None:
    """Add the second derivatives of pairs times the vector, if there are any."""
    if pairs is None:
        return
    add_pair_blocks(pairs.slots, pairs.values, vector, product)
