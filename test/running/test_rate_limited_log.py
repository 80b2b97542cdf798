# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Each kind of warning is logged at once, a flood rarely, and every warning is counted."""
from icofabric_sim.running import rate_limited_log
from icofabric_sim.running.rate_limited_log import MAX_LINE_LENGTH, RateLimitedLog, shortened
import pytest


@pytest.fixture
def clock(monkeypatch):
    """Wall time that a test sets: clock[0]."""
    now = [100.0]
    monkeypatch.setattr(rate_limited_log.time, 'monotonic', lambda: now[0])
    return now


def test_each_kind_is_heard_at_once_and_then_once_a_second(clock):
    said = []
    heard = RateLimitedLog(said.append)
    for _ in range(3):
        heard.log('nan', 'not finite')
        heard.log('frame', 'wrong frame')
    assert said == ['not finite', 'wrong frame']
    clock[0] += 1.0
    heard.log('nan', 'not finite')
    assert said[2:] == ['not finite (2 similar ones before)']


def test_who_tries_by_hand_hears_of_every_one(clock):
    said = []
    heard = RateLimitedLog(said.append)
    for _ in range(20):
        heard.log('nan', 'not finite')
        clock[0] += 1.5
    assert said == ['not finite'] * 20


def test_flood_is_heard_ever_more_rarely(clock):
    """Ten thousand a second for ten minutes: few lines, which count all of them."""
    said = []
    heard = RateLimitedLog(said.append)
    for _ in range(600 * 100):
        heard.log('nan', 'not finite')
        clock[0] += 0.01
    assert len(said) < 20
    counted = len(said) + sum(int(line.split('(')[1].split()[0]) for line in said[1:])
    assert counted >= 600 * 100 - 60 * 100
    # After a quiet while counting starts over.
    clock[0] += 100.0
    heard.log('nan', 'again')
    clock[0] += 1.1
    assert said[-1].startswith('again')


def test_kinds_without_end_take_no_memory(clock):
    heard = RateLimitedLog(lambda text: None)
    for number in range(5000):
        heard.log(f'kind {number}', 'new')
    assert len(heard._kinds) <= 1000


def test_long_lines_lose_their_middle():
    assert shortened('all of it') == 'all of it'
    text = shortened('begin ' + 'x' * 10**6 + ' end')
    assert text.startswith('begin xxx') and text.endswith('xxx end')
    assert '[...999010 characters...]' in text and len(text) < MAX_LINE_LENGTH + 50
