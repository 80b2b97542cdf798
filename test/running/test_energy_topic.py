# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`~/energy`: its labels, its times, and its numbers."""

import icofabric_sim as ico
from icofabric_sim.messages import decode_float64_multi_array
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.messages.topics import ENERGIES, ENERGY, Outputs, POSES, Recorded
import pytest
from runner_helpers import ListSink, make_runner, run, SCENE

# As the contract has them.
LABEL = (
    'kinetic, connectors, gravity, contact, work in, dissipated, balance error, field, '
    'lost at breaks')
CHANGES = {'initial_random.velocity_sigma': 0.1, 'gravity': [0.0, 0.0, -9.81]}


def test_labels_name_the_numbers():
    assert ', '.join(ENERGIES) == LABEL
    scene = ico.Scene.from_parameters({**SCENE, 'duration': 0.0})
    snapshot = ico.compile_scene(scene).snapshot()
    message = decode_float64_multi_array(Outputs(scene).energy(snapshot))
    assert list(message.labels) == [LABEL] and message.values.shape == (9,)
    assert set(ENERGIES.values()) | {'total'} == set(snapshot.energy)


def test_numbers_are_those_of_the_snapshot_with_every_pose():
    sink = ListSink(POSES, ENERGY)
    runner = run(make_runner(
        sink, **{name.replace('.', '__'): value for name, value in CHANGES.items()}))
    assert not runner.failure
    assert [time for time, _ in sink.of(ENERGY)] == [time for time, _ in sink.of(POSES)]
    direct = ico.compile_scene(runner.simulation.scene)
    for now, data in sink.of(ENERGY):
        direct.advance_to(seconds(now))
        energy = direct.snapshot().energy
        values = dict(zip(ENERGIES, decode_float64_multi_array(data).values))
        assert values == {label: energy[name] for label, name in ENERGIES.items()}
        assert energy['total'] == pytest.approx(sum(
            values[label] for label in ('kinetic', 'connectors', 'gravity', 'contact', 'field')))
        assert values['contact'] == values['dissipated'] == 0.0
    assert values['kinetic'] > 0.0 < values['connectors'] and values['gravity'] != 0.0


def test_energy_goes_into_the_bag_and_only_to_those_who_want_it(monkeypatch):
    assert ENERGY.recorded is Recorded.ALWAYS and not ENERGY.latched
    monkeypatch.setattr(Outputs, 'energy', lambda self, snapshot: pytest.fail('built'))
    run(make_runner(sink := ListSink(POSES), initial_random__velocity_sigma=0.1))
    assert len(sink.of(POSES)) == 7
