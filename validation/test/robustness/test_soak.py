# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Short versions of the long runs, and what these judge by; limits on wall time are not judged."""
import csv
import os
import subprocess
import sys

from icofabric_validation.robustness.soak_judge import (
    clock_faults,
    clock_moments,
    measure_real_time_factor,
    Moments,
    slope,
)
import pytest
from ros_helpers import domain

TICK = 10**7  # ns
NOTHING: Moments = clock_moments([], 0)


def soak(folder, *arguments):
    """The rows of a run, by name, and what it printed."""
    table = folder / 'table.csv'
    done = subprocess.run(
        [sys.executable, '-m', 'icofabric_validation.robustness.soak', *arguments,
         '--no-wall-limits', '--domain', str(domain()), '--seed', str(os.getpid()),
         '--csv', str(table), '--keep', str(folder / 'kept')],
        text=True, capture_output=True, timeout=600)
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    with table.open(encoding='utf-8') as file:
        rows = {row['name'].strip(): row for row in csv.DictReader(file)}
    return rows, said


def number(row):
    return float(row['value'].split()[0].strip(',').replace(',', ''))


def judged(rows, *names):
    for name in names:
        assert rows[name]['good'] == 'yes', rows[name]


@pytest.mark.long
def test_a_short_soak(tmp_path):
    rows, said = soak(tmp_path, '--minutes', '0.8')
    judged(
        rows, 'exit status', 'tracebacks', 'rise over the second half', 'open files, median early '
        'and late', 'missing, doubled or off the grid', 'bags, not closed', 'verify identical',
        'ticks missing, doubled or off the grid', 'unaccounted for')
    for name, least in (('done', 20), ('ticks of /clock received', 500), ('wrenches sent', 500)):
        assert number(rows[name]) > least, said
    assert number(rows['bags, not closed']) >= 2
    for deed in ('push', 'reweave', 'reset', 'save', 'restore', 'burst', 'switch_recording'):
        assert f'{deed} ' in said


def test_a_driven_run_verifies_on_one_and_two_threads(tmp_path):
    rows, _ = soak(tmp_path, '--part', 'verify60', '--seconds', '5')
    judged(rows, 'verify --threads 1', 'verify --threads 2', 're-weaves in it', 'wrenches in it',
           '~/checkpoint in it', 'simulated time in the bag')


def test_a_clock_without_fault():
    stamps = [k * TICK for k in range(50)]
    assert clock_faults(stamps, NOTHING, 100.0) == []


@pytest.mark.parametrize('stamps, words', [
    ([0, TICK, 3 * TICK], 'nothing between'),
    ([0, TICK, TICK, 2 * TICK], 'twice'),
    ([0, TICK, TICK + 1, 2 * TICK], 'off the grid'),
    ([0, TICK, 2 * TICK, TICK, 2 * TICK], 'came after'),
])
def test_faults_of_a_clock_are_found(stamps, words):
    faults = clock_faults(stamps, NOTHING, 100.0)
    assert len(faults) == 1 and words in faults[0]


def test_what_a_clock_may_do():
    """Repeat a pause, jump over steps, go back at a reset and to a checkpoint."""
    moments = clock_moments([
        ('pause', 0.015, {}), ('step', 0.055, {'count': 4}), ('reset', 0.07, {'time_reset': True}),
        ('checkpoint_restored', 0.01, {'of': 0.0333}), ('reset', 0.04, {'time_reset': False}),
    ], 0)
    stamps = [0, TICK, 15 * 10**6, 15 * 10**6, 55 * 10**6, 6 * TICK, 7 * TICK, 0, TICK,
              33_300_000, 4 * TICK, 4 * TICK, 5 * TICK]
    assert clock_faults(stamps, moments, 100.0) == []
    assert len(clock_faults(stamps, NOTHING, 100.0)) > 3
    assert clock_faults([4 * TICK, 0, TICK], clock_moments(
        [('reset', 0.04, {'time_reset': False})], 4 * TICK), 100.0)


def test_pace_of_ticks():
    """As fast as wanted at first, then half as fast; the pause in between does not count."""
    moments = clock_moments([('pause', 1.005, {})], 0)
    ticks = [(0.01 * k, k * TICK) for k in range(101)]
    ticks.append((1.005, 1_005_000_000))
    ticks += [(100.0 + 0.02 * k, (k + 101) * TICK) for k in range(100)]
    speed = measure_real_time_factor(ticks, moments, 100.0)
    assert speed.first == pytest.approx(1.0, rel=1e-6)
    assert speed.second == pytest.approx(0.5, rel=1e-6)
    assert speed.longest == pytest.approx(0.02) and speed.drift == pytest.approx(-0.5)


def test_slope_is_that_of_the_second_half():
    times = [float(k) for k in range(101)]
    values = [min(k, 50) * 10.0 + max(k - 50, 0) * 0.25 for k in range(101)]
    assert slope(times, values) == pytest.approx(0.25)
    assert slope([0.0, 1.0], [0.0, 5.0]) == 0.0
