# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Fronts of a multifrontal elimination (statics/fronts.py): what parts hand on to others.

What is handed on is symmetric; its lower triangle is kept, column by column, in one array.
"""

from icofabric_sim.kernels.runtime.compiled import compiled
import numpy as np


@compiled
def add_update(
    own: np.ndarray, side: np.ndarray, rest: np.ndarray, places: np.ndarray, packed: np.ndarray
) -> None:
    """
    Add what was handed on (k (k + 1) / 2,) to a front, at rising `places` (k,) in it.

    `own` (p, p) are the freedoms that go, `rest` (b, b) those that stay, `side` (b, p) between.
    """
    gone, count, position = own.shape[0], places.shape[0], 0
    for j in range(count):
        column = places[j]
        for i in range(j, count):
            row, value = places[i], packed[position]
            position += 1
            if column >= gone:
                rest[row - gone, column - gone] += value
            elif row >= gone:
                side[row - gone, column] += value
            else:
                own[row, column] += value


@compiled
def pack_lower(rest: np.ndarray, packed: np.ndarray) -> None:
    """Lower triangle of `rest` (b, b) into `packed` (b (b + 1) / 2,)."""
    position = 0
    for j in range(rest.shape[0]):
        for i in range(j, rest.shape[0]):
            packed[position] = rest[i, j]
            position += 1
