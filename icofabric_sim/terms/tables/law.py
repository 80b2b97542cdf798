# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Connectors whose tension follows a table.

Connectors of one law share its intervals, which stay in the fastest cache. If all follow one
table, each vector of connectors stores two adjacent intervals that contain the lengths of all
lanes, and each lane chooses between them. The stored intervals change no result: a length has one
interval.

Else the range of a table is divided into bins of one width. The interval of a length is found by
one product, the entry of its bin and one comparison. Bins with more than one bound, and those that
reach beyond the ends of the table, are marked: their lengths are located by bisection.
"""

from typing import Any

from icofabric_sim.kernels.runtime.compiled import compiled, inlined
from icofabric_sim.kernels.runtime.lanes import (
    any_lane,
    insert,
    lane,
    LANES,
    load,
    load_pair,
    maximum,
    rsqrt,
    splat,
    Vector,
    where,
)
from icofabric_sim.terms.shared import LINK_COUNT, Variety
from icofabric_sim.terms.tables.record import Tables

# Number of entries of an interval and of a table: see `Tables`.
ROW_SIZE, HEAD_SIZE = 8, 8


@compiled
def row_of(tables: Tables, number: int, length: float) -> int:
    """Return the row of the interval of a table for a `length` [m]."""
    head = HEAD_SIZE * number
    low, high = int(tables.heads[head + 4]), int(tables.heads[head + 5])
    while low < high:
        middle = (low + high + 1) >> 1
        if tables.rows[ROW_SIZE * middle] < length:
            low = middle
        else:
            high = middle - 1
    if low == int(tables.heads[head + 4]) or low == int(tables.heads[head + 5]):
        tables.beyond[0] = 1.0
    return low


@compiled
def search_rows(tables: Tables, link: int, s: int, length: Vector) -> Vector:
    """Return the rows of all lanes' intervals by bisection."""
    result = splat(0.0)
    for i in range(LANES):
        number = int(tables.number[link, s + i])
        if number >= 0:
            result = insert(result, i, float(row_of(tables, number, lane(length, i))))
    return result


@compiled
def remember_near(tables: Tables, link: int, s: int, length: Vector) -> int:
    """Store and return the start of two intervals that contain all lanes, as `Tables.near`."""
    first, last = int(tables.heads[4]), int(tables.heads[5])
    lowest, highest = last, first
    for i in range(LANES):
        if tables.number[link, s + i] >= 0.0:
            row = row_of(tables, 0, lane(length, i))
            lowest, highest = min(lowest, row), max(highest, row)
    # Lengths beyond the ends of the table are excluded, because each of them must be recorded.
    lower = min(lowest, last - 2)
    near = ROW_SIZE * lower if lower > first and highest <= lower + 1 else -1
    tables.near[LINK_COUNT * (s >> 2) + link] = near
    return near


@inlined
def find_rows(tables: Tables, link: int, s: int, length: Vector, there: Any) -> Vector:
    """
    Return the rows of the intervals of connectors for a `length` [m].

    Lanes outside the mask `there` get an interval of any table.
    """
    zero, heads = splat(0.0), tables.heads
    number = maximum(load(tables.number, link, s), zero)
    origin, scale = load_pair(heads, number, HEAD_SIZE, 0)
    last, first = load_pair(heads, number, HEAD_SIZE, 2)
    place = first + clipped((length - origin) * scale, last)
    return binned_rows(tables, link, s, length, place, there)


@inlined
def binned_rows(
    tables: Tables, link: int, s: int, length: Vector, place: Vector, there: Any
) -> Vector:
    """Return the rows of the intervals from the `place` of each length among the bins."""
    bound, row = load_pair(tables.bins, place, 2, 0)
    if any_lane(where(there, bound, splat(0.0)) < splat(0.0)):
        return search_rows(tables, link, s, length)
    return where(bound < length, row + splat(1.0), row)


@inlined
def clipped(place: Vector, last: Vector) -> Vector:
    """Return places between 0 and `last`; 0 for NaN."""
    return maximum(where(place < last, place, last), splat(0.0))


@inlined
def tension_in(tables: Tables, row: Vector, length: Vector) -> Vector:
    """Return the tension [N] by intervals in any rows."""
    anchor, f = load_pair(tables.rows, row, ROW_SIZE, 1)
    d, c = load_pair(tables.rows, row, ROW_SIZE, 3)
    b, _ = load_pair(tables.rows, row, ROW_SIZE, 5)
    t = length - anchor
    return f + t * (d + t * (c + t * b))


@inlined
def tension_near(rows: Any, near: int, length: Vector) -> Vector:
    """Return the tension [N] by two adjacent intervals."""
    high = near + ROW_SIZE
    is_high = splat(rows[high]) < length
    t = length - where(is_high, splat(rows[high + 1]), splat(rows[near + 1]))
    d = where(is_high, splat(rows[high + 3]), splat(rows[near + 3]))
    c = where(is_high, splat(rows[high + 4]), splat(rows[near + 4]))
    b = where(is_high, splat(rows[high + 5]), splat(rows[near + 5]))
    return where(is_high, splat(rows[high + 2]), splat(rows[near + 2])) + t * (
        d + t * (c + t * b))


@inlined
def replace_factor(
    tables: Tables | None, variety: Variety | None, link: int, s: int, square: Vector, there: Any,
    factor: Vector
) -> Vector:
    """Return tension over length [N/m] by the table; `factor` if no connector has a table."""
    if tables is None:
        return factor
    else:
        return tabled_factor(tables, variety, link, s, square, there)


@inlined
def tabled_factor(
    tables: Tables, variety: Variety | None, link: int, s: int, square: Vector, there: Any
) -> Vector:
    """Return tension over length [N/m] of a connector by its table, or as a spring."""
    inverse = rsqrt(square)
    length = square * inverse
    if tables.is_alike:
        zero, one, rows = splat(0.0), splat(1.0), tables.rows
        near = int(tables.near[LINK_COUNT * (s >> 2) + link])
        if near >= 0:
            left = where(splat(rows[near]) < length, zero, one)
            left = where(splat(rows[near + 2 * ROW_SIZE]) < length, one, left)
            if any_lane(where(there, left, zero) > zero):
                near = remember_near(tables, link, s, length)
        if near >= 0:
            return tension_near(rows, near, length) * inverse
        heads = tables.heads
        place = clipped((length - splat(heads[0])) * splat(heads[1]), splat(heads[2]))
        row = binned_rows(tables, link, s, length, place, there)
        return tension_in(tables, row, length) * inverse
    return mixed_factor(tables, variety, link, s, length, inverse)


@compiled
def mixed_factor(
    tables: Tables, variety: Variety, link: int, s: int, length: Vector, inverse: Vector
) -> Vector:
    """Return tension over length [N/m] if not all connectors follow one table."""
    rest = load(variety.natural_length, link, s)
    k = where(
        length > rest, load(variety.extension, link, s), load(variety.compression, link, s))
    return replace_pull(tables, link, s, length, k * (length - rest)) * inverse


@compiled
def replace_pull(
    tables: Tables | None, link: int, s: int, length: Vector, pull: Vector
) -> Vector:
    """Return the tension [N] of a connector by its table; `pull` without a table."""
    if tables is None:
        return pull
    else:
        there = load(tables.number, link, s) > splat(-0.5)
        row = find_rows(tables, link, s, length, there)
        return where(there, tension_in(tables, row, length), pull)


@compiled
def replace_slope(
    tables: Tables | None, link: int, s: int, length: Vector, slope: Vector
) -> Vector:
    """
    Return the slope of the tension [N/m] of a connector by its table; `slope` without a table.
    """
    if tables is None:
        return slope
    else:
        there = load(tables.number, link, s) > splat(-0.5)
        row = find_rows(tables, link, s, length, there)
        anchor, _ = load_pair(tables.rows, row, ROW_SIZE, 1)
        d, c = load_pair(tables.rows, row, ROW_SIZE, 3)
        b, _ = load_pair(tables.rows, row, ROW_SIZE, 5)
        t = length - anchor
        return where(there, d + t * (splat(2.0) * c + t * (splat(3.0) * b)), slope)


@compiled
def replace_energy(
    tables: Tables | None, link: int, s: int, length: Vector, energy: Vector
) -> Vector:
    """
    Return the energy [J] of a connector by its table; `energy` without a table.

    Health checks call this function, so it also searches again for intervals that contain all
    lanes.
    """
    if tables is None:
        return energy
    else:
        if tables.is_alike and tables.near[LINK_COUNT * (s >> 2) + link] < 0:
            remember_near(tables, link, s, length)
        there = load(tables.number, link, s) > splat(-0.5)
        row = find_rows(tables, link, s, length, there)
        anchor, f = load_pair(tables.rows, row, ROW_SIZE, 1)
        d, c = load_pair(tables.rows, row, ROW_SIZE, 3)
        b, stored = load_pair(tables.rows, row, ROW_SIZE, 5)
        t = length - anchor
        own = stored + t * (f + t * (d / splat(2.0) + t * (
            c / splat(3.0) + t * b / splat(4.0))))
        return where(there, own, energy)


@compiled
def replace_alone(
    tables: Tables | None, link: int, s: int, length: float, law: tuple[float, float, float]
) -> tuple[float, float, float]:
    """
    Return tension [N], energy [J] and slope [N/m] by a connector's table; `law` without a table.
    """
    if tables is None:
        return law
    else:
        number = int(tables.number[link, s])
        if number < 0:
            return law
        rows, r = tables.rows, ROW_SIZE * row_of(tables, number, length)
        t = length - rows[r + 1]
        return (
            rows[r + 2] + t * (rows[r + 3] + t * (rows[r + 4] + t * rows[r + 5])),
            rows[r + 6] + t * (rows[r + 2] + t * (
                rows[r + 3] / 2.0 + t * (rows[r + 4] / 3.0 + t * rows[r + 5] / 4.0))), law[2])
