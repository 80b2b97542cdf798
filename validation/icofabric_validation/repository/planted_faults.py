# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Plant the faults of planted_faults.yaml, one at a time, and print the fraction that tests catch.

Each fault is planted in a copy of the tree. The tests of its file run, quickest first and without
those of `make test-long`, until one fails. This test must pass in a second copy without the fault.
The whole suite may run for faults that survive (`--whole-suite`). Results go into a table, and
faults in the table are not run again:

    .venv/bin/python -m icofabric_validation.repository.planted_faults --only bag/ ros/ \
        --results faults.csv

A fault in kernels recompiles all kernels, which takes minutes, so these faults are last.
"""

import argparse
import csv
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

from icofabric_validation.source_tree import ROOT
import yaml

TABLE = Path(__file__).with_suffix('.yaml')
PACKAGE = 'icofabric_sim'
# Time limit of a test, which a fault may cause to hang.
_TEST_TIMEOUT_S = 900
_WHOLE_SUITE = ('test', 'validation/test', '-m', 'not graph and not long')
# Options for the tests of a file: those of `make test`.
_USUAL = ('-m', 'not long')
_LEFT_OUT = ('.git', '.venv', '.*_cache', 'build', 'install', 'log', 'dist', 'runs')
_FAILED = re.compile(
    r'^(?:FAILED|ERROR) ((?:validation/)?test/\S+?\.py(?:::.*?)?)(?: - .*)?$', re.MULTILINE)
# Exit statuses of pytest: all passed; some failed; not started, for example by a failed import.
_PASSED, _SOME_FAILED, _BROKEN_OFF = 0, 1, 2


class Fault(NamedTuple):
    """A line of a file of the package, and its replacement."""

    file: str
    old: str
    new: str
    tests: tuple[str, ...]  # files, quickest first

    @property
    def in_kernels(self) -> bool:
        """True if the fault changes kernels, which are then recompiled."""
        return self.file.startswith(('kernels/', 'geometry/', 'terms/'))

    def __str__(self) -> str:
        """Return file, old line and new line."""
        return f'{self.file}: {self.old.strip()}  ->  {self.new.strip()}'


def read_table(path: Path = TABLE, root: Path = ROOT) -> list[Fault]:
    """Return the faults; raise ValueError if one cannot be planted or has no tests."""
    faults = []
    for name, entry in yaml.safe_load(path.read_text(encoding='utf-8')).items():
        text = (root / PACKAGE / name).read_text(encoding='utf-8')
        tests = tuple(entry['tests'])
        missing = [test for test in tests if not (root / test).is_file()]
        if missing or not tests:
            raise ValueError(f'{name}: no such tests: {missing or tests}')
        for old, new in entry['faults']:
            if text.count(old) != 1:
                raise ValueError(
                    f'{name} has this line {text.count(old)} times instead of once; update the '
                    f'table: {old!r}')
            if old == new:
                raise ValueError(f'{name}: the replacement is equal to the line: {old!r}')
            faults.append(Fault(name, old, new, tests))
    return faults


class Copies:
    """Copies of the tree with and without a fault."""

    def __init__(self, folder: Path) -> None:
        """Copy the tree with its caches of kernels."""
        self.faulty, self.clean = folder / 'faulty', folder / 'clean'
        for copy in (self.faulty, self.clean):
            shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*_LEFT_OUT), symlinks=True)
        self._cache = folder / 'cache'

    def first_failure(self, fault: Fault, tests: tuple[str, ...]) -> str:
        """Return the first test that fails only with the fault, or an empty string."""
        path = self.faulty / PACKAGE / fault.file
        text = path.read_text(encoding='utf-8')
        path.write_text(text.replace(fault.old, fault.new), encoding='utf-8')
        # Kernels with the fault must not replace those without it.
        try:
            failed = run_tests(self.faulty, tests, self._cache if fault.in_kernels else None)
        finally:
            path.write_text(text, encoding='utf-8')
            shutil.rmtree(self._cache, ignore_errors=True)
        if failed and run_tests(self.clean, (failed,), None):
            print(f'  {failed} fails without the fault, too', flush=True)
            return ''
        return failed


def run_tests(tree: Path, tests: tuple[str, ...], cache: Path | None) -> str:
    """Return the first test that fails in a copy of the tree, or an empty string."""
    environment = {**os.environ, 'PYTHONPATH': f'{tree}:{tree}/validation',
                   'PYTHONDONTWRITEBYTECODE': '1'}
    if cache is not None:
        environment['NUMBA_CACHE_DIR'] = str(cache)
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-x', '-q', '-n', '0', '-p', 'no:cacheprovider',
         f'--timeout={_TEST_TIMEOUT_S}', *tests],
        cwd=tree, env=environment, text=True, capture_output=True, check=False)
    if done.returncode == _PASSED:
        return ''
    found = _FAILED.search(done.stdout)
    if found is None or done.returncode not in (_SOME_FAILED, _BROKEN_OFF):
        raise RuntimeError(
            f'pytest {" ".join(tests)} ended with {done.returncode} and names no test:\n'
            f'{done.stdout[-2000:]}{done.stderr[-2000:]}')
    return found[1]


def known_results(path: Path | None) -> dict[tuple[str, str, str], str]:
    """Return the tests in a table of results, by file, old and new text; '': not caught."""
    if path is None or not path.is_file():
        return {}
    with path.open(encoding='utf-8', newline='') as file:
        return {(file_, old, new): caught for file_, old, new, caught, _ in csv.reader(file)}


def judge(
    copies: Copies, fault: Fault, *, whole: bool, known: dict[tuple[str, str, str], str],
    results: Path | None,
) -> str:
    """Return the test that catches a fault, or an empty string."""
    if fault[:3] in known:
        return known[fault[:3]]
    begun, caught = time.monotonic(), ''
    for test in fault.tests:
        caught = caught or copies.first_failure(fault, (test, *_USUAL))
    if not caught and whole:
        caught = copies.first_failure(fault, _WHOLE_SUITE)
    seconds = time.monotonic() - begun
    if results is not None:
        with results.open('a', encoding='utf-8', newline='') as file:
            csv.writer(file).writerow([*fault[:3], caught, f'{seconds:.0f}'])
    return caught


def main() -> int:
    """Print the test that catches each fault, and the fraction caught; return 0."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        '--only', nargs='+', default=[''], metavar='WORD', help='faults of files whose name '
        'starts so, e.g. bag/ ros/')
    parser.add_argument(
        '--whole-suite', action='store_true', help='run all tests except those of nodes for '
        'faults that survive')
    parser.add_argument('--results', type=Path, metavar='FILE', help='a table (CSV) to add to')
    arguments = parser.parse_args()
    faults = [fault for fault in read_table() if fault.file.startswith(tuple(arguments.only))]
    if not faults:
        parser.error(f'--only: no fault is in a file that starts with {arguments.only}')
    faults.sort(key=lambda fault: fault.in_kernels)
    known = known_results(arguments.results)
    caught_by_own, survivors = 0, []
    with tempfile.TemporaryDirectory(prefix='icofabric_faults_') as folder:
        copies = Copies(Path(folder))
        for number, fault in enumerate(faults, 1):
            caught = judge(
                copies, fault, whole=arguments.whole_suite, known=known,
                results=arguments.results)
            print(f'{number} of {len(faults)}  {fault}\n  {caught or "SURVIVES"}', flush=True)
            caught_by_own += caught.partition('::')[0] in fault.tests
            if not caught:
                survivors.append(fault)
    share = 1.0 - len(survivors) / len(faults)
    print(
        f'{len(faults) - len(survivors)} of {len(faults)} faults are caught: {share:.0%}; '
        f'{caught_by_own} by tests of their file')
    for fault in survivors:
        print(f'survives: {fault}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
