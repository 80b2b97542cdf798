# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric verify BAG ...`."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from icofabric_sim.commands.bags import bag_errors, bag_path
from icofabric_sim.commands.report import add_json_argument, print_report
from icofabric_sim.terminal import InputError, notes, Progress

if TYPE_CHECKING:
    from icofabric_sim.bag.recorded_run import RecordedRun

_NAME = 'icofabric verify'
_NANOSECONDS = 10**9
# Integer nanoseconds of later times do not fit a bag [s].
_MAX_TIME_S = 9e9


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument(
        'bags', metavar='BAG', nargs='+',
        help='folder of a bag, or its .mcap or .db3 file; several are verified one by one')
    add_json_argument(parser)
    parser.add_argument(
        '--node', default='', metavar='NAME',
        help='fabric to verify: full name of its node (default: all in the bag)')
    parser.add_argument(
        '--threads', type=int, default=0, metavar='N',
        help='number of threads (default: as in the scene); the result does not depend on it')
    parser.add_argument(
        '--start', type=float, metavar='S',
        help='simulated time [s]: start at the last checkpoint up to this time, instead '
             'of at the start')
    parser.add_argument(
        '--stop', type=float, metavar='S', help='simulated time [s] at which to stop')


def main(arguments: argparse.Namespace) -> int:
    """Simulate each run again and compare; return 1 if one differs."""
    if arguments.threads < 0:
        raise InputError(f'--threads must be at least 0, got {arguments.threads}')
    start, stop = (_nanoseconds(name, getattr(arguments, name)) for name in ('start', 'stop'))
    if start is not None and stop is not None and not start <= stop:
        raise InputError(f'--stop {arguments.stop:g} s lies before --start {arguments.start:g} s')
    good = True
    for number, name in enumerate(arguments.bags):
        if number and not arguments.json:
            print()
        path = bag_path(name)
        with bag_errors(path):
            for node in _nodes(path, arguments.node):
                good &= _verify(
                    path, node, arguments.threads, start, stop, as_json=arguments.json)
    return 0 if good else 1


def _nodes(path: Path, wanted: str) -> list[str]:
    from icofabric_sim.bag.recorded_run import RecordedRun
    with RecordedRun(path) as run:
        if wanted and not any(name.startswith(f'{wanted}/') for name in run.topics):
            raise InputError(
                f'--node {wanted!r}: unknown fabric; {path} contains '
                f'{", ".join(run.nodes) or "none"}')
        return [wanted] if wanted else run.nodes or ['']


def _verify(
    path: Path, node: str, threads: int, start: int | None, stop: int | None, *, as_json: bool
) -> bool:
    from icofabric_sim.bag.recorded_run import RecordedRun
    from icofabric_sim.running.replay.resimulation import NotRepeatable
    from icofabric_sim.running.replay.verify import verify_run
    with RecordedRun(path, node) as run:
        if 'animation' in run.custom:
            raise InputError(
                f'{path} is an animation ({run.custom["animation"]}): there is no simulation that '
                'could be verified')
        begin = _within(run, start)
        end = run.end if stop is None else min(stop, run.end)
        span = max((end - begin) / _NANOSECONDS, 1e-9)
        with Progress(span, 's') as progress, notes(progress, _NAME):
            try:
                result = verify_run(
                    run, threads=threads, start=start, stop=stop,
                    on_time=lambda time: progress.update((time - begin) / _NANOSECONDS))
            except NotRepeatable as error:
                # A bag, but one that cannot be simulated again: bad input.
                raise InputError(str(error)) from error
            except KeyboardInterrupt:
                progress.note(f'{_NAME}: {path} was not verified to its end')
                raise
    print_report(result.rows(), as_json=as_json, lines=[result.conclusion()])
    return result.is_good


def _within(run: 'RecordedRun', start: int | None) -> int:
    if start is None:
        return run.start
    if not start <= run.end:
        raise InputError(
            f'--start {start / _NANOSECONDS:g} s lies after the end of {run.path} '
            f'({run.end / _NANOSECONDS:g} s)')
    return max(start, run.start)


def _nanoseconds(name: str, time: float | None) -> int | None:
    if time is None:
        return None
    if not 0.0 <= time <= _MAX_TIME_S:
        raise InputError(f'--{name} must be a simulated time [s], at least 0, got {time!r}')
    return round(time * _NANOSECONDS)
