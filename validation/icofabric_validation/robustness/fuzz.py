# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Feeds damaged, foreign and random input to every reader of the package, and judges what comes back.

    .venv/bin/python -m icofabric_validation.robustness.fuzz [--kind all] [--seed 0] [--cases 0] \
        [--seconds 1e9]
        [--scale 1] [--csv FILE]

Kinds are in fuzz_kinds.py; each case follows from the kind and its seed alone, so that
`--kind bags --seed 17 --cases 1` repeats the case of seed 17. Without `--cases` each kind has its
own number of them, times `--scale`; `--seconds` ends a kind that takes longer. A case is refused,
by an error of the package that names what is wrong, or taken, with a right result. A fault is
another error, a case of more than 10 s, a result that is silently another one, or memory that
grows by more than 64 MB after the first tenth of the cases. Exit status 1 where there is a fault.
"""

import argparse
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
import csv
import logging
import os
from pathlib import Path
import random
import signal
import sys
import tempfile
import time
from types import FrameType
from typing import NamedTuple
import warnings

from icofabric_validation.benchmarks.machine import describe_machine
from icofabric_validation.robustness.fuzz_kinds import Fault, KINDS, REFUSED

LONGEST_CASE = 10.0  # [s]
GROWTH = 64.0  # [MB]
# Of faults so many are shown in full for each kind.
_SHOWN = 5
_MB = 2**20


class Hang(BaseException):
    """A case took too long: no handler of errors may take it for one of its own."""


class Row(NamedTuple):
    """What became of the cases of one kind."""

    kind: str
    seed: int
    cases: int
    refused: int
    taken: int
    faults: int
    seconds: float
    longest: float  # case [s]
    growth: float  # of the memory after the first tenth [MB]


def resident() -> float:
    """Memory of this process [MB]."""
    pages = int(Path('/proc/self/statm').read_text(encoding='utf-8').split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / _MB


@contextmanager
def limited() -> Iterator[None]:
    """Break off what takes too long."""
    signal.setitimer(signal.ITIMER_REAL, LONGEST_CASE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def _hangs(number: int, frame: FrameType | None) -> None:
    raise Hang


def fuzz(kind: str, seed: int, cases: int, seconds: float) -> Row:
    """Do the cases of one kind, and print what is wrong."""
    signal.signal(signal.SIGALRM, _hangs)
    found: Counter[str] = Counter()
    done, longest, early = 0, 0.0, 0.0
    with tempfile.TemporaryDirectory(prefix='icofabric_fuzz_') as folder:
        with KINDS[kind].subject(Path(folder)) as subject:
            begun = time.monotonic()
            for number in range(seed, seed + cases):
                before = time.monotonic()
                if before - begun > seconds:
                    break
                try:
                    with limited():
                        found[subject.do(random.Random(number))] += 1
                except Hang:
                    _say(kind, number, f'it took more than {LONGEST_CASE:g} s', found)
                except (Fault, Exception) as error:  # noqa: BLE001 - that is what is looked for
                    _say(kind, number, f'{type(error).__name__}: {error}', found)
                longest = max(longest, time.monotonic() - before)
                done += 1
                if done == max(1, cases // 10):
                    early = resident()
            took, growth = time.monotonic() - begun, resident() - early if early else 0.0
            problem = subject.end()
    if problem:
        _say(kind, seed, problem, found)
    # The bookkeeping of a few cases is no growth.
    if growth > GROWTH and done > cases // 10:
        _say(kind, seed, f'the memory grew by {growth:.0f} MB', found)
    refused = found[REFUSED]
    return Row(kind, seed, done, refused, done - refused - found['fault'], found['fault'],
               took, longest, growth)


def _say(kind: str, seed: int, text: str, found: Counter[str]) -> None:
    found['fault'] += 1
    if found['fault'] <= _SHOWN:
        print(f'FAULT: --kind {kind} --seed {seed} --cases 1: {text[:1000]}', flush=True)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n\n')[0].strip())
    parser.add_argument('--kind', choices=['all', *KINDS], default='all')
    parser.add_argument('--seed', type=int, default=0, help='of the first case')
    parser.add_argument('--cases', type=int, default=0, help='default: those of each kind')
    parser.add_argument('--scale', type=float, default=1.0, help='times as many cases')
    parser.add_argument('--seconds', type=float, default=1e9, help='that a kind takes at most')
    parser.add_argument('--csv', type=Path, help='write the table there')
    arguments = parser.parse_args(argv)
    # Warnings of dropped messages are what is asked for.
    logging.getLogger('icofabric_sim').setLevel(logging.CRITICAL)
    # A warning of numpy is a value that nobody has looked at.
    warnings.simplefilter('error')
    # What is too large is infinite, and refused for that later.
    warnings.filterwarnings('ignore', 'overflow encountered', RuntimeWarning)
    # rosbags leaves files of a damaged bag to the garbage collector.
    warnings.simplefilter('ignore', ResourceWarning)
    kinds = list(KINDS) if arguments.kind == 'all' else [arguments.kind]
    rows = []
    print(describe_machine())
    for kind in kinds:
        cases = arguments.cases or max(1, round(KINDS[kind].cases * arguments.scale))
        rows.append(fuzz(kind, arguments.seed, cases, arguments.seconds))
        row = rows[-1]
        print(f'{row.kind:12} {row.cases:9,} cases: {row.refused:9,} refused, {row.taken:9,} '
              f'taken, {row.faults:3} faults; {row.seconds:6.1f} s, longest {row.longest:5.2f} s, '
              f'memory {row.growth:+5.1f} MB', flush=True)
    total = sum(row.cases for row in rows)
    print(f'{"all":12} {total:9,} cases: {sum(row.faults for row in rows)} faults')
    if arguments.csv:
        with arguments.csv.open('w', newline='', encoding='utf-8') as file:
            table = csv.writer(file)
            table.writerow(Row._fields)
            table.writerows(rows)
    return 1 if any(row.faults for row in rows) else 0


if __name__ == '__main__':
    sys.exit(main())
