# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What the numbers of a vector have in common: their sum, and the largest of them."""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import lane, LANES, Vector


@compiled
def largest_lane(value: Vector) -> float:
    """Largest number of a vector; infinite where one is not a number."""
    largest = 0.0
    for i in range(LANES):
        number = lane(value, i)
        if not number <= largest:
            largest = number if number == number else math.inf
    return largest


@compiled
def sum_of_lanes(value: Vector) -> float:
    """Sum of the numbers of a vector."""
    total = 0.0
    for i in range(LANES):
        total += lane(value, i)
    return total
