# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Lockstep: `~/advance` from another process, with wrenches before it and services beside it."""
import json
import time

from icofabric_sim.bag import BagReader
from icofabric_sim.messages import decode_string, decode_wrench_stamped, WrenchStampedBytes
from rclpy.duration import Duration
from ros_helpers import Client, NodeProcess, write_scene

SCENE = {
    'weave': {'size': [3, 3, 3]},
    'contact': {'mode': 'never'},
    'drag': {'linear': 0.05},
    'groups': {'tip': 'x_max', 'rest': 'not x_max'},
    'loads': {'tip': {'group': 'tip'}, 'rest': {'group': 'rest'}},
    'solver': {'step': 1e-4},
    'start_paused': True,
    'advance_duration': 0.004,
}
DURATION = 4_000_000  # ns
BURST = 900  # more than the node takes at once, and fewer than its queue holds


def reached(answer):
    """Time [ns] in the answer of a service that went well."""
    assert answer.success, answer.message
    return round(float(answer.message.partition(', t = ')[2].removesuffix(' s')) * 1e9)


def force_of(number):
    """Message with a force that tells its number; its bytes are sent faster than objects."""
    message = WrenchStampedBytes('')
    message.force[:] = 0.0, 0.0, 1e-7 * number
    message.torque[:] = 0.0
    return message.stamped(0)


def test_acknowledged_wrenches_act_before_the_advance(client, folder):
    """Under load: bursts on two channels and other requests, before and while time advances."""
    client.set(record__path=str(folder / 'bag'))
    assert client.call('~/record', 'std_srvs/srv/SetBool', data=True).success
    channels = ('~/loads/tip', '~/loads/rest')
    publishers = [client.publisher(channel) for channel in channels]
    start = reached(client.call('~/clear_loads'))
    rounds = 12
    for number in range(1, rounds + 1):
        burst = [force_of(number * BURST + count) for count in range(BURST)]
        for data in burst:
            for publisher in publishers:
                publisher.publish(data)
        others = [client.begin('~/get_parameters', 'rcl_interfaces/srv/GetParameters',
                               names=['step_count']) for _ in range(5)]
        for publisher in publishers:
            assert publisher.wait_for_all_acked(Duration(seconds=30))
        assert reached(client.call('~/advance')) == start + number * DURATION
        for other in others:
            client.wait_for(other.done, 'another answer')
    assert client.call('~/record', 'std_srvs/srv/SetBool', data=False).success
    last, found = {}, []
    with BagReader(folder / 'bag') as bag:
        for name, _, data in bag.messages(
                ['/icofabric/events', *(topic.replace('~', '/icofabric') for topic in channels)]):
            if name.endswith('/events'):
                if json.loads(decode_string(data))['event'] == 'advance':
                    found.append(dict(last))
            else:
                last[name] = round(decode_wrench_stamped(data).first[2] * 1e7)
    wanted = {topic.replace('~', '/icofabric') for topic in channels}
    assert found == [dict.fromkeys(wanted, number * BURST + BURST - 1)
                     for number in range(1, rounds + 1)]


def test_state_of_the_end_is_published(client):
    poses = client.listen('~/poses')
    client.wait_for(lambda: poses, 'poses')
    for _ in range(3):
        end = reached(client.call('~/advance'))
        client.wait_for(
            lambda end=end: poses[-1].nanoseconds == end, 'the poses of that time')


def test_others_are_answered_meanwhile_and_a_pause_ends_it(client):
    client.set(advance_duration=1e6)
    before = client.clock
    future = client.begin('~/advance', 'std_srvs/srv/Trigger')
    client.wait_for(lambda: client.clock > before, 'time that goes on')
    longest = 0.0
    for _ in range(20):
        began = time.monotonic()
        assert client.get('step_count') == [1]
        assert client.call('~/save_checkpoint').message
        longest = max(longest, time.monotonic() - began)
    print(f'\nlongest answer beside an advance: {longest:.3f} s')
    assert not future.done()
    client.pause()
    client.wait_for(future.done, 'the answer of ~/advance')
    answer = future.result()
    assert not answer.success and 'advanced by' in answer.message
    assert 'ended by a pause' in answer.message
    future = client.begin('~/advance', 'std_srvs/srv/Trigger')
    client.settle()
    assert client.call('~/reset').success
    client.wait_for(future.done, 'the answer of ~/advance')
    assert not future.result().success and 'ended by a reset' in future.result().message
    client.set(advance_duration=0.004)


def test_bad_durations_are_refused(client):
    for value in (0.0, -1.0, 1e-10, float('nan'), 1e300):
        [result] = client.set_each(advance_duration=value)
        assert not result.successful and 'advance_duration' in result.reason
    assert client.call('~/advance').success


def test_loads_are_cleared(client):
    client.push('~/loads/tip', (0.0, 0.0, 1e-3))
    client.push('~/wrench', (0.0, 0.0, 1e-3), frame='icosahedron_0')
    client.settle()
    client.health(lambda status: status.values['loads active'] == '2')
    assert client.call('~/clear_loads').success
    client.health(lambda status: status.values['loads active'] == '0')


def test_end_of_the_node_is_told(tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    with NodeProcess(tmp_path / 'log', scene=scene, parameters={'advance_duration': 1e6},
                     offset=1) as node, Client(node, offset=1) as client:
        future = client.begin('~/advance', 'std_srvs/srv/Trigger')
        client.wait_for(lambda: float(client.health().values['steps']) > 0, 'steps')
        assert node.stop() == 0
        client.wait_for(future.done, 'the last answer', limit=5)
        assert not future.result().success
        assert 'the run has ended' in future.result().message
