# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Planes that move on prescribed paths, and shells and slabs that they push."""

from contact_scenes import A, loose
from fabrics import same_state
import icofabric_sim as ico
from icofabric_sim import contact
from icofabric_sim.geometry.icosahedron import FACES, inscribed_radius, vertices
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.devices import refusals
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

RHO = inscribed_radius(A)
# A face down.
FACE_DOWN = Rotation.align_vectors([[0.0, 0.0, -1.0]], [vertices(1.0)[FACES[0]].mean(axis=0)])[0]
GRAVITY = 9.81
SINK = 1e-5  # [m] overlap at the start


def on_plane(motion, *, method='dop8', **changes):
    """A shell with a face on a plane that moves."""
    return loose(**{
        'groups.one': 'all', 'initial.one.group': 'one',
        'initial.one.rotation': FACE_DOWN.as_rotvec().tolist(),
        'gravity': [0.0, 0.0, -GRAVITY], 'solver.method': method,
        'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': SINK - RHO,
        **{f'planes.floor.{name}': value for name, value in motion.items()}, **changes})


LIFT = {'motion': 'ramp', 'linear': [0.0, 0.0, 0.5], 'duration': 0.5}
LOSSES = {'contact.damping': 50.0, 'contact.friction': 0.3}


def test_a_shell_on_a_plane_that_accelerates_upward_feels_its_weight_and_inertia():
    simulation = ico.compile_scene(on_plane(LIFT, **LOSSES))
    mass = simulation.scene.shell.mass
    for time in (0.1, 0.3, 0.48):
        simulation.advance_to(time)
        reactions, energy = simulation.reactions(), simulation.snapshot().energy
        assert reactions.names == ('planes.floor',)
        assert reactions.force[0] == pytest.approx([0.0, 0.0, mass * (GRAVITY + 1.0)], abs=1e-9)
        assert reactions.point[0] == pytest.approx([0.0, 0.0, SINK - RHO + 0.5 * time**2])
        # The work of the plane, from the force and its displacement.
        assert energy['work_in'] == pytest.approx(mass * (GRAVITY + 1.0) * 0.5 * time**2, rel=3e-3)
    assert simulation.balance.worst < 1e-9


@pytest.mark.parametrize('method', ['dop8', 'leapfrog'])
def test_friction_drags_a_shell_on_a_plane_that_slides(method):
    """The motion of a shell on a sliding plane is that of a sliding shell on a plane at rest."""
    speed, step = 0.3, 2e-7 if method == 'leapfrog' else 0.0
    slide = {**LOSSES, 'solver.step': step, 'method': method}
    moving = ico.compile_scene(on_plane(
        {'motion': 'velocity', 'linear': [speed, 0.0, 0.0]}, **slide))
    still = ico.compile_scene(on_plane({}, **{
        'initial.one.linear_velocity': [-speed, 0.0, 0.0]}, **slide))
    times = (0.01, 0.02, 0.04)
    for time in times if method == 'dop8' else times[:1]:
        moving.advance_to(time)
        still.advance_to(time)
        one, other = moving.snapshot(), still.snapshot()
        shift = np.array([speed * time, 0.0, 0.0])
        assert one.position - shift == pytest.approx(other.position, abs=1e-12)
        assert one.orientation == pytest.approx(other.orientation, abs=1e-9)
        assert moving.reactions().force == pytest.approx(still.reactions().force, abs=1e-6)
        assert one.energy['dissipated'] == pytest.approx(other.energy['dissipated'], rel=1e-8)
    if method == 'dop8':
        # On average the normal force is the weight.
        assert one.linear_velocity[0, 0] == pytest.approx(0.3 * GRAVITY * 0.04, rel=2e-3)
    # The impulse of a plane with constant velocity, times that velocity.
    work = speed * moving.scene.shell.mass * one.linear_velocity[0, 0]
    near = {'dop8': 1e-9, 'leapfrog': 1e-6}[method]
    assert one.energy['work_in'] == pytest.approx(work, rel=near)
    assert moving.balance.worst < {'dop8': 1e-9, 'leapfrog': 1e-5}[method]


def test_a_platen_that_vibrates_moves_a_shell_as_a_separate_integration_says():
    # Friction has no effect, because nothing slips.
    amplitude, frequency, stiffness = 2e-5, 40.0, 2e4
    scene = on_plane({
        'motion': 'sine', 'linear': [0.0, 0.0, amplitude], 'frequency': frequency},
        **{'contact.stiffness': stiffness, 'contact.friction': 0.3, 'solver.tolerance': 1e-9})
    simulation, mass = ico.compile_scene(scene), scene.shell.mass
    turned = FACE_DOWN.as_quat()

    def rates(time, y):
        offset = SINK - RHO + amplitude * np.sin(2.0 * np.pi * frequency * time)
        force = contact.plane_contact_force(
            A, [0.0, 0.0, 1.0], offset, ([0.0, 0.0, y[0]], turned), stiffness).force[2]
        return [y[1], force / mass - GRAVITY]

    times = np.array([0.007, 0.014, 0.02])
    expected = solve_ivp(
        rates, (0.0, times[-1]), [0.0, 0.0], t_eval=times, method='DOP853', rtol=1e-10,
        atol=1e-14, max_step=1e-4)
    for time, height, speed in zip(times, *expected.y):
        simulation.advance_to(time)
        snapshot = simulation.snapshot()
        assert snapshot.position[0, 2] == pytest.approx(height, abs=1e-9)
        assert snapshot.linear_velocity[0, 2] == pytest.approx(speed, abs=1e-6)
    assert np.abs(expected.y[1]).max() > 1e-3 and simulation.balance.worst < 1e-8


PRESS = {
    'weave.size': [3, 3, 3], 'weave.connector_angle': 0.3, 'connector.stiffness': 200.0,
    'connector.damping': 0.2, 'contact.friction': 0.3, 'solver.method': 'dop8',
    'solver.tolerance': 1e-5,
    'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.0163,
    'planes.floor.motion': 'hold', 'planes.press.normal': [0.0, 0.0, -1.0],
    'planes.press.offset': -0.11, 'planes.press.motion': 'ramp',
    'planes.press.linear': [0.02, 0.0, -0.1], 'planes.press.duration': 0.02}


def press(**changes):
    return ico.Scene.from_parameters({**PRESS, **changes})


def momentum(simulation):
    return simulation.scene.shell.mass * simulation.snapshot().linear_velocity.sum(axis=0)


def test_a_slab_between_platens_balances_their_forces_and_their_work():
    simulation, impulse, step = ico.compile_scene(press()), np.zeros(3), 2e-4
    start = simulation.snapshot().energy['total']
    most = 0.0
    for number in range(300):
        # The impulse of both platens is the momentum of the slab.
        simulation.advance_to((number + 0.5) * step)
        force = simulation.reactions().force
        impulse += step * force.sum(axis=0)
        most = max(most, np.abs(force).max())
    simulation.advance_to(300 * step)
    energy = simulation.snapshot().energy
    assert force[0, 2] > 0.05 and force[1, 2] < -0.05 and abs(force[1, 0]) > 0.01
    assert momentum(simulation) == pytest.approx(impulse, abs=2e-3 * most * 300 * step)
    assert energy['dissipated'] > 1e-5 and energy['work_in'] == pytest.approx(
        energy['total'] - start + energy['dissipated'], rel=1e-6)
    assert simulation.balance.worst < 1e-5


def test_pieces_checkpoints_threads_and_listing_do_not_change_bits():
    whole = ico.compile_scene(press())
    whole.advance_to(0.03)
    pieces = ico.compile_scene(press(**{'contact.mode': 'always', 'solver.threads': 2}))
    checkpoints = []
    for time in np.linspace(0.0, 0.03, 14):
        pieces.advance_to(time)
        pieces.snapshot()
        checkpoints.append(pieces.checkpoint())
    assert same_state(whole.snapshot(), pieces.snapshot())
    assert whole.reactions().force[1, 2] < -0.01
    for checkpoint in checkpoints[5::4]:
        again = ico.compile_scene(press(**{'contact.mode': 'always'}))
        again.restore(Checkpoint.from_bytes(checkpoint.to_bytes()))
        again.advance_to(0.03)
        assert same_state(again.snapshot(), whole.snapshot())
        assert again.checkpoint().difference(pieces.checkpoint()) == ''


def test_a_plane_that_twists_move_is_one_on_a_path():
    path = ico.compile_scene(on_plane({
        'motion': 'velocity', 'linear': [0.1, 0.0, 0.05], 'start': 0.01, 'duration': 0.02},
        **LOSSES))
    live = ico.compile_scene(on_plane({'motion': 'hold'}, **LOSSES))
    live.move_plane('floor', [0.1, 0.0, 0.05], time=0.01)
    live.move_plane('floor', [0.0, 0.0, 0.0], time=0.03)
    for simulation in (path, live):
        simulation.advance_to(0.04)
    assert live.snapshot().position == pytest.approx(path.snapshot().position, abs=1e-12)
    assert live.reactions().point[0] == pytest.approx([0.002, 0.0, SINK - RHO + 0.001])
    live.reset_time()
    assert live.reactions().point[0] == pytest.approx([0.0, 0.0, SINK - RHO])


def test_a_fast_plane_is_detected_before_it_reaches_shells_at_rest():
    simulation = ico.compile_scene(on_plane(
        {'offset': -0.2, 'motion': 'velocity', 'linear': [0.0, 0.0, 2.0]},
        **{'gravity': [0.0, 0.0, 0.0], 'contact.friction': 0.3}))
    simulation.advance_to(0.12)
    # Elastic: the shell leaves with twice the speed of the plane.
    energy = simulation.snapshot().energy
    assert energy['contact'] == 0.0
    assert simulation.snapshot().linear_velocity[0] == pytest.approx([0.0, 0.0, 4.0], abs=1e-6)
    # Work is the impulse times the velocity of the plane.
    assert energy['work_in'] == pytest.approx(energy['kinetic'], rel=1e-8)
    assert energy['work_in'] == pytest.approx(2.0 * momentum(simulation)[2], rel=1e-8)


def test_statics_hold_planes_at_their_place_at_a_time():
    """A shell between two platens, which squeeze its opposite faces by 2e-5 m in all."""
    stiffness, lower = 2e5, 0.1 * (0.01 + 0.01)
    scene = on_plane({}, **{
        'gravity': [0.0, 0.0, 0.0], 'contact.stiffness': stiffness,
        'planes.floor.offset': -RHO, 'planes.press.normal': [0.0, 0.0, -1.0],
        'planes.press.offset': -RHO - lower + 2e-5, 'planes.press.motion': 'ramp',
        'planes.press.linear': [0.02, 0.0, -0.1], 'planes.press.duration': 0.02})
    with pytest.raises(ValueError, match='planes.press.motion: changes with time'):
        ico.solve_equilibrium(scene)
    found = ico.solve_equilibrium(scene, time=0.03)
    expected = contact.plane_contact_force(
        A, [0.0, 0.0, 1.0], -RHO, ([0.0, 0.0, -1e-5], FACE_DOWN.as_quat()), stiffness).force
    assert found.converged and expected[2] > 0.1
    assert found.snapshot.position[0, 2] == pytest.approx(-1e-5, abs=1e-12)
    assert found.reactions.force == pytest.approx(np.array([expected, -expected]), rel=1e-6)
    assert found.reactions.point[1] == pytest.approx([0.02 * 0.02, 0.0, RHO - 2e-5])


def test_refusals_name_the_plane():
    scene = press()
    with pytest.raises(ParameterError, match='planes.floor.motion hold is not shared by ranks'):
        refusals.require_shareable(scene, cosines=False, body_force=False)
    with pytest.raises(ParameterError, match='planes.floor moves'):
        ico.compile_scene(press(**{
            'solver.method': 'sdirk4', 'contact.friction': 0.0, 'connector.damping': 0.0}))
    for changes, said in (
            ({'planes.press.motion': 'fixed'}, 'planes.press.linear .* is fixed: leave it out'),
            ({'planes.press.duration': 0.0}, 'planes.press.duration must be above 0 s'),
            ({'planes.press.motion': 'table'}, 'planes.press.linear must be zero')):
        with pytest.raises(ParameterError, match=said):
            press(**changes)
    simulation = ico.compile_scene(on_plane({}))
    with pytest.raises(ValueError, match='planes.floor.motion is fixed: choose hold'):
        simulation.move_plane('floor', [0.0, 0.0, 1.0])
    with pytest.raises(ValueError, match='no movable plane .roof.; known: none'):
        simulation.move_plane('roof', [0.0, 0.0, 1.0])
