# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The scripts in examples/ do to a running node what they say."""

import os
import re
import signal
import subprocess
import sys

import icofabric_sim as ico
from icofabric_sim.messages import decode_string
from icofabric_sim.messages.topics import Outputs
import pytest
from ros_helpers import Client, domain, load_example, next_line, NodeProcess, ROOT

SLAB = ROOT / 'config' / 'hanging_slab.yaml'


def run_example(name):
    """Process of an example, in the graph of the tests."""
    return subprocess.Popen(
        [sys.executable, '-u', str(ROOT / 'examples' / name)], stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, env={**os.environ, 'ROS_DOMAIN_ID': str(domain(0))},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))


def speeds(text):
    return [float(number) for number in re.findall(r'moves at ([0-9.]+) m/s', text)]


def test_push_moves_the_fabric_and_stiffens_it(tmp_path):
    with NodeProcess(
            tmp_path / 'log', scene=ROOT / 'config' / 'hanging_slab.yaml',
            parameters={'gravity': '[0.0, 0.0, 0.0]'}) as node, Client(node) as client:
        poses, weaves = client.listen('~/poses'), client.listen('~/weave', latched=True)
        client.wait_for(lambda: poses, 'poses')
        before = poses[0].values[:, 1].copy()
        done = subprocess.run(
            [sys.executable, str(ROOT / 'examples' / 'push.py')], capture_output=True, text=True,
            timeout=60, env={**os.environ, 'ROS_DOMAIN_ID': str(domain(0))})
        assert done.returncode == 0, done.stderr
        assert 'successful=True' in done.stdout
        client.wait_for(
            lambda: (poses[-1].values[:, 1] - before).max() > 1e-3, 'the push to move the tip')
        client.wait_for(lambda: 'stiffness: 3000.0' in str(weaves[-1]), 'the stiffer connectors')
        assert node.stop() == 0


def test_lockstep_damps_the_tip_and_repeats_exactly(tmp_path):
    with NodeProcess(
            tmp_path / 'log', scene=SLAB, parameters={'start_paused': 'true'}) as node, Client(
                node) as client:
        said = []
        for _ in range(2):
            done = run_example('damp_in_lockstep.py')
            out, errors = done.communicate(timeout=120)
            assert done.returncode == 0, errors
            said.append(speeds(out))
            assert client.clock == 1_500_000_000  # 150 calls, to the nanosecond
            client.set(reset_time=True)
            assert client.call('~/reset').success
        # It falls by its weight, undamped it would swing on at the largest of these speeds.
        assert max(said[0]) > 0.1 and said[0][-1] < 0.2 * max(said[0])
        # However fast the processes were: nothing depends on that.
        assert said[0] == said[1]
        assert node.stop() == 0


def test_live_controller_damps_the_tip(tmp_path):
    with NodeProcess(
            tmp_path / 'log', scene=SLAB, parameters={
                'publish_rate': 100.0, 'start_paused': 'true'}) as node, Client(node) as client:
        done = run_example('damp_live.py')
        assert speeds(next_line(done)) == [0.0]
        client.pause(False)
        said = [speeds(next_line(done))[0] for _ in range(10)]  # five seconds
        done.send_signal(signal.SIGINT)
        _, errors = done.communicate(timeout=60)
        assert done.returncode == 0, errors
        # How well it damps depends on when its messages come: 8 mm/s and more were seen. Left
        # alone the tip still moves at up to 0.37 m/s then.
        assert max(said) > 0.001 and max(said[5:]) < 0.15, said
        assert node.stop() == 0


def test_gymnasium_environment_is_one(tmp_path, monkeypatch):
    pytest.importorskip('gymnasium', reason='gymnasium is not installed on this machine')
    from gymnasium.utils.env_checker import check_env
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain(0)))
    module = load_example('fabric_environment')
    with NodeProcess(
            tmp_path / 'log', scene=SLAB, parameters={'start_paused': 'true'}) as node, Client(
                node):
        env = module.FabricEnv(steps=20)
        check_env(env, skip_render_check=True)
        first, _ = env.reset()
        assert (first == env.reset()[0]).all()
        pushed, reward, terminated, truncated, _ = env.step([0.0, 1.0, 0.0])
        assert pushed[4] > 1e-3 and reward < 0.0 and not (terminated or truncated)
        for _ in range(19):
            *_, truncated, _ = env.step([0.0, 0.0, 0.0])
        assert truncated
        env.close()
        done = run_example('fabric_environment.py')
        out, errors = done.communicate(timeout=120)
        assert done.returncode == 0, errors
        # Left alone the slab gets -230; the speed at one moment is a matter of chance.
        assert -60.0 < float(re.search(r'sum of rewards (\S+),', out)[1]) < 0.0
        assert node.stop() == 0


def test_poses_become_frames_of_the_bodies_that_are_chosen():
    """The messages for TF; tf2_ros itself is not among the wheels."""
    from geometry_msgs.msg import Pose, PoseArray
    poses_to_tf = load_example('poses_to_tf')
    poses = PoseArray(poses=[Pose() for _ in range(3)])
    poses.header.frame_id, poses.header.stamp.sec = 'world', 4
    poses.poses[2].position.y, poses.poses[2].orientation.x = 0.5, 1.0
    rows = poses_to_tf.Rows()
    first, second = poses_to_tf.transforms_of(poses, [2, 0], rows)
    assert (first.header.frame_id, first.header.stamp.sec) == ('world', 4)
    assert (first.child_frame_id, second.child_frame_id) == ('icosahedron_2', 'icosahedron_0')
    assert first.transform.translation.y == 0.5 and first.transform.rotation.x == 1.0
    assert second.transform.translation.y == 0.0
    scene = ico.load_scene('hanging_slab')
    chosen = scene.with_changes({'publish.group': 'tip', 'publish.stride': 3})
    for one, is_known in ((chosen, False), (scene, True)):
        weave = Outputs(one).weave(one.parameters)
        rows.take_weave(decode_string(weave))
        assert rows.are_known == is_known
    rows.take_bodies(chosen.published_bodies)
    body = int(chosen.published_bodies[2])
    [frame] = poses_to_tf.transforms_of(poses, [body], rows)
    assert frame.child_frame_id == f'icosahedron_{body}' and frame.transform.translation.y == 0.5
    with pytest.raises(SystemExit, match='body 0 is not among the poses'):
        poses_to_tf.transforms_of(poses, [0], rows)
