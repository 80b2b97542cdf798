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
comparisons for all lanes as a table has rows would cost more beyond some twenty rows. The force
remembers the piece of each connector with its bounds, so all lanes are compared at once, and only
a connector that has left its piece is looked up again. What is remembered changes no result: a
length has one piece.
"""

import math

from icofabric_sim.kernels.records import LawTables, LINK_COUNT, Variety
from icofabric_sim.kernels.runtime.compiled import compiled, inlined
from icofabric_sim.kernels.runtime.lanes import (
    any_lane,
    lane,
    LANES,
    load,
    load_at,
    rsqrt,
    splat,
    Vector,
    where,
)
import numpy as np

# Numbers that are remembered of a piece: see `LawTables.pieces`.
PIECE = 8


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
def find_pieces(
    tables: LawTables, variety: Variety, link: int, s: int, length: Vector, at: int
) -> None:
    """
    Remember the pieces of lanes that have left theirs, from place `at` on: see `LawTables.pieces`.

    Springs have two pieces, with k_c up to the natural length and k_e above.
    """
    rows, pieces = tables.rows, tables.pieces
    for i in range(LANES):
        place, number = at + i, lane(length, i)
        if pieces[place] < number <= pieces[place + LANES]:
            continue
        start = int(tables.first[link, s + i])
        if start < 0:
            rest = variety.natural_length[link, s + i]
            pulls = number > rest
            pieces[place] = rest if pulls else -math.inf
            pieces[place + LANES] = math.inf if pulls else rest
            for k in range(2, PIECE):
                pieces[place + k * LANES] = 0.0
            pieces[place + 2 * LANES] = rest
            pieces[place + 4 * LANES] = (
                variety.extension[link, s + i] if pulls else variety.compression[link, s + i])
        else:
            r, last = piece_of(rows, start, number), int(rows[start, 7])
            pieces[place] = rows[r, 0] if r > start else -math.inf
            pieces[place + LANES] = rows[r + 1, 0] if r < last else math.inf
            for k in range(2, PIECE):
                pieces[place + k * LANES] = rows[r, k - 1]


@inlined
def place_of_pieces(
    tables: LawTables, variety: Variety | None, link: int, s: int, length: Vector
) -> int:
    """Where the pieces of a connector are remembered, once they are those of its `length` [m]."""
    at = PIECE * (LINK_COUNT * s + LANES * link)
    zero, one = splat(0.0), splat(1.0)
    left = where(load_at(tables.pieces, at) < length, zero, one)
    left = where(load_at(tables.pieces, at + LANES) < length, one, left)
    if any_lane(left > zero):
        find_pieces(tables, variety, link, s, length, at)
    return at


@inlined
def tension_at(pieces: np.ndarray, at: int, length: Vector) -> Vector:
    """Tension [N] by the pieces from place `at` on."""
    t = length - load_at(pieces, at + 2 * LANES)
    return load_at(pieces, at + 3 * LANES) + t * (
        load_at(pieces, at + 4 * LANES) + t * (
            load_at(pieces, at + 5 * LANES) + t * load_at(pieces, at + 6 * LANES)))


@inlined
def tabled_factor(
    tables: LawTables, variety: Variety | None, link: int, s: int, square: Vector
) -> Vector:
    """Tension over length [N/m] of a connector of squared length `square`, table or spring."""
    inverse = rsqrt(square)
    length = square * inverse
    at = place_of_pieces(tables, variety, link, s, length)
    return tension_at(tables.pieces, at, length) * inverse


@compiled
def tabled_pull(
    tables: LawTables | None, variety: Variety | None, link: int, s: int, length: Vector,
    pull: Vector
) -> Vector:
    """Tension [N] of a connector; `pull` without table."""
    if tables is None:
        return pull
    else:
        at = place_of_pieces(tables, variety, link, s, length)
        return where(
            load(tables.first, link, s) < splat(0.0), pull, tension_at(tables.pieces, at, length))


@compiled
def tabled_slope(
    tables: LawTables | None, variety: Variety | None, link: int, s: int, length: Vector,
    slope: Vector
) -> Vector:
    """Slope of the tension [N/m] of a connector; `slope` without table."""
    if tables is None:
        return slope
    else:
        at = place_of_pieces(tables, variety, link, s, length)
        t = length - load_at(tables.pieces, at + 2 * LANES)
        own = load_at(tables.pieces, at + 4 * LANES) + t * (
            splat(2.0) * load_at(tables.pieces, at + 5 * LANES)
            + t * (splat(3.0) * load_at(tables.pieces, at + 6 * LANES)))
        return where(load(tables.first, link, s) < splat(0.0), slope, own)


@compiled
def tabled_energy(
    tables: LawTables | None, variety: Variety | None, link: int, s: int, length: Vector,
    energy: Vector
) -> Vector:
    """Energy [J] of a connector; `energy` without table."""
    if tables is None:
        return energy
    else:
        at = place_of_pieces(tables, variety, link, s, length)
        t = length - load_at(tables.pieces, at + 2 * LANES)
        own = load_at(tables.pieces, at + 7 * LANES) + t * (
            load_at(tables.pieces, at + 3 * LANES) + t * (
                load_at(tables.pieces, at + 4 * LANES) / splat(2.0) + t * (
                    load_at(tables.pieces, at + 5 * LANES) / splat(3.0)
                    + t * load_at(tables.pieces, at + 6 * LANES) / splat(4.0))))
        return where(load(tables.first, link, s) < splat(0.0), energy, own)
