# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
What must not depend on interrupts, resets, or the way inputs arrive; and loads beyond reason.
"""

import hashlib
import logging
import subprocess
import sys

from fabrics import loaded_fabric, make_scene, RANDOM, STATE, warnings_said
import icofabric_sim as ico
from icofabric_sim.kernels import monitor
from icofabric_sim.simulation.errors import Interrupted
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

# A test run in the background would hand on that SIGINT is ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
simulation = ico.compile_scene(ico.Scene.from_parameters(eval(sys.argv[1])))
simulation.warm_up()
count, sent, inside = 0, threading.Event(), threading.Event()

def disturb():
    for k in range(60):
        inside.wait()
        time.sleep(0.001 + 0.004 * (k % 4))
        before = count
        os.kill(os.getpid(), signal.SIGINT)
        # The next one comes when this one has been caught.
        while count == before:
            time.sleep(0.0005)
    sent.set()

threading.Thread(target=disturb, daemon=True).start()
while True:
    try:
        inside.set()
        while simulation.time < 12.0 or not sent.is_set():
            simulation.advance_to(max(simulation.time, 12.0))
        break
    except KeyboardInterrupt:
        inside.clear()
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
    assert int(count) == 60 and float(time) == 12.0 and restored == 'True'
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
    assert again.status.step == fresh.status.step
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
    assert same_bits(ahead, pieces) and not ahead.status.active_loads


def test_steps_are_counted_as_they_are_taken():
    simulation = make()
    end = simulation.status.next_step_time
    # At a step end, without effect, and twice the same: none of these is a step of its own.
    simulation.apply_wrench('push', force=(0.0, 0.0, 0.1), time=end)
    simulation.apply_wrench('push', force=(0.0, 0.0, 0.1), time=end + 1e-5)
    simulation.apply_wrench('push', time=0.9)
    before = simulation.status.step_count
    simulation.advance_steps(7)
    assert simulation.status.step_count == before + 7
    assert simulation.time == pytest.approx(end + 6 * simulation.status.step, rel=1e-9)
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
    assert not warnings_said(caplog)


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
    crowded = {'contact': {'mode': 'auto', 'stiffness': 100.0},
               'bodies': {'near': {'position': [0.0, 0.0, -0.0305]}}}
    old = make(**crowded)
    assert old.status.proximity is not None
    new = make(**crowded, gravity=[0.0, 0.0, -1.0])
    with caplog.at_level(logging.WARNING):
        old.advance_to(0.01)
        assert len(warnings_said(caplog)) == 1
        new.continue_from(old, keep_motion=True)
        new.advance_to(0.02)
    assert new.status.proximity is old.status.proximity and len(warnings_said(caplog)) == 1
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
    new.continue_from(old, keep_motion=True)
    assert new.status.active_loads['push'].force.tolist() == [0.0, 0.0, 1.0]
    assert new.status.active_loads['pull'].force.tolist() == [2.0, 0.0, 0.0]


@pytest.mark.parametrize('method', ico.METHODS)
def test_looking_at_a_state_does_not_delay_the_inputs_of_that_time(method):
    changes = {'solver.method': method, 'solver.tolerance': 1e-3}
    quiet, watched = (ico.compile_scene(loaded_fabric(changes)) for _ in range(2))
    watched.snapshot()
    for time in (0.0, 0.004, 0.0091):
        for simulation in (quiet, watched):
            simulation.advance_to(time)
            for force in ((0.0, 1.0, 0.0), (2.0, 1.0, 0.0)):
                simulation.apply_wrench('two', force)
                if simulation is watched:
                    simulation.snapshot()
    for simulation in (quiet, watched):
        simulation.advance_to(0.015)
    assert same_bits(quiet, watched)
    assert quiet.status.step_count == watched.status.step_count
    assert quiet.error_estimate == watched.error_estimate
    assert abs(quiet.snapshot().energy['work_in']) > 1e-3


@pytest.mark.parametrize('method', ico.METHODS)
def test_warming_up_takes_no_step(method):
    scene = loaded_fabric({'solver.method': method, 'loads.tip.force': [1.0, 0.0, 0.0]})
    cold, warm = ico.compile_scene(scene), ico.compile_scene(scene)
    warm.warm_up()
    assert warm.status.step_count == 0
    assert warm.checkpoint().to_bytes() == cold.checkpoint().to_bytes()
    old = ico.compile_scene(scene)
    old.apply_wrench('two', (0.0, 1.0, 0.0))
    old.advance_to(0.01)
    # Wrenches that go over act from the first step on.
    for simulation in (cold, warm):
        simulation.continue_from(old, keep_motion=False)
        simulation.advance_to(0.02)
    assert same_bits(cold, warm)


def test_adaptive_steps_are_counted_as_they_end():
    simulation = ico.compile_scene(loaded_fabric({'solver.method': 'dop8'}))
    times = []
    for count in range(1, 6):
        simulation.advance_steps(1)
        assert simulation.status.step_count == count
        times.append(simulation.time)
    assert times == sorted(set(times))
    other = ico.compile_scene(loaded_fabric({'solver.method': 'dop8'}))
    other.advance_steps(5)
    assert other.status.step_count == 5 and other.time == times[-1]
    third = ico.compile_scene(loaded_fabric({'solver.method': 'dop8'}))
    third.advance_to(times[-1])
    assert third.status.step_count == 5


def test_a_fabric_woven_anew_owes_no_errors_for_the_time_before():
    def run(start):
        simulation = make()
        if start:
            old = make()
            old.advance_to(start)
            simulation.continue_from(old, keep_motion=False)
        simulation.advance_to(start + 0.3)
        return simulation

    assert run(50.0).error_estimate == pytest.approx(run(0.0).error_estimate, rel=1e-6)


def test_what_overlaps_in_a_fabric_woven_anew_does_so_from_then_on():
    crowded = {'contact': {'mode': 'auto', 'stiffness': 100.0},
               'bodies': {'near': {'position': [0.0, 0.0, -0.0305]}}}
    old, new = make(), make(**crowded)
    old.advance_to(2.5)
    new.continue_from(old, keep_motion=False)
    assert new.status.proximity.time == 2.5


# A pull that folds the fabric up, and makes its motion rougher and rougher.
FOLDED = {
    'contact.mode': 'never', 'solver.tolerance': 1e-4, 'weave.variant': 1,
    'groups.pushed': 'x_max', 'loads.l.group': 'pushed', 'loads.l.frame': 'body',
    'loads.l.force': [-2.0, -0.5, -0.3], 'loads.l.point': [0.01, -0.022, 0.002]}


@pytest.mark.parametrize('method', ico.METHODS)
def test_a_run_whose_time_is_reset_remembers_nothing(method):
    scene = loaded_fabric({
        'solver.method': method, 'solver.tolerance': 1e-3,
        'contact.mode': 'never' if method == 'tsit5' else 'auto'})
    fresh, again = ico.compile_scene(scene), ico.compile_scene(scene)
    start, count = fresh.checkpoint(), 0
    # Stopped at steps of every number since the last look.
    for number in range(30):
        again.apply_wrench('two', (0.0, 3.0, 0.0), time=again.time + 0.002)
        again.advance_to(again.time + 0.005)
        again.advance_steps(number + 1)
        count += again.status.step_count
        again.reset_time()
        assert again.checkpoint().difference(start) == ''
    assert count > 500


def test_a_run_whose_time_is_reset_does_not_know_where_the_first_went_back():
    fresh, again = (
        ico.compile_scene(make_scene((2, 4, 2), {
            **FOLDED, 'solver.method': 'srkn6', 'solver.tolerance': 1e-5}))
        for _ in range(2))
    start = fresh.checkpoint()
    fresh.advance_to(0.1)
    again.advance_to(0.1)
    assert np.isfinite(fresh._driver.errors.returned_to)  # it did go back
    again.reset_time()
    assert again.checkpoint().difference(start) == ''
    again.advance_to(0.1)
    assert again.checkpoint().to_bytes() == fresh.checkpoint().to_bytes()


def test_an_unsound_state_is_never_kept_for_its_rougher_motion(monkeypatch):
    """A look that finds both must end the run at the last sound look, not at this one."""
    scene = make_scene((3, 3, 3), {
        'contact.mode': 'never', 'solver.tolerance': 1e-4, 'solver.method': 'srkn6'}, **RANDOM)
    simulation, same = ico.compile_scene(scene), ico.compile_scene(scene)
    simulation.advance_to(0.02)
    driver = simulation._driver
    trajectory = driver.trajectory
    seen = []
    respond = driver.respond

    def note(status, time):
        seen.append((status, time))
        respond(status, time)

    monkeypatch.setattr(driver, 'respond', note)
    # The next look finds any motion too rough, and any balance wrong.
    trajectory.ledger.rough_limit, trajectory.ledger.limit = 1e-300, 1e-300
    kept = trajectory.saved_time
    with pytest.raises(ico.SimulationError, match='does not balance') as caught:
        simulation.advance_to(1.0)
    status, time = seen[-1]
    assert status & monitor.ROUGHER and status & monitor.UNBALANCED
    assert simulation.time == kept < time
    assert f'the last good state, of t = {kept:.9g} s, is kept' in str(caught.value)
    # It is the state of that time, which a sound run passes.
    same.advance_to(kept)
    assert same_bits(simulation, same) and kept > 0.0
    for name in STATE:
        assert np.isfinite(getattr(simulation.snapshot(), name)).all()
