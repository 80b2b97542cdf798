# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The recurrence of Lanczos for M^-1/2 H M^-1/2, H the Hessian of a configuration (hessian.py).

Vectors are (6, s) arrays, slots last, scaled by the roots of mass and inertia. Scalar products are
added up over groups of blocks, and the groups in their order, as in figures.py. Ranks that have
whole groups therefore get bit-identical results.
"""

import math

from icofabric_sim.kernels.conjugate import add_own_terms, add_pair_terms
from icofabric_sim.kernels.hessian import hessian_times
from icofabric_sim.kernels.records import Blocks, Model, SecondDerivatives, State
from icofabric_sim.kernels.runtime.compiled import compiled, compiled_for
from icofabric_sim.kernels.runtime.lane_reductions import sum_of_lanes
from icofabric_sim.kernels.runtime.lanes import fma, load, splat, store
from icofabric_sim.terms.coulomb.record import Coulomb
from icofabric_sim.terms.coulomb.tangent import add_coulomb_product
import numpy as np


@compiled_for(model='contacts')
def lanczos_steps(
    model: Model, state: State, points: np.ndarray, moved: np.ndarray, turns: np.ndarray,
    own: SecondDerivatives | None, pairs: SecondDerivatives | None, coulomb: Coulomb | None,
    previous: np.ndarray, current: np.ndarray, product: np.ndarray, sums: np.ndarray, size: int,
    diagonal: np.ndarray, off: np.ndarray, first: int, last: int, shapes: np.ndarray | None,
    weights: np.ndarray
) -> None:
    """
    Take steps first to last of the three-term recurrence for M^-1/2 H M^-1/2.

    `own` and `pairs`: second derivatives of single bodies and pairs of bodies (anchors, loads,
    contacts); `coulomb`: charges and dipoles. `sums` holds a number for each group of `size`
    blocks. `current` is the unit vector of step `first`, `previous` that before it (zero at the
    start); both are overwritten. The tridiagonal matrix goes into `diagonal` and `off`: off[i]
    couples steps i and i + 1. If `shapes` (j, 6, s) are given, weights[i] (i, j) times the vector
    of step i is added to them.
    """
    root_m, root_i = math.sqrt(model.inverse_mass), math.sqrt(model.inverse_inertia)
    blocks, count, groups = model.blocks, model.blocks.slot.shape[0], sums.shape[0]
    for step in range(first, last):
        add_shapes(shapes, weights, step, current)
        hessian_times(
            model, state, points, moved, turns, root_m, root_i, model.supports, current, product)
        add_own_terms(own, current, product)
        add_pair_terms(pairs, current, product)
        add_coulomb_product(
            coulomb, model.blocks, state.position, state.orientation, model.supports, root_m,
            root_i, current, product)
        note_products(blocks, current, product, sums, size, 0, groups, count)
        alpha = added_up(sums)
        beta = off[step - 1] if step > 0 else 0.0
        subtract(
            blocks, alpha, current, beta, previous, product, sums, size, 0, groups, count)
        diagonal[step], off[step] = alpha, math.sqrt(added_up(sums))
        if not off[step] > 0.0:
            return
        shift(blocks, 1.0 / off[step], previous, current, product, 0, count)


@compiled
def add_shapes(
    shapes: np.ndarray | None, weights: np.ndarray, step: int, current: np.ndarray
) -> None:
    """Add weights[step] times the present vector."""
    if shapes is None:
        return
    for j in range(shapes.shape[0]):
        for k in range(6):
            for s in range(current.shape[1]):
                shapes[j, k, s] += weights[step, j] * current[k, s]


@compiled
def added_up(sums: np.ndarray) -> float:
    """Return the sum of numbers in their order."""
    total = 0.0
    for group in range(sums.shape[0]):
        total += sums[group]
    return total


@compiled
def note_products(
    blocks: Blocks, left: np.ndarray, right: np.ndarray, sums: np.ndarray, size: int, first: int,
    last: int, end: int
) -> None:
    """
    Add up scalar products over groups first to last of `size` blocks, none from block `end` on.
    """
    for group in range(first, last):
        total = splat(0.0)
        for block in range(group * size, min(group * size + size, end)):
            s = blocks.slot[block]
            for k in range(6):
                total = fma(load(left, k, s), load(right, k, s), total)
        sums[group] = sum_of_lanes(total)


@compiled
def subtract(
    blocks: Blocks, alpha: float, current: np.ndarray, beta: float, previous: np.ndarray,
    product: np.ndarray, sums: np.ndarray, size: int, first: int, last: int, end: int
) -> None:
    """Compute product - alpha current - beta previous, in place; sum its squares over groups."""
    a, b = splat(-alpha), splat(-beta)
    for group in range(first, last):
        total = splat(0.0)
        for block in range(group * size, min(group * size + size, end)):
            s = blocks.slot[block]
            for k in range(6):
                value = fma(a, load(current, k, s), load(product, k, s))
                value = fma(b, load(previous, k, s), value)
                store(product, k, s, value)
                total = fma(value, value, total)
        sums[group] = sum_of_lanes(total)


@compiled
def shift(
    blocks: Blocks, scale: float, previous: np.ndarray, current: np.ndarray, product: np.ndarray,
    first: int, last: int
) -> None:
    """
    Store the next vector, `scale` times the product, and the present one, of blocks first to last.
    """
    factor = splat(scale)
    for block in range(first, last):
        s = blocks.slot[block]
        for k in range(6):
            store(previous, k, s, load(current, k, s))
            store(current, k, s, factor * load(product, k, s))
