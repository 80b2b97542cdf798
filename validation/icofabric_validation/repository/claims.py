# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Runs commands that stand beside figures and promises of the pages, and compares what they print.

    .venv/bin/python -m icofabric_validation.repository.claims
    .venv/bin/python -m icofabric_validation.repository.claims --only law_table shear_stiffness
    .venv/bin/python -m icofabric_validation.repository.claims \
        --pages docs/statics.md docs/replay.md

docs/claims.yaml says which figures: deterministic ones have to agree in every digit that the page
prints, ratios of times within a factor. Of the pages (README.md and docs/tour.md) every command
`.venv/bin/icofabric` is run, in the order of the page, in a folder of its own, and has to end with
0; not those of verbs that serve, or go on for long. One that takes more than `--seconds` is ended,
and counts as not seen.
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
SAME, DIFFERS, UNSEEN = 'the same', 'DIFFERS', 'not seen'
# Verbs that go on until they are ended, or for long.
UNENDING = ('view', 'stress', 'benchmark', 'warm', 'sweep')
# Folders of the tree that commands read from.
READ = ('examples', 'config')


class Row(NamedTuple):
    """What was compared."""

    claim: str
    page: str
    said: str
    seen: str
    verdict: str


def numbers(text: str) -> list[Decimal]:
    """Return the numbers of a text, without the commas between thousands."""
    return [Decimal(number.rstrip(',').replace(',', '')) for number in NUMBER.findall(text)]


def agrees(said: str, seen: str) -> bool:
    """Whether two words are the same, or two numbers in the digits that `said` has."""
    if said == seen:
        return True
    try:
        one, other = Decimal(said.replace(',', '')), Decimal(seen.replace(',', ''))
    except ArithmeticError:
        return False
    return abs(one - other) <= Decimal(5).scaleb(int(one.as_tuple().exponent) - 1)


def is_within(said: str, seen: Sequence[str], factor: float) -> bool:
    """Whether all of `seen` are in the range of the numbers of `said`, to a factor either way."""
    low, high = float(min(numbers(said))), float(max(numbers(said)))
    return bool(seen) and all(
        low / factor <= float(number) <= factor * high
        for text in seen for number in numbers(text))


def said_by(claim: dict[str, Any], figures: dict[str, dict[str, Any]]) -> list[str]:
    """Return what the page says, or docs/figures.yaml; ValueError where it does not."""
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


def seen_in(claim: dict[str, Any], output: str) -> list[str]:
    """Return what the output of its command shows, in the unit of the page."""
    seen = groups(claim['seen'], output)
    if 'scale' in claim:
        seen = [str(Decimal(number) * claim['scale']) for number in seen]
    return seen


def verdict(claim: dict[str, Any], said: Sequence[str], seen: Sequence[str]) -> str:
    """Say whether what was seen is what the page says."""
    if 'factor' in claim:
        right = is_within(' '.join(said), seen, float(claim['factor']))
        return f'within {claim["factor"]} times' if right else DIFFERS
    if 'figure' in claim:
        said = [str(number) for number in numbers(' '.join(said))]
    right = len(said) == len(seen) and all(map(agrees, said, seen))
    return SAME if right else DIFFERS


class Runs:
    """Commands in a folder of their own, each once."""

    def __init__(self, folder: Path, seconds: float) -> None:
        """End each after so many `seconds`."""
        self._folder, self._seconds = folder, seconds
        self._outputs: dict[str, tuple[int | None, str]] = {}
        for name in READ:
            (folder / name).symlink_to(ROOT / name)
        for name in ('runs', 'docs/gallery'):
            (folder / name).mkdir(parents=True)

    def output(self, command: str) -> tuple[int | None, str]:
        """Return the exit status, None where it took too long, and what it printed."""
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
                # With the processes that it started.
                os.killpg(process.pid, signal.SIGKILL)
                process.communicate()
                status, text = None, f'took more than {self._seconds:g} s'
            self._outputs[command] = status, text
            print(f'{time.monotonic() - began:6.1f} s  {command}', file=sys.stderr, flush=True)
        return self._outputs[command]


def judged(
    name: str, claim: dict[str, Any], figures: dict[str, dict[str, Any]], runs: Runs
) -> Row:
    """Compare one claim."""
    said = said_by(claim, figures)
    command = claim.get('command') or figures[claim['figure']]['command']
    if 'before' in claim:
        runs.output(claim['before'])
    status, output = runs.output(command)
    page = claim.get('page', 'docs/figures.yaml')
    if status is None:
        return Row(name, page, ', '.join(said), output, UNSEEN)
    seen = seen_in(claim, output)
    if status != claim.get('ends_with', 0):
        return Row(name, page, ', '.join(said), f'exit status {status}', DIFFERS)
    return Row(name, page, ', '.join(said), ', '.join(seen), verdict(claim, said, seen))


def commands_of(text: str) -> Iterator[str]:
    """Return the commands of a page that stand in lines of their own, in its order."""
    for line in re.findall(
            r'^(?: {4}|\t)? *(\.venv/bin/icofabric .*)$', text, re.MULTILINE):
        command = re.sub(r'\s+#\s.*$', '', line).strip()
        if command.split()[1] not in UNENDING and '[-' not in command:
            yield command


def tried(page: str, runs: Runs) -> Iterator[Row]:
    """Run the commands of a page."""
    for command in commands_of((ROOT / page).read_text(encoding='utf-8')):
        status, text = runs.output(command)
        words = ' '.join(command.split()[1:])
        if status is None:
            yield Row(words, page, 'ends with 0', text, UNSEEN)
        else:
            last = text.strip().splitlines()[-1:] if status else []
            yield Row(words, page, 'ends with 0', ' '.join([str(status), *last]),
                      DIFFERS if status else SAME)


def table(rows: Sequence[Row]) -> str:
    """Return the rows below each other; long words are cut."""
    shown = [Row('claim', 'page', 'said', 'seen', 'verdict'), *rows]
    cut = [[word if len(word) <= 60 else word[:57] + '...' for word in row] for row in shown]
    widths = [max(len(row[k]) for row in cut) for k in range(len(Row._fields))]
    return '\n'.join('  '.join(
        word.ljust(width) for word, width in zip(row, widths)).rstrip() for row in cut)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--only', nargs='+', default=None, help='names of claims; no pages then')
    parser.add_argument('--pages', nargs='*', default=['README.md', 'docs/tour.md'])
    parser.add_argument('--seconds', type=float, default=100.0, help='for a command at most')
    options = parser.parse_args()
    claims, figures = (
        yaml.safe_load((ROOT / 'docs' / f'{name}.yaml').read_text(encoding='utf-8'))[name]
        for name in ('claims', 'figures'))
    if unknown := {*(options.only or ())} - {*claims}:
        parser.error(f'docs/claims.yaml has no {", ".join(sorted(unknown))}')
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(Path(folder), options.seconds)
        rows = [judged(name, claims[name], figures, runs) for name in options.only or claims]
        if not options.only:
            rows += [row for page in options.pages for row in tried(page, runs)]
    print(table(rows))
    differing = sum(row.verdict == DIFFERS for row in rows)
    unseen = sum(row.verdict == UNSEEN for row in rows)
    print(f'\n{len(rows)} compared or run: {differing} differ, {unseen} took too long')
    return 1 if differing else 0


if __name__ == '__main__':
    sys.exit(main())
