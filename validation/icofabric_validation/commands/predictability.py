# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric stress --predictability`: growth of initial displacements, from round-off up."""

import argparse
from pathlib import Path

from icofabric_sim.commands.report import rows_as_they_come
from icofabric_sim.terminal import InputError, require_place
from icofabric_validation.commands.named_problems import is_given, RANDOM_SCENE_OPTIONS


def add_predictability_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument(
        '--predictability', action='store_true',
        help='instead of random scenes: growth of initial displacements, from a unit of '
        'round-off up, and the errors added by round-off')


def main_predictability(arguments: argparse.Namespace) -> int:
    """Run all scenes; return 1 if small displacements grow at another rate than larger ones."""
    from icofabric_validation.predictability import (
        CASES,
        HEAD,
        measure_predictability,
        Row,
        row_line,
    )
    for name in (
            *RANDOM_SCENE_OPTIONS, 'named', 'problem', 'long', 'list', 'map', 'steps', 'picture'):
        if is_given(arguments, name):
            raise InputError(f'--{name} cannot be combined with --predictability')
    table = None
    if arguments.output is not None:
        table = require_place('--output', Path(arguments.output).expanduser())
    if not arguments.json:
        print(HEAD, flush=True)
    runs: list[tuple[str, str]] = []
    faults = set()
    with rows_as_they_come(
            Row._fields, row_line, table=table, as_json=arguments.json,
            total=sum(len(case.methods) for case in CASES.values())) as take:
        for row in measure_predictability():
            if (row.scene, row.method) not in runs:
                runs.append((row.scene, row.method))
            if row.fault:
                faults.add((row.scene, row.method))
            take(row, len(runs))
    if not arguments.json:
        print(f'{len(runs)} runs, {len(faults)} with growth that the motion does not explain')
    return int(bool(faults))
