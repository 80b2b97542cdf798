# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Inputs from outside: what is judged, what waits, and what no checkpoint holds."""

import json

from fabrics import changed
import icofabric_sim as ico
from icofabric_sim.messages import decode_string, TwistStampedBytes, WrenchStampedBytes
from icofabric_sim.messages.input_topics import decode_input
from icofabric_sim.messages.topics import EVENTS
from icofabric_sim.running.parameter_change import ParameterChange
from icofabric_sim.running.received_inputs import judge
import pytest
from recorded_runs import DRIVEN_SCENE
from runner_helpers import Beside, FORCE, ListSink, make_runner, push

SCENE = {
    **DRIVEN_SCENE, 'groups': {'top': 'z_max', 'tip': 'ids 0'},
    'loads': {'tip': {'group': 'tip'}, 'grip': {'group': 'tip', 'frame': 'body'}}}
NAN = float('nan')


def input_of(topic, first=(0.0, 0.0, 0.1), frame=''):
    if topic.startswith('~/drives/'):
        message = TwistStampedBytes(frame)
        message.linear[:] = first
    else:
        message = WrenchStampedBytes(frame)
        message.force[:] = first
    return decode_input(topic, message.stamped(0))


@pytest.fixture(scope='module')
def scene():
    return ico.Scene.from_parameters(SCENE)


@pytest.mark.parametrize(('topic', 'frame'), [
    ('~/wrench', 'icosahedron_3'), ('~/loads/tip', ''), ('~/loads/tip', 'world'),
    ('~/loads/grip', 'icosahedron'), ('~/drives/top', ''), ('~/drives/top', 'world')])
def test_input_that_the_scene_can_take(scene, topic, frame):
    judge(scene, input_of(topic, frame=frame))


@pytest.mark.parametrize(('topic', 'changes', 'words'), [
    ('~/wrench', {'frame': 'icosahedron_4'}, 'no body 4; bodies are 0 to 3'),
    ('~/loads/tap', {}, "no load channel 'tap'; known: grip, tip.*loads.tap.group"),
    ('~/drives/tip', {}, "no drive 'tip'; known: top.*drives.tip.group"),
    ('~/loads/tip', {'frame': 'icosahedron'}, "loads.tip.frame is world, .* '' or 'world'"),
    ('~/loads/grip', {'frame': 'world'}, "loads.grip.frame is body, .* '' or 'icosahedron'"),
    ('~/drives/top', {'frame': 'map'}, "'map'; a drive moves in the world.* '' or 'world'"),
    ('~/loads/tip', {'first': (NAN, 0.0, 0.0)}, 'not finite .force .nan, 0.0, 0.0. N, torque'),
    ('~/drives/top', {'first': (NAN, 0.0, 0.0)}, 'not finite .linear .nan, 0.0, 0.0. m/s, ang'),
    ('~/loads/tip', {'first': (1e300, 0.0, 0.0)}, 'too large to integrate .force .*1e.300.* kg'),
    ('~/drives/top', {'first': (1e9, 0.0, 0.0)}, 'too fast to integrate .linear'),
])
def test_input_that_the_scene_cannot_take_is_refused_with_the_reason(
        scene, topic, changes, words):
    with pytest.raises(ValueError, match=words):
        judge(scene, input_of(topic, **changes))


def test_a_wrench_is_judged_by_the_masses_of_its_own_bodies():
    shell = ico.Scene.from_parameters(SCENE)
    light = changed(shell, {
        'groups.own': 'ids 0', 'masses.own.group': 'own',
        'masses.own.mass': 1e-4 * shell.shell.mass})
    force = 1e-2 * 1e12 * shell.shell.mass * shell.geometry.cube_width
    for frame in ('icosahedron_0', 'icosahedron_1'):
        judge(shell, input_of('~/wrench', frame=frame, first=(force, 0.0, 0.0)))
    judge(light, input_of('~/wrench', frame='icosahedron_1', first=(force, 0.0, 0.0)))
    with pytest.raises(ValueError, match='too large to integrate .* of 7.26e-07 kg'):
        judge(light, input_of('~/wrench', frame='icosahedron_0', first=(force, 0.0, 0.0)))


def test_message_that_is_no_input_is_dropped_with_its_topic(caplog):
    runner = make_runner(sink := ListSink())
    with Beside(runner) as beside:
        runner.inputs.receive('~/loads/tip', b'\0\1\0\0')
        runner.inputs.receive('~/loads/tap', WrenchStampedBytes('').stamped(0))
        beside.wait_for(lambda: runner.dropped == 2)
    texts = [record.getMessage() for record in caplog.records]
    assert any('a wrench on ~/loads/tip was dropped: ' in text for text in texts)
    assert any("no load channel 'tap'" in text for text in texts) and not sink.messages


def test_what_waits_is_in_no_checkpoint_and_stays_when_a_state_cannot_be_set():
    runner = make_runner(sink := ListSink(), start_paused=True, duration=0.0)
    with Beside(runner):
        push(runner, stamp=2_000_000)
        push(runner, stamp=1_000_000, force=-FORCE)
        checkpoint = runner.post(runner.simulation.checkpoint).result(60.0)
        assert checkpoint.state_tree().part('inputs').entries('queue') == []
        # The run goes back to how it was before, and what waits still acts.
        with pytest.raises(ValueError, match='is invalid'):
            runner.set_body_state(0, {'position': [1e200, 0.0, 0.0]}).result(60.0)
        assert runner.status().loads_waiting == 2
        runner.take_steps().result(60.0)
        while runner.now < 2_000_000:
            runner.take_steps().result(60.0)
    assert [time for _, time, _ in sink.messages] == [1_000_000, 2_000_000]
    assert runner.simulation.status.active_loads['tip'].force.tolist() == FORCE.tolist()
    again = ico.compile_scene(runner.simulation.scene)
    again.restore(checkpoint)
    again.advance_to(0.003)
    assert not again.status.active_loads


def test_what_acts_in_a_changed_fabric_before_it_runs_is_recorded():
    """An input of the present time waits while kernels are awaited, and a change comes first."""
    runner = make_runner(sink := ListSink(EVENTS), start_paused=True, duration=0.0)
    message = WrenchStampedBytes('')
    message.force[:] = FORCE

    def receive_while_held():
        runner.state.is_held = True
        runner.inputs.take('~/loads/tip', message.stamped(0))
        return len(runner.inputs), runner.inputs.acted

    with Beside(runner):
        assert runner.post(receive_while_held).result(60.0) == (1, 0)
        change = ParameterChange(
            runner.parameters, runner.parameters.with_changes({'connector.stiffness': 700.0}))
        runner.apply_change(change)
        assert change.outcome.result(60.0) == ''
    assert runner.inputs.acted == 1 and len(runner.inputs) == 0
    names = [topic if topic != EVENTS else json.loads(decode_string(data))['event']
             for topic, _, data in sink.messages]
    assert names == ['reweave', '~/loads/tip']
    assert runner.simulation.status.active_loads['tip'].force.tolist() == FORCE.tolist()
