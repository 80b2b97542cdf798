# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`make run` ends with the reason if its node fails, is stuck, or is not alone."""

from contextlib import contextmanager
import sys

from geometry_msgs.msg import PoseArray
from icofabric_sim.ros.robustness import node_watch
import pytest
import rclpy
from ros_helpers import domain, load_example

SLEEPER = [sys.executable, '-c', 'import time; time.sleep(600)']
DEAD = [sys.executable, '-c', 'import sys; print("fabric_node: no such file"); sys.exit(7)']
first_light = load_example('first_light')


@contextmanager
def other_fabric():
    context = rclpy.Context()
    context.init()
    node = rclpy.create_node('other', context=context)
    node.create_publisher(PoseArray, first_light.POSES, 10)
    try:
        yield
    finally:
        node.destroy_node()
        context.try_shutdown()


@pytest.fixture
def own_domain(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain()))


def test_a_node_that_dies_is_named_with_its_status(own_domain, capfd):
    assert first_light.follow_node(DEAD, [0]) == 7
    said = capfd.readouterr().err
    assert 'no such file' in said and 'status 7 before it was ready' in said


def test_a_stuck_node_is_ended(own_domain, capfd, monkeypatch):
    monkeypatch.setattr(node_watch, 'MAX_SILENCE_S', 0.5)
    assert first_light.follow_node(SLEEPER, [0]) == 1
    assert 'it is stuck' in capfd.readouterr().err


def test_another_fabric_in_the_graph_is_not_taken_for_the_own_node(own_domain, capfd, monkeypatch):
    monkeypatch.setattr(first_light, '_DISCOVERY_S', 30.0)
    with other_fabric():
        assert first_light.follow_node(SLEEPER, [0]) == 1
    assert 'another node already publishes /icofabric/poses' in capfd.readouterr().err
