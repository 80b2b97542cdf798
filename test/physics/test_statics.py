# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Equilibria: closed forms, balance of forces, the energy and its derivatives, the end of a fall.
"""

from dataclasses import replace

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.statics import modes, spectrum
from icofabric_sim.statics.equilibrium import MECHANISM, NOT_AT_REST, NOT_COUNTED, STABLE, UNSTABLE
from icofabric_sim.statics.fabric import Configuration, StaticFabric
from icofabric_sim.statics.held import without_potential
import numpy as np
import pytest

# Everything that has a potential, none of it small.
ALL_TERMS = {
    'gravity': [1.0, -2.0, -9.0],
    'connector': {
        'stiffness_extension': 700.0, 'stiffness_compression': 300.0, 'natural_length': 0.03,
        'bending_stiffness': 1e-4, 'twisting_stiffness': 2e-4},
    'charge': {'per_body': 1e-6, 'dipole': [1e-7, 2e-7, -1e-7]},
    'field': {'electric': [1e4, 2e4, -3e4]},
    'groups': {'pair': 'ids 1 2'},
    'loads': {'pull': {'group': 'pair', 'force': [1.0, 2.0, 3.0], 'point': [0.003, 0.01, -0.002]}},
    'anchors': {'rope': {'body': 3, 'edge': 'up', 'position': [0.1, 0.1, 0.1]}},
}
HUNG = {
    'gravity': [0.0, 0.0, -9.81], 'groups': {'top': 'z_max'},
    'supports': {'top': {'group': 'top'}}}


def law_file(tmp_path):
    path = tmp_path / 'law.csv'
    path.write_text('length,force\n0.02,-8.0\n0.03,0.0\n0.035,4.0\n0.05,5.0\n')
    return str(path)


def anywhere(fabric, seed=1):
    """A configuration far from the woven one."""
    random = np.random.default_rng(seed)
    shape = len(fabric.free), 3
    return fabric.start.moved(np.hstack([
        2e-3 * random.standard_normal(shape), 0.2 * random.standard_normal(shape)]))


def motions(fabric, seed=2):
    random = np.random.default_rng(seed)
    shape = len(fabric.free), 3
    return [np.hstack([1e-2 * random.standard_normal(shape), random.standard_normal(shape)])
            for _ in range(2)]


@pytest.mark.parametrize('table', [False, True])
def test_forces_and_hessian_are_derivatives_of_the_energy(table, tmp_path):
    sections = dict(ALL_TERMS)
    if table:
        sections['connector'] = {'law': law_file(tmp_path), 'bending_stiffness': 1e-4}
    fabric = StaticFabric(make_scene((3, 3, 2), **sections))
    here = anywhere(fabric)
    first, second = motions(fabric)
    power = float((here.force * first).sum())
    errors, curved = [], []
    for h in (1e-3, 5e-4):
        ahead, behind = here.moved(h * first).energy, here.moved(-h * first).energy
        errors.append(abs((ahead - behind) / (2.0 * h) + power) / abs(power))
        curved.append((ahead - 2.0 * here.energy + behind) / h**2)
    assert errors[1] < 3e-6 and errors[1] < 0.3 * errors[0] + 1e-9
    product = here.times(first)
    assert (first * product).sum() == pytest.approx(
        (4.0 * curved[1] - curved[0]) / 3.0, rel=1e-5)
    # Symmetric, also away from equilibrium.
    assert (second * product).sum() == pytest.approx((first * here.times(second)).sum(), rel=1e-11)
    # Also its columns: forces at both sides (of a potential, so the mean of the two holds them).
    h = 1e-5
    change = (here.moved(-h * first).force - here.moved(h * first).force) / (2.0 * h)
    assert np.allclose(product[:, :3], change[:, :3], atol=1e-4 * np.abs(change[:, :3]).max())


def test_a_body_on_one_connector_hangs_straight_down():
    """Eq 48 for one body: tension M g, length D + M g / k, the attachment above the centre."""
    scene = make_scene((2, 1, 2), connector={'stiffness': 200.0}, **HUNG)
    result = ico.solve_equilibrium(scene)
    weight = scene.shell.mass * 9.81
    assert result.converged and result.verdict == MECHANISM and result.residual <= 1e-10
    # It can turn about the vertical.
    assert (result.mechanism_count, result.unstable_count) == (1, 0)
    assert result.tension == pytest.approx([weight], rel=1e-10)
    assert result.snapshot.connector_length == pytest.approx(
        [scene.connectors.natural_length + weight / 200.0], rel=1e-12)
    lower, upper = result.snapshot.connector_ends[0][
        np.argsort(result.snapshot.connector_ends[0][:, 2])]
    assert np.allclose(lower[:2], upper[:2], atol=1e-12)
    centre = result.snapshot.position[0]
    assert np.allclose(lower - centre, [0.0, 0.0, scene.geometry.cube_width / 2.0], atol=1e-11)
    held = result.reaction[1]
    # And the held body itself.
    assert held[2] == pytest.approx(2.0 * weight, rel=1e-10)
    assert np.abs(held[:2]).max() < 1e-10 * weight


def test_reactions_bear_the_load_and_no_body_is_left_with_a_force():
    scene = make_scene(
        (4, 4, 4), connector={'stiffness': 2000.0}, contact={'stiffness': 5e4}, **{
            **HUNG, 'groups': {'top': 'z_max', 'low': 'z_min'}, 'solver': {'tolerance': 1e-10},
            'loads': {'low': {'group': 'low', 'force': [0.02, 0.0, -0.05], 'share': 'total'}}})
    result = ico.solve_equilibrium(scene)
    assert result.verdict == STABLE and result.residual <= 1e-10
    # Shells touch, and are counted in.
    assert len(result.contact_state.pairs) > 3
    weight = scene.body_count * scene.shell.mass * 9.81
    load = np.array([0.02, 0.0, -0.05 - weight])
    assert np.abs(result.reaction[:, :3].sum(axis=0) + load).max() < 1e-9 * weight
    # Moments too, about the origin of the world.
    where = result.snapshot.position
    moment = (np.cross(where, result.reaction[:, :3]) + result.reaction[:, 3:]).sum(axis=0)
    acting = np.zeros_like(where)
    acting[:, 2] = -scene.shell.mass * 9.81
    low = scene.groups['low']
    acting[low] += np.array([0.02, 0.0, -0.05]) / len(low)
    assert np.abs(moment + np.cross(where, acting).sum(axis=0)).max() < 1e-9 * weight
    # The same forces as in motion: started there, the fabric stays.
    simulation = ico.compile_scene(scene)
    simulation.set_state(
        position=result.snapshot.position, orientation=result.snapshot.orientation)
    simulation.advance_to(0.02)
    moved = np.abs(simulation.snapshot().position - result.snapshot.position).max()
    assert moved < 1e-9 * scene.geometry.half_edge
    assert np.abs(result.snapshot.position - scene.position).max() > 0.01 * scene.geometry.pitch


@pytest.mark.long
def test_a_fall_with_drag_ends_where_the_solver_ends():
    """A short stiff beam, positive definite: the end is one and the same from both starts."""
    scene = make_scene(
        (3, 2, 2), gravity=[0.0, 0.0, -9.81], groups={'wall': 'x_min'},
        supports={'wall': {'group': 'wall'}},
        # Given: no kernel that chooses steps is compiled for this kind of scene.
        solver={'step': 2e-4},
        connector={'stiffness': 300.0, 'bending_stiffness': 2e-2},
        # Twice the lowest frequency: as fast as it can come to rest.
        drag={'linear': 50.0 * 7.26e-3, 'angular': 50.0 * 1.115e-6})
    found = ico.solve_equilibrium(scene)
    assert found.verdict == STABLE and found.mechanism_count == 0
    simulation = ico.compile_scene(scene)
    simulation.advance_to(1.2)
    end = simulation.snapshot()
    a = scene.geometry.half_edge
    assert np.abs(end.position - scene.position).max() > 0.01 * a
    assert np.abs(end.position - found.snapshot.position).max() < 1e-8 * a
    again = ico.solve_equilibrium(scene, start=end, tolerance=1e-7)
    assert again.converged and again.step_count <= 2
    assert np.abs(again.snapshot.position - end.position).max() < 1e-8 * a


def test_loads_that_turn_with_their_bodies_have_an_equilibrium_too():
    scene = make_scene(
        (3, 2, 2), groups={'wall': 'x_min', 'tip': 'x_max'}, supports={'wall': {'group': 'wall'}},
        connector={'stiffness': 300.0, 'bending_stiffness': 5e-3, 'twisting_stiffness': 5e-3},
        loads={'tip': {'group': 'tip', 'frame': 'body', 'force': [0.02, -0.03, 0.1],
                       'torque': [1e-4, 0.0, 2e-4], 'point': [0.002, 0.0, 0.004]}})
    result = ico.solve_equilibrium(scene)
    assert result.converged and result.verdict == STABLE
    simulation = ico.compile_scene(scene)
    simulation.set_state(
        position=result.snapshot.position, orientation=result.snapshot.orientation)
    simulation.advance_to(0.01)
    assert np.abs(simulation.snapshot().position - result.snapshot.position).max() < 1e-10
    assert np.abs(result.snapshot.orientation - scene.orientation).max() > 1e-3


def test_energy_never_grows_on_the_way():
    """Without contact, whose stiffness grows on the way."""
    scene = make_scene(
        (4, 3, 3), contact={'mode': 'never'}, gravity=[0.0, 0.0, -9.81],
        groups={'wall': 'x_min'}, supports={'wall': {'group': 'wall'}},
        connector={'stiffness': 500.0})
    seen = []
    result = ico.solve_equilibrium(scene, progress=seen.append)
    energies = [progress.energy for progress in seen]
    assert result.converged and len(energies) > 10
    assert energies[-1] < energies[0]
    assert all(after <= before + 1e-12 for before, after in zip(energies, energies[1:]))


def test_a_pushed_strut_is_unstable_where_it_stands_straight():
    """A connector between a held body and a free one, pushed along its line: it would buckle."""
    scene = make_scene((2, 1, 2), connector={'stiffness': 200.0}, **HUNG)
    hanging = ico.solve_equilibrium(scene).snapshot
    lifted = scene.parameters.with_changes({'gravity': [0.0, 0.0, 9.81]})
    shortened = hanging.position.copy()
    shortened[0, 2] += 2.0 * scene.shell.mass * 9.81 / 200.0
    start = replace(hanging, position=shortened)
    result = ico.solve_equilibrium(ico.Scene.from_parameters(lifted), start=start)
    assert result.converged and result.verdict == UNSTABLE
    assert result.unstable_count >= 2 and result.tension[0] < 0.0


def test_an_unloaded_fabric_is_at_rest_and_has_its_mechanisms():
    scene = make_scene((3, 3, 3))
    result = ico.solve_equilibrium(scene)
    assert result.verdict == MECHANISM and result.step_count == 0
    assert result.mechanism_count == 6 * scene.body_count - scene.connector_count
    assert not result.reaction.any()


def test_large_fabrics_are_judged_without_counting(monkeypatch):
    scene = make_scene((4, 4, 4), connector={'stiffness': 2000.0}, **HUNG)
    for module, name in ((spectrum, 'DENSE'), (spectrum, 'COUNTED'), (modes, 'DENSE')):
        monkeypatch.setattr(module, name, 10)
    result = ico.solve_equilibrium(scene)
    assert result.verdict == NOT_COUNTED and result.converged
    assert result.mechanism_count == result.unstable_count == -1
    # Of many modes of a fabric under pressure Lanczos' iteration sees the lowest at once.
    pressed = make_scene((3, 3, 3), connector={'natural_length': 0.031})
    matrix = spectrum.scaled_hessian(StaticFabric(pressed).start)
    values = np.linalg.eigvalsh(matrix.toarray())
    assert spectrum.ends_of_spectrum(StaticFabric(pressed).start) == pytest.approx(
        (values[0], values[-1]), rel=1e-6)
    assert values[0] < 0.0
    assert spectrum.judge_curvature(StaticFabric(pressed).start) == (-1, 1)
    with pytest.raises(ValueError, match='highest'):
        modes.solve_modes(scene, count=2)


def test_a_search_that_ends_too_early_says_so():
    scene = make_scene((4, 4, 4), connector={'stiffness': 2000.0}, **HUNG)
    result = ico.solve_equilibrium(scene, largest_step_count=2)
    assert result.verdict == NOT_AT_REST and not result.converged
    assert result.mechanism_count == result.unstable_count == -1
    assert result.residual > 1e-10 and np.abs(result.unbalanced_wrench).max() > 0.0
    assert len(result.worst_bodies) == 4
    assert 'all of its 2 steps' in result.reason and 'largest_step_count' in result.reason
    turned = make_scene((2, 2, 2), groups={'low': 'z_min', 'high': 'z_max'}, supports={
        's': {'group': 'high'}}, loads={'l': {'group': 'low', 'torque': [0.0, 0.1, 0.0]}})
    lost = ico.solve_equilibrium(turned, largest_step_count=2)
    assert 'loads.l: follows' in lost.reason and 'there may be no equilibrium' in lost.reason
    assert not lost.converged and not ico.solve_equilibrium(make_scene((2, 2, 2))).reason
    assert result.unbalanced_wrench[scene.groups['top']].max() == 0.0


def test_drives_stand_where_they_are_at_the_time():
    sections = {
        'connector': {'stiffness': 300.0, 'bending_stiffness': 5e-3},
        'groups': {'wall': 'x_min', 'tip': 'x_max'}, 'supports': {'wall': {'group': 'wall'}},
        'drives': {'tip': {'group': 'tip', 'motion': 'velocity', 'linear': [0.0, 0.0, 0.002]}}}
    scene = make_scene((3, 2, 2), **sections)
    result = ico.solve_equilibrium(scene, time=1.5)
    tip = scene.groups['tip']
    assert np.allclose(result.snapshot.position[tip] - scene.position[tip], [0.0, 0.0, 0.003])
    assert result.converged
    total = result.reaction[:, :3].sum(axis=0)
    assert np.abs(result.reaction[tip, 2].sum()) > 1e-3
    assert np.abs(total).max() < 1e-9 * result.force_scale


@pytest.mark.parametrize('sections, words', [
    ({'gravity': [0.0, 0.0, -9.81]}, ['nothing holds', 'supports']),
    ({'groups': {'g': 'x_max'}, 'drives': {'shaker': {
        'group': 'g', 'motion': 'velocity', 'linear': [0.0, 0.0, 1e-3]}}},
     ['drives.shaker.motion', 'time']),
    ({'groups': {'g': 'x_max'}, 'supports': {'g': {'group': 'g'}}, 'loads': {'l': {
        'group': 'g', 'force': [1.0, 0.0, 0.0], 'profile': 'ramp', 'duration': 1.0}}},
     ['loads.l.profile and 1 more', 'time']),
    ({'anchors': {'rope': {'body': 0, 'edge': 'up', 'position': [0.0, 0.0, 0.1],
                           'velocity': [0.0, 0.0, 0.1]}}}, ['anchors.rope.velocity', 'time']),
])
def test_what_cannot_be_at_rest_is_refused(sections, words):
    with pytest.raises(ValueError) as caught:
        ico.solve_equilibrium(make_scene((2, 2, 2), **sections))
    assert all(word in str(caught.value) for word in words)
    if 'time' in words:
        with pytest.raises(ValueError, match=words[0]):
            ico.solve_modes(make_scene((2, 2, 2), **sections))


def test_loads_without_a_potential_are_named():
    scene = make_scene((2, 2, 2), groups={'g': 'x_max'}, loads={
        'dead': {'group': 'g', 'force': [1.0, 0.0, 0.0], 'point': [0.0, 0.01, 0.0]},
        'turns': {'group': 'g', 'force': [1.0, 0.0, 0.0], 'frame': 'body'},
        'twists': {'group': 'g', 'torque': [0.0, 0.1, 0.0]}, 'later': {'group': 'g'}},
        tractions={'press': {'group': 'g', 'pressure': 10.0}})
    assert without_potential(scene) == ['loads.turns', 'loads.twists', 'tractions.press']


def test_arguments_are_judged():
    scene, other = make_scene((2, 2, 2)), make_scene((3, 2, 2))
    snapshot = ico.solve_equilibrium(other).snapshot
    for arguments, word in (
            ({'tolerance': 0.0}, 'tolerance'), ({'time': -1.0}, 'time'),
            ({'time': np.inf}, 'time'), ({'start': snapshot}, 'start')):
        with pytest.raises(ValueError, match=word):
            ico.solve_equilibrium(scene, **arguments)


PLACED = {'gravity': [0.0, 0.0, -9.81], 'contact': {'mode': 'always', 'stiffness': 1e4}}


def test_contact_forces_and_hessian_are_derivatives_of_the_energy():
    scene = make_scene((3, 3, 2), planes={'floor': {
        'normal': [0.0, 0.1, 1.0], 'offset': -0.005}}, **PLACED)
    fabric = StaticFabric(scene)
    random = np.random.default_rng(1)
    shape = scene.body_count, 3
    here = fabric.start.moved(np.hstack([
        8e-3 * random.standard_normal(shape), 0.3 * random.standard_normal(shape)]))
    assert len(here.contact_state.pairs) >= 3 and len(here.contact_state.planes[0]) >= 5
    assert 0.2 < here.contact_state.energy / here.energy < 1.0
    first, second = motions(fabric)
    h = 1e-5
    ahead, behind = here.moved(h * first), here.moved(-h * first)
    assert (ahead.energy - behind.energy) / (2.0 * h) == pytest.approx(
        -float((here.force * first).sum()), rel=1e-8)
    product = here.times(first)
    h = 1e-4
    curved = (here.moved(h * first).energy - 2.0 * here.energy
              + here.moved(-h * first).energy) / h**2
    assert (first * product).sum() == pytest.approx(curved, rel=1e-5)
    assert (second * product).sum() == pytest.approx((first * here.times(second)).sum(), rel=1e-9)
    # The matrix has the contacts too, between bodies that no connector joins.
    matrix = spectrum.scaled_hessian(here)
    scaled = (matrix @ first.ravel()).reshape(first.shape)
    assert np.allclose(
        scaled, here.times(first / fabric.root) / fabric.root, atol=1e-9 * np.abs(scaled).max())


def test_a_slab_on_a_floor():
    """The floor bears the weight; the slab can slide and turn on it."""
    scene = make_scene(
        (5, 5, 3), weave={'size': [5, 5, 3], 'connector_angle': 0.15},
        planes={'floor': {'normal': [0.0, 0.0, 1.0], 'offset': -0.017}},
        **{**PLACED, 'connector': {'stiffness': 300.0, 'bending_stiffness': 0.02}})
    result = ico.solve_equilibrium(scene)
    assert result.verdict == MECHANISM and result.mechanism_count == 3
    here = Configuration(
        StaticFabric(scene), result.snapshot.position.copy(), result.snapshot.orientation.copy())
    weight = scene.body_count * scene.shell.mass * 9.81
    assert here.contact_state.wrench[:, 2].sum() == pytest.approx(weight, rel=1e-9)
    assert len(here.contact_state.planes[0]) == 13 and not len(here.contact_state.pairs)
    assert 0.0 < here.contact_state.depth < 0.05 * scene.geometry.half_edge
    assert ico.solve_modes(scene, at=result.snapshot).mechanism_count == 3


def test_a_shell_on_its_edge_stands_but_not_for_long():
    scene = make_scene(
        (1, 1, 1), planes={'floor': {'normal': [0.0, 0.0, 1.0], 'offset': -0.0162}}, **PLACED)
    result = ico.solve_equilibrium(scene)
    assert result.verdict == UNSTABLE and result.unstable_count >= 1
    scene = make_scene((1, 1, 1), gravity=[0.0, 0.0, -9.81], contact={'mode': 'always'})
    with pytest.raises(ValueError, match='planes'):
        ico.solve_equilibrium(scene)


def test_loads_are_brought_up_in_parts():
    """Each part is the equilibrium under it; the last one that of all, however it is reached."""
    sections = {
        'connector': {'stiffness': 300.0, 'bending_stiffness': 2e-2}, 'groups': {
            'wall': 'x_min', 'tip': 'x_max'}, 'supports': {'wall': {'group': 'wall'}},
        'gravity': [0.0, 0.0, -9.81], 'charge': {'per_body': 1e-7, 'dipole': [1e-8, 0.0, 2e-8]},
        'field': {'electric': [0.0, 2e5, 0.0]},
        'loads': {'tip': {'group': 'tip', 'force': [0.0, 0.05, 0.0], 'share': 'total'}}}
    scene = make_scene((3, 2, 2), **sections)
    seen = []
    steps = list(ico.step_loads(scene, [0.25, 0.5, 1.0], progress=seen.append))
    assert [factor for factor, _ in steps] == [0.25, 0.5, 1.0] and seen
    whole = ico.solve_equilibrium(scene)
    a = scene.geometry.half_edge
    assert np.abs(steps[-1][1].snapshot.position - whole.snapshot.position).max() < 1e-8 * a
    # A half of everything, written into the scene.
    half = make_scene((3, 2, 2), **{
        **sections, 'gravity': [0.0, 0.0, -4.905], 'field': {'electric': [0.0, 1e5, 0.0]},
        'loads': {'tip': {'group': 'tip', 'force': [0.0, 0.025, 0.0], 'share': 'total'}}})
    there, found = ico.solve_equilibrium(half), steps[1][1]
    assert np.abs(found.snapshot.position - there.snapshot.position).max() < 1e-8 * a
    assert found.reaction[:, :3].sum(axis=0) == pytest.approx(
        0.5 * whole.reaction[:, :3].sum(axis=0), rel=1e-8)
    moved = [np.abs(step.snapshot.position - scene.position).max() for _, step in steps]
    assert 0.0 < moved[0] < moved[1] < moved[2]
    # A search that does not end is the last one.
    short = list(ico.step_loads(scene, [0.5, 1.0], largest_step_count=1))
    assert len(short) == 1 and not short[0][1].converged
    with pytest.raises(ValueError, match='load_factor'):
        ico.solve_equilibrium(scene, load_factor=-1.0)
