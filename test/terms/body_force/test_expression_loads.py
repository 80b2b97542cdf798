# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Loads by expressions of place and time, against closed forms and independent integrals."""

import math

from driven_runs import Drive
from fabrics import make_scene, same_state
import icofabric_sim as ico
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.geometry.icosahedron import face_geometry, integrate_face
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.scene.expression_loads import PLACE
from icofabric_sim.scene.expression_times import critical_times
from icofabric_sim.scene.expressions import make_expression
from icofabric_sim.scene.summary import describe_scene
from icofabric_sim.simulation.devices import refusals
from icofabric_sim.simulation.model.expression_force import with_expressions
from icofabric_sim.simulation.model.layout import make_layout
from icofabric_sim.simulation.stepping.method_needs import required_method
from icofabric_sim.terms.body_force.external_force import call_function
import numpy as np
import pytest

LOOSE = {
    'weave.connected': False, 'solver.tolerance': 1e-9, 'groups.g': 'ids 1 3',
    'initial.turned.group': 'g', 'initial.turned.rotation': [0.4, -0.7, 0.2],
    'initial.turned.displacement': [0.01, 0.02, -0.03]}
TIME = 0.37


def scene_with(changes):
    return make_scene((2, 2, 2), {**LOOSE, **changes})


def wrenches(scene, time=TIME):
    """Forces and torques by the compiled function in the initial state."""
    force = with_expressions(scene, None)
    state = np.hstack(scene.initial)
    external = force.prepare(make_layout(scene.weave.grid, scene.body_count), state)
    assert force.is_compiled
    assert call_function(
        external.address, time, external.numbers, external.result) == 0
    return external.result[:, :3], external.result[:, 3:]


def axes_of(scene):
    return cosines_from_quaternions(scene.initial.orientation)


@pytest.mark.parametrize('frame, share', [('world', 'each'), ('body', 'total')])
def test_a_force_acts_at_its_point(frame, share):
    point = np.array([0.01, -0.004, 0.007])
    scene = scene_with({
        'loads.w.group': 'g', 'loads.w.expression': 'k*x*t, exp(y) - z, y*z', 'constants.k': 7.0,
        'loads.w.point': point.tolist(), 'loads.w.frame': frame, 'loads.w.share': share})
    force, torque = wrenches(scene)
    for body in range(4):
        axes = axes_of(scene)[body]
        arm = point @ axes
        x, y, z = scene.initial.position[body] + arm
        expected = np.array([7.0 * x * TIME, math.exp(y) - z, y * z]) * (body in (1, 3))
        if frame == 'body':
            expected = 0.5 * expected @ axes
        assert force[body] == pytest.approx(expected, rel=1e-13, abs=1e-16)
        assert torque[body] == pytest.approx(np.cross(arm, expected), rel=1e-12, abs=1e-17)
    assert np.abs(force[1]).min() > 1e-4


@pytest.mark.parametrize('direction, frictionless', [
    ('follower', False), ('follower', True), ('fixed', False), ('fixed', True)])
def test_tractions_of_place_and_time_are_integrated_over_faces(direction, frictionless):
    scene = scene_with({
        'tractions.w.group': 'g', 'tractions.w.faces': 'numbers 7 12',
        'tractions.w.expression': '300*exp(xi + 9*x)*t, 50*cos(eta - 20*y), 80*xi*z',
        'tractions.w.direction': direction, 'tractions.w.frictionless': frictionless})
    force, torque = wrenches(scene)
    half_edge, geometry = scene.geometry.half_edge, face_geometry(scene.geometry.half_edge)
    woven = cosines_from_quaternions(scene.orientation)
    for body in (1, 3):
        axes = axes_of(scene)[body]
        total, moment = np.zeros((2, 3))
        for face in (6, 11):
            corner, sides = geometry.frames[face][:, 0], geometry.frames[face][:, 1:]
            normal = geometry.normals[face]
            first = sides[:, 0] / np.linalg.norm(sides[:, 0])
            frame = np.stack([-normal, first, np.cross(normal, first)])

            def at(points, corner=corner, sides=sides, frame=frame, normal=normal, axes=axes,
                   body=body):
                xi, eta = np.linalg.lstsq(sides, (points - corner).T, rcond=None)[0]
                x, y, z = (scene.initial.position[body] + points @ axes).T
                parts = np.stack([
                    300.0 * np.exp(xi + 9.0 * x) * TIME, 50.0 * np.cos(eta - 20.0 * y),
                    80.0 * xi * z], axis=1) @ frame
                push = parts @ (axes if direction == 'follower' else woven[body])
                if frictionless:
                    out = normal @ axes
                    push = np.outer(push @ out, out)
                return np.hstack([push, np.cross(points @ axes, push)])

            whole = np.asarray(integrate_face(at, face + 1, half_edge, degree=24))
            total, moment = total + whole[:3], moment + whole[3:]
        assert force[body] == pytest.approx(total, rel=1e-9)
        assert torque[body] == pytest.approx(moment, rel=1e-8, abs=1e-12)
    assert not force[[0, 2]].any() and np.abs(force[1]).max() > 1e-3


def test_a_factor_of_pressure_and_shear():
    base = {'tractions.w.group': 'g', 'tractions.w.faces': 'toward 1 0 0'}
    one, two = (wrenches(scene_with({**base, **changes})) for changes in (
        {'tractions.w.pressure': 300.0, 'tractions.w.shear': [80.0, -50.0],
         'tractions.w.expression': 'xi + t'},
        {'tractions.w.expression': '300*(xi + t), 80*(xi + t), -50*(xi + t)'}))
    assert one[0] == pytest.approx(two[0], rel=1e-13) and one[0].any()
    assert one[1] == pytest.approx(two[1], rel=1e-12, abs=1e-18)


@pytest.mark.parametrize('direction', ['follower', 'fixed'])
def test_without_place_and_time_the_kernels_of_tractions_act(direction):
    """A polynomial is that of `variation`; three components add up; any method."""
    base = {'tractions.w.group': 'g', 'tractions.w.faces': 'toward 1 0 0',
            'tractions.w.direction': direction, 'solver.method': 'leapfrog'}
    given = {'tractions.w.pressure': 300.0, 'tractions.w.shear': [80.0, -50.0]}
    scenes = [scene_with({**base, **changes}) for changes in (
        {**given, 'tractions.w.variation': '1 2 0 0 0 -3'},
        {**given, 'tractions.w.expression': '1 + 2*xi - 3*eta**2'},
        {'tractions.w.expression': '300*(1 + 2*xi - 3*eta**2), 80*(1 + 2*xi - 3*eta**2),'
                                   '-50*(1 + 2*xi - 3*eta**2)'})]
    assert not any(scene.expression_loads for scene in scenes)
    sums = [(
        sum(part.force for part in scene.tractions['w'].wrenches),
        sum(part.torque + np.cross(part.point, part.force)
            for part in scene.tractions['w'].wrenches)) for scene in scenes]
    for force, torque in sums[1:]:
        assert force == pytest.approx(sums[0][0], rel=1e-12, abs=1e-15)
        assert torque == pytest.approx(sums[0][1], rel=1e-11, abs=1e-16)
    assert np.abs(sums[0][0]).max() > 1e-3


def test_rules_are_chosen_by_their_error():
    base = {'tractions.w.group': 'g', 'tractions.w.pressure': 1.0}

    def rule_of(text):
        return scene_with({**base, 'tractions.w.expression': text}).tractions['w'].quadrature

    degrees = [rule_of(text).degree for text in ('1', 'xi**4', 'exp(3*xi)', 'abs(xi - 0.3)')]
    assert degrees == sorted(degrees) and degrees[0] == 2 and degrees[-1] == 64
    # The stated error of a corner is that of the total, int |xi - c| = c^2 - c^3/3 - c/2 + 1/6.
    rule, c = rule_of('abs(xi - 0.3)'), 0.3
    assert 1e-6 < rule.error < 1e-3
    scene = scene_with({**base, 'tractions.w.expression': 'abs(xi - 0.3)',
                        'tractions.w.faces': 'numbers 1'})
    area = 4.0 * math.sqrt(3.0) / 4.0 * scene.geometry.half_edge**2
    exact = 2.0 * area * (c * c - c**3 / 3.0 - c / 2.0 + 1.0 / 6.0)
    found = np.linalg.norm(scene.tractions['w'].wrenches[0].force)
    assert abs(found - exact) < 3.0 * rule.error * exact
    text = '\n'.join(line for _, line in describe_scene(scene))
    assert f'abs(xi - 0.3) (Gauss rule of degree 64, relative error {rule.error:.1e})' in text
    moving = scene_with({**base, 'tractions.w.expression': 'exp(xi)*t'})
    assert 'exp(xi)*t (Gauss rule of degree 8' in '\n'.join(
        line for _, line in describe_scene(moving))
    for text in ('where(xi < 0.3, 1, 0)', 'where(xi < 0.3, 1, t)'):
        with pytest.raises(ico.ParameterError, match='do not converge.*smoother'):
            scene_with({**base, 'tractions.w.expression': text})


def test_rules_are_chosen_where_an_expression_varies():
    """A narrow peak on one of many bodies, and a front that passes at 2 m/s."""
    base = make_scene((8, 8, 2), {'weave.connected': False})
    body = base.body_count // 3
    centre = base.position[body] + face_geometry(base.geometry.half_edge).centroids[0] @ (
        cosines_from_quaternions(base.orientation[[body]])[0])
    given = {'groups.w': 'all', 'tractions.w.group': 'w', 'tractions.w.pressure': 1000.0}
    scene = base.with_changes({
        **given, 'tractions.w.faces': 'numbers 1', **{
            f'constants.c{axis}': float(value) for axis, value in zip('xyz', centre)},
        'tractions.w.expression': 'exp(-((x - cx)**2 + (y - cy)**2 + (z - cz)**2)/0.003**2)'})
    force, _ = wrenches(scene, 0.0)
    corner, sides = np.split(face_geometry(scene.geometry.half_edge).frames[0], [1], axis=1)
    xi, weight = np.polynomial.legendre.leggauss(80)
    xi, weight = 0.5 * xi + 0.5, 0.5 * weight
    a, b = xi[:, None], (1.0 - xi[:, None]) * xi
    points = corner.T + (a[..., None] + 0.0 * b[..., None]) * sides[:, 0] + b[..., None] * (
        sides[:, 1])
    middle = face_geometry(scene.geometry.half_edge).centroids[0]
    peak = np.exp(-((points - middle)**2).sum(axis=-1) / 0.003**2)
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]))
    exact = 1000.0 * area * (weight[:, None] * (1.0 - a) * weight * peak).sum()
    assert np.linalg.norm(force[body]) == pytest.approx(exact, rel=1e-6)
    with pytest.raises(ico.ParameterError, match='do not converge'):
        base.with_changes({
            **given, 'tractions.w.expression': 'where(x + 0.1 < 2*t, 1, 0)'})


def test_fields_of_place_act_on_charges_and_dipoles():
    """E = (k x, -k y, E_z): forces Q E + (p . grad) E and torques p x E, exact for linear E."""
    k, dipole = 3e4, np.array([2e-7, -1e-7, 3e-7])
    scene = scene_with({
        'charge.per_body': 1e-6, 'charge.dipole': dipole.tolist(), 'constants.k': k,
        'charges.c.group': 'g', 'charges.c.charge': -2e-6, 'charges.c.dipole': dipole.tolist(),
        'field.electric_expression': 'k*x, -k*y, 1e3'})
    force, torque = wrenches(scene)
    for body, (x, y, _) in enumerate(scene.initial.position):
        field, p = np.array([k * x, -k * y, 1e3]), dipole @ axes_of(scene)[body]
        charge = -2e-6 if body in (1, 3) else 1e-6
        expected = charge * field + k * p * [1.0, -1.0, 0.0]
        assert force[body] == pytest.approx(expected, rel=1e-11, abs=1e-15)
        assert torque[body] == pytest.approx(np.cross(p, field), rel=1e-11, abs=1e-15)


def test_springs_to_a_point_swing():
    """The motion is c + (x_0 - c) cos(w t) with w = sqrt(k / M), and a ramp by min."""
    k, c = 3.0, 0.1
    scene = scene_with({
        'loads.w.group': 'g', 'loads.w.expression': '-k*(x - c), -k*y, 1e-3*min(t/0.1, 1)',
        'constants.k': k, 'constants.c': c})
    simulation = ico.compile_scene(scene)
    assert simulation.status.method_name == 'dop8'
    assert 'loads.w.expression depends on place or time' in simulation.status.method_reason
    rate, first = math.sqrt(k / scene.shell.mass), scene.initial.position
    for time in (0.05, 0.5):
        simulation.advance_to(time)
        state = simulation.snapshot()
        for body in (1, 3):
            assert state.position[body, 0] == pytest.approx(
                c + (first[body, 0] - c) * math.cos(rate * time), abs=1e-8)
            assert state.position[body, 1] == pytest.approx(
                first[body, 1] * math.cos(rate * time), abs=1e-8)
            pushed = time**2 / 0.2 if time < 0.1 else time - 0.05
            assert state.linear_velocity[body, 2] == pytest.approx(
                1e-3 / scene.shell.mass * pushed, rel=1e-6)
        assert np.array_equal(state.position[0], first[0])
        energy = state.energy
        assert energy['work_in'] == pytest.approx(energy['kinetic'], abs=1e-7)
        assert energy['kinetic'] > 1e-3
    whole = ico.compile_scene(scene)
    whole.advance_to(0.5)
    assert same_state(whole.snapshot(), state)


def test_profiles_scale_expressions_and_end_steps():
    """A pulse of the force 0.1 t, a ramp of a field: impulses in closed form; resets restart."""
    scene = scene_with({
        'loads.w.group': 'g', 'loads.w.expression': '0, 0.1*t + 0*x, 0', 'loads.w.start': 0.1,
        'loads.w.duration': 0.2, 'charge.per_body': 1e-6, 'field.electric_expression': '0*x, 0, t',
        'field.profile': 'ramp', 'field.duration': 0.2})
    simulation, mass = ico.compile_scene(scene), scene.shell.mass
    ends = []
    for start in (0.0, 0.4):
        for time in (0.05, 0.2, 0.25, 0.4):
            simulation.advance_to(start + time)
            velocity = simulation.snapshot().linear_velocity
            until = min(max(time, 0.1), 0.3)
            assert velocity[1, 1] == pytest.approx(
                0.05 * (until**2 - 0.01) / mass, rel=1e-9, abs=1e-12)
            ramp = min(time, 0.2)**3 / 0.6 + max(time**2 - 0.04, 0.0) / 2.0
            assert velocity[:, 2] == pytest.approx(1e-6 * ramp / mass, rel=1e-7)
            assert not velocity[0, 1]
            if time == 0.2:
                other = ico.compile_scene(scene)
                other.restore(simulation.checkpoint())
        other.advance_to(start + 0.4)
        assert same_state(other.snapshot(), simulation.snapshot())
        ends.append(velocity)
        simulation.reset()
    assert simulation.time == 0.8 and ends[1] == pytest.approx(ends[0], rel=1e-12)
    held = scene.with_changes({
        'supports.s.group': 'all', 'field.electric_expression': '', 'field.profile': 'steady',
        'field.duration': 0.0})
    with pytest.raises(ValueError, match='loads.w.expression and 2 more: changes with time'):
        ico.solve_equilibrium(held)
    for time, force in ((0.05, 0.0), (0.2, 0.02), (0.31, 0.0)):
        result = ico.solve_equilibrium(held, time=time)
        assert result.reaction[1, 1] == pytest.approx(-force, abs=1e-15)


def test_short_pulses_are_not_skipped():
    """Steps of a body at rest end where an expression changes: impulses in closed form."""
    texts = {
        'max(0, 1 - abs(t - 0.51)/0.01)': 0.01, 'where(t < 5.3, 0, where(t < 5.301, 1, 0))': 1e-3,
        'exp(-((t - 3.1)/1e-3)**2)': 1e-3 * math.sqrt(math.pi),
        'max(0, sin(40*t) - 0.995)*0.1': None}
    for text, impulse in texts.items():
        scene = scene_with({'loads.w.group': 'g', 'loads.w.expression': f'0, 0, {text}'})
        simulation = ico.compile_scene(scene)
        simulation.advance_to(6.0)
        found = scene.shell.mass * simulation.snapshot().linear_velocity[1, 2]
        if impulse is None:
            # Of each of 38 peaks; the first is at 40 t = pi/2.
            width = math.acos(0.995)
            impulse = 38 * 0.1 * 2.0 / 40.0 * (math.sin(width) - 0.995 * width)
        assert found == pytest.approx(impulse, rel=1e-5), text


@pytest.mark.parametrize('text, times, rate', [
    ('abs(abs(abs(t - 1) - 0.5) - 0.1)', [0.4, 0.5, 0.6, 1.0, 1.4, 1.5, 1.6], 0.0),
    ('abs(sin(5*t + x)) + sin(6*t)*y', [], 5.0), ('max(0, sin(max(2*t, 7*t - 1)))', [0.2], 7.0),
    ('where(x - 2*t > 0, 1, 0)', [0.05, 0.1], 0.0), ('min(t/0.1, 1) + t*x', [0.1], 0.0)])
def test_times_of_changes_are_found(text, times, rate):
    expression = make_expression(
        scene_with({'loads.w.group': 'g', 'loads.w.expression': f'{text}, 0, 0'}).parameters,
        'loads.w.expression', PLACE, (3,))
    found = critical_times(expression, np.array([[0.1, 0.0, 3.0], [0.2, 1.0, 0.0]]))
    assert found.times == pytest.approx(times, rel=1e-12)
    assert found.rate == pytest.approx(rate, rel=1e-12)


def test_loads_and_a_body_force_add_up():
    scene = scene_with({'loads.w.group': 'g', 'loads.w.expression': '-3*(x - 0.1), 0, 0'})

    def own(time, position, orientation, linear_velocity, angular_velocity, body):
        return (0.0, 1e-3 * body, 0.0), (0.0, 0.0, 0.0)

    def energies(time, position, orientation, body):
        return -1e-3 * body * position[1]

    simulation = ico.compile_scene(scene, body_force=ico.BodyForce(own, potential=energies))
    alone = ico.compile_scene(scene)
    for each in (simulation, alone):
        each.advance_to(0.2)
    state, mass = simulation.snapshot(), scene.shell.mass
    assert state.position[:, 0] == pytest.approx(alone.snapshot().position[:, 0], abs=1e-10)
    assert state.linear_velocity[:, 1] == pytest.approx(
        1e-3 * np.arange(4) * 0.2 / mass, rel=1e-9)
    energy = state.energy
    assert energy['field'] == 0.0 < energy['work_in']
    assert abs(energy['balance_error']) < 1e-7 * energy['kinetic']


def test_bodies_have_their_numbers():
    """Compiled for one body, in Python for all and for one, and for surfaces."""
    def one(time, position, orientation, linear_velocity, angular_velocity, body):
        return (1e-3 * body, 0.0, 0.0), (0.0, 0.0, 0.0)

    def every(time, position, orientation, linear_velocity, angular_velocity, body):
        return np.outer(1e-3 * body, [1.0, 0.0, 0.0]), np.zeros((len(body), 3))

    def single(time, position, orientation, linear_velocity, angular_velocity, body):
        return (math.fsum([1e-3 * int(body)]), 0.0, 0.0), [0.0] * 3

    scene = make_scene((2, 2, 2), LOOSE)
    area = math.sqrt(3.0) * scene.geometry.half_edge**2

    def press(face, xi, eta, time, body):
        return np.outer(-1e-3 / area * body, [1.0, 0.0, 0.0])

    normal = face_geometry(scene.geometry.half_edge).normals[4]
    for force, expected in (
            (ico.BodyForce(one), [1.0, 0.0, 0.0]), (ico.BodyForce(every), [1.0, 0.0, 0.0]),
            (ico.BodyForce(single), [1.0, 0.0, 0.0]),
            (ico.surface_force(scene, press, faces='numbers 5'), normal)):
        simulation = ico.compile_scene(scene, body_force=force)
        simulation.advance_to(0.01)
        found = scene.shell.mass * simulation.snapshot().linear_velocity / 0.01
        axes = axes_of(scene) if expected is normal else np.tile(np.eye(3), (4, 1, 1))
        assert found == pytest.approx(
            1e-3 * np.arange(4)[:, None] * np.einsum('i,nij->nj', expected, axes), abs=1e-11)


def test_a_number_that_is_not_finite_names_load_and_body():
    base = {'loads.w.group': 'g', 'loads.w.expression': '0, 1e-3/(0.05 - t), 0'}
    with pytest.raises(ValueError, match=r'loads.w.expression is not finite \(for body 1\)'):
        ico.compile_scene(scene_with({**base, 'loads.w.expression': 'log(x - 9), 0, 0'}))
    simulation = ico.compile_scene(scene_with({
        **base, 'loads.w.expression': '0, 0, sqrt(0.02 - t)'}))
    with pytest.raises(ico.SimulationError) as caught:
        simulation.advance_to(0.1)
    assert 'loads.w.expression failed at t = 0.02' in str(caught.value)
    assert 'not finite (for body 1)' in str(caught.value) and 'kept' in str(caught.value)


def test_what_opposes_an_expression_is_refused():
    load = {'loads.w.group': 'g', 'loads.w.expression': 'x, 0, t'}
    for changes, words in (
            ({'tractions.w.group': 'g', 'tractions.w.expression': 'xi', 'tractions.w.variation':
              '1 2 3'}, 'two factors'),
            ({'tractions.w.group': 'g', 'tractions.w.expression': 'xi, 0, 0',
              'tractions.w.pressure': 2.0}, 'tractions.w.pressure'),
            ({'tractions.w.group': 'g', 'tractions.w.expression': '1/xi'}, 'converge|finite')):
        with pytest.raises(ico.ParameterError, match=words):
            scene_with(changes)
    scene = scene_with(load)
    with pytest.raises(ico.ParameterError, match='loads.w.expression by place or time is not sh'):
        refusals.require_shareable(scene, cosines=False, body_force=False)
    with pytest.raises(ico.ParameterError, match='loads.w.expression .*not computed on'):
        refusals.require_on_device(scene, cosines=False, body_force=False, shared=False)
    for method in ('leapfrog', 'sdirk4'):
        with pytest.raises(ico.ParameterError, match=f'{method} .*loads.w.expression'):
            required_method(scene.with_changes({'solver.method': method}), outside=True)
    with pytest.raises(ico.ParameterError, match='loads.w.expression is given quaternions'):
        ico.compile_scene(scene, rotation='direction_cosines')


HELD = {
    'groups.wall': 'x_min', 'groups.tip': 'x_max', 'supports.w.group': 'wall',
    'loads.l.group': 'tip'}


@pytest.mark.parametrize('text, curl', [
    ('0, 0, -0.3 - 20*z', 0.0), ('-5*(y - 0.02), 5*x, -0.3 + z', 10.0)])
def test_statics_balances_forces_of_place(text, curl):
    """The reactions balance the forces at the places found, with a potential or without one."""
    scene = make_scene((3, 2, 2), {
        **HELD, 'loads.l.expression': text, 'connector.bending_stiffness': 0.02})
    result = ico.solve_equilibrium(scene)
    assert result.converged and result.residual < 1e-9
    place, tip = result.snapshot.position, scene.groups['tip']
    x, y, z = place[tip].T
    forces = np.stack(
        [0.0 * x, 0.0 * x, -0.3 - 20.0 * z] if curl == 0.0 else
        [-5.0 * (y - 0.02), 5.0 * x, -0.3 + z], axis=1)
    assert np.abs(place - scene.position).max() > 1e-4
    assert result.reaction[:, :3].sum(axis=0) == pytest.approx(-forces.sum(axis=0), abs=1e-9)
    if curl == 0.0:
        assert ico.solve_modes(scene, at=result.snapshot).frequencies.min() > 0.0
    else:
        with pytest.raises(ValueError, match='loads.l.expression has no potential'):
            ico.solve_modes(scene, at=result.snapshot)


def test_statics_needs_a_time_for_forces_of_time():
    scene = make_scene((3, 2, 2), {
        **HELD, 'loads.l.expression': '0, 0, -t', 'connector.bending_stiffness': 0.02})
    with pytest.raises(ValueError, match='loads.l.expression: changes with time'):
        ico.solve_equilibrium(scene)
    found, steady = (ico.solve_equilibrium(each, time=0.2) for each in (
        scene, scene.with_changes({'loads.l.expression': '', 'loads.l.force': [0.0, 0.0, -0.2]})))
    assert found.snapshot.position == pytest.approx(steady.snapshot.position, abs=1e-9)
    # The expression need not be finite at another time.
    late = ico.solve_equilibrium(
        scene.with_changes({'loads.l.expression': '0, 0, -0.2*sqrt(t - 0.5)/sqrt(0.5)'}), time=1.0)
    assert late.snapshot.position == pytest.approx(steady.snapshot.position, abs=1e-9)


def test_live_changes_are_recorded_and_verified(tmp_path):
    scene = scene_with({
        'loads.w.group': 'g', 'loads.w.expression': '-3*(x - 0.1), sin(9*t), 0',
        'loads.w.start': 0.013, 'tractions.p.group': 'g', 'tractions.p.expression': '50*t*xi',
        'tractions.p.pressure': 1.0, 'real_time_factor': 0.0, 'duration': 0.1})
    drive = Drive(tmp_path / 'bag', scene, [
        (30, lambda drive: drive.change(loads__w__expression='k*x, 0, -t', constants__k=-5.0)),
        (50, lambda drive: drive.reset()),
        (70, lambda drive: drive.change(line_loads__l__group='g', line_loads__l__force=[
            0.0, 1.0, 0.0], line_loads__l__expression='s*t'))]).run()
    assert drive.runner.parameters['loads.w.expression'] == 'k*x, 0, -t'
    with RecordedRun(tmp_path / 'bag') as run:
        result = verify_run(run)
    assert result.verdict == 'identical' and result.repeated['re-weaves'] == 2
    assert result.compared.total() > 10


@pytest.mark.parametrize('text, ends_steps', [
    ('-20*x, -20*y, 0', False), ('0, 0, 0.01*max(0, 1 - abs(t - 0.5)/0.1)', True)])
def test_only_changes_in_time_end_steps(text, ends_steps):
    """Loads of place alone leave many steps to each call of a kernel."""
    simulation = ico.compile_scene(scene_with({
        'loads.w.group': 'all', 'loads.w.expression': text}))
    trajectory = simulation._driver.trajectory
    assert (trajectory.changing is not None) is ends_steps
