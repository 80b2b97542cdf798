# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Brute force over all slabs up to 7x7x7, all variants.

The oracle is the plain statement of the fabric: grid points x + y + z even (variants 0 and 2) or
odd (1 and 3). The formulas of the document are transcribed here once more, as printed.
"""

import itertools

from icofabric_sim.scene.weave_index import (
    alpha_from_indices,
    centre_rule,
    checked_size,
    checked_variant,
    column_count,
    indices_from_alpha,
    indices_from_grid,
    is_centre,
    level_count,
    row_count,
    slab_count,
)
from icofabric_sim.scene.weave_lattice import slab_grid
import numpy as np
import pytest

SIZES = list(itertools.product(range(1, 8), repeat=3))
VARIANTS = (0, 1, 2, 3)
# The rules that the document prints, and all that permute the axes.
NAMED = {'column': 'xyz', 'row': 'yxz'}
ORDERS = [*NAMED, 'xzy', 'yzx', 'zxy', 'zyx']


def occupied(variant, size):
    """Return bool (Nx, Ny, Nz): where the icosahedra are."""
    x, y, z = np.indices(size)
    return (x + y + z) % 2 == variant % 2


def printed_rule(variant, along, i, j, k):
    """Return the centre by eqs 56 (top, bottom), 59, 61 and 63 as printed, for indices from 0."""
    shift = variant % 2
    if along == 'column':
        return (2 * i + (j + (k + shift) % 2) % 2, j, k)
    return (i, 2 * j + (i + (k + shift) % 2) % 2, k)


def printed_range(variant, along, size, line, k):
    """Return the number of indices along a line by eqs 57, 60, 62 and 64 as printed."""
    length = size[0] if along == 'column' else size[1]
    n = (length - length % 2) // 2
    return n + ((line + 1 - (k + variant % 2) % 2) % 2) * (length % 2)


def printed_alpha(variant, along, size, i, j, k):
    nx, ny, _ = size
    sign = -1 if variant % 2 else 1
    level = nx * ny * k
    length, line, place = (nx, j, i) if along == 'column' else (ny, i, j)
    return ((level + sign * (level % 2)) // 2
            + (length * line + sign * (-1)**k * (length * line % 2)) // 2 + place)


@pytest.mark.parametrize('variant', VARIANTS)
def test_counts_of_columns_rows_levels_and_slabs(variant):
    # Tables 1-4.
    for size in SIZES:
        there = occupied(variant, size)
        i, j, k = (np.arange(n) for n in size)
        assert np.array_equal(
            column_count(variant, size, j[:, None], k), there.sum(axis=0))
        assert np.array_equal(row_count(variant, size, i[:, None], k), there.sum(axis=1))
        assert np.array_equal(level_count(variant, size, k), there.sum(axis=(0, 1)))
        assert slab_count(variant, size) == there.sum()
        for line, level in itertools.product(range(size[1]), range(size[2])):
            assert printed_range(variant, 'column', size, line, level) == column_count(
                variant, size, line, level)
        for line, level in itertools.product(range(size[0]), range(size[2])):
            assert printed_range(variant, 'row', size, line, level) == row_count(
                variant, size, line, level)


def test_table_3_as_printed_is_off_by_one_level():
    # As printed, (-1)^(k+1) for variants 0 and 2: right for k from 1, not from 0.
    size = (3, 3, 4)
    printed = [(9 + (-1)**(k + 1) * (9 % 2)) // 2 for k in range(4)]
    assert printed == [4, 5, 4, 5]
    assert [level_count(0, size, k) for k in range(4)] == [5, 4, 5, 4]


@pytest.mark.parametrize('variant', VARIANTS)
@pytest.mark.parametrize('along', ORDERS)
def test_alpha_counts_the_slab_and_all_rules_give_the_same_centres(variant, along):
    inner, outer, sheets = ('xyz'.index(axis) for axis in NAMED.get(along, along))
    for size in SIZES:
        # The fabric line by line, in plain loops.
        centres, indices = [], []
        for sheet in range(size[sheets]):
            for line in range(size[outer]):
                places = [p for p in range(size[inner]) if (p + line + sheet) % 2 == variant % 2]
                for place, p in enumerate(places):
                    for found, first in ((centres, p), (indices, place)):
                        triple = {inner: first, outer: line, sheets: sheet}
                        found.append((triple[0], triple[1], triple[2]))
        count = slab_count(variant, size)
        assert len(centres) == count
        alpha = np.arange(count)
        found = indices_from_alpha(variant, size, alpha, along=along)
        assert found.shape == (count, 3)
        if count == 0:
            continue
        assert found.tolist() == [list(triple) for triple in indices]
        assert np.array_equal(
            alpha_from_indices(variant, size, *found.T, along=along), alpha)
        grid = centre_rule(variant, *found.T, along=along)
        assert grid.tolist() == [list(centre) for centre in centres]
        assert np.array_equal(indices_from_grid(variant, grid, along=along), found)
        assert {tuple(point) for point in grid.tolist()} == {
            tuple(point) for point in np.argwhere(occupied(variant, size)).tolist()}
        for number, triple in enumerate(indices if along in NAMED else ()):
            assert printed_alpha(variant, along, size, *triple) == number
            assert printed_rule(variant, along, *triple) == centres[number]


@pytest.mark.parametrize('variant', VARIANTS)
def test_own_rule_of_each_variant(variant):
    # Alpha runs along columns in variants 0 and 1, along rows in 2 and 3.
    along = 'column' if variant < 2 else 'row'
    size = (5, 4, 3)
    alpha = np.arange(slab_count(variant, size))
    indices = indices_from_alpha(variant, size, alpha)
    assert np.array_equal(indices, indices_from_alpha(variant, size, alpha, along=along))
    grid = centre_rule(variant, *indices.T)
    assert np.array_equal(grid, slab_grid(variant, size))
    fastest = 0 if variant < 2 else 1
    assert np.array_equal(
        np.lexsort((grid[:, fastest], grid[:, 1 - fastest], grid[:, 2])), alpha)


@pytest.mark.parametrize('variant', VARIANTS)
@pytest.mark.parametrize('along', ORDERS)
def test_infinite_fabric(variant, along):
    # Eq 55 holds for negative indices: the centres are all points of one parity, each once.
    reach = range(-6, 7)
    i, j, k = (index.ravel() for index in np.meshgrid(reach, reach, reach, indexing='ij'))
    grid = centre_rule(variant, i, j, k, along=along)
    assert np.all(grid.sum(axis=1) % 2 == variant % 2)
    assert np.all(is_centre(variant, grid))
    assert not np.any(is_centre(variant, grid + [0, 1, 0]))
    points = {tuple(point) for point in grid.tolist()}
    assert len(points) == len(grid)
    assert np.array_equal(
        indices_from_grid(variant, grid, along=along), np.stack((i, j, k), axis=1))
    expected = {
        point for point in itertools.product(range(-5, 6), repeat=3)
        if sum(point) % 2 == variant % 2}
    assert expected <= points
    if variant == 0 and along == 'column':
        # Eq 55 as printed, with absolute values.
        printed = np.stack((2 * i + (np.abs(j) + np.abs(k) % 2) % 2, j, k), axis=1)
        assert np.array_equal(grid, printed)


@pytest.mark.parametrize('along', ['level', '', 'xy', 3])
def test_another_rule_is_refused(along):
    for ask in (
        lambda: centre_rule(0, 1, 1, 0, along=along),
        lambda: indices_from_grid(0, [[1, 1, 0]], along=along),
        lambda: alpha_from_indices(0, (4, 3, 2), 1, 1, 0, along=along),
        lambda: indices_from_alpha(0, (4, 3, 2), 3, along=along),
    ):
        with pytest.raises((ValueError, TypeError), match='along must be .*zyx'):
            ask()


def test_large_slabs_do_not_overflow():
    size = (2**20 + 1, 2**20 - 1, 2**20 + 3)
    generator = np.random.default_rng(1)
    for variant in VARIANTS:
        count = slab_count(variant, size)
        assert count > 2**58
        alpha = np.append(generator.integers(0, count, 1000), [0, count - 1])
        indices = indices_from_alpha(variant, size, alpha)
        assert np.array_equal(alpha_from_indices(variant, size, *indices.T), alpha)
        grid = centre_rule(variant, *indices.T)
        assert np.all((grid >= 0) & (grid < size))
        assert np.all(is_centre(variant, grid))


def test_scalars_and_broadcasting():
    assert centre_rule(0, -1, 2, 3).tolist() == [-1, 2, 3]
    assert centre_rule(1, 0, np.arange(2), 0).tolist() == [[1, 0, 0], [0, 1, 0]]
    assert column_count(1, (5, 5, 5), 0, 0) == 2
    assert int(alpha_from_indices(0, (3, 3, 3), 1, 2, 2)) == slab_count(0, (3, 3, 3)) - 1


def test_bad_variants_and_sizes_are_named():
    for variant in (-1, 4, True, 'x', 0.5):
        with pytest.raises(ValueError, match=r'weave\.variant is '):
            checked_variant(variant)
    for size in ([0, 1, 1], [1, 1], [1.0, 1, 1], [True, 1, 1], [-3, 1, 1], []):
        with pytest.raises(ValueError, match=r'weave\.size is \['):
            checked_size(size)
    assert checked_size(np.array([1, 2, 3])) == (1, 2, 3)


@pytest.mark.parametrize('alpha', [-1, 14, [0, 99]])
def test_an_index_beyond_the_slab_is_refused(alpha):
    # 27 points with 14 shells in variant 0.
    assert indices_from_alpha(0, (3, 3, 3), 13).tolist() == [1, 2, 2]
    with pytest.raises(ValueError, match='alpha must be from 0 to 13 in a slab of 14 shells'):
        indices_from_alpha(0, (3, 3, 3), alpha)
