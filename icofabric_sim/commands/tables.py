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
`icofabric tables`: Tables 1 to 10 of the document, from the data that weaves are built from.

Source: "A Mathematical Model of Icosahedral Materials". Nothing is typed in here: counts come from
`scene/weave_index.py`, connections from `scene/weave_tables.py`.
"""

import argparse
from collections.abc import Callable, Sequence
from itertools import groupby
import json
from pathlib import Path
from textwrap import wrap
from typing import NamedTuple

from icofabric_sim.libraries import require_library
from icofabric_sim.terminal import bad_input, InputError, require_place

Size = tuple[int, int, int]
# As the default of `weave.size`: all three are odd, where the formulas show all they can.
_SIZE = (5, 5, 5)
_SUFFIXES = ('.png', '.svg')
_PARITIES = ('both odd or both even', 'one odd, one even')


class Displacement(NamedTuple):
    """From the centre of the local icosahedron to that of the remote one, in units of W."""

    x: int
    y: int
    z: int

    def __str__(self) -> str:
        """Return it as the document writes it, such as (W, 0, -W)."""
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
    """One table of the document."""

    number: int
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ''

    def lines(self) -> list[str]:
        """Return it as aligned text."""
        texts = [self.columns, *([str(cell) for cell in row] for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*texts)]
        numeric = [isinstance(cell, int) for cell in self.rows[0]]
        lines = [f'Table {self.number}: {self.title}']
        for row in texts:
            cells = (
                text.rjust(width) if right else text.ljust(width)
                for text, width, right in zip(row, widths, numeric))
            lines.append(f'  {"  ".join(cells)}'.rstrip())
        return lines + wrap(self.note, 98, initial_indent='  ', subsequent_indent='  ')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb takes."""
    parser.add_argument(
        'numbers', metavar='N', nargs='*', type=int,
        help='tables to print, 1 to 10 (default: all, or none where --figure is given)')
    parser.add_argument(
        '--size', type=int, nargs=3, metavar=('NX', 'NY', 'NZ'), default=_SIZE,
        help='slab that Tables 1 to 4 and 10 count, in grid positions (default: 5 5 5)')
    parser.add_argument(
        '--json', action='store_true',
        help='print JSON instead of text: displacements in units of W, indices of neighbours as '
             'steps from (i, j, k)')
    parser.add_argument(
        '--figure', metavar='FILE',
        help='draw Figure 5, connector length over connector angle, beside a diagram of the six '
             'edges and the twelve connectors of an icosahedron, to a .png or .svg')


def main(arguments: argparse.Namespace) -> int:
    """Print tables, draw the figure, or both."""
    from icofabric_sim.scene.weave_index import checked_size
    for number in arguments.numbers:
        if number not in TABLES:
            raise InputError(f'N must be the number of a table, 1 to {max(TABLES)}, got {number}')
    figure = None if arguments.figure is None else Path(arguments.figure).expanduser()
    if figure is not None:
        if figure.suffix.lower() not in _SUFFIXES:
            raise InputError(
                f'--figure {arguments.figure}: give a file that ends in {" or ".join(_SUFFIXES)}')
        require_place('--figure', figure)
        require_library('matplotlib', 'a picture')
    with bad_input():
        size = checked_size(arguments.size)
    wanted = arguments.numbers or ([] if figure else TABLES)
    tables = [TABLES[number](number, size) for number in wanted]
    if figure is not None:
        from icofabric_sim.pictures.weave_diagram import draw_figure_5
        figure.parent.mkdir(parents=True, exist_ok=True)
        draw_figure_5(figure)
    if arguments.json:
        print(json.dumps({
            'size': size, 'tables': [table._asdict() for table in tables],
            'figure': None if figure is None else str(figure)}, indent=1))
        return 0
    text = ['\n'.join(table.lines()) for table in tables]
    if figure is not None:
        text.append(f'Figure 5 drawn to {figure}')
    print('\n\n'.join(text))
    return 0


def _line_table(number: int, size: Size) -> Table:
    """Tables 1 and 2: a column j, or a row i, of level k."""
    from icofabric_sim.scene.weave_index import column_count, row_count
    count, name, letter = (
        (column_count, 'column', 'j') if number == 1 else (row_count, 'row', 'i'))
    return Table(
        number, f'icosahedra in a {name} of a slab of {_of(size)}',
        ('variant', *(f'{letter} and k {parity}' for parity in _PARITIES)),
        tuple((label, *(int(count(variant, size, line, 0)) for line in (0, 1)))
              for variant, label in enumerate(('0 or 2', '1 or 3'))),
        f'{letter} is the number of the {name} and k that of its level, both from 0.')


def _level_table(number: int, size: Size) -> Table:
    from icofabric_sim.scene.weave_index import level_count
    return Table(
        number, f'icosahedra in level k of a slab of {_of(size)}',
        ('variant', 'k even', 'k odd'),
        tuple((label, *(int(level_count(variant, size, k)) for k in (0, 1)))
              for variant, label in enumerate(('0 or 2', '1 or 3'))),
        'Corrected: k counts from 0, as everywhere; the signs of the document, (-1)^(k+1) for '
        'variants 0 and 2 and (-1)^k for 1 and 3, are those for levels counted from 1.')


def _slab_table(number: int, size: Size) -> Table:
    from icofabric_sim.scene.weave_index import slab_count
    return Table(
        number, f'icosahedra in a slab of {_of(size)}', ('variant', 'icosahedra'),
        tuple((label, slab_count(variant, size))
              for variant, label in enumerate(('0 or 2', '1 or 3'))))


def _edge_table(number: int, size: Size) -> Table:
    from icofabric_sim.geometry.icosahedron import NAMED_EDGES
    from icofabric_sim.scene.weave_tables import TABLE_5
    return Table(
        number, 'centres of the icosahedra that are connected to one, from its centre, body axes',
        ('local edge', 'remote edge', 'one centre', 'the other'),
        tuple((NAMED_EDGES[edge], NAMED_EDGES[edge ^ 1],
               *(Displacement(*direction) for _, direction in pairs))
              for edge, pairs in groupby(TABLE_5, key=lambda pair: pair[0])),
        'W = w + L sin(theta). Up is body +z, north body +x, west body +y.')


def _index_table(number: int, size: Size) -> Table:
    """Tables 6 to 9: connections of variants 0 to 3."""
    from icofabric_sim.geometry.icosahedron import NAMED_EDGES
    from icofabric_sim.scene.weave_index import is_turned
    from icofabric_sim.scene.weave_tables import INDEX_TABLES
    variant = number - 6
    line = 'i' if is_turned(variant) else 'j'
    return Table(
        number, f'connections of icosahedron (i, j, k) in the orthogonal weave, variant {variant}',
        ('local edge', 'remote edge', 'displacement', *(f'k and {line} {p}' for p in _PARITIES)),
        tuple((NAMED_EDGES[row.local_edge], NAMED_EDGES[row.remote_edge],
               Displacement(*row.displacement), Step(*row.even_step), Step(*row.odd_step))
              for row in INDEX_TABLES[variant]))


def _connector_table(number: int, size: Size) -> Table:
    from icofabric_sim.scene.weave_tables import connector_count, table_10
    return Table(
        number, f'connections in a slab of {_of(size)}',
        ('variant', 'connections', 'unit squares of the grid'),
        tuple((label, table_10(variant, size), connector_count(variant, size))
              for variant, label in ((0, '0 or 1'), (2, '2 or 3'))),
        'Each unit square of the grid holds one connector, so the two columns agree.')


TABLES: dict[int, Callable[[int, Size], Table]] = {
    1: _line_table, 2: _line_table, 3: _level_table, 4: _slab_table, 5: _edge_table,
    **dict.fromkeys(range(6, 10), _index_table), 10: _connector_table}


def _of(size: Sequence[int]) -> str:
    return ' x '.join(map(str, size))
