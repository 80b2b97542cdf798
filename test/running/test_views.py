# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What a page is sent of a run: by the wall clock, and nothing where nobody looks."""
import time

import icofabric_sim as ico
from icofabric_sim.messages import topics
from icofabric_sim.messages.topics import VIEWS
from icofabric_sim.running import views
from icofabric_sim.running.broadcast import Broadcast
import pytest
from runner_helpers import ListSink

POSES = VIEWS[topics.POSES]


@pytest.fixture
def simulation():
    return ico.compile_scene(ico.load_scene('hanging_slab'))


@pytest.fixture
def clock(monkeypatch):
    """A wall clock [s] that goes on by itself only in its only item."""
    now = [100.0]
    monkeypatch.setattr(time, 'monotonic', lambda: now[0])
    return now


def test_pages_get_at_most_60_poses_and_10_of_the_rest_in_a_second(simulation, clock):
    page = ListSink(*VIEWS.values())
    broadcast = Broadcast([page], simulation)
    for number in range(3000):  # outputs every 60th of a simulated second, 3,000 in a second
        clock[0] = 100.0 + number / 3000.0
        broadcast.due(number * 10**9 // 60)
    assert 55 <= len(page.of(POSES)) <= 60
    assert len(page.of(VIEWS[topics.ENERGY])) == 10
    assert len({time for time, _ in page.of(VIEWS[topics.CONNECTORS])}) == 10


def test_they_are_the_messages_that_others_get(simulation, clock):
    page, other = ListSink(*VIEWS.values()), ListSink(*VIEWS)
    broadcast = Broadcast([page, other], simulation)
    simulation.advance_to(0.5)
    broadcast.due(500_000_000)
    assert page.messages and len(page.messages) == len(other.messages)
    for topic, view in VIEWS.items():
        assert page.of(view) == other.of(topic) != []


def test_others_get_all_whoever_looks(simulation, clock):
    page, other = ListSink(*VIEWS.values()), ListSink(topics.POSES)
    broadcast = Broadcast([page, other], simulation)
    for number in range(1, 31):
        broadcast.due(number * 10**9 // 60 + (number * 10**9 % 60 >= 30))
    assert len(other.messages) == 30 and len(page.of(POSES)) == 1


def frames_in_10_s(simulation, clock, monkeypatch, *, cost, waiting=0.0):
    """Count poses that take `cost` of processor time [s] each, and as much again of `waiting`."""
    busy = [0.0]
    monkeypatch.setattr(time, 'thread_time', lambda: busy[0])
    page = ListSink(*VIEWS.values())
    broadcast = Broadcast([page], simulation)
    build = broadcast._build

    def slow(topic, now):
        if topic is topics.POSES:
            busy[0] += cost
            clock[0] += cost + waiting
        return build(topic, now)

    monkeypatch.setattr(broadcast, '_build', slow)
    end = clock[0] + 10.0
    while clock[0] < end:
        broadcast.due(0)
        clock[0] += 0.002
    return len(page.of(POSES))


def test_what_takes_long_is_sent_seldom(simulation, clock, monkeypatch):
    found = frames_in_10_s(simulation, clock, monkeypatch, cost=0.01)
    # 10 ms each, of which they may take so much of the wall time; the first is no measure.
    assert 10 <= found <= 14
    assert (found - 2) * 0.01 <= views._SHARES[topics.POSES] * 10.0


def test_what_waits_for_a_busy_processor_is_sent_as_often(simulation, clock, monkeypatch):
    assert 540 <= frames_in_10_s(
        simulation, clock, monkeypatch, cost=1e-4, waiting=0.01) <= 600


def test_small_fabrics_get_30_frames_a_second(simulation, clock, monkeypatch):
    assert 300 <= frames_in_10_s(
        simulation, clock, monkeypatch, cost=1.2e-3, waiting=0.02) <= 360


def test_a_page_sees_the_present_at_once_after_a_jump(simulation, clock):
    page = ListSink(*VIEWS.values())
    broadcast = Broadcast([page], simulation)
    for _ in range(3):
        broadcast.start(0)
    assert len(page.of(POSES)) == 3


def test_nothing_is_built_where_nobody_looks(simulation, clock, monkeypatch):
    broadcast = Broadcast([ListSink()], simulation)
    monkeypatch.setattr(broadcast, '_build', lambda topic, now: pytest.fail(topic.name))
    broadcast.due(0)
    broadcast.emit(0)
