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
"""What verbs report: two columns for people, or JSON for programs."""

import argparse
from collections.abc import Iterable
import json

Row = tuple[str, str]


def add_json_argument(parser: argparse.ArgumentParser) -> None:
    """Declare --json."""
    parser.add_argument(
        '--json', action='store_true',
        help='report as JSON: names with a text, or a list of texts')


def print_report(rows: Iterable[Row], *, as_json: bool, lines: Iterable[str] = ()) -> None:
    """Print rows of a label and a text, and further lines."""
    from icofabric_sim.scene.summary import as_lines
    table = list(rows)
    if not as_json:
        print('\n'.join([*as_lines(table), *lines]), flush=True)
        return
    report: dict[str, str | list[str]] = {}
    label = ''
    for name, text in table:
        label = name or label
        before = report.get(label)
        report[label] = text if before is None else (
            [*before, text] if isinstance(before, list) else [before, text])
    said = list(lines)
    if said:
        report['result'] = said if len(said) > 1 else said[0]
    print(json.dumps(report, indent=2, ensure_ascii=False), flush=True)
