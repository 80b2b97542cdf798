# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""replay_node from the outside: a process of its own, and a client in another."""
import asyncio
import os
import signal
import subprocess
import sys
from types import SimpleNamespace

from driven_runs import Drive, in_order, lively_scene, random_pushes
from icofabric_sim import messages
from icofabric_sim.bag import BagReader
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.messages import ERROR, MarkerAction, OK
from icofabric_sim.messages.topics import ENERGIES
from icofabric_sim.parameters.text import dump_parameters
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from recorded_runs import FORCE, record_push, swing_scene
from replay_bags import END, NODE, pose, POSE_TIMES, RECORDS, SECOND, STORAGES, write_bag
import ros_helpers
from ros_helpers import Client, domain, NodeProcess, ROOT

ros_helpers.DECODERS['geometry_msgs/msg/WrenchStamped'] = messages.decode_wrench_stamped
ros_helpers.TYPES.update({
    f'{NODE}/loads/tip': 'geometry_msgs/msg/WrenchStamped',
    f'{NODE}/events': 'std_msgs/msg/String',
    '/replay/other/poses': 'geometry_msgs/msg/PoseArray',
})


class ReplayProcess(NodeProcess):
    """`replay_node` in a process of its own."""

    MODULE = 'icofabric_sim.ros.replay_node'
    READY = ': playing '

    def __init__(self, log_path, bag, *arguments, **parameters):
        super().__init__(
            log_path, *arguments, parameters={'bag': bag, 'fabric': NODE, **parameters})


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp('bag') / 'run')


def stamps(poses):
    return [pose.nanoseconds for pose in poses]


@pytest.mark.parametrize('storage', STORAGES)
def test_a_run_is_played_to_its_end(tmp_path, storage):
    """Every message arrives, with the clock, and the node ends with the bag."""
    bag = write_bag(tmp_path / 'bag', storage=storage)
    with ReplayProcess(tmp_path / 'log', bag, start_paused=True) as node, Client(node) as client:
        poses, clock = client.listen('~/poses'), client.listen('/clock')
        energy, markers = client.listen('~/energy'), client.listen('~/connectors')
        events = client.listen('~/events')
        weave = client.listen('~/weave', latched=True)
        client.wait_for(lambda: poses and clock and energy and markers and weave, 'the start')
        assert stamps(poses)[0] == 0 and clock[0] == 0 and weave == ['first']
        assert client.pause(False) == 0
        client.wait_for(lambda: POSE_TIMES[-1] in stamps(poses), 'the last poses')
        assert node.wait() == 0
        assert 'Traceback' not in node.log()
        played = stamps(poses)
        assert sorted(set(played)) == POSE_TIMES and played == sorted(played)
        assert clock == sorted(clock) and clock[-1] == END
        assert {k * SECOND // 100 for k in range(201)} <= set(clock)
        assert len({float(item.values[0]) for item in energy}) == 101
        assert weave == ['first', 'second'] and events[-1] == 'pause'
        assert sum(item.action == MarkerAction.DELETEALL for item in markers) == 1
        for item in poses:
            assert item.values.tobytes() == messages.decode_pose_array(
                pose(item.nanoseconds)).values.tobytes()


def test_late_joiners_of_a_paused_replay_see_its_state(tmp_path, bag):
    options = {'start_paused': True, 'start_offset': 1.25}
    with ReplayProcess(tmp_path / 'log', bag, **options) as node, Client(node) as first:
        assert first.next('~/poses').nanoseconds == POSE_TIMES[62]
        with Client(node) as late:
            assert late.next('~/weave', latched=True) == 'second'
            assert late.next('~/poses').nanoseconds == POSE_TIMES[62]
            assert late.next('~/connectors').nanoseconds == 1_200_000_000
            assert late.next('~/energy').values[0] == POSE_TIMES[62]
            assert late.clock == 1_250_000_000
            status = late.health()
        assert status.name == NODE and status.level == OK
        assert status.message == 'paused in a recorded run'
        assert status.values['recorded time [s]'] == '1.250000000'
        assert status.values['recorded message'] == 'shells overlap'
        assert node.stop(signal.SIGTERM) == 0


def test_services_and_parameters(tmp_path, bag):
    with ReplayProcess(tmp_path / 'log', bag, '-p', 'start_paused:=true', stay=True) as node, \
            Client(node) as client:
        poses, clock = client.listen('~/poses'), client.listen('/clock')
        weave = client.listen('~/weave', latched=True)
        markers = client.listen('~/connectors')
        client.wait_for(lambda: poses and clock and weave and markers, 'the start')

        # From frame to frame.
        answers = [client.call('~/step') for _ in range(3)]
        assert [answer.message for answer in answers] == [
            f'stepped to the next poses, t = 0.0{k}0000000 s' for k in (2, 4, 6)]
        client.wait_for(lambda: POSE_TIMES[3] in stamps(poses), 'the third step')
        assert set(stamps(poses)) == set(POSE_TIMES[:4]) and clock[-1] == POSE_TIMES[3]

        # To any time, and back: the clock jumps, and old markers are removed.
        del markers[:]
        client.set(seek=1.5)
        client.wait_for(lambda: POSE_TIMES[75] in stamps(poses) and len(markers) > 2, 'the seek')
        assert markers[0].action == MarkerAction.DELETEALL
        client.wait_for(lambda: weave == ['first', 'second'], 'the later scene')
        answer = client.call('~/reset')
        assert answer.success and answer.message == 'reset to the start, t = 0.000000000 s'
        client.wait_for(lambda: clock[-1] == 0 and stamps(poses)[-1] == 0, 'the start again')
        client.wait_for(lambda: weave == ['first', 'second', 'first'], 'the first scene')

        # Refusals, in words.
        refused = client.set_each(
            seek=2.5, rate=-1.0, loop=3, start_offset=1.0, nonsense=1, stay=False)
        assert [item.successful for item in refused] == [False] * 5 + [True]
        words = [item.reason for item in refused[:5]]
        for text, part in zip(words, (
                'seek: 2.500000000 s is not in the bag, which goes from 0.000000000 s to 2.0000',
                'rate must lie in 0 to 1e+06, got -1.0', 'loop must be true or false, got 3',
                'start_offset cannot be changed while', "unknown parameter 'nonsense'")):
            assert part in text
        message = ParameterMessage(name='rate')
        message.value.type = 99
        assert not client.set_messages([message])[0].successful
        client.set(stay=True, rate=0)  # integers are accepted where a float is meant
        assert client.get('rate', 'stay', 'bag') == [0.0, True, str(bag)]

        # On to the end, where it stays.
        assert client.pause(False) == 0
        running = client.call('~/step')
        assert not running.success and 'only while paused' in running.message
        client.health(lambda status: status.message == 'at the end of the recorded run')
        client.wait_for(lambda: clock[-1] == END and stamps(poses)[-1] == END, 'the end')
        client.set(seek=0.5, rate=1.0)
        client.next('/clock', lambda time: SECOND // 2 < time < END)
        assert node.stop() == 0


def test_loop_jumps_back_and_can_be_ended(tmp_path, bag):
    options = {'loop': True, 'start_offset': 1.5, 'rate': 4.0}
    with ReplayProcess(tmp_path / 'log', bag, **options) as node, Client(node) as client:
        clock, poses = client.listen('/clock'), client.listen('~/poses')

        def jumps():
            return [k for k in range(1, len(clock)) if clock[k] < clock[k - 1]]

        client.wait_for(lambda: len(jumps()) >= 2, 'two loops')
        client.set(loop=False)
        assert node.wait() == 0
        assert {clock[k] for k in jumps()} == {1_500_000_000} and END in clock
        assert set(stamps(poses)) == set(POSE_TIMES[75:])


def test_in_a_namespace_with_the_inputs_and_another_clock(tmp_path, bag):
    """Beside a live fabric: other names, no clock; use_sim_time changes nothing."""
    options = {'inputs': True, 'publish_clock': False, 'loop': True, 'use_sim_time': True}
    names = ('-r', '__ns:=/replay', '-r', '__node:=other',
             '-r', '~/loads/tip:=/icofabric/loads/tip')
    with ReplayProcess(tmp_path / 'log', bag, *names, **options) as node, \
            Client(node) as client:
        poses, wrenches = client.listen('/replay/other/poses'), client.listen('~/loads/tip')
        client.wait_for(lambda: len(poses) > 20, 'poses')
        client.wait_for(lambda: wrenches, 'the recorded wrench')
        assert not client.node.get_publishers_info_by_topic('/clock')
        assert client.node.get_publishers_info_by_topic('/icofabric/poses') == []
        assert client.health().name == '/replay/other'
        assert node.stop() == 0


def test_recorded_inputs_push_a_live_fabric(tmp_path):
    """Only where that is asked for, and through a renaming."""
    scene = swing_scene()
    record_push(tmp_path / 'bag', scene)
    (tmp_path / 'scene.yaml').write_text(dump_parameters(dict(scene.parameters)))
    live = {'record.path': tmp_path / 'live', 'real_time_factor': 1.0, 'duration': 0.0}
    aside = ('-r', '__node:=replay', '-r', '~/loads/tip:=/icofabric/loads/tip')
    with NodeProcess(tmp_path / 'log', scene=tmp_path / 'scene.yaml', parameters=live) as fabric, \
            Client(fabric) as client:
        worked = list(ENERGIES).index('work in')
        assert client.next('~/energy').values[worked] == 0.0
        with ReplayProcess(tmp_path / 'replay_log', tmp_path / 'bag', *aside, inputs=True,
                           publish_clock=False, loop=True) as replay:
            # As often as it takes them to find each other.
            client.next('~/energy', lambda energy: energy.values[worked] != 0.0)
            assert replay.stop() == 0
        assert fabric.stop() == 0
    with RecordedRun(tmp_path / 'live') as run:
        acted = run.inputs()
    assert {tuple(entry.force) for entry in acted} <= {FORCE, (0.0, 0.0, 0.0)}
    assert FORCE in [tuple(entry.force) for entry in acted]
    assert {entry.topic for entry in acted} == {f'{NODE}/loads/tip'}


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_in_order(tmp_path, bag, number):
    with ReplayProcess(tmp_path / 'log', bag, loop=True) as node, Client(node) as client:
        client.next('~/poses')
        assert node.stop(number) == 0


def test_damage_is_told_and_is_a_status_of_its_own(tmp_path):
    large = [(time, f'{NODE}/poses', pose(time, 400)) for time in POSE_TIMES]
    write_bag(tmp_path / 'bag', large)
    (file,) = (tmp_path / 'bag').glob('*.mcap')
    data = bytearray(file.read_bytes())
    place = data.index(large[-1][2]) - 40
    data[place:place + 40] = b'\xff' * 40
    file.write_bytes(data)
    with ReplayProcess(tmp_path / 'log', tmp_path / 'bag', start_paused=True) as node, \
            Client(node) as client:
        client.listen('/diagnostics')
        client.pause(False)
        assert node.wait() == 1
        assert 'Traceback' not in node.log()
        assert node.lines('is damaged') and node.lines('[ERROR]')
        client.wait_for(
            lambda: client.received['/diagnostics'][-1][1][0].level == ERROR, 'the last report')


@pytest.fixture(scope='module')
def driven(tmp_path_factory):
    """A run of 0.7 s that was pushed at random, rewoven and stiffened in its first half."""
    path = tmp_path_factory.mktemp('driven') / 'run'
    scene = lively_scene(real_time_factor=0.0, duration=0.7)
    Drive(path, scene, in_order(
        random_pushes(seed=5, count=12, end=300),
        [(60, lambda drive: drive.change(connector__stiffness=350.0)),
         (110, lambda drive: drive.change(weave__size=[3, 3, 2])),
         (330, lambda drive: drive.push('tip', (0.0, 0.4, 0.0)))])).run()
    return path


@pytest.mark.parametrize('paused', [True, False])
def test_going_on_as_a_simulation(tmp_path, driven, paused):
    """From a recorded moment on the same bits as recorded, where nothing new happens."""
    moment = 345_678_901  # while the last push still acts
    with RecordedRun(driven) as run:
        assert 5 < len(run.inputs()) and max(item.nanoseconds for item in run.inputs()) < moment
        recorded = {time: data for name, time, data in run.messages(start=moment)
                    if name == '~/poses'}
    options = {'start_paused': True, 'record.path': tmp_path / 'more', 'rate': 0.2,
               'seek': moment / 1e9}
    with ReplayProcess(tmp_path / 'log', driven, **options) as node, Client(node) as client:
        poses, clock = client.listen('~/poses'), client.listen('/clock')
        client.wait_for(lambda: poses and clock, 'the replay')
        if not paused:
            client.pause(False)
        answer = client.call('~/continue')
        assert answer.success, answer.message
        told = round(float(answer.message.split('t = ')[1].removesuffix(' s')) * 1e9)
        assert told == moment if paused else moment <= told
        expected = {time: data for time, data in recorded.items() if time > told}
        assert len(expected) > 10
        client.wait_for(lambda: node.lines('ready: '), 'the simulation')
        client.set(real_time_factor=0.5)
        assert client.get('duration', 'record.path', 'weave.size') == [
            0.0, str(tmp_path / 'more'), [3, 3, 2]]
        if paused:
            client.pause(False)
        # All that a fabric_node does, it does.
        client.wait_until(max(expected) + 1)
        assert set(expected) <= {pose.nanoseconds for pose in poses}  # none is lost on the way
        client.set(step_count=3)
        client.pause()
        assert client.call('~/step').message.startswith('3 solver steps taken')
        client.push('~/wrench', (0.0, 0.1, 0.0), frame='icosahedron_3')
        client.pause(False)
        client.wait_until(max(expected) + 200_000_000)
        status = client.health(lambda status: status.message != 'paused')
        assert status.values['bodies'] == str(len(poses[-1].values)) and status.level < ERROR
        assert node.stop() == 0
    with BagReader(tmp_path / 'more') as more:
        found = {time: data for _, time, data in more.messages([f'{NODE}/poses'])}
        assert more.topics[f'{NODE}/wrench'].message_count == 1
    assert more.start_time == told
    assert {time: found[time] for time in expected} == expected


def test_a_run_that_cannot_go_on_is_played_on(tmp_path, bag):
    path = tmp_path / 'taken'
    path.mkdir()
    options = {'rate': 0.1, 'record.path': path}
    with ReplayProcess(tmp_path / 'log', bag, **options) as node, Client(node) as client:
        before = client.clock
        answer = client.call('~/continue')
        assert not answer.success and 'exists and is never overwritten' in answer.message
        path.rmdir()
        answer = client.call('~/continue')
        assert not answer.success and answer.message.startswith('this run cannot be continued: ')
        client.wait_for(lambda: client.clock > before + SECOND // 20, 'the replay to go on')
        assert client.pause() > before
        assert not client.call('~/continue').success  # and may be asked again
        assert node.stop() == 0


COMMAND_LINES = {
    'no bag given; run replay_node BAG': [],
    'replay_node takes one bag': ['{bag}', '{bag}'],
    '/nowhere/bag does not exist': ['/nowhere/bag'],
    'is not a bag: it must be a folder': ['{folder}'],
    "unknown parameter 'rat'; did you mean rate?": ['{bag}', '--ros-args', '-p', 'rat:=1.0'],
    'rate must lie in 0 to 1e+06, got -2.0': ['{bag}', '--ros-args', '-p', 'rate:=-2.0'],
    'start_offset: 3 s is beyond the end: the bag is 2 s long':
        ['{bag}', '--ros-args', '-p', 'start_offset:=3'],
    "contains no topics of '/c'; fabrics in it: /b/fabric, /icofabric":
        ['{bag}', '--ros-args', '-p', 'fabric:=/c'],
}


def test_bad_command_lines_are_told_in_one_line(tmp_path, bag):
    """Status 2; 1 where the bag itself says no; and help."""
    unfinished = write_bag(tmp_path / 'unfinished')
    (unfinished / 'metadata.yaml').unlink()
    wanted = {words: ([part.format(bag=bag, folder=ROOT / 'docs') for part in line], 2)
              for words, line in COMMAND_LINES.items()}
    wanted['`icofabric recover'] = [str(unfinished)], 1
    wanted['usage: replay_node BAG'] = ['--help'], 0
    command = [sys.executable, '-m', 'icofabric_sim.ros.replay_node']
    running = {words: subprocess.Popen(
        command + line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain())})
        for words, (line, _) in wanted.items()}
    for words, process in running.items():
        output, errors = process.communicate(timeout=120)
        status = wanted[words][1]
        assert process.returncode == status, (words, output, errors)
        assert words in (errors if status else output), (words, errors)
        if status:
            assert errors.startswith('replay_node: ') and len(errors.splitlines()) == 1


def test_plain_argument_and_several_fabrics(tmp_path, bag):
    """`replay_node BAG`; of several fabrics the first is played, and the others are named."""
    done = subprocess.run(
        [sys.executable, '-m', 'icofabric_sim.ros.replay_node', str(bag), '--ros-args', '-p',
         'rate:=0.0'], capture_output=True, text=True, timeout=120, cwd=ROOT,
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain())})
    assert done.returncode == 0, done.stderr
    assert 'topics of /b/fabric, t = 0 s to 2 s' in done.stderr
    assert 'this bag also holds /icofabric; the parameter fabric selects' in done.stderr


def test_seek_service_of_rosbag2():
    """Where rosbag2_interfaces is installed; its answer is true or false."""
    from icofabric_sim.ros.replay import ReplayNode
    told, sought = [], []

    class Answers:

        @staticmethod
        async def of(begin):
            return begin()

    def seek(time):
        if time > END:
            raise ValueError('not in the bag')
        sought.append(time)

    node = SimpleNamespace(
        answers=Answers, player=SimpleNamespace(seek=seek),
        get_logger=lambda: SimpleNamespace(error=told.append))
    for sec, success in ((1, True), (3, False)):
        request = SimpleNamespace(time=SimpleNamespace(sec=sec, nanosec=5))
        response = asyncio.run(ReplayNode._seek(node, request, SimpleNamespace()))
        assert response.success is success
    assert sought == [SECOND + 5] and told == ['not in the bag']


def test_recorded_times_are_those_of_the_bag():
    assert [time for time, name, _ in RECORDS if name == f'{NODE}/poses'] == POSE_TIMES
