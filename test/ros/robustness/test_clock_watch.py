# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Which other publishers of /clock a node finds."""
from types import SimpleNamespace

from icofabric_sim.ros.robustness.clock_watch import ClockWatch


class Graph:
    """A node, and the publishers of /clock that it finds: (name, namespace)."""

    def __init__(self, *publishers):
        self.publishers, self.warnings = publishers, []

    def get_fully_qualified_name(self):
        return '/left/icofabric'

    def create_timer(self, interval, callback, *, clock):
        self.look = callback

    def get_logger(self):
        return SimpleNamespace(warning=self.warnings.append)

    def get_publishers_info_by_topic(self, topic):
        assert topic == '/clock'
        return [SimpleNamespace(node_name=name, node_namespace=space)
                for name, space in self.publishers]


def test_another_clock_is_warned_of_once_its_name_is_known():
    graph = Graph(('icofabric', '/left'), ('_NODE_NAME_UNKNOWN_', '_NODE_NAMESPACE_UNKNOWN_'))
    watch = ClockWatch(graph)
    graph.look()
    assert not watch.note and not graph.warnings
    graph.publishers = ('icofabric', '/left'), ('player', '/')
    graph.look()
    graph.look()
    assert 'also published by /player' in watch.note and len(graph.warnings) == 1
    graph.publishers = graph.publishers[:1]
    graph.look()
    assert not watch.note
