# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Implicit steps: their order, momenta, tolerance where damping is stiff, and the same bits."""

from fabrics import BOTH_FORMS
import icofabric_sim as ico
from icofabric_sim.geometry.rotations import rotate_quaternions
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.model.velocity_matrix import VelocityMatrix
from icofabric_sim.simulation.stepping.thread_team import teams_of
from icofabric_sim.statics.fabric import Configuration, StaticFabric
import numpy as np
import pytest

FABRIC = {
    'weave': {'size': [3, 3, 3]},
    'contact': {'mode': 'never'},
    'initial_random': {'velocity_sigma': 0.05, 'spin_sigma': 2.0, 'seed': 3},
}
# Beside a critical damping of about 4 N s/m.
STIFF = {**FABRIC, 'connector': {'damping': 4000.0}}
EVERYTHING = {
    'weave': {'size': [3, 3, 3]},
    'contact': {'mode': 'never'},
    'gravity': [0.0, 0.0, -9.81],
    'groups': {'top': 'z_max', 'low': 'z_min'},
    'supports': {'hold': {'group': 'top'}},
    'drives': {'pull': {'group': 'low', 'motion': 'velocity', 'linear': [0.02, 0.0, 0.0]}},
    'connector': {
        'damping': 100.0, 'stiffness_extension': 500.0, 'stiffness_compression': 400.0,
        'bending_stiffness': 1e-3, 'twisting_stiffness': 1e-3},
    'drag': {'linear': 0.01, 'angular': 1e-6},
}


def run(scene, method, time, *, step=0.0, tolerance=1e-6, form='quaternion'):
    simulation = ico.compile_scene(ico.Scene.from_parameters({
        **scene, 'solver': {'method': method, 'step': step, 'tolerance': tolerance}}),
        rotation=form)
    simulation.advance_to(time)
    assert simulation.status.method_name == method or method == 'auto'
    return simulation


def distance(one, other, edge=0.02):
    """Largest difference of places over a, and of orientations [rad]."""
    sign = np.sign((one.orientation * other.orientation).sum(axis=1, keepdims=True))
    return max(
        np.abs(one.position - other.position).max() / (0.5 * edge),
        2.0 * np.linalg.norm(one.orientation - sign * other.orientation, axis=1).max())


def bits(simulation):
    snapshot = simulation.snapshot()
    return [getattr(snapshot, name).tobytes() for name in (
        'position', 'orientation', 'linear_velocity', 'angular_velocity')]


@pytest.mark.parametrize('form', BOTH_FORMS)
def test_order_is_four(form):
    exact = run(FABRIC, 'dop8', 0.04, tolerance=1e-10).snapshot()
    errors = [
        distance(run(FABRIC, 'sdirk4', 0.04, step=step, form=form).snapshot(), exact)
        for step in (1e-3, 5e-4, 2.5e-4)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert errors[-1] < 1e-4 and (orders > 3.7).all() and (orders < 4.4).all()


def test_momentum_stays_to_rounding_and_angular_momentum_within_the_order():
    found = []
    for step in (1e-3, 5e-4):
        simulation = run(FABRIC, 'sdirk4', 0.0, step=step)
        before = simulation.snapshot()
        simulation.advance_to(0.05)
        after = simulation.snapshot()
        momenta = [s.linear_velocity.sum(axis=0) for s in (before, after)]
        scale = np.abs(before.linear_velocity).sum()
        assert np.abs(after.position - before.position).max() > 1e-4
        assert np.abs(momenta[1] - momenta[0]).max() < 1e-13 * scale
        found.append(np.abs(angular(simulation, after) - angular(simulation, before)).max())
    assert found[0] > 8.0 * found[1]


def angular(simulation, snapshot):
    """Angular momentum over the mass of a body [m^2/s]."""
    shell = simulation.scene.shell
    return (np.cross(snapshot.position, snapshot.linear_velocity).sum(axis=0)
            + shell.inertia / shell.mass * snapshot.angular_velocity.sum(axis=0))


@pytest.mark.parametrize('tolerance', [
    1e-5, *(pytest.param(value, marks=pytest.mark.long) for value in (1e-3, 1e-7))])
def test_the_tolerance_is_kept_where_damping_is_stiff(tolerance):
    duration = 0.02
    exact = run(STIFF, 'dop8', duration, tolerance=1e-10)
    implicit = run(STIFF, 'sdirk4', duration, tolerance=tolerance)
    error = distance(implicit.snapshot(), exact.snapshot())
    assert error < tolerance * duration
    assert error < 3.0 * implicit.status.error_estimate
    assert implicit.status.step_count < exact.status.step_count / 4.0
    # Nearly all of the energy that connectors resist is gone, and accounted for.
    assert exact.snapshot().energy['dissipated'] > 0.0
    assert implicit.snapshot().energy['dissipated'] == pytest.approx(
        exact.snapshot().energy['dissipated'], rel=1e-2)


@pytest.mark.long
def test_everything_that_it_integrates():
    exact = run(EVERYTHING, 'dop8', 0.05, tolerance=1e-9)
    implicit = run(EVERYTHING, 'sdirk4', 0.05, tolerance=1e-5)
    assert np.abs(exact.snapshot().linear_velocity).max() > 0.01
    assert distance(implicit.snapshot(), exact.snapshot()) < 1e-5 * 0.05


def test_states_within_a_step_are_as_good_as_its_end():
    exact, implicit = (run(STIFF, 'dop8', 0.0, tolerance=1e-9), run(
        STIFF, 'sdirk4', 0.0, tolerance=1e-5))
    for time in np.linspace(1e-3, 0.02, 40):
        exact.advance_to(time)
        implicit.advance_to(time)
        assert distance(implicit.snapshot(), exact.snapshot()) < 1e-5 * 0.02
    assert implicit.status.step_count < 4000


def test_a_step_that_cannot_be_solved_shows_no_state():
    """Neither at its end nor within it; the last good state is there."""
    fast = {**FABRIC, 'initial_random': {'velocity_sigma': 20.0, 'spin_sigma': 2.0, 'seed': 3},
            'connector': {'bending_stiffness': 1e-3, 'twisting_stiffness': 1e-3},
            'solver': {'method': 'sdirk4', 'step': 0.2}}
    for time in (0.08, 0.5):
        simulation = ico.compile_scene(ico.Scene.from_parameters(fast))
        simulation.warm_up()
        start = simulation.snapshot().position
        with pytest.raises(ico.SimulationError, match='a smaller solver.step'):
            simulation.advance_to(time)
            simulation.snapshot()
        assert simulation.time == 0.0
        assert (simulation.snapshot().position == start).all()


def test_pieces_and_checkpoints_give_the_same_bits():
    whole, pieces = run(STIFF, 'sdirk4', 0.03), run(STIFF, 'sdirk4', 0.0)
    for time in (0.001, 0.0047, 0.0123, 0.02):
        pieces.advance_to(time)
        pieces.snapshot()
    kept = pieces.checkpoint()
    pieces.advance_to(0.03)
    assert bits(pieces) == bits(whole)
    restored = run(STIFF, 'sdirk4', 0.0)
    restored.restore(kept)
    restored.advance_to(0.03)
    assert bits(restored) == bits(whole)


def test_one_thread_takes_them_whatever_is_asked_for():
    """A second one would wait at the first barrier for ever."""
    alone = run(FABRIC, 'sdirk4', 0.01)
    with teams_of(2):
        beside = run(FABRIC, 'sdirk4', 0.01)
    assert beside.status.thread_count == 1 and beside.status.step_count > 0
    assert bits(alone) == bits(beside)


# Damped far beyond the critical, and pressed together by planes from the start.
PRESSED = {
    'weave': {'size': [3, 3, 3], 'connector_angle': -0.3},
    'contact': {'mode': 'auto', 'stiffness': 4e4},
    'connector': {'damping': 200.0, 'bending_stiffness': 1e-3, 'twisting_stiffness': 1e-3},
    'planes': {
        'floor': {'normal': [0.0, 0.0, 1.0], 'offset': -0.0162},
        'wall': {'normal': [1.0, 0.0, 0.0], 'offset': -0.0163}},
    'groups': {'far': 'x_max'},
    'loads': {'push': {'group': 'far', 'frame': 'world', 'force': [-2.0, 0.3, -1.0]}},
}


@pytest.mark.parametrize('tolerance', [1e-2, pytest.param(1e-3, marks=pytest.mark.long)])
def test_the_tolerance_is_kept_where_shells_touch(tolerance):
    """For as long as errors do not grow: later bounces make them a hundred times as large."""
    duration = 0.01
    exact = run(PRESSED, 'dop8', duration, tolerance=1e-7)
    assert len(exact.contacts().bodies) > 3
    implicit = run(PRESSED, 'sdirk4', duration, tolerance=tolerance)
    error = distance(implicit.snapshot(), exact.snapshot())
    assert 0.0 < error < tolerance * duration
    assert implicit.status.step_count < 0.1 * exact.status.step_count
    assert implicit.balance.error_in_parts < 0.01


def test_momenta_stay_where_shells_touch():
    """Momentum to rounding, angular momentum within the order of the method."""
    crowded = {
        **{name: value for name, value in PRESSED.items() if name not in ('planes', 'loads')},
        'weave': {'size': [3, 3, 3], 'connector_angle': -0.36},
        'initial_random': {'velocity_sigma': 0.05, 'spin_sigma': 5.0, 'seed': 3}}
    turned = []
    for tolerance in (1e-2, 1e-4):
        simulation = run(crowded, 'sdirk4', 0.0, tolerance=tolerance)
        start, met = simulation.snapshot(), 0
        for time in (0.001, 0.002, 0.003):
            simulation.advance_to(time)
            met += len(simulation.contacts().bodies)
        end = simulation.snapshot()
        speed = np.abs(start.linear_velocity).max()
        assert met > 10
        assert np.abs((end.linear_velocity - start.linear_velocity).sum(axis=0)).max() < (
            1e-12 * speed)
        turned.append(np.abs(angular(simulation, end) - angular(simulation, start)).max()
                      / np.abs(angular(simulation, start)).max())
    assert turned[1] < 0.1 * turned[0] < 1e-3


def test_where_contacts_are_looked_for_changes_no_bit():
    """Nor do pieces and a checkpoint on the way."""
    end, loose = 0.004, {'tolerance': 1e-3}
    runs = [run({**PRESSED, 'contact': {**PRESSED['contact'], 'mode': mode}}, 'sdirk4', end,
                **loose) for mode in ('auto', 'always')]
    assert len(runs[0].contacts().bodies) > 3 and bits(runs[0]) == bits(runs[1])
    pieces, restored = (run(PRESSED, 'sdirk4', 0.0, **loose) for _ in range(2))
    for time in (0.0007, 0.0021):
        pieces.advance_to(time)
        pieces.snapshot()
    restored.restore(pieces.checkpoint())
    for simulation in (pieces, restored):
        simulation.advance_to(end)
        assert bits(simulation) == bits(runs[0])


@pytest.mark.parametrize('form', ['quaternion', 'direction_cosines'])
def test_the_matrix_knows_what_touches(form):
    """It is 1 + g^2 M^-1/2 H M^-1/2, with the H that statics has."""
    scene = ico.Scene.from_parameters({
        **PRESSED, 'connector': {'stiffness': 300.0}, 'weave': {
            'size': [3, 3, 3], 'connector_angle': -0.3648},
        'masses': {'heavy': {'group': 'far', 'mass': 0.05}}})
    rng = np.random.default_rng(1)
    shift, turn = (size * rng.normal(size=(scene.body_count, 3)) for size in (2e-4, 2e-2))
    position, orientation = (
        scene.initial.position + shift, rotate_quaternions(turn, scene.initial.orientation))
    packed, g = pack_scene(scene, cosines=form == 'direction_cosines'), 1e-3
    held = np.zeros((scene.body_count, 6), bool)
    held[0] = True
    motion = rng.normal(size=held.shape)
    motion[held] = 0.0
    state = packed.layout.pack(scene.initial._replace(position=position, orientation=orientation))
    work = packed.layout.room(packed.model.links)
    place_all(packed.model, state, work, 0, len(packed.layout.blocks.slot))
    factors = VelocityMatrix(packed, scene.weave.grid, held).factors(
        packed.model, state, work.points, g)
    here = Configuration(StaticFabric(scene), position, orientation)
    assert len(here.contact_blocks[0]) > 10 and (here.contact_state.planes[0].size > 0)
    masses = np.column_stack([scene.masses.mass, scene.masses.inertia])
    root = np.repeat(masses, 3, axis=1) ** -0.5
    assert np.ptp(root[:, 0]) > 1.0

    def changed(pairs):
        return motion + g * g * root * np.where(held, 0.0, here.times(root * motion, pairs=pairs))

    def found(right):
        return factors.solve(right.ravel()).reshape(motion.shape)

    assert found(changed(True)) == pytest.approx(motion, abs=1e-8)
    # The forces of contacts are no small part of it.
    assert np.abs(found(changed(False)) - motion).max() > 0.1


def test_auto_takes_them_where_damping_is_far_beyond_the_vibrations():
    for damping, method in ((0.5, 'dop8'), (4000.0, 'sdirk4')):
        simulation = run(
            {**FABRIC, 'connector': {'damping': damping}}, 'auto', 0.0, tolerance=1e-4)
        assert simulation.status.method_name == method


@pytest.mark.parametrize('contact, method', [
    ({'contact': {'mode': 'auto'}}, 'sdirk4'),
    ({'contact': {'mode': 'auto', 'damping': 1.0}}, 'dop8'),
    # What bounces on a floor so hard has to be followed.
    ({'contact': {'mode': 'auto', 'stiffness': 1e15},
      'planes': {'floor': {'normal': [0.0, 0.0, 1.0], 'offset': -0.1}}}, 'dop8'),
    ({'contact': {'mode': 'auto', 'stiffness': 1e4},
      'planes': {'floor': {'normal': [0.0, 0.0, 1.0], 'offset': -0.1}}}, 'sdirk4')])
def test_auto_minds_contacts_that_are_expected(contact, method):
    simulation = run(
        {**FABRIC, 'connector': {'damping': 4000.0}, **contact}, 'auto', 0.0, tolerance=1e-4)
    assert simulation.status.method_name == method


@pytest.mark.parametrize('changes, named', [
    ({'contact': {'mode': 'auto', 'damping': 1.0}}, 'contact.damping'),
    ({'contact': {'mode': 'always', 'friction': 0.1}}, 'contact.friction'),
    ({'connector': {'obstruction': 'wrap'}}, 'connector.obstruction is wrap'),
    ({'connector': {'break_length_extension': 0.1}}, 'connectors that break'),
    ({'charge': {'per_body': 1e-9}}, 'charge.per_body'),
])
def test_what_they_cannot_follow_is_refused_by_name(changes, named):
    with pytest.raises(ValueError, match=named) as error:
        run({**FABRIC, **changes}, 'sdirk4', 0.0)
    assert 'solver.method sdirk4' in str(error.value) and 'take dop8' in str(error.value)
