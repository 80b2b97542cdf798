# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""What interrupts a run: pause, steps, reset, failure, and changes of the scene."""
import threading

from fabrics import warnings_said
from icofabric_sim.messages import decode_marker_points, decode_pose_array, decode_string
from icofabric_sim.messages.topics import CLOCK, CONNECTORS, EVENTS, POSES, TOPICS, WEAVE
from icofabric_sim.running import reweave, time_line
from icofabric_sim.running import runner as runner_module
from icofabric_sim.simulation.simulation import compile_scene
import numpy as np
import pytest
from runner_helpers import Beside, ListSink, make_runner, push, run


def test_pause_and_steps():
    sink = ListSink(POSES)
    runner = make_runner(sink, start_paused=True, solver__step=0.001, step_count=3, duration=0.0)
    with Beside(runner):
        assert runner.take_steps().result(60.0) == 3_000_000
        assert runner.simulation.step_count == 3
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
    monkeypatch.setattr(time_line, 'RESPONSE', 0.0)
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
    runner._run_commands()
    assert runner.now == 100_000_000 and sink.jumps == []
    assert runner.simulation.active_loads == {}
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
    step = float(np.nextafter(scene.stability_limit, 0.0))
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
    runner._run_commands()
    assert runner.dropped == 50
    assert sum('was dropped' in record.getMessage() for record in caplog.records) == 1
    runner.reset()
    runner._run_commands()
    assert runner.failure == ''


def test_error_of_a_command_goes_to_the_one_who_asked():
    runner = make_runner(ListSink())
    future = runner.post(lambda: 1 // 0)
    run(runner)
    with pytest.raises(ZeroDivisionError):
        future.result(0.0)
    assert runner.now == 100_000_000


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
    runner.on_rebuilt = lambda *report: told.append(report)
    with Beside(runner) as beside:
        push(runner)
        push(runner, key=0)
        runner.take_steps().result(60.0)
        before = runner.simulation
        wanted = change_and_wait(beside, runner, told, connector__stiffness=250.0)
        assert told == [(wanted, '')] and runner.simulation is not before
        assert runner.parameters is wanted
        assert (runner.simulation.snapshot().position == before.snapshot().position).all()
        assert set(runner.simulation.active_loads) == {'tip', 0}
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
    runner.on_rebuilt = lambda *report: told.append(report)
    before = runner.simulation, runner.parameters
    with Beside(runner) as beside:
        wanted = change_and_wait(beside, runner, told, connector__stiffness=1e9)
        assert told[0][0] is wanted and 'solver.step' in told[0][1]
    assert (runner.simulation, runner.parameters) == before
    assert len(sink.of(WEAVE)) == 1


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
    runner.on_rebuilt = lambda *report: told.append(report)
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
    runner.on_rebuilt = lambda *report: told.append(report)
    last = runner.simulation.scene.body_count - 1
    with Beside(runner) as beside:
        push(runner, key=last, stamp=10**7)
        change_and_wait(beside, runner, told, weave__size=[2, 2, 1])
        runner.set_paused(False)
        beside.wait_for(lambda: runner.finished)
    assert runner.dropped == 1 and sink.messages == []
    [warning] = warnings_said(caplog)
    assert warning.startswith(
        '1 waiting wrench was dropped (~/wrench; the first for t = 0.01 s): ')
    assert 'the weave changed before' in warning
