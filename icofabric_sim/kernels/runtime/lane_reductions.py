# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
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
