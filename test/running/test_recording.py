# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The bag of a run as a sink: its topics, its names, and what it says about itself."""
from dataclasses import replace
import json
import shutil
import threading
import time

import icofabric_sim as ico
from icofabric_sim.bag import BagError, BagReader, BagRecorder, recover_bag
from icofabric_sim.bag.bag_file import BagFile
from icofabric_sim.bag.summary import summarise_bag
from icofabric_sim.kernels.runtime.target import host_processor, kernel_target
from icofabric_sim.messages import (
    decode_string,
    StringBytes,
    UInt8MultiArrayBytes,
    WrenchStampedBytes,
)
from icofabric_sim.messages.topics import (
    CHECKPOINT,
    CLOCK,
    DIAGNOSTICS,
    EVENTS,
    POSES,
    Recorded,
    STATE,
    TOPICS,
    WEAVE,
)
from icofabric_sim.running.recording import (
    BagSink,
    describe_run,
    DROPPED,
    summarise_growth,
    summarise_run,
)
from icofabric_sim.running.run_records import Errors
from icofabric_sim.running.runner import Runner
from icofabric_sim.simulation.reports.divergence import Companion, Growth
import numpy as np
import pytest

SCENE = {'weave': {'size': [2, 2, 2]}, 'contact': {'mode': 'never'}, 'duration': 0.05,
         'real_time_factor': 0.0}

SUMMARY = {'proximity', 'failure', 'wrenches_dropped', 'balance_worst', 'error_rate',
           'error_estimate', 'error_estimate_lacks'}


def make_simulation(**sections):
    return ico.compile_scene(ico.Scene.from_parameters({**SCENE, **sections}))


@pytest.fixture
def simulation():
    return make_simulation()


def test_run_is_described_for_a_repetition(simulation, tmp_path):
    described = describe_run(simulation)
    assert all(type(value) is str for value in described.values())
    (tmp_path / 'scene.yaml').write_text(described['scene'])
    assert dict(ico.load_scene(tmp_path / 'scene.yaml').parameters) == dict(
        simulation.scene.parameters)
    assert float(described['step']) == simulation.status.step
    assert described['method'] == simulation.status.method_name in ico.METHODS
    assert described['method_reason'] == simulation.status.method_reason
    assert float(described['tolerance']) == 1e-6
    assert described['threads'] == str(simulation.status.thread_count)
    assert described['version'] == ico.__version__
    assert described['processor'] == host_processor() != ''
    assert described['kernels'] == kernel_target() != ''
    libraries = json.loads(described['libraries'])
    assert {'numpy', 'numba', 'llvmlite', 'rosbags'} <= libraries.keys()


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_run_without_a_graph_is_recorded(simulation, tmp_path, storage):
    """Under the names of the node, so that the same tools read it."""
    sink = BagSink(tmp_path / 'bag', simulation, storage=storage, live=False)
    assert sink.is_bag
    assert sink.wants(POSES) and not sink.wants(STATE)
    Runner(simulation, [sink]).run(until_finished=True)
    sink.close(summary={'failure': 'none'})
    with BagReader(tmp_path / 'bag') as bag:
        assert bag.custom['failure'] == 'none'
        assert bag.custom['scene'] == describe_run(simulation)['scene']
        counts = {name: topic.message_count for name, topic in bag.topics.items()}
        assert counts['/icofabric/poses'] == 4 and counts['/clock'] == 6
        assert counts['/icofabric/weave'] == 1 and bag.topics['/icofabric/weave'].latched
        assert next(bag.messages())[0] == '/icofabric/recording'
        assert not any('state' in name for name in counts)
        assert bag.end_time == 50_000_000


@pytest.mark.parametrize('step', [0.0, 1e-4])
def test_what_the_run_achieved_is_said_at_its_end(step):
    simulation = make_simulation(
        solver={'step': step}, initial_random={'velocity_sigma': 0.1})
    runner = Runner(simulation, [])
    runner.run(until_finished=True)
    assert not runner.failure
    said = summarise_run(runner.status())
    assert all(type(value) is str for value in said.values())
    assert 0.0 < float(said['balance_worst']) == simulation.balance.worst < 1e-3
    assert float(said['error_rate']) == simulation.status.error_rate > 0.0
    assert float(said['error_estimate']) == simulation.error_estimate > 0.0


def test_a_run_without_an_estimate_of_errors_says_so_in_its_bag(tmp_path):
    simulation = make_simulation(
        solver={'step': 1e-4, 'error_estimate': False}, initial_random={'velocity_sigma': 0.1})
    sink = BagSink(tmp_path / 'bag', simulation, live=False)
    runner = Runner(simulation, [sink])
    runner.run(until_finished=True)
    companion = Companion(simulation)
    sink.close(summary={
        **summarise_run(runner.status()), **summarise_growth(companion.result())})
    rows = dict(summarise_bag(tmp_path / 'bag').rows())
    assert rows['accuracy'].startswith('not estimated; solver.tolerance is 1e-06')
    assert 'they were not estimated' in rows['growth']
    assert rows['evaluations'].startswith(f'{simulation.status.evaluation_count:,} evaluations')


def test_growth_is_said_in_numbers_that_can_be_read_back():
    growth = Growth(np.array([0.0, 0.5, 1.0]), np.array([1.0, 2e5, 1e30]),
                    np.array([0.0, 1e-7, 2e-7]), True, '')
    said = summarise_growth(growth)
    assert all(type(value) is str for value in said.values())
    assert float(said['growth']) == 1e30 and said['growth_is_at_least'] == 'true'
    assert float(said['meaningful_until']) == 0.5 and said['growth_ended'] == 'none'
    calm = summarise_growth(replace(growth, growth=np.ones(3), ended='it broke'))
    assert float(calm['meaningful_until']) == 1.0 and calm['growth_ended'] == 'it broke'


def test_names_follow_the_node(simulation, tmp_path):
    sink = BagSink(tmp_path / 'bag', simulation, storage='mcap', live=True, name='/lab/left')
    assert [sink.resolve(topic.name) for topic in (POSES, WEAVE, CLOCK, DIAGNOSTICS)] == [
        '/lab/left/poses', '/lab/left/weave', '/clock', '/diagnostics']
    sink.close()
    with BagReader(tmp_path / 'bag') as bag:
        expected = {sink.resolve(topic.name) for topic in TOPICS
                    if topic.recorded is Recorded.ALWAYS}
        # Topics are there even if nothing came.
        assert expected <= set(bag.topics)


def test_inputs_are_recorded_under_their_own_topic(simulation, tmp_path):
    sink = BagSink(tmp_path / 'bag', simulation, storage='mcap', live=True)
    data = WrenchStampedBytes('icosahedron_0').stamped(7)
    sink.send_input('/icofabric/wrench', WrenchStampedBytes.TYPE, 20, data)
    sink.send_input('/icofabric/wrench', WrenchStampedBytes.TYPE, 30, data)
    sink.close()
    with BagReader(tmp_path / 'bag') as bag:
        topic = bag.topics['/icofabric/wrench']
        assert topic.type_name == WrenchStampedBytes.TYPE and not topic.latched
        assert list(bag.messages(['/icofabric/wrench'])) == [
            ('/icofabric/wrench', time, data) for time in (20, 30)]


def test_jump_of_time_opens_the_next_bag_with_the_scene_that_runs(simulation, tmp_path):
    sink = BagSink(tmp_path / 'bag', simulation, storage='mcap', live=True)
    sink.send(CLOCK, 5, b'\0\1\0\0' + bytes(8))
    (tmp_path / 'bag_1').mkdir()  # of another owner
    other = make_simulation(gravity=[0.0, 0.0, -3.0])
    in_force = other.scene.parameters.with_changes({'publish_rate': 10.0})
    ended = Runner(simulation, []).status()._replace(
        proximity='close', dropped=3, balance_worst=0.25, errors=Errors(1e-7, 3e-7))
    sink.time_jumped_back(other, in_force, ended)
    sink.send_input('/icofabric/wrench', WrenchStampedBytes.TYPE, 0,
                    WrenchStampedBytes('').stamped(0))
    sink.close()
    with BagReader(tmp_path / 'bag') as first, BagReader(tmp_path / 'bag_2') as second:
        assert first.custom['scene'] == describe_run(simulation)['scene']
        assert second.custom['scene'] == describe_run(other, in_force)['scene']
        assert 'publish_rate: 10.0' in second.custom['scene'] != first.custom['scene']
        assert {name: first.custom[name] for name in SUMMARY} == {
            'proximity': 'close', 'failure': 'none', 'wrenches_dropped': '3',
            'balance_worst': '0.25', 'error_rate': '1e-07', 'error_estimate': '3e-07',
            'error_estimate_lacks': 'nothing'}
        assert not SUMMARY & second.custom.keys()
        assert first.topics['/clock'].message_count == 1
        assert second.topics['/clock'].message_count == 0
        assert second.topics['/icofabric/wrench'].message_count == 1
    assert list((tmp_path / 'bag_1').iterdir()) == []


def test_jump_of_time_without_a_place_for_the_next_bag(simulation, tmp_path):
    """The run goes on, without a bag, and the error is reported once."""
    errors = []
    (tmp_path / 'folder').mkdir()
    sink = BagSink(
        tmp_path / 'folder' / 'bag', simulation, storage='mcap', live=True,
        on_error=errors.append)
    sink.recorder.close()
    shutil.rmtree(tmp_path / 'folder')  # after it was closed: nothing to complain of
    (tmp_path / 'folder').write_text('in the way')
    sink.time_jumped_back(
        simulation, simulation.scene.parameters, Runner(simulation, []).status())
    [error] = errors
    assert isinstance(error, BagError) and 'record.path' in str(error)
    assert not sink.wants(POSES)
    sink.send_input('/icofabric/wrench', WrenchStampedBytes.TYPE, 0,
                    WrenchStampedBytes('').stamped(0))
    sink.close(summary={'failure': 'none'})
    assert len(errors) == 1


def status_of(simulation, seconds=0.0):
    return Runner(simulation, []).status()._replace(time=round(seconds * 1e9))


def make_sink(path, simulation, **options):
    return BagSink(path, simulation, live=options.pop('live', True), **options)


def test_recording_is_switched_off_and_on(simulation, tmp_path):
    """Each time a bag of its own, with the last words of the run at that time."""
    sink = make_sink(tmp_path / 'bag', simulation)
    in_force = simulation.scene.parameters
    assert sink.is_recording and sink.path == tmp_path / 'bag'
    sink.send(CLOCK, 5, b'\0\1\0\0' + bytes(8))
    ended = status_of(simulation, 0.25)._replace(dropped=3)
    said = sink.switch(False, simulation, in_force, ended)
    assert said == f'{tmp_path / "bag"} is closed'
    assert not sink.is_recording and sink.path == tmp_path / 'bag'
    assert not any(sink.wants(topic) for topic in TOPICS)
    sink.send(CLOCK, 6, b'\0\1\0\0' + bytes(8))
    sink.send_input('/icofabric/wrench', WrenchStampedBytes.TYPE, 6, b'')
    assert sink.switch(False, simulation, in_force, ended) == 'recording was not active'
    (tmp_path / 'bag_1').mkdir()  # of another owner
    said = sink.switch(True, simulation, in_force, status_of(simulation, 0.5))
    assert said == f'recording to {tmp_path / "bag_2"}'
    sink.send(CLOCK, 7 * 10**8, b'\0\1\0\0' + bytes(8))
    # On while it is on: the next bag.
    said = sink.switch(True, simulation, in_force, status_of(simulation, 0.75))
    assert said == f'recording to {tmp_path / "bag_3"}; {tmp_path / "bag_2"} is closed'
    sink.close(summary={'failure': 'none'})
    sink.close()
    with BagReader(tmp_path / 'bag') as bag:
        assert bag.custom['wrenches_dropped'] == '3'
        assert bag.topics['/clock'].message_count == 1
        assert '/icofabric/wrench' not in bag.topics
    with BagReader(tmp_path / 'bag_2') as bag:
        # It begins when it was opened, with what is known of the run.
        first = next(bag.messages())
        assert first[:2] == ('/icofabric/recording', 500_000_000) == (
            '/icofabric/recording', bag.start_time)
        assert json.loads(decode_string(first[2])) == describe_run(simulation)
        assert bag.custom['failure'] == 'none' and bag.custom['wrenches_dropped'] == '0'
    with BagReader(tmp_path / 'bag_3') as bag:
        assert bag.start_time == 750_000_000 and 'wrenches_dropped' not in bag.custom


def test_recording_cannot_be_switched_on_without_a_path(simulation, tmp_path):
    sink = make_sink('', simulation, name='/lab/left')
    assert not sink.is_recording and sink.path is None and sink.error is None
    assert sink.statistics.written == 0 == sink.dropped
    assert not sink.wants(POSES)
    in_force = simulation.scene.parameters
    with pytest.raises(BagError, match='record.path is empty.*param set /lab/left record.path'):
        sink.switch(True, simulation, in_force, status_of(simulation))
    assert sink.switch(False, simulation, in_force, status_of(simulation)) == (
        'recording was not active')
    sink.time_jumped_back(simulation, in_force, status_of(simulation))
    # Set while it runs.
    in_force = in_force.with_changes({
        'record.path': str(tmp_path / 'late'), 'record.storage': 'sqlite3'})
    assert sink.switch(True, simulation, in_force, status_of(simulation)) == (
        f'recording to {tmp_path / "late"}, complete only after it is closed '
        '(mcap survives a kill)')
    sink.close()
    sink.close()
    with BagReader(tmp_path / 'late' / 'late_0.db3') as bag:
        assert bag.custom['version'] == ico.__version__


def test_what_is_set_for_all_bags_holds_for_all(simulation, tmp_path):
    """The command line's word counts, not the scene's."""
    sink = make_sink(tmp_path / 'bag', simulation, storage='sqlite3')
    in_force = simulation.scene.parameters.with_changes({'record.path': str(tmp_path / 'other')})
    sink.switch(True, simulation, in_force, status_of(simulation))
    sink.close()
    assert sorted(file.name for file in tmp_path.glob('*/*.db3')) == ['bag_0.db3', 'bag_1_0.db3']


def test_parameters_in_force_count_before_the_scene(simulation, tmp_path):
    in_force = simulation.scene.parameters.with_changes({
        'record.path': str(tmp_path / 'one'), 'record.storage': 'sqlite3', 'marker_rate': 3.0})
    sink = make_sink(tmp_path / 'one', simulation, parameters=in_force)
    later = in_force.with_changes({'record.path': str(tmp_path / 'two')})
    sink.switch(True, simulation, later, status_of(simulation))
    sink.close()
    for name in ('one', 'two'):
        with BagReader(tmp_path / name / f'{name}_0.db3') as bag:
            assert bag.custom['scene'] == describe_run(
                simulation, in_force if name == 'one' else later)['scene']
            assert 'marker_rate: 3.0' in bag.custom['scene']


def test_parameters_split_and_compress(tmp_path):
    simulation = make_simulation(**{'record': {
        'split_duration': 0.02, 'compression': 'zstd', 'path': str(tmp_path / 'bag')}})
    sink = make_sink(tmp_path / 'bag', simulation, live=False)
    Runner(simulation, [sink]).run(until_finished=True)
    sink.close()
    assert sorted(file.name for file in (tmp_path / 'bag').iterdir()) == [
        'bag_0.mcap', 'bag_1.mcap', 'metadata.yaml']
    with BagReader(tmp_path / 'bag') as bag:
        assert bag.topics['/icofabric/poses'].message_count == 4
    with BagReader(tmp_path / 'bag' / 'bag_1.mcap') as part:
        # The scene in force, from ~/weave.
        assert part.custom['part'] == '1'
        (tmp_path / 'scene.yaml').write_text(part.custom['scene'])
    assert dict(ico.load_scene(tmp_path / 'scene.yaml').parameters) == dict(
        simulation.scene.parameters)


def test_a_later_file_tells_the_scene_in_force_there(tmp_path):
    simulation = make_simulation(record={'split_duration': 1.0})
    sink = make_sink(tmp_path / 'bag', simulation)
    for second in range(6):
        if second == 3:
            sink.send(WEAVE, second * 10**9, StringBytes('another').to_bytes())
        sink.send(CLOCK, second * 10**9, b'\0\1\0\0' + bytes(8))
    sink.close()
    scenes = []
    for number in range(3):
        with BagReader(tmp_path / 'bag' / f'bag_{number}.mcap') as part:
            scenes.append(part.custom['scene'])
    assert scenes[:2] == 2 * [describe_run(simulation)['scene']] and scenes[2] == 'another'
    with BagReader(tmp_path / 'bag') as bag:
        assert bag.custom['scene'] == scenes[0]


def test_events_and_checkpoints_are_recorded(simulation, tmp_path):
    sink = make_sink(tmp_path / 'bag', simulation)
    assert sink.wants(EVENTS) and sink.wants(CHECKPOINT)
    event, checkpoint = StringBytes('{}').to_bytes(), UInt8MultiArrayBytes(b'abc').to_bytes()
    sink.send(CHECKPOINT, 5, checkpoint)
    sink.send(EVENTS, 5, event)
    sink.close()
    with BagReader(tmp_path / 'bag') as bag:
        assert list(bag.messages(['/icofabric/events', '/icofabric/checkpoint'])) == [
            ('/icofabric/checkpoint', 5, checkpoint), ('/icofabric/events', 5, event)]


def test_bags_of_two_fabrics_do_not_collide(simulation, tmp_path):
    """No absolute name but /clock and /diagnostics, so that both can be put into one bag."""
    names = []
    for name in ('left', 'right'):
        sink = make_sink(tmp_path / name, simulation, name=f'/{name}/icofabric')
        sink.close()
        with BagReader(tmp_path / name) as bag:
            names.append(set(bag.topics))
            assert bag.custom_on(f'/{name}/icofabric/recording') == bag.custom
            assert bag.custom_on('/icofabric/recording') == {}
    assert '/left/icofabric/recording' in names[0]
    assert names[0] & names[1] == {'/clock', '/diagnostics'}


@pytest.fixture
def hanging_disk(monkeypatch):
    """Make every write of a bag wait until the event is set."""
    allowed, write = threading.Event(), BagFile.write

    def slow(file, *arguments):
        assert allowed.wait(60)
        write(file, *arguments)

    monkeypatch.setattr(BagFile, 'write', slow)
    yield allowed
    allowed.set()


def test_a_hanging_disk_does_not_stop_a_live_run(tmp_path, monkeypatch, hanging_disk):
    """It drops and counts, says so at once, and jumps, switches and ends without waiting."""
    monkeypatch.setattr('icofabric_sim.bag.recorder.BagRecorder.__init__.__kwdefaults__', {
        **BagRecorder.__init__.__kwdefaults__, 'queue_bytes': 5000})
    monkeypatch.setattr('icofabric_sim.running.recording._DISK_WAIT_S', 0.05)
    simulation = make_simulation(duration=0.5, reset_time=True)
    warned = []
    sink = make_sink(tmp_path / 'bag', simulation, on_warning=warned.append)
    runner = Runner(simulation, [sink])
    runner.run(until_finished=True)
    assert runner.finished and not runner.failure
    assert sink.error is None and sink.statistics.written == 0
    dropped = sink.dropped
    assert dropped > 50
    [warning] = warned
    assert str(tmp_path / 'bag') in warning and 'too slow' in warning
    in_force = simulation.scene.parameters
    said = sink.switch(True, simulation, in_force, runner.status())
    assert said == (f'recording to {tmp_path / "bag_1"}; {tmp_path / "bag"} is still being '
                    'written: the disk is slow')
    sink.time_jumped_back(simulation, in_force, runner.status())
    assert sink.path == tmp_path / 'bag_2' and sink.dropped == dropped
    hanging_disk.set()
    sink.close()
    for name in ('bag', 'bag_1', 'bag_2'):
        with BagReader(tmp_path / name) as bag:
            assert ('messages_dropped' in bag.custom) == (name == 'bag')
            assert '/icofabric/recording' in bag.topics
    with BagReader(tmp_path / 'bag') as bag:
        assert bag.custom['messages_dropped'] == str(dropped)
        assert sum(json.loads(bag.custom[DROPPED]).values()) == dropped
        assert bag.topics['/icofabric/weave'].message_count >= 1
    text = '\n'.join(summarise_bag(tmp_path / 'bag').lines())
    assert f'{dropped} messages: the disk was too slow; inputs are complete' in text


def test_a_full_disk_ends_the_bag_and_not_the_run(simulation, tmp_path, monkeypatch):
    """And recording can be switched on again, where there is room."""
    write, told = BagFile.write, []

    def full(file, topic, nanoseconds, data):
        if file.path.name == 'bag' and nanoseconds > 20_000_000:
            raise OSError(28, 'No space left on device')
        write(file, topic, nanoseconds, data)

    monkeypatch.setattr(BagFile, 'write', full)
    sink = make_sink(tmp_path / 'bag', simulation, on_error=told.append)
    runner = Runner(simulation, [sink])
    runner.run(until_finished=True)
    assert runner.finished and not runner.failure
    patience = time.monotonic() + 60
    while sink.error is None:
        assert time.monotonic() < patience
        time.sleep(0.01)
    assert not sink.wants(POSES) and sink.is_recording
    assert told == [sink.error] and 'No space left on device' in str(sink.error)
    assert sink.dropped > 0
    in_force = simulation.scene.parameters
    said = sink.switch(True, simulation, in_force, runner.status())
    assert said.startswith(f'recording to {tmp_path / "bag_1"}; recording to ')
    assert sink.error is None and sink.wants(POSES)
    sink.close()
    assert len(told) == 1
    with BagReader(tmp_path / 'bag') as bag:
        assert bag.custom['recording_stopped'] == 'No space left on device'
        assert bag.end_time <= 20_000_000 and bag.topics['/clock'].message_count == 3
    text = '\n'.join(summarise_bag(tmp_path / 'bag').lines())
    assert 'the recording stopped before the run did: No space left on device' in text


def test_a_killed_run_keeps_all_that_a_repetition_needs(simulation, tmp_path):
    """Here as if killed after its last flush: the index and the metadata are cut off."""
    sink = make_sink(tmp_path / 'bag', simulation, live=False)
    Runner(simulation, [sink]).run(until_finished=True)
    sink.send_input('/icofabric/wrench', WrenchStampedBytes.TYPE, 50_000_000,
                    WrenchStampedBytes('').stamped(0))
    sink.close(summary={'failure': 'none'})
    with BagReader(tmp_path / 'bag') as bag:
        whole = list(bag.messages())
    file = tmp_path / 'bag' / 'bag_0.mcap'
    file.write_bytes(file.read_bytes()[:-500])
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    report = recover_bag(tmp_path / 'bag', tmp_path / 'again')
    assert report.damage and report.custom['scene'] == describe_run(simulation)['scene']
    with BagReader(tmp_path / 'again') as bag:
        assert list(bag.messages()) == whole


def test_existing_folder_is_never_overwritten(simulation, tmp_path):
    (tmp_path / 'bag').mkdir()
    with pytest.raises(BagError, match='record.path: .* exists'):
        BagSink(tmp_path / 'bag', simulation, storage='mcap', live=True)
    assert list((tmp_path / 'bag').iterdir()) == []
