# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
What is said while long work goes on is true: the time left, the pace, and the end by a signal.
"""

import io
import os
import re
import signal
import threading
import time

from icofabric_sim import terminal
from icofabric_sim.bag.summary import summarise_bag
from icofabric_sim.commands import load_cases
from icofabric_sim.commands.main import main
from icofabric_sim.process import wait_notice
from icofabric_sim.process.compile_notice import compile_notice, CompileNotice
from icofabric_sim.process.interrupts import exit_request
from icofabric_sim.running.run_monitor import RunMonitor
from icofabric_sim.statics import equilibrium
import numba
import pytest

RUN = ['run', 'free_slab', '-p', 'weave.size:=[3, 3, 3]', '--no-growth', '--duration', '0.25']


class Work:
    """Work with a bar, at a given pace, on a clock of its own."""

    def __init__(self, monkeypatch, *, total=1000.0, **choices):
        self.now = self.done = 0.0
        self.notice, self.out = CompileNotice(), io.StringIO()
        for module in (terminal, wait_notice):
            monkeypatch.setattr(module.time, 'monotonic', lambda: self.now)
        self.notice._wait_notice._end_s = 0.0
        monkeypatch.setattr(terminal, 'compile_notice', self.notice)
        monkeypatch.setattr(terminal, '_LINE_INTERVAL_S', 0.1)
        self.progress = terminal.Progress(total, 's', stream=self.out, **choices)

    def go_on(self, seconds, pace):
        """Work for so many seconds at so much each; returns the times left that were shown."""
        before = len(self.out.getvalue())
        for _ in range(round(8 * seconds)):
            self.now += 0.125
            self.done += 0.125 * pace
            self.progress.update(self.done)
        text = self.out.getvalue()[before:]
        units = {'s': 1.0, 'min': 60.0, 'h': 3600.0}
        return [float(number) * units[unit]
                for number, unit in re.findall(r'about (\S+) (s|min|h) left', text)]

    def compile(self, seconds):
        """Have the compiler work meanwhile."""
        self.notice.begin(kept=True)
        self.now += seconds
        self.notice.end()


def test_time_left_is_that_of_the_recent_pace(monkeypatch):
    work = Work(monkeypatch)
    assert not work.go_on(1.5, 1.0), 'too early to tell'
    left = work.go_on(8.0, 1.0)
    assert left[-1] == pytest.approx(1000.0 - work.done, rel=0.04)
    # Ten times as fast: silent while both paces are in the window, then right.
    changed = work.go_on(16.0, 10.0)
    assert changed[-1] == pytest.approx((1000.0 - work.done) / 10.0, rel=0.04)
    assert all(value > 0.4 * (1000.0 - work.done) / 10.0 for value in changed)
    assert len(changed) < 100


def test_compiling_does_not_count_as_pace(monkeypatch):
    work = Work(monkeypatch)
    work.go_on(6.0, 2.0)
    work.compile(50.0)
    left = work.go_on(6.0, 2.0)
    assert len(left) > 40
    assert left == pytest.approx([(1000.0 - 12.0) / 2.0] * len(left), rel=0.05)


def test_where_the_pace_says_nothing_the_time_passed_is_shown(monkeypatch):
    work = Work(monkeypatch, foreseen=False)
    assert not work.go_on(20.0, 1.0)
    assert work.out.getvalue().splitlines()[-1] == '20 of 1000 s, after 20 s'


def send_once(monkeypatch, act):
    """Have something done when the run first shows its state."""
    send, done = RunMonitor.send, []

    def sending(self, *arguments):
        send(self, *arguments)
        if not done:
            done.append(True)
            act()

    monkeypatch.setattr(RunMonitor, 'send', sending)


def test_summary_states_the_compiler_apart(monkeypatch, capsys):
    # What a test before has left to a thread would count too.
    for thread in threading.enumerate():
        if thread.name in ('kernels', 'weave'):
            thread.join()
    real, spent = time.monotonic, [0.0]
    monkeypatch.setattr(time, 'monotonic', lambda: real() + spent[0])

    def compiling():
        compile_notice.begin(kept=True)
        spent[0] += 4800.0
        compile_notice.end()

    send_once(monkeypatch, compiling)
    assert main([*RUN, '--no-record']) == 0
    out = capsys.readouterr().out
    wall, factor = map(float, re.search(
        r'steps, (\S+) s of wall time \(real-time factor ([^,]+),', out).groups())
    assert wall < 480.0 and factor == pytest.approx(0.25 / wall, rel=0.01)
    more, = re.findall(r'(\S+) s of additional wall time to load or compile kernels', out)
    assert float(more) >= 4800.0


def test_a_signal_breaks_off_the_compiler_and_keeps_the_bag(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr('icofabric_sim.process.interrupts._GRACE_S', 0.0)
    compiled = []

    def interrupted():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)
        numba.njit(lambda x: x + 1.0)(1.0)
        compiled.append(True)

    send_once(monkeypatch, interrupted)
    assert main([*RUN, '--record', str(tmp_path / 'bag')]) == 130
    assert not compiled
    out = capsys.readouterr().out
    assert re.search('^stopped +by the user at t = .* no results', out, re.MULTILINE)
    summary = summarise_bag(tmp_path / 'bag')
    assert summary.finished and summary.custom['interrupted'] == 'true'
    # The process can go on.
    exit_request.check()
    assert numba.njit(lambda x: x + 2.0)(1.0) == 3.0


@pytest.mark.parametrize('words, module, name, file', [
    (['elasticity', 'stiff_cantilever', '-p', 'weave.size:=[3, 2, 2]', '--kinds', 'pull',
      '--points', '3'], load_cases, 'curve_points', 'curves.csv'),
    (['statics', 'hanging_slab', '-p', 'weave.size:=[3, 3, 2]', '--load-steps', '3'], equilibrium,
     'step_loads', 'load_steps.csv')])
def test_what_was_found_before_an_interrupt_is_printed_and_written(
        words, module, name, file, monkeypatch, capsys, tmp_path):
    whole = getattr(module, name)

    def interrupted(*given, **choices):
        for number, found in enumerate(whole(*given, **choices)):
            if number == 2:
                raise KeyboardInterrupt
            yield found

    monkeypatch.setattr(module, name, interrupted)
    assert main([*words, '--output', str(tmp_path)]) == 130
    out = capsys.readouterr().out
    assert out.count('  equilibrium') == 2
    assert len((tmp_path / file).read_text().splitlines()) == 3
