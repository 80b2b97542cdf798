# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0

from analytical import projectile
from fabrics import changed, loaded_fabric, make_scene, same_state
import icofabric_sim as ico
from icofabric_sim.simulation.inputs.input_types import BodyTarget, ChannelTarget, Wrench
from icofabric_sim.simulation.inputs.inputs import Inputs
from icofabric_sim.simulation.inputs.queue import InputQueue
import numpy as np
import pytest

FORCE, TORQUE = np.array([0.3, -1.1, 2.0]), np.array([0.002, 0.001, -0.003])
STEPS = (0.0, 1e-4, 0.0137, 0.75)


def one_body(changes=None, **sections):
    return make_scene(
        (1, 1, 1), {'groups.tip': 'all', 'loads.tip.group': 'tip', **(changes or {})}, **sections
    )


@pytest.mark.parametrize('step', STEPS)
@pytest.mark.parametrize('times', [(0.0, 0.5), (0.123, 0.456), (0.2, 0.2001)])
def test_impulse_is_force_times_time_whatever_the_step(step, times):
    begin, end = times
    scene = one_body({'solver.step': step})
    simulation = ico.compile_scene(scene)
    assert simulation.apply_wrench('tip', FORCE, TORQUE, time=begin) == begin
    simulation.apply_wrench('tip', time=end)
    simulation.advance_to(1.0)
    s = simulation.snapshot()
    duration = end - begin
    np.testing.assert_allclose(
        s.linear_velocity[0], FORCE * duration / scene.shell.mass, rtol=1e-12
    )
    np.testing.assert_allclose(
        s.angular_velocity[0], TORQUE * duration / scene.shell.inertia, rtol=1e-12
    )
    # The way is exact too: a parabola while the force acts, then a straight line.
    way = projectile(np.zeros(3), 0.0, FORCE / scene.shell.mass, duration)
    way = way + FORCE * duration / scene.shell.mass * (1.0 - end)
    np.testing.assert_allclose(s.position[0] - scene.position[0], way, rtol=1e-11)
    assert simulation.status.active_loads == {}


@pytest.mark.parametrize('method', ['dop8', 'srkn4'])
@pytest.mark.parametrize('ahead', [False, True])
def test_a_time_keeps_its_state_whatever_begins_to_act_then(method, ahead):
    scene = loaded_fabric({'solver.method': method})
    channel, still, pushed = next(iter(scene.loads)), *(ico.compile_scene(scene) for _ in range(2))
    at = 0.0123456
    if ahead:
        pushed.apply_wrench(channel, FORCE, time=at)
    for simulation in (still, pushed):
        simulation.advance_to(at)
    shown = pushed.snapshot()
    if not ahead:
        pushed.apply_wrench(channel, FORCE)
    pushed.apply_body_wrench(1, FORCE)
    pushed.pull(0, (1.0, 0.0, 0.0))
    assert ChannelTarget(channel) in pushed.inputs.acting()
    again, beside = ico.compile_scene(scene), pushed.snapshot()
    again.restore(pushed.checkpoint())
    for other in (still.snapshot(), beside, again.snapshot()):
        assert same_state(other, shown)
    for simulation in (still, pushed, again):
        simulation.advance_to(2.0 * at)
    assert same_state(again.snapshot(), pushed.snapshot())
    assert not same_state(still.snapshot(), pushed.snapshot())


def test_wrench_applied_now_acts_from_now():
    scene = one_body({'solver.step': 0.01})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.1234)
    assert simulation.apply_wrench('tip', FORCE) == 0.1234
    assert np.array_equal(simulation.status.active_loads['tip'].force, FORCE)
    simulation.advance_to(0.2)
    assert simulation.snapshot().linear_velocity[0] == pytest.approx(
        FORCE * 0.0766 / scene.shell.mass, rel=1e-12
    )


@pytest.mark.parametrize('hold', [0.01, 0.25])
def test_hold_time_ends_a_wrench(hold):
    scene = one_body({'solver.step': 0.007, 'loads.tip.hold': hold})
    simulation = ico.compile_scene(scene)
    simulation.apply_wrench('tip', FORCE, time=0.1)
    simulation.advance_to(1.0)
    expected = FORCE * hold / scene.shell.mass
    assert simulation.snapshot().linear_velocity[0] == pytest.approx(expected, rel=1e-12)
    assert not simulation.status.active_loads


def test_a_new_wrench_starts_a_new_hold_time():
    scene = one_body({'solver.step': 0.007, 'loads.tip.hold': 0.2})
    simulation = ico.compile_scene(scene)
    for time, factor in ((0.1, 1.0), (0.25, 1.0), (0.4, -2.0)):
        simulation.apply_wrench('tip', factor * FORCE, time=time)
    simulation.advance_to(1.0)
    # 0.1 to 0.4 with one, 0.4 to 0.6 with minus two.
    expected = FORCE * (0.3 - 2.0 * 0.2) / scene.shell.mass
    assert simulation.snapshot().linear_velocity[0] == pytest.approx(expected, rel=1e-12)


def test_zero_ends_a_hold_and_a_later_wrench_keeps_its_own():
    scene = one_body({'solver.step': 0.007, 'loads.tip.hold': 0.3})
    simulation = ico.compile_scene(scene)
    for time, factor in ((0.1, 1.0), (0.2, 0.0), (0.25, 1.0)):
        simulation.apply_wrench('tip', factor * FORCE, time=time)
    simulation.advance_to(1.0)
    expected = FORCE * (0.1 + 0.3) / scene.shell.mass
    assert simulation.snapshot().linear_velocity[0] == pytest.approx(expected, rel=1e-12)


def test_last_of_several_wrenches_at_one_time_wins():
    scene = one_body({'solver.step': 0.01})
    simulation = ico.compile_scene(scene)
    for factor in (5.0, 0.0, 1.0):
        simulation.apply_wrench('tip', factor * FORCE, time=0.5)
    simulation.advance_to(1.0)
    assert simulation.snapshot().linear_velocity[0] == pytest.approx(
        FORCE * 0.5 / scene.shell.mass, rel=1e-12
    )


def test_steady_load_of_the_scene_is_replaced_and_comes_back_with_a_reset():
    scene = one_body({'loads.tip.force': list(FORCE), 'solver.step': 0.01})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.5)
    simulation.apply_wrench('tip', -FORCE)
    simulation.advance_to(0.75)
    simulation.apply_wrench('tip')
    simulation.advance_to(1.0)
    velocity = simulation.snapshot().linear_velocity[0]
    assert velocity == pytest.approx(FORCE * 0.25 / scene.shell.mass, rel=1e-12)
    simulation.reset()
    assert not simulation.snapshot().linear_velocity.any()
    simulation.advance_to(1.5)
    assert simulation.snapshot().linear_velocity[0] == pytest.approx(
        FORCE * 0.5 / scene.shell.mass, rel=1e-12
    )


def test_share_total_and_each():
    scenes = {
        share: make_scene(
            (2, 2, 2),
            {
                'weave.connected': False,
                'groups.three': 'ids 0 1 3',
                'loads.l.group': 'three',
                'loads.l.share': share,
                'loads.l.force': list(FORCE),
                'loads.l.torque': list(TORQUE),
            },
        )
        for share in ('each', 'total')
    }
    speeds = {}
    for share, scene in scenes.items():
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.01)
        s = simulation.snapshot()
        part = 3.0 if share == 'total' else 1.0
        for body in (0, 1, 3):
            assert s.linear_velocity[body] == pytest.approx(
                FORCE * 0.01 / part / scene.shell.mass, rel=1e-12
            )
            assert s.angular_velocity[body] == pytest.approx(
                TORQUE * 0.01 / part / scene.shell.inertia, rel=1e-12
            )
        assert not s.linear_velocity[2].any() and not s.angular_velocity[2].any()
        speeds[share] = s.linear_velocity[0]
    assert speeds['each'] == pytest.approx(3.0 * speeds['total'], rel=1e-12)


# A quarter turn about z: body x is world y.
TURNED = {
    'loads.tip.point': [0.01, 0.0, 0.0],
    'initial.i.group': 'all',
    'initial.i.rotation': [0.0, 0.0, np.pi / 2],
}


@pytest.mark.parametrize(
    'frame, force, moment',
    [
        # Force along x, in the world or on the body; its point lies on world y.
        ('world', [1.0, 0.0, 0.0], [0.0, 0.0, -0.01]),
        ('body', [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]),
    ],
)
def test_frame_and_point(frame, force, moment):
    scene = one_body({**TURNED, 'loads.tip.frame': frame, 'solver.step': 1e-9})
    simulation = ico.compile_scene(scene)
    simulation.apply_wrench('tip', (1.0, 0.0, 0.0), (0.0, 0.0, 0.004))
    simulation.advance_to(1e-9)
    s = simulation.snapshot()
    expected = np.array(force) * 1e-9 / scene.shell.mass
    np.testing.assert_allclose(s.linear_velocity[0], expected, atol=1e-12 * np.abs(expected).max())
    expected = (np.array(moment) + [0, 0, 0.004]) * 1e-9 / scene.shell.inertia
    np.testing.assert_allclose(
        s.angular_velocity[0], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max()
    )


def test_follower_force_turns_with_its_body():
    # A body that spins at a constant rate under a force on its own axes runs in a circle:
    # V = F/(m omega) (sin(omega t), 1 - cos(omega t)).
    omega, push, end = 7.0, 0.05, 0.6
    scene = one_body(
        {
            'loads.tip.frame': 'body',
            'initial.i.group': 'all',
            'solver.step': 1e-4,
            'initial.i.angular_velocity': [0.0, 0.0, omega],
            'loads.tip.force': [push, 0.0, 0.0],
        }
    )
    simulation = ico.compile_scene(scene)
    simulation.advance_to(end)
    s = simulation.snapshot()
    expected = (
        push
        / (scene.shell.mass * omega)
        * np.array([np.sin(omega * end), 1.0 - np.cos(omega * end), 0.0])
    )
    # The trapezoidal rule of the kicks: (omega h)^2 / 12.
    np.testing.assert_allclose(
        s.linear_velocity[0], expected, rtol=0, atol=(omega * 1e-4) ** 2 / 6 * 2.0
    )
    assert s.linear_velocity[0, 1] > 1.0
    assert np.array_equal(s.angular_velocity[0], [0.0, 0.0, omega])


def test_wrench_on_one_body_acts_on_its_own_axes_and_adds_to_its_channels():
    scene = make_scene(
        (2, 2, 2),
        {
            'weave.connected': False,
            'groups.tip': 'ids 2',
            'loads.tip.group': 'tip',
            'initial.i.group': 'all',
            'initial.i.rotation': [0.0, 0.0, np.pi / 2],
            'solver.step': 1e-6,
        },
    )
    simulation = ico.compile_scene(scene)
    simulation.apply_body_wrench(2, (1.0, 0.0, 0.0))
    simulation.apply_wrench('tip', (0.0, 0.0, 3.0))
    assert simulation.apply_body_wrench(np.int64(0), torque=(0.0, 0.0, 1e-3), time=5e-4) == 5e-4
    simulation.advance_to(1e-3)
    s = simulation.snapshot()
    np.testing.assert_allclose(
        s.linear_velocity[2], np.array([0.0, 1.0, 3.0]) * 1e-3 / scene.shell.mass, atol=1e-12
    )
    np.testing.assert_allclose(
        s.angular_velocity[0], np.array([0.0, 0.0, 1e-3]) * 5e-4 / scene.shell.inertia, rtol=1e-12
    )
    assert not s.linear_velocity[[0, 1, 3]].any()
    assert set(simulation.status.active_loads) == {0, 2, 'tip'}
    simulation.apply_body_wrench(2)
    simulation.advance_to(2e-3)
    assert simulation.snapshot().linear_velocity[2, 1] == s.linear_velocity[2, 1]


def test_refused_wrenches_change_nothing():
    simulation = ico.compile_scene(loaded_fabric())
    simulation.advance_to(0.01)
    for arguments, message in (
        (
            ('nobody', FORCE),
            "there is no load channel 'nobody'; known: tip, two. Define it with loads.nobody",
        ),
        (('tip', (1.0, float('nan'), 0.0)), 'force must be three finite numbers'),
        (('tip', (1.0, 2.0)), 'force must be three finite numbers'),
        (('tip', FORCE, (0.0, float('inf'), 0.0)), 'torque must be three finite numbers'),
    ):
        with pytest.raises(ValueError, match=message):
            simulation.apply_wrench(*arguments)
    for time in (0.005, float('nan'), float('inf')):
        with pytest.raises(ValueError, match='cannot act at|time must be a finite number'):
            simulation.apply_wrench('tip', FORCE, time=time)
    for body in (-1, 10, 10**12):
        with pytest.raises(ValueError, match=f'body must be an integer from 0 to 5, got {body}'):
            simulation.apply_body_wrench(body, FORCE)
    untouched = ico.compile_scene(loaded_fabric())
    for each in (simulation, untouched):
        each.advance_to(0.02)
    assert same_state(simulation.snapshot(), untouched.snapshot())
    assert not simulation.status.active_loads


def test_inputs_go_over_to_a_changed_scene():
    scene = loaded_fabric({'loads.tip.force': [1.0, 0.0, 0.0]})
    inputs = Inputs(scene)
    simulation = ico.compile_scene(scene)
    simulation.apply_wrench('two', FORCE)
    simulation.apply_body_wrench(5, FORCE)
    simulation.apply_body_wrench(1, FORCE, time=0.3)
    inputs = simulation.inputs
    smaller = Inputs(
        make_scene(
            (2, 2, 2),
            {'groups.tip': 'ids 0', 'loads.tip.group': 'tip', 'loads.tip.force': [2.0, 0.0, 0.0]},
        )
    )
    smaller.adopt(inputs, 0.0, anew=False)
    # Neither the channel 'two' nor body 5 exist any more; the scene's own load is the new one.
    tip, two = ChannelTarget('tip'), ChannelTarget('two')
    assert set(smaller.active) == {tip}
    assert smaller.active[tip].force[0] == 2.0
    assert [event.target for event in smaller.queue] == [BodyTarget(1)]
    again = Inputs(changed(scene, {'gravity': [0.0, 0.0, -1.0]}))
    again.adopt(inputs, 0.0, anew=False)
    assert set(again.active) == {tip, two, BodyTarget(5)}


def test_cleared_load_stays_cleared_in_a_changed_scene():
    scene = loaded_fabric({'loads.tip.force': [1.0, 0.0, 0.0]})
    simulation = ico.compile_scene(scene)
    simulation.apply_wrench('tip')
    assert not simulation.status.active_loads
    again = Inputs(changed(scene, {'gravity': [0.0, 0.0, -1.0]}))
    again.adopt(simulation.inputs, 0.0, anew=False)
    assert not again.active


# Messages in the queue.

def test_message_acts_as_an_input_that_was_given_ahead():
    """The same bits; messages are taken once they have acted, in that order."""
    times = (0.003, 0.0071, 0.003)
    ahead, told = ico.compile_scene(loaded_fabric()), ico.compile_scene(loaded_fabric())
    for number, time in enumerate(times):
        force = (1.0 + number) * FORCE
        ahead.apply_wrench('tip', force, TORQUE, time=time)
        told.inputs.put(time, ChannelTarget('tip'), Wrench(force, TORQUE), number)
    assert (ahead.status.waiting_loads, told.status.waiting_loads) == (3, 0)
    assert told.inputs.message_count == 3
    told.advance_to(0.003)
    assert told.inputs.take_acted() == [0, 2] and told.inputs.message_count == 1
    for simulation in (ahead, told):
        simulation.advance_to(0.01)
    assert same_state(ahead.snapshot(), told.snapshot()) and told.inputs.message_count == 0
    assert told.inputs.take_acted() == [1] and told.inputs.take_acted() == []


def test_queue_keeps_messages_when_a_checkpoint_is_restored():
    simulation = ico.compile_scene(loaded_fabric())
    simulation.apply_wrench('tip', FORCE, time=0.002)
    checkpoint = simulation.checkpoint()
    tip, body = ChannelTarget('tip'), BodyTarget(1)
    for time, target in ((0.004, tip), (0.003, body), (0.005, tip)):
        simulation.inputs.put(time, target, Wrench(2.0 * FORCE, TORQUE), str(target))
    simulation.apply_wrench('tip', time=0.006)
    simulation.restore(checkpoint)
    queue = simulation.inputs.queue
    assert [(event.time, event.message) for event in queue] == [
        (0.002, None), (0.003, 'body 1'), (0.004, 'loads.tip'), (0.005, 'loads.tip')]
    lost = queue.drop_messages(lambda target: target == tip)
    assert [event.time for event in lost] == [0.004, 0.005] and queue.message_count == 1
    simulation.advance_to(0.01)
    assert set(simulation.status.active_loads) == {'tip', 1}
    assert np.array_equal(simulation.status.active_loads['tip'].force, FORCE)


def test_holds_end_before_inputs_of_the_same_time_begin():
    queue = InputQueue()
    tip = ChannelTarget('tip')
    queue.put(1.0, tip, Wrench(FORCE, TORQUE))
    queue.put(1.0, tip, None)
    queue.put(0.5, tip, Wrench(-FORCE, TORQUE), 'first')
    assert len(queue) == 3 and queue.next_time == 0.5
    assert [queue.take().value is None for _ in range(3)] == [False, True, False]
    assert queue.next_time == np.inf and queue.message_count == 0
