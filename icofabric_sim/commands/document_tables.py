# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Tables 1 to 10 of the document, computed from the data that weaves are built from.

Source: "A Mathematical Model of Icosahedral Materials". Counts come from `scene/weave_index.py`
and connections from `scene/weave_tables.py`; no value is typed in.
"""

from collections.abc import Callable, Sequence
from itertools import groupby
from textwrap import wrap
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import NAMED_EDGES
from icofabric_sim.scene.weave_index import (
    checked_size,
    column_count,
    is_turned,
    level_count,
    row_count,
    slab_count,
)
from icofabric_sim.scene.weave_tables import connector_count, INDEX_TABLES, TABLE_5, table_10
from icofabric_sim.terminal import bad_input, InputError

Size = tuple[int, int, int]
_PARITIES = ('both odd or both even', 'one odd, one even')


class Displacement(NamedTuple):
    """Vector from the centre of the local icosahedron to that of the remote one, in units of W."""

    x: int
    y: int
    z: int

    def __str__(self) -> str:
        """Return the displacement as in the document, such as (W, 0, -W)."""
        return f'({", ".join({-1: "-W", 0: "0", 1: "W"}[part] for part in self)})'


class Step(NamedTuple):
    """Coordinate indices of the remote icosahedron minus those of the local one."""

    i: int
    j: int
    k: int

    def __str__(self) -> str:
        """Return the indices of the remote icosahedron, such as (i+1, j, k)."""
        return f'({", ".join(f"{n}{part:+d}" if part else n for n, part in zip("ijk", self))})'


Cell = str | int | Displacement | Step


class Table(NamedTuple):
    """Table of the document."""

    number: int
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ''

    def lines(self) -> list[str]:
        """Return the table as aligned text."""
        return [
            f'Table {self.number}: {self.title}', *align_rows(self.columns, self.rows),
            *indent_text(self.note)]


def align_rows(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """Return a header and rows as lines; columns of integers are right-aligned."""
    texts = [columns, *([str(cell) for cell in row] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*texts)]
    numeric = [isinstance(cell, int) for cell in rows[0]]
    return [
        '  ' + '  '.join(
            text.rjust(width) if right else text.ljust(width)
            for text, width, right in zip(row, widths, numeric)).rstrip()
        for row in texts]


def indent_text(text: str) -> list[str]:
    """Return a note as indented lines of at most 98 characters."""
    return wrap(text, 98, initial_indent='  ', subsequent_indent='  ')


def find_tables(numbers: Sequence[int], size: Sequence[int]) -> tuple[Size, list[Table]]:
    """Return the validated size of a slab and the requested tables for it."""
    for number in numbers:
        if number not in TABLES:
            raise InputError(f'N must be the number of a table, 1 to {max(TABLES)}, got {number}')
    with bad_input():
        checked = checked_size(size)
    return checked, [TABLES[number](number, checked) for number in numbers]


def _line_table(number: int, size: Size) -> Table:
    """Return Table 1 or 2: icosahedra in a column j, or in a row i, of level k."""
    count, name, letter = (
        (column_count, 'column', 'j') if number == 1 else (row_count, 'row', 'i'))
    return Table(
        number, f'icosahedra in a {name} of a slab of {_of(size)}',
        ('variant', *(f'{letter} and k {parity}' for parity in _PARITIES)),
        tuple((label, *(int(count(variant, size, line, 0)) for line in (0, 1)))
              for variant, label in enumerate(('0 or 2', '1 or 3'))),
        f'{letter} is the index of the {name} and k that of its level, both from 0.')


def _level_table(number: int, size: Size) -> Table:
    return Table(
        number, f'icosahedra in level k of a slab of {_of(size)}',
        ('variant', 'k even', 'k odd'),
        tuple((label, *(int(level_count(variant, size, k)) for k in (0, 1)))
              for variant, label in enumerate(('0 or 2', '1 or 3'))),
        'Corrected: k counts from 0; the signs of the document, (-1)^(k+1) for '
        'variants 0 and 2 and (-1)^k for 1 and 3, are for levels counted from 1.')


def _slab_table(number: int, size: Size) -> Table:
    return Table(
        number, f'icosahedra in a slab of {_of(size)}', ('variant', 'icosahedra'),
        tuple((label, slab_count(variant, size))
              for variant, label in enumerate(('0 or 2', '1 or 3'))))


def _edge_table(number: int, size: Size) -> Table:
    return Table(
        number, 'centres of the neighbours of an icosahedron, from its centre, body axes',
        ('local edge', 'remote edge', 'one centre', 'the other'),
        tuple((NAMED_EDGES[edge], NAMED_EDGES[edge ^ 1],
               *(Displacement(*direction) for _, direction in pairs))
              for edge, pairs in groupby(TABLE_5, key=lambda pair: pair[0])),
        'W = w + L sin(theta). Up is body +z, north body +x, west body +y.')


def _index_table(number: int, size: Size) -> Table:
    """Return one of Tables 6 to 9: connections of variants 0 to 3."""
    variant = number - 6
    line = 'i' if is_turned(variant) else 'j'
    return Table(
        number, f'connections of icosahedron (i, j, k) in the orthogonal weave, variant {variant}',
        ('local edge', 'remote edge', 'displacement', *(f'k and {line} {p}' for p in _PARITIES)),
        tuple((NAMED_EDGES[row.local_edge], NAMED_EDGES[row.remote_edge],
               Displacement(*row.displacement), Step(*row.even_step), Step(*row.odd_step))
              for row in INDEX_TABLES[variant]))


def _connector_table(number: int, size: Size) -> Table:
    return Table(
        number, f'connections in a slab of {_of(size)}',
        ('variant', 'connections', 'unit squares of the grid'),
        tuple((label, table_10(variant, size), connector_count(variant, size))
              for variant, label in ((0, '0 or 1'), (2, '2 or 3'))),
        'Each unit square of the grid holds one connector, so the two columns agree.')


TABLES: dict[int, Callable[[int, Size], Table]] = {
    1: _line_table, 2: _line_table, 3: _level_table, 4: _slab_table, 5: _edge_table,
    **dict.fromkeys(range(6, 10), _index_table), 10: _connector_table}
# Equations that each table uses, and the errata that correct it.
SOURCES: dict[int, tuple[tuple[int, ...], tuple[str, ...]]] = {
    1: ((57, 58, 60), ()), 2: ((62, 64, 65), ()),
    3: ((56, 57, 59, 60, 61, 62, 63, 64), ('C6',)), 4: ((57, 60, 62, 64), ()),
    5: ((50, 51), ()), 6: ((51, 56), ()), 7: ((51, 59), ()), 8: ((51, 61), ()),
    9: ((51, 63), ()), 10: ((57, 58, 60, 62, 64, 65), ())}


def _of(size: Sequence[int]) -> str:
    return ' x '.join(map(str, size))
