# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Dipoles that act on each other and on charges (charge.mutual)."""

import math

from fabrics import make_scene, packed_state, wrenches
import icofabric_sim as ico
from icofabric_sim.kernels.frequency_bound import field_bound
from icofabric_sim.simulation.model.electric import COULOMB_CONSTANT
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.spectrum import scaled_hessian
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

DISTANCE = 0.1
ALONE = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
# One body has a charge and a dipole, one only a charge, one only a dipole.
CHARGE = np.array([1e-7, -2e-7, 0.0])
MOMENT = np.array([[1e-8, -2e-9, 4e-9], [0.0, 0.0, 0.0], [-3e-9, 2e-8, 1e-8]])
THREE = {
    'bodies.b.position': [0.1, 0.02, 0.0], 'bodies.c.position': [0.03, 0.09, -0.05],
    'charge.mutual': True, 'weave.connected': False, **{
        f'{family}.g{body}.{field}': value
        for body in range(3) for family, field, value in (
            ('charges', 'group', f'g{body}'),
            ('charges', 'charge', float(CHARGE[body])),
            ('charges', 'dipole', MOMENT[body].tolist()))},
    **{f'groups.g{body}': f'ids {body}' for body in range(3)}}


def pair(changes):
    """Two bodies on the x axis."""
    return make_scene((1, 1, 1), {
        'bodies.b.position': [DISTANCE, 0.0, 0.0], 'charge.mutual': True, **changes})


def energy_of(position, moment, charge=CHARGE):
    """Energy [J] of all pairs, from potential and field of each body at all others."""
    energy = 0.0
    for i in range(len(position)):
        for j in range(i):
            u = position[i] - position[j]
            r = np.linalg.norm(u)
            potential = charge[j] / r + moment[j] @ u / r**3
            field = (charge[j] + 3.0 * (moment[j] @ u) / r**2) * u / r**3 - moment[j] / r**3
            energy += COULOMB_CONSTANT * (charge[i] * potential - moment[i] @ field)
    return energy


def wrenches_of(position, moment, charge=CHARGE, h=1e-5):
    """Forces and torques (n, 3): minus the slopes of the energy, by differences of order 6."""
    slopes = []
    for turned in (False, True):
        for body in range(len(position)):
            for axis in np.eye(3):
                ends = []
                for step in (1.0, 2.0, 3.0, -1.0, -2.0, -3.0):
                    place, turned_moment = position.copy(), moment.copy()
                    if turned:
                        turned_moment[body] = Rotation.from_rotvec(
                            100.0 * step * h * axis).apply(moment[body])
                    else:
                        place[body] += step * h * axis
                    ends.append(energy_of(place, turned_moment, charge))
                rates = np.subtract(ends[:3], ends[3:]) / (100.0 * h if turned else h)
                slopes.append(-(45.0 * rates[0] - 9.0 * rates[1] + rates[2]) / 60.0)
    return np.array(slopes).reshape(2, len(position), 3)


def explicit_wrenches(position, moment):
    """Forces and torques (n, 3), from the field of each body and its gradient at all others."""
    force, torque = np.zeros((3, 3)), np.zeros((3, 3))
    for i in range(3):
        for j in {0, 1, 2} - {i}:
            u = position[i] - position[j]
            r = np.linalg.norm(u)
            along, own = moment[j] @ u, moment[i]
            field = (CHARGE[j] + 3.0 * along / r**2) * u / r**3 - moment[j] / r**3
            # (p . grad) E
            slope = CHARGE[j] * (own / r**3 - 3.0 * (own @ u) * u / r**5) + 3.0 * (
                (own @ moment[j]) * u + along * own + (own @ u) * moment[j]) / r**5 - (
                15.0 * along * (own @ u) * u / r**7)
            force[i] += COULOMB_CONSTANT * (CHARGE[i] * field + slope)
            torque[i] += COULOMB_CONSTANT * np.cross(own, field)
    return force, torque


@pytest.mark.parametrize(('first', 'second', 'force', 'turning'), [
    # In line they attract, side by side they repel, crossed they turn; unequal strengths.
    ([1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [12.0, 0.0, 0.0], [0.0, 0.0]),
    ([0.0, 0.0, 1.0], [0.0, 0.0, 2.0], [-6.0, 0.0, 0.0], [0.0, 0.0]),
    ([1.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.0, 0.0, -6.0], [2.0, 4.0])])
def test_two_dipoles_have_their_closed_forms(first, second, force, turning):
    # F = 6 k p p' / r^4, 3 k p p' / r^4, and torques p p' k / r^3 and 2 p p' k / r^3.
    scene = pair({
        'groups.b': 'ids 1', 'charges.b.group': 'b', 'charges.b.dipole': [
            1e-8 * part for part in second], 'charge.dipole': [1e-8 * part for part in first]})
    found = wrenches(scene, scene.position, ALONE)
    unit = COULOMB_CONSTANT * 1e-16 / DISTANCE**4
    assert found.force[0] == pytest.approx(unit * np.array(force), rel=1e-12, abs=1e-12 * unit)
    assert found.force[1] == pytest.approx(-found.force[0], rel=1e-12, abs=1e-12 * unit)
    torque = unit * DISTANCE * np.array([[0.0, turning[0], 0.0], [0.0, turning[1], 0.0]])
    assert found.torque == pytest.approx(torque, rel=1e-12, abs=1e-12 * unit)


def test_a_charge_pulls_a_dipole():
    # 2 k q p / r^3 along the axis.
    scene = pair({
        'groups.b': 'ids 1', 'charges.b.group': 'b', 'charges.b.charge': 3e-7,
        'charge.dipole': [-1e-8, 0.0, 0.0]})
    found = wrenches(scene, scene.position, ALONE)
    assert found.force[0] == pytest.approx(
        [2.0 * COULOMB_CONSTANT * 3e-15 / DISTANCE**3, 0.0, 0.0], rel=1e-12)


@pytest.mark.parametrize('cosines', [False, True])
def test_forces_and_torques_are_minus_the_slopes_of_the_energy(cosines):
    scene = make_scene((1, 1, 1), THREE)
    turns = Rotation.random(3, random_state=2)
    found = wrenches(scene, scene.position, turns.as_quat(), cosines=cosines)
    force, torque = wrenches_of(scene.position, turns.apply(MOMENT))
    assert found.force == pytest.approx(force, abs=1e-8 * np.abs(force).max())
    assert found.torque == pytest.approx(torque, abs=1e-8 * np.abs(torque).max())
    assert np.abs(found.torque[[0, 2]]).min(axis=1).min() > 0.0 == np.abs(found.torque[1]).max()
    # Nothing acts on the whole.
    assert np.abs(found.force.sum(axis=0)).max() < 1e-13 * np.abs(force).max()
    whole = (np.cross(scene.position, found.force) + found.torque).sum(axis=0)
    assert np.abs(whole).max() < 1e-13 * np.abs(torque).max()


def test_a_run_follows_its_equations_and_conserves_momentum_and_energy():
    scene = make_scene((1, 1, 1), {**THREE, 'solver.tolerance': 1e-9})
    simulation = ico.compile_scene(scene)
    turn = np.array([[20.0, -5.0, 3.0], [0.0, 10.0, 0.0], [-8.0, 2.0, 15.0]])
    simulation.set_state(angular_velocity=turn)
    mass, inertia = scene.shell.mass, scene.shell.inertia
    start = simulation.snapshot()
    assert start.energy['field'] == pytest.approx(energy_of(scene.position, MOMENT), rel=1e-12)

    def slope(time, y):
        place, speed, moment, spin = y.reshape(4, 3, 3)
        force, torque = explicit_wrenches(place, moment)
        return np.concatenate([
            speed, force / mass, np.cross(spin, moment), torque / inertia]).ravel()

    end = 0.03
    wanted = solve_ivp(
        slope, (0.0, end), np.concatenate([
            scene.position, np.zeros((3, 3)), MOMENT, turn]).ravel(),
        method='DOP853', rtol=1e-9, atol=1e-14).y[:, -1].reshape(4, 3, 3)
    simulation.advance_to(end)
    s = simulation.snapshot()
    assert np.abs(s.position - scene.position).max() > 1e-3
    assert s.position == pytest.approx(wanted[0], abs=1e-8)
    assert Rotation.from_quat(s.orientation).apply(MOMENT) == pytest.approx(
        wanted[2], abs=1e-6 * np.abs(MOMENT).max())
    exchanged = s.energy['kinetic'] - start.energy['kinetic']
    assert abs(s.energy['balance_error']) < 1e-8 * abs(exchanged)
    assert s.energy['field'] == pytest.approx(energy_of(s.position, wanted[2]), rel=1e-6)
    assert np.abs(s.linear_velocity.sum(axis=0)).max() < 1e-12 * np.abs(s.linear_velocity).max()
    whole = (mass * np.cross(s.position, s.linear_velocity)
             + inertia * s.angular_velocity).sum(axis=0)
    assert whole == pytest.approx(inertia * turn.sum(axis=0), rel=1e-7)


def test_second_derivatives_are_those_of_the_energy():
    fabric = StaticFabric(make_scene((1, 1, 1), THREE))
    random, shape = np.random.default_rng(1), (3, 3)
    here = fabric.start.moved(np.hstack([
        2e-3 * random.standard_normal(shape), 0.5 * random.standard_normal(shape)]))
    first, second = (np.hstack([
        1e-2 * random.standard_normal(shape), random.standard_normal(shape)]) for _ in range(2))
    product, h = here.times(first), 1e-4
    ahead, behind = here.moved(h * first), here.moved(-h * first)
    change = (behind.force - ahead.force) / (2.0 * h)
    assert product[:, :3] == pytest.approx(change[:, :3], abs=1e-6 * np.abs(change[:, :3]).max())
    assert (ahead.energy + behind.energy - 2.0 * here.energy) / h**2 == pytest.approx(
        float((first * product).sum()), rel=1e-6)
    assert (second * product).sum() == pytest.approx((first * here.times(second)).sum(), rel=1e-12)
    root = fabric.root
    assert (scaled_hessian(here) @ (root * first).ravel()) == pytest.approx(
        (product / root).ravel(), abs=1e-9 * np.abs(product / root).max())
    # No vibration is faster than the bound that limits the step.
    bound = field_bound(fabric.model, here.state)
    largest = float(np.linalg.eigvalsh(scaled_hessian(here).toarray()).max())
    assert largest <= bound < 10.0 * largest


def test_two_held_dipoles_swing_together_and_against_each_other():
    # U = -k p^2 / r^3 (2 cos a cos b - sin a sin b): Lambda w^2 = k p^2 / r^3 and 3 k p^2 / r^3.
    scene = pair({
        'charge.dipole': [1e-8, 0.0, 0.0], 'groups.each': 'all', 'supports.s.group': 'each',
        'supports.s.fix': 'tx ty tz'})
    found = ico.solve_modes(scene)
    unit = math.sqrt(COULOMB_CONSTANT * 1e-16 / DISTANCE**3 / scene.shell.inertia)
    moving = found.frequencies[found.frequencies > 1e-3 * unit]
    assert moving == pytest.approx(unit * np.sqrt([1.0, 1.0, 3.0, 3.0]), rel=1e-9)
    assert found.mechanism_count == 2
    rest = ico.solve_equilibrium(scene)
    assert rest.converged
    packed = pack_scene(scene)
    state = packed_state(packed, scene.position, ALONE)
    assert math.sqrt(field_bound(packed.model, state)) >= unit * math.sqrt(3.0)
