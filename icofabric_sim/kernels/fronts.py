# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Fronts of a multifrontal elimination (statics/fronts.py): updates that fronts pass to others.

An update is symmetric; its lower triangle is stored, column by column, in one array.
"""

from icofabric_sim.kernels.runtime.compiled import compiled
import numpy as np


@compiled
def add_update(
    own: np.ndarray, side: np.ndarray, rest: np.ndarray, places: np.ndarray, packed: np.ndarray
) -> None:
    """
    Add an update (k (k + 1) / 2,) to a front, at rising `places` (k,) in the front.

    `own` (p, p) are the eliminated freedoms, `rest` (b, b) the remaining ones, `side` (b, p)
    between.
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
    """Copy the lower triangle of `rest` (b, b) into `packed` (b (b + 1) / 2,)."""
    position = 0
    for j in range(rest.shape[0]):
        for i in range(j, rest.shape[0]):
            packed[position] = rest[i, j]
            position += 1
