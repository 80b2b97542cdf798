# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a node that looks around finds that its name is taken."""
from types import SimpleNamespace

from icofabric_sim.ros.robustness import name_watch
from icofabric_sim.ros.robustness.name_watch import NameWatch
import pytest


class Graph:
    """A node, and the publishers of `~/poses` that it finds."""

    def __init__(self, *publishers):
        self.publishers = [SimpleNamespace(node_name=name, node_namespace=space)
                           for name, space in publishers]

    def get_fully_qualified_name(self):
        return '/left/icofabric'

    def get_logger(self):
        return SimpleNamespace(warning=print)

    def resolve_topic_name(self, name):
        return name.replace('~', '/left/icofabric')

    def get_publishers_info_by_topic(self, topic):
        assert topic == '/left/icofabric/poses'
        return self.publishers


def test_name_that_is_taken_is_refused():
    with pytest.raises(ValueError, match='node /left/icofabric is already running.*__node:='):
        NameWatch(Graph(('rosbag2_player', '/'), ('icofabric', '/left'))).require_first()


def test_others_on_the_topic_do_no_harm(monkeypatch):
    monkeypatch.setattr(name_watch, '_DISCOVERY_S', 0.0)
    NameWatch(Graph(('rosbag2_player', '/'), ('icofabric', '/right'))).require_first()
