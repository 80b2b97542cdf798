# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric tables`: the tables of `icofabric document`, and its Figure 5."""

import argparse
import json

from icofabric_sim.commands.picture_arguments import figure_path


def add_size_argument(parser: argparse.ArgumentParser) -> None:
    """Declare the size of the slab whose bodies the tables count."""
    # The default of `weave.size`: all three are odd, so that every case of the formulas appears.
    parser.add_argument(
        '--size', type=int, nargs=3, metavar=('NX', 'NY', 'NZ'), default=(5, 5, 5),
        help='slab that Tables 1 to 4 and 10 count, in grid positions (default: 5 5 5)')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument(
        'numbers', metavar='N', nargs='*', type=int,
        help='tables to print, 1 to 10 (default: all, or none with --figure)')
    add_size_argument(parser)
    parser.add_argument(
        '--json', action='store_true',
        help='print JSON instead of text: displacements in units of W, indices of neighbours as '
             'steps from (i, j, k)')
    parser.add_argument(
        '--figure', metavar='FILE',
        help='draw Figure 5, connector length against connector angle, and a diagram of the six '
             'edges and the twelve connectors of an icosahedron, to a .png or .svg')


def main(arguments: argparse.Namespace) -> int:
    """Print tables, draw the figure, or both."""
    from icofabric_sim.commands.document_tables import find_tables, TABLES
    figure = None if arguments.figure is None else figure_path('--figure', arguments.figure)
    size, tables = find_tables(
        arguments.numbers or ([] if figure else list(TABLES)), arguments.size)
    if figure is not None:
        from icofabric_sim.pictures.document_figures import draw_figure
        draw_figure('5', figure)
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
