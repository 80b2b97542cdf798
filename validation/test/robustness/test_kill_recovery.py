# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Real runs, driven at random, that are killed at random moments: what is saved of them verifies.
"""
import os
import subprocess
import sys


def test_killed_runs_are_recovered_and_verify():
    """The limit on the loss is judged by the benchmark, on a machine that does nothing else."""
    done = subprocess.run(
        [sys.executable, '-m', 'icofabric_validation.robustness.kill_recovery', '--kills', '3',
         '--longest', '1.5', '--limit', '20', '--seed', str(os.getpid())],
        text=True, capture_output=True, timeout=500)
    assert done.returncode == 0, done.stdout + done.stderr
    head, *kills, last = done.stdout.splitlines()
    assert last.startswith('lost at most') and '3 of 3 good' in last
    assert [line.split()[2] for line in kills] == ['tiny', 'slab', 'tiny']
    for line in kills:
        saved = not line.endswith(('nothing saved', 'before it began'))
        assert not saved or line.endswith('identical')
        # Nothing is on the disk of what lived for less than an instant.
        assert saved or float(line.split()[1]) < 1.0
