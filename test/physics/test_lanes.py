# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Vectors in kernels: what is compiled does what the plain functions say, lane by lane."""

from icofabric_sim.kernels.runtime import lanes
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    any_lane,
    bits,
    fabs,
    fma,
    insert,
    lane,
    LANES,
    load,
    load_at,
    load_pair,
    maximum,
    rsqrt,
    splat,
    sqrt,
    store,
    store_at,
    where,
)
import numpy as np
import pytest

# Rows of the tables below.
A, B, C, RESULT = 0, 1, 2, 3
SPECIAL = (
    0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 5e-324, -5e-324, 2.2250738585072014e-308,
    1.7976931348623157e308, 1e-300, np.pi)


def add(table, s):
    store(table, RESULT, s, load(table, A, s) + load(table, B, s))


def subtract(table, s):
    store(table, RESULT, s, load(table, A, s) - load(table, B, s))


def multiply(table, s):
    store(table, RESULT, s, load(table, A, s) * load(table, B, s))


def divide(table, s):
    store(table, RESULT, s, load(table, A, s) / load(table, B, s))


def magnitude(table, s):
    store(table, RESULT, s, fabs(load(table, A, s)))


def root(table, s):
    store(table, RESULT, s, sqrt(load(table, A, s)))


def larger(table, s):
    store(table, RESULT, s, maximum(load(table, A, s), load(table, B, s)))


def less(table, s):
    a, b = load(table, A, s), load(table, B, s)
    store(table, RESULT, s, where(a < b, splat(1.0), splat(2.0)))


def more(table, s):
    a, b = load(table, A, s), load(table, B, s)
    store(table, RESULT, s, where(a > b, a, load(table, C, s)))


def spread(table, s):
    store(table, RESULT, s, splat(table[A, s + LANES - 1]))


def move(table, s):
    # Any place, also between those of blocks, and of another row.
    store(table, RESULT, s, load_at(table.reshape(-1), table.shape[1] + s - 3))


def gather(table, s):
    # Neighbours in a flat view, at places with fractions, another for each lane.
    places = splat(0.75)
    for i in range(LANES):
        places = insert(places, i, 0.75 + 3 * i % 7)
    first, second = load_pair(table.reshape(-1), places, 2, s)
    store(table, RESULT, s, where(first < second, first, second))


def move_back(table, s):
    # Through a flat view, to any place; only lanes of the last row are changed.
    store_at(table.reshape(-1), RESULT * table.shape[1] + s - 1, load(table, A, s))


def exchange(table, s):
    value = load(table, A, s)
    for i in range(LANES):
        value = insert(value, i, 2.0 * lane(value, LANES - 1 - i))
    store(table, RESULT, s, value)


def any_of(table, s):
    found = any_lane(load(table, A, s) > load(table, B, s))
    store(table, RESULT, s, splat(1.0) if found else splat(0.0))


def masked(table, s):
    byte = np.uint8(s % 256)
    store(table, RESULT, s, where(bits(byte), load(table, A, s), load(table, B, s)))


def fused(table, s):
    store(table, RESULT, s, fma(load(table, A, s), load(table, B, s), load(table, C, s)))


def inverse_root(table, s):
    store(table, RESULT, s, rsqrt(load(table, A, s)))


EXACT = (
    add, subtract, multiply, divide, magnitude, root, larger, less, more, spread, move, gather,
    move_back, exchange, any_of, masked)


def make_table(seed):
    """Numbers of all sizes, and all pairs of special ones."""
    generator = np.random.default_rng(seed)
    special = np.array(np.meshgrid(SPECIAL, SPECIAL)).reshape(2, -1)
    count = 4096
    table = np.zeros((4, count))
    table[:3] = generator.standard_normal((3, count)) * 2.0 ** generator.integers(
        -300, 300, (3, count))
    # Equal and nearly equal numbers.
    table[B, ::7] = table[A, ::7]
    table[C, ::5] = -table[A, ::5] * table[B, ::5]
    first = 64
    table[:2, first:first + special.shape[1]] = special
    return table


def sweep(function, table, *, plain):
    """Apply a function to all whole vectors of a copy; returns the row of results."""
    table = table.copy()
    kernel = function if plain else compile_once(function)
    with np.errstate(all='ignore'):
        for s in range(LANES, table.shape[1] - LANES, LANES):
            kernel(table, s)
    return table[RESULT]


_COMPILED = {}


def compile_once(function):
    if function not in _COMPILED:
        _COMPILED[function] = compiled(function)
    return _COMPILED[function]


@pytest.mark.parametrize('function', EXACT, ids=lambda function: function.__name__)
def test_compiled_is_plain_to_the_last_bit(function):
    table = make_table(1)
    one, other = sweep(function, table, plain=False), sweep(function, table, plain=True)
    nan = np.isnan(one)
    # What a NaN carries is up to the processor.
    assert np.array_equal(nan, np.isnan(other))
    assert np.array_equal(one[~nan].view(np.int64), other[~nan].view(np.int64))
    assert len(np.unique(one[~nan])) > (1 if function in (less, any_of) else 400)


def test_product_and_sum_round_once_or_twice():
    table = make_table(2)
    table[:3] = np.where(np.abs(table[:3]) < 1e100, table[:3], 1.0)
    table[:3] = np.where(np.abs(table[:3]) > 1e-100, table[:3], 1.0)
    table = np.nan_to_num(table, nan=1.0)
    got, plain = sweep(fused, table, plain=False), sweep(fused, table, plain=True)
    inner = slice(LANES, table.shape[1] - LANES)
    a, b, c = table[:3, inner].astype(np.longdouble)
    # A fused one errs by half a unit in the last place of the result, two roundings by half a unit
    # of the product as well.
    size = np.abs(a * b).astype(float)
    for result in (got[inner], plain[inner]):
        error = np.abs(result - (a * b + c)).astype(float)
        assert (error <= 0.5001 * (np.spacing(np.abs(result)) + np.spacing(size))).all()
    assert np.abs(got[inner]).max() > 1e50


def test_inverse_root_over_all_normal_numbers():
    generator = np.random.default_rng(3)
    # Every exponent of normal numbers, with mantissas at both ends, and many in between.
    exponents = np.arange(-1022, 1024)
    parts = [np.ldexp(mantissa, exponents) for mantissa in (
        1.0, np.nextafter(1.0, 2.0), np.nextafter(2.0, 1.0), 4.0 / 3.0)]
    parts += [np.ldexp(generator.uniform(1.0, 2.0, len(exponents)), exponents) for _ in range(40)]
    parts.append(generator.uniform(1.0, 4.0, 100_000))
    numbers = np.concatenate(parts)
    numbers = numbers[:len(numbers) // LANES * LANES]
    table = np.ones((4, len(numbers) + 2 * LANES))
    table[A, LANES:-LANES] = numbers
    got = sweep(inverse_root, table, plain=False)[LANES:-LANES]
    exact = 1.0 / np.sqrt(numbers.astype(np.longdouble))
    units = np.abs((got - exact) / np.spacing(exact.astype(float))).astype(float)
    print(f'rsqrt: at most {units.max():.3f} units in the last place')
    assert units.max() < 4.0
    plain = sweep(inverse_root, table, plain=True)[LANES:-LANES]
    assert (np.abs((plain - exact) / np.spacing(exact.astype(float))) < 1.6).all()


@pytest.mark.parametrize('plain', [False, True])
def test_every_mask_chooses_its_lanes(plain):
    table = np.zeros((4, LANES))
    table[A], table[B] = np.arange(1.0, LANES + 1.0), -1.0

    def choose(table, byte):
        store(table, RESULT, 0, where(bits(np.uint8(byte)), load(table, A, 0), load(table, B, 0)))
        return any_lane(where(bits(np.uint8(byte)), splat(1.0), splat(0.0)) > splat(0.5))

    kernel = choose if plain else compiled(choose)
    for byte in range(1 << LANES):
        chosen = np.array([byte >> i & 1 for i in range(LANES)], dtype=bool)
        assert kernel(table, byte) == (byte != 0)
        assert np.array_equal(table[RESULT], np.where(chosen, table[A], table[B]))


def test_every_function_is_tested_here():
    functions = [*EXACT, fused, inverse_root, test_every_mask_chooses_its_lanes]
    used = {name for function in functions for name in function.__code__.co_names}
    assert set(lanes.__all__) - {'LANES'} <= used | {'bits', 'any_lane', 'splat'}
