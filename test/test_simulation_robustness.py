# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
What must not depend on interrupts, resets, or the way inputs arrive; and loads beyond reason.
"""

import hashlib
import logging
import subprocess
import sys

import icofabric_sim as ico
from icofabric_sim.simulation import Interrupted
import numpy as np
import pytest

FABRIC = {
    'weave': {'size': [3, 3, 3]},
    'contact': {'mode': 'never'},
    'initial_random': {'velocity_sigma': 0.05, 'spin_sigma': 2.0, 'seed': 3},
    'groups': {'top': 'z_max', 'side': 'x_max', 'wall': 'x_min'},
    'loads': {'push': {'group': 'top', 'hold': 0.1}},
}


def make(**changes):
    return ico.compile_scene(ico.Scene.from_parameters({**FABRIC, **changes}))


def same_bits(one, other):
    a, b = one.snapshot(), other.snapshot()
    return a.time == b.time and all(
        (getattr(a, name) == getattr(b, name)).all()
        for name in ('position', 'orientation', 'linear_velocity', 'angular_velocity'))


# In a process of its own: an interrupt that comes late must not meet the test runner.
INTERRUPTED_RUN = """
import hashlib, os, signal, sys, threading, time
import icofabric_sim as ico

simulation = ico.compile_scene(ico.Scene.from_parameters(eval(sys.argv[1])))
simulation.warm_up()
count, sent = 0, threading.Event()

def disturb():
    for k in range(60):
        time.sleep(0.004 * (k % 4))
        os.kill(os.getpid(), signal.SIGINT)
    sent.set()

def run():
    global count
    while simulation.time < 12.0 or not sent.is_set():
        try:
            simulation.advance_to(max(simulation.time, 12.0))
        except KeyboardInterrupt:
            count += 1

threading.Thread(target=disturb, daemon=True).start()
while True:
    try:
        run()
        break
    except KeyboardInterrupt:
        count += 1
position = simulation.snapshot().position
print(count, hashlib.sha256(position.tobytes()).hexdigest(), simulation.time,
      signal.getsignal(signal.SIGINT) is signal.default_int_handler)
"""


def test_ctrl_c_in_an_advance_loses_nothing():
    result = subprocess.run(
        [sys.executable, '-c', INTERRUPTED_RUN, repr(FABRIC)], capture_output=True, text=True,
        check=True, timeout=120)
    count, digest, time, restored = result.stdout.split()
    plain = make()
    plain.advance_to(12.0)
    assert int(count) > 5 and float(time) == 12.0 and restored == 'True'
    assert digest == hashlib.sha256(plain.snapshot().position.tobytes()).hexdigest()


def test_should_stop_ends_an_advance_at_a_step_end_and_the_run_goes_on():
    plain, stopped = make(), make()
    answers = iter([False, True] * 3 + [False] * 10**6)
    stopped.should_stop = lambda: next(answers)
    plain.advance_to(20.0)
    count = 0
    while stopped.time < 20.0:
        try:
            stopped.advance_to(20.0)
        except Interrupted:
            count += 1
            assert 0.0 < stopped.time < 20.0
    assert count == 3 and same_bits(plain, stopped)


@pytest.mark.parametrize('back', ['reset_time', 'set_state'])
def test_a_run_from_a_state_does_not_depend_on_what_was_before(back):
    fresh, again = make(), make()
    again.apply_wrench('push', force=(50.0, 0.0, 80.0))
    again.advance_to(0.5)
    start = fresh.snapshot()
    if back == 'reset_time':
        again.reset_time()
    else:
        again.reset_time()
        again.advance_to(0.05)
        again.reset_time()
        again.set_state(position=start.position, orientation=start.orientation,
                        linear_velocity=start.linear_velocity,
                        angular_velocity=start.angular_velocity)
    assert again.step == fresh.step
    for simulation in (fresh, again):
        simulation.advance_to(0.3)
    assert same_bits(fresh, again)
    assert np.abs(fresh.snapshot().position - start.position).max() > 1e-3


def test_a_wrench_that_renews_a_hold_at_its_end_gives_the_same_bits_whenever_it_is_known():
    ahead, pieces = make(), make()
    for k in range(1, 3):
        ahead.apply_wrench('push', force=(0.0, 0.0, 1.0), time=0.1 * k)
    for k in range(1, 3):
        pieces.advance_to(0.1 * k)
        pieces.apply_wrench('push', force=(0.0, 0.0, 1.0))
    for simulation in (ahead, pieces):
        simulation.advance_to(0.4)
    assert same_bits(ahead, pieces) and not ahead.active_loads


def test_steps_are_counted_as_they_are_taken():
    simulation = make()
    end = simulation.next_step_time
    # At a step end, without effect, and twice the same: none of these is a step of its own.
    simulation.apply_wrench('push', force=(0.0, 0.0, 0.1), time=end)
    simulation.apply_wrench('push', force=(0.0, 0.0, 0.1), time=end + 1e-5)
    simulation.apply_wrench('push', time=0.9)
    before = simulation.step_count
    simulation.advance_steps(7)
    assert simulation.step_count == before + 7
    assert simulation.time == pytest.approx(end + 6 * simulation.step, rel=1e-9)
    with pytest.raises(TypeError):
        simulation.advance_steps(1.5)


@pytest.mark.parametrize(('name', 'changes', 'force'), [
    ('load', {}, 1e4),
    ('weight', {'gravity': [0.0, 0.0, -1e6], 'supports': {'wall': {'group': 'wall'}}}, 0.0),
])
def test_loads_beyond_reason_do_not_outrun_the_chosen_step(name, changes, force, caplog):
    simulation = make(**changes)
    simulation.apply_wrench('push', force=(force, 0.0, 0.0))
    top = simulation.scene.groups['top']
    start = simulation.snapshot()
    with caplog.at_level(logging.WARNING):
        simulation.advance_to(0.01)
    end = simulation.snapshot()
    work = force * (end.position[top, 0] - start.position[top, 0]).sum()
    gain = end.energy['total'] - start.energy['total']
    largest = max(abs(work), end.energy['kinetic'], end.energy['connectors'])
    assert largest > 1.0
    assert abs(gain - work) < 2e-3 * largest
    assert not caplog.records


def test_slack_connectors_answer_a_load_as_no_connectors_do():
    ends = []
    for changes in ({'connector': {'stiffness': 0.0}}, {'weave': {'size': [3, 3, 3],
                                                                  'connected': False}}):
        simulation = make(**changes, initial_random={'velocity_sigma': 0.0},
                          loads={'push': {'group': 'top', 'frame': 'body',
                                          'point': [0.0, 0.005, 0.0]}})
        simulation.apply_wrench('push', force=(0.05, 0.0, 0.0))
        simulation.advance_to(0.5)
        ends.append(simulation.snapshot().position)
    assert np.abs(ends[0] - ends[1]).max() < 1e-4
    assert np.abs(ends[0] - simulation.scene.position).max() > 0.01


def test_a_load_too_large_for_any_step_stops_and_a_reset_starts_again():
    simulation = make(weave={'size': [2, 2, 1], 'connected': False}, groups={'top': 'all'})
    simulation.apply_wrench('push', force=(1e300, 0.0, 0.0))
    simulation.apply_wrench('push', force=(1e308, 1e308, 1e308))
    with pytest.raises(ico.SimulationError, match='load'):
        simulation.advance_to(0.1)
    simulation.reset()
    before = simulation.time
    simulation.advance_to(before + 0.1)
    assert np.abs(simulation.snapshot().position - simulation.scene.position).max() > 1e-4


@pytest.mark.parametrize('changes', [
    {'connector': {'stiffness': 1e305}}, {'solver': {'step': 1e-18}}, {'solver': {'step': 5e-324}},
])
def test_scenes_that_no_step_can_take_are_refused_at_the_start(changes):
    with pytest.raises(ValueError, match='step'):
        make(**changes)


def test_a_changed_scene_says_once_what_is_known_already(caplog):
    crowded = {'contact': {'mode': 'auto'},
               'bodies': {'near': {'position': [0.001, 0.0, 0.001]}}}
    old = make(**crowded)
    assert old.proximity is not None
    new = make(**crowded, gravity=[0.0, 0.0, -1.0])
    with caplog.at_level(logging.WARNING):
        old.advance_to(0.01)
        assert len(caplog.records) == 1
        new.take_over(old, keep_motion=True)
        new.advance_to(0.02)
    assert new.proximity is old.proximity and len(caplog.records) == 1
    assert np.abs(new.snapshot().position - old.snapshot().position).max() > 0.0


def test_received_wrenches_outlive_a_change_and_steady_loads_follow_the_scene():
    def scene(force):
        return ico.Scene.from_parameters({**FABRIC, 'loads': {
            'push': {'group': 'top', 'force': [0.0, 0.0, force]},
            'pull': {'group': 'side', 'force': [force, 0.0, 0.0]}}})

    old, new = ico.compile_scene(scene(1.0)), ico.compile_scene(scene(2.0))
    # Received, though it equals the steady load.
    old.apply_wrench('push', force=(0.0, 0.0, 1.0))
    old.advance_to(0.01)
    new.take_over(old, keep_motion=True)
    assert new.active_loads['push'].force.tolist() == [0.0, 0.0, 1.0]
    assert new.active_loads['pull'].force.tolist() == [2.0, 0.0, 0.0]
