# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Twists that take over drives and planes: when they act, that records repeat them."""

import icofabric_sim as ico
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.messages import TwistStampedBytes
from icofabric_sim.messages.input_topics import decode_wrench_stamped
from icofabric_sim.messages.topics import wrench_topics
from icofabric_sim.running.broadcast import Broadcast
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.running.runner import Runner
import numpy as np
import pytest
from recorded_runs import DRIVEN_SCENE, record_run, Sent
from runner_helpers import Beside, ListSink

LINEAR, ANGULAR = np.array([0.02, 0.0, -0.01]), np.array([0.0, 0.5, 0.0])


def twist(stamp, linear=LINEAR, angular=ANGULAR, drive='top'):
    message = TwistStampedBytes('')
    message.linear[:], message.angular[:] = linear, angular
    return Sent(f'~/drives/{drive}', message.stamped(stamp))


def test_record_with_twists_is_identical(tmp_path):
    scene = ico.Scene.from_parameters({
        **DRIVEN_SCENE, 'real_time_factor': 0.0, 'duration': 0.3})
    record_run(tmp_path / 'bag', scene, twist(60_000_000), twist(
        123_456_789, -2.0 * LINEAR, np.zeros(3)))
    with RecordedRun(tmp_path / 'bag') as run:
        result = verify_run(run)
        assert result.verdict == 'identical' and not result.difference, result.lines()
        assert result.repeated['inputs'] == 2
    simulation = ico.compile_scene(scene)
    simulation.apply_twist('top', LINEAR, ANGULAR, time=0.06)
    simulation.apply_twist('top', -2.0 * LINEAR, time=0.123456789)
    simulation.advance_to(0.3)
    bodies = scene.drives['top'].bodies
    way = simulation.snapshot().position[bodies].mean(axis=0) - scene.drives['top'].middle
    moved = LINEAR * (0.123456789 - 0.06) - 2.0 * LINEAR * (0.3 - 0.123456789)
    assert way == pytest.approx(moved, abs=1e-12)


def test_twist_for_a_drive_that_is_gone_is_dropped():
    scene = ico.Scene.from_parameters(DRIVEN_SCENE)
    runner = Runner(ico.compile_scene(scene), [])
    with Beside(runner) as beside:
        runner.inputs.receive(*twist(0, drive='other'))
        beside.wait_for(lambda: runner.status().dropped == 1)


PLATEN = {
    'weave.size': [1, 1, 1], 'contact.stiffness': 1e4, 'contact.friction': 0.3,
    'gravity': [0.0, 0.0, -9.81], 'planes.floor.normal': [0.0, 0.0, 1.0],
    'planes.floor.offset': -0.0161, 'planes.floor.motion': 'hold', 'real_time_factor': 0.0,
    'publish_rate': 100.0, 'duration': 0.03}


def plane_twist(stamp, linear, angular=(0.0, 0.0, 0.0)):
    sent = twist(stamp, linear, angular)
    return Sent('~/planes/floor', sent.data)


def test_record_with_a_moved_plane_is_identical(tmp_path):
    scene = ico.Scene.from_parameters(PLATEN)
    record_run(tmp_path / 'bag', scene, plane_twist(10_000_000, [0.05, 0.0, 0.1]))
    with RecordedRun(tmp_path / 'bag') as run:
        result = verify_run(run)
        assert result.verdict == 'identical' and not result.difference, result.lines()
        assert result.repeated['inputs'] == 1
        *_, last = run.poses()
    simulation = ico.compile_scene(scene)
    simulation.move_plane('floor', [0.05, 0.0, 0.1], time=0.01)
    simulation.advance_to(0.03)
    assert (last.position == simulation.snapshot().position).all()
    # The floor has carried the shell.
    assert last.position[0, 2] > 0.001


def test_wrenches_on_planes_are_built_for_a_listener():
    scene = ico.Scene.from_parameters({
        **PLATEN, 'groups.one': 'all', 'supports.guide.group': 'one', 'supports.guide.fix': 'tx'})
    topics = wrench_topics(scene)
    assert [topic.name for topic in topics] == ['~/supports/guide/wrench', '~/planes/floor/wrench']
    simulation, sink = ico.compile_scene(scene), ListSink(topics[1])
    simulation.move_plane('floor', [0.0, 0.0, 0.1])
    simulation.advance_to(0.002)
    Broadcast([sink], simulation).emit(2_000_000)
    (topic, time, data), = sink.messages
    message, reactions = decode_wrench_stamped(data), simulation.reactions()
    assert (topic, message.nanoseconds, message.frame_id) == (topics[1], 2_000_000, 'world')
    assert np.array(message.first) == pytest.approx(-reactions.force[1])
    assert message.first[2] < -0.01
    assert np.array(message.second) == pytest.approx(-reactions.torque[1], abs=1e-15)


@pytest.mark.parametrize('sent, said', [
    (plane_twist(0, [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]), 'a plane does not rotate'),
    (plane_twist(0, [1e9, 0.0, 0.0]), 'too fast to integrate')])
def test_impossible_twists_of_planes_are_dropped(sent, said, caplog):
    runner = Runner(ico.compile_scene(ico.Scene.from_parameters(PLATEN)), [])
    with Beside(runner) as beside:
        runner.inputs.receive(*sent)
        beside.wait_for(lambda: runner.status().dropped == 1)
    assert said in caplog.text
