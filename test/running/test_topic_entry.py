# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""One entry adds a topic: published at its rate on request, recorded, and verified."""

import icofabric_sim as ico
from icofabric_sim.bag import BagReader
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.messages import decode_float64_multi_array, Float64MultiArrayBytes, topics
from icofabric_sim.messages.topics import POSES, Recorded, Topic
from icofabric_sim.running.recording import BagSink, summarise_run
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.running.runner import Runner
import numpy as np
import pytest
from runner_helpers import ListSink, make_runner, run

PERIOD = 20_000_000  # [ns] of the rate below
CHANGES = {'duration': 0.1, 'marker_rate': 50.0, 'gravity': [0.0, 0.0, -9.81]}


@pytest.fixture
def built(monkeypatch):
    """Times at which the added topic `~/centroid` was built, and its entry."""
    times = []

    def build(outputs, run, now):
        times.append(now)
        message = Float64MultiArrayBytes(('x, y, z',), (3,))
        message.values[:] = run.snapshot().position.mean(axis=0)
        return [message.to_bytes()]

    entry = Topic(
        '~/centroid', Float64MultiArrayBytes.TYPE, recorded=Recorded.ALWAYS, rate='marker_rate',
        build=build, requires='connector.stiffness')
    monkeypatch.setattr(topics, 'PERIODIC', (*topics.PERIODIC, entry))
    return times, entry


def test_it_is_sent_at_its_rate(built):
    times, entry = built
    sink = ListSink(entry, POSES)
    runner = run(make_runner(sink, **CHANGES))
    found = sink.of(entry)
    assert [time for time, _ in found] == list(range(0, 100_000_001, PERIOD)) == times
    positions = [decode_float64_multi_array(data).values for _, data in found]
    assert positions[-1] == pytest.approx(runner.simulation.snapshot().position.mean(axis=0))
    assert np.all(np.diff([z for _, _, z in positions]) < 0.0)


def test_it_is_not_built_without_a_subscriber_or_its_parameter(built):
    times, entry = built
    sink = ListSink(POSES)
    run(make_runner(sink, **CHANGES))
    assert sink.messages and not times
    sink = ListSink(entry, POSES)
    run(make_runner(sink, **CHANGES, connector__stiffness=0.0))
    assert sink.of(POSES) and not sink.of(entry) and not times


@pytest.mark.parametrize('is_changed', [False, True])
def test_a_bag_has_it_and_verification_compares_it(tmp_path, built, is_changed):
    _, entry = built
    simulation = ico.compile_scene(ico.load_scene('hanging_slab').with_changes({
        **CHANGES, 'record.path': str(tmp_path / 'bag'), 'real_time_factor': 0.0}))
    bag = BagSink(tmp_path / 'bag', simulation, live=False)
    if is_changed:
        send = bag.send

        def send_changed(topic, time, data):
            send(topic, time, data[:-8] + bytes(8) if topic is entry and time else data)
        bag.send = send_changed
    runner = run(Runner(simulation, [bag]))
    bag.close(summary=summarise_run(runner.status()))
    with BagReader(tmp_path / 'bag') as reader:
        assert reader.topics['/icofabric/centroid'].message_count == 6
    with RecordedRun(tmp_path / 'bag', '/icofabric') as recorded:
        report = verify_run(recorded)
    assert report.verdict == ('differs' if is_changed else 'identical'), report.lines()
    assert any('/centroid' in line for line in report.lines()) is is_changed
