# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Reductions of the numbers of a vector: their sum, and the largest of them."""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import lane, LANES, Vector


@compiled
def largest_lane(value: Vector) -> float:
    """Return the largest number of a vector; infinity if one is not a number."""
    largest = 0.0
    for i in range(LANES):
        number = lane(value, i)
        if not number <= largest:
            largest = number if number == number else math.inf
    return largest


@compiled
def sum_of_lanes(value: Vector) -> float:
    """Return the sum of the numbers of a vector."""
    total = 0.0
    for i in range(LANES):
        total += lane(value, i)
    return total
