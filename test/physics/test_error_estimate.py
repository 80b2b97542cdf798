# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
What a run says that its method has added, beside what a far tighter one finds from outside.

A selection of `icofabric_validation.benchmarks.error_estimate`, which judges many more scenes.
"""

import math

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.simulation.reports.divergence import distance_between
from icofabric_validation.benchmarks.added_errors import draw_scene, judge
from icofabric_validation.stress.windows import fastest_rate, Windows
import numpy as np
import pytest

# Drag that stops all motion within some 20 ms: what is added is added then. With a little
# damping, of the kind of an example scene.
STOPPED = {
    'weave.size': [2, 2, 2], 'weave.connector_angle': 0.5, 'contact.mode': 'never',
    'drag.linear': 0.5, 'drag.angular': 5e-5, 'connector.damping': 1e-3,
    'initial_random.velocity_sigma': 0.3, 'initial_random.spin_sigma': 20.0,
    'initial_random.seed': 1}


@pytest.mark.parametrize('method', ['leapfrog', 'srkn4', 'srkn6', 'srkn8', 'dop8'])
def test_estimate_is_within_three_times_of_what_was_added(method):
    for seed, given in ((0, 0.0), (3, 0.0), (1, 0.7), (3, 0.5)):
        changes, periods, _ = draw_scene('free', seed)
        judged = judge(changes, method, given, min(periods, 60.0))
        assert judged.is_measurable and not judged.ended
        assert 1.0 / 3.0 < judged.ratio < 3.0
        assert not judged.decreases


@pytest.mark.parametrize('method, seed', [
    pytest.param('dop8', 7, marks=pytest.mark.long), ('dop8', 9), ('srkn6', 7), ('srkn6', 9)])
def test_estimate_counts_what_contacts_add(method, seed):
    changes, periods, _ = draw_scene('contact', seed)
    judged = judge(changes, method, 0.0, periods)
    assert judged.is_measurable and not judged.ended and not judged.decreases
    # Shells meet and part in a few windows, in which most is added.
    windows = np.sort(np.diff(judged.added))
    assert windows[-4:].sum() > 0.6 * judged.added[-1]
    # What a collision adds hangs on where in a step it begins: 0.2 to 5 times what is counted.
    stiffness = changes['contact.stiffness']
    ratios = [judged.ratio] + [
        judge({**changes, 'contact.stiffness': (1.0 + part) * stiffness}, method, 0.0,
              periods).ratio for part in (0.01, 0.02)]
    assert 1.0 / 3.0 < sorted(ratios)[1] < 3.0


def test_estimate_with_contacts_is_the_same_in_pieces_and_from_a_checkpoint():
    changes, periods, _ = draw_scene('contact', 21)
    scene = ico.Scene.from_parameters(changes | {'solver.method': 'srkn6'})
    whole, pieces, restored = (ico.compile_scene(scene) for _ in range(3))
    end = periods * 2.0 * np.pi / whole.status.largest_frequency
    whole.advance_to(end)
    estimates, free = [0.0], 0.0
    for time in np.sort(np.random.default_rng(0).uniform(0.0, end, 100)):
        pieces.advance_to(time)
        estimates.append(pieces.error_estimate)
        if not pieces.status.deepest_overlap:
            free = estimates[-1]
        if len(estimates) == 75:
            assert pieces.status.deepest_overlap > 0.0
            restored.restore(pieces.checkpoint())
            assert restored.error_estimate == pieces.error_estimate
    assert (np.diff(estimates) >= 0.0).all() and estimates[-1] > 10.0 * free > 0.0
    for simulation in (pieces, restored):
        simulation.advance_to(end)
        assert simulation.error_estimate == whole.error_estimate
        np.testing.assert_array_equal(simulation.snapshot().position, whole.snapshot().position)


@pytest.mark.parametrize('given', [0.0, 0.7])
def test_estimate_of_a_motion_that_dies(given):
    judged = judge(STOPPED, 'dop8', given, 150.0)
    # With steps of one length nearly all is added in the first tenth of the run.
    first = judged.added[len(judged.added) // 10]
    assert (first > 0.9 * judged.added[-1]) == (given > 0.0)
    assert judged.is_measurable and not judged.decreases
    assert 1.0 / 3.0 < judged.ratio < 3.0


@pytest.mark.parametrize('changes', [
    {'drag.linear': 0.05, 'drag.angular': 5e-6, 'connector.damping': 1e-3},
    {'drag.linear': 10.0, 'drag.angular': 1e-3, 'connector.damping': 1e-3},
    {'connector.stiffness_compression': 100.0},
    {'connector.stiffness_compression': 100.0, 'connector.break_length_extension': 0.034,
     'solver.step': 1e-4}])
def test_measured_steps_are_the_same_in_pieces_with_inputs_and_from_a_checkpoint(changes):
    scene = make_scene(changes=changes | {
        'solver.method': 'dop8', 'solver.tolerance': 1e-4, 'contact.mode': 'never',
        'initial_random.velocity_sigma': 0.3, 'initial_random.spin_sigma': 20.0,
        'groups.one': 'ids 1', 'loads.push.group': 'one'})
    whole, pieces, restored = (ico.compile_scene(scene) for _ in range(3))
    estimates, forces = [0.0], {number: (0.05 * number, 0.0, 0.0) for number in (20, 33, 70)}
    times = np.random.default_rng(0).uniform(0.0, 1e-3, 100).cumsum()
    for number, time in enumerate(times):
        pieces.advance_to(time)
        estimates.append(pieces.error_estimate)
        if number in forces:
            for simulation in (pieces, whole):
                simulation.advance_to(time)
                simulation.apply_wrench('push', forces[number])
        # Within a window that is measured, and after.
        if number in (2, 75):
            restored.restore(pieces.checkpoint())
            assert restored.error_estimate == pieces.error_estimate
            restored.advance_to(times[number + 1])
    assert (np.diff(estimates) >= 0.0).all() and estimates[-1] > 0.0
    for simulation in (whole, restored):
        simulation.advance_to(pieces.time)
        assert simulation.error_estimate == pieces.error_estimate
        np.testing.assert_array_equal(
            simulation.snapshot().position, pieces.snapshot().position)


@pytest.mark.parametrize(
    'kind, seed', [('damped', 3), ('damped', 4), ('damped', 43), ('kinked', 9)])
def test_estimate_of_steps_whose_two_error_estimates_mislead(kind, seed):
    # Beyond oscillation they say 20, 29 and 12 times what was added, of hidden kinks a tenth.
    changes, periods, _ = draw_scene(kind, seed)
    judged = judge(changes, 'dop8', 0.0, min(periods, 25.0))
    assert judged.is_measurable and not judged.ended and not judged.decreases
    assert 1.0 / 3.0 < judged.ratio < 3.0


@pytest.mark.parametrize('given', [0.0, 0.5])
def test_decay_that_is_slow_beside_steps_costs_no_evaluations_for_the_estimate(given):
    changes, _, _ = draw_scene('damped', 8)
    judged = judge(changes, 'dop8', given, 25.0)
    assert judged.is_measurable and not judged.ended and not judged.decreases
    assert 1.0 / 3.0 < judged.ratio < 3.0
    for damping, is_measured in ((1.0, False), (30.0, True)):
        run = ico.compile_scene(ico.Scene.from_parameters(changes | {
            'solver.method': 'dop8',
            'drag.linear': damping * changes['drag.linear'],
            'connector.damping': damping * changes['connector.damping']}))
        before = run.status.estimation_count
        run.advance_steps(50)
        assert run.error_estimate > 0.0
        assert (run.status.estimation_count > before) is is_measured


@pytest.mark.parametrize('seed, given', [(0, 0.0), (8, 0.37)])
def test_estimate_counts_forces_that_jump_where_bands_change_to_another_geodesic(seed, given):
    # The two error estimates, and probes, said 1/31 and 1/40 of what was added.
    changes, periods, _ = draw_scene('wrapped', seed)
    judged = judge(changes, 'dop8', given, min(periods, 8.0))
    assert judged.is_measurable and not judged.ended and not judged.decreases
    assert 1.0 / 3.0 < judged.ratio < 3.0


@pytest.mark.parametrize('kind, seed, method, given', [
    # Errors rise tenfold within a few periods: three probes in twelve of them missed that.
    ('free', 3, 'srkn8', 0.525), ('free', 13, 'srkn8', 0.321), ('contact', 16, 'leapfrog', 0.0),
    # Steps of a ten-thousandth of a period: errors within parts of it were summed.
    ('loaded', 14, 'leapfrog', 0.0), ('contact', 1, 'leapfrog', 0.0),
    ('wrapped', 0, 'leapfrog', 0.0),
    # Stretches of three periods, in which errors of jumps grow.
    ('wrapped', 14, 'dop8', 0.395), ('wrapped', 7, 'srkn6', 0.422)])
def test_estimate_of_errors_that_vary_or_take_each_other_back(kind, seed, method, given):
    changes, periods, _ = draw_scene(kind, seed)
    judged = judge(changes, method, given, min(periods, 12.0))
    assert judged.is_measurable and not judged.ended and not judged.decreases
    assert 1.0 / 3.0 < judged.ratio < 3.0


LOOSE = {
    'shell.edge_length': 0.02, 'shell.thickness': 0.002, 'shell.density': 1200.0,
    'weave.size': [1, 1, 1], 'weave.connected': False, 'contact.mode': 'always',
    'contact.stiffness': 3e4, 'solver.threads': 1}


@pytest.mark.parametrize('method', [
    'leapfrog', pytest.param('dop8', marks=pytest.mark.long)])
def test_an_error_of_velocity_moves_loose_shells_on(method):
    """Nothing takes back what a collision adds to a velocity: the estimate follows the flight."""
    scene = LOOSE | {
        'bodies.b.position': [0.06, 0.004, 0.003], 'bodies.b.linear_velocity': [-1.0, 0.1, 0.2],
        'bodies.b.angular_velocity': [3.0, -20.0, 8.0], 'solver.method': 'dop8'}
    times, ratios = (0.1, 1.0), []
    exact = ico.compile_scene(ico.Scene.from_parameters(scene | {'solver.tolerance': 1e-11}))
    ends = []
    for time in times:
        exact.advance_to(time)
        ends.append(exact.snapshot())
    for step in (2e-5, 4e-5):
        run = ico.compile_scene(ico.Scene.from_parameters(
            scene | {'solver.method': method, 'solver.step': step}))
        pieces, estimates, added = ico.compile_scene(run.scene), [0.0], []
        for time, end in zip(times, ends):
            run.advance_to(time)
            added.append(distance_between(run.snapshot(), end, 0.01))
            ratios.append(run.error_estimate / added[-1])
            for moment in np.linspace(pieces.time, time, 30)[1:]:
                pieces.advance_to(moment)
                estimates.append(pieces.error_estimate)
            assert pieces.error_estimate == run.error_estimate
        # After the collision, at 0.025 s, errors grow with the flight.
        assert added[1] > 8.0 * added[0] > 1e-6
        assert (np.diff(estimates) >= 0.0).all()
        run.restore(pieces.checkpoint())
        pieces.advance_to(1.1)
        run.advance_to(1.1)
        assert run.error_estimate == pieces.error_estimate > estimates[-1]
    # Where kinks lie in steps is chance; what they add before is left over a thousandth of it.
    assert 1.0 / 3.0 < np.median(ratios) < 3.0 and 0.2 < min(ratios) < max(ratios) < 10.0


@pytest.mark.parametrize('step', [0.1, 0.3])
def test_given_steps_see_what_slack_connectors_add_while_they_are_taut(step):
    """Two shells fly nearly all the time: windows of one short period beside tighter runs tell."""
    scene = ico.Scene.from_parameters({
        'weave.size': [1, 2, 2], 'contact.mode': 'never', 'connector.stiffness': 5.0,
        'connector.stiffness_extension': 1e5, 'initial_random.velocity_sigma': 0.5,
        'initial_random.seed': 5, 'solver.method': 'leapfrog', 'solver.threads': 1,
        'duration': 0.1})
    rate = ico.compile_scene(scene).status.largest_frequency
    run = ico.compile_scene(scene.with_changes({'solver.step': step / rate}))
    windows = Windows(run, fastest_rate(run), lambda: False, max_windows=math.inf)
    windows.follow(0.1)
    added = windows.result()
    assert added.windows > 100 and not added.unjudged and added.error > 1e-6
    assert 1.0 / 3.0 < run.error_estimate / added.error < 3.0


def test_given_steps_say_that_bodies_fly_where_connectors_are_slack_or_broken():
    """Kinks pass between what is measured, and what they add to velocities is not taken back."""
    scene = ico.Scene.from_parameters({
        'weave.size': [1, 2, 2], 'contact.mode': 'never', 'connector.stiffness': 1e2,
        'connector.stiffness_extension': 1e5, 'initial_random.velocity_sigma': 0.5,
        'initial_random.seed': 5, 'solver.method': 'dop8', 'solver.threads': 1})
    chosen = ico.compile_scene(scene)
    given = scene.with_changes({'solver.step': 0.3 / chosen.status.largest_frequency})
    run, exact = ico.compile_scene(given), ico.compile_scene(
        scene.with_changes({'solver.tolerance': 1e-9}))
    run.advance_to(0.2)
    for other in (exact, chosen):
        other.advance_to(run.time)
    errors = [distance_between(one.snapshot(), exact.snapshot(), scene.geometry.half_edge)
              for one in (run, chosen)]
    assert errors[0] > 3.0 * run.error_estimate > 1e-5
    assert 'bodies move freely' in run.status.error_estimate_lacks
    # Chosen steps keep the tolerance, 1e-6 1/s, and need no such words.
    assert errors[1] < 1e-6 * run.time and chosen.status.error_estimate_lacks == ''
    # A little softer is no slack; once that has broken bodies fly, too.
    softer = ico.compile_scene(given.with_changes({
        'connector.stiffness': 0.5e5, 'connector.break_length_extension':
        1.001 * scene.geometry.connector_length}))
    assert softer.status.error_estimate_lacks == ''
    softer.advance_to(0.2)
    assert softer.status.broken_count
    assert 'bodies move freely' in softer.status.error_estimate_lacks


def test_a_load_that_lasts_a_few_given_steps_is_told_when_it_acts():
    """A torque turns a spin for two steps; after that spins are exact, and nothing is added."""
    step = 4e-3
    scene = ico.Scene.from_parameters({
        'weave.size': [1, 1, 1], 'weave.connected': False, 'contact.mode': 'never',
        'loads.turn.group': 'all', 'loads.turn.torque': [2e-3, 0.0, 0.0],
        'loads.turn.profile': 'steady', 'loads.turn.duration': 2 * step,
        'initial.spun.group': 'all', 'initial.spun.angular_velocity': [0.0, 20.0, 30.0],
        'solver.method': 'leapfrog', 'solver.threads': 1})
    exact = ico.compile_scene(scene.with_changes({'solver.step': step / 256}))
    run = ico.compile_scene(scene.with_changes({'solver.step': step}))
    added, estimates = [], []
    for count in (1, 2, 3, 20, 60):
        exact.advance_to(count * step)
        run.advance_to(count * step)
        added.append(distance_between(run.snapshot(), exact.snapshot(), scene.shell.half_edge))
        estimates.append(run.error_estimate)
    assert added[0] > 1e-4 and added[1] > 1.2 * added[0]
    assert added[2:] == pytest.approx([added[1]] * 3, rel=0.05)
    assert estimates[:2] == pytest.approx(added[:2], rel=0.05)
    # What follows is measured 64 steps later, and until then taken to be as before.
    assert (np.diff(estimates) >= 0.0).all() and estimates[-1] < 15.0 * added[-1]
    other = ico.compile_scene(run.scene)
    other.advance_to(step)
    resumed = ico.compile_scene(run.scene)
    resumed.restore(other.checkpoint())
    resumed.advance_to(60 * step)
    assert resumed.error_estimate == run.error_estimate


def test_errors_of_velocity_do_not_move_what_lies_on_a_floor():
    run = ico.compile_scene(ico.Scene.from_parameters(LOOSE | {
        'gravity': [0.0, 0.0, -9.81], 'planes.floor.normal': [0.0, 0.0, 1.0],
        'planes.floor.offset': -0.02, 'contact.damping': 30.0, 'solver.method': 'dop8',
        'solver.step': 2e-5}))
    estimates = []
    for time in (0.2, 0.5, 0.8):
        run.advance_to(time)
        estimates.append(run.error_estimate)
    # It bounced, and lies still.
    assert abs(run.snapshot().linear_velocity).max() < 1e-9 and estimates[0] > 1e-5
    assert estimates[2] - estimates[0] < 1e-4 * estimates[0]


def test_steps_that_contacts_make_err_more_than_allowed_are_reported_once(caplog):
    changes, _, _ = draw_scene('contact', 11)
    run = ico.compile_scene(ico.Scene.from_parameters(changes | {'solver.method': 'srkn8'}))
    run.advance_to(40.0 * np.pi / run.status.largest_frequency)
    assert run.error_estimate > 3.0 * changes['solver.tolerance'] * run.time
    said = [text for text in caplog.messages if 'where solver.tolerance' in text]
    assert len(said) == 1 and 'solver.method dop8 or auto' in said[0]


def test_methods_that_do_not_follow_contacts_are_named_at_the_start(caplog):
    changes = {
        'shell.edge_length': 0.02, 'contact.mode': 'auto', 'weave.size': [2, 2, 2],
        'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.1,
        'gravity': [0.0, 0.0, -9.81]}
    for method, step, said in (
            ('srkn6', 0.0, True), ('dop8', 0.0, False), ('auto', 0.0, False),
            ('srkn6', 1e-5, False)):
        caplog.clear()
        ico.compile_scene(ico.Scene.from_parameters(changes | {
            'solver.method': method, 'solver.step': step}))
        found = [text for text in caplog.messages if 'has steps of one length' in text]
        assert len(found) == said and all('dop8 or auto' in text for text in found)


def test_a_step_that_crossings_keep_short_is_not_measured_at_every_check(monkeypatch):
    # Each measurement is of thousands of steps, each check of six.
    changes, _, _ = draw_scene('kinked', 0)
    run = ico.compile_scene(ico.Scene.from_parameters(changes | {'solver.method': 'srkn8'}))
    probe, counted = run._event_loop.driver.errors.probe, []
    measured = probe.measured
    monkeypatch.setattr(probe, 'measured', lambda *words, **more: (
        counted.append(run.time), measured(*words, **more))[1])
    run.advance_to(600.0 * run.status.step)
    assert run.status.step_count >= 600 and len(counted) <= 2


def test_estimate_with_bands_is_the_same_from_a_checkpoint_within_a_stretch():
    changes, _, _ = draw_scene('wrapped', 0)
    scene = ico.Scene.from_parameters(changes | {'solver.method': 'leapfrog'})
    whole, pieces, restored = (ico.compile_scene(scene) for _ in range(3))
    period = 2.0 * np.pi / whole.status.largest_frequency
    pieces.advance_to(0.4 * period)
    restored.restore(pieces.checkpoint())
    touching = restored._event_loop.driver.errors.touching
    assert touching is not None and 'earlier' in touching.state_tree()
    for simulation in (whole, pieces, restored):
        simulation.advance_to(1.3 * period)
    assert whole.error_estimate == pieces.error_estimate == restored.error_estimate
    assert touching.total > 0.0 and 'earlier' in touching.state_tree()


def test_chosen_steps_keep_the_tolerance_at_kinks():
    # Most is added in two steps, in which estimates are too small: 1.9 times the tolerance.
    changes, periods, _ = draw_scene('kinked', 28)
    judged = judge(changes, 'dop8', 0.0, periods)
    assert len(judged.times) > 10 and not judged.ended
    assert judged.added[-1] < changes['solver.tolerance'] * judged.times[-1]


def test_near_rounding_steps_at_kinks_go_on():
    changes, _, _ = draw_scene('kinked', 2)
    run = ico.compile_scene(ico.Scene.from_parameters(changes | {
        'solver.method': 'dop8', 'connector.obstruction': 'warn'}))
    run.advance_to(6e-4)
    assert 0.0 < run.error_estimate < changes['solver.tolerance'] * run.time


@pytest.mark.parametrize('method, step', [('leapfrog', 0.0), ('leapfrog', 2e-4), ('dop8', 0.0)])
def test_estimate_is_the_same_in_pieces_and_from_a_checkpoint(method, step):
    scene = make_scene(changes={
        'solver.method': method, 'solver.step': step, 'solver.tolerance': 1e-4,
        'initial_random.velocity_sigma': 0.3, 'initial_random.spin_sigma': 20.0})
    whole, pieces, restored = (ico.compile_scene(scene) for _ in range(3))
    estimates = [0.0]
    for time in np.random.default_rng(0).uniform(0.0, 4e-3, 100).cumsum():
        pieces.advance_to(time)
        estimates.append(pieces.error_estimate)
        if len(estimates) == 50:
            restored.restore(pieces.checkpoint())
            assert restored.error_estimate == pieces.error_estimate
    assert (np.diff(estimates) >= 0.0).all() and estimates[1] > 0.0
    for simulation in (whole, restored):
        simulation.advance_to(pieces.time)
        assert simulation.error_estimate == pieces.error_estimate


@pytest.mark.parametrize('method, step', [('leapfrog', 0.0), ('leapfrog', 2e-4), ('dop8', 0.0)])
def test_jumps_and_inputs_take_nothing_back(method, step):
    simulation = ico.compile_scene(make_scene(changes={
        'solver.method': method, 'solver.step': step, 'solver.tolerance': 1e-4,
        'initial_random.velocity_sigma': 0.3, 'initial_random.spin_sigma': 20.0,
        'groups.one': 'ids 1', 'loads.push.group': 'one'}))
    estimate = 0.0
    for number in range(40):
        simulation.advance_to(simulation.time + 3.1e-3)
        assert simulation.error_estimate > estimate
        estimate = simulation.error_estimate
        if number % 4 == 1:
            simulation.apply_wrench('push', (0.1 * number, 0.0, 0.0))
        elif number % 4 == 3:
            simulation.set_state(linear_velocity=0.9 * simulation.snapshot().linear_velocity)
        assert simulation.error_estimate >= estimate * (1.0 - 1e-15)
    simulation.reset_time()
    assert simulation.error_estimate == 0.0


def test_no_stretch_leads_across_a_jump_of_the_state():
    """Steps get their first length there, and a stretch that began before it is not judged."""
    scene = ico.load_scene('stiff_cantilever').with_changes({
        'weave.size': [2, 2, 2], 'solver.method': 'srkn6'})
    before = ico.compile_scene(scene)
    before.advance_to(0.01)
    after = ico.compile_scene(scene.with_changes({'connector.stiffness': 3000.0}))
    after.continue_from(before, keep_motion=True)
    assert after.time == before.time and after.error_estimate < 1e-6
    after.advance_to(0.02)
    after.reset()
    after.advance_to(0.03)
    assert 0.0 < after.error_estimate < 1e-6


def test_a_step_that_ends_with_a_pulse_is_no_difference_of_the_motion():
    """It is shorter than those before: differences across it would say far too much."""
    changes, _, _ = draw_scene('loaded', 4)
    simulation = ico.compile_scene(ico.Scene.from_parameters({
        **changes, 'solver.method': 'srkn4', 'solver.step': 0.0}))
    step, end = simulation.status.step, changes['loads.l.duration']
    simulation.advance_to(end - 10.0 * step)
    before = simulation.error_estimate
    simulation.advance_to(end)
    assert simulation.status.step_count > 300
    # A step ends there, in the middle of which would have been the next.
    assert simulation.snapshot().time == end
    simulation.advance_to(end + 20.0 * step)
    assert before < simulation.error_estimate < 1.3 * before


def test_measurements_at_kinks_take_their_part_of_the_steps():
    """One takes three periods of steps: later ones wait until the run has paid for them."""
    scene = make_scene((3, 3, 3), {
        'connector.stiffness_compression': 100.0, 'contact.mode': 'never',
        'solver.method': 'srkn4', 'solver.tolerance': 1e-6,
        'initial_random.velocity_sigma': 0.05, 'initial_random.spin_sigma': 2.0})
    simulation = ico.compile_scene(scene)
    first = simulation.status.estimation_count
    simulation.advance_to(0.5)
    status = simulation.status
    assert status.step_count > 500
    assert first < status.estimation_count <= first + 0.2 * status.evaluation_count
