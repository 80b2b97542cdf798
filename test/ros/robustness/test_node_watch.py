# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A node is waited for as long as it makes progress, and a stuck one is named with the reason.

Stand-ins for the node print given lines, or nothing.
"""

import io
import os
import sys
import time

from icofabric_sim.process.compile_notice import COMPILING, STILL_COMPILING
from icofabric_sim.ros.robustness import node_watch
from icofabric_sim.ros.robustness.node_watch import NodeStuck, NodeWatch
from icofabric_sim.ros.start import READY
import pytest


class StandIn:
    """A process that prints what is given, and a clock and a processor that are set by hand."""

    def __init__(self, folder):
        self.now, self.used, self.shown = 1000.0, 0.0, io.StringIO()
        words = folder / 'words'
        os.mkfifo(words)
        self.watch = NodeWatch(
            [sys.executable, '-c', f'for line in open({str(words)!r}): print(line, end="")'],
            READY, out=self.shown, clock=lambda: self.now, processor=lambda pid: self.used)
        self.pipe = words.open('w')

    def say(self, text):
        """Have it say a line, and wait until that has come."""
        before = len(self.shown.getvalue())
        self.pipe.write(text + '\n')
        self.pipe.flush()
        deadline = time.monotonic() + 60.0
        while text not in self.shown.getvalue()[before:]:
            assert time.monotonic() < deadline
            time.sleep(0.01)

    def judge(self, passed, seen=''):
        """Have it judged after so many seconds."""
        self.now += passed
        self.watch.judge(lambda: seen)


@pytest.fixture
def stand_in(tmp_path):
    found = StandIn(tmp_path)
    yield found
    found.pipe.close()
    found.watch.process.kill()
    found.watch.wait()


def test_a_node_that_compiles_is_waited_for(stand_in):
    stand_in.say(f'[INFO] [icofabric]: {COMPILING}')
    for turn in range(60):
        stand_in.say(f'[INFO] [icofabric]: {STILL_COMPILING}, for {10 * turn} s so far')
        stand_in.used = 4.0 * turn
        stand_in.judge(10.0)
    assert '   600 s: waiting for fabric_node, which is compiling its kernels (236 s of' in (
        stand_in.shown.getvalue())


def test_a_node_that_works_without_a_word_is_waited_for(stand_in):
    for _ in range(60):
        stand_in.used += 0.6
        stand_in.judge(10.0)
    assert '600 s: waiting for fabric_node, which is busy (36 s of processor time' in (
        stand_in.shown.getvalue())


def test_a_node_that_starves_is_waited_for_while_it_speaks(stand_in):
    for turn in range(60):
        stand_in.say(f'importing {turn}')
        stand_in.judge(50.0)


def test_a_node_that_neither_speaks_nor_works_is_stuck(stand_in):
    stand_in.say('importing')
    stand_in.judge(node_watch.MAX_SILENCE_S)
    assert 'silent for 60 s' in stand_in.shown.getvalue()
    with pytest.raises(NodeStuck, match=r'for 61 s it printed nothing .*last line: importing'):
        stand_in.judge(1.0)


def test_a_node_that_is_ready_but_out_of_reach(stand_in):
    stand_in.judge(50.0)
    stand_in.say(f'[INFO] [icofabric]: {READY}63 bodies')
    stand_in.judge(node_watch.DISCOVERY_S)
    assert 'is ready, it is not discovered over ROS 2 yet' in stand_in.shown.getvalue()
    with pytest.raises(NodeStuck, match='ready for 61 s, but this process has not discovered it'):
        stand_in.judge(1.0)
    with pytest.raises(NodeStuck, match='ready for 62 s, but /poses is seen, but no pose'):
        stand_in.judge(1.0, '/poses is seen, but no pose has come')


def test_time_of_the_processor_is_that_of_the_process():
    before = node_watch.processor_time(os.getpid())
    spent = time.process_time()
    while time.process_time() - spent < 0.3:
        pass
    assert 0.2 < node_watch.processor_time(os.getpid()) - before < 30.0
    assert node_watch.processor_time(2**30) == 0.0
