# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A node's end: signals are noted, and what the middleware holds up ends all the same."""
from pathlib import Path
import signal
import subprocess
import sys

from icofabric_sim.ros.start import FAILED
import pytest

ROOT = Path(__file__).resolve().parents[2]

BEGIN = """
import threading
import time
from icofabric_sim.ros.start import StopSignals

def held_up():
    if threading.current_thread() is threading.main_thread():
        print('stands', flush=True)
    while True:
        time.sleep(10.0)

signals = StopSignals()
signals.record_only(limit=0.5)
"""


def ends(script, *, number=None):
    """Exit status and error output of a process that gets signal `number` once it stands."""
    with subprocess.Popen(
            [sys.executable, '-c', BEGIN + script], cwd=ROOT, text=True, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE) as process:
        assert process.stdout.readline() == 'stands\n'
        if number is not None:
            process.send_signal(number)
        _, said = process.communicate(timeout=60)
        return process.returncode, said


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_end_that_is_held_up_is_forced_and_says_where(number):
    status, said = ends('held_up()', number=number)
    assert status == FAILED
    assert 'ended by force' in said and 'in held_up' in said


def test_what_is_forced_after_all_is_done_keeps_the_status():
    status, said = ends('signals.ignore(0)\nheld_up()')
    assert status == 0 and 'ended by force' in said


def test_a_start_that_fails_ends_with_its_status_where_the_middleware_stands_still():
    status, said = ends('signals = StopSignals(ends_process=True)\nsignals.ignore(2)\nheld_up()')
    assert status == 2 and 'ended by force' in said and 'in held_up' in said


def test_closing_of_a_bag_takes_as_long_as_it_takes():
    status, said = ends("""
print('stands', flush=True)
while not signals.received:
    time.sleep(0.01)
with signals.without_limit():
    time.sleep(2.0)
""", number=signal.SIGINT)
    assert status == 0 and not said


@pytest.mark.parametrize('save', ["lambda: print('saved', file=sys.stderr)", 'held_up'])
def test_what_can_be_saved_is_saved_before(save):
    script = f'import sys\nsignals.save_before_force({save})\nheld_up()'
    status, said = ends(script, number=signal.SIGINT)
    assert status == FAILED and ('saved' in said) == ('print' in save)


def test_nothing_is_forced_without_a_signal():
    status, said = ends("print('stands', flush=True)\ntime.sleep(2.0)")
    assert status == 0 and not said


def test_process_that_is_done_ends_without_destructors():
    script = """
import atexit
import sys
from icofabric_sim.ros.start import end_process

atexit.register(print, 'destructors')
sys.stdout.write('all that was said')
end_process(3)
"""
    ended = subprocess.run(
        [sys.executable, '-c', script], cwd=ROOT, text=True, capture_output=True, timeout=60,
        check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (3, 'all that was said', '')
