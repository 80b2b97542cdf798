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
