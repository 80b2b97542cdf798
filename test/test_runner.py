# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The runner without ROS: outputs on their grid, inputs at their moment, and what interrupts a run.
"""
from collections import Counter
from fractions import Fraction
import threading
import time

import icofabric_sim as ico
from icofabric_sim import broadcast
from icofabric_sim.messages import (
    decode_clock,
    decode_marker_points,
    decode_pose_array,
    decode_string,
    WrenchStampedBytes,
)
from icofabric_sim.outputs import CLOCK, CONNECTORS, DIAGNOSTICS, POSES, STATE, TOPICS, WEAVE
from icofabric_sim.run_records import WrenchInput
from icofabric_sim.runner import Runner
from icofabric_sim.schedule import seconds
import numpy as np
import pytest

SCENE = {
    'weave': {'size': [2, 2, 2]},
    'connector': {'stiffness': 200.0},
    'contact': {'mode': 'never'},
    'groups': {'tip': 'ids 1'},
    'loads': {'tip': {'group': 'tip'}},
    'real_time_factor': 0.0,
    'duration': 0.1,
}
FORCE = np.array([0.0, 0.0, 0.05])


class ListSink:
    """
    Keeps what it is sent; wants the given topics only.
    """

    is_bag = False

    def __init__(self, *topics, bag=False):
        self.topics, self.is_bag = topics, bag
        self.messages, self.jumps = [], []

    def wants(self, topic):
        return topic in self.topics

    def send(self, topic, nanoseconds, data):
        assert topic in self.topics and type(data) is bytes
        self.messages.append((topic, nanoseconds, data))

    def send_input(self, topic, type_name, nanoseconds, data):
        assert type_name == WrenchStampedBytes.TYPE
        self.messages.append((topic, nanoseconds, data))

    def time_jumped_back(self, simulation):
        self.jumps.append(simulation)

    def of(self, topic):
        return [(time, data) for kind, time, data in self.messages if kind == topic]


def make_runner(*sinks, **changes):
    dotted = {name.replace('__', '.'): value for name, value in changes.items()}
    scene = ico.Scene.from_parameters(SCENE)
    scene = ico.Scene.from_parameters(scene.parameters.with_changes(dotted))
    return Runner(ico.compile_scene(scene, body_wrenches=True), list(sinks))


def push(runner, key='tip', *, stamp=0, force=FORCE, topic='/loads/tip'):
    data = WrenchStampedBytes('')
    data.force[:] = force
    runner.receive(WrenchInput(topic, key, stamp, np.array(force), np.zeros(3),
                               data.stamped(max(stamp, 0))))


def run(runner):
    """
    To the end of its duration, as fast as possible.
    """
    runner.run(until_finished=True)
    return runner


class Beside:
    """
    A runner in a thread of its own, as in the node.
    """

    def __init__(self, runner):
        self.runner = runner
        self.thread = threading.Thread(target=runner.run, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, kind, error, traceback):
        self.runner.stop()
        self.thread.join(60.0)
        assert not self.thread.is_alive()

    def wait_for(self, condition):
        deadline = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < deadline
            time.sleep(0.002)


@pytest.fixture
def built(monkeypatch):
    """
    Counts the messages that are laid out.
    """
    counts = Counter()

    def counting(name):
        original = getattr(broadcast.Outputs, name)

        def method(self, *arguments):
            counts[name] += 1
            return original(self, *arguments)

        return method

    for name in ('poses', 'state', 'connectors', 'weave', 'clock', 'cleared'):
        monkeypatch.setattr(broadcast.Outputs, name, counting(name))
    return counts


def test_nothing_is_built_without_listeners(built):
    sink = ListSink()
    runner = run(make_runner(sink))
    assert runner.now == 100_000_000 and runner.finished
    assert not built and sink.messages == []


def test_only_what_is_wanted_is_built(built):
    run(make_runner(ListSink(POSES), ListSink(POSES, CLOCK)))
    assert set(built) == {'poses', 'clock'}
    # Once for both sinks: outputs 0 to 6 at 60 Hz, 0 to 10 at 100 Hz.
    assert built['poses'] == 7 and built['clock'] == 11


def test_outputs_lie_on_their_grids_with_the_state_of_that_time():
    sink = ListSink(*TOPICS)
    run(make_runner(sink, publish_rate=70.0))
    times = [time for time, _ in sink.of(POSES)]
    assert times == [round(Fraction(k * 10**9, 70)) for k in range(8)]
    assert [decode_clock(data) for _, data in sink.of(CLOCK)] == [k * 10**7 for k in range(11)]
    assert {time for time, _ in sink.of(CONNECTORS)} == {0, 100_000_000}
    assert [time for time, _ in sink.of(STATE)] == times
    assert len(sink.of(WEAVE)) == 1 and sink.of(DIAGNOSTICS) == []


def test_states_are_those_of_a_direct_simulation():
    sink = ListSink(POSES)
    run(make_runner(sink, initial_random__velocity_sigma=0.1))
    scene = ico.Scene.from_parameters({**SCENE, 'initial_random': {'velocity_sigma': 0.1}})
    direct = ico.compile_scene(scene)
    for now, data in sink.of(POSES):
        direct.advance_to(seconds(now))
        pose = decode_pose_array(data)
        assert pose.nanoseconds == now
        assert pose.values[:, :3].tobytes() == direct.snapshot().position.tobytes()
        assert pose.values[:, 3:].tobytes() == direct.snapshot().orientation.tobytes()
    assert abs(direct.snapshot().position - scene.position).max() > 1e-4


def test_listeners_do_not_change_the_motion():
    """
    Other outputs cut the run in other pieces; the bits stay.
    """
    ends = []
    for topics, rate in (((), 60.0), ((POSES,), 977.0), (TOPICS, 61.3)):
        runner = make_runner(
            ListSink(*topics), publish_rate=rate, initial_random__spin_sigma=5.0)
        push(runner, stamp=33_333_333)
        ends.append(run(runner).simulation.snapshot())
    for end in ends[1:]:
        assert end.position.tobytes() == ends[0].position.tobytes()
        assert end.orientation.tobytes() == ends[0].orientation.tobytes()


@pytest.mark.parametrize(('stamp', 'acts'), [
    (0, 0), (-5, 0), (1, 1), (12_345_678, 12_345_678), (99_999_999, 99_999_999)])
def test_input_acts_at_its_stamp(stamp, acts):
    sink = ListSink(POSES)
    runner = make_runner(sink)
    push(runner, stamp=stamp)
    run(runner)
    direct = ico.compile_scene(ico.Scene.from_parameters(SCENE))
    direct.apply_wrench('tip', FORCE, time=seconds(acts))
    direct.advance_to(0.1)
    assert [time for time, _ in sink.of('/loads/tip')] == [acts]
    assert runner.simulation.snapshot().position.tobytes() == direct.snapshot().position.tobytes()


def test_input_comes_before_the_states_it_changes():
    sink = ListSink(POSES)
    runner = make_runner(sink)
    push(runner, stamp=50_000_000)
    run(runner)
    kinds = [(kind, time) for kind, time, _ in sink.messages]
    assert kinds.index(('/loads/tip', 50_000_000)) + 1 == kinds.index((POSES, 50_000_000))


def test_inputs_of_one_time_act_in_the_order_in_which_they_came():
    runner = make_runner(sink := ListSink())
    for k in (3.0, 1.0, 2.0):
        push(runner, stamp=10_000_000, force=k * FORCE)
    push(runner, stamp=9_000_000)
    run(runner)
    assert [time for _, time, _ in sink.messages] == [9_000_000, *[10_000_000] * 3]
    assert runner.simulation.active_loads['tip'].force.tolist() == (2.0 * FORCE).tolist()


def test_input_beyond_the_horizon_acts_at_once_with_one_warning(caplog):
    runner = make_runner(sink := ListSink(), input_horizon=0.05)
    push(runner, stamp=50_000_000)
    push(runner, stamp=50_000_001)
    push(runner, stamp=time.time_ns())
    run(runner)
    assert [time for _, time, _ in sink.messages] == [0, 0, 50_000_000]
    [warning] = [record.getMessage() for record in caplog.records]
    assert 'input_horizon = 0.05 s' in warning and '/loads/tip' in warning


def test_duration_ends_a_run_exactly():
    runner = run(make_runner(ListSink(POSES), duration=0.0123456789))
    assert runner.now == 12_345_679 and runner.status().finished


def test_finished_run_waits_for_a_longer_duration():
    """
    As in a node that was started without one.
    """
    runner = make_runner(ListSink())
    with Beside(runner) as beside:
        beside.wait_for(lambda: runner.finished)
        runner.change(runner.parameters.with_changes({'duration': 0.2})).result(60.0)
        beside.wait_for(lambda: runner.now == 200_000_000)


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
    assert [time for time, _ in sink.of('/loads/tip')] == [4_500_000]


def test_paused_run_repeats_itself_for_live_listeners_only(monkeypatch):
    monkeypatch.setattr('icofabric_sim.runner._IDLE_REFRESH', 0.01)
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
    assert actions.count(3) == 1 and set(actions[actions.index(3) + 1:]) == {0}


def test_reset_of_time_repeats_the_run():
    sink = ListSink(POSES)
    runner = run(make_runner(sink, reset_time=True, initial_random__spin_sigma=5.0))
    first = sink.of(POSES)
    sink.messages.clear()
    runner.reset()
    run(runner)
    assert sink.jumps == [runner.simulation]
    # Asked for before the run began again: it starts with the old state at the old time.
    start = max(k for k, (time, _) in enumerate(sink.of(POSES)) if time == 0)
    assert sink.of(POSES)[start:] == first


UNSTABLE = {'weave__size': [3, 3, 3], 'initial_random__velocity_sigma': 3.0}


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
    """
    A live change keeps state, time and wrenches; a new weave keeps the time.
    """
    sink, told = ListSink(POSES, WEAVE, CONNECTORS), []
    runner = make_runner(sink, start_paused=True, duration=0.0, solver__step=0.001, step_count=20)
    runner.on_rebuilt = lambda *report: told.append(report)
    with Beside(runner) as beside:
        push(runner)
        push(runner, key=0, topic='/wrench')
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


def test_wrench_that_waits_for_a_body_that_is_gone_is_dropped(caplog):
    sink, told = ListSink(), []
    runner = make_runner(sink, start_paused=True)
    runner.on_rebuilt = lambda *report: told.append(report)
    last = runner.simulation.scene.body_count - 1
    with Beside(runner) as beside:
        push(runner, key=last, stamp=10**7, topic='/wrench')
        change_and_wait(beside, runner, told, weave__size=[2, 2, 1])
        runner.set_paused(False)
        beside.wait_for(lambda: runner.finished)
    assert runner.dropped == 1 and sink.messages == []
    assert any('/wrench was dropped: the weave changed' in record.getMessage()
               for record in caplog.records)


def test_report_comes_at_once_and_at_the_end():
    sink, statuses = ListSink(DIAGNOSTICS), []

    def report(status):
        statuses.append(status)
        return b'report'

    simulation = make_runner().simulation
    runner = run(Runner(simulation, [sink], report=report))
    assert [time for time, _ in sink.of(DIAGNOSTICS)] == [0, runner.now]
    assert statuses[-1].finished and not statuses[0].finished
    assert statuses[-1].step_count == simulation.step_count > 0
    assert statuses[-1].body_count == simulation.scene.body_count
