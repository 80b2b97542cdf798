# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Vibrations and mechanisms: closed forms, counts by another way, the frequencies of real motion.
"""


from dataclasses import replace

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.simulation.model.lanczos import Lanczos, start_vector
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.statics import modes, spectrum
from icofabric_sim.statics.dissection import dissection_order
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.iteration import begin
from icofabric_sim.statics.spectrum import scaled_hessian
from icofabric_validation.benchmarks import mechanism_counts
import numpy as np
import pytest
from scipy import sparse
from scipy.sparse import linalg

CANTILEVER = {
    'groups': {'wall': 'x_min'}, 'supports': {'wall': {'group': 'wall'}},
    'connector': {'stiffness': 300.0, 'bending_stiffness': 5e-3, 'twisting_stiffness': 1e-3}}


def rank_by_differences(scene):
    """
    Rank of the derivatives of the connectors' lengths, from lengths of displaced fabrics alone.
    """
    fabric = StaticFabric(scene)
    count, h = scene.body_count, 1e-6
    a = scene.geometry.half_edge
    columns = []
    for body in range(count):
        for freedom in range(6):
            motion = np.zeros((count, 6))
            motion[body, freedom] = h * (a if freedom < 3 else 1.0)
            columns.append(
                fabric.start.moved(motion).snapshot.connector_length
                - fabric.start.moved(-motion).snapshot.connector_length)
    values = np.linalg.svd(np.array(columns).T / (2.0 * h * a), compute_uv=False)
    return int(np.count_nonzero(values > 1e-6))


def test_two_bodies_on_one_connector():
    """One frequency: along the connector, k (1/mu + 2 |s x n|^2 / Lambda) with mu = M / 2."""
    scene = make_scene((2, 1, 2), connector={'stiffness': 200.0})
    found = ico.solve_modes(scene)
    shell, ends = scene.shell, ico.compile_scene(scene).snapshot().connector_ends[0]
    direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    lever = np.linalg.norm(np.cross(ends[0] - scene.position[0], direction))
    square = 200.0 * (2.0 / shell.mass + 2.0 * lever**2 / shell.inertia)
    assert found.frequencies == pytest.approx([np.sqrt(square)], rel=1e-12)
    assert (found.mechanism_count, found.rigid_count, found.unstable_count) == (11, 6, 0)
    # Kinetic energy 1/2 at 1 rad/s.
    shape = found.shapes[0]
    assert shell.mass * (shape[:, :3]**2).sum() + shell.inertia * (
        shape[:, 3:]**2).sum() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize('variant', [0, 1, 2, 3])
@pytest.mark.parametrize('size', [(2, 2, 2), (3, 2, 2), (3, 3, 3), (4, 3, 2)])
def test_mechanisms_are_counted_exactly(variant, size):
    for angle in (0.3, 0.66):
        scene = make_scene(
            size, weave={'size': list(size), 'variant': variant, 'connector_angle': angle})
        found = ico.solve_modes(scene)
        rank = rank_by_differences(scene)
        freedoms = 6 * scene.body_count
        assert found.counts == (freedoms, scene.connector_count, rank)
        assert found.mechanism_count == len(found.mechanisms) == freedoms - rank
        assert found.self_stress_count == scene.connector_count - rank
        assert len(found.frequencies) == rank and found.unstable_count == 0
        # The theorem of the counting.
        assert freedoms - scene.connector_count == (
            found.mechanism_count - found.self_stress_count)
        # No mechanism stretches a connector.
        fabric = StaticFabric(scene)
        rest = fabric.start.snapshot.connector_length
        for motion in found.mechanisms[:3]:
            motion = 1e-5 * motion / np.abs(motion).max() * scene.geometry.half_edge
            stretch = fabric.start.moved(motion).snapshot.connector_length - rest
            assert np.abs(stretch).max() < 1e-8 * scene.geometry.half_edge


def test_zero_energy_motions_of_held_and_anchored_fabrics():
    scene = make_scene((3, 3, 2), groups={'one': 'ids 0'}, supports={'one': {'group': 'one'}})
    held = ico.solve_modes(scene)
    assert held.rigid_count == 0 and held.degrees_of_freedom == 6 * scene.body_count - 6
    assert held.mechanism_count == held.degrees_of_freedom - held.counts.rank
    rope = {'body': 0, 'edge': 'down', 'position': [0.0, 0.0, -0.1]}
    anchored = ico.solve_modes(make_scene((3, 3, 2), anchors={'rope': rope}))
    assert anchored.rigid_count == 5
    assert anchored.counts.connectors == scene.connector_count + 1


def test_frequencies_are_those_of_a_small_motion():
    """About an equilibrium, pre-stressed by weight: a run in the shape of a mode is cos(w t)."""
    scene = make_scene(
        (4, 2, 2), gravity=[0.0, 0.0, -9.81], solver={'tolerance': 1e-8}, **CANTILEVER)
    rest = ico.solve_equilibrium(scene).snapshot
    found = ico.solve_modes(scene, at=rest)
    straight = ico.solve_modes(scene)
    assert abs(found.frequencies[0] / straight.frequencies[0] - 1.0) > 1e-3
    simulation = ico.compile_scene(scene)
    fabric = StaticFabric(scene)
    for number in (0, 3, len(found.frequencies) - 1):
        rate, shape = found.frequencies[number], found.shapes[number]
        shape = 1e-5 / np.abs(shape[:, 3:]).max() * shape
        start = modes.Configuration(fabric, rest.position, rest.orientation).moved(shape)
        simulation.reset()
        simulation.set_state(position=start.position, orientation=start.orientation)
        since = simulation.time
        for part in (0.25, 0.5, 1.0, 1.35):
            simulation.advance_to(since + part * 2.0 * np.pi / rate)
            moved = simulation.snapshot().position - rest.position
            along = (moved * shape[:, :3]).sum() / (shape[:, :3]**2).sum()
            assert along == pytest.approx(np.cos(2.0 * np.pi * part), abs=2e-4)


def rotated_by_noise(scene, amplitude):
    """A snapshot of the scene with its bodies moved and turned, so that all connectors pull."""
    random = np.random.default_rng(7)
    a, shape = scene.geometry.half_edge, (scene.body_count, 3)
    motion = np.hstack([
        a * random.standard_normal(shape), random.standard_normal(shape)])
    fabric = StaticFabric(scene)
    return fabric.start.moved(np.where(fabric.free, amplitude * motion, 0.0)).snapshot


PULLED = {
    'anchors': {'rope': {'body': 0, 'edge': 'down', 'position': [0.0, 0.0, -0.1]}},
    'charge': {'dipole': [1e-8, 0.0, 2e-8]}, 'field': {'electric': [0.0, 2e5, 0.0]},
    'groups': {'some': 'x_max'}, 'loads': {'pull': {
        'group': 'some', 'force': [0.3, 0.0, 0.1], 'point': [0.0, 0.01, 0.004]}}}
PRESSED = {
    'weave': {'size': [3, 3, 3], 'connector_angle': 0.15}, 'gravity': [0.0, 0.0, -9.81],
    'planes': {'floor': {'normal': [0.0, 0.0, 1.0], 'offset': -0.016}},
    'contact': {'mode': 'always', 'stiffness': 1e4}}


@pytest.mark.parametrize('sections, exact', [
    ({}, True), ({'connector': {'natural_length': 0.03}}, True), (CANTILEVER, True),
    ({'connector': {'stiffness_extension': 300.0, 'stiffness_compression': 700.0}}, False),
    (PULLED, False), (PRESSED, False)])
def test_largest_is_what_the_steps_follow(sections, exact):
    """One iteration finds both; where the step choice adds bounds, it is above, and not far."""
    scene = make_scene((3, 3, 3), **sections)
    simulation = ico.compile_scene(scene)
    # Shells that touch may not overlap by much.
    moved = rotated_by_noise(scene, 0.01 if 'planes' in sections else 0.2)
    for at in (None, moved):
        found = ico.solve_modes(scene, at=at)
        values = np.linalg.eigvalsh(scaled_hessian(found.configuration).toarray())
        assert found.largest_frequency == pytest.approx(np.sqrt(values[-1]), rel=1e-8)
        assert found.frequencies[-1] == pytest.approx(found.largest_frequency, rel=1e-8)
        if 'planes' in sections:
            assert len(found.configuration.contact_state.planes[0]) > 3
        if at is not None:
            simulation.set_state(position=at.position, orientation=at.orientation)
        ratio = simulation.status.largest_frequency / found.largest_frequency
        assert 1.0 - 1e-4 < ratio < (1.0 + 1e-4 if exact else 4.0)
        if not exact and at is not None:
            assert ratio > 1.0 + 1e-4


def test_steps_and_modes_begin_the_same_iteration():
    """Bit by bit: the same start, the same products."""
    scene = make_scene((5, 4, 3), **CANTILEVER)
    packed, here = pack_scene(scene), StaticFabric(scene).start
    layout, state = packed.layout, packed.layout.pack(scene.initial)
    work = layout.room(packed.model.links)
    place_all(packed.model, state, work, 0, len(layout.blocks.slot))
    steps = Lanczos(
        packed.model, state, work, start_vector(layout, packed.model.supports), 20)
    modes_run, start = begin(here, 20)
    for run in (steps, modes_run):
        run.go_on(20)
    assert np.array_equal(steps.matrix.diagonal, modes_run.matrix.diagonal)
    assert steps.matrix.diagonal.all()
    assert np.array_equal(steps.matrix.off, modes_run.matrix.off)
    # Its vectors are orthogonal, as far as rounding lets them be, and come again.
    vectors = modes_run.combine(start, np.eye(20))
    flat = vectors.reshape(20, -1)
    assert np.abs(flat @ flat.T - np.eye(20)).max() < 1e-10
    assert np.array_equal(vectors[0], start)


def test_a_large_fabric_has_the_same_largest_frequency():
    scene = make_scene((9, 8, 7), **CANTILEVER)
    found = ico.solve_modes(scene, count=1, which='highest')
    assert found.degrees_of_freedom > spectrum.DENSE // 2
    assert found.largest_frequency == pytest.approx(found.frequencies[0], rel=1e-7)
    assert ico.compile_scene(scene).status.largest_frequency == pytest.approx(
        found.largest_frequency, rel=1e-4)


@pytest.mark.parametrize('sections', [
    {}, CANTILEVER,
    {'weave': {'kind': 'bias', 'size': [4, 4, 4]}, 'connector': {'natural_length': 0.036}}])
def test_large_fabrics_are_counted_by_factorisation(sections, monkeypatch):
    scene = make_scene((5, 5, 4), **sections)
    whole = ico.solve_modes(scene)
    monkeypatch.setattr(modes, 'DENSE', 10)
    monkeypatch.setattr(spectrum, 'DENSE', 10)
    for which, part in (('lowest', slice(0, 7)), ('highest', slice(-7, None))):
        found = ico.solve_modes(scene, count=7, which=which)
        assert found.mechanism_count == whole.mechanism_count
        assert found.unstable_count == whole.unstable_count
        assert found.frequencies == pytest.approx(whole.frequencies[part], rel=1e-8)
        # By the pivots what singular values say.
        assert found.counts == whole.counts
        assert found.self_stress_count == whole.self_stress_count
        assert found.shapes.shape == (7, scene.body_count, 6)
        again = ico.solve_modes(scene, count=7, which=which)
        assert np.array_equal(again.shapes, found.shapes)


@pytest.mark.parametrize('size, sections', [
    ((5, 5, 5), CANTILEVER), ((5, 5, 5), {}),
    # Three waves have each frequency, and the iteration finds one of them at a time.
    ((4, 4, 4), {'connector': {'bending_stiffness': 5e-3}})])
@pytest.mark.parametrize('counted', [True, False])
def test_lowest_without_factors(size, sections, counted, monkeypatch):
    """As beyond 60,000 freedoms, and beyond those whose motions are counted."""
    scene = make_scene(size, **sections)
    whole = ico.solve_modes(scene)
    for module, name in ((modes, 'DENSE'), (spectrum, 'DENSE'), (modes, 'FACTORED')):
        monkeypatch.setattr(module, name, 10)
    if not counted:
        for module in (modes, spectrum):
            monkeypatch.setattr(module, 'COUNTED', 10)
    count = 11
    found = ico.solve_modes(scene, count=count)
    expected = whole.frequencies[:count]
    if size == (4, 4, 4):
        assert np.diff(expected).min() < 1e-9 * expected[0]
    assert found.mechanism_count == (whole.mechanism_count if counted else -1)
    assert found.counts == (whole.counts if counted else None)
    assert found.frequencies == pytest.approx(expected, rel=1e-9)
    # They are orthogonal, and each is a mode.
    root = found.configuration.fabric.root
    flat = (found.shapes * root).reshape(count, -1)
    assert np.abs(flat @ flat.T - np.eye(count)).max() < 1e-9
    for rate, shape in zip(found.frequencies, found.shapes):
        wanted = rate**2 * root**2 * shape
        here = found.configuration
        left = np.where(here.fabric.free, here.times(shape) - wanted, 0.0)
        assert np.abs(left / root).max() < 1e-6 * np.abs(wanted / root).max()
    again = ico.solve_modes(scene, count=count)
    assert np.array_equal(again.shapes, found.shapes)


def test_long_thin_fabrics_take_factors_where_iteration_does_not_end(monkeypatch):
    scene = make_scene((21, 2, 2), **CANTILEVER)
    whole = ico.solve_modes(scene)
    for module, name in ((modes, 'DENSE'), (spectrum, 'DENSE'), (modes, 'ITERATED')):
        monkeypatch.setattr(module, name, 10)
    monkeypatch.setattr(modes, '_MODES', replace(modes._MODES, max_trial_products=60))
    found = ico.solve_modes(scene, count=3)
    assert found.frequencies == pytest.approx(whole.frequencies[:3], rel=1e-8)
    monkeypatch.setattr(modes, 'FACTORED', 10)
    monkeypatch.setattr(modes, '_MODES', replace(modes._MODES, max_products=60))
    with pytest.raises(ValueError, match='of the 3 lowest .* 60 products'):
        ico.solve_modes(scene, count=3)


def test_elimination_counts_what_all_eigenvalues_say(monkeypatch):
    """Part by part, with contacts between bodies that no connector joins, and under pressure."""
    monkeypatch.setattr(spectrum, '_PART_BODIES', 2)
    for size, sections in (
            ((5, 4, 4), {'contact': {'mode': 'always', 'stiffness': 1e4}}),
            ((4, 4, 4), {'connector': {'natural_length': 0.03}}), ((6, 3, 3), CANTILEVER),
            ((3, 3, 3), {'bodies': {'one': {'position': [0.0, 0.0, 0.5]}}})):
        scene = make_scene(size, **sections)
        here = StaticFabric(scene).configuration('moved', rotated_by_noise(scene, 0.3))
        if 'contact' in sections:
            # Squeezed until shells touch that are no neighbours.
            here.position[:] *= 0.45
            joined = {tuple(sorted(pair)) for pair in scene.connectors.bodies.tolist()}
            assert {tuple(pair) for pair in np.sort(here.contact_state.pairs).tolist()} - joined
        matrix = scaled_hessian(here)
        values = np.linalg.eigvalsh(matrix.toarray())
        for part in (-0.3, -1e-3, 1e-3, 0.02, 0.2, 0.9):
            shift = part * float(np.abs(values).max())
            below = int(np.count_nonzero(values < shift))
            assert spectrum.count_under(here, matrix, shift) == below
        assert spectrum.count_under(here, matrix, 2.0 * float(values[-1])) == len(values)
        assert np.count_nonzero(values < -1e-3 * values[-1]) > 3


def test_matrix_is_the_product_column_by_column():
    scene = make_scene((3, 3, 3), **CANTILEVER)
    here = StaticFabric(scene).start
    here = here.moved(0.05 * np.random.default_rng(3).standard_normal(
        (scene.body_count, 6)) * [[1e-2] * 3 + [1.0] * 3])
    matrix, fabric = scaled_hessian(here).toarray(), here.fabric
    vector = np.random.default_rng(4).standard_normal(fabric.free.shape)
    vector[~fabric.free] = 0.0
    product = here.times(vector / fabric.root) / fabric.root
    expected = matrix @ vector[fabric.free]
    assert np.abs(product[fabric.free] - expected).max() < 1e-12 * np.abs(expected).max()
    assert np.array_equal(matrix, matrix.T) and np.abs(matrix).max() > 0.0


def test_elimination_parts_the_fabric():
    grid = make_scene((9, 8, 7)).weave.grid
    order = dissection_order(grid)
    assert np.array_equal(np.sort(order), np.arange(len(grid)))
    # The last plane parts the rest: no neighbours on either side of it.
    extent = np.ptp(grid, axis=0)
    axis = int(np.argmax(extent))
    last = grid[order[-20:], axis]
    assert (last == last[0]).all()


def test_free_rigid_motions_cost_nothing_under_prestress():
    scene = make_scene((3, 3, 3), connector={'natural_length': 0.03, 'bending_stiffness': 1e-3})
    found = ico.solve_equilibrium(scene)
    assert found.converged and np.abs(found.tension).max() > 0.0
    vibrations = ico.solve_modes(scene, at=found.snapshot)
    assert vibrations.rigid_count == 6 and vibrations.mechanism_count >= 6


def test_bad_arguments():
    scene, other = make_scene((2, 2, 2)), make_scene((3, 2, 2))
    with pytest.raises(ValueError, match='which'):
        ico.solve_modes(scene, which='largest')
    with pytest.raises(ValueError, match='count'):
        ico.solve_modes(scene, count=0)
    # Nothing would ever come to an end there.
    with pytest.raises(ValueError, match='time'):
        ico.solve_modes(scene, time=np.inf)
    snapshot = ico.compile_scene(other).snapshot()
    with pytest.raises(ValueError, match='at has'):
        ico.solve_modes(scene, at=snapshot)


def test_mechanisms_of_slabs_of_all_sizes_are_counted_alike_in_five_ways():
    """
    A part of the sweep over slabs up to 6 x 6 x 6 (docs/decisions/statics.md).
    """
    every = list(mechanism_counts.slabs(6))
    assert len(every) == 6**3 * 4 * len(mechanism_counts.ANGLES)
    every = [slab for slab in every if np.prod(slab[0]) > 1]  # some of those have no body
    chosen = np.random.RandomState(1).choice(len(every), 40, replace=False)
    most = 0
    for size, variant, angle in [([6, 6, 6], 1, 0.5), *(every[number] for number in chosen)]:
        found = mechanism_counts.count(make_scene(
            size, weave={'size': size, 'variant': variant, 'connector_angle': angle}))
        assert found.agree, (size, variant, angle, found)
        assert found.rank == found.connectors
        # No threshold decides: all values are far from it, on either side.
        assert found.smallest > 0.05 and found.largest < 1e-13
        most = max(most, found.freedoms)
    assert most == 648


def test_a_body_alone_has_its_rigid_motions_only():
    found = ico.solve_modes(make_scene((1, 1, 1)))
    assert found.counts == (6, 0, 0) and found.mechanism_count == found.rigid_count == 6
    assert not len(found.frequencies) and found.self_stress_count == 0


def test_an_iteration_that_does_not_converge_says_what_to_do(monkeypatch):
    def tired(matrix, **words):
        raise linalg.ArpackNoConvergence('no convergence', np.zeros(0), np.zeros((0, 0)))

    monkeypatch.setattr(linalg, 'eigsh', tired)
    with pytest.raises(ValueError, match='did not converge.*request fewer'):
        modes._iterate(sparse.identity(9, format='csr'), k=2, which='LA')
