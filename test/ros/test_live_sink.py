# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Publishers as a sink: what is wanted, and what is counted when a subscriber is stuck."""
from icofabric_sim.messages.topics import CHECKPOINT, CLOCK, POSES, STATE, TF, TOPICS, WEAVE
from icofabric_sim.ros import live_sink
from icofabric_sim.ros.live_sink import LiveSink, message_class
import pytest


@pytest.fixture
def node(bare_node):
    return bare_node


def test_only_what_someone_listens_to_is_wanted(node):
    topics = [topic for topic in TOPICS if topic is not TF]  # whose type may be missing
    sink = LiveSink(node, topics)
    wanted = [topic for topic in topics if sink.wants(topic)]
    # Latched: for later subscribers.
    assert wanted == [topic for topic in topics if topic.latched] and WEAVE in wanted
    subscription = node.create_subscription(
        message_class(POSES.type), POSES.name, lambda message: None, 10)
    while not sink.wants(POSES):
        pass
    assert not sink.wants(STATE)
    node.destroy_subscription(subscription)
    while sink.wants(POSES):
        pass
    sink.close()
    assert not sink.wants(WEAVE)


def test_topics_that_are_not_published_are_not_wanted(node):
    sink = LiveSink(node, [topic for topic in TOPICS if topic not in (CLOCK, TF)])
    assert not sink.wants(CLOCK) and not sink.wants(CHECKPOINT)
    assert not node.get_publishers_info_by_topic('/clock')


class FakePublisher:
    """Its subscribers confirm at some checks."""

    def __init__(self):
        self.confirms, self.failed_checks = lambda: True, 0

    def publish(self, data):
        pass

    def wait_for_all_acked(self, timeout):
        assert timeout.nanoseconds == 0  # publishing never waits
        self.failed_checks += 1
        return self.confirms()


@pytest.fixture
def sink(node, monkeypatch):
    sink, now = LiveSink(node, [POSES]), [1000.0]
    monkeypatch.setattr(live_sink.time, 'monotonic', lambda: now[0])
    sink._outlets[POSES.name].publisher = FakePublisher()

    def send(count, period):
        for _ in range(count):
            now[0] += period
            sink.send(POSES, 0, b'')

    sink.several, sink.publisher = send, sink._outlets[POSES.name].publisher
    return sink


def test_healthy_subscribers_cost_few_looks(sink):
    sink.several(1000, 1 / 60)
    assert sink.not_taken == 0 and 50 <= sink.publisher.failed_checks <= 100


@pytest.mark.parametrize('phase', range(10))
def test_subscribers_are_asked_once_for_a_full_queue(sink, phase):
    """In between there is always something whose acknowledgement was not requested yet."""
    sent = []
    sink.publisher.confirms = lambda: len(sent) % 10 == phase
    for _ in range(600):
        sent.append(1)
        sink.several(1, 1 / 60)
    assert sink.not_taken == 0


def test_stuck_subscriber_is_counted_until_it_goes_on(sink):
    sink.several(30, 1 / 60)
    sink.publisher.confirms = lambda: False
    sink.several(60 * 5, 1 / 60)
    assert sink.not_taken == 0
    sink.several(60 * 5, 1 / 60)
    counted = sink.not_taken
    assert 200 < counted <= 300
    sink.publisher.confirms = lambda: True
    sink.several(600, 1 / 60)
    assert sink.not_taken - counted <= 1


def test_messages_too_close_for_an_answer_are_not_judged(sink):
    sink.publisher.confirms = lambda: False
    sink.several(100_000, 1e-3)
    assert sink.not_taken == 0 and sink.publisher.failed_checks == 0
