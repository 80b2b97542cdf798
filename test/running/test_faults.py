# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Clocks that jump and memory that ends: neither changes a result or ends in a traceback."""
import itertools
import subprocess
import sys
import time

from icofabric_sim.messages.topics import POSES
import pytest
from runner_helpers import ListSink, make_runner, run

LIMITED = """
import resource, sys
from icofabric_sim.commands.main import main
import icofabric_sim as ico
ico.compile_scene(ico.Scene.from_parameters({'weave.size': [2, 2, 2]}))
used = 4096 * int(open('/proc/self/statm').read().split()[0])
resource.setrlimit(resource.RLIMIT_AS, (used + int(sys.argv[1]), used + int(sys.argv[1])))
sys.exit(main(sys.argv[2:]))
"""


@pytest.mark.parametrize('jump', [-1e9, 3600.0, 1e9])
def test_jumps_of_the_wall_clock_change_no_bit(jump, monkeypatch):
    plain = ListSink(POSES)
    run(make_runner(plain, initial_random__velocity_sigma=0.1))
    jumps, clock = itertools.count(), time.time
    monkeypatch.setattr(time, 'time', lambda: clock() + jump * next(jumps))
    monkeypatch.setattr(time, 'time_ns', lambda: int(1e9 * time.time()))
    jumped = ListSink(POSES)
    runner = run(make_runner(jumped, initial_random__velocity_sigma=0.1, real_time_factor=1.0))
    assert runner.failure == '' and runner.finished
    assert jumped.messages == plain.messages


@pytest.mark.parametrize('megabytes', [5, 20, 60])
def test_a_process_without_memory_says_so_in_a_line(megabytes, tmp_path):
    done = subprocess.run(
        [sys.executable, '-c', LIMITED, str(megabytes * 2**20), 'run', 'free_slab', '-p',
         'weave.size:=[120, 120, 60]', '-p', 'contact.mode:=never', '--duration', '0.001',
         '--record', str(tmp_path / 'bag')],
        text=True, capture_output=True, timeout=300)
    said = done.stderr.strip().splitlines()
    assert done.returncode in (1, 2), done.stderr
    assert 'Traceback' not in done.stderr and 'memory' in said[-1], done.stderr
    assert said[-1].startswith('icofabric run: ')
