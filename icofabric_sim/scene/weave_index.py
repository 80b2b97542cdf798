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
Where the icosahedra of an orthogonal slab lie, how many there are, and how they are numbered.

Source: "A Mathematical Model of Icosahedral Materials", eqs 55-65, Tables 1-4 and the formulas
for the index alpha. Everything is integer and in units of the pitch W; indices may be integers or
integer arrays, which broadcast, and negative ones (the infinite fabric) work throughout.

The centres are the grid points x + y + z of one parity: even for variants 0 and 2, odd for 1 and
3. The document numbers them along columns (x = 2i + ..., y = j, z = k) in variants 0 and 1, and
along rows (x = i, y = 2j + ..., z = k) in variants 2 and 3, and says that a permutation of the
axes gives as good a rule. `along` chooses one of the six: 'column' or 'row', or the axes in the
order in which they are counted: 'xyz' is 'column', 'yxz' is 'row', and in 'zxy' a place is
2k + ... along z, the lines follow each other along x, and the sheets of lines along y.
"""

from itertools import permutations
from typing import Literal, Sequence

from icofabric_sim import checks
import numpy as np

VARIANTS = (0, 1, 2, 3)

Index = int | np.integer | np.ndarray
Along = Literal['column', 'row', 'xyz', 'xzy', 'yxz', 'yzx', 'zxy', 'zyx']
# Axes of the places in a line, of the lines in a sheet, and of the sheets.
_ORDERS = {''.join('xyz'[axis] for axis in axes): axes for axes in permutations(range(3))}
_ORDERS |= {'column': _ORDERS['xyz'], 'row': _ORDERS['yxz']}


def gap_parity(variant: int) -> int:
    """
    Return 0 where the corner holds an icosahedron (variants 0, 2), 1 where it is a gap (1, 3).
    """
    return checked_variant(variant) & 1


def is_turned(variant: int) -> bool:
    """Return whether the bodies are turned by 90 degrees about z (variants 2 and 3)."""
    return checked_variant(variant) >= 2


def rule_of(variant: int) -> Along:
    """Return the direction along which the document's own rule and alpha count this variant."""
    return 'row' if is_turned(variant) else 'column'


def _axes(variant: int, along: str | None) -> tuple[int, ...]:
    """Return the axes of places, lines and sheets; of the document's own rule where None."""
    along = rule_of(variant) if along is None else along
    checks.choice('along', along, tuple(_ORDERS))
    return _ORDERS[along]


def centre_rule(
        variant: int, i: Index, j: Index, k: Index, *, along: Along | None = None) -> np.ndarray:
    """
    Return the grid point (x, y, z) of coordinate indices (i, j, k), int64, (..., 3).

    Eqs 55, 56, 59, 61 and 63, and for another `along` the rules that permute the axes.
    Reduction modulo 2 is a bit mask, so it needs no absolute values (eq 55) for negative indices.
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
    Coordinate indices (i, j, k) of grid points with an icosahedron, int64, (..., 3).

    The inverse of `centre_rule`; the parity of the points is not checked.
    """
    indices = np.array(grid, np.int64)
    # An arithmetic shift rounds down, also below zero, which drops the remainder of the rule.
    indices[..., _axes(variant, along)[0]] >>= 1
    return indices


def is_centre(variant: int, grid: np.ndarray) -> np.ndarray:
    """Return which grid points (..., 3) hold an icosahedron in the infinite fabric."""
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

    The indices are those of the same rule (`along`) and must lie in the slab.
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
    Coordinate indices (i, j, k) of the icosahedra `alpha`, int64, (..., 3).

    The inverse of `alpha_from_indices` for 0 <= alpha < `slab_count`.
    """
    remainder = np.asarray(alpha, np.int64)
    gap = gap_parity(variant)
    axes = _axes(variant, along)
    length, breadth, _ = (int(size[axis]) for axis in axes)
    # The last sheet, then the last line, that starts at or before the wanted place.
    sheet = (2 * remainder + gap) // (length * breadth)
    remainder = remainder - _half(length * breadth * sheet, gap)
    line_gap = (sheet + gap) & 1
    line = (2 * remainder + line_gap) // length
    indices = np.empty((*remainder.shape, 3), np.int64)
    for axis, index in zip(axes, (remainder - _half(length * line, line_gap), line, sheet)):
        indices[..., axis] = index
    return indices


def checked_variant(variant: int) -> int:
    """Return the variant if it is one."""
    if isinstance(variant, bool) or variant not in VARIANTS:
        raise ValueError(f'weave.variant is {variant!r}: it must be 0, 1, 2 or 3')
    return int(variant)


def checked_size(size: Sequence[int]) -> tuple[int, int, int]:
    """Return the size as three integers, all positive."""
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
    # The document's (n + n mod 2)/2 where the count starts at an icosahedron, (n - n mod 2)/2
    # where it starts at a gap.
    return (doubled + 1 - gap) >> 1
