# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric recover BAG [DESTINATION]`."""

import argparse
from pathlib import Path

from icofabric_sim.commands.bags import bag_path
from icofabric_sim.commands.report import add_json_argument, print_report
from icofabric_sim.terminal import CommandFailed, InputError, Progress, require_place


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument('bag', metavar='BAG', help='folder of the bag, or its .mcap or .db3 file')
    parser.add_argument(
        'destination', metavar='DESTINATION', nargs='?', default='',
        help='folder of the new bag (default: BAG_recovered)')
    add_json_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    """Copy all readable messages into a new bag."""
    from icofabric_sim.bag import BagError, next_free_path, recover_bag
    from icofabric_sim.bag.reader import storage_files
    from icofabric_sim.bag.summary import span_text

    source = bag_path(arguments.bag)
    if not source.exists():
        raise InputError(f'{source} does not exist')
    if not any(file.suffix in ('.mcap', '.db3') for file in storage_files(source)):
        raise InputError(f'{source} is not a bag: it holds no .mcap or .db3 file')
    name = source.name if source.is_dir() else source.stem
    if arguments.destination:
        destination = Path(arguments.destination).expanduser()
        if destination.exists():
            raise InputError(f'{destination} already exists and will not be overwritten; choose '
                             'another')
        require_place('DESTINATION', destination)
    else:
        destination = next_free_path(source.absolute().with_name(f'{name}_recovered'))
    with Progress(100.0, '%') as progress:
        try:
            report = recover_bag(
                source, destination, on_progress=lambda part: progress.update(100.0 * part))
        except BagError as error:
            raise CommandFailed(str(error)) from error
    print_report([
        ('bag', str(report.path)),
        ('messages', f'{report.message_count:,}, '
                     f'{span_text(report.start_time, report.end_time)}'),
        *(('' if number else 'topics', f'{topic}: {count:,}')
          for number, (topic, count) in enumerate(sorted(report.topics.items()))),
        ('source', f'the source was damaged: {report.damage}' if report.damage else
         'the source was complete: nothing was lost'),
        ('next', f'icofabric info {report.path}')], as_json=arguments.json)
    return 0
