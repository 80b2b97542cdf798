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
3. Two rules number them: one counts along columns (x = 2i + ..., y = j, z = k), which is the
document's rule for variants 0 and 1, the other along rows (x = i, y = 2j + ..., z = k), its rule
for variants 2 and 3. `along` chooses the other one: 'column' or 'row'.
"""

from typing import Literal, Sequence

import numpy as np

VARIANTS = (0, 1, 2, 3)

Index = int | np.integer | np.ndarray
Along = Literal['column', 'row']


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


def centre_rule(
        variant: int, i: Index, j: Index, k: Index, *, along: Along | None = None) -> np.ndarray:
    """
    Return the grid point (x, y, z) of coordinate indices (i, j, k), int64, (..., 3).

    Eqs 55, 56, 59, 61 and 63, and for the other `along` the alternative rules given with them.
    Reduction modulo 2 is a bit mask, so it needs no absolute values (eq 55) for negative indices.
    """
    i, j, k = np.broadcast_arrays(*(np.asarray(index, np.int64) for index in (i, j, k)))
    gap = gap_parity(variant)
    if (along or rule_of(variant)) == 'column':
        return np.stack((2 * i + ((j + k + gap) & 1), j, k), axis=-1)
    return np.stack((i, 2 * j + ((i + k + gap) & 1), k), axis=-1)


def indices_from_grid(
        variant: int, grid: np.ndarray, *, along: Along | None = None) -> np.ndarray:
    """
    Coordinate indices (i, j, k) of grid points with an icosahedron, int64, (..., 3).

    The inverse of `centre_rule`; the parity of the points is not checked.
    """
    indices = np.array(grid, np.int64)
    # An arithmetic shift rounds down, also below zero, which drops the remainder of the rule.
    indices[..., 0 if (along or rule_of(variant)) == 'column' else 1] >>= 1
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
    i, j, k = (np.asarray(index, np.int64) for index in (i, j, k))
    gap = gap_parity(variant)
    columns = (along or rule_of(variant)) == 'column'
    line_length = int(size[0] if columns else size[1])
    line, place = (j, i) if columns else (i, j)
    return (_half(int(size[0]) * int(size[1]) * k, gap)
            + _half(line_length * line, (k + gap) & 1) + place)


def indices_from_alpha(
        variant: int, size: Sequence[int], alpha: Index, *,
        along: Along | None = None) -> np.ndarray:
    """
    Coordinate indices (i, j, k) of the icosahedra `alpha`, int64, (..., 3).

    The inverse of `alpha_from_indices` for 0 <= alpha < `slab_count`.
    """
    remainder = np.asarray(alpha, np.int64)
    gap = gap_parity(variant)
    columns = (along or rule_of(variant)) == 'column'
    level_size = int(size[0]) * int(size[1])
    line_length = int(size[0] if columns else size[1])
    # The last level, then the last line, that starts at or before the wanted place.
    k = (2 * remainder + gap) // level_size
    remainder = remainder - _half(level_size * k, gap)
    line_gap = (k + gap) & 1
    line = (2 * remainder + line_gap) // line_length
    place = remainder - _half(line_length * line, line_gap)
    return np.stack((place, line, k) if columns else (line, place, k), axis=-1)


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
