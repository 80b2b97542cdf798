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
"""Short runs of benchmarks/fuzz.py and fuzz_node.py: nothing breaks, hangs, or lies."""
import csv
import os
from pathlib import Path
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[2]
FACTOR = int(os.environ.get('ICOFABRIC_EXAMPLES', '1'))
CASES = {'messages': 6000, 'inputs': 3000, 'checkpoints': 300, 'scenes': 400, 'arguments': 1000,
         'bags': 15}


@pytest.mark.examples
@pytest.mark.parametrize('kind', CASES)
def test_every_case_is_refused_or_right(kind, tmp_path):
    table = tmp_path / 'table.csv'
    path = os.pathsep.join([str(ROOT), os.environ.get('PYTHONPATH', '')]).rstrip(os.pathsep)
    done = subprocess.run(
        [sys.executable, str(ROOT / 'benchmarks' / 'fuzz.py'), '--kind', kind, '--cases',
         str(CASES[kind] * FACTOR), '--csv', str(table)],
        text=True, capture_output=True, timeout=580, env={**os.environ, 'PYTHONPATH': path})
    assert done.returncode == 0, done.stdout + done.stderr
    with table.open(encoding='utf-8') as file:
        [row] = csv.DictReader(file)
    assert int(row['cases']) == CASES[kind] * FACTOR and row['faults'] == '0'
    # Both ends are reached.
    assert int(row['refused']) > 0 and int(row['taken']) > 0


@pytest.mark.long
def test_a_live_node_answers_and_moves_as_without_one(tmp_path):
    path = os.pathsep.join([str(ROOT), os.environ.get('PYTHONPATH', '')]).rstrip(os.pathsep)
    done = subprocess.run(
        [sys.executable, str(ROOT / 'benchmarks' / 'fuzz_node.py'), '--bursts', '8',
         '--messages', '500', '--seed', '3', '--folder', str(tmp_path)],
        text=True, capture_output=True, timeout=580, env={
            **os.environ, 'PYTHONPATH': path, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'})
    assert done.returncode == 0, done.stdout + done.stderr
    assert "'checks': 8}, 0 faults" in done.stdout
