# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Answers that a client could not be reached with are sent again, for some seconds."""

import time
import warnings

from icofabric_sim.ros.robustness import late_answers
from icofabric_sim.ros.robustness.late_answers import LateAnswers
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from ros_helpers import domain


class Service:
    """Sends nothing the first times, as rclpy says it."""

    def __init__(self, failures):
        self.failures, self.sent = failures, []

    def send_response(self, response, header):
        if self.failures:
            self.failures -= 1
            warnings.warn(
                'failed to send response (timeout): client will not receive response',
                RuntimeWarning, stacklevel=1)
        else:
            self.sent.append((response, header))


@pytest.fixture
def serving(monkeypatch):
    """A node, and what serves it for so long [s]."""
    monkeypatch.setattr(late_answers, '_unsent', None)
    with warnings.catch_warnings():
        context = rclpy.Context()
        context.init(domain_id=domain(0))
        node = Node('late', context=context, start_parameter_services=False)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)

        def serve(seconds, until=lambda: False):
            end = time.monotonic() + seconds
            while time.monotonic() < end and not until():
                executor.spin_once(timeout_sec=0.05)

        yield LateAnswers(node), serve
        node.destroy_node()
        context.destroy()


def test_what_was_not_sent_is_sent_later_once(serving):
    late, serve = serving
    slow, quick = Service(3), Service(0)
    for service in (slow, quick):
        late.watch(service)
        service.send_response('yes', 7)
    assert quick.sent == [('yes', 7)] and not slow.sent
    serve(20.0, lambda: slow.sent)
    serve(0.3)
    assert slow.sent == [('yes', 7)] and slow.failures == 0 and len(quick.sent) == 1


def test_after_some_seconds_it_is_given_up(serving, monkeypatch):
    monkeypatch.setattr(late_answers, '_MAX_TRIES', 2)
    late, serve = serving
    never = Service(10**6)
    late.watch(never)
    never.send_response('yes', 7)
    serve(1.0)
    assert never.failures == 10**6 - 3 and not never.sent


def test_other_warnings_are_shown_as_before(serving, monkeypatch):
    late, _ = serving
    shown = []
    monkeypatch.setattr(
        late._detector, '_show', lambda message, *_, **__: shown.append(str(message)))
    warnings.simplefilter('always')
    warnings.warn('something else', RuntimeWarning, stacklevel=1)
    assert shown == ['something else']
