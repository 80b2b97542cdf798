# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The largest frequency, its bound, and the steps that follow from it.
"""

import re

from analytical import quaternion_product, rotation_quaternion
from fabrics import changed, make_scene, RANDOM
import icofabric_sim as ico
from icofabric_sim import stability
from icofabric_sim.integrators.methods import METHODS
from icofabric_sim.kernels.hessian import hessian_product
from icofabric_sim.kernels.monitor import frequency_bound
from icofabric_sim.kernels.records import State, Work
from icofabric_sim.kernels.rotations import fill_arms
from icofabric_sim.kernels.wrenches import compute_wrenches
from icofabric_sim.model import pack_model
from icofabric_sim.stability import largest_frequency
import numpy as np
import pytest
import scipy.linalg

SIZES = ((2, 2, 2), (3, 2, 2), (3, 3, 3), (4, 3, 2))
# A taut pull on both ends of a slab, shared out among their bodies.
PULL = {
    'groups': {'left': 'x_min', 'right': 'x_max'},
    'contact': {'mode': 'never'},
    'loads': {
        'left': {'group': 'left', 'share': 'total'},
        'right': {'group': 'right', 'share': 'total'},
    },
}


def pulled(size, force, step=0.0):
    return make_scene(
        size,
        {
            'loads.left.force': [-force, 0.0, 0.0],
            'solver.step': step,
            'loads.right.force': [force, 0.0, 0.0],
        },
        **PULL,
    )


def random_configuration(generator, scene, amplitude):
    """
    Positions stretched and scattered, orientations turned, by up to the `amplitude`.
    """
    stretch = np.exp(amplitude * generator.uniform(-1.0, 1.0, 3))
    noise = (
        0.5 * amplitude * scene.geometry.pitch * generator.standard_normal((scene.body_count, 3))
    )
    turn = amplitude * generator.standard_normal((scene.body_count, 3))
    return (
        scene.position * stretch + noise,
        quaternion_product(rotation_quaternion(turn), scene.orientation),
    )


def packed_arms(model, orientation):
    arms = np.empty((len(orientation), 3, 3))
    fill_arms(orientation, model.connectors.half_width, arms)
    return arms


def assembled(scene, position, orientation):
    """
    Dense M^-1/2 H M^-1/2, free freedoms only, column by column from `hessian_product`.
    """
    model, count = pack_model(scene), scene.body_count
    arms = packed_arms(model, orientation)
    force, torque = np.empty((count, 3)), np.empty((count, 3))
    columns = []
    for unit in np.eye(6 * count).reshape(6 * count, 2, count, 3):
        hessian_product(model.connectors, position, arms, unit[0], unit[1], force, torque)
        columns.append(np.concatenate([force.ravel(), torque.ravel()]))
    scale = np.repeat(np.sqrt([model.inverse_mass, model.inverse_inertia]), 3 * count)
    matrix = scale[:, None] * np.array(columns).T * scale
    if scene.supports is None:
        return matrix
    held = np.concatenate(
        [scene.supports.translation.ravel(), np.repeat(scene.supports.rotation, 3)]
    )
    return matrix[np.ix_(~held, ~held)]


def exact_rate(scene, position, orientation):
    matrix = assembled(scene, position, orientation)
    top = len(matrix) - 1
    return np.sqrt(scipy.linalg.eigh(matrix, eigvals_only=True, subset_by_index=[top, top])[0])


@pytest.mark.parametrize('variant', range(4))
@pytest.mark.parametrize('size', SIZES)
def test_largest_frequency_is_that_of_the_dense_matrix(size, variant):
    generator = np.random.default_rng(variant)
    scene = make_scene(size, {'weave.variant': variant})
    for amplitude in (0.0, 0.1, 1.0):
        position, orientation = random_configuration(generator, scene, amplitude)
        frequency = largest_frequency(pack_model(scene), position, orientation, locate=True)
        exact = exact_rate(scene, position, orientation)
        assert frequency.rate == pytest.approx(exact, rel=2e-4)
        assert 1 <= len(frequency.bodies) <= 4
    # Rotations take part: it is well above the frequency of one body on one connector.
    assert frequency.rate > 2.0 * np.sqrt(scene.connectors.stiffness / scene.shell.mass)


def test_large_fabrics_get_a_frequency_that_is_never_too_low(monkeypatch):
    # They settle for less accuracy, on the safe side. Tried here on fabrics that can be checked.
    monkeypatch.setattr(stability, '_SMALL', 0)
    generator = np.random.default_rng(13)
    for size in SIZES:
        scene = make_scene(size)
        for amplitude in (0.0, 0.1, 1.0):
            position, orientation = random_configuration(generator, scene, amplitude)
            rate = largest_frequency(pack_model(scene), position, orientation).rate
            ratio = rate / exact_rate(scene, position, orientation)
            assert 1.0 - 1e-3 < ratio < 1.016


@pytest.mark.parametrize('fix', ['all', 'tx ty', 'rotation', 'tz rotation'])
def test_largest_frequency_respects_supports(fix):
    free = make_scene((3, 3, 3))
    scene = changed(
        free, {'groups.some': 'z_max or ids 0', 'supports.s.group': 'some', 'supports.s.fix': fix}
    )
    position, orientation = random_configuration(np.random.default_rng(2), scene, 0.3)
    rate = largest_frequency(pack_model(scene), position, orientation).rate
    assert rate == pytest.approx(exact_rate(scene, position, orientation), rel=2e-4)
    # Holding something never makes the fastest motion faster, and here it makes it slower.
    assert rate < exact_rate(free, position, orientation)


def test_nothing_moves_when_all_is_held_or_slack():
    scene = make_scene((2, 2, 2), {'supports.s.group': 'all'})
    assert largest_frequency(pack_model(scene), scene.position, scene.orientation).rate == 0.0
    scene = make_scene((2, 2, 2), {'connector.stiffness': 0.0})
    assert largest_frequency(pack_model(scene), scene.position, scene.orientation).rate == 0.0
    scene = make_scene((2, 2, 2), {'weave.connected': False})
    assert largest_frequency(pack_model(scene), scene.position, scene.orientation).rate == 0.0


def test_located_bodies_are_where_the_fastest_motion_is():
    # One body pushed close to its neighbours and turned: its connectors are the tightest.
    scene = make_scene((5, 2, 2))
    position, orientation = scene.position.copy(), scene.orientation.copy()
    orientation[4] = quaternion_product(rotation_quaternion([0.0, 1.2, 0.0]), orientation[4])
    position[4] += [0.0, 0.0, 0.8 * scene.geometry.pitch]
    matrix = assembled(scene, position, orientation)
    shape = np.linalg.eigh(matrix)[1][:, -1].reshape(2, -1, 3)
    share = (shape**2).sum(axis=(0, 2))
    bodies = largest_frequency(pack_model(scene), position, orientation, locate=True).bodies
    assert bodies[0] == np.argmax(share)
    assert share[list(bodies)].sum() > 0.7


def test_bound_is_above_the_frequency_in_200_random_configurations():
    generator = np.random.default_rng(11)
    ratios = {0.0: [], 0.1: [], 0.5: [], 1.0: [], 2.0: []}
    for trial in range(200):
        scene = make_scene(
            SIZES[trial % 4],
            {
                'weave.variant': trial // 4 % 4,
                'weave.connector_angle': float(generator.uniform(-0.3, 0.7)),
            },
        )
        amplitude = list(ratios)[trial % 5]
        position, orientation = random_configuration(generator, scene, amplitude)
        model = pack_model(scene)
        bound, body = frequency_bound(
            model.connectors,
            model.adjacency,
            model.inverse_mass,
            model.inverse_inertia,
            position,
            packed_arms(model, orientation),
        )
        assert 0 <= body < scene.body_count
        ratios[amplitude].append(np.sqrt(bound) / exact_rate(scene, position, orientation))
    for amplitude, values in ratios.items():
        print(f'amplitude {amplitude}: bound / frequency {min(values):.3f} to {max(values):.3f}')
        assert min(values) >= 1.0
        assert max(values) < 4.0
    assert max(ratios[0.0]) < 1.3


def test_frequency_grows_as_a_slab_is_pulled():
    scene = make_scene((5, 5, 5))
    model = pack_model(scene)

    def rate(*factors):
        return largest_frequency(model, scene.position * np.array(factors), scene.orientation).rate

    rest = rate(1.0, 1.0, 1.0)
    figures = {
        factors: rate(*factors) / rest
        for factors in ((2.0, 1.0, 1.0), (2.0, 2.0, 1.0), (2.0, 2.0, 2.0))
    }
    print(f'at rest {rest:.2f} rad/s; pulled {figures}')
    assert figures[2.0, 1.0, 1.0] == pytest.approx(1.257, abs=0.005)
    assert figures[2.0, 2.0, 1.0] == pytest.approx(1.451, abs=0.005)
    assert figures[2.0, 2.0, 2.0] == pytest.approx(1.619, abs=0.005)


def leapfrog_run(scene, step, count):
    """
    Largest speed [m/s] after `count` steps of the kernel, which asks nothing about the step.
    """
    model = pack_model(scene)
    state = State(*(array.copy() for array in scene.initial))
    work = Work(
        np.zeros((scene.body_count, 3)),
        np.zeros((scene.body_count, 3)),
        np.zeros((scene.body_count, 3, 3)),
    )
    compute_wrenches(model, None, state, work)
    METHODS['leapfrog'].advance(
        model,
        None,
        state,
        work,
        step,
        count,
        0,
        count + 1,
        None,
        np.zeros(4),
        np.inf,
        0.0,
        0.0,
        np.inf,
    )
    return np.abs(state.linear_velocity).max()


@pytest.mark.parametrize('size, variant', [((2, 2, 1), 0), ((3, 3, 3), 1), ((5, 5, 5), 0)])
def test_leapfrog_is_stable_up_to_the_limit_and_not_beyond(size, variant):
    scene = make_scene(size, {'weave.variant': variant, 'initial_random.velocity_sigma': 1e-7})
    limit = (
        METHODS['leapfrog'].stability
        / largest_frequency(pack_model(scene), scene.position, scene.orientation).rate
    )
    start = np.abs(scene.initial.linear_velocity).max()
    # Amplitudes grow to 1 / sqrt(1 - 0.98^2) = 5 times at most, and stay there.
    assert 0.1 * start < leapfrog_run(scene, 0.98 * limit, 20_000) < 20.0 * start
    # cosh(g) = (omega h)^2 / 2 - 1 with omega h = 2.04: g = 0.4 for each step.
    assert leapfrog_run(scene, 1.02 * limit, 20) > 3.0 * start
    assert leapfrog_run(scene, 1.02 * limit, 30) > 20.0 * leapfrog_run(scene, 1.02 * limit, 20)


def test_step_beyond_the_limit_is_refused_with_the_limit():
    scene = make_scene((3, 3, 3))
    limit = 2.0 / exact_rate(scene, scene.position, scene.orientation)
    with pytest.raises(
        ValueError, match='solver.step 0.01 s is beyond the stability limit'
    ) as caught:
        ico.compile_scene(changed(scene, {'solver.step': 0.01}))
    assert f'{limit:.4g}'[:5] in str(caught.value)
    named = float(re.search(r'limit ([0-9.e-]+) s', str(caught.value)).group(1))
    assert named == pytest.approx(limit, rel=2e-4)
    with pytest.raises(ValueError, match='stability limit'):
        ico.compile_scene(changed(scene, {'solver.step': 1.001 * limit}))
    simulation = ico.compile_scene(changed(scene, {'solver.step': 0.999 * limit}))
    assert simulation.step == 0.999 * limit
    assert simulation.stability_limit == pytest.approx(limit, rel=2e-4)


@pytest.mark.parametrize('share, force', [(0.8, 100.0), (0.95, 20.0)])
def test_fixed_step_that_becomes_unsafe_stops_the_run(share, force):
    limit = ico.compile_scene(pulled((5, 3, 3), 0.0)).stability_limit
    scene = pulled((5, 3, 3), force, share * limit)
    simulation = ico.compile_scene(scene)
    length = np.ptp(simulation.snapshot().position[:, 0])
    with pytest.raises(ico.SimulationError, match='has become unsafe at t = ') as caught:
        simulation.advance_to(1.0)
    print(caught.value)
    text = str(caught.value)
    time = float(re.search(r't = ([0-9.e-]+) s', text).group(1))
    bodies = [
        int(word) for word in re.search(r'bodies ([0-9, ]+) move', text).group(1).split(', ')
    ]
    new_limit = float(re.search(r'limit is now ([0-9.e-]+) s', text).group(1))
    # It stops where it says, and the state there can still be looked at.
    s = simulation.snapshot()
    assert simulation.time == s.time == pytest.approx(time, rel=1e-8)
    assert 0.0 < time < 1.0
    assert np.ptp(s.position[:, 0]) > 1.05 * length
    # The limit is that of the configuration it stopped at, just below the step.
    assert new_limit == pytest.approx(2.0 / exact_rate(scene, s.position, s.orientation), rel=3e-4)
    assert 0.85 * scene.parameters['solver.step'] < new_limit < scene.parameters['solver.step']
    assert set(bodies) <= set(range(scene.body_count)) and bodies
    with pytest.raises(ico.SimulationError, match='has become unsafe'):
        simulation.advance_to(1.0)
    # A reset is a new start.
    simulation.reset()
    assert np.array_equal(simulation.snapshot().position, scene.initial.position)
    simulation.advance_to(time + 4 * simulation.step)
    assert np.ptp(simulation.snapshot().position[:, 0]) > length


@pytest.mark.parametrize('seed', range(4))
def test_no_look_of_a_fixed_step_passes_over_an_unsafe_configuration(seed):
    # Tumbling, stretching fabrics: wherever the run goes on, the exact limit is above the step.
    rest = make_scene(
        (3, 3, 3),
        {
            'contact.mode': 'never',
            'initial_random.seed': seed,
            'initial_random.velocity_sigma': 2.0,
            'initial_random.spin_sigma': 100.0,
        },
    )
    simulation = ico.compile_scene(
        changed(rest, {'solver.step': 0.8 * ico.compile_scene(rest).stability_limit})
    )
    worst = 0.0
    with pytest.raises(ico.SimulationError, match='has become unsafe'):
        while True:
            simulation.advance_steps(8)
            s = simulation.snapshot()
            worst = max(worst, exact_rate(rest, s.position, s.orientation) * simulation.step / 2.0)
    assert 0.85 < worst < 1.0 + 2e-4
    assert simulation.step_count > 200
    s = simulation.snapshot()
    assert exact_rate(rest, s.position, s.orientation) * simulation.step / 2.0 > 1.0 - 2e-4


def test_chosen_step_shrinks_as_the_fabric_is_pulled_and_energy_stays_sane():
    scene = pulled((5, 3, 3), 400.0)
    simulation = ico.compile_scene(scene)
    start, first = simulation.snapshot(), simulation.step
    shortest, largest = first, 0.0
    for count in range(1, 101):
        simulation.advance_to(0.001 * count)
        shortest = min(shortest, simulation.step)
        s = simulation.snapshot()
        largest = max(
            largest,
            exact_rate(scene, s.position, s.orientation) * simulation.step
            if count % 10 == 0
            else 0,
        )
    work = sum(
        ((s.position - start.position)[load.bodies] @ load.force).sum() / len(load.bodies)
        for load in scene.loads.values()
    )
    assert shortest < 0.75 * first
    assert 0.05 < largest < 0.5
    assert s.energy['total'] - start.energy['total'] == pytest.approx(work, rel=0.01)
    assert work > 1.0
    assert simulation.stability_limit > 4.0 * simulation.step


def test_step_follows_a_spin_and_a_calm():
    scene = make_scene((2, 2, 2), {'contact.mode': 'never'})
    simulation = ico.compile_scene(scene)
    calm = simulation.step
    simulation.set_state(angular_velocity=np.full((4, 3), 2000.0))
    fast = simulation.step
    assert fast < 0.3 * calm
    simulation.set_state(angular_velocity=np.zeros((4, 3)))
    assert simulation.step == pytest.approx(calm, rel=0.3)


def test_random_fabric_has_the_limit_of_its_state():
    simulation = ico.compile_scene(make_scene((3, 3, 3), **RANDOM))
    before = simulation.largest_frequency
    simulation.advance_to(0.05)
    s = simulation.snapshot()
    simulation.set_state(position=s.position)  # a jump reads the frequency anew
    exact = exact_rate(simulation.scene, s.position, s.orientation)
    assert simulation.largest_frequency == pytest.approx(exact, rel=2e-4)
    assert simulation.largest_frequency != before
