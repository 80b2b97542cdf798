# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What interrupts a run: pause, steps, reset, failure, and changes of the scene."""
import json
import threading

from fabrics import warnings_said
from icofabric_sim.kernels.runtime.kernel_guard import _guard
from icofabric_sim.messages import decode_marker_points, decode_pose_array, decode_string
from icofabric_sim.messages.topics import (
    CLOCK,
    CONNECTORS,
    CONTACTS,
    EVENTS,
    POSES,
    REACTIONS,
    TOPICS,
    WEAVE,
)
from icofabric_sim.process.compile_notice import KernelsMissing
from icofabric_sim.running import reweave, run_changes, time_advance
from icofabric_sim.running import runner as runner_module
from icofabric_sim.running.checkpoint_files import path_to_restore, path_to_save
from icofabric_sim.running.parameter_change import ParameterChange
from icofabric_sim.running.time_requests import StepRequest
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import KernelsAwaited, SimulationError
from icofabric_sim.simulation.simulation import compile_scene
import numpy as np
import pytest
from runner_helpers import Beside, ListSink, make_runner, push, run


def test_pause_and_steps():
    sink = ListSink(POSES)
    runner = make_runner(sink, start_paused=True, solver__step=0.001, step_count=3, duration=0.0)
    with Beside(runner):
        assert runner.take_steps().result(60.0) == 3_000_000
        assert runner.simulation.status.step_count == 3
        # An input within the steps ends one of them there.
        push(runner, stamp=4_500_000)
        assert runner.take_steps().result(60.0) == 5_500_000
        assert runner.paused
        assert runner.set_paused(False).result(60.0) == 5_500_000
    assert runner.now > 5_500_000
    times = [time for time, _ in sink.of(POSES)]
    assert {0, 3_000_000, 5_500_000} <= set(times)
    assert [time for time, _ in sink.of('~/loads/tip')] == [4_500_000]


def test_steps_tick_where_they_end_however_long_they_take(monkeypatch):
    monkeypatch.setattr(time_advance, 'RESPONSE', 0.0)
    monkeypatch.setattr(runner_module, '_IDLE_REFRESH', 0.0)
    sink = ListSink(CLOCK, EVENTS)
    runner = make_runner(
        sink, start_paused=True, duration=0.0, solver__step=0.0013, step_count=7)
    with Beside(runner):
        runner.take_steps().result(60.0)
        end = runner.take_steps().result(60.0)
    assert end == pytest.approx(14 * 1_300_000, abs=20)
    told = {time for time, data in sink.of(EVENTS)}
    ticks = {time for time, _ in sink.of(CLOCK)}
    assert len(told) == 2 and ticks == told | {0}


def test_paused_run_repeats_itself_for_live_listeners_only(monkeypatch):
    monkeypatch.setattr('icofabric_sim.running.runner._IDLE_REFRESH', 0.01)
    live, bag = ListSink(POSES, CLOCK), ListSink(POSES, CLOCK, bag=True)
    with Beside(make_runner(bag, live, start_paused=True)) as beside:
        beside.wait_for(lambda: len(live.of(POSES)) > 5)
    assert len(bag.of(POSES)) == 1
    assert len(set(live.of(POSES))) == 1


def test_reset_keeps_the_time_unless_told():
    sink = ListSink(*TOPICS)
    runner = make_runner(sink, initial_random__spin_sigma=5.0)
    push(runner)
    run(runner)
    runner.reset()
    push(runner, stamp=10**9)
    runner._do_commands()
    assert runner.now == 100_000_000 and sink.jumps == []
    assert runner.simulation.status.active_loads == {}
    pose = decode_pose_array(sink.of(POSES)[-1][1])
    assert pose.nanoseconds == 100_000_000
    assert (pose.values[:, :3] == runner.simulation.scene.position).all()
    # Removed markers first, then those of the initial state.
    actions = [decode_marker_points(data).action for _, data in sink.of(CONNECTORS)]
    assert actions.count(3) == 1 and set(actions[actions.index(3) + 1:]) == {0, 2}


def test_reset_of_time_repeats_the_run():
    sink = ListSink(POSES)
    runner = run(make_runner(sink, reset_time=True, initial_random__spin_sigma=5.0))
    first = sink.of(POSES)
    sink.messages.clear()
    runner.reset()
    run(runner)
    [(simulation, parameters, ended)] = sink.jumps
    assert simulation is runner.simulation and parameters is runner.parameters
    assert ended.time == 100_000_000 and ended.finished
    # Asked for before the run began again: it starts with the old state at the old time.
    start = max(k for k, (time, _) in enumerate(sink.of(POSES)) if time == 0)
    assert sink.of(POSES)[start:] == first


UNSTABLE = {
    'weave__size': [3, 3, 3], 'initial_random__velocity_sigma': 3.0, 'solver__method': 'srkn6'}


def unstable_runner(sink):
    scene = make_runner(**UNSTABLE).simulation
    step = float(np.nextafter(scene.status.stability_limit, 0.0))
    return make_runner(sink, solver__step=step, duration=1.0, **UNSTABLE)


def test_failure_stops_the_time_and_a_reset_forgets_it(caplog):
    sink = ListSink(POSES)
    runner = run(unstable_runner(sink))
    assert 0 < runner.now < 10**9 and 'solver.step' in runner.failure
    assert runner.status().failure == runner.failure
    assert sink.of(POSES)[-1][0] == runner.now
    # The state before the failure is kept, and can be looked at.
    assert np.isfinite(runner.simulation.snapshot().position).all()
    for _ in range(50):
        push(runner)
    runner.take_steps()
    runner._do_commands()
    assert runner.dropped == 50
    assert sum('was dropped' in record.getMessage() for record in caplog.records) == 1
    runner.reset()
    runner._do_commands()
    assert runner.failure == ''


def test_error_of_a_command_goes_to_the_one_who_asked():
    runner = make_runner(ListSink())
    future = runner.post(lambda: 1 // 0)
    run(runner)
    with pytest.raises(ZeroDivisionError):
        future.result(0.0)
    assert runner.now == 100_000_000


@pytest.mark.parametrize('topic, is_measured', [
    (POSES, False), (REACTIONS, True), (CONTACTS, True)])
def test_forces_are_measured_while_a_sink_wants_them(topic, is_measured):
    assert make_runner(ListSink(CLOCK), ListSink(topic))._broadcast.is_measured() == is_measured


def change_and_wait(beside, runner, told, **changes):
    count = len(told)
    dotted = {name.replace('__', '.'): value for name, value in changes.items()}
    wanted = runner.parameters.with_changes(dotted)
    runner.change(wanted)
    beside.wait_for(lambda: len(told) > count)
    return wanted


def test_changes_of_the_scene():
    """A live change keeps state, time and wrenches; a new weave keeps the time."""
    sink, told = ListSink(POSES, WEAVE, CONNECTORS), []
    runner = make_runner(sink, start_paused=True, duration=0.0, solver__step=0.001, step_count=20)
    runner.changes.on_rebuilt = lambda *report: told.append(report)
    with Beside(runner) as beside:
        push(runner)
        push(runner, key=0)
        runner.take_steps().result(60.0)
        before = runner.simulation
        wanted = change_and_wait(beside, runner, told, connector__stiffness=250.0)
        assert told == [(wanted, '')] and runner.simulation is not before
        assert runner.parameters is wanted
        assert (runner.simulation.snapshot().position == before.snapshot().position).all()
        assert set(runner.simulation.status.active_loads) == {'tip', 0}
        assert runner.now == 20_000_000 and runner.simulation.time == 0.02
        wanted = change_and_wait(beside, runner, told, weave__size=[3, 3, 3])
        assert runner.simulation.scene.body_count > before.scene.body_count
        assert runner.now == 20_000_000
        assert (runner.simulation.snapshot().position == runner.simulation.scene.position).all()
        pose = decode_pose_array(sink.of(POSES)[-1][1])
        assert len(pose.values) == runner.simulation.scene.body_count
        assert runner.take_steps().result(60.0) == 40_000_000
    texts = [decode_string(data) for _, data in sink.of(WEAVE)]
    assert ['stiffness: 250.0' in text for text in texts] == [False, True, True]


def test_change_that_cannot_be_built_leaves_everything():
    sink, told = ListSink(WEAVE), []
    runner = make_runner(sink, start_paused=True, solver__step=0.001)
    runner.changes.on_rebuilt = lambda *report: told.append(report)
    before = runner.simulation, runner.parameters
    with Beside(runner) as beside:
        wanted = change_and_wait(beside, runner, told, connector__stiffness=1e9)
        assert told[0][0] is wanted and 'solver.step' in told[0][1]
    assert (runner.simulation, runner.parameters) == before
    assert len(sink.of(WEAVE)) == 1


def test_a_change_that_cannot_be_built_takes_none_with_it_that_was_accepted_before():
    sink = ListSink(EVENTS)
    runner = make_runner(sink, duration=0.0)
    softer = runner.parameters.with_changes({'connector.stiffness': 200.0})
    light = softer.with_changes({'gravity': [0.0, 0.0, -1.62]})
    wrong = light.with_changes({'solver.step': 1.0})
    with Beside(runner):
        # All are there before the first is built.
        changes = [
            ParameterChange(runner.parameters, each) for each in (softer, light, wrong)]
        answers = [change.outcome for change in changes]
        for change in changes:
            runner.apply_change(change)
        assert answers[0].result(60.0) == answers[1].result(60.0) == ''
        assert 'solver.step' in answers[2].result(60.0)
    assert runner.simulation.scene.parameters == runner.parameters == light
    events = [json.loads(decode_string(data))['event'] for _, data in sink.of(EVENTS)]
    assert [name for name in events if name in ('reweave', 'change_refused')] == [
        'reweave', 'change_refused']


def test_rates_change_without_a_new_fabric():
    sink = ListSink(POSES, WEAVE)
    runner = make_runner(sink)
    simulation = runner.simulation
    runner.change(runner.parameters.with_changes({'publish_rate': 10.0, 'duration': 0.3}))
    run(runner)
    assert runner.simulation is simulation
    assert [time for time, _ in sink.of(POSES)] == [k * 10**8 for k in range(4)]
    assert 'publish_rate: 10.0' in decode_string(sink.of(WEAVE)[-1][1])


def test_rates_act_at_once_while_another_fabric_is_being_built(monkeypatch):
    held = threading.Event()

    def slow_build(scene, **options):
        held.wait(60.0)
        return compile_scene(scene, **options)

    runner = make_runner(ListSink(POSES), start_paused=True, duration=0.0)
    told = []
    runner.changes.on_rebuilt = lambda *report: told.append(report)
    monkeypatch.setattr(reweave, 'compile_scene', slow_build)
    with Beside(runner) as beside:
        woven = runner.parameters.with_changes({'weave.size': [3, 3, 3]})
        runner.change(woven).result(60.0)
        wanted = woven.with_changes({'publish_rate': 7.0, 'real_time_factor': 0.5})
        runner.change(wanted).result(60.0)
        assert runner.parameters['publish_rate'] == 7.0
        assert runner.parameters['real_time_factor'] == 0.5
        assert runner.parameters['weave.size'] != [3, 3, 3] and not told
        held.set()
        beside.wait_for(lambda: told)
    assert told == [(wanted, '')] and runner.parameters == wanted
    assert runner.simulation.scene.parameters['weave.size'] == [3, 3, 3]


def test_wrench_that_waits_for_a_body_that_is_gone_is_dropped(caplog):
    sink, told = ListSink(), []
    runner = make_runner(sink, start_paused=True)
    runner.changes.on_rebuilt = lambda *report: told.append(report)
    last = runner.simulation.scene.body_count - 1
    with Beside(runner) as beside:
        push(runner, key=last, stamp=10**7)
        change_and_wait(beside, runner, told, weave__size=[2, 2, 1])
        runner.set_paused(False)
        beside.wait_for(lambda: runner.finished)
    assert runner.dropped == 1 and sink.messages == []
    [warning] = warnings_said(caplog)
    assert warning.startswith(
        '1 waiting input was dropped (~/wrench; the first for t = 0.01 s): ')
    assert 'the weave has changed' in warning


def test_what_parameters_say_is_read_in_the_order_of_the_commands(tmp_path):
    """A change that was accepted counts for whatever is asked for after it."""
    runner = make_runner(ListSink(), start_paused=True, step_count=3, solver__step=0.001)
    runner.change(runner.parameters.with_changes(
        {'step_count': 7, 'checkpoint.path': str(tmp_path / 'new.checkpoint')}))
    steps = StepRequest()
    taken, saved = runner.take_steps(steps), runner.save_checkpoint(path_to_save)
    assert runner.parameters['step_count'] == 3  # nothing is done yet
    with Beside(runner):
        assert taken.result(60.0) == 7_000_000 and steps.count == 7
        assert saved.result(60.0) == str(tmp_path / 'new.checkpoint')
        elsewhere = runner.parameters.with_changes({'checkpoint.path': str(tmp_path / 'none')})
        runner.change(elsewhere)
        with pytest.raises(ValueError, match='no checkpoint in .*none'):
            runner.restore_checkpoint(path_to_restore).result(60.0)


def test_scene_that_was_built_to_judge_a_change_is_used(monkeypatch):
    built, told = [], []

    class CountedScene(Scene):

        @classmethod
        def from_parameters(cls, parameters):
            built.append(parameters)
            return Scene.from_parameters(parameters)

    monkeypatch.setattr(reweave, 'Scene', CountedScene)
    runner = make_runner(ListSink(), start_paused=True)
    runner.changes.on_rebuilt = lambda *report: told.append(report)
    wanted = runner.parameters.with_changes({'connector.stiffness': 300.0})
    scene = Scene.from_parameters(wanted)
    with Beside(runner) as beside:
        runner.apply_change(ParameterChange(runner.parameters, wanted, scene))
        beside.wait_for(lambda: told)
        assert runner.simulation.scene is scene and not built
        again = wanted.with_changes({'connector.stiffness': 400.0})
        runner.change(again)
        beside.wait_for(lambda: len(told) == 2)
    assert built == [again] and runner.simulation.scene.parameters == again
    assert [reason for _, reason in told] == ['', '']


def test_scene_of_a_later_change_is_used_once_the_earlier_one_is_built(monkeypatch):
    """Changes that come while a fabric is built are one more build, of the last scene."""
    held, told = threading.Event(), []

    def slow_compile(scene, **options):
        held.wait(60.0)
        return compile_scene(scene, **options)

    monkeypatch.setattr(reweave, 'compile_scene', slow_compile)
    runner = make_runner(ListSink(), start_paused=True)
    runner.changes.on_rebuilt = lambda *report: told.append(report)
    first = runner.parameters.with_changes({'connector.stiffness': 300.0})
    second = first.with_changes({'gravity': [0.0, 0.0, -1.0]})
    scenes = [Scene.from_parameters(parameters) for parameters in (first, second)]
    with Beside(runner) as beside:
        runner.apply_change(ParameterChange(runner.parameters, first, scenes[0]))
        runner.apply_change(ParameterChange(first, second, scenes[1])).result(60.0)
        held.set()
        beside.wait_for(lambda: told)
        assert runner.simulation.scene is scenes[1]
    assert told == [(second, '')]


def test_a_swap_that_lacks_kernels_never_compiles_them_in_the_run(monkeypatch):
    """It changes nothing and is tried again, with the motion of a swap at that time."""
    guards, replace = [], run_changes.replace_simulation

    def lacks_at_first(*arguments):
        guards.append(bool(_guard.forbids))
        restarts = replace(*arguments)
        if len(guards) == 1:
            raise KernelsMissing
        return restarts

    monkeypatch.setattr(run_changes, 'replace_simulation', lacks_at_first)
    told, sink = [], ListSink(EVENTS)
    runner, other = (make_runner(
        each, start_paused=True, duration=0.0, solver__step=0.001, step_count=20)
        for each in (sink, ListSink()))
    runner.changes.on_rebuilt = lambda *report: told.append(report)
    with Beside(runner) as beside, Beside(other):
        for each in (runner, other):
            push(each)
            each.take_steps().result(60.0)
        change = ParameterChange(
            runner.parameters, runner.parameters.with_changes({'connector.damping': 0.01}))
        runner.apply_change(change)
        assert change.outcome.result(60.0) == '' and guards == [True, True]
        beside.wait_for(lambda: told)
        other.apply_change(again := ParameterChange(change.before, change.after))
        assert again.outcome.result(60.0) == '' and guards == [True, True, True]
        for each in (runner, other):
            each.take_steps().result(60.0)
    names = [json.loads(decode_string(data))['event'] for _, data in sink.of(EVENTS)]
    assert names == ['step', 'reweave', 'step'] and len(told) == 1
    state, expected = runner.simulation.snapshot(), other.simulation.snapshot()
    assert state.time == expected.time and set(runner.simulation.status.active_loads) == {'tip'}
    assert state.position.tobytes() == expected.position.tobytes()


@pytest.mark.parametrize('error', [
    MemoryError('no room'), KernelsAwaited(), SimulationError('it cannot go on'),
    ValueError('it cannot be')])
@pytest.mark.parametrize('place', ['replace_simulation', 'set_scene'])
def test_a_change_that_fails_as_it_is_put_in_place_leaves_the_run_as_it_was(
        monkeypatch, place, error):
    def fail(*arguments):
        raise error

    changed = {'connector__stiffness': 250.0}
    sink, told = ListSink(EVENTS, WEAVE), []
    runner = make_runner(sink, duration=0.0, start_paused=True, step_count=5)
    runner.changes.on_rebuilt = lambda *outcome: told.append(outcome)
    before, in_force = runner.simulation, runner.parameters
    wanted = in_force.with_changes({'connector.stiffness': changed['connector__stiffness']})
    with monkeypatch.context() as patched, Beside(runner):
        if place == 'set_scene':
            patched.setattr(runner._broadcast, 'set_scene', fail)
        else:
            patched.setattr(run_changes, 'replace_simulation', fail)
        runner.take_steps().result(60.0)
        change = ParameterChange(in_force, wanted)
        runner.apply_change(change).result(60.0)
        reason = change.outcome.result(60.0)
        assert reason == str(error) and told == [(wanted, reason)]
        assert runner.simulation is before and runner.parameters is in_force
        runner.take_steps().result(60.0)
    refused = [json.loads(decode_string(data)) for _, data in sink.of(EVENTS)]
    assert [event['reason'] for event in refused if event['event'] == 'change_refused'] == [reason]
    assert not any(event['event'] == 'reweave' for event in refused)
    other = make_runner(duration=0.0, start_paused=True, step_count=5)
    with Beside(other):
        other.take_steps().result(60.0)
        other.take_steps().result(60.0)
    state, expected = before.snapshot(), other.simulation.snapshot()
    assert state.time == expected.time > 0.0
    assert state.position.tobytes() == expected.position.tobytes()
