# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Work of loads, the balance of all energies, and the stop where it fails."""

import math
import re

from analytical import amplification, free_rotation, rotation_quaternion
from fabrics import changed, FORMS, LOADED, make_scene, packed_state, RANDOM, SUPPORTED
import icofabric_sim as ico
from icofabric_sim.kernels.loads import NONE, work_row
from icofabric_sim.parameters.example_scenes import example_scenes
from icofabric_sim.simulation.model.packing import pack_loads, pack_scene, WrenchRow
from icofabric_sim.simulation.stepping.methods import METHODS
from icofabric_sim.terms.profiles import ONES
import numpy as np
import pytest
from references import axes_of

# Gauss-Legendre on (0, 1): exact for polynomials up to degree 79.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)
NODES, WEIGHTS = 0.5 * (NODES + 1.0), 0.5 * WEIGHTS
SINGLE = make_scene((1, 1, 1))


def work_of_drift(form, in_body_axes, spin, velocity, h, seed=0):
    """Work of one wrench off centre over a drift: of the kernel, by quadrature, and its size."""
    generator = np.random.default_rng(seed)
    force, torque, point = generator.standard_normal((3, 3)) * [[2.0], [0.02], [0.01]]
    packed = pack_scene(SINGLE, cosines=form == 'direction_cosines')
    orientation = rotation_quaternion(generator.standard_normal((1, 3)))
    state = packed_state(
        packed, generator.standard_normal((1, 3)), orientation, velocity[None], spin[None])
    loads = pack_loads(
        [WrenchRow(np.zeros(1, np.int32), in_body_axes, force, torque, point)], packed.layout)
    work_row(loads, state, 0, int(packed.layout.blocks.slot[0]), 0.0, h, NONE, ONES)
    powers = []
    for x in NODES:
        axes = axes_of(free_rotation(orientation, spin[None], x * h))[0]
        f, n = (force @ axes, torque @ axes) if in_body_axes else (force, torque)
        powers.append(f @ (velocity + np.cross(spin, point @ axes)) + n @ spin)
    size = h * (np.linalg.norm(force) * (
        np.linalg.norm(velocity) + np.linalg.norm(point) * np.linalg.norm(spin))
        + np.linalg.norm(torque) * np.linalg.norm(spin))
    return float(loads.work[0].sum()), h * float(WEIGHTS @ powers), size


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('in_body_axes', [False, True])
@pytest.mark.parametrize('angle', [0.0, 1e-9, 1e-3, 0.0999, 0.1001, 1.0, 10.0, 30.0])
def test_work_of_a_drift_is_the_integral_of_the_power(angle, in_body_axes, form):
    for seed in range(5):
        generator = np.random.default_rng(100 + seed)
        h = float(10.0 ** generator.uniform(-6, 0))
        direction = generator.standard_normal(3)
        spin = angle / h * direction / np.linalg.norm(direction)
        velocity = generator.standard_normal(3) / h
        got, expected, size = work_of_drift(form, in_body_axes, spin, velocity, h, seed)
        # A turn by many radians leaves little of a large power; the angle's own rounding counts.
        assert abs(got - expected) < (1e-14 + 1e-15 * angle) * size
        assert abs(expected) > 1e-4 * size


def work_so_far(simulation):
    """Work [J] up to the last step, also since the last look."""
    trajectory = simulation._driver.trajectory
    return float(trajectory.ledger.earlier_work) + math.fsum(trajectory.loads.work)


SPLITTINGS = [name for name, method in METHODS.items() if method.symplectic]


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('method', SPLITTINGS)
def test_constant_force_does_force_times_way(method, form):
    scene = make_scene((3, 2, 2), {
        'groups.tip': 'x_max', 'loads.tip.group': 'tip', 'loads.tip.force': [3.0, -1.0, 2.0],
        'loads.tip.share': 'total', 'solver.method': method, 'contact.mode': 'never'}, **RANDOM)
    simulation = ico.compile_scene(scene, rotation=form)
    load = scene.loads['tip']
    start, total, last = simulation.snapshot(), 0.0, simulation.snapshot().position
    for number in range(4):
        simulation.advance_steps(100)
        position = simulation.snapshot().position
        way = (position - last)[load.bodies].sum(axis=0) / len(load.bodies)
        total, last = total + float(simulation.status.active_loads['tip'].force @ way), position
        # Sums of ways that partly cancel: beside the work done by then.
        done = work_so_far(simulation)
        assert done == pytest.approx(total, rel=1e-11, abs=1e-13)
        simulation.apply_wrench('tip', (3.0 * (-1.0) ** number, 0.0, 1.0 + number))
    end = simulation.snapshot()
    assert abs(done) > 1e-4
    # And it is the energy gained, to what the method keeps.
    assert end.energy['total'] - start.energy['total'] == pytest.approx(done, rel=1e-6)


def test_loads_on_what_is_held_do_no_work():
    scene = make_scene((3, 2, 2), {
        'loads.l.group': 'top', 'loads.l.force': [3.0, 1.0, 2.0], 'loads.l.torque': [0, 0.1, 0],
        'loads.l.frame': 'body', 'loads.l.point': [0.01, 0.0, 0.002]}, **SUPPORTED, **RANDOM)
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.02)
    assert work_so_far(simulation) == 0.0 == simulation.balance.work
    assert 0.0 < simulation.balance.worst < 1e-4


FABRICS = {
    'free': make_scene((2, 2, 2), **RANDOM),
    'supported': make_scene((3, 2, 2), **RANDOM, **SUPPORTED),
    'loaded': make_scene((2, 2, 2), **RANDOM, **LOADED),
    'spinning': make_scene((2, 2, 2), {
        'initial_random.spin_sigma': 300.0, 'initial_random.velocity_sigma': 0.2}, **LOADED),
}
# Steps times frequency of the coarsest of four runs, each with 5/7 of the step before.
COARSEST = {'leapfrog': 0.2, 'srkn4': 0.9, 'srkn6': 1.2, 'srkn8': 1.2, 'dop8': 0.9,
            'tsit5': 0.1}


@pytest.mark.parametrize('method, form', [
    # By dop8 direction cosines have kernels of their own.
    pytest.param(name, form, marks=(
        pytest.mark.long if method.adaptive and form == FORMS[1] else ()))
    for name, method in METHODS.items() for form in FORMS])
@pytest.mark.parametrize('name', FABRICS)
def test_balance_converges_at_the_order_of_the_method(name, method, form):
    scene = changed(FABRICS[name], {'solver.method': method, 'solver.energy_limit': 10.0})
    longest = COARSEST[method] / ico.compile_scene(scene).status.largest_frequency
    if name == 'spinning':
        longest *= 0.5
    duration, errors, steps = 0.02, [], []
    for number in range(4):
        count = math.ceil(duration / longest * 1.4**number)
        simulation = ico.compile_scene(
            changed(scene, {'solver.step': duration / count}), rotation=form)
        start, samples = simulation.snapshot().energy['total'], []
        # At many moments: the error of a symplectic method comes and goes.
        for part in range(1, 9):
            simulation.advance_steps(max(count * part // 8 - simulation.status.step_count, 1))
            work = work_so_far(simulation) if scene.loads else 0.0
            samples.append(abs(simulation.snapshot().energy['total'] - start - work))
        errors.append(max(samples) / simulation.balance.scale)
        steps.append(simulation.status.step)
    errors, steps = np.array(errors), np.array(steps)
    above = errors > 3e-13
    if above.sum() < 2:
        assert errors[-1] < 1e-12
        return
    slope = np.polyfit(np.log(steps[above]), np.log(errors[above]), 1)[0]
    print(f'{name} {method} {form}: {slope:.2f}, {errors}')
    order = METHODS[method].order
    assert slope > order - 0.6 and errors[-1] < errors[0] * 1.4 ** (-1.8 * order)


@pytest.mark.parametrize('path', [
    pytest.param(path, id=name, marks=(
        () if name in ('dropped_slab', 'hanging_slab') else pytest.mark.long))
    for name, path in example_scenes().items()])
def test_balance_of_example_scenes_holds_by_far(path):
    # At their own tolerance: test/scene/test_example_scenes.py.
    simulation = ico.compile_scene(changed(ico.load_scene(path), {'solver.tolerance': 1e-3}))
    simulation.advance_to(0.6)
    balance = simulation.balance
    print(balance)
    # The worst is where next to nothing moves yet.
    assert 0.0 < balance.worst < balance.limit
    assert balance.scale > 0.0 and balance.limit == 0.01


def failed(simulation):
    """Advance to failure; returns its message after checks of what every failure promises."""
    with pytest.raises(ico.SimulationError, match='does not balance|no longer finite') as caught:
        simulation.advance_steps(1000)
    text = str(caught.value)
    body = int(re.search(r'body (\d+)', text).group(1))
    connector = int(re.search(r'connector (\d+)', text).group(1))
    time = float(re.search(r'at t = ([0-9.e+-]+) s', text).group(1))
    saved = float(re.search(r'good state, of t = ([0-9.e+-]+) s', text).group(1))
    scene = simulation.scene
    assert 0 <= body < scene.body_count
    assert body in scene.connectors.bodies[connector]
    assert simulation.status.step_count <= 1000
    s = simulation.snapshot()
    assert simulation.time == s.time == pytest.approx(saved, rel=1e-8, abs=1e-12)
    assert saved < time <= 1001 * simulation.status.step
    assert all(np.isfinite(getattr(s, name)).all() for name in (
        'position', 'orientation', 'linear_velocity', 'angular_velocity'))
    # It stays where it is until it is given another state.
    with pytest.raises(ico.SimulationError):
        simulation.advance_to(simulation.time + 1.0)
    assert simulation.snapshot().time == s.time
    return text


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('growth', [1.1, 1.5, 10.0])
def test_unstable_runs_stop_within_a_thousand_steps(growth, method, form, monkeypatch):
    scene = make_scene((4, 4, 4), {
        'solver.method': method, 'contact.mode': 'never', 'initial_random.velocity_sigma': 0.01})
    # The shortest step with which the fastest motion grows so much in each: just beyond their
    # limits, splittings of high order are unstable in a narrow band only.
    product = next(p for p in np.arange(METHODS[method].stability, 20.0, 1e-3)
                   if amplification(METHODS[method], p) > growth)
    step = product / ico.compile_scene(scene).status.largest_frequency
    # A method that is taken to be stable everywhere.
    monkeypatch.setitem(METHODS, method, METHODS[method]._replace(stability=1e3))
    simulation = ico.compile_scene(changed(scene, {'solver.step': step}), rotation=form)
    start = simulation.snapshot().energy
    text = failed(simulation)
    assert f'steps are {simulation.status.step:.6g} s' in text or 'finite' in text
    # The state that is kept is one of before: its energy still balances.
    kept = simulation.snapshot().energy
    assert abs(kept['total'] - start['total']) <= 0.0101 * simulation.balance.scale
    simulation.reset()
    assert np.array_equal(simulation.snapshot().position, scene.initial.position)
    simulation.advance_steps(1)
    assert np.isfinite(simulation.snapshot().position).all()


def test_a_rough_step_just_below_the_limit_is_stopped_by_the_balance():
    # Stable, but the leapfrog's energy is off by (omega h)^2 / 4 in the fastest motions.
    scene = make_scene((4, 4, 4), {'solver.method': 'leapfrog', 'contact.mode': 'never'}, **RANDOM)
    limit = ico.compile_scene(scene).status.stability_limit
    rough = changed(scene, {'solver.step': 0.999 * limit})
    text = failed(ico.compile_scene(rough))
    assert 'is above solver.energy_limit 0.01' in text
    # A larger limit allows it.
    simulation = ico.compile_scene(changed(rough, {'solver.energy_limit': 100.0}))
    try:
        simulation.advance_steps(100)
    except ico.SimulationError as error:
        assert 'unsafe' in str(error)
    assert simulation.status.step_count >= 8


def test_first_number_that_is_not_finite_stops_the_run():
    scene = make_scene((2, 2, 2), {'groups.tip': 'ids 2', 'loads.tip.group': 'tip',
                                   'solver.step': 1e-4, 'solver.energy_limit': 1e300})
    simulation = ico.compile_scene(scene)
    simulation.advance_steps(3)
    simulation.apply_wrench('tip', (1e300, 0.0, 0.0))
    assert 'finite' in failed(simulation)


def test_limit_is_a_parameter_and_energy_that_rounding_makes_is_none():
    assert ico.compile_scene(make_scene(changes={'solver.energy_limit': 0.2})).balance.limit == 0.2
    for changes in ({}, {'weave.variant': 2, 'weave.connector_angle': 0.3},
                    {'bodies.far.position': [1e3, 2e3, -3e3]},
                    {'gravity': [0.0, 0.0, -9.81], 'supports.s.group': 'all'}):
        # At rest, and held under its weight: nothing moves, so nothing can be out of balance.
        simulation = ico.compile_scene(make_scene((3, 3, 3), changes))
        simulation.advance_to(1.0)
        assert np.abs(
            simulation.snapshot().position - simulation.scene.position).max() < 1e-11


def test_small_motion_may_lose_what_the_tolerance_lets_it_lose():
    """Velocities of 1,000 tolerances fade under `dop8`, within the tolerance: no run stops."""
    scene = make_scene(
        (2, 2, 2), solver={'method': 'dop8', 'tolerance': 1e-4},
        initial_random={'velocity_sigma': 1e-3, 'spin_sigma': 0.1, 'seed': 3})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.5)
    balance = simulation.balance
    # It has lost more than solver.energy_limit of what moves, and says so.
    assert balance.worst > 0.01 and simulation.error_estimate < 1e-4 * simulation.time
    kept = simulation.checkpoint()
    simulation.advance_to(0.6)
    again = ico.compile_scene(scene)
    again.restore(kept)
    again.advance_to(0.6)
    assert again.balance == simulation.balance
    # What such errors do not explain stops it all the same.
    simulation._driver.trajectory.ledger.base += 10.0 * simulation.balance.scale
    with pytest.raises(ico.SimulationError, match='does not balance'):
        simulation.advance_to(0.7)


def test_livelier_motion_is_held_to_the_energy_limit():
    """However long it runs: errors within the tolerance are no part of it that counts."""
    simulation = ico.compile_scene(make_scene(
        (2, 2, 2), solver={'method': 'dop8', 'tolerance': 1e-4},
        initial_random={'velocity_sigma': 0.5, 'spin_sigma': 50.0, 'seed': 3}))
    simulation.advance_to(0.01)
    simulation._driver.trajectory.ledger.base += 0.02 * simulation.balance.scale
    with pytest.raises(ico.SimulationError, match='does not balance'):
        simulation.advance_to(0.05)


def test_energies_of_a_kept_state_are_those_of_its_time():
    """Where a run stops it goes back: what was spent and done since then is taken back too."""
    scene = make_scene(
        (2, 2, 2), solver={'method': 'dop8'}, connector={'damping': 0.05}, drag={'linear': 0.01},
        groups={'some': 'x_max'}, loads={'push': {'group': 'some', 'force': [0.5, 0.2, -0.3]}},
        **RANDOM)
    simulation, honest = ico.compile_scene(scene), ico.compile_scene(scene)
    simulation.advance_to(0.01)
    simulation._driver.trajectory.ledger.base += 10.0 * simulation.balance.scale
    before = simulation.snapshot().energy
    with pytest.raises(ico.SimulationError, match='does not balance'):
        simulation.advance_to(0.05)
    kept = simulation.snapshot()
    honest.advance_to(kept.time)
    wanted = honest.snapshot().energy
    for name in ('dissipated', 'work_in', 'kinetic'):
        assert kept.energy[name] == pytest.approx(wanted[name], rel=1e-9)
        assert wanted[name] != 0.0
    assert abs(kept.time - 0.01) < 0.005 and before['dissipated'] > 0.0
