# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric sweep SWEEP_FILE|SCENE`."""

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, ExitStack
import os
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

from icofabric_sim.commands.picture_arguments import figure_path
from icofabric_sim.commands.report import print_json
from icofabric_sim.commands.scenes import add_scene_arguments, read_parameters
from icofabric_sim.parameters.example_scenes import example_scenes
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

_NAME = 'icofabric sweep'
_STORE = 'runs/sweep'
_PRINTED_ROWS = 20
# The table is rewritten after this wall time [s], and after this multiple of the writing time.
_WRITE_AFTER, _WRITE_TIMES = 2.0, 20.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    add_scene_arguments(parser, 'SWEEP_FILE|SCENE', 'a sweep file, see docs/howto/sweep.md')
    parser.add_argument(
        '--vary', metavar='NAME:=VALUES', action='append', default=[],
        help="values of a parameter: '[300.0, 500.0]', or a range: 0.1..0.7/13 for 13 values, "
             '1..1000/7log with logarithmic spacing, 0.1..0.7 to be sampled; repeat for '
             'a grid; NAME[1] is one element of a list')
    parser.add_argument(
        '--sample', metavar='METHOD:COUNT[:SEED]',
        help='sample COUNT points from ranges without a count: sobol, halton, latin, random')
    parser.add_argument(
        '--verb', dest='verbs', action='append', metavar='VERB',
        help='computation of each run: run (default), statics, modes (about the equilibrium if '
             'statics is also given), elasticity, bands, curve, mechanisms; may be repeated')
    parser.add_argument(
        '--keep', action='append', metavar='PHRASE',
        help="results to keep: energies, extremes, bag, 'displacement GROUP', tension, "
             "'reaction GROUP', 'frequencies [COUNT]', moduli, gap, 'curve KIND STRAIN [POINTS "
             "[AXIS]]'; all: docs/howto/sweep.md; may be repeated")
    parser.add_argument(
        '--duration', type=float, metavar='S', help='simulated time [s] of each run')
    who = parser.add_mutually_exclusive_group()
    who.add_argument(
        '--workers', type=int, metavar='N',
        help='processes on this machine (default: one for each core); 0: only this process, '
             'without Dask')
    who.add_argument(
        '--scheduler', default='', metavar='ADDRESS',
        help='use the workers of a Dask scheduler: address (tcp://host:8786) or '
             'scheduler file (.json)')
    parser.add_argument(
        '--store', default=_STORE, metavar='FOLDER',
        help='folder of finished runs, which are not repeated (%(default)s)')
    parser.add_argument(
        '--retry', action='store_true', help='repeat failed runs')
    parser.add_argument(
        '--output', metavar='FILE',
        help='output table: .csv or .parquet (default: STORE/NAME.csv), updated '
             'while runs finish')
    parser.add_argument('--picture', metavar='FILE', help='plot the result: .png or .svg')
    parser.add_argument(
        '--columns', nargs='+', default=[], metavar='COLUMN',
        help='columns to print and to plot (default: the first ones); a varied parameter among '
             'them is the abscissa')
    parser.add_argument(
        '--list', action='store_true',
        help='list planned and finished runs without running them')
    parser.add_argument('--json', action='store_true', help='print the table as JSON')


def main(arguments: argparse.Namespace) -> int:
    """Run what the store lacks; return 1 if a run has failed."""
    from icofabric_sim.sweeps.sweep import make_executor
    with bad_input():
        executor = make_executor(arguments.workers, arguments.scheduler)
    require_place('--store', Path(arguments.store).expanduser(), is_folder=True)
    name, study = _study(arguments)
    output, picture = _places(arguments, name)
    if arguments.list:
        return _list(name, study)
    say(f'{name}: {_counted(len(study.requests), "run")} of {", ".join(study.work.verbs)}, '
        f'{_counted(study.kernel_variant_count, "kernel variant")}; the first run of each '
        'compiles its kernels unless they are on disk, and the others wait for it')
    began = time.monotonic()
    outcomes: list[Outcome] = []
    try:
        _gather(arguments, study, executor, outcomes, output)
    except KeyboardInterrupt:
        say(f'{_NAME}: {_save_finished(study, output)}')
        raise
    _report(arguments, name, study, outcomes, output, time.monotonic() - began)
    if picture is not None:
        from icofabric_sim.pictures.sweep_picture import draw_sweep
        try:
            draw_sweep(picture, name, study.table(outcomes), arguments.columns)
        except ValueError as error:
            raise CommandFailed(f'--picture {picture}: {error}') from error
        say(f'drawn to {picture}')
    return int(any(outcome.reason for outcome in outcomes))


def _study(arguments: argparse.Namespace) -> tuple[str, 'Study']:
    """Return name and plan, from a sweep file or a scene, with the options."""
    from icofabric_sim.parameters.file import parse_parameter_override
    from icofabric_sim.parameters.validation import make_parameters
    from icofabric_sim.sweeps.study_file import is_sweep_file, read_sweep_file
    from icofabric_sim.sweeps.sweep import Study

    path = Path(arguments.scene).expanduser()
    vary: Any = {}
    cases = sample = keep = None
    verbs: Any = ['run']
    with bad_input():
        if arguments.scene not in example_scenes() and is_sweep_file(path):
            file = read_sweep_file(path)
            name = path.stem
            given = dict(file.parameters)
            vary, cases, sample = file.vary or {}, file.cases, file.sample
            verbs, keep = file.verbs, file.keep
            for rule in arguments.parameter:
                parameter, value = parse_parameter_override(rule)
                given[parameter] = value
            parameters = make_parameters(given)
        else:
            name, parameters = read_parameters(arguments)
        if arguments.duration is not None:
            parameters = parameters.with_changes({'duration': arguments.duration})
        if not isinstance(vary, dict):
            raise ValueError(f'vary must be a dictionary of parameters and values, got {vary!r}')
        try:
            with _planning() as on_validated:
                study = Study.from_parameters(
                    parameters, {**vary, **dict(map(_varied, arguments.vary))}, cases=cases,
                    sample=sample if arguments.sample is None else _sample(arguments.sample),
                    verbs=arguments.verbs or verbs, keep=arguments.keep or keep,
                    store=arguments.store, on_validated=on_validated)
        except TypeError as error:
            # A sweep file may give a number in place of a list.
            raise InputError(str(error)) from error
    return name, study


@contextmanager
def _planning() -> Iterator[Callable[[int, int], None]]:
    """Show the number of validated runs; the total is known with the first one."""
    with ExitStack() as stack:
        shown: list[Progress] = []

        def show(done: int, total: int) -> None:
            if not shown:
                shown.append(stack.enter_context(Progress(total, 'runs validated')))
            shown[0].update(done)

        yield show


def _varied(rule: str) -> tuple[str, Any]:
    """Return name and values of `--vary NAME:=VALUES`."""
    import yaml
    name, found, text = rule.partition(':=')
    if not found or not name or not text:
        raise InputError(f'--vary {rule}: write NAME:=VALUES, such as connector.stiffness:=[1e3]')
    if not text.startswith(('[', '{')):
        return name, text
    from icofabric_sim.sweeps.study_file import parse_yaml
    try:
        return name, parse_yaml(text)
    except yaml.YAMLError as error:
        raise InputError(f'--vary {rule}: {" ".join(str(error).split())}') from error


def _sample(text: str) -> dict[str, Any]:
    words = text.split(':')
    if len(words) not in (2, 3) or not all(word.isdecimal() for word in words[1:]):
        raise InputError(
            f'--sample {text}: write METHOD:COUNT or METHOD:COUNT:SEED, such as sobol:64')
    return {'method': words[0], 'count': int(words[1]),
            'seed': int(words[2]) if len(words) == 3 else 0}


def _places(arguments: argparse.Namespace, name: str) -> tuple[Path, Path | None]:
    """Return the paths of the table and the picture."""
    from icofabric_sim.sweeps.table import require_suffix
    output = Path(arguments.store).expanduser() / f'{name}.csv'
    if arguments.output is not None:
        output = require_place('--output', Path(arguments.output).expanduser())
        with bad_input():
            require_suffix(output)
    if arguments.picture is None:
        return output, None
    return output, figure_path('--picture', arguments.picture)


def _list(name: str, study: 'Study') -> int:
    done = study.finished()
    failed = sum(bool(outcome.reason) for outcome in done.values())
    print(f'{name}: {_counted(len(study.requests), "run")} of {", ".join(study.work.verbs)}; '
          f'kept: {", ".join(map(str, study.work.keep))}')
    print(f'{len(done):,} finished in {study.store.path}, of which {failed:,} failed')
    for request in study.requests[:_PRINTED_ROWS]:
        state = done[request.number].state.value if request.number in done else 'planned'
        print(f'  {state:6}  {request.key}  {study.plan.describe(request.number)}')
    if len(study.requests) > _PRINTED_ROWS:
        print(f'  ... and {len(study.requests) - _PRINTED_ROWS:,} more')
    return 0


def _gather(
    arguments: argparse.Namespace, study: 'Study', executor: 'Executor',
    outcomes: list['Outcome'], output: Path
) -> None:
    """Collect outcomes as they finish, and update the table on disk."""
    from icofabric_sim.sweeps.dask_runs import SchedulerLost
    from icofabric_sim.sweeps.single_run import State, WorkersDiffer
    total = len(study.requests)
    written, pause = time.monotonic(), _WRITE_AFTER
    with Progress(total, 'runs') as progress, notes(progress, _NAME):
        try:
            with bad_input():
                for outcome in study.outcomes(executor, retry=arguments.retry):
                    if outcome.state is State.DONE and not any(
                            one.state is State.DONE for one in outcomes):
                        _require_columns(arguments, study, outcome)
                    outcomes.append(outcome)
                    if outcome.state is not State.DONE and not outcome.reused:
                        progress.note(
                            f'{study.plan.describe(outcome.number)}: {outcome.state.value}: '
                            f'{outcome.reason}')
                    if (began := time.monotonic()) - written >= pause:
                        _save(study, outcomes, output)
                        written = time.monotonic()
                        pause = max(_WRITE_AFTER, _WRITE_TIMES * (written - began))
                    progress.update(len(outcomes))
        except WorkersDiffer as error:
            kept = f'; {_save_finished(study, output)}' if outcomes else ''
            raise InputError(f'{error}{kept}') from error
        except SchedulerLost as error:
            raise CommandFailed(f'{error}; {_save_finished(study, output)}') from error
    _save(study, outcomes, output)


def _require_columns(
    arguments: argparse.Namespace, study: 'Study', outcome: 'Outcome'
) -> None:
    """Reject columns that no run fills; the first run defines the columns."""
    known = [*study.plan.names, *(column.name for column in outcome.columns)]
    for name in arguments.columns:
        if name not in known:
            raise InputError(
                f'--columns {name}: unknown column; choose from: {", ".join(known)}')


def _save(study: 'Study', outcomes: Sequence['Outcome'], output: Path) -> None:
    study.table(outcomes).save(output)


def _save_finished(study: 'Study', output: Path) -> str:
    """
    Write all finished runs of the store, also those not collected; return their number as text.
    """
    found = study.finished()
    _save(study, list(found.values()), output)
    return (f'{len(found):,} of {_counted(len(study.requests), "run")} are finished and kept in '
            f'{study.store.path}; the same command continues')


def _report(
    arguments: argparse.Namespace, name: str, study: 'Study', outcomes: Sequence['Outcome'],
    output: Path, wall: float
) -> None:
    table = study.table(outcomes)
    reused = sum(outcome.reused for outcome in outcomes)
    failed = len(table.failed)
    if arguments.json:
        print_json({'study': name, 'table': table.table(), 'failed': failed, 'reused': reused,
                    'store': os.fspath(study.store.path)})
    else:
        print('\n'.join(table.lines(_PRINTED_ROWS, arguments.columns)))
        print(f'{_counted(len(table), "run")}, {reused:,} from the store, {failed:,} '
              f'failed, in {duration_text(wall)}; table: {output}')


def _counted(count: int, word: str) -> str:
    return f'{count:,} {word}' if count == 1 else f'{count:,} {word}s'
