# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric document`: compute the tables, the appendix and the figures of the document."""

import argparse
import json
from pathlib import Path

from icofabric_sim.commands.picture_arguments import figure_path
from icofabric_sim.commands.tables import add_size_argument
from icofabric_sim.pictures.citation import cite
from icofabric_sim.terminal import bad_input, InputError, require_place

_PARTS = ('appendix', 'tables', *map(str, range(1, 11)))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    from icofabric_sim.parameters.table import STATIC
    specifications = {row.name: row for row in STATIC}
    parser.add_argument(
        'parts', metavar='PART', nargs='*',
        help='what to print: appendix, tables, or the number of a table, 1 to 10 (default: tables '
             'and appendix, or nothing if figures are drawn)')
    add_size_argument(parser)
    for option, name, quantity in (
            ('--edge', 'shell.edge_length', 'outer edge 2a'),
            ('--thickness', 'shell.thickness', 'thickness T'),
            ('--density', 'shell.density', 'density rho')):
        row = specifications[name]
        parser.add_argument(
            option, type=float, default=row.default, metavar=quantity.split()[-1].upper(),
            help=f'{quantity} of the shell for which the appendix gives numbers [{row.unit}] '
                 '(%(default)s)')
    parser.add_argument(
        '--json', action='store_true', help='print JSON instead of text, with values in SI units')
    parser.add_argument(
        '--figures', metavar='FOLDER', help='draw all figures into this folder')
    parser.add_argument(
        '--format', choices=('png', 'svg'), default='png',
        help='file format of --figures (%(default)s)')
    parser.add_argument(
        '--figure', nargs=2, action='append', default=[], metavar=('N', 'FILE'),
        help='draw one figure to a .png or .svg; N: 1, 2, 3a (golden rectangles), 3b (frustum of '
             'a face), 4, 5, 6, 7, or edges (the diagram that the text requests)')


def main(arguments: argparse.Namespace) -> int:
    """Print and draw what was requested; return 1 if a check of the appendix fails."""
    from icofabric_sim.commands.document_tables import find_tables, SOURCES, TABLES
    for part in arguments.parts:
        if part not in _PARTS:
            raise InputError(f'PART must be one of {", ".join(_PARTS)}, got {part!r}')
    paths = _figure_paths(arguments)
    parts = arguments.parts or ([] if paths else ['tables', 'appendix'])
    numbers = [int(part) for part in parts if part.isdigit()]
    if 'tables' in parts and not numbers:
        numbers = list(TABLES)
    size, tables = find_tables(numbers, arguments.size)
    appendix = None
    if 'appendix' in parts:
        from icofabric_sim.commands.appendix import Appendix
        from icofabric_sim.geometry.shell import Shell
        with bad_input():
            appendix = Appendix(Shell.from_thickness(
                arguments.edge, arguments.thickness, arguments.density))
    if paths:
        from icofabric_sim.pictures.document_figures import draw_figure, FIGURES
        for name, path in paths:
            draw_figure(name, path)
        figures = [(name, FIGURES[name], path) for name, path in paths]
    else:
        figures = []
    if arguments.json:
        print(json.dumps({
            'size': size,
            'tables': [{**table._asdict(), **dict(zip(
                ('equations', 'errata'), SOURCES[table.number]))} for table in tables],
            'figures': [{
                'figure': name, 'title': figure.title, 'equations': list(figure.equations),
                'errata': figure.errata, 'file': str(path)} for name, figure, path in figures],
            'appendix': None if appendix is None else appendix.to_json()}, indent=1))
    else:
        text = ['\n'.join([*table.lines(), f'  {cite(*SOURCES[table.number])}'])
                for table in tables]
        if appendix is not None:
            text.append('\n'.join(appendix.lines()))
        if figures:
            text.append('\n'.join(
                f'{figure.caption} drawn to {path}' for name, figure, path in figures))
        print('\n\n'.join(text))
    return 0 if appendix is None or all(check.holds for check in appendix.checks) else 1


def _figure_paths(arguments: argparse.Namespace) -> list[tuple[str, Path]]:
    """Return the names of the figures and their files."""
    paths = [(name, figure_path('--figure', file)) for name, file in arguments.figure]
    if paths or arguments.figures is not None:
        from icofabric_sim.libraries import require_library
        require_library('matplotlib', 'a picture')
        from icofabric_sim.pictures.document_figures import FIGURES
        for name, _ in paths:
            if name not in FIGURES:
                raise InputError(
                    f'--figure N must be one of {", ".join(FIGURES)}, got {name!r}')
        if arguments.figures is not None:
            folder = require_place(
                '--figures', Path(arguments.figures).expanduser(), is_folder=True)
            paths += [(name, folder / f'figure_{name}.{arguments.format}') for name in FIGURES]
    return paths
