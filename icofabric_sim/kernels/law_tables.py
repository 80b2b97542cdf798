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
"""
Connectors whose tension follows a table, see law_tables.py beside this folder.

Each lane looks up its own piece by bisection: neighbouring bodies have other lengths, and as many
comparisons for all lanes as a table has rows would cost more beyond some twenty rows.
"""

from icofabric_sim.kernels.records import LawTables
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    insert,
    lane,
    LANES,
    load,
    rsqrt,
    splat,
    Vector,
    where,
)
import numpy as np


@compiled
def piece_of(rows: np.ndarray, first: int, length: float) -> int:
    """Row of the piece of a table that begins in row `first`, for a `length` [m]."""
    low, high = first, int(rows[first, 7])
    while low < high:
        middle = (low + high + 1) >> 1
        if rows[middle, 0] < length:
            low = middle
        else:
            high = middle - 1
    return low


@compiled
def table_tension(rows: np.ndarray, first: Vector, length: Vector, value: Vector) -> Vector:
    """Tension [N] where there is a table (`first` is not negative), `value` elsewhere."""
    for i in range(LANES):
        start = int(lane(first, i))
        if start >= 0:
            number = lane(length, i)
            r = piece_of(rows, start, number)
            t = number - rows[r, 1]
            value = insert(value, i, rows[r, 2] + t * (
                rows[r, 3] + t * (rows[r, 4] + t * rows[r, 5])))
    return value


@compiled
def table_energy(rows: np.ndarray, first: Vector, length: Vector, value: Vector) -> Vector:
    """Energy [J] where there is a table, `value` elsewhere."""
    for i in range(LANES):
        start = int(lane(first, i))
        if start >= 0:
            number = lane(length, i)
            r = piece_of(rows, start, number)
            t = number - rows[r, 1]
            value = insert(value, i, rows[r, 6] + t * (rows[r, 2] + t * (
                rows[r, 3] / 2.0 + t * (rows[r, 4] / 3.0 + t * rows[r, 5] / 4.0))))
    return value


@compiled
def tabled_factor(
    tables: LawTables | None, link: int, s: int, square: Vector, factor: Vector
) -> Vector:
    """
    Tension over length [N/m] of a connector of squared length `square`; `factor` without table.
    """
    if tables is None:
        return factor
    else:
        inverse = rsqrt(square)
        first = load(tables.first, link, s)
        tension = table_tension(tables.rows, first, square * inverse, splat(0.0))
        return where(first < splat(0.0), factor, tension * inverse)


@compiled
def tabled_pull(
    tables: LawTables | None, link: int, s: int, length: Vector, pull: Vector
) -> Vector:
    """Tension [N] of a connector; `pull` without table."""
    if tables is None:
        return pull
    else:
        return table_tension(tables.rows, load(tables.first, link, s), length, pull)


@compiled
def tabled_energy(
    tables: LawTables | None, link: int, s: int, length: Vector, energy: Vector
) -> Vector:
    """Energy [J] of a connector; `energy` without table."""
    if tables is None:
        return energy
    else:
        return table_energy(tables.rows, load(tables.first, link, s), length, energy)
