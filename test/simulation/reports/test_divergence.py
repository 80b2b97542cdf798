# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Growth of a small displacement: closed forms, a direct comparison, and what follows from it."""

import logging
import math

import icofabric_sim as ico
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.reports import divergence
from icofabric_sim.simulation.reports.divergence import (
    Companion,
    DISPLACEMENT,
    Growth,
    LARGEST_DISTANCE,
    MEANINGFUL,
    measure_growth,
    SENSITIVE,
)
import numpy as np
import pytest

# A slab that falls from the side at which it is held, and folds.
SWING = {
    'weave': {'size': [3, 3, 3], 'connector_angle': 0.3},
    'gravity': [0.0, 0.0, -9.81],
    'groups': {'wall': 'x_min', 'tip': 'x_max'},
    'supports': {'wall': {'group': 'wall'}},
    'loads': {'tip': {'group': 'tip', 'share': 'total'}},
    'contact': {'mode': 'never'},
}
LOOSE = {
    'weave': {'size': [2, 2, 2], 'connected': False},
    'contact': {'mode': 'never'},
    'initial_random': {'velocity_sigma': 0.3, 'spin_sigma': 5.0, 'seed': 4},
}


def make_scene(sections, **changes):
    scene = ico.Scene.from_parameters(sections)
    dotted = {name.replace('__', '.'): value for name, value in changes.items()}
    return ico.Scene.from_parameters(scene.parameters.with_changes(dotted))


def distance(one, two, half_edge):
    """
    Largest distance of centres over a, or angle [rad], computed another way than in growth.py.
    """
    shift = np.sqrt(((one.position - two.position) ** 2).sum(axis=1)).max() / half_edge
    product = np.abs((one.orientation * two.orientation).sum(axis=1))
    # The chord of quaternions: precise for small angles.
    chord = np.minimum(
        np.linalg.norm(one.orientation - two.orientation, axis=1),
        np.linalg.norm(one.orientation + two.orientation, axis=1))
    angle = np.where(product < 0.9, 2.0 * np.arccos(np.minimum(product, 1.0)),
                     4.0 * np.arcsin(0.5 * chord))
    return max(shift, angle.max())


def test_it_is_offered_by_the_package():
    assert ico.measure_growth is measure_growth and ico.Growth is Growth


def test_free_bodies_stay_as_far_apart_as_they_were():
    """No forces: displacements keep their length, whatever the velocities and spins."""
    growth = measure_growth(make_scene(LOOSE), 1.0)
    assert growth.time[0] == 0.0 and growth.time[-1] == 1.0 and len(growth.time) > 40
    np.testing.assert_allclose(growth.growth, 1.0, rtol=1e-6)
    assert not growth.is_sensitive and growth.meaningful_until == math.inf
    assert growth.ended == '' and not growth.at_least


def test_companion_starts_displaced_by_its_size_with_the_same_velocities():
    scene = make_scene(SWING, initial_random__velocity_sigma=0.01, initial_random__seed=2,
                       groups__rail='ids 5', supports__rail__group='rail',
                       supports__rail__fix='tx tz')
    simulation = ico.compile_scene(scene)
    companion = Companion(simulation)
    one, two = simulation.snapshot(), companion._displaced.snapshot()
    np.testing.assert_array_equal(one.linear_velocity, two.linear_velocity)
    np.testing.assert_array_equal(one.angular_velocity, two.angular_velocity)
    moved, turned = one.position != two.position, one.orientation != two.orientation
    supports = scene.supports
    assert not moved[supports.translation].any() and moved[~supports.translation].all()
    assert not turned[supports.rotation].any() and turned[~supports.rotation].any(axis=1).all()
    found = distance(one, two, scene.shell.half_edge)
    assert found == pytest.approx(DISPLACEMENT, rel=1e-6)
    assert companion.result().growth.tolist() == [1.0]


def test_growth_is_that_of_two_runs_side_by_side():
    """Before and after the companion has been brought back: nothing else changes but the scale."""
    # The same steps in all three, so that what they add cancels.
    scene = make_scene(SWING, solver__step=2e-4)
    simulation = ico.compile_scene(scene)
    companion = Companion(simulation)
    # A displacement that stays small all along, in the same direction.
    start, displaced = simulation.snapshot(), companion._displaced.snapshot()
    part, beside = 1e-3, ico.compile_scene(scene)
    turned = start.orientation + part * (displaced.orientation - start.orientation)
    beside.set_state(
        position=start.position + part * (displaced.position - start.position),
        orientation=turned / np.linalg.norm(turned, axis=1, keepdims=True))
    first = distance(start, beside.snapshot(), scene.shell.half_edge)
    compared = []
    for time in np.linspace(0.0, 0.6, 61)[1:]:
        for run in (simulation, beside):
            run.advance_to(time)
        companion.look()
        expected = distance(
            simulation.snapshot(), beside.snapshot(), scene.shell.half_edge) / first
        compared.append((companion.result().growth[-1], expected))
    found, expected = np.array(compared).T
    np.testing.assert_allclose(found, expected, rtol=0.1)
    # It was brought back at least once.
    assert found.max() * DISPLACEMENT > 3.0 * LARGEST_DISTANCE
    assert companion.result().largest == found.max()


def test_run_is_not_changed_by_its_companion():
    alone, watched = (ico.compile_scene(make_scene(SWING)) for _ in range(2))
    companion = Companion(watched)
    for time in np.linspace(0.0, 0.2, 14)[1:]:
        watched.advance_to(time)
        companion.look()
    alone.advance_to(0.2)
    for name in ('position', 'orientation', 'linear_velocity', 'angular_velocity'):
        assert getattr(alone.snapshot(), name).tobytes() == (
            getattr(watched.snapshot(), name).tobytes())
    assert companion.result().largest > 2.0


def test_same_growth_every_time_and_for_every_accuracy():
    """It is of the motion, not of the method: 1e-3 is too coarse to see it, and is refined."""
    results = [measure_growth(make_scene(SWING, solver__tolerance=tolerance), 0.25).largest
               for tolerance in (1e-6, 1e-6, 1e-3, 1e-9)]
    assert results[0] == results[1] > 10.0
    np.testing.assert_allclose(results, results[0], rtol=0.2)
    given = measure_growth(make_scene(SWING, solver__step=2e-4), 0.25)
    assert given.largest == pytest.approx(results[0], rel=0.2)
    # The errors of a step that was given are measured at the end.
    assert given.error[0] == 0.0 < given.error[-1] and (np.diff(given.error) > 0.0).all()


def test_chaos_is_followed_far_beyond_the_size_of_the_fabric():
    scene = make_scene(SWING)
    growth = measure_growth(scene, 2.0)
    assert growth.largest > 1e10 and growth.is_sensitive and not growth.at_least
    assert 0.1 < growth.meaningful_until < 1.5
    # Up to then the errors are small, indeed smaller than what is said of them.
    coarse = ico.compile_scene(scene)
    fine = ico.compile_scene(make_scene(SWING, solver__tolerance=1e-10))
    for run in (coarse, fine):
        run.advance_to(growth.meaningful_until)
    found = distance(coarse.snapshot(), fine.snapshot(), scene.shell.half_edge)
    assert 0.0 < found < MEANINGFUL
    for run in (coarse, fine):
        run.advance_to(2.0)
    assert distance(coarse.snapshot(), fine.snapshot(), scene.shell.half_edge) > MEANINGFUL


def test_loads_act_on_the_companion_too():
    """A pulled run beside one that is not would part at once."""
    scene = make_scene(SWING, loads__tip__force=[0.0, 2.0, 0.0])
    pulled = ico.compile_scene(scene)
    pulled.advance_to(0.05)
    still = ico.compile_scene(make_scene(SWING))
    still.advance_to(0.05)
    apart = distance(pulled.snapshot(), still.snapshot(), scene.shell.half_edge)
    assert apart > 0.1
    assert measure_growth(scene, 0.05).largest * DISPLACEMENT < 1e-3 * apart


def test_companion_of_a_run_under_way_takes_its_wrenches_over():
    simulation = ico.compile_scene(make_scene(SWING))
    simulation.advance_to(0.03)
    simulation.apply_wrench('tip', (0.0, 2.0, 0.0))
    simulation.advance_to(0.05)
    companion = Companion(simulation)
    simulation.advance_to(0.07)
    companion.look()
    growth = companion.result()
    assert growth.time.tolist() == [0.05, 0.07]
    assert 0.1 < growth.growth[-1] < 30.0 and not growth.ended


def test_companion_that_fails_ends_the_measurement_only(monkeypatch):
    simulation = ico.compile_scene(make_scene(SWING))
    companion = Companion(simulation)
    simulation.advance_to(0.01)
    companion.look()

    def fail(time):
        raise SimulationError('it broke')

    monkeypatch.setattr(companion._displaced, 'advance_to', fail)
    for time in (0.02, 0.03):
        simulation.advance_to(time)
        companion.look()
    growth = companion.result()
    assert 'it broke' in growth.ended and growth.time.tolist() == [0.0, 0.01]
    # Nothing is known of what came later.
    assert growth.meaningful_until == 0.01


def test_warnings_of_the_companion_are_not_repeated(caplog):
    crash = {**LOOSE, 'contact': {'mode': 'auto', 'stiffness': 1e4},
             'initial_random': {'velocity_sigma': 0.0}, 'bodies': {
                 'a': {'position': [1.0, 0.0, 0.0], 'linear_velocity': [1.0, 0.0, 0.0]},
                 'b': {'position': [1.1, 0.0, 0.0]}}}
    with caplog.at_level(logging.WARNING, logger='icofabric_sim'):
        measure_growth(make_scene(crash), 0.2)
    assert sum('overlap by' in record.getMessage() for record in caplog.records) == 1


def test_long_histories_are_thinned_and_keep_their_largest(monkeypatch):
    monkeypatch.setattr(divergence, '_SETTINGS', divergence.GrowthSettings(max_history=16))
    simulation = ico.compile_scene(make_scene(SWING))
    companion = Companion(simulation)
    seen = []
    for time in np.linspace(0.0, 0.2, 101)[1:]:
        simulation.advance_to(time)
        companion.look()
        seen.append(companion._history[-1][1])
    growth = companion.result()
    assert len(growth.time) <= 17 and (np.diff(growth.time) > 0.0).all()
    assert growth.largest == max(seen) > 1.0 and growth.time[-1] == 0.2


def history(growth, error, *, at_least=False, ended=''):
    count = len(growth)
    return Growth(np.arange(count, dtype=float), np.array(growth), np.array(error), at_least,
                  ended)


def test_what_follows_from_a_growth():
    calm = history([1.0, 5.0, 3.0], [0.0, 1e-6, 2e-6])
    assert calm.largest == 5.0 and not calm.is_sensitive and calm.meaningful_until == math.inf
    assert calm.final_error(1e-6) == pytest.approx(1e-6 * 2.0 * 5.0)
    assert calm.final_error(0.0) == pytest.approx(2e-6 * 5.0)
    # A duration below a second counts as one.
    assert history([1.0], [0.0]).final_error(1e-6) == 1e-6
    wild = history([1.0, 1e3, 10.0, 1e7, 1e9], [0.0, 1e-6, 2e-6, 3e-6, 4e-6])
    assert wild.is_sensitive and wild.meaningful_until == 2.0
    # What had grown does not count as small again later.
    early = history([1.0, 1e9, 1.0], [0.0, 1e-6, 2e-6])
    assert early.meaningful_until == 0.0
    assert history([1.0, 1e9, math.inf], [0.0, 1e-12, 0.0]).meaningful_until == 1.0
    assert history([1.0, SENSITIVE], [0.0, 0.0]).is_sensitive
    assert history([1.0, 2.0], [0.0, 0.0], at_least=True).is_sensitive
    assert history([1.0, 2.0], [0.0, 0.0], ended='it broke').meaningful_until == 1.0


@pytest.mark.parametrize('duration', [0.0, -1.0, math.nan, math.inf])
def test_durations_are_checked(duration):
    with pytest.raises(ValueError, match='duration'):
        measure_growth(make_scene(LOOSE), duration)
