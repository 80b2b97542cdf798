# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What `regression.py` calls slower, and what it refuses."""

import math
import re
import sys

from icofabric_validation.benchmarks import regression
import pytest


@pytest.mark.parametrize('ratios, slower', [
    ([1.06, 1.2, 1.051], True), ([1.06, 1.2, 1.04], False), ([0.9, 0.95], False),
    ([math.nan, math.nan], False)])
def test_slower_is_a_whole_range_above_the_limit(ratios, slower):
    assert regression.is_slower(ratios) is slower


def test_cases_that_are_slower_or_do_not_run_fail(monkeypatch, tmp_path):
    # Times [s] of each case in the other tree and in this one.
    times = {'same': (1.0, 1.04), 'slower': (1.0, 1.06), 'not here': (1.0, math.nan),
             'not there': (math.nan, 1.0)}
    calls = []

    class Worker:
        def __init__(self, tree, config, gravity_ratio):
            self.is_this = tree == regression.ROOT
            assert config == tmp_path / 'config'

        def time(self, case):
            calls.append((case, self.is_this))
            return times[case][self.is_this], 1

        def close(self):
            pass

    monkeypatch.setattr(regression, 'Worker', Worker)
    rows = []
    failed = regression.compare(tmp_path, list(times), 2, rows.append)
    assert failed == ['slower', 'not here']
    assert [row.split()[-1] for row in rows[1:]] == ['1', 'SLOWER', 'RUN', '1']
    # In turns, each tree first in every other round.
    order = [is_this for case, is_this in calls if case == 'same']
    assert order == [True, False, *[False, True] * 3, *[True, False] * 3]


@pytest.mark.parametrize('words, said', [
    (['no-such-commit', '--no-baseline'], "no commit 'no-such-commit'.*`git log`"),
    (['--cases', 'no such case'], 'S1, srkn6, 100 steps'),
    (['--rounds', '2'], 'at least 5, got 2')])
def test_wrong_arguments_name_the_way_out(words, said, monkeypatch, capsys):
    monkeypatch.setattr(sys, 'argv', ['regression.py', *words])
    with pytest.raises(SystemExit) as ended:
        regression.main()
    assert ended.value.code == 2
    assert re.search(said, capsys.readouterr().err)
