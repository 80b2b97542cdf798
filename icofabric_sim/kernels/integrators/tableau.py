# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Tableaus of explicit embedded Runge-Kutta pairs, and their arrays for the kernels."""

import math
from typing import NamedTuple

from icofabric_sim.kernels.rhs import LAST
import numpy as np

# Slots of slopes: the first two stages, and the end of the step. Slots between the last stage of a
# pair and the end stay empty; the slopes of the dense output follow the end.
FIRST, SECOND, DENSE = 0, 1, LAST + 1
SLOPE_COUNT = 16


class Tableau(NamedTuple):
    """Coefficients of an embedded Runge-Kutta pair, by the numbers of its slopes."""

    # Weights of the slopes before each stage; the first stage has none.
    stages: tuple[tuple[float, ...], ...]
    step: tuple[float, ...]
    # Weights of the step minus those of two embedded formulas, of the stages and, if there is one
    # more, of the end. `step_error` combines both errors; a pair with one embedded formula has
    # zeros in `lower_error`.
    higher_error: tuple[float, ...]
    lower_error: tuple[float, ...]
    error_order: int  # of the combined error for each second
    # Stages that only states within a step need, by the slopes of the stages, the end and the
    # dense stages before.
    dense_stages: tuple[tuple[float, ...], ...]
    # Weights of all slopes in the coefficients of the interpolation beyond the cubic of Hermite.
    dense: tuple[tuple[float, ...], ...]
    # The combined error times this ratio is compared with the tolerance.
    estimate_ratio: float
    # The result of `probable_error` times this ratio is reported.
    probable_ratio: float = 1.0


class Pair(NamedTuple):
    """
    A tableau in the slots of the slopes.

    The arrays of all pairs have the same types: one compiled kernel takes the steps of any pair.
    """

    weights: np.ndarray  # (SLOPE_COUNT, SLOPE_COUNT), of the slopes before the one of a row
    lengths: np.ndarray  # (SLOPE_COUNT,): the last weight of a row that is not 0 has this number
    nodes: np.ndarray  # (SLOPE_COUNT,), when each slope is, as a fraction of the step
    step: np.ndarray  # (stages,)
    # (stages,), or (LAST + 1,) if the slope of the end has a weight
    higher_error: np.ndarray
    lower_error: np.ndarray
    dense_slots: np.ndarray  # slots of the slopes that only states within a step need
    dense: np.ndarray  # (coefficients, SLOPE_COUNT)
    exponent: float  # of the error in the length of the next step
    estimate_ratio: float
    probable_ratio: float
    judges_end: bool  # True: the error depends on the slope of the end

    @property
    def stage_count(self) -> int:
        """The number of stages; the slope of the end is not included."""
        return len(self.step)

    @property
    def stage_weights(self) -> list[np.ndarray]:
        """Weights of the slopes before each stage but the first, and those of the step."""
        rows = [self.weights[k, :self.lengths[k]] for k in range(SECOND, self.stage_count)]
        return [*rows, self.step]

    @property
    def kept_slots(self) -> tuple[int, ...]:
        """Slots of the slopes that dense output needs, those of `dense_slots` not included."""
        rows = np.concatenate([self.weights[self.dense_slots], self.dense])
        return tuple(
            slot for slot in range(SLOPE_COUNT)
            if slot not in self.dense_slots and rows[:, slot].any())


def pair_of(tableau: Tableau) -> Pair:
    """
    Return the `tableau` in the slots of the slopes.

    Raises
    ------
    ValueError
        If slopes are more than slots.

    """
    count = len(tableau.stages)
    free = [*range(DENSE, SLOPE_COUNT), *range(count, LAST)]
    if count > LAST or len(tableau.dense_stages) > len(free):
        raise ValueError(
            f'a pair has at most {LAST} stages and, of {SLOPE_COUNT} slopes, one at the end of '
            f'the step, got {count} stages and {len(tableau.dense_stages)} dense stages')
    dense_slots = free[:len(tableau.dense_stages)]
    slots = [*range(count), LAST, *dense_slots]
    # A force that depends on time is evaluated at the sum of the weights.
    rows = (*tableau.stages, (1.0,), *tableau.dense_stages)
    nodes, weights = np.zeros(SLOPE_COUNT), np.zeros((SLOPE_COUNT, SLOPE_COUNT))
    for slot, row in zip(slots, rows):
        nodes[slot] = math.fsum(row)
        weights[slot, slots[:len(row)]] = row
    weights[LAST] = 0.0
    judges_end = len(tableau.higher_error) > count
    errors = np.zeros((2, LAST + 1 if judges_end else count))
    for error, row in zip(errors, (tableau.higher_error, tableau.lower_error)):
        error[slots[:len(row)]] = row
    dense = np.zeros((len(tableau.dense), SLOPE_COUNT))
    for target, row in zip(dense, tableau.dense):
        target[slots[:len(row)]] = row
    return Pair(
        weights=weights,
        lengths=np.array([np.flatnonzero(np.append(1.0, row))[-1] for row in weights]),
        nodes=nodes, step=np.array(tableau.step),
        higher_error=errors[0].copy(), lower_error=errors[1].copy(),
        dense_slots=np.array(dense_slots, dtype=np.int64), dense=dense,
        exponent=1.0 / tableau.error_order, estimate_ratio=tableau.estimate_ratio,
        probable_ratio=tableau.probable_ratio, judges_end=judges_end)
