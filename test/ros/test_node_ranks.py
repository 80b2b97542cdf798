# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A node on the first rank of MPI: driven over the graph, re-woven, recorded; one verifies it."""

import subprocess
import sys

from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.running.replay.verify import verify_run
from mpi_launcher import launcher
import pytest
from ros_helpers import Client, NodeProcess, parameter, reasons, ROOT, write_scene

SCENE = {
    'weave': {'size': [5, 5, 5], 'connector_angle': 0.4},
    'gravity': [0.0, 0.0, -9.81],
    'groups': {'top': 'z_max', 'tip': 'z_min'},
    'supports': {'top': {'group': 'top'}},
    'loads': {'tip': {'group': 'tip', 'share': 'total', 'hold': 0.2}},
    'contact': {'mode': 'never'},
    'solver': {'method': 'srkn4', 'tolerance': 1e-3},
}


def test_a_node_on_ranks_is_driven_as_any_other_and_verifies(tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    with NodeProcess(
            tmp_path / 'log', scene=scene, parameters={'record.path': str(tmp_path / 'bag')},
            launcher=(launcher(), '-n', '2'), own=('--ranks',)) as node, Client(node) as client:
        assert '2 ranks share the steps' in node.log()
        poses = client.listen('~/poses')
        client.wait_until(10**8)
        before = len(poses)
        for force in (0.2, -0.1, 0.3):
            client.push('~/loads/tip', force=(0.0, force, 0.0))
            client.wait_until(client.clock + 2 * 10**7)
        # Built aside while the old fabric runs, and shared by the same ranks.
        client.set(**{'connector.stiffness': 700.0})
        client.wait_until(client.clock + 10**8)
        client.set(**{'weave.size': [5, 5, 7]})
        client.wait_for(lambda: len(poses[-1].values) == 88, 'the longer fabric')
        # What ranks cannot share is refused in words, and the fabric goes on.
        [refused] = client.set_messages([parameter('connector.damping', 0.1)])
        # A busy machine answers before the build has failed, and reports why on /diagnostics.
        words = refused.reason if not refused.successful else reasons(client.health(
            lambda status: 'damped' in reasons(status)))
        assert 'damped' in words and 'dop8' in words
        hand, start = client.publisher('~/pull', 'geometry_msgs/msg/PointStamped'), len(poses)
        moved = pulls = 0.0
        while pulls < 5 or moved <= 5e-3 and pulls < 50:
            hand.publish(_target(0))
            client.wait_until(client.clock + 2 * 10**7)
            moved, pulls = poses[-1].values[0, 0] - poses[start - 1].values[0, 0], pulls + 1
        print(f'the pulled shell has moved by {moved:.4f} m')
        assert moved > 5e-3
        client.pause()
        assert client.call('~/step').success
        client.pause(False)
        client.wait_until(client.clock + 10**8)
        assert len(poses) > before + 5
        assert node.stop() == 0
    with RecordedRun(tmp_path / 'bag') as run:
        result = verify_run(run)
    assert result.verdict == 'identical', result.lines()
    # Three pushes and five pulls.
    assert result.repeated['inputs'] >= 8 and result.repeated['re-weaves'] >= 1


def _target(body):
    from geometry_msgs.msg import PointStamped
    message = PointStamped()
    message.header.frame_id = f'icosahedron_{body}'
    message.point.x = 0.5
    return message


@pytest.mark.parametrize('own, words', [
    ((), 'started 2 processes'), (('--ranks',), 'charge.mutual')])
def test_what_cannot_be_is_said_by_one_of_them(own, words, tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', {**SCENE, 'charge': {'mutual': True}})
    done = subprocess.run(
        [launcher(), '-n', '2', sys.executable, '-m', 'icofabric_sim.ros.fabric_node', *own,
         '--ros-args', '--params-file', str(scene)], cwd=ROOT, capture_output=True, text=True,
        timeout=120)
    # 9: once in a while the launcher kills the rank that has not ended yet.
    assert done.returncode in (2, 9), (done.returncode, done.stdout, done.stderr)
    said = [line for line in done.stderr.splitlines() if words in line]
    assert len(said) == 1 and 'Traceback' not in done.stderr, done.stderr
