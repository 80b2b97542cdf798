# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Advances by a duration, and loads that are cleared: what a run does, shows and records."""
from concurrent.futures import wait
import json

from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.messages import decode_string
from icofabric_sim.messages.topics import EVENTS, POSES, STATE
from icofabric_sim.running import runner as runner_module
from icofabric_sim.running.recording import BagSink, summarise_run
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.running.runner import Runner
from icofabric_sim.running.time_requests import AdvanceRequest, TimeRequests
from icofabric_sim.simulation.inputs.input_types import ChannelTarget
from icofabric_sim.simulation.simulation import compile_scene
import numpy as np
import pytest
from recorded_runs import swing_scene
from runner_helpers import Beside, ListSink, make_runner, push

PAUSED = {'start_paused': True, 'duration': 0.0, 'real_time_factor': 1.0}


def events_of(sink):
    return [json.loads(decode_string(data)) for _, data in sink.of(EVENTS)]


def test_advance_is_exact_and_shown_once():
    """Times that no output and no step falls on, also as a sum, to the nanosecond."""
    runner = make_runner(
        sink := ListSink(POSES, EVENTS, bag=True), **PAUSED, advance_duration=0.0123456785,
        publish_rate=1000.0)
    duration = 12_345_678  # rounded half to even
    with Beside(runner) as beside:
        beside.wait_for(lambda: sink.of(POSES))
        for number in range(1, 4):
            assert runner.advance().result(60.0) == runner.now == number * duration
            assert runner.paused and runner.simulation.time == runner.now / 1e9
        runner.change(runner.parameters.with_changes({'advance_duration': 1e-9}))
        assert runner.advance().result(60.0) == 3 * duration + 1
    times = [time for time, _ in sink.of(POSES)]
    assert times == sorted({*range(0, 3 * duration, 10**6), *(
        number * duration for number in (1, 2, 3)), 3 * duration + 1})
    assert [event['event'] for event in events_of(sink)] == ['advance', 'advanced'] * 4


def test_state_that_is_due_at_the_end_is_shown_once():
    runner = make_runner(sink := ListSink(POSES, bag=True), **PAUSED, advance_duration=0.002,
                         publish_rate=1000.0)
    with Beside(runner):
        runner.advance().result(60.0)
    assert [time for time, _ in sink.of(POSES)] == [0, 10**6, 2 * 10**6]


def test_advance_has_the_bits_of_a_run():
    alone = make_runner(ListSink(POSES), initial_random__velocity_sigma=0.5, duration=0.06)
    alone.run(until_finished=True)
    runner = make_runner(ListSink(POSES), initial_random__velocity_sigma=0.5, **PAUSED)
    with Beside(runner):
        for _ in range(6):
            runner.advance().result(60.0)
    ours, theirs = runner.simulation.snapshot(), alone.simulation.snapshot()
    assert runner.now == alone.now
    assert np.array_equal(ours.position, theirs.position)
    assert np.abs(ours.linear_velocity).max() > 0.1


@pytest.mark.parametrize(('deed', 'reason'), [
    (lambda runner: runner.set_paused(True), 'ended by a pause'),
    (lambda runner: runner.set_paused(False), 'the run was resumed'),
    (lambda runner: runner.reset(), 'ended by a reset'),
    (lambda runner: runner.stop(), 'the run has ended')])
@pytest.mark.parametrize('running', [False, True])
def test_advance_that_is_ended_says_why(deed, reason, running):
    runner = make_runner(
        sink := ListSink(EVENTS), **{**PAUSED, 'start_paused': not running},
        advance_duration=1e5, solver__step=1e-4)
    with Beside(runner) as beside:
        first, second = runner.advance(), runner.advance()
        runner.post(lambda: None).result(60.0)  # both have been heard
        beside.wait_for(lambda: runner.now > 0)
        assert not first.done()
        deed(runner)
        if reason == 'the run was resumed' and running:
            # It does so already: nothing is ended by that.
            runner.post(lambda: None).result(60.0)
            assert not first.done()
            return
        wait([first, second], 60.0)
    for future, word in ((first, 'advanced by'), (second, '' if running else 'not advanced')):
        with pytest.raises(RuntimeError, match=f'{word}.*{reason}'):
            future.result(60.0)
    if not running and reason != 'the run has ended':
        assert [event['event'] for event in events_of(sink)][:2] == ['advance', 'advance_ended']


def test_advance_of_a_running_fabric_waits_for_the_time():
    runner = make_runner(ListSink(POSES), duration=0.0, advance_duration=0.0037)
    with Beside(runner):
        before = runner.now
        reached = [runner.advance() for _ in range(3)]
        ends = [future.result(60.0) for future in reached]
    assert not runner.paused and all(end >= before + 3_700_000 for end in ends)
    # The time is stopped at, so that each is the time that was asked for.
    assert ends == sorted(ends)


def test_advances_that_wait_are_answered_each_at_its_end():
    requests, waiting = TimeRequests(), [AdvanceRequest(duration) for duration in (5, 3, 9)]
    for request in waiting:
        request.begin(10)
        requests.wait(request)
    for now, done in ((13, [False, True, False]), (15, [True, True, False]), (19, [True] * 3)):
        assert requests.next_time() == now
        requests.answer(now)
        assert [request.future.done() for request in waiting] == done
    assert requests.next_time() is None


def test_advance_ends_with_the_duration():
    runner = make_runner(ListSink(POSES), **{**PAUSED, 'duration': 0.01}, advance_duration=0.007)
    with Beside(runner):
        assert runner.advance().result(60.0) == 7_000_000
        with pytest.raises(RuntimeError, match='advanced by 0.003000000 of 0.0070.*has passed'):
            runner.advance().result(60.0)
        with pytest.raises(RuntimeError, match='not advanced: the duration of 0.01 s has passed'):
            runner.advance().result(60.0)


def test_loads_are_cleared_and_stay_so():
    """Those that were received, on channels and bodies, the scene's own, and what waits."""
    runner = make_runner(ListSink(), **PAUSED, loads__tip__force=[0.0, 0.0, 0.01])
    with Beside(runner):
        push(runner, 2)
        push(runner, stamp=5_000_000)
        inputs = runner.simulation.inputs
        runner.advance().result(60.0)
        assert set(map(str, inputs.acting())) == {'loads.tip', 'body 2'}
        push(runner, stamp=15_000_000)
        assert runner.clear_loads().result(60.0) == 10_000_000
        assert not inputs.acting() and runner.dropped == 1
        runner.advance().result(60.0)
        assert not inputs.acting() and ChannelTarget('tip') in inputs.received
        push(runner)
        runner.advance().result(60.0)
        assert [str(target) for target in inputs.acting()] == ['loads.tip']


def test_repeats_of_a_time_have_one_state(monkeypatch):
    """Whatever comes while it stands still: so a client may take whichever it gets."""
    monkeypatch.setattr(runner_module, '_IDLE_REFRESH', 0.0)
    runner = make_runner(
        sink := ListSink(POSES, STATE), **PAUSED, solver__method='dop8',
        advance_duration=0.0123)
    with Beside(runner) as beside:
        runner.advance().result(60.0)
        for act in (lambda: push(runner), runner.clear_loads, lambda: push(runner, 2)):
            before = len(sink.of(STATE))
            act()
            beside.wait_for(lambda before=before: len(sink.of(STATE)) > before + 2)
        now = runner.now
        runner.advance().result(60.0)
    for topic in (POSES, STATE):
        messages = [data for time, data in sink.of(topic) if time == now]
        assert len(messages) > 9 and len(set(messages)) == 1


def test_bag_of_advances_is_identical(tmp_path):
    """With advances that end early, and outputs on and off their grid; none is missing."""
    scene = swing_scene(**{
        'start_paused': True, 'advance_duration': 0.0035, 'publish_rate': 400.0,
        'duration': 0.0, 'loads.tip.force': [0.0, 0.1, 0.0],
        'initial_random.velocity_sigma': 0.1})
    simulation = compile_scene(scene)
    bag = BagSink(tmp_path / 'bag', simulation, live=True, storage='mcap')
    runner = Runner(simulation, [bag])
    with Beside(runner) as beside:
        for _ in range(5):
            runner.advance().result(60.0)
        push(runner)
        runner.advance().result(60.0)
        runner.clear_loads().result(60.0)
        runner.change(runner.parameters.with_changes({'advance_duration': 1e4}))
        before, early = runner.now, runner.advance()
        beside.wait_for(lambda: runner.now > before)
        runner.reset().result(60.0)
        assert early.exception() is not None
        runner.change(runner.parameters.with_changes({'advance_duration': 0.005}))
        runner.advance().result(60.0)
        runner.set_paused(False).result(60.0)
        end = runner.now + 10_000_000
        beside.wait_for(lambda: runner.now > end)
    bag.close(summary=summarise_run(runner.status()))
    with RecordedRun(tmp_path / 'bag') as run:
        result = verify_run(run)
    assert result.verdict == 'identical' and result.gaps == (), result.lines()
    assert result.repeated['advances'] == 8 and result.repeated['inputs'] >= 2


def test_an_advance_of_a_running_fabric_is_answered_where_the_duration_ends():
    runner = make_runner(
        ListSink(POSES), start_paused=False, duration=0.01, real_time_factor=1.0,
        advance_duration=0.02)
    with Beside(runner):
        with pytest.raises(RuntimeError, match='duration'):
            runner.advance().result(60.0)
        assert runner.now <= 10**7


def test_an_advance_of_a_paused_fabric_ends_with_the_duration():
    runner = make_runner(
        ListSink(POSES), start_paused=True, duration=0.01, real_time_factor=1.0,
        advance_duration=0.01)
    with Beside(runner):
        first, second = runner.advance(), runner.advance()
        assert first.result(60.0) == 10**7
        with pytest.raises(RuntimeError, match='duration'):
            second.result(60.0)
        assert runner.now == 10**7
