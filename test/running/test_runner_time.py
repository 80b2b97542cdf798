# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Simulated time under pressure: floods, failures, long steps, and what is asked for in between.
"""
import time

from icofabric_sim.messages.schedule import nanoseconds_not_before, seconds
from icofabric_sim.messages.topics import CLOCK, POSES
from icofabric_sim.parameters.validation import make_parameters, ParameterError
from icofabric_sim.running import time_advance
from icofabric_sim.running.real_time_factor import RealTimeFactor
from icofabric_sim.simulation.errors import SimulationError
import numpy as np
import pytest
from runner_helpers import Beside, ListSink, make_runner, push, run


def messages_of(caplog, word):
    return [record.getMessage() for record in caplog.records if word in record.getMessage()]


def test_a_duration_below_a_nanosecond_ends_too():
    runner = make_runner(ListSink(POSES), duration=1e-12, real_time_factor=0.0)
    runner.run(until_finished=True)
    assert runner.finished and runner.now == 1


def test_flood_of_messages_does_not_drive_the_time():
    factor = 0.01
    runner = make_runner(ListSink(POSES), real_time_factor=factor, duration=0.0)
    began = time.monotonic()
    with Beside(runner) as beside:
        for _ in range(300):
            runner.post(lambda: None).result(60.0)
        beside.wait_for(lambda: runner.now > 0)
        reached = seconds(runner.now)
    # However slow the machine is, it may not be faster; by one chunk at most.
    assert 0.0 < reached <= factor * (time.monotonic() - began + 0.011)


def test_chunk_is_bounded_by_the_target_factor():
    """
    Without subscribers nothing else would bound it, and an immediate wrench would act far ahead.
    """
    real_time = RealTimeFactor(0.5)
    real_time.record_steps(10**12, 0.001)
    assert real_time.chunk(0.01, 1e-4) == real_time.chunk(0.01, 1.0) == 5_000_000
    real_time.set_target(1e-6, 0)
    assert real_time.chunk(0.01, 1e-4) == 10
    real_time.set_target(0.0, 0)
    assert real_time.chunk(0.01, 1e-4) == 10**13
    real_time.forget_speed()
    assert real_time.chunk(0.01, 1e-4) == 100_000


@pytest.mark.parametrize(('name', 'bad', 'good'), [
    ('duration', 1e300, 1e9),
    ('input_horizon', 1e300, 1e9),
    ('real_time_factor', 1e300, 1e6),
    ('real_time_factor', 1e-300, 1e-6),
    ('real_time_factor', 9e-7, 0.0),
    ('step_count', 10**7, 10**6),
])
def test_values_that_no_run_could_use_are_refused(name, bad, good):
    assert make_parameters({name: good})[name] == good
    with pytest.raises(ParameterError, match=f'{name} must be at least .* and at most') as error:
        make_parameters({name: bad})
    assert ('or 0' in str(error.value)) == (name == 'real_time_factor')


@pytest.mark.parametrize('factor', [1e-6, 1e6])
def test_extreme_paces_and_durations_run(factor):
    runner = make_runner(
        ListSink(POSES), real_time_factor=factor, duration=1e9, input_horizon=1e9)
    with Beside(runner) as beside:
        push(runner, stamp=10**18)
        beside.wait_for(lambda: runner.now > 0)
    assert runner.failure == '' and not runner.finished


def test_wrench_that_the_simulation_fails_on_ends_the_run_in_order(caplog):
    runner = make_runner(sink := ListSink())

    def fail(time):
        raise SimulationError('too much')

    # What the simulation does once time goes on from where wrenches have changed.
    runner.simulation._driver.cut = fail
    for stamp in (10_000_000, 10_000_000, 20_000_000):
        push(runner, stamp=stamp)
    run(runner)
    # At the last state that is good: the step was not ended at the wrench.
    now = nanoseconds_not_before(runner.simulation.time)
    assert runner.failure == 'too much' and 0 < runner.now == now < 10_000_000
    assert len(sink.messages) == 2 and runner.dropped == 1
    [warning] = messages_of(caplog, 'dropped')
    assert warning.startswith('1 waiting input was dropped') and 'has stopped' in warning


def test_infinite_load_is_forgotten_by_a_reset():
    runner = make_runner(ListSink())
    for stamp in (10_000_000, 20_000_000):
        push(runner, stamp=stamp, force=[1e308, 1e308, 1e308], judged=False)
    run(runner)
    assert runner.failure and runner.dropped == 1
    runner.reset()
    run(runner)
    assert runner.failure == '' and runner.finished


def failing_runner(**changes):
    settings = {
        'weave__size': [3, 3, 3], 'initial_random__velocity_sigma': 3.0,
        'solver__method': 'srkn6', **changes}
    step = np.nextafter(make_runner(**settings).simulation.status.stability_limit, 0.0)
    return make_runner(ListSink(POSES), solver__step=float(step), **settings)


def test_time_goes_on_after_steps_that_failed():
    runner = failing_runner(start_paused=True, step_count=10**5, duration=1.0)
    with Beside(runner) as beside:
        with pytest.raises(RuntimeError, match='of 100000 solver steps taken.*solver.step'):
            runner.take_steps().result(60.0)
        failed = runner.now
        assert failed > 0 and runner.failure
        assert 0.0 <= seconds(failed) - runner.simulation.time < 2e-9
        assert runner.reset().result(60.0) >= failed
        runner.set_paused(False).result(60.0)
        beside.wait_for(lambda: runner.now > failed)
        assert beside.thread.is_alive()


def test_stop_is_heard_within_a_long_advance():
    """The run ends at the end of a step, and the simulation can go on from there."""
    runner = make_runner(ListSink(), duration=0.0, solver__step=1e-6)
    runner._real_time.chunk = lambda *arguments: 2 * 10**10
    with Beside(runner) as beside:
        beside.wait_for(lambda: runner.simulation.status.step_count > 100)
    assert 0 < runner.now < 2 * 10**10
    simulation = runner.simulation
    assert 0.0 <= seconds(runner.now) - simulation.time < 2e-9
    count = simulation.status.step_count
    simulation.advance_steps(50)
    assert simulation.status.step_count == count + 50


def test_endless_commands_do_not_stop_the_time():
    runner = make_runner(ListSink())
    calls = []

    def again():
        calls.append(runner.now)
        if not runner.now and len(calls) < 100_000:
            runner.post(again)

    runner.post(again)
    run(runner)
    assert calls[-1] > 0


ENDINGS = {
    'pause': (lambda runner: runner.set_paused(True), 'ended by a pause'),
    'resume': (lambda runner: runner.set_paused(False), 'the run was resumed'),
    'reset': (lambda runner: runner.reset(), 'ended by a reset'),
    'stop': (lambda runner: runner.stop(), 'the run has ended'),
}


@pytest.mark.parametrize('ending', ENDINGS)
def test_many_steps_leave_room_for_requests(ending, caplog):
    act, reason = ENDINGS[ending]
    runner = make_runner(
        ListSink(), start_paused=True, solver__step=1e-6, step_count=10**6, duration=0.0)
    with Beside(runner) as beside:
        future = runner.take_steps()
        beside.wait_for(lambda: runner.now > 0)
        assert 0 < runner.post(lambda: runner.simulation.status.step_count).result(60.0) < 10**6
        assert not future.done()
        act(runner)
        error = future.exception(60.0)
    assert isinstance(error, RuntimeError) and reason in str(error)
    taken = int(str(error).split()[0])
    assert 0 < taken < 10**6 and f'{taken} of 1000000 solver steps' in str(error)
    assert messages_of(caplog, reason) == [str(error)]


def test_requests_for_steps_follow_each_other():
    runner = make_runner(ListSink(), start_paused=True, solver__step=1e-5, step_count=1000)
    with Beside(runner):
        futures = [runner.take_steps(), runner.take_steps()]
        times = [future.result(60.0) for future in futures]
    assert times == pytest.approx([10**7, 2 * 10**7], abs=2)
    assert runner.simulation.status.step_count == 2000


def test_steps_are_refused_while_time_runs():
    runner = make_runner(ListSink(), duration=0.0)
    with Beside(runner), pytest.raises(RuntimeError, match='only while paused'):
        runner.take_steps().result(60.0)


def test_input_at_the_end_of_a_step_costs_none():
    runner = make_runner(
        sink := ListSink(), start_paused=True, solver__step=0.001, step_count=3, duration=0.0)
    with Beside(runner):
        push(runner, stamp=1_000_000)
        push(runner, stamp=2_000_000)
        assert runner.take_steps().result(60.0) == 3_000_000
    assert runner.simulation.status.step_count == 3
    assert [now for _, now, _ in sink.messages] == [1_000_000, 2_000_000]


def test_wrenches_beyond_the_end_are_counted(caplog):
    runner = make_runner(ListSink())
    for stamp in (50_000_000, 100_000_001, 200_000_000):
        push(runner, stamp=stamp)
    run(runner)
    assert runner.dropped == runner.status().dropped == 2
    [warning] = messages_of(caplog, 'dropped')
    assert '2 waiting inputs' in warning and '/loads/tip' in warning and 'ended' in warning


def test_wrenches_that_a_reset_forgets_are_counted(caplog):
    runner = make_runner(sink := ListSink(), start_paused=True)
    with Beside(runner):
        push(runner, stamp=50_000_000)
        runner.reset().result(60.0)
    assert runner.dropped == 1 and sink.messages == []
    [warning] = messages_of(caplog, 'dropped')
    assert warning.startswith('1 waiting input was dropped') and 'reset' in warning


@pytest.mark.parametrize('method', ['leapfrog', 'srkn6', 'dop8'])
def test_calls_that_are_broken_off_change_no_bit(method, monkeypatch):
    ends = []
    for patience in (1e9, 0.0):
        monkeypatch.setattr(time_advance, '_MAX_CALL_S', patience)
        sink = ListSink(POSES)
        # Fast enough for some hundred steps between two outputs, so for calls that take a while.
        runner = make_runner(
            sink, solver__method=method, initial_random__spin_sigma=50.0, duration=0.5,
            publish_rate=4.0, connector__stiffness=2e5, solver__tolerance=1e-3)
        push(runner, stamp=123_456_789)
        broken = []
        reaches = runner._time._reaches
        monkeypatch.setattr(
            runner._time, '_reaches', lambda target, reaches=reaches, broken=broken: (
                broken.append(reaches(target)) or broken[-1]))
        run(runner)
        assert runner.now == 500_000_000 and not runner.failure
        ends.append((sink.of(POSES), False in broken))
    assert ends[0][0] == ends[1][0] and len(ends[0][0]) == 3
    assert [broken for _, broken in ends] == [False, True]


def test_call_that_is_broken_off_at_once_repeats_no_output(monkeypatch):
    """The time at which it stands has been shown."""
    sink = ListSink(CLOCK)
    runner = make_runner(sink, solver__method='leapfrog', solver__step=1e-4, duration=0.1)
    reaches, broken = runner._time._reaches, []

    def breaks_off(target):
        # At every tick but the first.
        if sink.of(CLOCK) and runner.now > 0 and runner.now not in broken:
            broken.append(runner.now)
            return False
        return reaches(target)

    monkeypatch.setattr(runner._time, '_reaches', breaks_off)
    run(runner)
    stamps = [stamp for stamp, _ in sink.of(CLOCK)]
    assert len(broken) > 5 and not runner.failure
    assert stamps == sorted(set(stamps)) and len(stamps) == 11
