# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Friction at rest, along a path: closed forms, energies, and runs that come to rest slowly.
"""

import math
from pathlib import Path

from fabrics import changed
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import vertices
from icofabric_sim.geometry.rotations import cosines_from_quaternions, rotate_axes
from icofabric_sim.scene.weave_geometry import geometry_from_angle, MINIMUM_ANGLE
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.friction import FrictionPath, Relaxation
from icofabric_sim.statics.spectrum import scaled_hessian
from icofabric_sim.sweeps.outcomes import carry_out, make_work
import numpy as np
import pytest

MU, K = 0.5, 1e5
HALF = 0.02 * (1.0 + math.sqrt(5.0)) / 4.0
# A shell that does not turn, on a floor, tied to a wall, pulled down, and pulled along the floor.
SLIDER = {
    'weave.size': [1, 1, 1], 'contact.stiffness': K, 'contact.friction': MU, 'groups.it': 'all',
    'supports.it.group': 'it', 'supports.it.fix': 'rotation',
    'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -HALF,
    'anchors.down.edge': 'down', 'anchors.down.position': [0.0, 0.0, -10.0],
    'anchors.down.stiffness': 1.0, 'anchors.down.natural_length': 10.0 - HALF - 2.0,
    'anchors.tie.edge': 'west', 'anchors.tie.position': [0.0, -1.0, 0.0],
    'anchors.tie.stiffness': 100.0, 'anchors.tie.natural_length': 1.0 + HALF,
    'loads.along.group': 'it', 'loads.along.force': [0.0, 3.0, 0.0]}
GROOVE = {
    'weave.size': [1, 1, 1], 'contact.stiffness': K, 'contact.friction': MU, 'groups.it': 'all',
    'supports.it.group': 'it', 'supports.it.fix': 'rotation'}
PUSH = 2.0  # [N] by the anchor below


def on_path(scene, factors):
    return [found for _, found in ico.step_loads(scene, factors)]


def test_a_slider_follows_its_loop():
    """
    A spring k beside a Coulomb element mu N (Jenkins 1962): x = (F - mu N) / k on the way out.

    On the way back it stays until F has fallen by 2 mu N, then x = (F + mu N) / k. The anchor
    below adds its tension over its length to k.
    """
    scene = ico.Scene.from_parameters(SLIDER)
    factors = [0.25, 0.5, 1.0, 0.6, 0.2, 0.0]
    found = on_path(scene, factors)
    assert len(found) == 6 and all(each.converged for each in found)
    # How far the spring of friction gives way.
    give = MU * PUSH / (2.0 / 7.0 * K)
    moved = [float(each.snapshot.position[0, 1]) for each in found]
    force = [3.0 * factor for factor in factors]
    edge, stiff = MU * PUSH, 100.0 + PUSH / (10.0 - HALF)
    assert moved[0] < give and not found[0].friction.slides.any()
    for index, sign in ((1, -1.0), (2, -1.0), (4, 1.0), (5, 1.0)):
        assert moved[index] == pytest.approx((force[index] + sign * edge) / stiff, rel=1e-4)
        assert found[index].friction.slides.all()
        assert found[index].friction.force[0, 1] == pytest.approx(sign * edge, rel=1e-4)
    # Between the two it sticks where it was.
    assert abs(moved[3] - moved[2]) < 2.0 * give and not found[3].friction.slides.any()
    assert moved[5] == pytest.approx(edge / stiff, rel=1e-4)
    # The floor bears the push and what rubs.
    floor = found[2].reactions
    assert floor.names[-1] == 'planes.floor'
    assert floor.force[-1] == pytest.approx([0.0, -edge, PUSH], rel=1e-4, abs=1e-9)


@pytest.mark.long
def test_the_path_is_that_of_a_slow_run():
    """The same loop in time, slowly and with drag: the dynamics' own law of friction."""
    from pathlib import Path
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'there_and_back.csv'
        file.write_text('time,factor\n0,0\n1,1\n2,0\n4,0\n')
        scene = ico.Scene.from_parameters({
            **SLIDER, 'contact.stiffness': 1e4, 'loads.along.profile': f'table {file}',
            'drag.linear': 2.0, 'solver.tolerance': 1e-6})
        simulation = ico.compile_scene(scene)
    at_rest = ico.Scene.from_parameters({**SLIDER, 'contact.stiffness': 1e4})
    found = on_path(at_rest, [0.2, 0.4, 0.6, 0.8, 1.0, 0.75, 0.5, 0.25, 0.0])
    # What lags behind the load does so by the drag: 2 N s/m over 100 N/m.
    simulation.advance_to(4.0)
    assert simulation.snapshot().position[0, 1] == pytest.approx(
        found[-1].snapshot.position[0, 1], rel=2e-3)
    assert found[-1].snapshot.position[0, 1] > 0.009


@pytest.mark.parametrize('part, holds', [(0.98, True), (1.02, False)])
def test_an_incline_holds_up_to_the_angle_of_friction(part, holds):
    angle = part * math.atan(MU)
    scene = ico.Scene.from_parameters({
        'weave.size': [1, 1, 1], 'contact.stiffness': K, 'contact.friction': MU,
        'groups.it': 'all', 'supports.it.group': 'it', 'supports.it.fix': 'rotation',
        'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -HALF,
        'gravity': [9.81 * math.sin(angle), 0.0, -9.81 * math.cos(angle)]})
    found = on_path(scene, [0.5, 1.0])
    assert found[-1].converged == holds and (len(found) == 2 if holds else True)
    if holds:
        weight = 9.81 * scene.shell.mass
        assert found[-1].friction.force[0, 0] == pytest.approx(
            -weight * math.sin(angle), rel=1e-6)
        assert not found[-1].friction.slides.any()


def dense(friction):
    """A dense slab under pre-tension, whose faces touch."""
    length = ico.Scene.from_parameters({
        'weave.size': [3, 3, 3], 'weave.connector_angle': -0.36}).geometry.connector_length
    return ico.Scene.from_parameters({
        'weave.size': [4, 3, 3], 'weave.connector_angle': -0.36, 'contact.stiffness': 2e4,
        'contact.friction': friction, 'connector.natural_length': 0.9 * length,
        'connector.bending_stiffness': 0.005})


def test_forces_of_friction_are_the_gradient_of_their_energy():
    """And second derivatives those of the forces; in any configuration near the last one."""
    scene = dense(0.4)
    path = FrictionPath.of(scene)
    fabric = StaticFabric(scene, friction=path)
    rest = ico.solve_equilibrium(changed(scene, {'contact.friction': 0.0})).snapshot
    here = fabric.configuration('start', rest)
    path = path.advanced(fabric.contacts, here.position, here.axes)
    path.update_limits(fabric.contacts, here.position, here.axes, Relaxation())
    assert len(path.pairs) > 10 and path.limit.max() > 0.0
    generator = np.random.default_rng(5)
    path.before[:] = 0.3 * path.limit[:, None] * generator.standard_normal(path.before.shape)
    path.before[:, :3] -= np.einsum(
        'pi,pi->p', path.before[:, :3], path.normal)[:, None] * path.normal
    count, a = scene.body_count, scene.geometry.half_edge
    shift = 1e-4 * a * generator.standard_normal((count, 3))
    position = rest.position + shift
    axes = rotate_axes(
        1e-3 * generator.standard_normal((count, 3)),
        cosines_from_quaternions(rest.orientation).reshape(-1, 3, 3))
    found = path.act(position, axes)
    assert found.slides.any() and not found.slides.all()
    for _ in range(4):
        dx, turn = generator.standard_normal((2, count, 3))
        h = 1e-7

        def at(sign, dx=dx, turn=turn, h=h):
            return position + sign * h * a * dx, rotate_axes(sign * h * turn, axes)

        slope = (path.act(*at(1.0)).energy - path.act(*at(-1.0)).energy) / (2.0 * h)
        work = float((found.wrench[:, :3] * a * dx).sum() + (found.wrench[:, 3:] * turn).sum())
        assert work == pytest.approx(-slope, rel=1e-5)
    bodies, blocks = path.blocks(position, axes)
    motion = np.hstack([a * dx, turn])
    product = np.zeros((count, 6))
    for (i, j), block in zip(bodies, blocks):
        both = block @ np.concatenate([motion[i], motion[j]])
        product[i] += both[:6]
        product[j] += both[6:]
    bend = float((product * motion).sum())
    h = 1e-6
    energies = [path.act(position + s * h * a * dx, rotate_axes(s * h * turn, axes)).energy
                for s in (-1.0, 0.0, 1.0)]
    assert bend == pytest.approx(
        (energies[0] - 2.0 * energies[1] + energies[2]) / h**2, rel=2e-2)


def test_a_dense_slab_loses_energy_in_a_cycle_of_shear():
    """Without friction a loop has no area; with it as much as friction takes."""
    lost = {}
    for friction in (0.0, 0.3):
        cycle, = ico.measure_cycles(dense(friction), 'shear', [0.004, 0.008, 0.012])
        assert len(cycle.points) == 6
        lost[friction] = cycle.loop_area
        work = cycle.loading_work
    assert abs(lost[0.0]) < 1e-6 * work
    assert lost[0.3] > 0.01 * work


def test_strong_friction_and_pushes_agree():
    # Pushes that answer limits of friction by more than they were changed swing ever wider.
    unit = geometry_from_angle(0.01, MINIMUM_ANGLE)
    scene = ico.Scene.from_parameters({
        'weave.size': [5, 3, 3], 'shell.edge_length': 0.02, 'connector.stiffness': 500.0,
        'weave.connector_angle': MINIMUM_ANGLE, 'contact.mode': 'auto',
        'connector.natural_length': 0.9 * unit.connector_length, 'contact.stiffness': 1e5,
        'contact.friction': 0.6})
    points = ico.measure_curve(scene, 'shear', [1e-4, 3e-4, 1e-3, 0.0025, 0.005, 0.0075, 0.01])
    assert len(points) == 7 and max(point.residual for point in points) < 1e-9
    assert points[0].sliding_pairs == 0 and points[-1].sliding_pairs > 3
    # What slides is left between mu N on either side, which is less than what sticks would bear.
    slopes = np.diff([point.stress for point in points]) / np.diff([
        point.strain for point in points])
    assert slopes[-1] < 0.5 * points[0].stress / 1e-4
    kept = {column.name: column.value for column in carry_out(
        make_work('curve', ['strength shear 0.001 1 x']), scene, Path())}
    assert kept['curve.shear.x.slips_at'] == next(
        point.strain for point in points if point.sliding_pairs)


@pytest.mark.parametrize('part', [0.3, 0.999, 1.001, 2.0])
def test_contact_forces_hold_on_an_incline_up_to_the_angle_of_friction(part):
    """Feasible iff tan(angle) <= mu, with the margin 1 - tan(angle) / mu."""
    angle = math.atan(part * MU)
    scene = ico.Scene.from_parameters({
        **GROOVE, 'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -HALF,
        'gravity': [9.81 * math.sin(angle), 0.0, -9.81 * math.cos(angle)]})
    found, weight = ico.solve_equilibrium(scene), 9.81 * scene.shell.mass
    assert found.friction_needed == pytest.approx(part * MU, rel=1e-6)
    assert found.converged == (part <= 1.0) and found.reactions.names[-1] == 'planes.floor'
    assert found.contacts.normal_force == pytest.approx(weight * math.cos(angle), rel=1e-6)
    if part <= 1.0:
        assert found.contacts.margin == pytest.approx(1.0 - part, abs=1e-6)
        assert found.reactions.force[-1] == pytest.approx(
            weight * np.array([-math.sin(angle), 0.0, math.cos(angle)]), rel=1e-6, abs=1e-12)
        assert np.abs(found.unbalanced_wrench).max() < 1e-9 * weight
    else:
        assert found.verdict == 'not in equilibrium' and 'slides' in found.reason
        assert f'contact.friction of at least {part * MU:.4g}'[:-1] in found.reason
        assert found.unbalanced_wrench[0, 0] == pytest.approx(
            weight * (math.sin(angle) - MU * math.cos(angle)), rel=1e-6)


@pytest.mark.parametrize('part, holds', [(0.98, True), (1.02, False)])
def test_a_shell_that_may_tip_rests_on_a_face(part, holds):
    angle = math.atan(0.4 * part)
    scene = ico.Scene.from_parameters({
        'weave.size': [1, 1, 1], 'contact.friction': 0.4, 'contact.stiffness': K,
        'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -HALF,
        'gravity': [9.81 * math.sin(angle), 0.0, -9.81 * math.cos(angle)]})
    found = ico.solve_equilibrium(scene)
    assert found.converged == holds
    # Friction acts at the centre of depth, and so turns the shell a little on its face.
    assert found.friction_needed == pytest.approx(0.4 * part, rel=0.02)
    height = found.snapshot.position[0, 2] + HALF
    assert height == pytest.approx(0.01 * (3.0 + math.sqrt(5.0)) / 2.0 / math.sqrt(3.0), abs=1e-4)


@pytest.mark.parametrize('size, gravity, losses', [
    ([1, 1, 1], [1.755, 0.959, -9.6], {'contact.damping': 0.1}),
    # The work of the weight as they slip would sustain these swings, but for the resting damping.
    ([1, 1, 1], [2.0, 0.0, -9.6], {'contact.damping': 0.01}),
    ([1, 1, 1], [2.0, 0.0, -9.6], {'contact.damping': 0.5}),
    pytest.param([2, 2, 1], [1.755, 0.959, -9.6],
                 {'contact.damping': 0.1, 'connector.damping': 0.5}, marks=pytest.mark.long)])
def test_shells_on_an_incline_below_the_angle_of_friction_come_to_rest(size, gravity, losses):
    # tan 0.208, mu 0.4: they fall on a face, slide a little, rock, and stand still.
    scene = ico.Scene.from_parameters({
        'weave.size': size, 'contact.friction': 0.4, 'planes.floor.normal': [0.0, 0.0, 1.0],
        'planes.floor.offset': -HALF, 'gravity': gravity, **losses})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(5.0)
    found = simulation.snapshot()
    assert np.abs(found.linear_velocity).max() < 1e-9
    assert (found.position[:, 0] - scene.position[:, 0]).min() > 1e-3
    held = simulation.contacts()
    assert held.force.sum(axis=0) == pytest.approx(
        -scene.body_count * scene.shell.mass * np.array(gravity), abs=1e-5)


@pytest.mark.parametrize('beyond', [-0.2, 0.1, 0.3])
def test_a_shell_in_a_groove_needs_friction_where_the_load_leans_out(beyond):
    """
    Between walls at 45 degrees a load needs none up to 45 degrees from the vertical.

    Beyond the shell would slide up one wall, and needs tan(beyond); the other one opens.
    """
    angle, root = math.pi / 4.0 + beyond, math.sqrt(0.5)
    offset = -float((vertices(0.01) @ [root, 0.0, root]).max())
    scene = ico.Scene.from_parameters({
        **GROOVE, 'planes.left.normal': [root, 0.0, root], 'planes.left.offset': offset,
        'planes.right.normal': [-root, 0.0, root], 'planes.right.offset': offset,
        'loads.push.group': 'it',
        'loads.push.force': [math.sin(angle), 0.0, -math.cos(angle)]})
    found = ico.solve_equilibrium(scene)
    assert found.converged
    assert found.friction_needed == pytest.approx(max(0.0, math.tan(beyond)), abs=1e-6)
    pushes = np.maximum([math.sin(-beyond), math.cos(beyond)], 0.0)
    assert sorted(found.contacts.normal_force) == pytest.approx(
        sorted(pushes[pushes > 0.0]), abs=1e-5)
    assert found.contacts.smallest_margin == pytest.approx(
        1.0 - max(0.0, math.tan(beyond)) / MU, abs=1e-5)


def test_contact_forces_of_a_dense_slab_are_admissible_and_balance():
    """Judged anew from points, forces and torques of the contacts."""
    scene = dense(0.3)
    found = ico.solve_equilibrium(scene)
    contacts, a = found.contacts, scene.geometry.half_edge
    assert found.converged and len(contacts.bodies) > 20
    plain = ico.solve_equilibrium(changed(scene, {'contact.friction': 0.0}))
    normal = plain.contacts.force / np.linalg.norm(plain.contacts.force, axis=1)[:, None]
    here = {tuple(pair): row for row, pair in enumerate(plain.contacts.bodies.tolist())}
    seen = 0
    for pair, force, push, margin in zip(
            contacts.bodies.tolist(), contacts.force, contacts.normal_force, contacts.margin):
        if tuple(pair) in here and push > 1e-3:
            along = float(force @ normal[here[tuple(pair)]])
            across = float(np.linalg.norm(force - along * normal[here[tuple(pair)]]))
            assert along == pytest.approx(push, rel=1e-2)
            assert across <= 0.3 * push * (1.01 - margin)
            seen += 1
    assert seen > 10 and contacts.smallest_margin >= 1.0 - found.friction_needed / 0.3 - 1e-6
    # Connectors and bending apart from contacts: the same slab without them.
    fabric = StaticFabric(scene, contact=False)
    here = fabric.configuration('at', found.snapshot)
    left = here.force + contacts.resultants(scene.body_count)
    left[:, 3:] /= a
    assert np.abs(left).max() < 1e-7 * found.force_scale


def test_a_plane_has_a_force_and_no_torque():
    """A plane has no centre: `reactions` has the torque on it."""
    scene = ico.Scene.from_parameters(SLIDER)
    for found in (ico.solve_equilibrium(scene), next(iter(ico.step_loads(scene, [1.0])))[1]):
        contacts = found.contacts
        assert contacts.bodies.tolist() == [[0, -1]]
        assert np.abs(contacts.wrench_on_second[0, :3]).max() > 0.5
        assert not contacts.wrench_on_second[0, 3:].any()
        assert np.array_equal(contacts.wrench_on_second[:, :3], -contacts.wrench_on_first[:, :3])


def test_differences_of_friction_take_two_calls(monkeypatch):
    scene = dense(0.3)
    fabric = StaticFabric(scene, friction=FrictionPath.of(scene))
    here = fabric.start
    path = fabric.friction.advanced(fabric.contacts, here.position, here.axes, 0.05)
    calls, wrenches = [], FrictionPath._wrenches

    def counted(self, places, turns):
        calls.append(len(places))
        return wrenches(self, places, turns)

    monkeypatch.setattr(FrictionPath, '_wrenches', counted)
    path.blocks(here.position, here.axes)
    assert calls == [len(path.pairs), 24 * len(path.pairs)] and calls[0] > 20


def test_small_motions_stick():
    # Along the floor the spring of friction, 2/7 K, holds the slider beside its ties.
    scene = ico.Scene.from_parameters(SLIDER)
    rest = on_path(scene, [0.25, 0.5])[-1].snapshot
    found = ico.solve_modes(scene, at=rest, time=0.0)
    smooth = ico.solve_modes(changed(scene, {'contact.friction': 0.0}), at=rest, time=0.0)
    spring = 2.0 / 7.0 * K
    assert found.mechanism_count == 0
    square, plain = (scene.shell.mass * each.frequencies**2 for each in (found, smooth))
    # Three motions: two along the floor, one into it, which friction leaves alone.
    assert len(square) == len(plain) == 3
    assert square[:2] == pytest.approx(plain[:2] + spring, rel=1e-6)
    assert square[2] == pytest.approx(plain[2], rel=1e-9) and square[2] > spring


def test_small_motions_of_shells_that_stick_to_each_other():
    # Beside springs of the slip alone: (x_1 + theta_1 x arm_1 - x_2 - theta_2 x arm_2) along the
    # surface, and r (theta_1 - theta_2) . n.
    flat = ico.Scene.from_parameters({
        'weave.size': [3, 3, 3], 'weave.connector_angle': -0.36,
        'connector.natural_length': 0.0127, 'connector.bending_stiffness': 0.005,
        'contact.stiffness': 2e4})
    rest = ico.solve_equilibrium(flat).snapshot
    scene = changed(flat, {'contact.friction': 0.3})
    found = ico.solve_modes(scene, at=rest)
    fabric = StaticFabric(flat, 0.0)
    here = fabric.configuration('at', rest)
    met, count = fabric.contacts.contact_points(here.position, here.axes), scene.body_count
    assert len(met.pairs) > 10 and found.mechanism_count == 6
    slip = np.zeros((len(met.pairs), 4, count, 6))
    for row, (pair, point, n) in enumerate(zip(met.pairs, met.point, met.normal)):
        along = np.eye(3) - np.outer(n, n)
        for body, sign in zip(pair, (1.0, -1.0)):
            arm = point - here.position[body]
            cross = np.array([np.cross(axis, arm) for axis in np.eye(3)]).T
            slip[row, :3, body, :3] = sign * along
            slip[row, :3, body, 3:] = sign * along @ cross
            slip[row, 3, body, 3:] = sign * met.radius[row] * n
    rows = slip.reshape(-1, 6 * count) / np.tile(fabric.root, count)
    matrix = scaled_hessian(here).toarray() + 2.0 / 7.0 * 2e4 * rows.T @ rows
    expected = np.linalg.eigvalsh(matrix)
    assert found.frequencies**2 == pytest.approx(expected[6:], abs=1e-6 * expected[-1])
    # Sticking makes the fabric stiffer, by more than any rounding.
    loose = ico.solve_modes(flat, at=rest)
    assert (found.frequencies > 0.999999 * loose.frequencies[-len(found.frequencies):]).all()
    assert found.frequencies[0] > 1.01 * loose.frequencies[0]


def test_shells_at_their_first_touch_do_not_stick():
    smooth = ico.Scene.from_parameters({
        'weave': {'size': [3, 3, 3], 'connector_angle': MINIMUM_ANGLE},
        'contact': {'mode': 'auto', 'stiffness': 1e4}})
    found, rough = (ico.solve_modes(scene) for scene in (
        smooth, changed(smooth, {'contact.friction': 0.4})))
    assert found.first_touches > 0 and len(found.frequencies) > 30
    assert rough.frequencies == pytest.approx(found.frequencies, rel=1e-12)
