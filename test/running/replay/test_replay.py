# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The player of recorded runs, without ROS: what it sends, when, and in how much memory."""
from collections import defaultdict
from concurrent.futures import Future
import shutil
import threading
import time
import tracemalloc

from icofabric_sim.bag import BagError, recover_bag
from icofabric_sim.messages import (
    decode_clock,
    decode_diagnostic_array,
    decode_marker_points,
    ERROR,
    MarkerAction,
    OK,
    PoseArrayBytes,
    WARN,
)
from icofabric_sim.messages.topics import TF
from icofabric_sim.messages.transforms import TransformsBytes
from icofabric_sim.running.replay.player import Player
from icofabric_sim.running.replay.replay_parameters import (
    begin_of,
    judge_option,
    judge_options,
    OPTIONS,
)
from icofabric_sim.running.replay.report import ReplayReport
from icofabric_sim.running.replay.source import ReplaySource
import numpy as np
import pytest
from replay_bags import (
    END,
    in_force,
    NODE,
    pose,
    POSE_TIMES,
    recorded,
    RECORDS,
    SECOND,
    STORAGES,
    text,
    TYPES,
    wrench,
    write_bag,
)

SPLIT = {'compression': 'zstd', 'split_duration': 0.3}
KINDS = {
    'mcap': {'storage': 'mcap'},
    'sqlite3': {'storage': 'sqlite3'},
    'mcap split and compressed': {'storage': 'mcap', **SPLIT},
    'sqlite3 split and compressed': {'storage': 'sqlite3', **SPLIT},
}


@pytest.fixture(scope='module', params=KINDS.values(), ids=KINDS)
def bag(request, tmp_path_factory):
    path = write_bag(tmp_path_factory.mktemp('bag') / 'run', **request.param)
    files = [*path.glob('*.mcap*'), *path.glob('*.db3*')]
    assert (len(files) > 5) == ('split_duration' in request.param)
    return path


@pytest.fixture
def any_source(bag):
    with ReplaySource(bag, fabric=NODE, inputs=True) as opened:
        yield opened


@pytest.fixture(scope='module')
def one_bag(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp('bag') / 'run')


@pytest.fixture
def source(one_bag):
    with ReplaySource(one_bag, fabric=NODE, inputs=True) as opened:
        yield opened


class ListSink:
    """Keeps what it is sent, with the wall time; wants all, or the named topics only."""

    def __init__(self, *names):
        self.names = names
        self.sent = []

    def wants(self, topic):
        return not self.names or topic.name in self.names

    def send(self, topic, nanoseconds, data):
        assert type(data) is bytes
        self.sent.append((topic.name, nanoseconds, data, time.monotonic()))

    def of(self, name):
        return [data for topic, _, data, _ in self.sent if topic == name]

    def times(self, name):
        return [nanoseconds for topic, nanoseconds, _, _ in self.sent if topic == name]


class Beside:
    """A player in a thread of its own, as in the node."""

    def __init__(self, source, sink, **options):
        self.sink = sink
        self.player = Player(source, sink, **options)
        self.thread = threading.Thread(target=self.player.run, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, kind, error, traceback):
        self.player.stop()
        self.join()

    def join(self):
        self.thread.join(60.0)
        assert not self.thread.is_alive()

    def wait_for(self, condition):
        deadline = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < deadline
            time.sleep(0.002)


def now(future):
    """Result of a command."""
    assert isinstance(future, Future)
    return future.result(60.0)


def play(source, sink=None, **options):
    """To the end, as fast as possible."""
    sink = sink or ListSink()
    player = Player(source, sink, **{'rate': 0.0, **options})
    player.run()
    assert not player.failure
    return sink


# What is played.

def test_everything_of_the_fabric_is_played_in_order(any_source):
    sink = play(any_source)
    played = ['~/poses', '~/connectors', '~/energy', '~/weave', '~/events', '~/loads/tip',
              '~/wrench']
    for name in played:
        assert sink.of(name) == recorded(name), name
    assert {name for name, *_ in sink.sent} == {*played, '/clock'}
    times = [time_ for _, time_, _, _ in sink.sent]
    assert times == sorted(times) and times[-1] == END
    assert len(sink.of('~/poses')) == 101 and sink.of('~/weave')[1] == text('second')


def test_clock_is_its_own_on_the_grid_of_the_rate(source):
    sink = play(source, clock_rate=30.0)
    assert [decode_clock(data) for data in sink.of('/clock')] == [
        round(k * SECOND / 30) for k in range(61)]
    assert not play(source, publish_clock=False).of('/clock')


def test_inputs_are_a_choice(bag):
    with ReplaySource(bag, fabric=NODE) as source:
        sink = play(source)
    assert sink.of('~/poses') == recorded('~/poses')
    assert not sink.of('~/loads/tip') and not sink.of('~/wrench')


def test_quality_of_service_is_the_recorded_one(any_source):
    topics = any_source.topics
    assert topics[f'{NODE}/weave'].latched and not topics[f'{NODE}/poses'].latched
    assert topics[f'{NODE}/poses'].depth == 7
    assert topics[f'{NODE}/poses'].type == PoseArrayBytes.TYPE


def test_fabrics_are_told_apart_by_name(bag):
    with ReplaySource(bag) as source:
        assert source.fabrics == ['/b/fabric', '/icofabric']
        assert source.fabric == '/b/fabric' and source.start == 0
        assert source.left_out[0] == '/camera/words' and f'{NODE}/poses' in source.left_out
    with ReplaySource(bag, fabric='/b/fabric') as source:
        sink = play(source)
    assert sink.of('~/weave') == [text('other')]
    assert sink.of('~/poses') == [pose(time_, 2) for time_ in POSE_TIMES]
    with pytest.raises(ValueError, match="no topics of '/c'; fabrics in it: /b/fabric, /icof"):
        ReplaySource(bag, fabric='/c')


def test_a_fabric_in_the_namespace_of_another_is_not_mixed_with_it(tmp_path):
    inner = f'{NODE}/inner/poses'
    TYPES[inner] = PoseArrayBytes.TYPE
    write_bag(tmp_path / 'bag', [(0, f'{NODE}/poses', pose(0)), (0, inner, pose(0, 1))])
    with ReplaySource(tmp_path / 'bag', fabric=NODE) as source:
        assert list(source.topics) == [f'{NODE}/poses']
    with ReplaySource(tmp_path / 'bag', fabric=f'{NODE}/inner') as source:
        assert list(source.topics) == [inner]


def test_frames_are_played_where_it_is_clear_whose_they_are(tmp_path):
    frames = TransformsBytes('world', ['icosahedron_3'])
    sent = [frames.filled(time_, np.full((1, 3), float(time_)), np.array([[0.0, 0.0, 0.0, 1.0]]))
            for time_ in range(3)]
    TYPES['/tf'] = TransformsBytes.TYPE
    alone = [record for time_ in range(3)
             for record in ((time_, f'{NODE}/poses', pose(time_)), (time_, '/tf', sent[time_]))]
    write_bag(tmp_path / 'alone', alone)
    with ReplaySource(tmp_path / 'alone') as source:
        assert not source.left_out
        assert play(source).of('/tf') == sent
        assert [data for topic, data in source.state_at(1).messages if topic == TF] == sent[1:2]
    write_bag(tmp_path / 'two', [*alone, (3, '/b/fabric/poses', pose(3, 2))])
    with ReplaySource(tmp_path / 'two', fabric=NODE) as source:
        assert source.left_out == ['/b/fabric/poses', '/tf']
        assert not play(source).of('/tf')


def test_bag_without_poses_needs_a_name(tmp_path):
    found = [record for record in RECORDS if not record[1].endswith('/poses')]
    write_bag(tmp_path / 'bag', found)
    with pytest.raises(BagError, match='contains no poses .* the parameter fabric. Topics: /b/fa'):
        ReplaySource(tmp_path / 'bag')
    with ReplaySource(tmp_path / 'bag', fabric=NODE) as source:
        assert play(source).of('~/connectors') == recorded('~/connectors')


# The state at a time.

@pytest.mark.parametrize('at', [
    0, 1, SECOND // 2, SECOND - 1, SECOND, SECOND + 1, 1_234_567_890, END])
def test_state_at_any_time(any_source, at):
    state = any_source.state_at(at)
    found = defaultdict(list)
    for topic, data in state.messages:
        found[topic.name].append(data)
    assert state.time == at
    assert state.messages[0][0].name == '~/weave'
    for name in ('poses', 'connectors', 'energy', 'weave'):
        assert found[f'~/{name}'] == in_force(f'{NODE}/{name}', at) != []
    events = [data for time_, name, data in RECORDS
              if name == f'{NODE}/events' and time_ == at]
    assert found['~/events'] == events


def test_offset_shows_the_state_at_once_and_goes_on(any_source):
    begin = 1_234_567_890
    sink = play(any_source, begin=begin)
    first = [name for name, time_, _, _ in sink.sent if time_ == begin]
    assert first[:2] == ['/clock', '~/weave'] and {'~/poses', '~/energy'} <= set(first)
    for name in ('poses', 'connectors', 'energy', 'weave'):
        expected = in_force(f'{NODE}/{name}', begin) + recorded(f'~/{name}', after=begin)
        assert sink.of(f'~/{name}') == expected, name
    assert decode_clock(sink.of('/clock')[0]) == begin
    assert not sink.of('~/events')  # they happened before


def test_state_near_the_end_reads_little(any_source, monkeypatch):
    """Neither seeking nor the rare topics read the whole bag."""
    read = []
    messages = any_source._reader.messages

    def counted(*arguments, **options):
        for item in messages(*arguments, **options):
            read.append(item)
            yield item

    monkeypatch.setattr(any_source._reader, 'messages', counted)
    any_source.state_at(END)
    assert 5 <= len(read) < len(RECORDS) / 5
    read.clear()
    next(any_source.frames(END - 1))
    assert len(read) < 10


# RealTimeFactor.

def test_pace_is_kept_without_drift(source, monkeypatch):
    """By a clock of the test's own: each wait ends 3 ms late, which does not add up."""
    rate, late, clock = 4.0, 0.003, [100.0]

    class LateEvent(threading.Event):

        def wait(self, timeout=None):
            clock[0] += timeout + late
            return False

    sink = ListSink('~/poses')
    player = Player(source, sink, rate=rate)
    player._wake = LateEvent()
    monkeypatch.setattr(time, 'monotonic', lambda: clock[0])
    player.run()
    assert not player.failure
    delays = [wall - 100.0 - nanoseconds / SECOND / rate
              for _, nanoseconds, _, wall in sink.sent]
    assert len(delays) == 101
    assert min(delays) >= -1e-9 and max(delays) <= late + 1e-9


def test_rate_changes_while_playing(source):
    sink = ListSink('~/poses', '/clock')
    with Beside(source, sink, rate=1.0) as beside:
        beside.wait_for(lambda: len(sink.of('~/poses')) > 5)
        now(beside.player.set_rate(0.0))
        beside.join()
    assert sink.of('~/poses') == recorded('~/poses')
    clocks = [decode_clock(data) for data in sink.of('/clock')]
    assert clocks == sorted(set(clocks)) and clocks[-1] == END
    assert beside.player.status().target_rate == 0.0


# Control.

def test_pause_stands_still_and_late_joiners_see_the_state(source):
    sink = ListSink('~/poses', '/clock')
    with Beside(source, sink) as beside:
        beside.wait_for(lambda: len(sink.of('~/poses')) > 3)
        at = now(beside.player.set_paused(True))
        assert 0 < at < END
        beside.wait_for(lambda: len(sink.of('/clock')) > 2)
        sink.names = ()  # another subscriber from here on
        sink.sent.clear()
        beside.wait_for(lambda: {'~/connectors', '~/energy', '/clock'} <= {
            name for name, *_ in sink.sent})
        assert set(sink.times('/clock')) == {at} == {beside.player.now}
        assert set(sink.of('~/energy')) == set(in_force(f'{NODE}/energy', at))
        assert set(sink.of('~/poses')) == set(in_force(f'{NODE}/poses', at))
        assert not sink.of('~/weave')  # latched: it waits where it is
        assert not sink.of('~/events') and not sink.of('~/loads/tip')
        assert beside.player.status().paused
        sink.sent.clear()
        assert now(beside.player.set_paused(False)) == at
        now(beside.player.set_rate(0.0))
        beside.join()
    assert sink.of('~/poses')[-1] == pose(END)


def test_pause_at_the_start_shows_the_start(source):
    sink = ListSink()
    with Beside(source, sink, paused=True) as beside:
        beside.wait_for(lambda: sink.of('~/energy'))
        assert sink.of('~/poses')[0] == pose(0) and sink.of('~/weave') == [text('first')]
        assert sink.of('~/loads/tip') == [wrench(0)] and sink.of('~/events') == [text('begin')]
    assert set(sink.times('~/poses')) == {0}


def test_late_joiners_of_slow_motion_see_the_state_too(source):
    sink = ListSink()
    with Beside(source, sink, rate=1e-4, begin=POSE_TIMES[7] + 1) as beside:
        beside.wait_for(lambda: len(sink.of('~/poses')) >= 3)
        assert set(sink.of('~/poses')) == {pose(POSE_TIMES[7])}
        clocks = [decode_clock(data) for data in sink.of('/clock')]
        assert clocks == sorted(clocks) and POSE_TIMES[7] < clocks[0] < clocks[-1] < POSE_TIMES[8]


def test_steps_go_from_poses_to_poses(source):
    sink = ListSink('~/poses', '~/energy', '/clock')
    with Beside(source, sink, paused=True) as beside:
        beside.wait_for(lambda: sink.of('~/poses'))
        assert [now(beside.player.step()) for _ in range(5)] == POSE_TIMES[1:6]
        beside.wait_for(lambda: pose(POSE_TIMES[5]) in sink.of('~/poses'))
        assert decode_clock(sink.of('/clock')[-1]) == POSE_TIMES[5]
        assert sorted(set(sink.of('~/poses'))) == sorted(pose(t) for t in POSE_TIMES[:6])
        now(beside.player.seek(END))
        with pytest.raises(RuntimeError, match='no poses after t = 2.000000000 s; call ~/reset'):
            now(beside.player.step())
        assert now(beside.player.reset()) == 0
        assert now(beside.player.step()) == POSE_TIMES[1]
        now(beside.player.set_paused(False))
        with pytest.raises(RuntimeError, match='only while paused'):
            now(beside.player.step())


@pytest.mark.parametrize('paused', [False, True])
def test_seek_forward_and_back(any_source, paused):
    sink = ListSink()
    with Beside(any_source, sink, paused=paused, stay=True) as beside:
        beside.wait_for(lambda: sink.of('~/poses'))
        for at in (1_500_000_000, 333_333_333):
            sink.sent.clear()
            assert now(beside.player.seek(at)) == at
            shown = [(name, data) for name, time_, data, _ in sink.sent if time_ == at]
            markers = [data for name, data in shown if name == '~/connectors']
            assert decode_marker_points(markers[0]).action == MarkerAction.DELETEALL
            expected = in_force(f'{NODE}/connectors', at)
            assert markers[1:len(expected) + 1] == expected
            assert in_force(f'{NODE}/poses', at)[0] in [data for _, data in shown]
            assert in_force(f'{NODE}/weave', at)[0] in [data for _, data in shown]
            assert shown[0][0] == '/clock' and decode_clock(shown[0][1]) == at
        assert beside.player.paused is paused
        with pytest.raises(ValueError, match=r't = 2.000000001 s is not in .* to t = 2.0000000'):
            now(beside.player.seek(END + 1))
        assert not beside.player.failure
        now(beside.player.set_paused(False))
        now(beside.player.set_rate(0.0))
        beside.wait_for(lambda: beside.player.at_end)
    # From the second seek on, all is there once more.
    assert set(recorded('~/poses', after=333_333_333)) <= set(sink.of('~/poses'))


def test_loop_starts_over_until_told_otherwise(any_source):
    sink = ListSink()
    begin = SECOND
    with Beside(any_source, sink, rate=0.0, loop=True, begin=begin) as beside:
        beside.wait_for(lambda: beside.player.status().loops >= 2)
        beside.player.loop = False
        beside.join()
    loops = beside.player.status().loops
    assert loops >= 2
    clocks = [decode_clock(data) for data in sink.of('/clock')]
    assert clocks.count(begin) == clocks.count(END) == loops + 1
    backwards = [k for k in range(1, len(clocks)) if clocks[k] < clocks[k - 1]]
    assert len(backwards) == loops and {clocks[k] for k in backwards} == {begin}
    expected = in_force(f'{NODE}/poses', begin) + recorded('~/poses', after=begin)
    assert sink.of('~/poses') == (loops + 1) * expected
    cleared = [data for data in sink.of('~/connectors')
               if decode_marker_points(data).action == MarkerAction.DELETEALL]
    assert len(cleared) == 2 * loops + 1  # the recorded ones, and one for each jump


def test_a_bag_of_one_moment_loops_without_haste(tmp_path):
    write_bag(tmp_path / 'bag', [(5, f'{NODE}/poses', pose(5))])
    with ReplaySource(tmp_path / 'bag') as source:
        started = time.monotonic()
        with Beside(source, ListSink(), loop=True) as beside:
            beside.wait_for(lambda: beside.player.status().loops >= 2)
            loops = beside.player.status().loops
        assert loops <= 1 + (time.monotonic() - started) / 0.1


def test_staying_at_the_end(source):
    sink = ListSink()
    with Beside(source, sink, rate=0.0, stay=True) as beside:
        beside.wait_for(lambda: beside.player.at_end)
        sink.sent.clear()
        beside.wait_for(lambda: sink.of('~/poses'))  # for late joiners
        assert set(sink.of('~/poses')) == {pose(END)}
        sink.sent.clear()
        now(beside.player.seek(SECOND))
        beside.wait_for(lambda: beside.player.at_end)
        assert len(set(sink.of('~/poses'))) == 51
        beside.player.stay = False
        beside.join()


def test_commands_after_the_end_are_answered(source):
    player = Player(source, ListSink(), rate=0.0)
    player.run()
    for future in (player.set_paused(True), player.seek(0), player.step(), player.reset()):
        with pytest.raises(RuntimeError, match='the replay has ended'):
            now(future)


def test_nothing_is_sent_that_nobody_wants(source):
    sink = play(source, ListSink('~/energy'))
    assert {name for name, *_ in sink.sent} == {'~/energy'}
    assert sink.of('~/energy') == recorded('~/energy')


# Other bags.

def test_a_recovered_bag_is_played_to_its_end(tmp_path):
    found = [record for record in RECORDS if record[1] == f'{NODE}/poses']
    large = [(time_, name, pose(time_, 400)) for time_, name, _ in found]
    write_bag(tmp_path / 'bag', large)
    (file,) = (tmp_path / 'bag').glob('*.mcap')
    file.write_bytes(file.read_bytes()[:int(1.3e6)])
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    with pytest.raises(BagError, match='was not finished'):
        ReplaySource(tmp_path / 'bag')
    assert recover_bag(tmp_path / 'bag', tmp_path / 'whole').damage
    with ReplaySource(tmp_path / 'whole') as source:
        poses = play(source).of('~/poses')
        assert poses == [data for _, _, data in large[:len(poses)]] and 20 < len(poses) < 101
        assert source.end == large[len(poses) - 1][0]


def test_damage_ends_the_replay_with_the_reason(tmp_path):
    large = [(time_, f'{NODE}/poses', pose(time_, 400)) for time_ in POSE_TIMES]
    write_bag(tmp_path / 'bag', large)
    (file,) = (tmp_path / 'bag').glob('*.mcap')
    data = bytearray(file.read_bytes())
    # The length of the second chunk's last message, from the index of records.
    place = data.index(large[-1][2]) - 40
    data[place:place + 40] = b'\xff' * 40
    file.write_bytes(data)
    sink = ListSink()
    with ReplaySource(tmp_path / 'bag') as source:
        with Beside(source, sink, rate=0.0) as beside:
            beside.join()
            assert 'is damaged' in beside.player.failure
            assert 0 < len(sink.of('~/poses')) < 101
            with pytest.raises(RuntimeError, match='the replay has ended'):
                now(beside.player.seek(0))


@pytest.mark.parametrize('storage', STORAGES)
def test_memory_does_not_grow_with_the_bag(tmp_path, storage):
    large = pose(0, 4000)  # 224 kB
    count = 200
    found = [(k * 10**7, f'{NODE}/poses', large) for k in range(count)]
    write_bag(tmp_path / 'bag', found, storage=storage)
    sizes = []

    class Counting(ListSink):

        def send(self, topic, nanoseconds, data):
            sizes.append(len(data))

    with ReplaySource(tmp_path / 'bag') as source:
        tracemalloc.start()
        try:
            play(source, Counting('~/poses'))
            source.state_at(source.end)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    assert sum(sizes) == count * len(large) > 40e6
    print(f'{storage}: at most {peak / 1e6:.1f} MB of {sum(sizes) / 1e6:.0f} MB')
    assert peak < 12e6
    shutil.rmtree(tmp_path / 'bag')


# Diagnostics.

def test_reports_say_how_the_replay_stands(source):
    about = ReplayReport('/replay', source)
    sink = ListSink('/diagnostics')
    player = Player(source, sink, rate=0.0, report=about.message)
    player.run()
    assert sink.sent
    time_, (status,) = decode_diagnostic_array(sink.of('/diagnostics')[-1])
    assert (time_, status.name, status.level) == (END, '/replay', OK)
    assert status.message == 'at the end of the recorded run'
    assert status.values['recorded time [s]'] == '2.000000000'
    assert status.values['end [s]'] == '2.000000000'
    assert (status.values['recorded level'], status.values['recorded message']) == (
        'WARN', 'shells overlap')


def test_levels_of_a_replay(source):
    about = ReplayReport('/replay', source)
    status = Player(source, ListSink()).status()
    slow = about.describe(status._replace(rate=0.5, target_rate=1.0), {})
    assert slow.level == WARN and 'rate 0.5' in slow.message
    assert about.describe(status._replace(rate=0.5, target_rate=0.5), {}).level == OK
    paused = about.describe(status._replace(rate=0.5, paused=True), {'note': 'more'})
    assert paused.message.startswith('paused') and paused.values['note'] == 'more'
    failed = about.describe(status._replace(failure='the bag is damaged'), {})
    assert (failed.level, failed.message) == (ERROR, 'the bag is damaged')
    malformed = about.describe(status._replace(recorded_report=b'\0\1\0\0abc'), {})
    assert malformed.level == OK and 'recorded level' not in malformed.values


# Parameters.

def test_parameters_have_their_defaults_and_types():
    options = judge_options({'rate': 2, 'loop': True}, 'runs/bag')
    assert options == {
        **{name: option.default for name, option in OPTIONS.items()},
        'bag': 'runs/bag', 'rate': 2.0, 'loop': True}
    assert type(options['rate']) is float


@pytest.mark.parametrize('given, words', [
    ({}, 'no bag given; run replay_node BAG'),
    ({'bag': 3}, 'bag must be a text, got 3'),
    ({'bag': 'a', 'rate': -1.0}, 'rate must lie in 0 to 1e\\+06, got -1.0'),
    ({'bag': 'a', 'rate': float('nan')}, 'rate must lie in'),
    ({'bag': 'a', 'rate': True}, 'rate must be a number, got True'),
    ({'bag': 'a', 'loop': 1}, 'loop must be true or false, got 1'),
    ({'bag': 'a', 'start_offset': float('inf')}, 'start_offset must lie in'),
    ({'bag': 'a', 'clock_rate': 0}, 'clock_rate must lie in'),
    ({'bag': 'a', 'record.storage': 'db'}, 'record.storage must be one of mcap, sqlite3'),
    ({'bag': 'a', 'start_ofset': 1.0}, "unknown parameter 'start_ofset'; did you mean start_off"),
    ({'bag': 'a', 'weave.size': [2, 2, 2]}, 'the parameters of the fabric are as recorded'),
    ({'bag': 'a', 'seek': 1.0, 'start_offset': 1.0}, 'both set the start'),
])
def test_bad_parameters_are_refused_by_name(given, words):
    with pytest.raises(ValueError, match=words):
        judge_options(given)


def test_two_different_bags_are_refused():
    assert judge_options({'bag': 'a'}, 'a')['bag'] == 'a'
    with pytest.raises(ValueError, match="two bags given, 'b' and the parameter bag: 'a'"):
        judge_options({'bag': 'a'}, 'b')


def test_where_to_begin():
    options = judge_options({'bag': 'a', 'start_offset': 0.5})
    assert begin_of(options, 3 * SECOND, 4 * SECOND) == 3_500_000_000
    assert begin_of(judge_options({'bag': 'a', 'seek': 3.25}), 3 * SECOND, 4 * SECOND) == (
        3_250_000_000)
    with pytest.raises(ValueError, match='start_offset: 0.5 s is beyond the end: .* 0.25 s long'):
        begin_of(options, 0, SECOND // 4)
    with pytest.raises(ValueError, match='seek: 3.000000000 s is not in the bag, which goes fr'):
        begin_of({**options, 'seek': 3.0}, 0, SECOND)
    assert judge_option('seek', -1) == -1.0
