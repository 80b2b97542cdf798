# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions of inputs: all that has arrived is taken at once; they follow the scene."""
import time

from fabrics import make_scene
from geometry_msgs.msg import WrenchStamped
from icofabric_sim.messages import decode_wrench_stamped
from icofabric_sim.ros.input_topics import InputTopics
import pytest
from rclpy.duration import Duration
from rclpy.qos import QoSProfile


@pytest.fixture
def node(bare_node):
    return bare_node


class Received(list):
    """Instead of `ReceivedInputs`: what was handed on."""

    def receive(self, topic, data):
        self.append((topic, round(decode_wrench_stamped(data).first[0])))


def scene_with(*channels):
    return make_scene((2, 2, 2), {
        'groups.both': 'all', **{f'loads.{name}.group': 'both' for name in channels}})


def test_all_that_was_acknowledged_is_taken_at_once(node):
    received, count = Received(), 300
    topics = InputTopics(node, received, scene_with('tip', 'rest'))
    channels = ('~/loads/rest', '~/loads/tip', '~/wrench')
    publishers = [
        node.create_publisher(WrenchStamped, name, QoSProfile(depth=count)) for name in channels]
    for publisher in publishers:
        while not publisher.get_subscription_count():
            pass
    message = WrenchStamped()
    for number in range(count):
        message.wrench.force.x = float(number)
        for publisher in publishers:
            publisher.publish(message)
    for publisher in publishers:
        assert publisher.wait_for_all_acked(Duration(seconds=30))
    # No executor turns: nothing else takes them.
    assert not received
    topics.take_all()
    for name in channels:
        assert [number for topic, number in received if topic == name] == list(range(count))
    topics.take_all()
    assert len(received) == count * len(channels)


def test_channels_come_and_go_with_the_scene(node):
    topics = InputTopics(node, Received(), scene_with('tip', 'rest'))

    def found():
        return {name.rpartition('/')[2] for name, _ in node.get_subscriber_names_and_types_by_node(
            'icofabric', '/') if '/loads/' in name}

    assert found() == {'tip', 'rest'}
    topics.set_scene(scene_with('rest', 'third'))
    # The graph follows within moments.
    for _ in range(500):
        if found() == {'rest', 'third'}:
            break
        time.sleep(0.01)
    assert found() == {'rest', 'third'}
