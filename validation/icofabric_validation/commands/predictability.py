# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""`icofabric stress --predictability`: how a change of the start grows, from rounding up."""

import argparse
from pathlib import Path

from icofabric_sim.commands.report import rows_as_they_come
from icofabric_sim.terminal import InputError, require_place
from icofabric_validation.commands.named_problems import is_given, OF_RANDOM_SCENES


def add_predictability_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        '--predictability', action='store_true',
        help='instead of random scenes: how displacements of the start grow, from a rounding '
        'unit up, and what rounding adds')


def main_predictability(arguments: argparse.Namespace) -> int:
    """Run all scenes; returns 1 where small displacements grow otherwise than larger ones."""
    from icofabric_validation.predictability import (
        CASES,
        HEAD,
        measure_predictability,
        Row,
        row_line,
    )
    for name in (*OF_RANDOM_SCENES, 'named', 'problem', 'long', 'list', 'map', 'steps', 'picture'):
        if is_given(arguments, name):
            raise InputError(f'--{name} does not go with --predictability; leave it out')
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
        print(f'{len(runs)} runs, {len(faults)} with growth that is not of the motion')
    return int(bool(faults))
