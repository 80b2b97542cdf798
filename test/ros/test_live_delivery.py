# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A large fabric from one process to another: every message, and every number in it."""
import icofabric_sim as ico
from icofabric_sim.messages import decode_marker_points, MarkerAction
from icofabric_sim.messages.markers import STRAIN_CLASSES
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.messages.topics import Outputs
import numpy as np
from ros_helpers import Client, NodeProcess, write_scene

# 100,920 bodies; slower than real time, so that a busy machine keeps up too.
SCENE = {
    'weave': {'size': [58, 58, 60]},
    'connector': {'stiffness': 1.0},
    'initial_random': {'velocity_sigma': 0.05, 'spin_sigma': 2.0, 'seed': 1},
    'contact': {'mode': 'never'},
    'solver': {'method': 'leapfrog', 'step': 0.005},
    'publish_rate': 10.0,
    'marker_rate': 1.0,
    'real_time_factor': 0.25,
    'start_paused': True,
}
END = 10**9  # of what is looked at [ns]


def test_a_large_fabric_arrives_whole(tmp_path):
    scene = ico.Scene.from_parameters(SCENE)
    assert scene.body_count == 100_920
    with NodeProcess(tmp_path / 'log', scene=write_scene(tmp_path / 'scene.yaml', SCENE)) as node:
        with Client(node) as client:
            poses, markers = client.listen('~/poses'), client.listen('~/connectors')
            client.wait_for(lambda: poses and markers, 'the state before the start')
            client.pause(False)
            client.wait_for(
                lambda: sum(marker.nanoseconds == END for marker in markers)
                == len(STRAIN_CLASSES) + 1, 'the last markers', limit=300.0)
            client.wait_for(lambda: poses[-1].nanoseconds > END, 'poses after them')
        assert node.stop() == 0
    # The state at rest is repeated for later subscribers.
    received = {
        pose.nanoseconds: pose.values for pose in poses if pose.nanoseconds <= END}
    assert list(received) == [k * 10**8 for k in range(11)]
    simulation, outputs = ico.compile_scene(scene), Outputs(scene)
    for now, values in received.items():
        simulation.advance_to(seconds(now))
        snapshot = simulation.snapshot()
        assert (values[:, :3] == snapshot.position).all()
        assert (values[:, 3:] == snapshot.orientation).all()
        if now in (0, END):
            check_markers([marker for marker in markers if marker.nanoseconds == now],
                          list(outputs.connectors(snapshot, now)))
    assert np.abs(received[END] - received[0]).max() > 0.01


def check_markers(received, expected):
    # The state at rest comes several times; the first may have been joined half way.
    assert {marker.marker_id for marker in received} == {0, 1, 2, 3, 4, 6}
    shown, decoded = 0, map(decode_marker_points, expected)
    expected = {marker.marker_id: marker for marker in decoded}
    for marker in received:
        wanted = expected[marker.marker_id]
        assert marker.action == wanted.action
        assert (marker.points == wanted.points).all()
        shown += marker.action == MarkerAction.ADD and len(marker.points) > 0
    assert shown > 0
