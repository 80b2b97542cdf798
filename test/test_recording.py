# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The bag of a run as a sink: its topics, its names, and what it says about itself.
"""
import json
import shutil

import icofabric_sim as ico
from icofabric_sim.bag import BagError, BagReader
from icofabric_sim.growth import Growth
from icofabric_sim.messages import WrenchStampedBytes
from icofabric_sim.outputs import CLOCK, DIAGNOSTICS, POSES, STATE, TOPICS, WEAVE
from icofabric_sim.recording import (
    BagSink,
    describe_run,
    host_processor,
    summarise_growth,
    summarise_run,
)
from icofabric_sim.run_records import Errors
from icofabric_sim.runner import Runner
import numpy as np
import pytest

SCENE = {'weave': {'size': [2, 2, 2]}, 'contact': {'mode': 'never'}, 'duration': 0.05,
         'real_time_factor': 0.0}

SUMMARY = {'proximity', 'failure', 'wrenches_dropped', 'balance_worst', 'error_rate',
           'error_estimate'}


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
    assert float(described['step']) == simulation.step
    assert described['method'] == simulation.method_name in ico.METHODS
    assert described['method_reason'] == simulation.method_reason
    assert float(described['tolerance']) == 1e-6
    assert described['threads'] == str(simulation.thread_count)
    assert described['version'] == ico.__version__
    assert described['processor'] == host_processor() != ''
    libraries = json.loads(described['libraries'])
    assert {'numpy', 'numba', 'llvmlite', 'rosbags'} <= libraries.keys()


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_run_without_a_graph_is_recorded(simulation, tmp_path, storage):
    """
    Under the names of the node, so that the same tools read it.
    """
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
    """
    Of a step that was given only what costs nothing.
    """
    simulation = make_simulation(
        solver={'step': step}, initial_random={'velocity_sigma': 0.1})
    runner = Runner(simulation, [])
    runner.run(until_finished=True)
    assert not runner.failure
    said = summarise_run(runner.status())
    assert all(type(value) is str for value in said.values())
    assert 0.0 < float(said['balance_worst']) == simulation.balance.worst < 1e-3
    if step:
        assert 'error_rate' not in said and 'error_estimate' not in said
    else:
        assert float(said['error_rate']) == simulation.error_rate > 0.0
        assert float(said['error_estimate']) == simulation.error_estimate > 0.0


def test_growth_is_said_in_numbers_that_can_be_read_back():
    growth = Growth(np.array([0.0, 0.5, 1.0]), np.array([1.0, 2e5, 1e30]),
                    np.array([0.0, 1e-7, 2e-7]), True, '')
    said = summarise_growth(growth)
    assert all(type(value) is str for value in said.values())
    assert float(said['growth']) == 1e30 and said['growth_is_at_least'] == 'true'
    assert float(said['meaningful_until']) == 0.5 and said['growth_ended'] == 'none'
    calm = summarise_growth(growth._replace(growth=np.ones(3), ended='it broke'))
    assert float(calm['meaningful_until']) == 1.0 and calm['growth_ended'] == 'it broke'


def test_names_follow_the_node(simulation, tmp_path):
    sink = BagSink(tmp_path / 'bag', simulation, storage='mcap', live=True, name='/lab/left')
    assert [sink.resolve(topic.name) for topic in (POSES, WEAVE, CLOCK, DIAGNOSTICS)] == [
        '/lab/left/poses', '/lab/left/weave', '/clock', '/diagnostics']
    sink.close()
    with BagReader(tmp_path / 'bag') as bag:
        expected = {sink.resolve(topic.name) for topic in TOPICS if topic.recorded}
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
    (tmp_path / 'bag_1').mkdir()  # of somebody else
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
            'balance_worst': '0.25', 'error_rate': '1e-07', 'error_estimate': '3e-07'}
        assert not SUMMARY & second.custom.keys()
        assert first.topics['/clock'].message_count == 1
        assert second.topics['/clock'].message_count == 0
        assert second.topics['/icofabric/wrench'].message_count == 1
    assert list((tmp_path / 'bag_1').iterdir()) == []


def test_jump_of_time_without_a_place_for_the_next_bag(simulation, tmp_path):
    """
    The run goes on, without a bag, and hears of it once.
    """
    errors = []
    (tmp_path / 'folder').mkdir()
    sink = BagSink(
        tmp_path / 'folder' / 'bag', simulation, storage='mcap', live=True,
        on_error=errors.append)
    sink.recorder.close()
    shutil.rmtree(tmp_path / 'folder')
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


def test_existing_folder_is_never_overwritten(simulation, tmp_path):
    (tmp_path / 'bag').mkdir()
    with pytest.raises(BagError, match='record.path: .* exists'):
        BagSink(tmp_path / 'bag', simulation, storage='mcap', live=True)
    assert list((tmp_path / 'bag').iterdir()) == []
