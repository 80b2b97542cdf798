# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors with two stiffnesses (eq 2), and groups of them with laws of their own."""

import analytical
from fabrics import BOTH_FORMS, changed, LOADED, make_scene, pair_face_to_face, RANDOM, same_state
import icofabric_sim as ico
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.model.stability import largest_frequency
from icofabric_sim.simulation.stepping.method_selection import choose_method
from icofabric_sim.simulation.stepping.methods import METHODS
import numpy as np
import pytest

KINKED = {
    'weave.variant': 0, 'connector.stiffness_extension': 800.0,
    'connector.stiffness_compression': 100.0, 'contact.mode': 'never'}
GROUPS = {
    'groups': {'low': 'z_min', 'high': 'not z_min'},
    'connector_groups': {
        'soft': {'between': 'low high', 'stiffness': 50.0},
        'taut': {'between': 'high high', 'natural_length': 0.03}}}


def swinging_pair(changes, amplitude, form='quaternion'):
    """Two bodies whose connector lies on their line of centres, longer by `amplitude` of D."""
    scene = make_scene((2, 2, 1), {'solver.tolerance': 1e-10, **changes})
    length = scene.connectors.natural_length
    simulation = ico.compile_scene(scene, rotation=form)
    position, orientation = pair_face_to_face(
        scene, scene.geometry.cube_width + length * (1.0 + amplitude))
    simulation.set_state(position=position, orientation=orientation)
    return scene, simulation


@pytest.mark.parametrize('form', BOTH_FORMS)
@pytest.mark.parametrize('extension, compression', [(800.0, 100.0), (60.0, 900.0)])
def test_period_is_half_of_each_stiffness(form, extension, compression):
    scene, simulation = swinging_pair({
        'connector.stiffness_extension': extension,
        'connector.stiffness_compression': compression}, 1e-2, form)
    frequencies = [
        analytical.axial_frequency(k, scene.shell.mass) for k in (extension, compression)]
    period = np.pi * sum(1.0 / frequency for frequency in frequencies)
    start = simulation.snapshot()
    # It is shortest after a quarter of the one and a half of both, and back after a period.
    simulation.advance_to(0.5 * np.pi / frequencies[0] + 0.5 * np.pi / frequencies[1])
    shortest = simulation.snapshot().connector_length[0] / scene.connectors.natural_length - 1.0
    assert shortest == pytest.approx(-1e-2 * np.sqrt(extension / compression), rel=1e-7)
    simulation.advance_to(period)
    end = simulation.snapshot()
    assert np.abs(end.position - start.position).max() < 1e-9 * scene.geometry.half_edge
    assert end.energy['connectors'] == pytest.approx(start.energy['connectors'], rel=1e-8)


def test_slack_connectors_do_nothing_when_short():
    scene, simulation = swinging_pair({'connector.stiffness_compression': 0.0}, -0.02)
    start = simulation.snapshot()
    speed = np.zeros((2, 3))
    axis = start.position[1] - start.position[0]
    speed[1] = 0.01 * axis / np.linalg.norm(axis)
    simulation.set_state(linear_velocity=speed)
    simulation.advance_to(0.01)
    middle = simulation.snapshot()
    np.testing.assert_allclose(
        middle.position - start.position, 0.01 * speed, rtol=0, atol=1e-15)
    assert middle.energy['connectors'] == 0.0
    # Pulled taut it hands all of the motion on: equal masses on a line exchange their velocities.
    simulation.advance_to(0.1)
    end = simulation.snapshot()
    assert end.energy['connectors'] == 0.0
    np.testing.assert_allclose(end.linear_velocity, speed[::-1], rtol=0, atol=1e-8 * 0.01)


@pytest.mark.parametrize('method', [
    # Its steps are of order 2 here, as all are, with 16 evaluations each: 35 s.
    pytest.param(name, marks=pytest.mark.long if name == 'srkn8' else ())
    for name, method in ico.METHODS.items() if not method.adaptive])
def test_steps_are_short_enough_for_slack_connectors_that_pull_later(method):
    """While they are slack any step is exact, so a measurement of the motion allows all steps."""
    tolerance = 1e-7
    scene, simulation = swinging_pair({
        'connector.stiffness_compression': 0.0, 'solver.method': method,
        'solver.tolerance': tolerance}, -0.02)
    speed = np.zeros((2, 3))
    axis = np.diff(simulation.snapshot().position, axis=0)[0]
    speed[1] = 0.01 * axis / np.linalg.norm(axis)
    simulation.set_state(linear_velocity=speed)
    simulation.advance_to(0.1)
    end = simulation.snapshot()
    allowed = tolerance * scene.geometry.half_edge * simulation.status.largest_frequency
    assert np.abs(end.linear_velocity - speed[::-1]).max() < 0.1 * allowed < 1e-4 * 0.01
    assert np.abs(end.linear_velocity - speed).max() > 1e-3


@pytest.mark.parametrize('method', [
    pytest.param(name, marks=pytest.mark.long if name == 'dop8' else ())
    for name in ico.METHODS])
def test_energy_and_momenta_stay_on_a_kinked_fabric(method):
    # Kinks leave srkn8 steps of order 2, each of 16 evaluations: minutes at the default tolerance.
    tolerance = {'solver.tolerance': 1e-4} if method == 'srkn8' else {}
    scene = make_scene((4, 3, 3), {**KINKED, 'solver.method': method, **tolerance}, **RANDOM)
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.3)
    s, first = simulation.snapshot(), scene.initial
    kinetic = s.energy['kinetic']
    assert abs(s.energy['balance_error']) < 1e-4 * kinetic
    momentum = s.linear_velocity.sum(axis=0) - first.linear_velocity.sum(axis=0)
    assert np.abs(momentum).max() < 1e-11 * np.abs(s.linear_velocity).sum()
    if ico.METHODS[method].symplectic:
        # The impulses that mend kinks are equal and opposite along a connector.
        one, other = (
            scene.shell.mass * np.cross(m.position, m.linear_velocity)
            + scene.shell.inertia * m.angular_velocity for m in (s, first))
        assert np.abs((one - other).sum(axis=0)).max() < 1e-11 * np.abs(one).sum()
    # Connectors were on both sides of the kink.
    strain = s.connector_length / scene.connectors.natural_length - 1.0
    assert (strain > 0.02).any() and (strain < -0.02).any()


def test_frequency_counts_the_stiffer_side():
    # A step has to be stable on both sides, wherever the connectors are now.
    soft = make_scene((3, 3, 3))
    for extension, compression in ((500.0, 20.0), (20.0, 500.0), (500.0, 0.0)):
        scene = changed(soft, {
            'connector.stiffness_extension': extension,
            'connector.stiffness_compression': compression})
        rates = [
            largest_frequency(packed, packed.layout.pack(scene.initial)).rate
            for packed in (pack_scene(scene), pack_scene(soft))]
        assert rates[0] == pytest.approx(rates[1], rel=1e-6)


@pytest.mark.parametrize('method', [
    'leapfrog', 'srkn6', pytest.param('dop8', marks=pytest.mark.long)])
def test_one_law_written_in_two_ways_is_the_same_motion(method):
    fixed = {'solver.method': method, 'solver.step': 2e-4}
    plain = make_scene((4, 3, 3), fixed, **RANDOM)
    same = changed(plain, {
        'groups.half': 'row 0', 'connector_groups.g.between': 'half all',
        'connector_groups.g.stiffness': 500.0})
    ends = []
    for scene in (plain, same):
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.02)
        ends.append(simulation.snapshot())
    scale = np.abs(ends[0].position - plain.initial.position).max()
    assert np.abs(ends[1].position - ends[0].position).max() < 1e-11 * scale


def test_loads_on_a_kinked_fabric_with_a_chosen_method():
    # The method is known only after the loads are; a pair of stages needs room for their power.
    scene = make_scene(
        (2, 2, 2), {**KINKED, 'solver.tolerance': 1e-8, 'initial_random.velocity_sigma': 2.0},
        **LOADED, **RANDOM)
    simulation = ico.compile_scene(scene)
    assert simulation.status.method_name == 'dop8'
    simulation.advance_to(0.02)
    simulation.apply_wrench(next(iter(scene.loads)), (0.5, 0.0, 0.1))
    simulation.advance_to(0.05)
    s = simulation.snapshot()
    assert abs(s.energy['work_in']) > 1e-6
    assert abs(s.energy['balance_error']) < 1e-5 * s.energy['kinetic']


def test_groups_take_their_connectors():
    scene = make_scene((3, 4, 3), **GROUPS)
    laws, connectors = scene.connectors.laws, scene.connectors
    low = np.isin(connectors.bodies, scene.groups['low'])
    assert np.array_equal(laws.extension == 50.0, low.sum(axis=1) == 1)
    assert np.array_equal(laws.natural_length == 0.03, low.sum(axis=1) == 0)
    assert np.array_equal(laws.extension, laws.compression)
    counts = [int((low.sum(axis=1) == n).sum()) for n in range(3)]
    assert min(counts) > 0 and sum(counts) == scene.connector_count
    # The taut part pulls itself together: pre-stress by group.
    simulation = ico.compile_scene(changed(scene, {'contact.mode': 'never'}))
    simulation.advance_to(0.01)
    assert simulation.snapshot().energy['kinetic'] > 0.0


@pytest.mark.parametrize('method', ['leapfrog', 'srkn4'])
def test_threads_and_pieces_give_the_same_bits(monkeypatch, method):
    from icofabric_sim.simulation.stepping import thread_team
    scene = make_scene((5, 4, 3), {
        **KINKED, 'solver.method': method,
        'solver.tolerance': 1e-8 if method == 'srkn4' else 1e-5}, **RANDOM)
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1)
    ends = []
    for threads, pieces in ((1, 1), (2, 1), (3, 7)):
        monkeypatch.setattr(thread_team, 'core_count', lambda threads=threads: threads)
        simulation = ico.compile_scene(scene)
        for piece in range(pieces):
            simulation.advance_to(0.005 * (piece + 1) / pieces)
            if piece == 3:
                # Nothing is kept from step to step but what a checkpoint holds.
                checkpoint = simulation.checkpoint()
                simulation = ico.compile_scene(scene)
                simulation.advance_to(0.001)
                simulation.restore(checkpoint)
        ends.append(simulation.snapshot())
    assert simulation.status.step_count > 50
    assert same_state(ends[0], ends[1]) and same_state(ends[0], ends[2])


@pytest.mark.parametrize('rest, other', [
    (0.95, 'connector.stiffness_compression'), (1.05, 'connector.stiffness_extension')])
def test_fabrics_far_from_their_kinks_take_the_steps_of_plain_springs(rest, other):
    # Held all around under pre-stress: the other stiffness never acts, and no bit shows it. In
    # pieces, whose first steps know nothing of how far the connectors are from their kinks, too.
    scene = make_scene((5, 5, 5), {
        'contact.mode': 'never', 'solver.method': 'srkn4', 'solver.step': 2e-5})
    length = scene.geometry.connector_length
    held = {f'groups.{side}': side for side in (
        'x_min', 'x_max', 'y_min', 'y_max', 'z_min', 'z_max')}
    held |= {f'supports.{side}.group': side for side in list(held.values())}
    held |= {f'supports.{side}.fix': 'all' for side in (
        'x_min', 'x_max', 'y_min', 'y_max', 'z_min', 'z_max')}
    plain = changed(scene, {
        **held, 'connector.natural_length': rest * length,
        'initial_random.velocity_sigma': 1e-3, 'initial_random.spin_sigma': 0.1})
    kinked = changed(plain, {other: 0.2 * plain.parameters['connector.stiffness']})
    ends = []
    for one, pieces in ((plain, 1), (kinked, 1), (kinked, 20)):
        simulation = ico.compile_scene(one)
        for _ in range(pieces):
            simulation.advance_steps(200 // pieces)
        ends.append(simulation.snapshot())
    assert np.abs(ends[0].position - plain.position).max() > 1e-6
    # The last steps looked for no crossing.
    assert simulation._driver.trajectory.work.kinks.margin[0] > 0.0
    assert same_state(ends[0], ends[1]) and same_state(ends[0], ends[2])


@pytest.mark.parametrize('changes, words', [
    ({'connector_groups.g.between': 'low'}, ['connector_groups.g.between', 'two groups']),
    ({'connector_groups.g.between': 'low nowhere'}, ["'nowhere'", 'low', 'groups.nowhere']),
    ({'connector_groups.g.between': 'low far'}, ['no connector leads']),
    ({'connector_groups.g.between': 'low low', 'connector_groups.g.natural_length': -1.0},
     ['natural_length', 'at least 0']),
])
def test_groups_that_make_no_sense_are_refused(changes, words):
    with pytest.raises(ParameterError) as caught:
        make_scene((3, 3, 5), {'groups.low': 'z_min', 'groups.far': 'z_max', **changes})
    for word in words:
        assert word in str(caught.value)


def orders(method, steps, changes=None, *, exact=None, **sections):
    """
    Measured orders of `method` on a kinked fabric, from errors at its fixed steps.

    Errors beside a run with the changes `exact`, by itself of dop8.
    """
    scene = make_scene(
        (3, 2, 2), {**KINKED, **(changes or {}), 'solver.method': method}, **RANDOM, **sections)
    exact = ico.compile_scene(changed(scene, exact or {
        'solver.method': 'dop8', 'solver.tolerance': 1e-10}))
    duration = 0.02
    exact.advance_to(duration)
    target = exact.snapshot().position
    errors = []
    for step in steps:
        simulation = ico.compile_scene(changed(scene, {'solver.step': step}))
        simulation.advance_to(duration)
        errors.append(np.abs(simulation.snapshot().position - target).max())
    return np.diff(np.log(errors)) / np.diff(np.log(steps)), errors


def test_methods_that_mend_kinks_keep_their_order():
    # Every crossing of the kink leaves an error of order 3 in its step: plain methods come down
    # to between 2 and 3 in the mean over many crossings.
    steps = 8e-4 * 0.5 ** np.arange(4)
    found = {name: orders(name, steps) for name in ('leapfrog', 'srkn4', 'srkn6')}
    for name, (slopes, errors) in found.items():
        print(name, slopes, errors)
    assert np.mean(found['leapfrog'][0]) == pytest.approx(2.0, abs=0.4)
    for name in ('srkn4', 'srkn6'):
        slopes, errors = found[name]
        assert np.mean(slopes) > 3.9
        assert errors[-1] < 1e-4 * found['leapfrog'][1][-1]


@pytest.mark.long
def test_kinks_are_mended_whatever_else_acts():
    # Loads and a drive are in the accelerations that crossings are foretold from; driven bodies
    # and held ones take no impulse. Judged by the method itself, with which dop8 agrees without
    # these: a kind of scene less to compile.
    steps = 1.6e-3 * 0.5 ** np.arange(5)
    slopes, errors = orders('srkn4', steps, exact={'solver.step': 1e-5}, changes={
        'gravity': [0.0, 0.0, -9.81], 'connector.bending_stiffness': 1e-3,
        'groups.tip': 'z_max', 'groups.foot': 'z_min and x_min', 'groups.rest': 'ids 1',
        'supports.s.group': 'rest', 'supports.s.fix': 'tx rotation',
        'loads.pull.group': 'tip', 'loads.pull.force': [0.2, 0.0, 0.3], 'loads.pull.point': [
            0.0, 0.004, 0.0],
        'drives.shake.group': 'foot', 'drives.shake.motion': 'sine', 'drives.shake.linear': [
            1e-3, 0.0, 0.0], 'drives.shake.frequency': 30.0})
    print(slopes, errors)
    assert np.mean(slopes) > 3.3 and errors[-1] < 1e-7 * 0.01


def test_connectors_that_never_cross_follow_one_law():
    # Woven taut: the other stiffness must not be felt.
    taut = {'connector.natural_length': 0.018, 'solver.method': 'srkn4', 'solver.step': 2e-4}
    scene = make_scene((3, 2, 2), {**KINKED, **taut, 'initial_random.velocity_sigma': 0.05,
                                   'initial_random.spin_sigma': 2.0}, **RANDOM)
    ends = []
    for one in (scene, changed(scene, {'connector.stiffness_compression': 800.0})):
        simulation = ico.compile_scene(one)
        simulation.advance_to(0.001)
        ends.append(simulation.snapshot())
    assert (ends[0].connector_length > 0.019).all()
    scale = np.abs(ends[0].position - scene.initial.position).max()
    assert np.abs(ends[1].position - ends[0].position).max() < 1e-12 * scale


@pytest.mark.parametrize('tolerance, kinks', [(1e-3, 1), (1e-6, 36), (1e-10, 5000)])
def test_auto_takes_a_method_that_mends_kinks(tolerance, kinks):
    choice = choose_method(tolerance, 5.0, kinks=kinks)
    assert choice.name == 'srkn4' and 'pull otherwise than they push' in choice.reason
    assert choose_method(tolerance, 5.0, kinks=kinks, strain=0.1).name == 'dop8'
    # With a given step too, where one of higher order would be taken for smooth springs.
    assert choose_method(1e-6, 5.0, kinks=kinks, fixed_ratio=1.4).name == 'srkn4'
    assert choose_method(1e-6, 5.0, fixed_ratio=1.4).name == 'srkn6'


@pytest.mark.parametrize('tolerance', [1e-4, 1e-7, 1e-9])
def test_chosen_steps_keep_the_tolerance_on_a_kinked_fabric(tolerance):
    scene = make_scene((3, 2, 2), {**KINKED, 'solver.tolerance': tolerance}, **RANDOM)
    simulation = ico.compile_scene(scene)
    exact = ico.compile_scene(changed(scene, {
        'solver.method': 'dop8', 'solver.tolerance': 3e-11}))
    for one in (simulation, exact):
        one.advance_to(0.05)
    error = np.abs(simulation.snapshot().position - exact.snapshot().position).max()
    status = simulation.status
    print(status.method_name, error / scene.geometry.half_edge, status.error_rate)
    # Growth of small differences is below 100 in so short a run.
    assert error / scene.geometry.half_edge < 100.0 * tolerance


@pytest.mark.parametrize('method, limit', [('auto', 1e-2), ('srkn6', 1e-3), ('srkn8', 1e-2)])
def test_chosen_steps_of_small_kinked_motion_drift_less_than_the_limit(method, limit):
    # The tolerance asks for nothing here: with the longest steps of the methods a run stops.
    scene = make_scene((3, 2, 2), {
        **KINKED, 'solver.method': method, 'solver.tolerance': 1.0, 'solver.energy_limit': limit,
        'initial_random.velocity_sigma': 1e-5, 'initial_random.spin_sigma': 1e-3})
    ends = []
    for pieces in (1, 5):
        simulation = ico.compile_scene(scene)
        rate, seen = simulation.status.largest_frequency, []
        for start, end in ((0.0, 1e2), (1e2, 5e3), (5e3, 2e4)):
            for piece in range(1, pieces + 1):
                simulation.advance_to((start + (end - start) * piece / pieces) / rate)
                simulation.snapshot()
            status = simulation.status
            seen.append((status.step * status.largest_frequency, simulation.balance.worst))
        ends.append(simulation.snapshot())
    (initial, _), (first, _), (last, worst) = seen
    # The energy drifts, and steps become shorter than at the start. Those of `srkn8` vary by a
    # tenth between measurements, so the last need not be the shortest.
    assert 1e-3 * limit < worst < 0.4 * limit, seen
    assert max(first, last) < initial <= METHODS[status.method_name].chosen, seen
    assert last < first or method == 'srkn8', seen
    assert same_state(*ends)
