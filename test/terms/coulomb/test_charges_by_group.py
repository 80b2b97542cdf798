# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Charges and dipoles by group, and electric fields that vary in time, against closed forms.
"""

import math

from fabrics import changed, make_scene, same_state
import icofabric_sim as ico
from icofabric_sim.simulation.model.electric import COULOMB_CONSTANT
import numpy as np
import pytest
from scipy.integrate import solve_ivp

FAR = {'b': {'position': [1.0, 0.0, 0.0]}}
TWO = {'groups': {'one': 'ids 0', 'two': 'ids 1'}, 'bodies': FAR}


def run(scene, time):
    simulation = ico.compile_scene(scene)
    simulation.advance_to(time)
    return simulation.snapshot()


def loose(changes, **sections):
    return make_scene((1, 1, 1), {'solver.tolerance': 1e-10, **changes}, **sections)


@pytest.mark.parametrize('method', ['auto', 'leapfrog', 'dop8'])
def test_a_load_swings(method):
    """M x'' = F sin(w t): x = (F / M) (t / w - sin(w t) / w^2); after its duration it goes on."""
    rate, end = 2.0 * math.pi * 5.0, 0.73
    scene = loose({
        'solver.method': method, 'groups.g': 'all', 'loads.l.group': 'g',
        'loads.l.force': [0.0, 2e-3, 0.0], 'loads.l.profile': 'sine 5.0', 'loads.l.start': 0.1,
        'loads.l.duration': end})
    simulation = ico.compile_scene(scene)
    push = 2e-3 / scene.shell.mass
    for time in (0.05, 0.4, 0.1 + end, 1.2):
        simulation.advance_to(time)
        t = min(max(time - 0.1, 0.0), end)
        speed = push * (1.0 - math.cos(rate * t)) / rate
        place = push * (t / rate - math.sin(rate * t) / rate**2) + speed * max(
            time - 0.1 - end, 0.0)
        state = simulation.snapshot()
        assert state.position[0, 1] == pytest.approx(
            place, abs=1e-6 * abs(place) if method == 'leapfrog' else 1e-12)
        assert state.linear_velocity[0, 1] == pytest.approx(
            speed, abs=1e-12 if method != 'leapfrog' else 1e-6 * push / rate)
    assert place > 1e-3


@pytest.mark.parametrize('words', ['sine', 'sine 0', 'sine -3.0', 'sine fast', 'sine inf',
                                   'sine 1e9', 'ramp 2'])
def test_profiles_that_make_no_sense_are_refused(words):
    with pytest.raises(ico.ParameterError, match='sine FREQUENCY'):
        loose({'groups.g': 'all', 'loads.l.group': 'g', 'loads.l.profile': words,
               'loads.l.duration': 1.0})


@pytest.mark.long
@pytest.mark.parametrize('method', ['srkn6', 'dop8'])
def test_equal_charges_by_group_move_as_those_of_all(method):
    """The same motion; what is energy of the field there counts as work here."""
    changes = {
        'solver.method': method, 'solver.tolerance': 1e-10, 'groups.wall': 'x_min',
        'supports.wall.group': 'wall', 'field.electric': [2e4, 1e4, 3e4]}
    alike = make_scene((3, 2, 2), {
        **changes, 'charge.per_body': 3e-8, 'charge.dipole': [1e-9, -2e-9, 1e-9]})
    by_group = make_scene((3, 2, 2), {
        **changes, 'groups.every': 'all', 'charges.every.group': 'every',
        'charges.every.charge': 3e-8, 'charges.every.dipole': [1e-9, -2e-9, 1e-9]})
    one, two = run(alike, 0.2), run(by_group, 0.2)
    assert np.abs(one.position - alike.position).max() > 1e-4
    assert np.abs(one.orientation - alike.orientation).max() > 1e-3
    assert two.position == pytest.approx(one.position, abs=1e-10)
    assert two.orientation == pytest.approx(one.orientation, abs=1e-8)
    gained = one.energy['field'] - ico.compile_scene(alike).snapshot().energy['field']
    assert 'field' not in two.energy or two.energy['field'] == 0.0
    assert two.energy['work_in'] == pytest.approx(-gained, rel=1e-6)


def test_groups_of_opposite_charge_part():
    """Each falls by q E / M, the uncharged one stays."""
    scene = loose({
        'charges.one.group': 'one', 'charges.one.charge': 2e-8, 'charges.two.group': 'two',
        'charges.two.charge': -5e-8, 'field.electric': [0.0, 0.0, 1e4],
        'bodies.c.position': [3.0, 0.0, 0.0]}, **TWO)
    found = run(scene, 0.5)
    expected = np.array([2e-8, -5e-8, 0.0]) * 1e4 / scene.shell.mass * 0.125
    assert found.position[:, 2] == pytest.approx(expected, rel=1e-12, abs=1e-15)
    assert abs(found.energy['balance_error']) < 1e-15


def test_charges_follow_a_field_that_swings():
    """M x'' = q E sin(w t), and a dipole turns as Lambda theta'' = -p E sin(w t) sin(theta)."""
    rate = 2.0 * math.pi * 3.0
    moment, field = 4e-9, 2e4
    scene = loose({
        'charges.one.group': 'one', 'charges.one.charge': 3e-8,
        'charges.two.group': 'two', 'charges.two.dipole': [moment, 0.0, 0.0],
        'field.electric': [0.0, field, 0.0], 'field.profile': 'sine 3.0',
        'solver.method': 'dop8'}, **TWO)
    state = run(scene, 0.7)
    push = 3e-8 * field / scene.shell.mass
    assert state.position[0, 1] == pytest.approx(
        push * (0.7 / rate - math.sin(rate * 0.7) / rate**2), rel=1e-9)
    # theta: from the field to the dipole, about z; at first a right angle below it.
    torque = moment * field / scene.shell.inertia
    turned = solve_ivp(
        lambda t, y: [y[1], torque * math.sin(rate * t) * math.cos(y[0])], (0.0, 0.7),
        [0.0, 0.0], rtol=1e-11, atol=1e-12).y[0, -1]
    x, y, z, w = state.orientation[1]
    assert abs(turned) > 0.3 and abs(x) + abs(y) < 1e-12
    assert math.remainder(2.0 * math.atan2(z, w) - turned, 2.0 * math.pi) == pytest.approx(
        0.0, abs=1e-7)
    assert state.position[1] == pytest.approx([1.0, 0.0, 0.0], abs=1e-15)


def test_a_field_that_begins_and_ends():
    """Nothing before its start, q E t / M while it lasts, nothing after; equal charges too."""
    scene = loose({
        'charge.per_body': 1e-8, 'field.electric': [1e4, 0.0, 0.0], 'field.start': 0.2,
        'field.duration': 0.3}, **TWO)
    simulation = ico.compile_scene(scene)
    for time, lasted in ((0.1, 0.0), (0.35, 0.15), (0.6, 0.3)):
        simulation.advance_to(time)
        assert simulation.snapshot().linear_velocity[:, 0] == pytest.approx(
            [1e-4 * lasted / scene.shell.mass] * 2, rel=1e-12)
    # A stop in the middle, and all in one go: the same bits.
    assert same_state(simulation.snapshot(), run(scene, 0.6))


def test_opposite_charges_circle_each_other():
    """Kepler: omega^2 = 2 k q Q / (M r^3) for two equal masses at the distance r."""
    charge, other, distance = 3e-7, 2e-7, 1.0
    mass = make_scene((1, 1, 1)).shell.mass
    rate = math.sqrt(2.0 * COULOMB_CONSTANT * charge * other / (mass * distance**3))
    speed = 0.5 * rate * distance
    scene = loose({
        'charge.mutual': True, 'charges.one.group': 'one', 'charges.one.charge': charge,
        'charges.two.group': 'two', 'charges.two.charge': -other,
        'initial.a.group': 'one', 'initial.a.linear_velocity': [0.0, -speed, 0.0],
        'initial.b.group': 'two', 'initial.b.linear_velocity': [0.0, speed, 0.0]}, **TWO)
    time = 0.6 * 2.0 * math.pi / rate
    state = run(scene, time)
    away = 0.5 * distance * np.array([math.cos(rate * time), math.sin(rate * time), 0.0])
    middle = np.array([0.5, 0.0, 0.0])
    assert state.position == pytest.approx(np.array([middle - away, middle + away]), abs=1e-8)
    assert state.energy['field'] == pytest.approx(
        -COULOMB_CONSTANT * charge * other / distance, rel=1e-8)


def test_charges_turn_in_a_magnetic_field_each_by_its_own():
    """The rate of each is -q B / M; one without a charge flies on."""
    scene = loose({
        'charges.one.group': 'one', 'charges.one.charge': 1e-3, 'charges.two.group': 'two',
        'charges.two.charge': -3e-3, 'field.magnetic': [0.0, 0.0, 2.0],
        'bodies.c.position': [3.0, 0.0, 0.0], 'groups.every': 'all', 'initial.i.group': 'every',
        'initial.i.linear_velocity': [0.4, 0.0, 0.0]}, **TWO)
    state = run(scene, 0.5)
    angle = -np.array([1e-3, -3e-3, 0.0]) * 2.0 / scene.shell.mass * 0.5
    assert np.abs(angle[:2]).min() > 0.05
    assert state.linear_velocity == pytest.approx(
        0.4 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(3)]), abs=1e-9)


@pytest.mark.long
def test_charges_by_group_rest_where_their_energy_is_least():
    """Statics knows each charge, also in second derivatives: beside a run that drag stops."""
    scene = make_scene((3, 3, 2), {
        'groups.wall': 'x_min', 'supports.wall.group': 'wall', 'groups.tip': 'x_max',
        'groups.low': 'z_min', 'charge.mutual': True, 'charge.per_body': 2e-8,
        'charges.tip.group': 'tip', 'charges.tip.charge': -3e-8,
        'charges.tip.dipole': [0.0, 0.0, 2e-9], 'field.electric': [1e4, 0.0, 3e4],
        'connector.bending_stiffness': 0.02, 'connector.twisting_stiffness': 0.02})
    found = ico.solve_equilibrium(scene)
    assert found.converged
    assert np.abs(found.snapshot.position - scene.position).max() > 1e-5
    slow = changed(scene, {'drag.linear': 0.3, 'drag.angular': 3e-5, 'solver.tolerance': 1e-8})
    rested = run(slow, 4.0)
    assert np.abs(rested.linear_velocity).max() < 1e-8
    assert rested.position == pytest.approx(found.snapshot.position, abs=1e-9)
    spectrum = ico.solve_modes(scene, at=found.snapshot)
    assert spectrum.frequencies.min() > 0.0


def test_what_fields_cannot_be_is_refused():
    with pytest.raises(ico.ParameterError, match='magnetic field that changes in time'):
        loose({'field.magnetic': [0.0, 0.0, 1.0], 'field.profile': 'sine 2.0'})
    with pytest.raises(ico.ParameterError, match=r"charges\.g\.group: there is no group 'x'"):
        loose({'charges.g.group': 'x'})
    with pytest.raises(ico.ParameterError, match='field.profile'):
        loose({'field.profile': 'wild'})
    swinging = loose({
        'charge.per_body': 1e-8, 'field.electric': [1.0, 0.0, 0.0], 'field.profile': 'sine 2.0',
        'groups.g': 'all', 'supports.s.group': 'g', 'supports.s.fix': 'ty'})
    with pytest.raises(ValueError, match=r'field\.profile: changes with time'):
        ico.solve_equilibrium(swinging)
