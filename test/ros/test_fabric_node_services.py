# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Services of the node: recording, checkpoints, and answers that do not delay others."""
import json
import re
import time

from icofabric_sim.bag import BagReader
from icofabric_sim.messages import decode_string
from icofabric_sim.ros.answers import MAX_PENDING_REQUESTS
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
import numpy as np
import pytest
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from ros_helpers import Client, NodeProcess, ros_class, write_scene
from std_srvs.srv import Trigger

STEP = 1e-4  # s
SCENE = {
    'weave': {'size': [3, 3, 3]},
    'contact': {'mode': 'never'},
    'initial_random': {'velocity_sigma': 0.05, 'spin_sigma': 1.0, 'seed': 4},
    'groups': {'tip': 'x_max'},
    'loads': {'tip': {'group': 'tip'}},
    'solver': {'step': STEP},
    'start_paused': True,
    'reset_time': True,
}


@pytest.fixture(scope='module')
def graph(graph):
    graph.listen('~/poses')
    return graph


@pytest.fixture
def client(graph):
    graph.pause()
    assert graph.call('~/reset').success
    yield graph
    graph.pause()


def record(client, on=True):
    answer = client.call('~/record', 'std_srvs/srv/SetBool', data=on)
    assert answer.success, answer.message
    return answer.message


def steps(client, count):
    """The state after `count` steps: stamp, and poses as bytes."""
    client.set(step_count=count)
    poses = client.received['/icofabric/poses']
    answer = client.call('~/step')
    assert answer.success, answer.message
    end = round(float(answer.message.partition(', t = ')[2].removesuffix(' s')) * 1e9)
    pose = client.wait_for(
        lambda: next((pose for pose in reversed(poses) if pose.nanoseconds == end), None), 'poses')
    return end, pose.values.tobytes()


def test_a_paused_fabric_without_forces_comes_to_rest_where_its_connectors_are_unstrained(client):
    steps(client, 50)
    answer = client.call('~/solve_equilibrium')
    assert answer.success and 'equilibrium, with mechanisms' in answer.message, answer.message
    end, poses = steps(client, 10)
    assert steps(client, 10)[0] > end
    again = steps(client, 10)[1]
    moved = np.frombuffer(again).reshape(-1, 7) - np.frombuffer(poses).reshape(-1, 7)
    assert abs(moved).max() < 1e-12  # 20 steps at 0.05 m/s would be 1e-4 m
    client.call('~/pause', 'std_srvs/srv/SetBool', data=False)
    refused = client.call('~/solve_equilibrium')
    assert not refused.success and 'pause it first' in refused.message


def test_least_resultants_are_what_the_scene_says(client):
    steps(client, 5)
    client.set(equilibrium__objective='resultants')
    answer = client.call('~/solve_equilibrium')
    client.set(equilibrium__objective='energy')
    assert answer.success and re.match(
        r'equilibrium, with mechanisms, residual \S+, the largest resultants left are \S+ N on '
        r'body \d+ and \S+ N m on body \d+, t = ', answer.message), answer.message


def test_what_was_sent_before_a_reset_or_a_step_acts_before_it(client):
    """Topics and services have no common order: a request overtakes what is acknowledged."""
    still = steps(client, 20)
    assert client.call('~/reset').success
    publisher = client.publisher('~/loads/tip')
    wrench = ros_class('geometry_msgs/msg/WrenchStamped')()
    wrench.wrench.force.y = 0.5
    for _ in range(10):
        for _ in range(900):
            publisher.publish(wrench)
        assert publisher.wait_for_all_acked(Duration(seconds=60))
        assert client.call('~/reset').success
        assert steps(client, 20) == still
        assert client.call('~/reset').success
    client.push('~/loads/tip', (0.0, 0.5, 0.0))
    assert publisher.wait_for_all_acked(Duration(seconds=60))
    pushed = steps(client, 20)
    assert pushed[0] == still[0] and pushed[1] != still[1]


def test_nothing_to_record_to(client):
    answer = client.call('~/record', 'std_srvs/srv/SetBool', data=True)
    assert not answer.success
    assert 'record.path' in answer.message and '/icofabric' in answer.message
    answer = client.call('~/record', 'std_srvs/srv/SetBool', data=False)
    assert answer.success and 'not active' in answer.message


def test_nowhere_to_keep_checkpoints(client):
    for service in ('~/save_checkpoint', '~/restore_checkpoint'):
        answer = client.call(service)
        assert not answer.success
        assert 'checkpoint.path' in answer.message and 'record.path' in answer.message


def test_record_on_and_off(client, folder):
    client.set(record__path=str(folder / 'bag'))
    assert str(folder / 'bag') in record(client)
    steps(client, 5)
    status = client.health(lambda status: status.values['recording'] == str(folder / 'bag'))
    assert float(status.values['recorder lag [s]']) >= 0.0
    assert 'closed' in record(client, on=False)
    client.health(lambda status: status.values['recording'] == 'no')
    assert str(folder / 'bag_1') in record(client)
    record(client, on=False)
    with BagReader(folder / 'bag') as bag:
        events = [json.loads(decode_string(data)) for _, _, data
                  in bag.messages(['/icofabric/events'])]
        assert [event['event'] for event in events][-1] == 'record'
        assert 'step' in [event['event'] for event in events]
        assert bag.topics['/icofabric/poses'].message_count >= 2


def test_checkpoint_goes_back_to_the_same_bits(client, folder):
    client.set(checkpoint__path=str(folder / 'saved'))
    client.push('~/loads/tip', (0.0, 0.02, 0.0))
    client.settle()
    steps(client, 7)
    answer = client.call('~/save_checkpoint')
    assert answer.success and answer.message == f'saved to {folder / "saved" / "1.checkpoint"}'
    saved = Checkpoint.load(folder / 'saved' / '1.checkpoint')
    assert saved.header['time'] == pytest.approx(7 * STEP)
    onward = steps(client, 30)
    answer = client.call('~/restore_checkpoint')
    assert answer.success and str(folder / 'saved' / '1.checkpoint') in answer.message
    assert answer.message.endswith(f't = {7 * STEP:.9f} s')
    assert steps(client, 30) == onward
    # The second one is another file, and the one that is restored.
    assert client.call('~/save_checkpoint').message.endswith('2.checkpoint')
    assert client.call('~/reset').success
    assert client.call('~/restore_checkpoint').message.endswith(f't = {onward[0] / 1e9:.9f} s')


def test_checkpoint_in_one_file(client, folder):
    path = folder / 'one' / 'last.checkpoint'
    client.set(checkpoint__path=str(path))
    answer = client.call('~/restore_checkpoint')
    assert not answer.success and str(path) in answer.message
    for count in (3, 4):
        time, _ = steps(client, count)
        assert client.call('~/save_checkpoint').message == f'saved to {path}'
    assert client.call('~/restore_checkpoint').message.endswith(f't = {time / 1e9:.9f} s')
    assert [file.name for file in path.parent.iterdir()] == ['last.checkpoint']


def test_checkpoint_that_is_none(client, folder, node):
    """Refused with the reason, and the run is as it was."""
    path = folder / 'broken.checkpoint'
    path.write_bytes(b'\x80\x05nonsense' * 100)
    client.set(checkpoint__path=str(path))
    before, _ = steps(client, 2)
    answer = client.call('~/restore_checkpoint')
    assert not answer.success and 'broken.checkpoint' in answer.message
    assert client.clock == before
    client.set(checkpoint__path='/proc/nowhere')
    answer = client.call('~/save_checkpoint')
    assert not answer.success and 'checkpoint.path' in answer.message
    assert 'Traceback' not in node.log()


def test_checkpoint_of_another_scene(client, folder):
    client.set(checkpoint__path=str(folder / 'other.checkpoint'))
    assert client.call('~/save_checkpoint').success
    client.set(connector__stiffness=600.0)
    client.health(lambda status: float(status.values['simulated time [s]']) >= 0.0)

    def refused():
        answer = client.call('~/restore_checkpoint')
        return not answer.success and 'stiffness' in answer.message

    client.wait_for(refused, 'refusal of a checkpoint of another scene')
    client.set(connector__stiffness=500.0)
    client.wait_for(lambda: client.call('~/restore_checkpoint').success, 'the first scene again')


def test_nobody_waits_for_steps_of_others(client):
    """Parameters and other services answer while steps are taken; a pause ends these."""
    client.set(step_count=1_000_000)
    began = client.clock
    future = client.begin('~/step', 'std_srvs/srv/Trigger')
    client.wait_for(lambda: float(client.health().values['steps']) > 0, 'steps')
    assert client.get('step_count') == [1_000_000]
    client.set(step_count=3)
    assert not future.done()
    refused = client.call('~/save_checkpoint')
    assert refused.success or 'checkpoint' in refused.message
    assert not future.done()
    client.pause()
    client.wait_for(future.done, 'the answer of ~/step')
    answer = future.result()
    assert not answer.success
    assert 'of 1000000 solver steps taken: ended by a pause' in answer.message
    client.wait_for(lambda: client.clock > began, 'the time that was reached')


def test_too_many_requests_are_refused(client):
    # A million steps may be done before all have asked; this is not.
    client.set(advance_duration=1e6)
    began = client.clock
    futures = [client.begin('~/advance', 'std_srvs/srv/Trigger')]
    client.wait_for(lambda: client.clock > began, 'the advance')

    def refused():
        return [future.result() for future in futures if future.done()]

    def are_refused():
        # Few at once: the queue of this client is short, and what it has no room for is lost.
        if len(refused()) < 40:
            futures.extend(client.begin('~/step', 'std_srvs/srv/Trigger') for _ in range(4))
            client.settle()
        return len(refused()) >= 40

    client.wait_for(are_refused, 'refusals')
    client.settle()
    assert len(futures) - len(refused()) >= MAX_PENDING_REQUESTS
    for answer in refused():
        assert not answer.success and f'{MAX_PENDING_REQUESTS} requests are' in answer.message
    # The parameter services do not wait, and neither does what was begun.
    client.set(step_count=1)
    assert client.get('step_count') == [1]
    assert len(futures) - len(refused()) >= MAX_PENDING_REQUESTS


def test_a_burst_of_calls_is_answered(client):
    caller = client.node.create_client(
        Trigger, '/icofabric/clear_loads', qos_profile=QoSProfile(depth=1000))
    try:
        client.wait_for(caller.service_is_ready, 'service')
        futures = [caller.call_async(Trigger.Request()) for _ in range(160)]
        client.wait_for(lambda: all(future.done() for future in futures),
                        lambda: f'{sum(not future.done() for future in futures)} answers')
        assert all(future.result().success for future in futures)
    finally:
        client.node.destroy_client(caller)


def test_end_of_the_node_is_told_to_those_who_wait(tmp_path):
    scene = write_scene(tmp_path / 'scene.yaml', SCENE)
    with NodeProcess(tmp_path / 'log', scene=scene, parameters={'step_count': 10**6},
                     offset=1) as node, Client(node, offset=1) as client:
        future = client.begin('~/step', 'std_srvs/srv/Trigger')
        client.wait_for(lambda: float(client.health().values['steps']) > 0, 'steps')
        began = time.monotonic()
        assert node.stop() == 0
        print(f'\nthe node ended within {time.monotonic() - began:.2f} s')
        client.wait_for(future.done, 'the last answer', limit=5)
        assert not future.result().success
        assert 'the run has ended' in future.result().message
