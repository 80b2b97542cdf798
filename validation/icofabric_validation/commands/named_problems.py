# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric stress --named`: problems with known answers."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from icofabric_sim.commands.report import print_json_line
from icofabric_sim.terminal import InputError, Progress, require_place

if TYPE_CHECKING:
    from icofabric_validation.named.problem import Answer

# Options of `icofabric stress` that only apply to random scenes.
RANDOM_SCENE_OPTIONS = ('scenes', 'seed', 'kinds', 'shrink', 'coverage', 'processes')


def add_named_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument(
        '--named', action='store_true',
        help='problems with known answers instead of random scenes: errors and orders')
    parser.add_argument(
        '--problem', metavar='N,N,...',
        help='with --named: these problems by number (default: all; --named --list names them)')
    parser.add_argument(
        '--long', action='store_true',
        help='with --named: full durations of the sources, which take many minutes')


def is_given(arguments: argparse.Namespace, name: str) -> bool:
    """Return True if an option or switch is on the command line; 0 is a value."""
    value = getattr(arguments, name)
    return value is not None and value is not False


def main_named(arguments: argparse.Namespace) -> int:
    """Solve the problems; return 1 if an answer differs from the known one."""
    from icofabric_validation.named import report
    from icofabric_validation.named.catalogue import PROBLEMS, solve_all
    for name in RANDOM_SCENE_OPTIONS:
        if is_given(arguments, name):
            raise InputError(f'--{name} applies to random scenes and cannot be combined with '
                             '--named')
    numbers = _numbers(arguments.problem, len(PROBLEMS))
    if arguments.list:
        print('\n'.join(report.catalogue_lines(PROBLEMS)))
        return 0
    if arguments.output is not None:
        table = require_place('--output', Path(arguments.output).expanduser())
        table.parent.mkdir(parents=True, exist_ok=True)
    if not arguments.json:
        print('\n'.join(report.head_lines()), flush=True)
    answers: list[Answer] = []
    with Progress(len(numbers), 'problems', foreseen=False) as progress:
        for answer in solve_all(numbers, long=arguments.long):
            answers.append(answer)
            progress.clear()
            if arguments.json:
                print_json_line(report.as_dictionary(answer))
            else:
                print('\n'.join(report.answer_lines(answer)), flush=True)
            if arguments.output is not None:
                report.write_table(table, answers)
            progress.update(len(answers))
    if not arguments.json:
        print(report.summary_line(answers))
    return int(any(answer.faults for answer in answers))


def _numbers(text: str | None, count: int) -> list[int]:
    """Parse numbers of problems from a text such as 1,4."""
    if text is None:
        return [*range(1, count + 1)]
    found = []
    for part in text.split(','):
        if not (part.strip().isdecimal() and 1 <= int(part) <= count):
            raise InputError(f'--problem {text}: {part!r} must be a number from 1 to {count}; '
                             '--named --list names them')
        found.append(int(part))
    return found
