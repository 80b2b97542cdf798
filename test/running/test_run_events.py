# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What each event does to the motion, and what a run shows after it."""

from fabrics import changed, make_scene, RANDOM
import icofabric_sim as ico
from icofabric_sim.running.run_events import (
    do_event,
    is_jump,
    replace_simulation,
    runs_after,
    Shown,
    shown_after,
)
import numpy as np
import pytest

TIME = 20_000_000


@pytest.fixture
def moving():
    """A fabric in motion, at t = 0.02 s, under a wrench that was received."""
    simulation = ico.compile_scene(make_scene(
        **RANDOM, groups={'tip': 'x_max'}, loads={'tip': {'group': 'tip'}}))
    simulation.apply_wrench('tip', (0.0, 0.0, 1e-3))
    simulation.advance_to(TIME / 1e9)
    assert abs(simulation.snapshot().position - simulation.scene.initial.position).max() > 1e-6
    return simulation


def test_reset_goes_back_to_the_initial_state_and_forgets_what_was_received(moving):
    later = TIME + 5_000_000
    do_event(moving, later, 'reset', {'time_reset': False, 'dropped': 0})
    assert moving.time == later / 1e9 and not moving.status.active_loads
    assert (moving.snapshot().position == moving.scene.initial.position).all()
    do_event(moving, later, 'reset', {'time_reset': True})
    assert moving.time == 0.0 and moving.status.step_count == 0


def test_a_body_that_is_put_elsewhere_is_the_only_one_that_moves(moving):
    before = moving.snapshot()
    wanted = before.position[3] + [0.0, 0.0, 1e-4]
    do_event(moving, TIME, 'state_set', {'body': 3, 'position': wanted.tolist(), 'time': 0.02})
    after = moving.snapshot()
    assert (after.position[3] == wanted).all() and after.time == before.time
    others = np.arange(len(before.position)) != 3
    assert (after.position[others] == before.position[others]).all()
    assert (after.linear_velocity == before.linear_velocity).all()
    for facts in ({'position': [0.0, 0.0, 0.0]}, {'body': 3, 'position': [0.0, 0.0]}):
        with pytest.raises((KeyError, ValueError)):
            do_event(moving, TIME, 'state_set', facts)


def test_failure_is_met_again_on_the_way_to_its_target():
    scene = make_scene(
        (3, 3, 3), initial_random={'velocity_sigma': 3.0}, solver={'method': 'srkn6'})
    limit = ico.compile_scene(scene).status.stability_limit
    failing = ico.compile_scene(
        changed(scene, {'solver.step': float(np.nextafter(limit, 0.0))}))
    with pytest.raises(ico.SimulationError, match='solver.step'):
        do_event(failing, 0, 'failed', {'target': 10**9, 'reason': 'solver.step'})
    assert 0.0 < failing.time < 1.0


@pytest.mark.parametrize('name', [
    'pause', 'resume', 'step', 'record', 'checkpoint_saved', 'change_refused', 'not known here'])
def test_other_events_do_not_touch_the_motion(moving, name):
    before = moving.snapshot()
    do_event(moving, TIME, name, {})
    assert moving.snapshot() is before and moving.status.active_loads


@pytest.mark.parametrize(('changes', 'restarts'), [
    ({'connector.stiffness': 600.0}, False), ({'shell.density': 900.0}, True)])
def test_the_changed_fabric_takes_over_as_its_parameters_say(moving, changes, restarts):
    scene, before = changed(moving.scene, changes), moving.snapshot()
    built, later = ico.compile_scene(scene), TIME + 1_000_000
    assert replace_simulation(
        moving, built, later, moving.scene.parameters, scene.parameters) == restarts
    assert built.time == later / 1e9 and built.status.active_loads.keys() == {'tip'}
    moved = abs(built.snapshot().position - before.position).max()
    begun = abs(built.snapshot().position - scene.initial.position).max()
    assert (begun < moved) == restarts


def test_what_is_shown_and_where_a_record_ends():
    assert {name: shown_after(name, running=True) for name in (
        'pause', 'step', 'failed', 'reset', 'reweave', 'state_set', 'record')} == {
        'pause': Shown.NOTHING, 'step': Shown.PRESENT, 'failed': Shown.PRESENT,
        'reset': Shown.ANEW, 'reweave': Shown.ANEW, 'state_set': Shown.NOTHING,
        'record': Shown.NOTHING}
    assert shown_after('state_set', running=False) is Shown.PRESENT
    assert [runs_after(name, running=True) for name in ('pause', 'resume', 'reset')] == [
        False, True, True]
    assert is_jump('reset', {'time_reset': True}) and not is_jump('reset', {'time_reset': False})
    assert is_jump('checkpoint_restored', {}) and not is_jump('reweave', {})
