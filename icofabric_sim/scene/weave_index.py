# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Positions, counts and numbering of the icosahedra of an orthogonal slab.

Source: "A Mathematical Model of Icosahedral Materials", eqs 55-65, Tables 1-4 and the formulas
for the index alpha. All quantities are integers in units of the pitch W. Indices may be integers
or integer arrays, which broadcast; negative indices (infinite fabric) are allowed.

Centres are the grid points with even x + y + z for variants 0 and 2, odd for 1 and 3. The document
numbers them along columns (x = 2i + ..., y = j, z = k) in variants 0 and 1, and along rows
(x = i, y = 2j + ..., z = k) in variants 2 and 3, and notes that any permutation of the axes gives
an equivalent rule. `along` chooses one of the six rules: 'column', 'row', or the axes in the order
of counting: 'xyz' is 'column' and 'yxz' is 'row'. In 'zxy' a position is 2k + ... along z,
consecutive lines are offset along x, and consecutive sheets of lines along y.
"""

from itertools import permutations
from typing import Literal, Sequence

from icofabric_sim import checks
import numpy as np

VARIANTS = (0, 1, 2, 3)

Index = int | np.integer | np.ndarray
Along = Literal['column', 'row', 'xyz', 'xzy', 'yxz', 'yzx', 'zxy', 'zyx']
# Axes of the positions in a line, of the lines in a sheet, and of the sheets.
_ORDERS = {''.join('xyz'[axis] for axis in axes): axes for axes in permutations(range(3))}
_ORDERS |= {'column': _ORDERS['xyz'], 'row': _ORDERS['yxz']}


def gap_parity(variant: int) -> int:
    """Return 0 if the corner has an icosahedron (variants 0, 2), 1 if it is a gap (1, 3)."""
    return checked_variant(variant) & 1


def is_turned(variant: int) -> bool:
    """Return True if the bodies are turned by 90 degrees about z (variants 2 and 3)."""
    return checked_variant(variant) >= 2


def rule_of(variant: int) -> Along:
    """Return the direction along which the document's rule and alpha count this variant."""
    return 'row' if is_turned(variant) else 'column'


def _axes(variant: int, along: str | None) -> tuple[int, ...]:
    """Return the axes of positions, lines and sheets; None means the document's rule."""
    along = rule_of(variant) if along is None else along
    checks.choice('along', along, tuple(_ORDERS))
    return _ORDERS[along]


def centre_rule(
        variant: int, i: Index, j: Index, k: Index, *, along: Along | None = None) -> np.ndarray:
    """
    Return the grid point (x, y, z) of coordinate indices (i, j, k), int64, (..., 3).

    Implements eqs 55, 56, 59, 61 and 63, and with `along` their permutations of axes. Reduction
    modulo 2 is a bit mask, so negative indices need no absolute values (eq 55).
    """
    indices = np.broadcast_arrays(*(np.asarray(index, np.int64) for index in (i, j, k)))
    place, line, sheet = _axes(variant, along)
    grid = np.stack(indices, axis=-1)
    grid[..., place] *= 2
    grid[..., place] += (indices[line] + indices[sheet] + gap_parity(variant)) & 1
    return grid


def indices_from_grid(
        variant: int, grid: np.ndarray, *, along: Along | None = None) -> np.ndarray:
    """
    Return the indices (i, j, k) of grid points with an icosahedron, int64, (..., 3).

    Inverse of `centre_rule`; the parity of the points is not checked.
    """
    indices = np.array(grid, np.int64)
    # An arithmetic shift rounds down, also for negative numbers, and removes the remainder.
    indices[..., _axes(variant, along)[0]] >>= 1
    return indices


def is_centre(variant: int, grid: np.ndarray) -> np.ndarray:
    """Return the mask of grid points (..., 3) with an icosahedron in the infinite fabric."""
    points = np.asarray(grid, np.int64)
    return (points.sum(axis=-1) & 1) == gap_parity(variant)


def column_count(variant: int, size: Sequence[int], j: Index, k: Index) -> Index:
    """Count the icosahedra in column j of level k (Table 1; the range of i in eqs 57 and 60)."""
    return _line_count(size[0], j, k, gap_parity(variant))


def row_count(variant: int, size: Sequence[int], i: Index, k: Index) -> Index:
    """Count the icosahedra in row i of level k (Table 2; the range of j in eqs 62 and 64)."""
    return _line_count(size[1], i, k, gap_parity(variant))


def level_count(variant: int, size: Sequence[int], k: Index) -> Index:
    """Count the icosahedra in level k (Table 3, corrected: the printed signs are for k from 1)."""
    return (int(size[0]) * int(size[1]) + 1 - ((gap_parity(variant) + k) & 1)) // 2


def slab_count(variant: int, size: Sequence[int]) -> int:
    """Count the icosahedra in a slab (Table 4)."""
    count = int(size[0]) * int(size[1]) * int(size[2])
    return (count + 1 - gap_parity(variant)) // 2


def alpha_from_indices(
        variant: int, size: Sequence[int], i: Index, j: Index, k: Index, *,
        along: Along | None = None) -> np.ndarray:
    """
    Return the lexicographic index alpha of (i, j, k), from 0, int64.

    The indices must follow the same rule (`along`) and lie in the slab.
    """
    axes = _axes(variant, along)
    place, line, sheet = (np.asarray((i, j, k)[axis], np.int64) for axis in axes)
    length, breadth, _ = (int(size[axis]) for axis in axes)
    gap = gap_parity(variant)
    return _half(length * breadth * sheet, gap) + _half(length * line, (sheet + gap) & 1) + place


def indices_from_alpha(
        variant: int, size: Sequence[int], alpha: Index, *,
        along: Along | None = None) -> np.ndarray:
    """
    Return the indices (i, j, k) of the icosahedra `alpha`, int64, (..., 3).

    Inverse of `alpha_from_indices`. Raises ValueError unless 0 <= alpha < `slab_count`.
    """
    remainder = np.asarray(alpha, np.int64)
    count = slab_count(variant, size)
    if remainder.size and not 0 <= remainder.min() <= remainder.max() < count:
        raise ValueError(
            f'alpha must be from 0 to {count - 1} in a slab of {count} shells, got '
            f'{checks.shown(alpha)}')
    gap = gap_parity(variant)
    axes = _axes(variant, along)
    length, breadth, _ = (int(size[axis]) for axis in axes)
    # The last sheet, then the last line, that starts at or before the position.
    sheet = (2 * remainder + gap) // (length * breadth)
    remainder = remainder - _half(length * breadth * sheet, gap)
    line_gap = (sheet + gap) & 1
    line = (2 * remainder + line_gap) // length
    indices = np.empty((*remainder.shape, 3), np.int64)
    for axis, index in zip(axes, (remainder - _half(length * line, line_gap), line, sheet)):
        indices[..., axis] = index
    return indices


def checked_variant(variant: int) -> int:
    """Return the variant, or raise ValueError if it is invalid."""
    if isinstance(variant, bool) or variant not in VARIANTS:
        raise ValueError(f'weave.variant is {variant!r}: it must be 0, 1, 2 or 3')
    return int(variant)


def checked_size(size: Sequence[int]) -> tuple[int, int, int]:
    """Return the size as three positive integers, or raise ValueError."""
    values = list(size)
    whole = all(isinstance(value, (int, np.integer)) and not isinstance(value, bool)
                for value in values)
    if not (len(values) == 3 and whole and min(values) >= 1):
        raise ValueError(
            f'weave.size is {values}: it must be three whole numbers of at least 1')
    return int(values[0]), int(values[1]), int(values[2])


def _line_count(length: int, line: Index, k: Index, gap: int) -> Index:
    return (int(length) + 1 - ((line + k + gap) & 1)) // 2


def _half(doubled: np.ndarray, gap: int | np.ndarray) -> np.ndarray:
    # The document's (n + n mod 2)/2 for a count that starts at an icosahedron, (n - n mod 2)/2 for
    # one that starts at a gap.
    return (doubled + 1 - gap) >> 1
