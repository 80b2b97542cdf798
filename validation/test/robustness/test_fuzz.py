# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Short runs of `fuzz.py` and `fuzz_node.py`: nothing breaks, hangs, or lies."""
import csv
import os
import shutil
import subprocess
import sys

from icofabric_sim.bag import BagReader, BagRecorder
from icofabric_validation.robustness import fuzz_kinds
import pytest

FACTOR = int(os.environ.get('ICOFABRIC_EXAMPLES', '1'))
CASES = {'messages': 6000, 'inputs': 3000, 'checkpoints': 300, 'scenes': 400, 'arguments': 1000,
         'bags': 15}


@pytest.mark.examples
@pytest.mark.parametrize('kind', CASES)
def test_every_case_is_refused_or_right(kind, tmp_path):
    table = tmp_path / 'table.csv'
    done = subprocess.run(
        [sys.executable, '-m', 'icofabric_validation.robustness.fuzz', '--kind', kind, '--cases',
         str(CASES[kind] * FACTOR), '--csv', str(table)],
        text=True, capture_output=True, timeout=580)
    assert done.returncode == 0, done.stdout + done.stderr
    with table.open(encoding='utf-8') as file:
        [row] = csv.DictReader(file)
    assert int(row['cases']) == CASES[kind] * FACTOR and row['faults'] == '0'
    # Both ends are reached.
    assert int(row['refused']) > 0 and int(row['accepted']) > 0


@pytest.mark.parametrize('kept', [10, 11, 15])
def test_a_recovered_start_of_a_bag_is_what_was_recorded(kept, tmp_path):
    """A recovery may end after any message, between the first connectors and energies too."""
    with fuzz_kinds.KINDS['bags'].subject(tmp_path) as subject:
        source, path = tmp_path / 'bag', tmp_path / 'whole'
        with BagReader(source) as reader:
            topics, found = reader.topics, list(reader.messages())
        assert found[4][0] == found[9][0] == '/icofabric/connectors' and '/energy' in found[10][0]
        for damage in (0, 1):
            with BagRecorder(path) as recorder:
                for name, entry in topics.items():
                    recorder.add_topic(name, entry.type_name, latched=entry.latched,
                                       depth=entry.depth or None)
                for name, at, item in found[:kept]:
                    recorder.write(name, at, item)
            if damage:
                subject._content = {source: ([], subject._content[source][1])}
                with pytest.raises(fuzz_kinds.Fault, match='holds other messages'):
                    subject._verify(source, path)
            else:
                assert subject._verify(source, path) == fuzz_kinds.ACCEPTED
            shutil.rmtree(path)


@pytest.mark.long
def test_a_live_node_answers_and_moves_as_without_one(tmp_path):
    done = subprocess.run(
        [sys.executable, '-m', 'icofabric_validation.robustness.fuzz_node', '--bursts', '8',
         '--messages', '500', '--seed', '3', '--folder', str(tmp_path)],
        text=True, capture_output=True, timeout=580, env={
            **os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'})
    assert done.returncode == 0, done.stdout + done.stderr
    assert "'checks': 8}, 0 faults" in done.stdout
