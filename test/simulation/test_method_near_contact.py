# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Another method goes on once shells are near each other, where `auto` chose the first."""

import icofabric_sim as ico
import numpy as np
import pytest

SCENE = ico.load_scene('free_slab').with_changes({
    'weave.size': [4, 4, 2], 'solver.threads': 1, 'groups.left': 'x_min', 'groups.right': 'x_max',
    'contact.stiffness': 1e6, 'loads.left.group': 'left', 'loads.right.group': 'right',
    'loads.all.group': 'all', 'loads.all.share': 'total'})
END = 0.08


def push(simulation):
    """Press both sides together, so that shells meet, with wrenches in between."""
    for side, force in (('left', 0.5), ('right', -0.5)):
        simulation.apply_wrench(side, force=(force, 0.0, 0.1 * force), time=0.001)
    for time in (0.0101, 0.0307, 0.0502):
        simulation.apply_wrench('all', force=(0.0, 20.0 * time, 0.1), time=time)


@pytest.fixture(scope='module')
def through():
    """A run to the end in one go, and the time from which the other method took its steps."""
    simulation, changed = ico.compile_scene(SCENE), None
    push(simulation)
    probe = ico.compile_scene(SCENE)
    push(probe)
    assert probe.status.method_name != 'dop8' and probe.status.touching_method == 'dop8'
    while probe.status.method_name != 'dop8':
        probe.advance_to(probe.time + 1e-4)
        assert probe.time < END
    changed = probe.time
    simulation.advance_to(END)
    assert simulation.status.method_name == 'dop8' and simulation.status.has_contacts
    assert simulation.status.deepest_overlap > 0.0
    return simulation, changed


def test_it_takes_over_before_anything_touches_and_says_why(through):
    _, changed = through
    simulation = ico.compile_scene(SCENE)
    push(simulation)
    simulation.advance_to(changed)
    status = simulation.status
    assert status.method_name == 'dop8' and not len(status.touching().bodies)
    assert 'until shells are near each other' in status.method_reason
    assert f'as of t = {changed:.2g}'[:-1] in status.method_reason


@pytest.mark.parametrize('pieces', [7, 240])
def test_pieces_give_the_same_bits_through_it(pieces, through):
    whole, _ = through
    simulation = ico.compile_scene(SCENE)
    push(simulation)
    for k in range(1, pieces + 1):
        simulation.advance_to(END * k / pieces)
        simulation.snapshot()
    assert simulation.snapshot().position.tobytes() == whole.snapshot().position.tobytes()
    assert simulation.status.step_count == whole.status.step_count
    assert simulation.error_estimate == whole.error_estimate
    assert simulation.balance == whole.balance


def test_single_steps_give_the_same_motion_through_it(through):
    whole, changed = through
    simulation = ico.compile_scene(SCENE)
    push(simulation)
    while simulation.time < changed + 0.002:
        count = simulation.status.step_count
        simulation.advance_steps(1)
        assert simulation.status.step_count == count + 1
    assert simulation.status.method_name == 'dop8'
    simulation.advance_to(END)
    assert simulation.snapshot().position.tobytes() == whole.snapshot().position.tobytes()


@pytest.mark.parametrize('at', [-0.003, 0.0, 0.004])
def test_a_checkpoint_of_either_method_goes_on_with_the_same_bits(at, through):
    whole, changed = through
    first = ico.compile_scene(SCENE)
    push(first)
    first.advance_to(changed + at)
    kept = ico.Checkpoint.from_bytes(first.checkpoint().to_bytes())
    fresh, other = ico.compile_scene(SCENE), ico.compile_scene(SCENE)
    other.advance_to(0.001)
    # Also into a run whose method has changed already.
    push(other)
    other.advance_to(END)
    for simulation in (fresh, other):
        simulation.restore(kept)
        assert simulation.status.method_name == first.status.method_name
        simulation.advance_to(END)
        assert simulation.snapshot().position.tobytes() == whole.snapshot().position.tobytes()
        assert simulation.balance == whole.balance


def test_a_checkpoint_of_another_scene_leaves_the_run_as_it_is(through):
    whole, _ = through
    simulation = ico.compile_scene(SCENE)
    push(simulation)
    simulation.advance_to(0.001)
    other = ico.compile_scene(SCENE.with_changes({'connector.stiffness': 1234.0}))
    with pytest.raises(ValueError, match='cannot be restored here'):
        simulation.restore(other.checkpoint())
    dop8 = ico.compile_scene(SCENE.with_changes({'solver.method': 'dop8'}))
    with pytest.raises(ValueError, match='solver.method'):
        simulation.restore(dop8.checkpoint())
    simulation.advance_to(END)
    assert simulation.snapshot().position.tobytes() == whole.snapshot().position.tobytes()


def test_a_reset_begins_with_the_first_method_again(through):
    whole, _ = through
    simulation = ico.compile_scene(SCENE)
    push(simulation)
    simulation.advance_to(END)
    simulation.reset_time()
    assert simulation.status.method_name != 'dop8' and simulation.status.step_count == 0
    assert simulation.error_estimate == 0.0
    push(simulation)
    simulation.advance_to(END)
    assert simulation.snapshot().position.tobytes() == whole.snapshot().position.tobytes()


def test_books_go_on_and_the_tolerance_is_kept(through):
    whole, changed = through
    simulation = ico.compile_scene(SCENE)
    push(simulation)
    simulation.advance_to(changed - 2e-4)
    before, steps = simulation.balance, simulation.status.step_count
    estimate, work = simulation.error_estimate, simulation.snapshot().energy['work_in']
    assert simulation.status.method_name != 'dop8'
    simulation.advance_to(changed)
    after = simulation.balance
    assert simulation.status.step_count > steps and work > 0.0
    assert simulation.snapshot().energy['work_in'] == pytest.approx(work, rel=0.1)
    assert after.scale >= before.scale and after.worst >= before.worst
    assert 0.5 * estimate <= simulation.error_estimate <= 10.0 * estimate + 1e-9
    energy = whole.snapshot().energy
    assert whole.balance.worst < 1e-6 and energy['work_in'] > 0.0
    tight = ico.compile_scene(SCENE.with_changes({
        'solver.method': 'dop8', 'solver.tolerance': 1e-8}))
    push(tight)
    tight.advance_to(END)
    apart = np.abs(tight.snapshot().position - whole.snapshot().position).max()
    # A run of 0.06 s in which a displacement grows some hundredfold.
    assert 0.0 < apart / SCENE.geometry.half_edge < 1e-4


def test_less_than_rounding_of_contacts_is_not_asked_for(through, caplog):
    """Steps fell to 1e-11 s: 587,222 instead of some 500."""
    whole, _ = through
    tight = ico.compile_scene(SCENE.with_changes({
        'solver.method': 'dop8', 'solver.tolerance': 1e-10}))
    push(tight)
    caplog.set_level('WARNING', 'icofabric_sim')
    tight.advance_to(END)
    assert whole.status.step_count < tight.status.step_count < 1000
    assert 'errors below 5' in caplog.text and 'are not asked for' in caplog.text
    apart = np.abs(tight.snapshot().position - whole.snapshot().position).max()
    assert 0.0 < apart / SCENE.geometry.half_edge < 1e-4


@pytest.mark.parametrize('changes', [
    {'solver.method': 'srkn6'}, {'solver.step': 1e-5}, {'contact.mode': 'never'},
    {'solver.tolerance': 1e-6, 'connector.damping': 1e-4}])
def test_a_method_or_step_that_was_given_and_others_that_follow_contacts_stay(changes):
    simulation = ico.compile_scene(SCENE.with_changes(changes))
    push(simulation)
    name = simulation.status.method_name
    assert simulation.status.touching_method == name
    simulation.advance_to(0.5 * END)
    assert simulation.status.method_name == name
