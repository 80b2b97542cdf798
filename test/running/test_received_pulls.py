# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Pulls that are received: when they begin and end, what is recorded, and that it repeats."""

import re

import icofabric_sim as ico
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.messages import decode_point_stamped, PointStampedBytes
from icofabric_sim.messages.frames import body_frame
from icofabric_sim.running import received_inputs
from icofabric_sim.running.recording import BagSink, summarise_run
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.running.runner import Runner
import numpy as np
import pytest
from runner_helpers import Beside, ListSink, make_runner, SCENE

BODY = 1


def pull(runner, point=(0.1, 0.0, 0.0), body=BODY, stamp=0):
    message = PointStampedBytes(body_frame(body))
    message.point[:] = point
    runner.inputs.receive('~/pull', message.stamped(stamp))


def pulled(runner):
    return runner.simulation.inputs.pulls.bodies


def test_pull_ends_after_silence_and_both_are_recorded(monkeypatch):
    # Beside other programs the run may not come to a step for a while.
    monkeypatch.setattr(received_inputs, 'PULL_SILENCE', 1.0)
    runner = make_runner(sink := ListSink(), duration=0.0)
    with Beside(runner) as beside:
        # A hand acts when it moves, whatever its clock says.
        pull(runner, stamp=500_000_000)
        beside.wait_for(lambda: len(sink.messages) == 2)
        assert not pulled(runner)
    (first, begun, data), (second, ended, last) = sink.messages
    assert first == second == '~/pull' and begun < ended
    assert decode_point_stamped(data).point.tolist() == [0.1, 0.0, 0.0]
    assert np.isnan(decode_point_stamped(last).point).all()
    assert decode_point_stamped(last).frame_id == 'icosahedron_1'


def test_pull_goes_on_while_it_is_heard_of(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(received_inputs.time, 'monotonic', lambda: now[0])
    runner = make_runner(sink := ListSink())
    inputs, take = runner.inputs, []
    message = PointStampedBytes(body_frame(BODY))
    for wait in (0.0, 0.4, 0.4, 0.6):
        now[0] += wait
        inputs.end_silent_pulls()
        take.append(pulled(runner))
        inputs.take('~/pull', message.stamped(0))
    assert take == [[], [BODY], [BODY], []]
    assert inputs.clear() == 0 and not pulled(runner)
    assert np.isnan(decode_point_stamped(sink.messages[-1][2]).point).all()


def test_pull_of_a_checkpoint_ends_too(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(received_inputs.time, 'monotonic', lambda: now[0])
    runner = make_runner()
    runner.simulation.pull(BODY, (0.1, 0.0, 0.0))
    runner.inputs.end_silent_pulls()
    assert pulled(runner) == [BODY]
    now[0] += 0.6
    runner.inputs.end_silent_pulls()
    assert not pulled(runner)


@pytest.mark.parametrize(('point', 'body', 'words'), [
    ((0.0, 0.0, 0.0), 4, 'no body 4; bodies are 0 to 3'),
    ((0.0, float('nan'), 0.0), 1, 'not finite .point .* m'),
    ((0.0, float('inf'), 0.0), 1, 'not finite .point .* m')])
def test_pull_that_cannot_be_is_dropped_with_the_reason(caplog, point, body, words):
    runner = make_runner(sink := ListSink())
    with Beside(runner) as beside:
        pull(runner, point, body)
        beside.wait_for(lambda: runner.dropped == 1)
    assert not sink.messages
    text = '\n'.join(record.getMessage() for record in caplog.records)
    assert 'a pull on ~/pull was dropped' in text
    assert re.search(words, text)


def test_pull_goes_on_in_a_changed_fabric_with_the_new_strength():
    runner = make_runner(ListSink(), duration=0.0, real_time_factor=1.0)
    wanted = runner.parameters.with_changes({'pull.strength': 4.0})
    with Beside(runner) as beside:
        pull(runner, (100.0, 0.0, 0.0))
        # The first force is that of the next step.
        beside.wait_for(
            lambda: runner.post(lambda: runner.simulation.inputs.pulls.forces).result(60.0))
        mass = runner.post(lambda: runner.simulation.inputs.pulls.mass(BODY)).result(60.0)
        largest = 50.0 * mass  # [N] at strength 1
        runner.change(wanted).result(60.0)

        def force():
            pull(runner, (100.0, 0.0, 0.0))
            forces = runner.post(lambda: runner.simulation.inputs.pulls.forces).result(60.0)
            return np.linalg.norm(forces.get(BODY, 0.0))

        beside.wait_for(lambda: 1.5 * largest < force() <= 4.0 * largest * (1.0 + 1e-12))


@pytest.mark.parametrize('end', ['silence', 'message', 'cleared'])
def test_recorded_pull_verifies_identical(tmp_path, monkeypatch, end):
    monkeypatch.setattr(received_inputs, 'PULL_SILENCE', 0.05 if end == 'silence' else 60.0)
    scene = ico.Scene.from_parameters({**SCENE, 'duration': 0.0, 'real_time_factor': 1.0})
    simulation = ico.compile_scene(scene)
    simulation.warm_up()
    bag = BagSink(tmp_path / 'bag', simulation, live=True, storage='mcap')
    runner = Runner(simulation, [bag])
    with Beside(runner) as beside:
        for number in range(4):
            pull(runner, (0.01 * number, 0.0, 0.02))
            beside.wait_for(lambda: pulled(runner))
        if end == 'message':
            pull(runner, (float('nan'),) * 3)
        elif end == 'cleared':
            runner.clear_loads().result(60.0)
        beside.wait_for(lambda: not pulled(runner))
        ended = runner.now
        beside.wait_for(lambda: runner.now > ended + 20_000_000)
    bag.close(summary=summarise_run(runner.status()))
    with RecordedRun(tmp_path / 'bag') as run:
        found = verify_run(run)
    assert found.verdict == 'identical', found
    assert found.repeated['inputs'] == 5
