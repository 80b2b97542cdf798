# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The node from the outside: topics, time, pause, step and reset, in a process of its own."""
from fractions import Fraction

import icofabric_sim as ico
from icofabric_sim.messages import OK, WARN
from icofabric_sim.messages.markers import OBSTRUCTED
from icofabric_sim.messages.topics import STRAIN_CLASSES, TF, TOPICS
import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from ros_helpers import Client, reasons

STEP = 0.0002  # s
# Falls and swings at one end; slower than real time, so that a busy machine keeps up too.
SCENE = {
    'weave': {'size': [5, 3, 3]},
    'gravity': [0.0, 0.0, -9.81],
    'groups': {'wall': 'x_min', 'tip': 'x_max'},
    'supports': {'wall': {'group': 'wall'}},
    'solver': {'step': STEP},
    'contact': {'mode': 'never'},
    'real_time_factor': 0.5,
}
ADD, DELETEALL, LINE_LIST = 0, 3, 5  # visualization_msgs/Marker


@pytest.fixture(scope='module')
def scene():
    return ico.Scene.from_parameters(SCENE)


@pytest.fixture
def paused(client):
    time = client.pause()
    client.wait_for(lambda: client.clock == time, 'the clock at rest')
    yield client
    client.pause(False)


def test_types_and_quality_of_topics(client):
    for name, type_name, *_ in [topic for topic in TOPICS if topic is not TF]:
        topic = name.replace('~', '/icofabric')
        found = client.wait_for(
            lambda topic=topic: client.node.get_publishers_info_by_topic(topic), topic)
        assert [info.topic_type for info in found] == [type_name]
        assert found[0].qos_profile.reliability == ReliabilityPolicy.RELIABLE
        latched = found[0].qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        assert latched == (topic.rpartition('/')[2] in ('weave', 'broken', 'bodies'))
    assert not client.node.get_publishers_info_by_topic('/tf')  # without tf.group


def test_weave_reaches_a_late_joiner(client, scene, tmp_path):
    text = client.next('~/weave', latched=True)
    (tmp_path / 'weave.yaml').write_text(text)
    read = ico.load_scene(tmp_path / 'weave.yaml')
    assert dict(read.parameters) == dict(scene.parameters)
    assert (read.position == scene.position).all()


@pytest.mark.parametrize(
    ('topic', 'rate'), [('~/poses', 60), ('/clock', 100), ('~/connectors', 10)])
def test_stamps_lie_on_the_grid(client, topic, rate):
    """Output k carries round(k 1e9 / rate) ns."""
    kept = client.listen(topic)
    start = len(kept)
    client.wait_for(lambda: len(kept) > start + 20, topic)
    stamps = [item if isinstance(item, int) else item.nanoseconds for item in kept[start:]]
    for stamp in stamps:
        assert isinstance(stamp, int)
        assert stamp == round(Fraction(round(stamp * rate / 1e9) * 10**9, rate))
    if topic == '~/connectors':  # several messages of one stamp
        stamps = sorted(set(stamps))
    assert all(later > earlier for earlier, later in zip(stamps, stamps[1:]))


def test_poses_fall_from_the_scene(client, scene):
    pose = client.next('~/poses', lambda pose: pose.nanoseconds > 10**8)
    assert pose.frame_id == 'world' and pose.values.shape == (scene.body_count, 7)
    np.testing.assert_allclose(np.linalg.norm(pose.values[:, 3:], axis=1), 1.0, atol=1e-12)
    held, tip = scene.groups['wall'], scene.groups['tip']
    assert (pose.values[held, :3] == scene.position[held]).all()
    assert (pose.values[tip, 2] < scene.position[tip, 2] - 1e-4).all()


def test_state_is_labelled(client, scene):
    state = client.next('~/state')
    assert state.labels == (
        'body', 'position orientation_xyzw linear_velocity angular_velocity')
    assert state.values.shape == (scene.body_count, 13)
    assert (state.values[scene.groups['wall'], 7:] == 0.0).all()
    assert abs(state.values[:, 7:10]).max() > 1e-3


def test_connectors_are_lists_by_strain(client, scene):
    kept = client.listen('~/connectors')
    start = len(kept)
    # Whole sets only: the first may have been joined half way.
    client.wait_for(lambda: len({m.nanoseconds for m in kept[start:]}) > 3, 'markers')
    stamp = sorted({marker.nanoseconds for marker in kept[start:]})[1]
    markers = [m for m in kept[start:] if m.nanoseconds == stamp and m.action == ADD]
    assert 1 < len(markers) <= len(STRAIN_CLASSES) + 1
    assert len({marker.marker_id for marker in markers}) == len(markers)
    bounds = [entry.above for entry in STRAIN_CLASSES] + [np.inf]
    for marker in markers:
        assert (marker.namespace, marker.marker_type) == ('connectors', LINE_LIST)
        assert marker.frame_id == 'world' and marker.pose.tolist() == [0, 0, 0, 0, 0, 0, 1]
        assert marker.scale[0] > 0.0
        if marker.marker_id > len(STRAIN_CLASSES):
            np.testing.assert_allclose(marker.color, OBSTRUCTED.color, rtol=1e-6)
            continue
        np.testing.assert_allclose(
            marker.color, STRAIN_CLASSES[marker.marker_id].color, rtol=1e-6)
        length = np.linalg.norm(marker.points[::2] - marker.points[1::2], axis=1)
        strain = length / scene.connectors.natural_length - 1.0
        assert (strain >= bounds[marker.marker_id] - 1e-9).all()
        assert (strain <= bounds[marker.marker_id + 1] + 1e-9).all()
    assert sum(len(marker.points) for marker in markers) == 2 * scene.connector_count
    assert any(marker.marker_id < len(STRAIN_CLASSES) for marker in markers)


def test_diagnostics_name_the_node_and_its_figures(client, scene):
    status = client.health(lambda status: float(status.values['real-time factor']) > 0.0)
    assert status.name == '/icofabric' and status.hardware_id == 'icofabric_sim'
    values = status.values
    assert values['bodies'] == str(scene.body_count)
    assert values['connectors'] == str(scene.connector_count)
    assert float(values['step [s]']) == STEP
    assert values['target real-time factor'] == '0.5'
    assert values['wrenches dropped'] == '0' and values['loads active'] == '0'
    assert float(values['stability margin']) > 1.0
    assert {'simulated time [s]', 'stability limit [s]', 'steps', 'proximity'} <= values.keys()


def test_diagnostics_follow_a_pause(paused):
    # A floppy fabric, whose connectors may end in shells: then that is said instead.
    status = paused.health(lambda status: status.message == 'paused' or (
        status.level == WARN and float(status.values['simulated time [s]']) * 1e9 == pytest.approx(
            paused.clock, abs=0.5)))
    assert status.level == OK or 'at the last health check' in reasons(status)
    assert float(status.values['simulated time [s]']) * 1e9 == pytest.approx(paused.clock, abs=0.5)


def test_another_node_follows_the_clock(client):
    """A node with use_sim_time has our time, to the nanosecond when it stands still."""
    use_sim_time = Parameter('use_sim_time', value=True)
    with client.another_node('follower', parameter_overrides=[use_sim_time]) as follower:
        def now():
            return follower.get_clock().now().nanoseconds

        first = client.wait_for(now, 'simulated time of a follower')
        client.wait_for(lambda: now() > first, 'the clock of a follower')
        client.pause()
        # Repeated while the fabric is paused: a follower that comes now gets a time too.
        client.next('/clock')
        client.wait_for(lambda: now() == client.clock, 'the same time')
        client.pause(False)


def test_paused_fabric_shows_itself_to_late_joiners(paused, node, scene):
    time = paused.clock
    with Client(node) as late:
        pose = late.next('~/poses')
        assert pose.values.shape == (scene.body_count, 7)
        late.next('~/connectors')
        assert late.next('~/weave', latched=True).startswith('/**:')
        assert late.next('~/poses').nanoseconds == pose.nanoseconds == late.clock
    assert paused.clock == time


def test_pause_stops_the_motion(client):
    time = client.pause()
    first = client.next('~/poses', lambda pose: pose.nanoseconds == time)
    second = client.next('~/poses')
    assert second.nanoseconds == time
    assert (second.values == first.values).all()
    assert client.pause(False) == time
    client.next('~/poses', lambda pose: pose.nanoseconds > first.nanoseconds)


def test_step_is_refused_while_running(client):
    answer = client.call('~/step')
    assert not answer.success
    assert '~/pause' in answer.message


def test_step_takes_step_count_steps(paused):
    # The first step ends one that the pause broke off: after it, steps are whole.
    assert paused.call('~/step').success
    poses = paused.listen('~/poses')
    before = paused.next('~/poses').nanoseconds
    paused.set(step_count=7)
    answer = paused.call('~/step')
    assert answer.success and answer.message.startswith('7 solver steps taken, t = ')
    paused.wait_for(lambda: poses[-1].nanoseconds > before, 'the state after the steps')
    paused.set(step_count=1)
    # A nanosecond is the finest time of a message.
    assert abs(poses[-1].nanoseconds - before - 7 * STEP * 1e9) <= 1


def test_reset_goes_back_to_the_initial_state_and_clears_markers(paused, scene):
    markers = paused.listen('~/connectors')
    time, known = paused.clock, len(markers)
    answer = paused.call('~/reset')
    assert answer.success and 'initial state' in answer.message
    pose = paused.next('~/poses')
    assert (pose.values[:, :3] == scene.position).all()
    assert (pose.values[:, 3:] == scene.orientation).all()
    assert pose.nanoseconds >= time
    paused.wait_for(
        lambda: DELETEALL in [marker.action for marker in markers[known:]], 'DELETEALL')
    actions = [marker.action for marker in markers[known:]]
    cleared = actions.index(DELETEALL)
    paused.wait_for(
        lambda: ADD in [marker.action for marker in markers[known + cleared:]],
        'markers after DELETEALL')


def test_reset_of_time(client):
    client.wait_until(10**8)
    client.set(reset_time=True)
    client.pause()
    answer = client.call('~/reset')
    assert answer.success and answer.message.endswith('t = 0.000000000 s')
    client.wait_for(lambda: client.clock == 0, 'time 0')
    client.set(reset_time=False)
    client.pause(False)
    client.next('~/poses', lambda pose: 0 < pose.nanoseconds < 10**8)


def test_nothing_to_complain_about(node):
    # But for connectors that enter a shell as the fabric folds.
    told = [line for line in node.lines('[WARN]') if 'connector.obstruction' not in line]
    assert not node.lines('[ERROR]') and not told
