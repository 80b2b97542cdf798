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
from icofabric_sim.messages import decode_float64_multi_array
from icofabric_sim.messages.topics import CONTACTS, POSES, REACTIONS, TENSIONS
from icofabric_sim.running.broadcast import Broadcast
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
    while len(asked) < 3 and time.monotonic() < deadline:
        broadcast.emit(0)
        time.sleep(0.01 if live else 0.0)
    assert set(asked) == set(MEASURED.values())
    sent = {topic: data for topic, _, data in sink.messages}
    assert (decode_float64_multi_array(sent[REACTIONS]).values[:, :3]
            == simulation.reactions().force).all()
    assert decode_float64_multi_array(sent[TENSIONS]).values.shape == (
        simulation.scene.connector_count, 2)
