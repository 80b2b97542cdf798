# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric study`."""

import argparse
from collections.abc import Sequence
import importlib.util
import os
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

from icofabric_sim.commands.report import add_json_numbers_argument, print_json
from icofabric_sim.libraries import require_library
from icofabric_sim.terminal import (
    bad_input,
    CommandFailed,
    duration_text,
    InputError,
    notes,
    Progress,
    require_place,
    say,
)

if TYPE_CHECKING:
    from icofabric_sim.sweeps.single_run import Outcome
    from icofabric_sim.sweeps.sweep import Executor, Study
    from icofabric_validation.material.part import Part, Results, Row, Stage, Table

_NAME = 'icofabric study'
_OUTPUT, _STORE = 'runs/study', 'runs/sweep'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument(
        '--part', action='append', metavar='NAME', default=[],
        help='run only this part; may be repeated (default: all; --list names them)')
    how_much = parser.add_mutually_exclusive_group()
    how_much.add_argument(
        '--quick', action='store_true',
        help='fewer values: three minutes of one core instead of ten')
    how_much.add_argument(
        '--large', action='store_true', help='larger slabs and more values: hours of one core')
    parser.add_argument(
        '--output', default=_OUTPUT, metavar='FOLDER',
        help='folder of figures (PART.png), tables (PART.txt) and results '
             '(PART.STAGE.csv) (%(default)s)')
    parser.add_argument(
        '--store', default=_STORE, metavar='FOLDER',
        help='folder of finished runs, which are not repeated; shared with icofabric sweep '
             '(%(default)s)')
    parser.add_argument(
        '--workers', type=int, metavar='N',
        help='processes on this machine (default: one for each core if Dask is installed, '
             'extra `sweep`); 0: only this process')
    parser.add_argument(
        '--retry', action='store_true', help='repeat failed runs')
    parser.add_argument(
        '--list', action='store_true',
        help='list the parts and their progress without running them')
    add_json_numbers_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    """Run what the store lacks, then write tables and figures; return 1 if a run has failed."""
    from icofabric_sim.sweeps.sweep import make_executor
    from icofabric_validation.material.catalogue import make_study, PARTS
    from icofabric_validation.material.part import Level
    for name in arguments.part:
        if name not in PARTS:
            raise InputError(f'--part {name}: unknown part; choose from '
                             f'{", ".join(PARTS)}')
    store = require_place('--store', Path(arguments.store).expanduser(), is_folder=True)
    output = require_place('--output', Path(arguments.output).expanduser(), is_folder=True)
    if not arguments.list:
        require_library('matplotlib', 'a picture')
    workers = arguments.workers
    if workers is None and importlib.util.find_spec('distributed') is None:
        workers = 0
    with bad_input():
        executor = make_executor(workers, '')
    parts = [part for name, part in PARTS.items() if name in (arguments.part or PARTS)]
    level = Level.QUICK if arguments.quick else (
        Level.LARGE if arguments.large else Level.USUAL)
    work = _Work()
    for part in parts:
        for name, stage in part.stages(level).items():
            with bad_input():
                work.add(part, name, stage, make_study(stage, store))
    if arguments.list:
        if arguments.json:
            print_json({'parts': {part.name: work.numbers(part) for part in parts}})
        else:
            for part in parts:
                print(work.line(part))
        return 0
    return _carry_out(
        work, parts, executor, output, retry=arguments.retry, as_json=arguments.json)


class _Work:
    """Studies of all stages, and their expected cost."""

    def __init__(self) -> None:
        self.stages: dict[tuple[str, str], tuple[Stage, Study]] = {}
        self.done = 0.0  # expected seconds of one core of the finished work

    def add(self, part: 'Part', name: str, stage: 'Stage', study: 'Study') -> None:
        self.stages[part.name, name] = stage, study

    def of(self, part: 'Part') -> dict[str, tuple['Stage', 'Study']]:
        """Return the stages of a part by name."""
        return {name: found for (owner, name), found in self.stages.items()
                if owner == part.name}

    @property
    def whole(self) -> float:
        """Return the expected seconds of one core."""
        return sum(stage.seconds * len(stage.cases) for stage, _ in self.stages.values())

    def numbers(self, part: 'Part') -> dict[str, Any]:
        """Return the finished and total runs of a part, and its expected cost."""
        stages = self.of(part).values()
        return {
            'title': part.title, 'runs': sum(len(study.requests) for _, study in stages),
            'finished': sum(len(study.finished()) for _, study in stages),
            'seconds_of_one_core': sum(
                stage.seconds * len(stage.cases) for stage, _ in stages)}

    def line(self, part: 'Part') -> str:
        """Return a line about a part."""
        found = self.numbers(part)
        return (f'{part.name:10} {part.title}: {found["runs"]} runs, {found["finished"]} '
                f'finished; about {duration_text(found["seconds_of_one_core"])} of one core for '
                'all')


def _carry_out(
    work: _Work, parts: Sequence['Part'], executor: 'Executor', output: Path,
    *, retry: bool,
    as_json: bool
) -> int:
    """Run part after part, so that an interrupted study has complete parts."""
    from icofabric_validation.material.part import rows_of
    began = time.monotonic()
    say(f'{_NAME}: about {duration_text(work.whole)} of one core if nothing is finished; finished '
        'runs are kept, and the same command continues')
    written: 'dict[str, tuple[str, list[Table]]]' = {}
    failed = reused = runs = 0
    try:
        with Progress(work.whole, 's of work foreseen') as progress, notes(progress, _NAME):
            for part in parts:
                found: dict[str, Sequence[Row]] = {}
                for name, (stage, study) in work.of(part).items():
                    outcomes = _outcomes(work, stage, study, executor, progress, retry=retry)
                    table = study.table(outcomes)
                    table.save(output / f'{part.name}.{name}.csv')
                    found[name] = rows_of(table)
                    failed += len(table.failed)
                    reused += sum(outcome.reused for outcome in outcomes)
                    runs += len(outcomes)
                    for outcome in table.failed:
                        progress.note(f'{part.name}, {name}: '
                                      f'{study.plan.describe(outcome.number)}: {outcome.reason}')
                written[part.name] = _write(part, found, output, progress)
    except KeyboardInterrupt:
        say(f'{_NAME}: finished runs are kept; the same command continues')
        raise
    if as_json:
        print_json({
            'runs': runs, 'from_store': reused, 'failed': failed, 'output': str(output),
            'parts': {part.name: {'title': part.title, 'tables': [
                table._asdict() for table in written[part.name][1]]} for part in parts}})
        return int(failed > 0)
    for text, _ in written.values():
        print(text)
    print(f'{runs:,} runs, {reused:,} of them from the store, {failed:,} failed, in '
          f'{duration_text(time.monotonic() - began)}; figures and tables: {output}')
    return int(failed > 0)


def _outcomes(
    work: _Work, stage: 'Stage', study: 'Study', executor: 'Executor', progress: Progress,
    *, retry: bool
) -> list['Outcome']:
    from icofabric_sim.sweeps.dask_runs import SchedulerLost
    from icofabric_sim.sweeps.single_run import WorkersDiffer
    found = []
    with bad_input():
        try:
            for outcome in study.outcomes(executor, retry=retry):
                found.append(outcome)
                work.done += stage.seconds
                progress.update(work.done)
        except (SchedulerLost, WorkersDiffer) as error:
            raise CommandFailed(f'{error}; the same command continues') from error
    return found


def _write(
    part: 'Part', found: 'Results', output: Path, progress: Progress
) -> 'tuple[str, list[Table]]':
    """Write figure and tables of a part; return the tables as text and as data."""
    from icofabric_validation.pictures.material_figures import draw_part
    lines, tables = [f'# {part.name}: {part.title}', ''], []
    try:
        tables = part.tables(found)
        for table in tables:
            lines += [table.title, '', *table.lines(), '']
            if table.note:
                lines += [table.note, '']
        draw_part(output / f'{part.name}.png', part.name, found)
    except (KeyError, ValueError, TypeError, ArithmeticError, StopIteration) as error:
        # A stage in which all runs have failed has no columns.
        progress.note(f'{part.name}: no tables, because runs that they need have failed ({error})')
    text = '\n'.join(lines)
    _replace(output / f'{part.name}.txt', text)
    return text, tables


def _replace(path: Path, text: str) -> None:
    """Replace a file atomically."""
    aside = path.with_name(f'.{path.name}.{os.getpid()}')
    try:
        aside.write_text(f'{text}\n', encoding='utf-8')
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)
