# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Reports of the verbs: two columns for people, or JSON for programs."""

import argparse
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, ExitStack, redirect_stdout
import csv
import json
import math
from pathlib import Path
import sys
from typing import Any, NamedTuple

from icofabric_sim.terminal import Progress

Row = tuple[str, str]


def add_json_argument(parser: argparse.ArgumentParser) -> None:
    """Declare --json."""
    parser.add_argument(
        '--json', action='store_true',
        help='print the report as JSON: an object of strings or lists of strings')


def add_json_numbers_argument(parser: argparse.ArgumentParser) -> None:
    """Declare --json for a verb that reports numbers."""
    parser.add_argument(
        '--json', action='store_true',
        help='print JSON with full precision in SI units; other messages go to the '
             'error stream')


@contextmanager
def text_to_stderr(as_json: bool) -> Iterator[None]:
    """Redirect printed text to the error stream if the report is JSON."""
    if not as_json:
        yield
        return
    with redirect_stdout(sys.stderr):
        yield


def print_json(report: Mapping[str, Any]) -> None:
    """
    Print numbers, strings, arrays and nested data as JSON; NaN and infinity become null.
    """
    print(json.dumps(_plain(report), indent=1, ensure_ascii=False), flush=True)


def print_json_line(report: Mapping[str, Any]) -> None:
    """Print a report as JSON on one line."""
    print(json.dumps(_plain(report), ensure_ascii=False), flush=True)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(name): _plain(inner) for name, inner in value.items()}
    if hasattr(value, 'tolist'):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def print_report(rows: Iterable[Row], *, as_json: bool, lines: Iterable[str] = ()) -> None:
    """Print rows of label and text, and further lines."""
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


def write_csv(path: Path, head: Iterable[str], rows: Iterable[Iterable[object]]) -> Path:
    """Write a CSV file in a folder that is created if missing; return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open('w', newline='', encoding='utf-8') as file:
        csv.writer(file).writerows([head, *rows])
    return path


@contextmanager
def rows_as_they_come(
    head: Iterable[str], line: Callable[[Any], str], *, table: Path | None, as_json: bool,
    total: int
) -> Iterator[Callable[[NamedTuple, int], None]]:
    """
    Yield a function that takes a row and the number of finished runs of `total`.

    The function prints the row, as a `line` or as JSON, and adds it to the CSV file `table` below
    the `head`. Rows are written at once, because an interrupt may end work of hours.
    """
    with ExitStack() as stack:
        file = None
        if table is not None:
            table.parent.mkdir(parents=True, exist_ok=True)
            file = stack.enter_context(table.open('w', newline='', encoding='utf-8'))
            writer = csv.writer(file)
            writer.writerow(head)
            file.flush()
        progress = stack.enter_context(Progress(total, 'runs'))

        def take(row: NamedTuple, done: int) -> None:
            if file is not None:
                writer.writerow(row)
                file.flush()
            progress.clear()
            if as_json:
                print_json_line(row._asdict())
            else:
                print(line(row), flush=True)
            progress.update(done)

        yield take
