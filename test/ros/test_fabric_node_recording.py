# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A run with a plain rclpy script beside it: what the poses answer, and what the bag holds."""
from fractions import Fraction
import itertools
import json
import os
import signal
import subprocess
import sys

import icofabric_sim as ico
from icofabric_sim.bag import BagReader, recover_bag
from icofabric_sim.messages import (
    decode_clock,
    decode_diagnostic_array,
    decode_pose_array,
    decode_string,
    decode_wrench_stamped,
)
from icofabric_sim.messages.schedule import seconds
import numpy as np
import pytest
from ros_helpers import Client, domain, NodeProcess, ROOT, wait_for, write_scene

CHANNEL = '/icofabric/loads/all_of_it'
# At rest without gravity, so that whatever moves was pushed.
SLAB = {
    'weave': {'size': [4, 3, 3]},
    'connector': {'stiffness': 300.0},
    'contact': {'mode': 'never'},
    'groups': {'everything': 'all', 'end': 'x_max'},
    'loads': {'all_of_it': {'group': 'everything', 'share': 'total'},
              'end': {'group': 'end', 'frame': 'body', 'point': [0.0, 0.004, 0.009]}},
}


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """Log, bag and what the script printed, of a run that Ctrl-C ended."""
    folder = tmp_path_factory.mktemp('recorded')
    scene = write_scene(folder / 'scene.yaml', SLAB)
    bag = folder / 'bag'
    with NodeProcess(folder / 'log', scene=scene, parameters={'record.path': bag}) as node:
        script = subprocess.run(
            [sys.executable, str(ROOT / 'test' / 'plain_wrench_client.py')], text=True,
            capture_output=True, timeout=120,
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain())})
        assert script.returncode == 0, script.stdout + script.stderr + node.log()
        with Client(node) as client:
            # Not only forces on the whole: on single bodies, off centre, turning with them.
            poses = client.listen('~/poses')
            client.push('~/wrench', (0.01, 0.0, 0.02), (1e-4, -2e-4, 0.0), frame='icosahedron_3')
            client.push('~/loads/end', (0.0, 0.01, 0.0), (0.0, 1e-4, 0.0), frame='icosahedron')
            client.push('~/wrench', (float('nan'), 0.0, 0.0), frame='icosahedron_3')
            # A node that has not yet heard of a new publisher asks for its messages seconds later.
            client.health(lambda status: status.values['loads active'] == '2'
                          and status.values['wrenches dropped'] == '1')
            before = len(poses)
            client.wait_for(lambda: len(poses) > before + 10, 'poses')
        status = node.stop()
        yield {'status': status, 'log': node.log(), 'bag': bag, **json.loads(script.stdout)}


@pytest.fixture(scope='module')
def messages(run):
    """(topic, time, bytes) in the order of the bag."""
    with BagReader(run['bag']) as bag:
        return list(bag.messages())


def recorded(messages, topic):
    return [(time, data) for name, time, data in messages if name == topic]


def test_interrupt_closes_the_bag(run):
    assert run['status'] == 0
    assert (run['bag'] / 'metadata.yaml').is_file()


def test_what_the_bag_says_of_the_run(run):
    with BagReader(run['bag']) as bag:
        custom = bag.custom
        assert next(bag.messages())[0] == '/icofabric/recording'
    assert custom['failure'] == 'none' and custom['proximity'] == 'none'
    assert custom['wrenches_dropped'] == '1'
    assert custom['method'] in ico.METHODS and custom['version'] == ico.__version__
    assert custom['method_reason'] and float(custom['tolerance']) == 1e-6
    assert float(custom['error_estimate']) >= 0.0 and float(custom['balance_worst']) < 0.01
    assert {'numpy', 'numba', 'rosbags'} <= json.loads(custom['libraries']).keys()
    assert custom['processor'] and float(custom['step']) > 0.0


def test_outputs_fill_their_grids(messages):
    for topic, rate in (('/icofabric/poses', 60), ('/clock', 100)):
        times = [time for time, _ in recorded(messages, topic)]
        assert len(times) > 50
        assert times == [round(Fraction(k * 10**9, rate)) for k in range(len(times))]
    marker_times = {time for time, _ in recorded(messages, '/icofabric/connectors')}
    assert sorted(marker_times) == [k * 10**8 for k in range(len(marker_times))]


def test_stamps_are_the_bag_times(messages):
    for time, data in recorded(messages, '/icofabric/poses'):
        assert decode_pose_array(data).nanoseconds == time
    for time, data in recorded(messages, '/clock'):
        assert decode_clock(data) == time
    assert len(recorded(messages, '/diagnostics')) >= 1
    for time, data in recorded(messages, '/diagnostics'):
        assert decode_diagnostic_array(data)[0] == time


def test_wrenches_act_as_the_contract_says(run, messages):
    """Stamp 0 and a wall time act at the next step, a stamp in simulated time exactly then."""
    pushes = recorded(messages, CHANNEL)
    assert len(pushes) == len(run['sent']) == 4
    for (_, data), sent in zip(pushes, run['sent']):
        wrench = decode_wrench_stamped(data)
        assert wrench.nanoseconds == sent['stamp']
        assert wrench.first.tolist() == sent['force']
    (at_once, planned, wall, cleared), _ = zip(*pushes)
    sent = run['sent']
    assert planned == sent[1]['stamp'] > sent[1]['sent_at']
    for acted, entry in ((at_once, sent[0]), (wall, sent[2]), (cleared, sent[3])):
        # The script's clock may run behind by the 10 ms between two ticks, or by a busy machine.
        assert acted >= entry['sent_at']
    assert wall < sent[2]['stamp'] // 2
    assert at_once < planned < wall < cleared


def test_one_warning_about_wall_time(run):
    lines = [line for line in run['log'].splitlines() if 'input_horizon' in line]
    assert len(lines) == 1
    assert CHANNEL in lines[0] and 'not simulated time' in lines[0] and '[WARN]' in lines[0]


def test_centre_of_mass_follows_the_pushes(messages):
    """Newton's second law for the whole slab, whatever its connectors do."""
    scene = ico.Scene.from_parameters(SLAB)
    mass = scene.shell.mass * scene.body_count
    pushes = [(seconds(time), decode_wrench_stamped(data).first)
              for time, data in recorded(messages, CHANNEL)]
    # Of two topics either may be taken first.
    others = ('/icofabric/wrench', '/icofabric/loads/end')
    end = min(time for topic, time, _ in messages if topic in others)
    checked = 0
    for time, data in recorded(messages, '/icofabric/poses'):
        if time > end:
            break
        expected, t = scene.position.mean(axis=0), seconds(time)
        for (start, force), (stop, _) in itertools.pairwise([*pushes, (np.inf, None)]):
            on = max(min(t, stop) - start, 0.0)  # held for so long until t
            expected = expected + force / mass * (0.5 * on**2 + on * max(t - stop, 0.0))
        centre = decode_pose_array(data).values[:, :3].mean(axis=0)
        np.testing.assert_allclose(centre, expected, rtol=0.0, atol=1e-10)
        checked += 1
    assert checked > 50
    assert (abs(expected - scene.position.mean(axis=0)) > 1e-3).all()


def test_nothing_moves_before_the_first_push(messages):
    first = recorded(messages, CHANNEL)[0][0]
    poses = [decode_pose_array(data).values
             for time, data in recorded(messages, '/icofabric/poses') if time <= first]
    assert len(poses) > 3
    scene = ico.Scene.from_parameters(SLAB)
    for values in poses:
        np.testing.assert_allclose(values[:, :3], scene.position, rtol=0.0, atol=1e-14)


def test_script_saw_what_the_bag_holds(run, messages):
    by_time = {time: decode_pose_array(data) for time, data in
               recorded(messages, '/icofabric/poses')}
    assert len(run['seen']) > 30
    for seen in run['seen']:
        pose = by_time[seen['stamp']]
        assert seen['frame'] == pose.frame_id == 'world'
        assert seen['positions'] == pose.values[:, :3].tolist()


def apply_recorded(simulation, topic, data):
    wrench = decode_wrench_stamped(data)
    if topic == '/icofabric/wrench':
        body = int(wrench.frame_id.removeprefix('icosahedron_'))
        simulation.apply_body_wrench(body, wrench.first, wrench.second)
    else:
        simulation.apply_wrench(topic.rpartition('/')[2], wrench.first, wrench.second)


def test_direct_simulation_gives_the_same_bits(run, messages, tmp_path):
    """The same inputs at the times at which they acted, without node, runner and graph."""
    with BagReader(run['bag']) as bag:
        (tmp_path / 'scene.yaml').write_text(bag.custom['scene'])
    simulation = ico.compile_scene(ico.load_scene(tmp_path / 'scene.yaml'))
    poses = inputs = 0
    for topic, time, data in messages:
        if topic == '/icofabric/wrench' or topic.startswith('/icofabric/loads/'):
            simulation.advance_to(seconds(time))
            apply_recorded(simulation, topic, data)
            inputs += 1
        elif topic == '/icofabric/poses':
            simulation.advance_to(seconds(time))
            state, values = simulation.snapshot(), decode_pose_array(data).values
            assert values[:, :3].tobytes() == state.position.tobytes(), time
            assert values[:, 3:].tobytes() == state.orientation.tobytes(), time
            poses += 1
    assert poses > 60 and inputs == 6
    moved = abs(simulation.snapshot().position - simulation.scene.position).max()
    assert moved > 1e-3


def test_time_reset_opens_the_next_bag(tmp_path):
    """PATH_1 begins at 0 with the scene that runs then; SIGTERM closes it as Ctrl-C does."""
    scene = write_scene(tmp_path / 'scene.yaml', SLAB)
    parameters = {'record.path': tmp_path / 'bag', 'reset_time': True}
    with NodeProcess(tmp_path / 'log', scene=scene, parameters=parameters) as node, \
            Client(node) as client:
        client.next('~/poses', lambda pose: pose.nanoseconds > 1e8)
        client.set(weave__size=[2, 2, 2])
        client.next('~/poses', lambda pose: len(pose.values) < 10)
        client.set(marker_rate=4.0)
        before = client.clock
        assert client.call('~/reset').success
        client.wait_for(lambda: client.clock < before, 'time to start again')
        client.wait_until(int(2e8))
        assert node.stop(signal.SIGTERM) == 0
    first, second = BagReader(tmp_path / 'bag'), BagReader(tmp_path / 'bag_1')
    with first, second:
        assert first.end_time >= before
        assert second.start_time == 0 and second.end_time < first.end_time + 10**9
        for bag, size in ((first, '[4, 3, 3]'), (second, '[2, 2, 2]')):
            assert f'size: {size}' in bag.custom['scene']
            assert bag.custom['failure'] == bag.custom['proximity'] == 'none'
            assert bag.custom['wrenches_dropped'] == '0'
            times = [time for _, time, _ in bag.messages(['/icofabric/poses'])]
            assert times == sorted(times) and times[0] == 0
        assert 'marker_rate: 4.0' in second.custom['scene']
        weaves = [decode_string(data) for _, _, data in first.messages(['/icofabric/weave'])]
        assert ['size: [4, 3, 3]' in text for text in weaves] == [True, False, False]
    assert not (tmp_path / 'bag_2').exists()


def test_kill_loses_the_last_second_at_most(tmp_path):
    """Three recordings of a tiny scene, killed at three moments; MCAP."""
    moments = (1.1, 1.4, 1.8)  # s; 0.5 s between flushes
    parameters = {'weave.size': '[2, 2, 1]', 'contact.mode': 'never'}
    nodes = [NodeProcess(tmp_path / f'log{k}', offset=k,
                         parameters={**parameters, 'record.path': tmp_path / f'bag{k}'})
             for k in range(len(moments))]
    clients = [Client(node, offset=k) for k, node in enumerate(nodes)]
    try:
        for client in clients:
            client.listen('/clock')
        starts = [client.clock for client in clients]
        for k in range(len(moments)):
            clients[k].wait_until(max(starts) + int(moments[k] * 1e9))
            nodes[k].send(signal.SIGKILL)
            nodes[k].wait()
        for k, client in enumerate(clients):
            published = client.received['/clock'][-1]
            report = recover_bag(tmp_path / f'bag{k}', tmp_path / f'whole{k}')
            assert report.damage
            with BagReader(tmp_path / f'whole{k}') as bag:
                times = [decode_clock(data) for _, _, data in bag.messages(['/clock'])]
                assert 'size: [2, 2, 1]' in bag.custom['scene']
                assert bag.topics['/icofabric/poses'].message_count > 10
            assert times == [n * 10**7 for n in range(len(times))]
            print(f'killed at {published / 1e9:.2f} s, lost {(published - times[-1]) / 1e9:.2f} s')
            # At a real-time factor of 1 a second of simulated time takes at least a second.
            assert published - times[-1] <= 10**9
    finally:
        for client in clients:
            client.close()
        for node in nodes:
            node.__exit__(None, None, None)


def test_sqlite3_warns_and_is_whole_after_an_interrupt(tmp_path):
    parameters = {'record.path': tmp_path / 'bag', 'record.storage': 'sqlite3',
                  'weave.size': '[2, 2, 1]'}
    with NodeProcess(tmp_path / 'log', parameters=parameters) as node, Client(node) as client:
        client.wait_until(int(1e8))
        assert node.stop() == 0
        lines = node.lines('record.storage')
    assert len(lines) == 1 and '[WARN]' in lines[0] and 'killed' in lines[0]
    with BagReader(tmp_path / 'bag') as bag:
        assert bag.topics['/icofabric/poses'].message_count > 5


def test_wait_for_reports(tmp_path):
    """A condition that never holds fails with its name, not with a hang."""
    with pytest.raises(pytest.fail.Exception, match='no such thing within'):
        wait_for(lambda: False, 'such thing', limit=0.01)
