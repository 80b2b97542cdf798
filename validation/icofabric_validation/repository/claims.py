# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Run the commands of figures on pages, and compare their output with the pages.

    .venv/bin/python -m icofabric_validation.repository.claims
    .venv/bin/python -m icofabric_validation.repository.claims --only law_table shear_stiffness
    .venv/bin/python -m icofabric_validation.repository.claims \
        --pages docs/statics.md docs/replay.md

docs/claims.yaml lists the figures. Deterministic figures must agree in all digits of the page, and
ratios of times within a factor. Every command `.venv/bin/icofabric` of the pages (README.md and
docs/tour.md) runs in the order of the page, in a temporary folder, and must return 0. Verbs that
serve or take long are left out. A command that takes more than `--seconds` is stopped and counts
as not seen.
"""

import argparse
from collections.abc import Iterator, Sequence
from decimal import Decimal
import os
from pathlib import Path
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any, NamedTuple

from icofabric_validation.source_tree import ROOT
import yaml

NUMBER = re.compile(r'\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?')
EQUAL, DIFFERENT, NOT_SEEN = 'equal', 'DIFFERENT', 'not seen'
# Verbs that serve until they are stopped, or take long.
LONG_VERBS = ('view', 'stress', 'benchmark', 'warm', 'sweep')
# Folders of the tree that commands read.
READ_FOLDERS = ('examples', 'config')


class Row(NamedTuple):
    """One comparison."""

    claim: str
    page: str
    said: str
    seen: str
    verdict: str


def numbers(text: str) -> list[Decimal]:
    """Return the numbers of a text, without the commas between thousands."""
    return [Decimal(number.rstrip(',').replace(',', '')) for number in NUMBER.findall(text)]


def is_equal(said: str, seen: str) -> bool:
    """Return True if two words are equal, or two numbers in the digits of `said`."""
    if said == seen:
        return True
    try:
        one, other = Decimal(said.replace(',', '')), Decimal(seen.replace(',', ''))
    except ArithmeticError:
        return False
    return abs(one - other) <= Decimal(5).scaleb(int(one.as_tuple().exponent) - 1)


def is_within(said: str, seen: Sequence[str], factor: float) -> bool:
    """Return True if all of `seen` are in the range of `said`, extended by a factor."""
    low, high = float(min(numbers(said))), float(max(numbers(said)))
    return bool(seen) and all(
        low / factor <= float(number) <= factor * high
        for text in seen for number in numbers(text))


def values_on_page(claim: dict[str, Any], figures: dict[str, dict[str, Any]]) -> list[str]:
    """Return the values on the page or in docs/figures.yaml; raise ValueError without a match."""
    if 'figure' in claim:
        return [str(figures[claim['figure']]['value'])]
    said = groups(claim['said'], (ROOT / claim['page']).read_text(encoding='utf-8'))
    if not said:
        raise ValueError(f'{claim["page"]} does not say {claim["said"]!r}')
    return said


def groups(pattern: str, text: str) -> list[str]:
    """Return the groups of every match in a text, one after the other."""
    return [group for found in re.finditer(pattern, text, re.MULTILINE)
            for group in found.groups()]


def values_in_output(claim: dict[str, Any], output: str) -> list[str]:
    """Return the values in the output of the command, in the unit of the page."""
    seen = groups(claim['seen'], output)
    if 'scale' in claim:
        seen = [str(Decimal(number) * claim['scale']) for number in seen]
    return seen


def verdict(claim: dict[str, Any], said: Sequence[str], seen: Sequence[str]) -> str:
    """Return the result of the comparison of page and output."""
    if 'factor' in claim:
        right = is_within(' '.join(said), seen, float(claim['factor']))
        return f'within {claim["factor"]} times' if right else DIFFERENT
    if 'figure' in claim:
        said = [str(number) for number in numbers(' '.join(said))]
    right = len(said) == len(seen) and all(map(is_equal, said, seen))
    return EQUAL if right else DIFFERENT


class Runs:
    """Commands in a temporary folder, each of which runs once."""

    def __init__(self, folder: Path, seconds: float) -> None:
        """Prepare the folder; stop each command after `seconds` [s]."""
        self._folder, self._seconds = folder, seconds
        self._outputs: dict[str, tuple[int | None, str]] = {}
        for name in READ_FOLDERS:
            (folder / name).symlink_to(ROOT / name)
        for name in ('runs', 'docs/gallery'):
            (folder / name).mkdir(parents=True)

    def output(self, command: str) -> tuple[int | None, str]:
        """Return exit status and output; the status is None if the command took too long."""
        if command not in self._outputs:
            words = shlex.split(command, comments=True)
            words[0] = str(ROOT / words[0])
            began = time.monotonic()
            process = subprocess.Popen(
                words, cwd=self._folder, text=True, start_new_session=True,
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            status: int | None
            try:
                text, _ = process.communicate(timeout=self._seconds)
                status = process.returncode
            except subprocess.TimeoutExpired:
                # With the child processes of the command.
                os.killpg(process.pid, signal.SIGKILL)
                process.communicate()
                status, text = None, f'took more than {self._seconds:g} s'
            self._outputs[command] = status, text
            print(f'{time.monotonic() - began:6.1f} s  {command}', file=sys.stderr, flush=True)
        return self._outputs[command]


def compare_claim(
    name: str, claim: dict[str, Any], figures: dict[str, dict[str, Any]], runs: Runs
) -> Row:
    """Compare one claim."""
    said = values_on_page(claim, figures)
    command = claim.get('command') or figures[claim['figure']]['command']
    if 'before' in claim:
        runs.output(claim['before'])
    status, output = runs.output(command)
    page = claim.get('page', 'docs/figures.yaml')
    if status is None:
        return Row(name, page, ', '.join(said), output, NOT_SEEN)
    seen = values_in_output(claim, output)
    if status != claim.get('ends_with', 0):
        return Row(name, page, ', '.join(said), f'exit status {status}', DIFFERENT)
    return Row(name, page, ', '.join(said), ', '.join(seen), verdict(claim, said, seen))


def commands_of(text: str) -> Iterator[str]:
    """Yield the commands of a page that are on separate lines, in order."""
    for line in re.findall(
            r'^(?: {4}|\t)? *(\.venv/bin/icofabric .*)$', text, re.MULTILINE):
        command = re.sub(r'\s+#\s.*$', '', line).strip()
        if command.split()[1] not in LONG_VERBS and '[-' not in command:
            yield command


def run_page(page: str, runs: Runs) -> Iterator[Row]:
    """Run the commands of a page."""
    for command in commands_of((ROOT / page).read_text(encoding='utf-8')):
        status, text = runs.output(command)
        words = ' '.join(command.split()[1:])
        if status is None:
            yield Row(words, page, 'ends with 0', text, NOT_SEEN)
        else:
            last = text.strip().splitlines()[-1:] if status else []
            yield Row(words, page, 'ends with 0', ' '.join([str(status), *last]),
                      DIFFERENT if status else EQUAL)


def table(rows: Sequence[Row]) -> str:
    """Return the rows as a table; long words are shortened."""
    shown = [Row('claim', 'page', 'said', 'seen', 'verdict'), *rows]
    cut = [[word if len(word) <= 60 else word[:57] + '...' for word in row] for row in shown]
    widths = [max(len(row[k]) for row in cut) for k in range(len(Row._fields))]
    return '\n'.join('  '.join(
        word.ljust(width) for word, width in zip(row, widths)).rstrip() for row in cut)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--only', nargs='+', default=None, help='names of claims, without pages')
    parser.add_argument('--pages', nargs='*', default=['README.md', 'docs/tour.md'])
    parser.add_argument('--seconds', type=float, default=100.0, help='limit for a command')
    options = parser.parse_args()
    claims, figures = (
        yaml.safe_load((ROOT / 'docs' / f'{name}.yaml').read_text(encoding='utf-8'))[name]
        for name in ('claims', 'figures'))
    if unknown := {*(options.only or ())} - {*claims}:
        parser.error(f'docs/claims.yaml has no {", ".join(sorted(unknown))}')
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(Path(folder), options.seconds)
        rows = [compare_claim(name, claims[name], figures, runs)
                for name in options.only or claims]
        if not options.only:
            rows += [row for page in options.pages for row in run_page(page, runs)]
    print(table(rows))
    differing = sum(row.verdict == DIFFERENT for row in rows)
    unseen = sum(row.verdict == NOT_SEEN for row in rows)
    print(f'\n{len(rows)} compared or run: {differing} differ, {unseen} took too long')
    return 1 if differing else 0


if __name__ == '__main__':
    sys.exit(main())
