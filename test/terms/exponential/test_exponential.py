# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors with f = k/alpha (exp(alpha (l - D)) - 1), against closed forms and SciPy."""

from decimal import Decimal, localcontext

from analytical import quaternion_product, rotation_quaternion
from fabrics import make_scene, packed_state, snapshot_of, wrenches
import icofabric_sim as ico
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.frequency_bound import frequency_bound
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import LANES, load_at, store_at
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.model.stability import hessian_product, largest_frequency
from icofabric_sim.terms.exponential.curve import ExponentialCurve
from icofabric_sim.terms.exponential.law import growth
from icofabric_sim.terms.laws import replace_alone
import numpy as np
import pytest
from references import axes_of, integrate_quaternions, resultants

L, K, ALPHA = 0.032360679774997896, 400.0, 90.0
LAW = {
    'connector.law': 'exponential', 'connector.alpha': ALPHA, 'connector.stiffness': K,
    'contact.mode': 'never'}
# Strains of a twentieth and more, where the slope changes by a factor.
SWING = {**LAW, 'initial_random.velocity_sigma': 1.0, 'initial_random.spin_sigma': 20.0,
         'initial_random.seed': 3}
# Rounding errors in units of 2^-53.
ULPS = 16


@compiled
def fill(x, grown, rest):
    for i in range(0, x.shape[0], LANES):
        one, other = growth(load_at(x, i))
        store_at(grown, i, one)
        store_at(rest, i, other)


def test_growth_is_exact_to_rounding():
    small = 10.0 ** np.linspace(-12.0, 0.0, 64)
    x = np.concatenate([
        np.linspace(-0.36, 0.36, 64), np.linspace(-40.0, 40.0, 64), small, -small,
        np.linspace(-690.0, 690.0, 64)])
    grown, rest = np.empty_like(x), np.empty_like(x)
    fill(x, grown, rest)
    with localcontext() as context:
        context.prec = 60
        for value, *found in zip(x, grown, rest):
            exact = Decimal(float(value)).exp() - 1
            for one, wanted in zip(found, (exact, exact - Decimal(float(value)))):
                assert abs(Decimal(float(one)) / wanted - 1) < ULPS * Decimal(2.0**-53)
    # The law for NumPy, with k = alpha = 1 and D = 0.
    x = x[np.abs(x) < 50.0]
    tension, energy = ExponentialCurve(1.0).evaluate(x, 1.0, 0.0)
    fill(x, grown, rest)
    np.testing.assert_allclose(tension, grown[:len(x)], rtol=ULPS * 2.0**-53)
    np.testing.assert_allclose(energy, rest[:len(x)], rtol=ULPS * 2.0**-53)


@pytest.mark.parametrize(('method', 'allowed'), [
    ('dop8', 1e-8), ('srkn8', 1e-8), pytest.param('sdirk4', 1e-3, marks=pytest.mark.long)])
def test_fabric_moves_as_scipy_says(method, allowed):
    scene = make_scene((3, 3, 2), {
        **SWING, 'solver.method': method,
        'solver.tolerance': 1e-9 if method != 'sdirk4' else 1e-6})
    duration = 0.02
    wanted = integrate_quaternions(scene, duration)
    simulation = ico.compile_scene(scene)
    start = simulation.snapshot()
    simulation.advance_to(duration)
    found = simulation.snapshot()
    a = scene.geometry.half_edge
    assert np.abs(found.position - wanted.position).max() < allowed * a
    assert np.abs(axes_of(found.orientation) - wanted.axes).max() < allowed
    strain = found.connector_length / L - 1.0
    assert strain.max() > 0.05 and strain.min() < -0.05
    assert np.abs(found.position - start.position).max() > 0.2 * a
    moved = abs(found.energy['connectors'] - start.energy['connectors'])
    assert moved > 1e-3 and abs(found.energy['balance_error']) < 10.0 * allowed * moved


def test_energy_of_a_wild_swing_is_balanced():
    scene = make_scene((3, 3, 2), {
        **SWING, 'initial_random.velocity_sigma': 3.0, 'solver.method': 'dop8',
        'solver.tolerance': 1e-8})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.05)
    found = simulation.snapshot()
    slope = K * np.exp(ALPHA * (found.connector_length - L))
    assert slope.max() > 2.0 * K
    assert abs(found.energy['balance_error']) < 1e-7 * found.energy['total']


def disturbed(scene):
    generator = np.random.default_rng(4)
    shape = (scene.body_count, 3)
    shift = 0.12 * scene.geometry.cube_width * generator.standard_normal(shape)
    turn = rotation_quaternion(0.3 * generator.standard_normal(shape))
    return scene.position + shift, quaternion_product(turn, scene.orientation)


def test_tangent_energy_and_bound_belong_to_the_force():
    scene = make_scene((3, 3, 2), LAW)
    position, orientation = disturbed(scene)
    packed = pack_scene(scene)
    state = packed_state(packed, position, orientation)
    axes = axes_of(orientation)
    force, moment = resultants(scene, position, axes)
    work = wrenches(scene, position, orientation)
    np.testing.assert_allclose(work.force, force, rtol=0, atol=1e-12 * np.abs(force).max())
    np.testing.assert_allclose(work.torque, moment, rtol=0, atol=1e-12 * np.abs(moment).max())
    generator, h = np.random.default_rng(5), 1e-7
    shift = generator.standard_normal(position.shape)
    product, _ = hessian_product(packed, state, shift, np.zeros_like(shift))
    slope = (resultants(scene, position + h * shift, axes)[0]
             - resultants(scene, position - h * shift, axes)[0]) / (2.0 * h)
    np.testing.assert_allclose(-slope, product, rtol=0, atol=1e-6 * np.abs(product).max())
    length = snapshot_of(scene, position, orientation).connector_length
    x = ALPHA * (length - L)
    assert x.max() > 1.0 and x.min() < -0.5
    stored = snapshot_of(scene, position, orientation).energy['connectors']
    assert stored == pytest.approx((K / ALPHA**2 * (np.exp(x) - 1.0 - x)).sum(), rel=1e-12)
    room = packed.layout.room(packed.model.links)
    place_all(packed.model, state, room, 0, len(packed.model.blocks.slot))
    bound = frequency_bound(packed.model, state, room)
    rate = largest_frequency(packed, state).rate
    assert rate**2 <= bound < 4.0 * rate**2
    # Springs of stiffness k are slower by far.
    assert rate > 1.5 * largest_frequency(pack_scene(make_scene((3, 3, 2), {
        **LAW, 'connector.law': '', 'connector.alpha': 0.0})), state).rate


def test_equilibrium_under_gravity_balances_the_written_law():
    scene = make_scene((3, 3, 3), {
        **LAW, 'connector.stiffness': 60.0, 'gravity': [0.0, 0.0, -9.81], 'groups.top': 'z_max',
        'supports.top.group': 'top'})
    found = ico.solve_equilibrium(scene)
    assert found.converged
    force, moment = resultants(
        scene, found.snapshot.position, axes_of(found.snapshot.orientation))
    free = np.ones(scene.body_count, bool)
    free[scene.groups['top']] = False
    weight = 9.81 * scene.shell.mass
    assert np.abs(force[free]).max() < 1e-6 * weight
    assert np.abs(moment[free]).max() < 1e-6 * weight * scene.geometry.half_edge
    spring = ico.solve_equilibrium(scene.with_changes({
        'connector.law': '', 'connector.alpha': 0.0}))
    sag = [result.snapshot.position[:, 2].min() for result in (spring, found)]
    assert abs(sag[1] - sag[0]) > 1e-4


def test_one_connector_alone_and_groups():
    scene = make_scene((3, 3, 2), {
        **LAW, 'connector.law': '', 'connector.stiffness_compression': 150.0,
        'groups.low': 'z_min', 'connector_groups.g.between': 'low all',
        'connector_groups.g.law': 'exponential', 'connector_groups.g.alpha': -40.0,
        'connector_groups.g.stiffness': 300.0})
    packed = pack_scene(scene)
    curves, links = packed.curves, packed.model.links
    chosen = curves.of >= 0
    assert 0 < chosen.sum() < scene.connector_count and curves.curves == (ExponentialCurve(-40.0),)
    (link, s), *_ = np.argwhere(links.laws.exponential.alpha != 0.0)
    law = replace_alone(links.laws, links.variety, link, s, 1.3 * L, (1.0, 2.0, 3.0))
    wanted = 300.0 / -40.0 * np.expm1(-12.0 * L)
    assert law[0] == pytest.approx(wanted, rel=1e-13)
    assert law[1] == pytest.approx(
        300.0 / 1600.0 * (np.expm1(-12.0 * L) + 12.0 * L), rel=1e-11)
    assert law[2] == pytest.approx(300.0 * np.exp(-12.0 * L), rel=1e-13)
    (link, s), *_ = np.argwhere(
        (links.laws.exponential.alpha == 0.0) & (links.variety.extension > 0.0))
    assert replace_alone(links.laws, links.variety, link, s, 1.3 * L, (1.0, 2.0, 3.0)) == (
        1.0, 2.0, 3.0)


def test_connectors_with_kinks_beside_exponential_ones():
    """Methods that resolve kinks leave the smooth law alone."""
    changes = {
        **SWING, 'connector.law': '', 'connector.stiffness_compression': 150.0,
        'groups.low': 'z_min', 'connector_groups.g.between': 'low all',
        'connector_groups.g.law': 'exponential', 'connector_groups.g.alpha': 60.0}
    ends = []
    for solver in ({'method': 'srkn6', 'step': 2e-5}, {'method': 'dop8', 'tolerance': 1e-9}):
        simulation = ico.compile_scene(make_scene((3, 3, 2), {
            **changes, **{f'solver.{name}': value for name, value in solver.items()}}))
        simulation.advance_to(0.01)
        ends.append(simulation.snapshot())
    a = 0.01
    assert np.abs(ends[0].position - ends[1].position).max() < 1e-6 * a
    assert np.abs(ends[0].connector_length / L - 1.0).max() > 0.05


@pytest.mark.parametrize('solver', [
    {'method': 'leapfrog', 'step': 1e-4}, {'method': 'dop8', 'tolerance': 1e-6}])
def test_a_device_moves_as_the_processor_does(solver):
    pytest.importorskip('warp', reason='Warp (extra `gpu`) is not installed')
    ends = []
    for device in ('cpu', 'warp_cpu'):
        simulation = ico.compile_scene(make_scene((3, 3, 2), {
            **SWING, 'solver.device': device,
            **{f'solver.{name}': value for name, value in solver.items()}}))
        simulation.advance_to(0.01)
        ends.append(simulation.snapshot())
    one, other = ends
    assert np.abs(one.position - other.position).max() < 1e-11 * np.abs(one.position).max()
    assert np.abs(one.orientation - other.orientation).max() < 1e-11
    assert one.energy['connectors'] == pytest.approx(other.energy['connectors'], rel=1e-9)
    assert np.abs(one.connector_length / L - 1.0).max() > 0.05


@pytest.mark.parametrize(('changes', 'words'), [
    ({'connector.alpha': 0.0}, 'connector.law exponential: alpha is 0'),
    ({'connector.stiffness_extension': 3.0}, 'give connector.stiffness'),
    ({'connector.law': ''}, 'connector.alpha .* has no effect .* connector.law to exponential'),
    ({'groups.low': 'z_min', 'connector_groups.g.between': 'low all',
      'connector_groups.g.alpha': 5.0},
     'connector_groups.g.alpha 5.0 1/m has no effect')])
def test_what_contradicts_the_law_is_refused(changes, words):
    with pytest.raises(ParameterError, match=words):
        make_scene((2, 2, 2), {**LAW, **changes})
