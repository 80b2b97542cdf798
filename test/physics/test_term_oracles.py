# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Every conservative term against the complex step, and in other units of length, mass and time.

The energies are written down here once more, for complex numbers: the imaginary part of
E(x + i h dx) over h is its derivative to the last bits, without a difference (Squire and Trapp
1998, SIAM Rev. 40, 110).
"""

from analytical import quaternion_product, rotation_quaternion
from fabrics import make_scene, packed_state, same_state, wrenches
import icofabric_sim as ico
from icofabric_sim.kernels.loads import kick_row, NONE
from icofabric_sim.simulation.inputs.inputs import Inputs
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.stepping import thread_team
import numpy as np
import pytest
from references import axes_of

COULOMB = 8.9875517862e9  # 1 / (4 pi eps_0) [N m^2/C^2], CODATA 2022
BENT = {'connector.bending_stiffness': 0.05, 'connector.stiffness': 0.0}
TWISTED = {'connector.twisting_stiffness': 0.04, 'connector.stiffness': 0.0}
DIPOLE = {'charge.dipole': [2e-6, -1e-6, 3e-6], 'field.electric': [1e4, 2e4, -1.5e4]}
MUTUAL = {'charge.per_body': 1e-6, 'charge.mutual': True}
HOOKED = {
    'anchors.one.body': 2, 'anchors.one.edge': 'west', 'anchors.one.position': [0.1, -0.03, 0.02],
    'anchors.two.body': 2, 'anchors.two.edge': 'up', 'anchors.two.position': [0.02, 0.05, 0.15],
    'anchors.three.body': 0, 'anchors.three.edge': 'down',
    'anchors.three.position': [0.0, 0.01, -0.1]}
CASES = {
    'springs': {'connector.stiffness_compression': 170.0, 'connector.natural_length': 0.033},
    'bending': BENT, 'twisting': TWISTED, 'dipole': DIPOLE, 'mutual': MUTUAL, 'anchors': HOOKED,
    'law': {}, 'exponential': {'connector.law': 'exponential', 'connector.alpha': 90.0}}
QUIET = {'contact.mode': 'never'}
L = 0.032360679774997896
LAW = [(0.5, -1.0), (0.9, -0.7), (1.0, 0.0), (1.1, 0.6), (1.25, 3.0), (1.4, 7.0), (1.6, 7.2)]


def law_file(folder, length=1.0, force=1.0):
    path = folder / 'law.csv'
    path.write_text(''.join(f'{x * L * length!r}, {f * force!r}\n' for x, f in LAW))
    return str(path)


def disturbed(scene, amplitude=0.6, seed=1):
    generator = np.random.default_rng(seed)
    shape = (scene.body_count, 3)
    shift = 0.15 * scene.geometry.cube_width * generator.standard_normal(shape)
    turn = rotation_quaternion(amplitude * generator.standard_normal(shape))
    return scene.position + shift, quaternion_product(turn, scene.orientation)


def length_of(vector):
    """Without the conjugate of np.linalg.norm."""
    return np.sqrt((vector * vector).sum())


def spring(length, extension, compression, rest):
    k = extension if length.real > rest else compression
    return 0.5 * k * (length - rest) ** 2


def energy(scene, position, axes):
    """Of all its terms [J], for complex positions (n, 3) and rows of axes (n, 3, 3)."""
    c, parameters, total = scene.connectors, scene.parameters, 0.0
    woven = axes_of(scene.orientation)
    laws = np.broadcast_arrays(*c.laws, c.bending_stiffness, c.twisting_stiffness, np.zeros(
        len(c)))
    for number, (pair, points) in enumerate(zip(c.bodies, c.points_body)):
        ends, rest = (
            [x[body] + point @ turn[body] for body, point in zip(pair, points)]
            for x, turn in ((position, axes), (scene.position, woven)))
        u, n = ends[1] - ends[0], rest[1] - rest[0]
        length = length_of(u)
        extension, compression, natural, bending, twisting, _ = (row[number] for row in laws)
        if parameters['connector.law'] == 'exponential':
            x = parameters['connector.alpha'] * (length - natural)
            total += extension / parameters['connector.alpha'] ** 2 * (np.exp(x) - 1.0 - x)
        elif c.curves.curves:
            table = c.curves.curves[c.curves.of[number]]
            row = table.rows[np.searchsorted(table.rows[1:, 0], length.real)]
            t = length - row[1]
            total += row[6] + t * (row[2] + t * (
                row[3] / 2.0 + t * (row[4] / 3.0 + t * row[5] / 4.0)))
        else:
            total += spring(length, extension, compression, natural)
        first, second = (axes[body].T @ woven[body] for body in pair)
        n = n / np.linalg.norm(n)
        total += bending * (2.0 - (u / length) @ (first @ n) - (u / length) @ (second @ n))
        total += 0.5 * twisting * (3.0 - np.trace(second @ first.T))
    dipole, field = np.array(parameters['charge.dipole']), np.array(parameters['field.electric'])
    total -= sum((dipole @ turn) @ field for turn in axes)
    if parameters['charge.mutual']:
        strength = COULOMB * parameters['charge.per_body'] ** 2
        for i in range(scene.body_count):
            for j in range(i):
                total += strength / length_of(position[i] - position[j])
    for name, anchor in scene.anchors.items():
        end = position[anchor.body] + anchor.arm @ axes[anchor.body]
        point = np.array(parameters[f'anchors.{name}.position'])
        total += spring(length_of(point - end), *anchor.law)
    return total


def with_anchors(scene, position, orientation):
    """Forces and torques of everything, those of anchors too, (n, 3) each."""
    work = wrenches(scene, position, orientation)
    if not scene.anchors:
        return work.force, work.torque
    packed = pack_scene(scene)
    model, state = packed.model, packed_state(packed, position, orientation)
    loads = Inputs(scene).pack(packed.layout)
    for block in range(len(model.blocks.slot)):
        for row in range(loads.start[block], loads.start[block + 1]):
            kick_row(
                model, loads, state, row, int(model.blocks.slot[block]), 0.0, 1.0, NONE, 1.0)
    return (
        work.force + scene.shell.mass * packed.layout.gather(state.linear_velocity),
        work.torque + scene.shell.inertia * packed.layout.gather(state.angular_velocity))


@pytest.mark.parametrize('name', CASES)
def test_wrench_is_the_complex_step_of_the_energy(name, tmp_path):
    changes = dict(CASES[name])
    if name == 'law':
        changes['connector.law'] = law_file(tmp_path)
    scene = make_scene((3, 3, 2), {**QUIET, **changes})
    position, orientation = disturbed(scene)
    axes = axes_of(orientation)
    force, torque = with_anchors(scene, position, orientation)
    generator, h = np.random.default_rng(7), 1e-30
    moved = 0.0
    for _ in range(6):
        shift = scene.geometry.half_edge * generator.standard_normal((scene.body_count, 3))
        turn = generator.standard_normal((scene.body_count, 3))
        # de_i = dtheta x e_i.
        turned = axes + 1j * h * np.cross(turn[:, None, :], axes)
        wanted = -energy(scene, position + 1j * h * shift, turned).imag / h
        found = (force * shift).sum() + (torque * turn).sum()
        size = np.abs(force * shift).sum() + np.abs(torque * turn).sum()
        assert abs(found - wanted) < 2e-13 * size
        moved += size
    assert moved > 0.01


def scaled(values, length, mass, time, law):
    """Parameters in other units: by powers of length, mass and time, (value, l, m, t) each."""
    changes = {
        name: (np.array(value) * length**a * mass**b * time**c).tolist()
        for name, (value, a, b, c) in values.items()}
    if law:
        changes['connector.law'] = law
    return changes


# Charges have the unit sqrt(k L^3): powers of two where the others are powers of four.
DIMENSIONED = {
    'shell.edge_length': (0.02, 1, 0, 0), 'shell.thickness': (0.002, 1, 0, 0),
    'shell.mass': (0.011, 0, 1, 0), 'shell.inertia': (1.7e-6, 2, 1, 0),
    'connector.bending_stiffness': (0.05, 2, 1, -2),
    'connector.twisting_stiffness': (0.04, 2, 1, -2), 'charge.per_body': (1e-6, 1.5, 0.5, -1),
    'charge.dipole': ([2e-6, -1e-6, 3e-6], 2.5, 0.5, -1),
    'field.electric': ([1e4, 2e4, -1.5e4], -0.5, 0.5, -1)}


@pytest.mark.parametrize(('length', 'mass', 'time'), [
    (4.0**-3, 1.0, 1.0), (1.0, 4.0**4, 1.0), (1.0, 1.0, 4.0**2), (4.0**5, 4.0**-7, 4.0**-3)])
@pytest.mark.parametrize('tabled', [False, pytest.param(True, marks=pytest.mark.long)])
def test_units_by_powers_of_four_give_the_same_bits(length, mass, time, tabled, tmp_path):
    results = []
    force = length * mass / time**2
    for units in ((1.0, 1.0, 1.0), (length, mass, time)):
        l, m, t = units
        law = law_file(tmp_path, l, l * m / t**2) if tabled else ''
        values = dict(DIMENSIONED)
        if not tabled:
            values['connector.stiffness_extension'] = (500.0, 0, 1, -2)
            values['connector.stiffness_compression'] = (170.0, 0, 1, -2)
        scene = make_scene((3, 3, 2), {
            **QUIET, 'charge.mutual': True, **scaled(values, l, m, t, law)})
        position, orientation = disturbed(scene)
        work = wrenches(scene, position, orientation)
        results.append((position, work.force, work.torque))
    (x, f, n), (y, g, k) = results
    assert np.array_equal(x * length, y)
    assert np.array_equal(f * force, g) and np.array_equal(n * force * length, k)
    assert np.abs(f).max() > 0.1


def everything(a, law):
    """Many terms at once, in units of the half edge a and a stiffness k; masses are 2e-5 s^2 k."""
    k = 500.0 if a < 0.1 else 9e4
    unit = 2e-5 * k
    return {
        **QUIET, 'shell.edge_length': 2.0 * a, 'shell.thickness': 0.2 * a, 'shell.mass': unit,
        'connector.stiffness_extension': k, 'connector.stiffness_compression': 0.6 * k,
        'connector.bending_stiffness': 0.1 * k * a * a, 'gravity': [0.0, 3.0 * a, -50.0 * a],
        'connector.twisting_stiffness': 0.05 * k * a * a,
        'charge.dipole': [1e-6, 0.0, 2e-6], 'field.electric': [0.0, 1e5 * k * a * a, 0.0],
        'anchors.hook.body': 3, 'anchors.hook.edge': 'up',
        'anchors.hook.position': [3.0 * a, 3.0 * a, 18.0 * a],
        'groups.tip': 'x_max', 'loads.tip.group': 'tip', 'loads.tip.profile': 'half_sine',
        'loads.tip.force': [0.0, 0.02 * k * a, 0.0], 'loads.tip.duration': 0.02,
        'tractions.air.group': 'tip', 'tractions.air.faces': 'all',
        'tractions.air.pressure': 0.01 * k / a, 'connector_groups.soft.between': 'tip tip',
        'connector_groups.soft.law': law, 'initial_random.velocity_sigma': 3.0 * a,
        'initial_random.spin_sigma': 5.0, 'solver.step': 1e-4}


def spent(a, law):
    """The same for what needs dop8: damping, drag, a magnetic field, a drive, breakage."""
    values = everything(a, law)
    k = values['connector.stiffness_extension']
    return {
        **values, 'solver.method': 'dop8', 'connector.damping': 1e-4 * k,
        'drag.linear': 1e-5 * k, 'drag.angular': 1e-5 * k * a * a,
        'field.magnetic': [0.0, 300.0, 100.0], 'charge.per_body': 1e-6 * k,
        'field.electric': [0.0, 1e5 * a, 0.0], 'charge.dipole': [0.0, 0.0, 1e-6 * k * a],
        'groups.low': 'ids 0', 'drives.shake.group': 'low', 'drives.shake.motion': 'sine',
        'drives.shake.linear': [0.0, 0.0, 0.2 * a], 'drives.shake.frequency': 20.0,
        'connector.break_length_extension': 4.0 * a}


@pytest.mark.long
@pytest.mark.parametrize(('terms', 'method'), [(everything, 'srkn4'), (spent, 'dop8')])
def test_a_fabric_of_millimetres_moves_like_one_of_metres(terms, method, tmp_path):
    ends = []
    for a in (1e-3, 1.0):
        k = 500.0 if a < 0.1 else 9e4
        scene = make_scene((3, 3, 3), {
            **terms(a, law_file(tmp_path, 100.0 * a, k * a)), 'solver.method': method})
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.03)
        s = simulation.snapshot()
        ends.append(np.hstack([s.position / a, s.orientation, s.linear_velocity / a]))
        moved = np.abs(s.position - scene.initial.position).max() / a
        assert moved > 0.05
        if terms is spent:
            assert s.energy['dissipated'] > 0.0
    assert np.abs(ends[0] - ends[1]).max() < 1e-10


@pytest.mark.long
def test_anchors_and_moments_with_two_threads_and_from_a_checkpoint(monkeypatch, tmp_path):
    # Of the kind of the fabric of millimetres.
    scene = make_scene((5, 5, 5), {
        **everything(1e-3, law_file(tmp_path, 0.1, 0.5)), 'anchors.hook.velocity': [
            0.0, 0.03, 0.0], 'solver.method': 'srkn4', 'solver.threads': 2,
        'initial_random.spin_sigma': 20.0})
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 20)
    ends = []
    for threads, stop in ((1, 0.0), (2, 0.0), (2, 0.0013)):
        monkeypatch.setattr(thread_team, 'core_count', lambda threads=threads: threads)
        simulation = ico.compile_scene(scene)
        assert simulation.status.thread_count == threads
        if stop:
            simulation.advance_to(stop)
            checkpoint, simulation = simulation.checkpoint(), ico.compile_scene(scene)
            simulation.restore(checkpoint)
        simulation.advance_to(0.003)
        ends.append(simulation.snapshot())
    assert same_state(ends[0], ends[1]) and same_state(ends[0], ends[2])
    assert ends[0].energy == ends[1].energy == ends[2].energy
    assert ends[0].energy['work_in'] != 0.0
