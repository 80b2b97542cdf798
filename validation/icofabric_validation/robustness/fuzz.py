# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Feed damaged, foreign and random input to every reader of the package, and judge the results.

    .venv/bin/python -m icofabric_validation.robustness.fuzz [--kind all] [--seed 0] [--cases 0] \
        [--seconds 1e9]
        [--scale 1] [--csv FILE]

Kinds are in fuzz_kinds.py. Kind and seed determine each case, so that `--kind bags --seed 17
--cases 1` repeats the case of seed 17. Without `--cases` each kind has a default number of cases,
times `--scale`. `--seconds` stops a kind that takes longer. A case is refused, by an error of the
package that names the cause, or accepted with the right result. A fault is another error, a case
of more than 10 s, a silently wrong result, or a memory growth of more than 64 MB after the first
tenth of the cases. The exit status is 1 if there is a fault.
"""

import argparse
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
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

from icofabric_sim.commands.report import write_csv
from icofabric_validation.benchmarks.machine import describe_machine
from icofabric_validation.robustness.fuzz_kinds import Fault, KINDS, REFUSED

MAX_CASE_TIME_S = 10.0
MAX_MEMORY_GROWTH_MB = 64.0
# Number of faults of each kind that are printed.
_MAX_PRINTED_FAULTS = 5
_MB = 2**20


class Hang(BaseException):
    """Time limit of a case; a BaseException, so that handlers of errors do not catch it."""


class Row(NamedTuple):
    """The results of the cases of one kind."""

    kind: str
    seed: int
    cases: int
    refused: int
    accepted: int
    faults: int
    seconds: float
    longest: float  # time of the slowest case [s]
    growth: float  # of memory after the first tenth of the cases [MB]


def resident_memory() -> float:
    """Return the resident_memory memory of this process [MB]."""
    pages = int(Path('/proc/self/statm').read_text(encoding='utf-8').split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / _MB


@contextmanager
def time_limit() -> Iterator[None]:
    """Raise Hang in a block that exceeds the time limit."""
    signal.setitimer(signal.ITIMER_REAL, MAX_CASE_TIME_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def _raise_hang(number: int, frame: FrameType | None) -> None:
    raise Hang


def fuzz(kind: str, seed: int, cases: int, seconds: float) -> Row:
    """Run the cases of one kind, and print faults."""
    signal.signal(signal.SIGALRM, _raise_hang)
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
                    with time_limit():
                        found[subject.run_case(random.Random(number))] += 1
                except Hang:
                    _add_fault(kind, number, f'it took more than {MAX_CASE_TIME_S:g} s', found)
                except (Fault, Exception) as error:  # noqa: BLE001 - any exception is a fault
                    _add_fault(kind, number, f'{type(error).__name__}: {error}', found)
                longest = max(longest, time.monotonic() - before)
                done += 1
                if done == max(1, cases // 10):
                    early = resident_memory()
            took, growth = time.monotonic() - begun, resident_memory() - early if early else 0.0
            problem = subject.end()
    if problem:
        _add_fault(kind, seed, problem, found)
    # A few cases are too few to measure growth.
    if growth > MAX_MEMORY_GROWTH_MB and done > cases // 10:
        _add_fault(kind, seed, f'the memory grew by {growth:.0f} MB', found)
    refused = found[REFUSED]
    return Row(kind, seed, done, refused, done - refused - found['fault'], found['fault'],
               took, longest, growth)


def _add_fault(kind: str, seed: int, text: str, found: Counter[str]) -> None:
    found['fault'] += 1
    if found['fault'] <= _MAX_PRINTED_FAULTS:
        print(f'FAULT: --kind {kind} --seed {seed} --cases 1: {text[:1000]}', flush=True)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n\n')[0].strip())
    parser.add_argument('--kind', choices=['all', *KINDS], default='all')
    parser.add_argument('--seed', type=int, default=0, help='seed of the first case')
    parser.add_argument('--cases', type=int, default=0, help='default: those of each kind')
    parser.add_argument('--scale', type=float, default=1.0, help='factor of the number of cases')
    parser.add_argument('--seconds', type=float, default=1e9, help='time limit of a kind')
    parser.add_argument('--csv', type=Path, help='write the table to this file')
    arguments = parser.parse_args(argv)
    # Dropped messages cause expected warnings.
    logging.getLogger('icofabric_sim').setLevel(logging.CRITICAL)
    # A warning of numpy is a value that was not validated.
    warnings.simplefilter('error')
    # Values that are too large become infinite and are refused later.
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
        print(f'{row.kind:12} {row.cases:9,} cases: {row.refused:9,} refused, {row.accepted:9,} '
              f'accepted, {row.faults:3} faults; {row.seconds:6.1f} s, longest '
              f'{row.longest:5.2f} s, memory {row.growth:+5.1f} MB', flush=True)
    total = sum(row.cases for row in rows)
    print(f'{"all":12} {total:9,} cases: {sum(row.faults for row in rows)} faults')
    if arguments.csv:
        write_csv(arguments.csv, Row._fields, rows)
    return 1 if any(row.faults for row in rows) else 0


if __name__ == '__main__':
    sys.exit(main())
