# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The largest frequency, its bound, and the steps that follow from it."""

from dataclasses import replace
import re

from analytical import quaternion_product, rotation_quaternion
from fabrics import changed, make_scene, packed_state, RANDOM
import icofabric_sim as ico
from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.flows import keep_accelerations, place_all
from icofabric_sim.kernels.frequency_bound import frequency_bound
from icofabric_sim.kernels.tridiagonal import largest_eigenvalue
from icofabric_sim.simulation.model import stability
from icofabric_sim.simulation.model.packing import pack_loads, pack_scene
from icofabric_sim.simulation.model.stability import hessian_product, largest_frequency
from icofabric_sim.simulation.stepping.methods import METHODS
from icofabric_sim.simulation.stepping.thread_team import ThreadTeam
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


# Near the limit a method is stable but no longer accurate: the energy of the fastest motions is
# off by much, the leapfrog's by (omega h)^2 / 4. That must not stop a run which is about safety.
ANY_BALANCE = {'solver.energy_limit': 1e3}


def pulled(size, force, method='auto', step=0.0, **changes):
    return make_scene(
        size,
        {
            'loads.left.force': [-force, 0.0, 0.0],
            'solver.step': step,
            'solver.method': method,
            'loads.right.force': [force, 0.0, 0.0],
            **changes,
        },
        **PULL,
    )


def random_configuration(generator, scene, amplitude):
    """Positions stretched and scattered, orientations turned, by up to the `amplitude`."""
    stretch = np.exp(amplitude * generator.uniform(-1.0, 1.0, 3))
    noise = (
        0.5 * amplitude * scene.geometry.pitch * generator.standard_normal((scene.body_count, 3))
    )
    turn = amplitude * generator.standard_normal((scene.body_count, 3))
    return (
        scene.position * stretch + noise,
        quaternion_product(rotation_quaternion(turn), scene.orientation),
    )


def top_frequency(scene, position, orientation, *, locate=False):
    """What `largest_frequency` says of a configuration."""
    packed = pack_scene(scene)
    return largest_frequency(packed, packed_state(packed, position, orientation), locate=locate)


def assembled(scene, position, orientation):
    """Dense M^-1/2 H M^-1/2, free freedoms only, column by column from `hessian_product`."""
    packed, count = pack_scene(scene), scene.body_count
    state = packed_state(packed, position, orientation)
    columns = []
    for unit in np.eye(6 * count).reshape(6 * count, 2, count, 3):
        force, torque = hessian_product(packed, state, *unit)
        columns.append(np.concatenate([force.ravel(), torque.ravel()]))
    roots = np.sqrt([packed.model.inverse_mass, packed.model.inverse_inertia])
    scale = np.repeat(roots, 3 * count)
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
        frequency = top_frequency(scene, position, orientation, locate=True)
        exact = exact_rate(scene, position, orientation)
        assert frequency.rate == pytest.approx(exact, rel=2e-4)
        assert 1 <= len(frequency.bodies) <= 4
    # Rotations take part: it is well above the frequency of one body on one connector.
    assert frequency.rate > 2.0 * np.sqrt(scene.connectors.stiffness / scene.shell.mass)


def test_large_fabrics_get_a_frequency_that_is_never_too_low(monkeypatch):
    # Large fabrics accept less accuracy, on the safe side. Small fabrics allow an exact check.
    monkeypatch.setattr(
        stability, '_SETTINGS', replace(stability.FrequencySettings(), small_body_count=0))
    generator = np.random.default_rng(13)
    for size in SIZES:
        scene = make_scene(size)
        for amplitude in (0.0, 0.1, 1.0):
            position, orientation = random_configuration(generator, scene, amplitude)
            rate = top_frequency(scene, position, orientation).rate
            ratio = rate / exact_rate(scene, position, orientation)
            assert 1.0 - 1e-3 < ratio < 1.016


@pytest.mark.parametrize('fix', ['all', 'tx ty', 'rotation', 'tz rotation'])
def test_largest_frequency_respects_supports(fix):
    free = make_scene((3, 3, 3))
    scene = changed(
        free, {'groups.some': 'z_max or ids 0', 'supports.s.group': 'some', 'supports.s.fix': fix}
    )
    position, orientation = random_configuration(np.random.default_rng(2), scene, 0.3)
    rate = top_frequency(scene, position, orientation).rate
    assert rate == pytest.approx(exact_rate(scene, position, orientation), rel=2e-4)
    # Holding something never makes the fastest motion faster, and here it makes it slower.
    assert rate < exact_rate(free, position, orientation)


def test_nothing_moves_when_all_is_held_or_slack():
    scene = make_scene((2, 2, 2), {'supports.s.group': 'all'})
    assert top_frequency(scene, scene.position, scene.orientation).rate == 0.0
    scene = make_scene((2, 2, 2), {'connector.stiffness': 0.0})
    assert top_frequency(scene, scene.position, scene.orientation).rate == 0.0
    scene = make_scene((2, 2, 2), {'weave.connected': False})
    assert top_frequency(scene, scene.position, scene.orientation).rate == 0.0


def test_located_bodies_are_where_the_fastest_motion_is():
    # One body pushed close to its neighbours and turned: its connectors are the tightest.
    scene = make_scene((5, 2, 2))
    position, orientation = scene.position.copy(), scene.orientation.copy()
    orientation[4] = quaternion_product(rotation_quaternion([0.0, 1.2, 0.0]), orientation[4])
    position[4] += [0.0, 0.0, 0.8 * scene.geometry.pitch]
    matrix = assembled(scene, position, orientation)
    shape = np.linalg.eigh(matrix)[1][:, -1].reshape(2, -1, 3)
    share = (shape**2).sum(axis=(0, 2))
    bodies = top_frequency(scene, position, orientation, locate=True).bodies
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
        # Held freedoms and the form of orientations do not matter to it.
        packed = pack_scene(scene, cosines=trial % 2 == 1)
        work = packed.layout.room(packed.model.links)
        state = packed_state(packed, position, orientation)
        place_all(packed.model, state, work, 0, len(packed.model.blocks.slot))
        bound = frequency_bound(packed.model, state, work)
        ratios[amplitude].append(np.sqrt(bound) / exact_rate(scene, position, orientation))
    for amplitude, values in ratios.items():
        print(f'amplitude {amplitude}: bound / frequency {min(values):.3f} to {max(values):.3f}')
        assert min(values) >= 1.0
        assert max(values) < 4.0
    assert max(ratios[0.0]) < 1.3


def test_frequency_grows_as_a_slab_is_pulled():
    scene = make_scene((5, 5, 5))

    def rate(*factors):
        return top_frequency(scene, scene.position * np.array(factors), scene.orientation).rate

    rest = rate(1.0, 1.0, 1.0)
    figures = {
        factors: rate(*factors) / rest
        for factors in ((2.0, 1.0, 1.0), (2.0, 2.0, 1.0), (2.0, 2.0, 2.0))
    }
    print(f'at rest {rest:.2f} rad/s; pulled {figures}')
    assert figures[2.0, 1.0, 1.0] == pytest.approx(1.257, abs=0.005)
    assert figures[2.0, 2.0, 1.0] == pytest.approx(1.451, abs=0.005)
    assert figures[2.0, 2.0, 2.0] == pytest.approx(1.619, abs=0.005)


def raw_run(scene, step, count, method='leapfrog'):
    """Largest speed [m/s] after `count` steps of the kernel, which asks nothing about the step."""
    packed = pack_scene(scene)
    model, layout = packed.model, packed.layout
    state = layout.pack(scene.initial)
    work = layout.room(model.links, None if METHODS[method].symplectic else state)
    place_all(model, state, work, 0, len(model.blocks.slot))
    keep_accelerations(model, state, work, 0.0, 0, len(model.blocks.slot))
    loads = pack_loads((), layout, stages=0 if METHODS[method].symplectic else 16)
    METHODS[method].advance(
        model, loads, state, layout.like(state), work, ThreadTeam(1, packed).team(0), 0.0,
        0, step, count, 0, count + 1, None, np.zeros(monitor.LEDGER_COUNT))
    return np.abs(state.linear_velocity).max()


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('size, variant', [((2, 2, 1), 0), ((3, 3, 3), 1), ((5, 5, 5), 0)])
def test_method_is_stable_up_to_its_limit(size, variant, method):
    scene = make_scene(size, {'weave.variant': variant, 'initial_random.velocity_sigma': 1e-7})
    rate = top_frequency(scene, scene.position, scene.orientation).rate
    limit = METHODS[method].stability / rate
    start = np.abs(scene.initial.linear_velocity).max()
    # The leapfrog's amplitudes grow to 1 / sqrt(1 - 0.98^2) = 5 times at most, and stay there.
    end = raw_run(scene, 0.98 * limit, 10_000, method)
    assert end < 20.0 * start
    # Only what is not symplectic may lose the fastest motions.
    assert end > (0.1 * start if METHODS[method].symplectic else 0.0)


@pytest.mark.parametrize('size, variant', [((2, 2, 1), 0), ((3, 3, 3), 1), ((5, 5, 5), 0)])
def test_leapfrog_is_unstable_beyond_the_limit(size, variant):
    scene = make_scene(size, {'weave.variant': variant, 'initial_random.velocity_sigma': 1e-7})
    limit = 2.0 / top_frequency(scene, scene.position, scene.orientation).rate
    start = np.abs(scene.initial.linear_velocity).max()
    # cosh(g) = (omega h)^2 / 2 - 1 with omega h = 2.04: g = 0.4 for each step.
    assert raw_run(scene, 1.02 * limit, 20) > 3.0 * start
    assert raw_run(scene, 1.02 * limit, 30) > 20.0 * raw_run(scene, 1.02 * limit, 20)


@pytest.mark.parametrize('method', METHODS)
def test_step_beyond_the_limit_is_refused_with_the_limit(method):
    scene = make_scene((3, 3, 3), {'solver.method': method})
    limit = METHODS[method].stability / exact_rate(scene, scene.position, scene.orientation)
    with pytest.raises(
        ValueError, match='solver.step 0.02 s is beyond the stability limit'
    ) as caught:
        ico.compile_scene(changed(scene, {'solver.step': 0.02}))
    assert f'{limit:.4g}'[:5] in str(caught.value)
    named = float(re.search(r'limit ([0-9.e-]+) s', str(caught.value)).group(1))
    assert named == pytest.approx(limit, rel=2e-4)
    with pytest.raises(ValueError, match='stability limit'):
        ico.compile_scene(changed(scene, {'solver.step': 1.001 * limit}))
    simulation = ico.compile_scene(changed(scene, {'solver.step': 0.999 * limit}))
    assert simulation.status.step == 0.999 * limit
    assert simulation.status.stability_limit == pytest.approx(limit, rel=2e-4)


def test_a_step_that_no_method_can_take_is_refused_also_where_the_method_is_free():
    scene = make_scene((3, 3, 3), {'solver.step': 0.02})
    with pytest.raises(ValueError, match='solver.step 0.02 s is beyond the stability limit'):
        ico.compile_scene(scene)
    # One that some method can take makes it the choice.
    rate = exact_rate(scene, scene.position, scene.orientation)
    simulation = ico.compile_scene(changed(scene, {'solver.step': 3.0 / rate}))
    assert METHODS[simulation.status.method_name].stability > 3.0
    assert 'solver.step' in simulation.status.method_reason


@pytest.mark.parametrize('share, force, method', [
    (0.8, 100.0, 'leapfrog'), (0.95, 20.0, 'leapfrog'), (0.95, 20.0, 'srkn4'),
    (0.9, 50.0, 'srkn6'), (0.95, 20.0, 'srkn8')])
def test_fixed_step_that_becomes_unsafe_stops_the_run(share, force, method):
    limit = ico.compile_scene(pulled((5, 3, 3), 0.0, method)).status.stability_limit
    scene = pulled((5, 3, 3), force, method, share * limit, **ANY_BALANCE)
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
    exact = METHODS[method].stability / exact_rate(scene, s.position, s.orientation)
    assert new_limit == pytest.approx(exact, rel=3e-4)
    assert 0.85 * scene.parameters['solver.step'] < new_limit < scene.parameters['solver.step']
    assert set(bodies) <= set(range(scene.body_count)) and bodies
    with pytest.raises(ico.SimulationError, match='has become unsafe'):
        simulation.advance_to(1.0)
    # A reset is a new start.
    simulation.reset()
    assert np.array_equal(simulation.snapshot().position, scene.initial.position)
    simulation.advance_to(time + 4 * simulation.status.step)
    assert np.ptp(simulation.snapshot().position[:, 0]) > length


@pytest.mark.parametrize('seed, method, share', [
    (0, 'leapfrog', 0.8), (1, 'srkn4', 0.9), (2, 'leapfrog', 0.8), (3, 'srkn6', 0.9)])
def test_no_look_of_a_fixed_step_passes_over_an_unsafe_configuration(seed, method, share):
    # Tumbling, stretching fabrics: wherever the run goes on, the exact limit is above the step.
    rest = make_scene(
        (3, 3, 3),
        {
            'contact.mode': 'never',
            'initial_random.seed': seed,
            'initial_random.velocity_sigma': 2.0,
            'initial_random.spin_sigma': 100.0,
            'solver.method': method,
            **ANY_BALANCE,
        },
    )
    simulation = ico.compile_scene(
        changed(rest, {'solver.step': share * ico.compile_scene(rest).status.stability_limit})
    )
    part, worst = simulation.status.step / METHODS[method].stability, 0.0
    monitor = simulation._event_loop.driver.monitor
    with pytest.raises(ico.SimulationError, match='has become unsafe'):
        for _ in range(2_000):
            simulation.advance_steps(monitor.interval - monitor.since_check)
            s = simulation.snapshot()
            worst = max(worst, exact_rate(rest, s.position, s.orientation) * part)
    assert 0.85 < worst < 1.0 + 2e-4
    assert simulation.status.step_count >= 10
    s = simulation.snapshot()
    assert exact_rate(rest, s.position, s.orientation) * part > 1.0 - 2e-4


def test_chosen_step_shrinks_as_the_fabric_is_pulled_and_energy_stays_sane():
    # With a tolerance that is never the reason.
    scene = pulled((5, 3, 3), 400.0, 'leapfrog', **{'solver.tolerance': 1e3})
    simulation = ico.compile_scene(scene)
    start, first = simulation.snapshot(), simulation.status.step
    shortest, largest = first, 0.0
    for count in range(1, 101):
        simulation.advance_to(0.001 * count)
        shortest = min(shortest, simulation.status.step)
        s = simulation.snapshot()
        largest = max(
            largest,
            exact_rate(scene, s.position, s.orientation) * simulation.status.step
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
    assert simulation.status.stability_limit > 4.0 * simulation.status.step


def test_step_follows_a_spin_and_a_calm():
    scene = make_scene((2, 2, 2), {'contact.mode': 'never'})
    simulation = ico.compile_scene(scene)
    calm = simulation.status.step
    simulation.set_state(angular_velocity=np.full((4, 3), 2000.0))
    fast = simulation.status.step
    assert fast < 0.3 * calm
    simulation.set_state(angular_velocity=np.zeros((4, 3)))
    assert simulation.status.step == pytest.approx(calm, rel=0.3)


def test_random_fabric_has_the_limit_of_its_state():
    simulation = ico.compile_scene(make_scene((3, 3, 3), **RANDOM))
    before = simulation.status.largest_frequency
    simulation.advance_to(0.05)
    s = simulation.snapshot()
    simulation.set_state(position=s.position)  # a jump computes the frequency again
    exact = exact_rate(simulation.scene, s.position, s.orientation)
    assert simulation.status.largest_frequency == pytest.approx(exact, rel=2e-4)
    assert simulation.status.largest_frequency != before


@pytest.mark.parametrize('seed', range(40))
def test_largest_eigenvalue_of_tridiagonal_matrices(seed):
    """Beside LAPACK's; also where many eigenvalues are equal, or couplings are tiny."""
    generator = np.random.default_rng(seed)
    size, scale = int(generator.integers(1, 120)), 10.0 ** generator.uniform(-9.0, 15.0)
    diagonal = scale * generator.uniform(0.0, 2.0, size)
    if seed % 4 == 0:
        diagonal[:] = scale
    off = scale * generator.uniform(1e-13 if seed % 3 == 0 else 0.1, 1.0, size - 1)
    vector = np.empty(size)
    value = largest_eigenvalue(diagonal, off, vector)
    expected = scipy.linalg.eigh_tridiagonal(
        diagonal, off, eigvals_only=True, select='i', select_range=(size - 1, size - 1))
    assert value == pytest.approx(expected[0], rel=2e-15)
    matrix = np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1)
    np.testing.assert_allclose(matrix @ vector, value * vector, atol=4e-15 * scale)
    assert np.linalg.norm(vector) == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize('size', [1, 2, 7])
@pytest.mark.parametrize('scale', [0.0, 1e-200, 1e200])
def test_largest_eigenvalue_of_extreme_matrices(size, scale):
    vector = np.empty(size)
    value = largest_eigenvalue(np.zeros(size), np.full(size - 1, scale), vector)
    # Of a chain: 2 cos(pi / (n + 1)).
    expected = 2.0 * np.cos(np.pi / (size + 1)) * scale
    assert value == pytest.approx(expected, rel=1e-14, abs=1e-15 * scale)
    assert np.linalg.norm(vector) == pytest.approx(1.0, rel=1e-14)
