# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""How the node gets on with others in its graph, and with the shell that started it."""
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import time

from icofabric_sim.kernels.runtime.disk_cache import (
    _prepare_stamp_folder,
    kernel_cache_folder,
)
from icofabric_sim.messages import WARN
from rclpy.qos import QoSProfile, ReliabilityPolicy
from ros_helpers import (
    Client,
    domain,
    NodeProcess,
    reasons,
    ROOT,
    ros_class,
    wait_for,
    write_scene,
)

SCENE = {
    'weave': {'size': [3, 3, 3]},
    'contact': {'mode': 'never'},
    'groups': {'tip': 'x_max'},
    'loads': {'tip': {'group': 'tip'}},
}


def test_second_node_of_a_name_does_not_start(tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    with NodeProcess(tmp_path / 'log', scene=scene) as node, Client(node) as client:
        with NodeProcess(tmp_path / 'second', scene=scene) as second:
            wait_for(lambda: second.process.poll() is not None
                     or second.lines('2 nodes are named /icofabric'), 'what the second says')
            # How soon they find each other is the middleware's business.
            if second.process.poll() is not None:
                assert second.wait() == 2
                [line] = second.lines('fabric_node:')
                assert 'another node /icofabric is already running' in line and '__node:=' in line
            else:
                client.health(lambda status: '2 nodes are named' in reasons(status))
                assert second.stop() == 0
        # Under another name it does.
        with NodeProcess(tmp_path / 'third', '-r', '__node:=other', scene=scene,
                         parameters={'publish_clock': 'false'}) as third:
            wait_for(lambda: third.lines(third.READY), 'a node of another name', node=third)
            assert third.stop() == 0
        # Not only nodes of this package can have the name.
        with client.another_node('icofabric', enable_rosout=False):
            status = client.health(lambda status: '2 nodes are named' in reasons(status))
            assert status.level == WARN and '/icofabric' in reasons(status)
            assert node.lines('2 nodes are named /icofabric')
        client.health(lambda status: 'nodes are named' not in reasons(status))
        assert node.stop() == 0


def test_interrupt_is_heard_where_the_shell_made_it_ignored(tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    log = tmp_path / 'log'
    with log.open('w') as out:
        process = subprocess.Popen(
            [sys.executable, '-m', NodeProcess.MODULE, '--ros-args', '--params-file', str(scene)],
            stdout=out, stderr=subprocess.STDOUT, cwd=ROOT,
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain(1))},
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN))
    try:
        wait_for(lambda: NodeProcess.READY in log.read_text(), 'a node that runs')
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0
    finally:
        process.kill()


def test_verb_is_interrupted_where_the_shell_made_it_ignored(tmp_path):
    process = subprocess.Popen(
        [sys.executable, '-m', 'icofabric_sim.commands.main', 'run', 'hanging_slab',
         '--duration', '1000', '--record', str(tmp_path / 'bag')], stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL, cwd=ROOT,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN))
    try:
        wait_for(lambda: list(tmp_path.glob('bag*')), 'a run that records')
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
    finally:
        process.kill()


def test_best_effort_wrenches_are_heard_and_said(tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    quality = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    kind = ros_class('geometry_msgs/msg/WrenchStamped')
    for offset, (choice, heard) in enumerate((('best_effort', True), ('reliable', False))):
        with NodeProcess(
                tmp_path / choice, scene=scene, offset=offset,
                parameters={'input_reliability': choice}) as node, Client(
                    node, offset=offset) as client:
            publisher = client.node.create_publisher(kind, '/icofabric/loads/tip', quality)
            message = kind()
            message.wrench.force.z = 0.001
            client.publisher('~/loads/tip')  # a reliable one fits both
            deadline = time.monotonic() + (60.0 if heard else 1.0)
            acts = False
            while time.monotonic() < deadline and not acts:
                publisher.publish(message)
                acts = client.health().values['loads active'] == '1'
            assert acts == heard
            lines = node.lines('best effort (input_reliability)')
            assert len(lines) == heard
            if heard:
                assert 'neither resent nor counted' in lines[0] and '~/advance' in lines[0]
            assert node.stop() == 0


def test_slider_costs_a_line_a_second_at_most(tmp_path):
    """Fifty changes a second, of a value that rebuilds the fabric and of one that does not."""
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    with NodeProcess(tmp_path / 'log', scene=scene) as node, Client(node) as client:
        client.get('step_count')
        before, began, futures = len(node.log().splitlines()), time.monotonic(), []
        from ros_helpers import parameter
        for number in range(200):
            futures.append(client.begin(
                '~/set_parameters', 'rcl_interfaces/srv/SetParameters', parameters=[
                    parameter('connector.stiffness', 500.0 + number),
                    parameter('marker_rate', 10.0 + 0.01 * number)]))
            time.sleep(max(0.0, began + 0.02 * number - time.monotonic()))
        for future in futures:
            client.wait_for(future.done, 'an answer')
        client.wait_for(lambda: len(node.log().splitlines()) > before, 'a line of the log')
        passed = time.monotonic() - began
        assert all(result.successful for future in futures for result in future.result().results)
        assert client.get('connector.stiffness') == [699.0]
        lines = node.log().splitlines()[before:]
        assert 1 <= len(lines) <= passed + 1, lines
        assert 'the changed fabric has been running since t = ' in lines[0]
        assert node.stop() == 0


def test_step_limit_is_named_with_its_time(tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    with NodeProcess(tmp_path / 'log', scene=scene) as node, Client(node) as client:
        text = client.health(
            lambda status: 'since t' in status.values['step limited by']).values['step limited by']
        assert 'connector.stiffness' in text and 'rad/s' in text
        assert 'accuracy' in text or 'stability' in text
        client.set(solver__step=1e-4)
        status = client.health(lambda status: 'fixed' in status.values['step limited by'])
        since = float(status.values['step limited by'].rpartition('since t = ')[2].split()[0])
        assert since > 0.0 and status.values['compiling'] == 'no'
        assert node.stop() == 0


def test_while_a_changed_scene_is_compiled_the_node_answers(tmp_path, monkeypatch):
    """With a cache that lacks the kernels of dop8, which a fabric with losses needs."""
    kept = Path(_prepare_stamp_folder(kernel_cache_folder()))
    cache = tmp_path / 'cache'
    shutil.copytree(
        kept, cache / 'icofabric_sim' / kept.name, copy_function=os.symlink,
        ignore=shutil.ignore_patterns('embedded.*', '*.lock'))
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(cache))
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    with NodeProcess(tmp_path / 'log', scene=scene) as node, Client(node) as client:
        client.set(drag__linear=1e-3)  # taken, and built for much longer
        status = client.health(lambda status: status.values['compiling'] != 'no')
        assert 'so far' in status.values['compiling']
        longest = 0.0
        for paused in (True, False, True, False):
            began = time.monotonic()
            client.pause(paused)
            assert client.get('step_count') == [1]
            longest = max(longest, time.monotonic() - began)
        print(f'\nlongest answer while compiling: {longest:.2f} s')
        before = client.clock
        client.wait_until(before + 1)
        began = time.monotonic()
        assert node.stop() == 0
        print(f'SIGINT to exit while compiling: {time.monotonic() - began:.2f} s')


def test_markers_of_loads_come_to_a_listener(tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    with NodeProcess(tmp_path / 'log', scene=scene) as node, Client(node) as client:
        kept = []
        client.node.create_subscription(
            ros_class('visualization_msgs/msg/MarkerArray'), '/icofabric/markers', kept.append, 10)
        client.push('~/loads/tip', (0.0, 0.0, 1e-3))
        client.wait_for(
            lambda: kept and kept[-1].markers[0].points, 'the arrow of a force')
        assert [marker.ns for marker in kept[-1].markers] == [
            'forces', 'torques', 'supports', 'planes', 'plane_surfaces', 'contacts',
            'contact_normals', 'contact_forces']
        assert node.stop() == 0
