# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
What a runner reports of what is done to it: events, checkpoints, what survives and what does not.
"""
import json
import threading

import icofabric_sim as ico
from icofabric_sim.bag import BagError
from icofabric_sim.messages import decode_pose_array, decode_string, decode_uint8_multi_array
from icofabric_sim.messages.topics import CHECKPOINT, EVENTS, POSES, TOPICS, WEAVE
from icofabric_sim.running import received_inputs, reweave
from icofabric_sim.running.run_records import is_initial
from icofabric_sim.running.runner import Runner
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.simulation import compile_scene
import numpy as np
import pytest
from runner_helpers import Beside, FORCE, ListSink, make_runner, push, run, SCENE


class BagLike(ListSink):
    """A sink that can be switched on and off, as a bag."""

    def __init__(self, *topics):
        super().__init__(*topics, bag=True)
        self.switched, self.refusal = [], ''

    def switch(self, on, simulation, parameters, status):
        if self.refusal:
            raise BagError(self.refusal)
        self.switched.append((on, simulation.time, status.time))
        return f'bag {len(self.switched)}'


def events(sink, *names):
    told = [(time, json.loads(decode_string(data))) for time, data in sink.of(EVENTS)]
    return [(time, facts) for time, facts in told if not names or facts['event'] in names]


def paused_runner(*sinks, **changes):
    return make_runner(
        *sinks, start_paused=True, duration=0.0, solver__step=0.001, step_count=10, **changes)


def change(beside, runner, **changes):
    """Change the scene and wait until it is there."""
    told = []
    runner.changes.on_rebuilt = lambda *report: told.append(report)
    runner.change(runner.parameters.with_changes(
        {name.replace('__', '.'): value for name, value in changes.items()}))
    beside.wait_for(lambda: told)
    return told[0][1]


def test_everything_that_is_done_is_told_with_its_time():
    sink = ListSink(EVENTS)
    runner = paused_runner(sink)
    with Beside(runner) as beside:
        runner.take_steps().result(60.0)
        runner.reset().result(60.0)
        change(beside, runner, connector__stiffness=300.0)
        runner.set_paused(False).result(60.0)
        runner.set_paused(True).result(60.0)
    told = events(sink)
    assert [facts['event'] for _, facts in told] == [
        'step', 'reset', 'reweave', 'resume', 'pause']
    assert all(facts['time'] == time / 1e9 for time, facts in told)
    assert told[0][0] == told[1][0] == told[2][0] == 10_000_000
    assert told[0][1]['count'] == 10
    assert told[1][1]['time_reset'] is False
    assert told[2][1]['changed'] == ['connector.stiffness'] and not told[2][1]['restarts']


def test_event_comes_before_the_state_that_it_changed():
    sink = ListSink(EVENTS, POSES, WEAVE, bag=True)
    runner = paused_runner(sink, initial_random__spin_sigma=5.0)
    with Beside(runner) as beside:
        runner.take_steps().result(60.0)
        runner.reset().result(60.0)
        change(beside, runner, weave__size=[3, 3, 3])
    kinds = [kind for kind, _, _ in sink.messages]
    assert kinds == [WEAVE, POSES, EVENTS, POSES, EVENTS, WEAVE, POSES, EVENTS, WEAVE, POSES]


def test_failure_is_told_with_what_the_run_was_on_its_way_to():
    settings = {
        'weave__size': [3, 3, 3], 'initial_random__velocity_sigma': 3.0,
        'solver__method': 'srkn6'}
    step = np.nextafter(make_runner(**settings).simulation.status.stability_limit, 0.0)
    runner = run(make_runner(
        sink := ListSink(EVENTS), solver__step=float(step), duration=1.0, **settings))
    [(time, facts)] = events(sink, 'failed')
    assert time == runner.now <= facts['target'] and facts['reason'] == runner.failure
    again = ico.compile_scene(runner.simulation.scene)
    with pytest.raises(ico.SimulationError, match='solver.step'):
        again.advance_to(facts['target'] / 1e9)


# Changes of the scene.

def test_wrenches_survive_a_change_where_they_have_a_place(caplog):
    sink = ListSink(EVENTS)
    runner = paused_runner(sink)
    last = runner.simulation.scene.body_count - 1
    with Beside(runner) as beside:
        for key in ('tip', 0, last):
            push(runner, key=key)
        runner.take_steps().result(60.0)
        for key in (1, last):
            push(runner, key=key, stamp=runner.now + 10**6)
        assert change(beside, runner, weave__size=[2, 2, 1]) == ''
        assert set(runner.simulation.status.active_loads) == {'tip', 0}
        runner.take_steps().result(60.0)
        assert set(runner.simulation.status.active_loads) == {'tip', 0, 1}
    [(_, facts)] = events(sink, 'reweave')
    assert facts['restarts'] and facts['lost'] == [f'body {last}'] and facts['dropped'] == 1
    texts = [record.getMessage() for record in caplog.records]
    assert any(f'because their targets no longer exist: body {last}'
               in text for text in texts)


def test_wrench_on_a_channel_that_is_deleted_ends_by_name(caplog):
    sink = ListSink(EVENTS)
    runner = paused_runner(sink)
    with Beside(runner) as beside:
        push(runner)
        push(runner, key=2)
        told = []
        runner.changes.on_rebuilt = lambda *report: told.append(report)
        given = {name: value for name, value in runner.parameters.given().items()
                 if not name.startswith('loads.')}
        runner.change(ico.Scene.from_parameters(given).parameters)
        beside.wait_for(lambda: told)
        assert set(runner.simulation.status.active_loads) == {2}
    [(_, facts)] = events(sink, 'reweave')
    assert facts['lost'] == ['loads.tip'] and not facts['restarts']


def test_hold_time_runs_on_through_a_change():
    runner = paused_runner(ListSink(), loads__tip__hold=0.015)
    with Beside(runner) as beside:
        push(runner)
        runner.take_steps().result(60.0)
        change(beside, runner, weave__size=[3, 2, 2])
        assert 'tip' in runner.simulation.status.active_loads
        runner.take_steps().result(60.0)
        assert not runner.simulation.status.active_loads


def test_change_there_and_back_does_not_touch_the_motion(monkeypatch):
    held = threading.Event()

    def slow_build(scene, **options):
        held.wait(60.0)
        return compile_scene(scene, **options)

    sink, told = ListSink(EVENTS), []
    runner = paused_runner(sink)
    before, parameters = runner.simulation, runner.parameters
    runner.changes.on_rebuilt = lambda *report: told.append(report)
    monkeypatch.setattr(reweave, 'compile_scene', slow_build)
    with Beside(runner) as beside:
        runner.change(parameters.with_changes({'connector.stiffness': 1.0})).result(60.0)
        runner.change(parameters).result(60.0)
        held.set()
        beside.wait_for(lambda: told)
    assert runner.simulation is before and told == [(parameters, '')]
    assert events(sink) == []


def test_newer_rates_than_those_that_were_built_are_told_after_them(monkeypatch):
    """The duration has a part in the choice of the method: a record must hold the one it was."""
    held = threading.Event()

    def slow_build(scene, **options):
        held.wait(60.0)
        return compile_scene(scene, **options)

    sink, told = ListSink(WEAVE), []
    runner = paused_runner(sink)
    runner.changes.on_rebuilt = lambda *report: told.append(report)
    monkeypatch.setattr(reweave, 'compile_scene', slow_build)
    with Beside(runner) as beside:
        wanted = runner.parameters.with_changes({'gravity': [0.0, 0.0, -1.0], 'duration': 7.0})
        runner.change(wanted).result(60.0)
        runner.change(wanted.with_changes({'duration': 9.0})).result(60.0)
        held.set()
        beside.wait_for(lambda: told)
    texts = [decode_string(data) for _, data in sink.of(WEAVE)][-2:]
    assert ['duration: 7.0' in text for text in texts] == [True, False]
    assert ['duration: 9.0' in text for text in texts] == [False, True]
    assert all('-1.0]' in text for text in texts)
    assert runner.simulation.scene.parameters['duration'] == 7.0
    assert runner.parameters['duration'] == 9.0


# Inputs of several senders, and inputs that wait.

def test_of_several_senders_the_last_wrench_rules_alone():
    """The sender does not matter; those of one stamp act in the order in which they came."""
    runner = paused_runner(sink := ListSink())
    with Beside(runner):
        for force in (1.0, 5.0, 2.0):
            push(runner, force=force * FORCE)
        push(runner, stamp=4_000_000, force=3.0 * FORCE)
        push(runner, stamp=3_000_000, force=4.0 * FORCE)
        runner.take_steps().result(60.0)
    assert [time for _, time, _ in sink.messages] == [0, 0, 0, 3_000_000, 4_000_000]
    assert runner.simulation.status.active_loads['tip'].force.tolist() == (3.0 * FORCE).tolist()


def test_wrench_of_a_sender_that_is_gone_stays_or_ends_with_its_hold_time():
    for hold, acts in ((0.0, True), (0.004, False)):
        runner = paused_runner(ListSink(), loads__tip__hold=hold)
        with Beside(runner):
            push(runner)
            runner.take_steps().result(60.0)
        assert bool(runner.simulation.status.active_loads) == acts


def test_queue_of_those_that_wait_is_bounded(monkeypatch, caplog):
    monkeypatch.setattr(received_inputs, 'MAX_WAITING_INPUTS', 3)
    runner = paused_runner(ListSink())
    with Beside(runner):
        for stamp in range(1, 7):
            push(runner, stamp=stamp * 10**6)
        runner.take_steps().result(60.0)
    assert runner.dropped == 3
    assert any('3 inputs are already waiting for their stamps' in record.getMessage()
               for record in caplog.records)


# Checkpoints.

def test_checkpoint_goes_to_the_file_and_to_bags_only(tmp_path):
    live, bag = ListSink(*TOPICS, CHECKPOINT), ListSink(CHECKPOINT, EVENTS, bag=True)
    runner = paused_runner(live, bag)
    path = tmp_path / 'one.checkpoint'
    with Beside(runner) as beside:
        push(runner)
        runner.take_steps().result(60.0)
        assert runner.save_checkpoint(path).result(60.0) == str(path)
        beside.wait_for(lambda: events(bag, 'checkpoint_saved'))
    saved = Checkpoint.load(path)
    [(time, data)] = bag.of(CHECKPOINT)
    assert time == 10_000_000 and live.of(CHECKPOINT) == []
    assert Checkpoint.from_bytes(decode_uint8_multi_array(data)).difference(saved) == ''
    [(_, facts)] = events(bag, 'checkpoint_saved')
    assert facts['path'] == str(path) and facts['of'] == 0.01


def test_restored_checkpoint_goes_on_to_the_same_bits(tmp_path, caplog):
    path, sink = tmp_path / 'one.checkpoint', ListSink(*TOPICS)
    bag = ListSink(CHECKPOINT, WEAVE, POSES, bag=True)
    runner = paused_runner(sink, bag, initial_random__spin_sigma=5.0)
    with Beside(runner):
        push(runner)
        runner.take_steps().result(60.0)
        runner.save_checkpoint(path).result(60.0)
        push(runner, force=-FORCE)
        runner.take_steps().result(60.0)
        first = sink.of(POSES)[-1]
        push(runner, stamp=runner.now + 1)
        count = len(bag.messages)
        assert runner.restore_checkpoint(path).result(60.0) == 10_000_000
        assert [kind for kind, _, _ in bag.messages[count:]] == [WEAVE, CHECKPOINT, POSES]
        assert runner.dropped == 1
        push(runner, force=-FORCE)
        assert runner.take_steps().result(60.0) == 20_000_000
    assert sink.of(POSES)[-1] == first
    [(_, facts)] = events(sink, 'checkpoint_restored')
    assert facts['time'] == 0.02 and facts['of'] == 0.01 and facts['dropped'] == 1
    [(simulation, _, ended)] = sink.jumps
    assert simulation is runner.simulation and ended.time == 20_000_000
    assert any('a checkpoint was restored before' in record.getMessage()
               for record in caplog.records)


def test_checkpoint_of_another_scene_is_refused_and_nothing_changes(tmp_path):
    path, sink = tmp_path / 'one.checkpoint', ListSink(EVENTS, POSES)
    runner = paused_runner(sink)
    with Beside(runner) as beside:
        runner.save_checkpoint(path).result(60.0)
        change(beside, runner, connector__stiffness=123.0)
        runner.take_steps().result(60.0)
        count = len(sink.of(POSES))
        with pytest.raises(ValueError, match='connector.stiffness'):
            runner.restore_checkpoint(path).result(60.0)
        with pytest.raises(OSError, match='none'):
            runner.restore_checkpoint(tmp_path / 'none').result(60.0)
    assert len(sink.of(POSES)) == count and sink.jumps == [] and runner.now == 10_000_000


def test_checkpoint_that_cannot_be_written_is_told():
    runner = paused_runner(sink := ListSink(EVENTS))
    with Beside(runner):
        with pytest.raises(OSError, match='nowhere'):
            runner.save_checkpoint('/nowhere/at/all').result(60.0)
    assert events(sink, 'checkpoint_saved') == []


def test_checkpoint_from_in_between_two_nanoseconds(tmp_path):
    runner = paused_runner(sink := ListSink(POSES))
    other = ico.compile_scene(runner.simulation.scene)
    other.advance_to(np.pi / 1000.0)
    other.checkpoint().save(tmp_path / 'pi')
    with Beside(runner):
        assert runner.restore_checkpoint(tmp_path / 'pi').result(60.0) == 3_141_593
    assert runner.simulation.time == 0.003141593
    other.advance_to(0.003141593)
    poses = decode_pose_array(sink.of(POSES)[-1][1])
    assert poses.values[:, :3].tobytes() == other.snapshot().position.tobytes()


def test_run_that_begins_elsewhere_is_recorded_from_a_checkpoint():
    simulation = ico.compile_scene(ico.Scene.from_parameters(SCENE))
    assert is_initial(simulation)
    simulation.apply_wrench('tip', time=0.05)
    assert not is_initial(simulation)
    simulation.advance_to(0.02)
    bag = ListSink(CHECKPOINT, POSES, bag=True)
    runner = run(Runner(simulation, [bag]))
    assert [time for time, _ in bag.of(CHECKPOINT)] == [20_000_000]
    assert bag.of(POSES)[0][0] == 20_000_000 and runner.now == 100_000_000
    simulation.reset_time()
    assert is_initial(simulation)
    simulation.set_state(linear_velocity=np.ones((simulation.scene.body_count, 3)))
    assert not is_initial(simulation)


# Recording on and off.

def test_recording_is_switched_on_with_scene_and_state():
    live, bag = ListSink(*TOPICS), BagLike(WEAVE, CHECKPOINT, POSES, EVENTS)
    runner = paused_runner(live, bag)
    with Beside(runner):
        runner.take_steps().result(60.0)
        runner.set_recording(False).result(60.0)
        bag.messages.clear()
        count = len(live.of(WEAVE))
        assert runner.set_recording(True).result(60.0) == 'bag 2'
    assert [kind for kind, _, _ in bag.messages] == [WEAVE, CHECKPOINT, POSES, EVENTS]
    assert bag.switched == [(False, 0.01, 10_000_000), (True, 0.01, 10_000_000)]
    assert [facts['on'] for _, facts in events(live, 'record')] == [False, True]
    # Subscribers have it all already.
    assert len(live.of(WEAVE)) == count


def test_recording_at_the_start_needs_no_checkpoint():
    bag = BagLike(WEAVE, CHECKPOINT, POSES)
    with Beside(runner := paused_runner(bag)):
        bag.messages.clear()
        runner.set_recording(True).result(60.0)
    assert [kind for kind, _, _ in bag.messages][-2:] == [WEAVE, POSES]
    assert not bag.of(CHECKPOINT)


def test_recording_that_is_not_possible_is_refused():
    with Beside(runner := paused_runner(ListSink(POSES))):
        with pytest.raises(RuntimeError, match='record.path'):
            runner.set_recording(True).result(60.0)
    bag = BagLike(POSES)
    bag.refusal = 'no room'
    with Beside(runner := paused_runner(bag)):
        with pytest.raises(BagError, match='no room'):
            runner.set_recording(True).result(60.0)


def test_nothing_is_saved_or_recorded_of_a_run_that_has_failed(tmp_path):
    runner = paused_runner(bag := BagLike(POSES))
    with Beside(runner):
        push(runner, force=[1e308, 1e308, 1e308], judged=False)
        with pytest.raises(RuntimeError):
            runner.take_steps().result(60.0)
        for future in (
            runner.save_checkpoint(tmp_path / 'x'), runner.set_recording(True)
        ):
            with pytest.raises(RuntimeError, match='has stopped .*reset it first'):
                future.result(60.0)
    assert bag.switched == [] and not (tmp_path / 'x').exists()
