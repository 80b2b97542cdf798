# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The runner without ROS: outputs on their grid, inputs at their moment, and what interrupts a run.
"""
from collections import Counter
from fractions import Fraction
import time

from fabrics import warnings_said
import icofabric_sim as ico
from icofabric_sim.messages import decode_clock, decode_pose_array
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.messages.topics import (
    CLOCK,
    CONNECTORS,
    DIAGNOSTICS,
    POSES,
    STATE,
    TOPICS,
    WEAVE,
)
from icofabric_sim.running import broadcast
from icofabric_sim.running.runner import Runner
import pytest
from runner_helpers import Beside, FORCE, ListSink, make_runner, push, run, SCENE


@pytest.fixture
def built(monkeypatch):
    """Counts the messages that are laid out."""
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
    """Other outputs cut the run in other pieces; the bits stay."""
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
    assert [time for time, _ in sink.of('~/loads/tip')] == [acts]
    assert runner.simulation.snapshot().position.tobytes() == direct.snapshot().position.tobytes()


def test_input_comes_before_the_states_it_changes():
    sink = ListSink(POSES)
    runner = make_runner(sink)
    push(runner, stamp=50_000_000)
    run(runner)
    kinds = [(kind, time) for kind, time, _ in sink.messages]
    assert kinds.index(('~/loads/tip', 50_000_000)) + 1 == kinds.index((POSES, 50_000_000))


def test_inputs_of_one_time_act_in_the_order_in_which_they_came():
    runner = make_runner(sink := ListSink())
    for k in (3.0, 1.0, 2.0):
        push(runner, stamp=10_000_000, force=k * FORCE)
    push(runner, stamp=9_000_000)
    run(runner)
    assert [time for _, time, _ in sink.messages] == [9_000_000, *[10_000_000] * 3]
    assert runner.simulation.status.active_loads['tip'].force.tolist() == (2.0 * FORCE).tolist()


def test_input_beyond_the_horizon_acts_at_once_with_one_warning(caplog):
    runner = make_runner(sink := ListSink(), input_horizon=0.05)
    push(runner, stamp=50_000_000)
    push(runner, stamp=50_000_001)
    push(runner, stamp=time.time_ns())
    run(runner)
    assert [time for _, time, _ in sink.messages] == [0, 0, 50_000_000]
    [warning] = warnings_said(caplog)
    assert 'input_horizon = 0.05 s' in warning and '/loads/tip' in warning


def test_duration_ends_a_run_exactly():
    runner = run(make_runner(ListSink(POSES), duration=0.0123456789))
    assert runner.now == 12_345_679 and runner.status().finished


def test_finished_run_waits_for_a_longer_duration():
    """As in a node that was started without one."""
    runner = make_runner(ListSink())
    with Beside(runner) as beside:
        beside.wait_for(lambda: runner.finished)
        runner.change(runner.parameters.with_changes({'duration': 0.2})).result(60.0)
        beside.wait_for(lambda: runner.now == 200_000_000)


def test_report_comes_at_once_and_at_the_end():
    sink, statuses = ListSink(DIAGNOSTICS), []

    def report(status):
        statuses.append(status)
        return b'report'

    simulation = make_runner().simulation
    runner = run(Runner(simulation, [sink], report=report))
    assert [time for time, _ in sink.of(DIAGNOSTICS)] == [0, runner.now]
    assert statuses[-1].finished and not statuses[0].finished
    assert statuses[-1].step_count == simulation.status.step_count > 0
    assert statuses[-1].body_count == simulation.scene.body_count
