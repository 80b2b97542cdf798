# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Topics of a test rig: built for a listener only, and in a live run once kernels are ready."""

import time

import icofabric_sim as ico
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.messages import decode_float64_multi_array
from icofabric_sim.messages.topics import CONTACTS, POSES, REACTIONS, TENSIONS
from icofabric_sim.running.broadcast import Broadcast
from icofabric_sim.running.recording import BagSink, summarise_run
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.running.runner import Runner
import pytest
from runner_helpers import ListSink

MEASURED = {REACTIONS: 'reactions', TENSIONS: 'tensions', CONTACTS: 'contacts'}


@pytest.mark.parametrize('live', [False, True])
def test_they_are_built_for_a_listener_only(live, monkeypatch):
    simulation, asked = ico.compile_scene(ico.load_scene('hanging_slab')), []
    for name in MEASURED.values():
        measure = getattr(simulation, name)
        monkeypatch.setattr(
            simulation, name, lambda measure=measure, name=name: asked.append(name) or measure())
    sink = ListSink(POSES)
    broadcast = Broadcast([sink], simulation, (lambda: b'') if live else None)
    broadcast.emit(0)
    assert sink.messages and not asked
    sink.topics = tuple(MEASURED)
    sink.messages.clear()
    deadline = time.monotonic() + 300.0
    while set(asked) != set(MEASURED.values()) and time.monotonic() < deadline:
        broadcast.emit(0)
        time.sleep(0.01 if live else 0.0)
    assert set(asked) == set(MEASURED.values())
    sent = {topic: data for topic, _, data in sink.messages}
    assert (decode_float64_multi_array(sent[REACTIONS]).values[:, :3]
            == simulation.reactions().force).all()
    assert decode_float64_multi_array(sent[TENSIONS]).values.shape == (
        simulation.scene.connector_count, 2)


def test_a_bag_holds_them_where_asked_and_verify_compares_them(tmp_path):
    path = tmp_path / 'bag'
    simulation = ico.compile_scene(ico.load_scene('hanging_slab').with_changes({
        'record.path': str(path), 'record.measured': True, 'duration': 0.05,
        'real_time_factor': 0.0}))
    bag = BagSink(path, simulation, live=False)
    runner = Runner(simulation, [bag])
    runner.run(until_finished=True)
    bag.close(summary=summarise_run(runner.status()))
    with RecordedRun(path, '/icofabric') as run:
        counts = {topic: len(run.times_of(topic.name)) for topic in MEASURED}
        assert counts == dict.fromkeys(MEASURED, 4)
        report = verify_run(run)
    assert report.verdict == 'identical', report.lines()
