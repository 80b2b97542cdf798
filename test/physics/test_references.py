# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Simulation against two independent integrations of eqs 45-49."""

import math

from analytical import amplification
from fabrics import BOTH_FORMS, changed, FORMS, LOADED, make_scene, RANDOM, SUPPORTED
import icofabric_sim as ico
from icofabric_sim.geometry.rotations import cosines_from_quaternions, quaternions_from_cosines
import numpy as np
import pytest
from references import axes_of, integrate_cosines, integrate_quaternions

SCENES = {
    'free': make_scene((2, 2, 2), **RANDOM),
    'gravity and supports': make_scene((3, 2, 2), **RANDOM, **SUPPORTED),
    'loads': make_scene((2, 2, 2), **RANDOM, **LOADED),
    'pre-stressed, variant 3, bias': make_scene(
        (2, 2, 2),
        {
            'weave.kind': 'bias',
            'weave.variant': 3,
            'weave.boundary': 'fabric',
            'weave.azimuth': 0.4,
            'connector.natural_length': 0.028,
        },
        **RANDOM,
    ),
    'loads without connectors': make_scene(
        (2, 2, 2), {'weave.connected': False}, **RANDOM, **LOADED
    ),
}
# Some two periods of the fastest motion.
DURATION = 0.02
# At most so many times a small error grows in it.
GROWTH = 10.0


@pytest.fixture(scope='module')
def reference():
    cache = {}

    def get(name):
        if name not in cache:
            cache[name] = integrate_quaternions(SCENES[name], DURATION)
        return cache[name]

    return get


def distances(scene, one, other):
    """
    Largest differences in position over a, axes, velocities and spins.

    Times are in units of the duration.
    """
    a = scene.geometry.half_edge
    scales = (a, 1.0, a / DURATION, 1.0 / DURATION)
    return np.array([np.abs(p - q).max() / scale for p, q, scale in zip(one, other, scales)])


def simulated(scene, step, form, method='leapfrog'):
    choice = {'solver.step': step, 'solver.method': method}
    simulation = ico.compile_scene(changed(scene, choice), rotation=form)
    simulation.advance_to(DURATION)
    s = simulation.snapshot()
    return s.position, axes_of(s.orientation), s.linear_velocity, s.angular_velocity


@pytest.mark.parametrize('name', SCENES)
def test_both_references_agree(name, reference):
    scene = SCENES[name]
    start = scene.initial
    begin = (
        start.position,
        axes_of(start.orientation),
        start.linear_velocity,
        start.angular_velocity,
    )
    moved = distances(scene, reference(name), begin)
    assert (moved > [0.1, 0.3, 0.1, 0.1]).all()
    # Each is good to 1e-12 for each unit of its growth; the motion amplifies it a little.
    assert (distances(scene, reference(name), integrate_cosines(scene, DURATION)) < 1e-10).all()


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('name', SCENES)
def test_simulation_converges_to_the_reference_at_its_order(name, form, reference):
    scene = SCENES[name]
    order = ico.METHODS['leapfrog'].order
    # From a hundred steps for each period of the fastest motion on; all divide the duration.
    counts = 200 * 2 ** np.arange(4)
    errors = np.array(
        [
            distances(scene, simulated(scene, DURATION / count, form), reference(name))
            for count in counts
        ]
    )
    slopes = np.polyfit(np.log(DURATION / counts), np.log(errors), 1)[0]
    assert slopes == pytest.approx(order, abs=0.01)
    # What would be left at step zero, by Richardson's rule, is a small part of the last error.
    assert (errors[-1] < 1e-4).all()
    assert (np.abs(errors[-2] - 4.0 * errors[-1]) < 0.01 * errors[-1]).all()


# Steps in the duration: from about a third of the stability limit down, all above rounding.
COUNTS = {'srkn4': (20, 28, 40, 56), 'srkn6': (14, 20, 28), 'srkn8': (14, 17, 20),
          'dop8': (24, 28, 34, 40), 'tsit5': (192, 224, 256, 320)}


def test_every_method_is_tested_for_its_order():
    assert {'leapfrog', *COUNTS} == set(ico.METHODS)


@pytest.mark.parametrize('name', ico.METHODS)
def test_stated_limit_is_where_an_oscillator_begins_to_grow(name):
    method = ico.METHODS[name]
    below = [amplification(method, p) for p in np.linspace(1e-3, 1.0, 4000) * method.stability]
    # Two equal eigenvalues of the limit itself are found to the root of the rounding only.
    assert max(below) < 1.0 + 1e-7
    # Stated to three digits, rounded down.
    beyond = max(amplification(method, p) for p in np.linspace(1.0, 1.02, 400) * method.stability)
    # At its limit, tsit5 begins to amplify by 1 + c (step x frequency)^6 with a small c.
    assert beyond > 1.0 + (1e-8 if name == 'tsit5' else 1e-4)
    assert method.chosen < method.stability


@pytest.mark.parametrize('form', BOTH_FORMS)
@pytest.mark.parametrize('method', COUNTS)
@pytest.mark.parametrize('name', SCENES)
def test_splittings_of_higher_order_keep_it(name, method, form, reference):
    scene, counts = SCENES[name], np.array(COUNTS[method])
    errors = np.array(
        [
            distances(scene, simulated(scene, DURATION / count, form, method), reference(name))
            for count in counts
        ]
    )
    assert (errors[-1] < 1e-4).all() and (errors > 0.0).all()
    for error in errors.T:
        # What is at the level of the reference says nothing about the order.
        above = error > 1e-10
        if above.sum() < 2:
            assert error.max() < 1e-8
            continue
        slope = np.polyfit(np.log(DURATION / counts[above]), np.log(error[above]), 1)[0]
        assert slope == pytest.approx(ico.METHODS[method].order, abs=0.35)


@pytest.mark.parametrize('name', SCENES)
def test_at_equal_work_a_higher_order_is_more_accurate(name, reference):
    scene = SCENES[name]
    errors = {
        method: distances(
            scene,
            simulated(scene, DURATION / round(240 / facts.stages), 'quaternion', method),
            reference(name),
        ).max()
        for method, facts in ico.METHODS.items()
    }
    assert errors['srkn6'] < 0.2 * errors['srkn4'] < 0.02 * errors['leapfrog']
    assert errors['srkn8'] < 0.01 * errors['leapfrog']


def test_chosen_step_is_as_accurate_as_asked(reference):
    scene = SCENES['free']
    simulation = ico.compile_scene(scene)
    simulation.advance_to(DURATION)
    s = simulation.snapshot()
    error = distances(
        scene,
        (s.position, axes_of(s.orientation), s.linear_velocity, s.angular_velocity),
        reference('free'),
    )
    # 1e-6 for each second that passes; positions and axes count.
    assert 1e-11 < error[:2].max() < 1e-6 * DURATION * GROWTH


def test_references_reject_a_wrong_connector():
    # The references are sharp enough: a stiffness wrong by 1e-6 shows.
    scene = SCENES['free']
    wrong = changed(scene, {'connector.stiffness': 500.0005})
    difference = distances(
        scene, integrate_quaternions(scene, DURATION), integrate_quaternions(wrong, DURATION)
    )
    assert difference.max() > 1e-8


def test_rotation_forms_convert_both_ways():
    generator = np.random.default_rng(5)
    quaternion = generator.standard_normal((2000, 4))
    # Half turns and turns about axes, where one or more components vanish.
    special = [
        q for q in np.array(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 4)).reshape(4, -1).T if q.any()
    ]
    quaternion = np.vstack([quaternion, special])
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    cosines = cosines_from_quaternions(quaternion)
    np.testing.assert_allclose(cosines, axes_of(quaternion), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(cosines), 1.0, atol=1e-14)
    back = quaternions_from_cosines(cosines)
    assert (back[:, 3] >= 0.0).all()
    sign = np.where((back * quaternion).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    np.testing.assert_allclose(sign * back, quaternion, atol=1e-15)
    assert math.isclose(np.abs(sign * back).max(), 1.0)
