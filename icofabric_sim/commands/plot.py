# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric plot BAG KIND`, also for the table of a benchmark."""

import argparse
import math
from pathlib import Path
import re

from icofabric_sim.commands.bags import bag_errors, bag_path
from icofabric_sim.commands.picture_arguments import figure_path
from icofabric_sim.terminal import bad_input, InputError

_WORK = 'work-precision'
_KINDS = ('energy', 'displacement', 'force', 'tension', 'spectrum', 'stress', _WORK)
_MIN_INCHES, _MAX_INCHES = 2.0, 40.0  # inches


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument(
        'bag', metavar='BAG',
        help='folder of a recorded run, or its file; for work-precision: work_precision.csv')
    parser.add_argument(
        'kind', choices=_KINDS, metavar='KIND',
        help='energy: energies and their balance; displacement, force: of groups against time; '
             'tension: distribution over the connectors, at four times; spectrum: of the '
             'displacements; stress: against strain, between two groups; work-precision: error '
             'against time of the solvers in a table of `icofabric benchmark work-precision`')
    parser.add_argument(
        '--output', metavar='FILE',
        help='figure, a file that ends in .png or .svg (default: BAG_KIND.png beside the bag)')
    parser.add_argument(
        '--groups', nargs='+', default=[], metavar='GROUP',
        help="groups of the scene, selectors such as 'x_max and z_max', or numbers of bodies "
             '(default: all groups of the scene)')
    parser.add_argument(
        '--axis', choices=('x', 'y', 'z'), default='',
        help='component of displacements and forces (default: magnitude of the vector)')
    parser.add_argument(
        '--size', default='6.4x4.0', metavar='WxH', help='size of the figure [inches] '
                                                         '(%(default)s)')
    parser.add_argument('--from', type=float, metavar='T', dest='start', default=-math.inf,
                        help='start at this simulated time [s]')
    parser.add_argument('--to', type=float, metavar='T', dest='end', default=math.inf,
                        help='end at this simulated time [s]')


def main(arguments: argparse.Namespace) -> int:
    """Draw one figure."""
    from icofabric_sim.bag import BagError
    from icofabric_sim.bag.recorded_run import RecordedRun
    from icofabric_sim.pictures.run_plots import plot_run

    source = bag_path(arguments.bag)
    name = source.stem if source.is_file() else source.name
    path = figure_path('--output', (
        source.absolute().with_name(f'{name}_{arguments.kind}.png')
        if arguments.output is None else arguments.output))
    size = _inches(arguments.size)
    if not arguments.end >= arguments.start:
        raise InputError(
            f'--to {arguments.end:g} s is before --from {arguments.start:g} s, or is not a time')
    if arguments.kind == _WORK:
        return _plot_work(arguments, source, path, size)
    with bad_input(), bag_errors(source), RecordedRun(source) as run:
        try:
            plot_run(
                run, arguments.kind, path, groups=arguments.groups, axis=arguments.axis,
                size=size, start=arguments.start, end=arguments.end)
        except BagError:
            raise
        except ValueError as error:
            raise InputError(f'--{error}') from error
    print(f'{arguments.kind} in {path}')
    return 0


def _plot_work(
    arguments: argparse.Namespace, source: Path, path: Path, size: tuple[float, float]
) -> int:
    from icofabric_sim.pictures.precision_picture import draw_work_precision, read_points
    for option, given in (
            ('--groups', arguments.groups), ('--axis', arguments.axis),
            ('--from', math.isfinite(arguments.start)), ('--to', math.isfinite(arguments.end))):
        if given:
            raise InputError(f'{option} applies to recorded runs; {_WORK} takes a table')
    if not source.is_file():
        raise InputError(
            f'{source}: no such file; {_WORK} takes the table that icofabric benchmark '
            f'{_WORK} --output FOLDER writes')
    with bad_input():
        draw_work_precision(read_points(source), path, size=size)
    print(f'{arguments.kind} in {path}')
    return 0


def _inches(text: str) -> tuple[float, float]:
    match = re.fullmatch(r'([0-9.]+)[x,]([0-9.]+)', text)
    try:
        size = (float(match[1]), float(match[2])) if match else (0.0, 0.0)
    except ValueError:
        size = (0.0, 0.0)
    if not all(_MIN_INCHES <= side <= _MAX_INCHES for side in size):
        raise InputError(
            f'--size must be WIDTHxHEIGHT, {_MIN_INCHES:g} to {_MAX_INCHES:g} inches, such as '
            f'6.4x4.0, got {text!r}')
    return size
