# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Rest and vibrations with connectors around shells: exact second derivatives, closed forms, runs.
"""

from fabrics import changed, make_scene
import icofabric_sim as ico
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.mechanisms import compatibility_matrix
from icofabric_sim.statics.spectrum import scaled_hessian
from icofabric_sim.statics.wrapped import find_ways
import numpy as np
import pytest

WRAP = {'connector.obstruction': 'wrap', 'contact.mode': 'never'}
CASES = {
    'plain': WRAP,
    'kinked': {
        **WRAP, 'connector.stiffness_compression': 150.0, 'connector.natural_length': 0.035,
        'connector.twisting_stiffness': 2e-4, 'weave.kind': 'bias'},
    'posts that resist bending': {
        **WRAP, 'connector.attachment_scale': 1.15, 'connector.bending_stiffness': 0.01,
        'connector.attachment.up': [0.0, 0.005, 0.0162]}}


def turned_fabric(case, seed=1, size=(3, 3, 2)):
    """A configuration in which many connectors lie around shells, some around both."""
    fabric = StaticFabric(make_scene(size, case))
    random = np.random.default_rng(seed)
    shape = len(fabric.free), 3
    here = fabric.start.moved(np.hstack([
        2e-3 * random.standard_normal(shape), 0.9 * random.standard_normal(shape)]))
    assert len(here.wrapped.of) > 5
    return here


def crossed(vectors):
    """Matrices that take a to v x a."""
    x, y, z = vectors
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def gradient_of_length(rows, ways, places, position, axes, straight):
    """
    First derivatives (12,) of one length, its places settled by Newton's method; also complex.

    `rows` (2, 10) of the two ways, `position` (2, 3), `axes` (2, 3, 3) as rows, `straight`
    (2, 3) the attachment points in body axes.
    """
    y = np.array(places, complex)
    free = np.flatnonzero(np.asarray(ways) >= 0)
    for _ in range(8):
        arms = [
            (rows[e, :3] + y[e] * rows[e, 3:6] if ways[e] >= 0 else straight[e]) @ axes[e]
            for e in range(2)]
        edges = [rows[e, 3:6] @ axes[e] for e in range(2)]
        reach = position[1] + arms[1] - position[0] - arms[0]
        length = np.sqrt(reach @ reach)
        n = reach / length
        wound = np.sqrt((y - rows[:, 6])**2 + rows[:, 7]**2)
        signs = np.array([-1.0, 1.0])
        left = (y - rows[:, 6]) / wound + signs * np.array([n @ t for t in edges])
        project = (np.eye(3) - np.outer(n, n)) / length
        slope = np.array([[
            signs[i] * signs[j] * (edges[i] @ project @ edges[j])
            + (i == j) * rows[i, 7]**2 / wound[i]**3 for j in range(2)] for i in range(2)])
        if len(free):
            y[free] -= np.linalg.solve(slope[np.ix_(free, free)], left[free])
    assert np.abs(left[free]).max(initial=0.0) < 1e-13
    return np.concatenate([-n, -np.cross(arms[0], n), n, np.cross(arms[1], n)])


@pytest.mark.parametrize('seed, name', [
    (1, 'plain'), (2, 'plain'), (1, 'posts that resist bending')])
def test_second_derivatives_of_lengths_by_the_complex_step(seed, name):
    here = turned_fabric(CASES[name], seed)
    packed = pack_scene(here.fabric.scene)
    wrapping, connectors = packed.model.wrapping, packed.connectors
    of = here.wrapped.of
    ways, places = np.zeros((len(of), 2), np.int64), np.zeros((len(of), 2))
    find_ways(
        wrapping, connectors, np.ascontiguousarray(here.position.T),
        np.ascontiguousarray(here.orientation.T), of, ways, places)
    assert (ways >= 0).all(axis=1).any() and not (ways >= 0).all()
    bodies = here.fabric.scene.connectors.bodies[of]
    h, worst = 1e-30, 0.0
    for w, second in enumerate(here.wrapped.second):
        codes = [connectors.first_edge[of[w]], connectors.second_edge[of[w]]]
        rows = np.array([wrapping.ways[code, max(way, 0)] for code, way in zip(codes, ways[w])])
        position, axes = here.position[bodies[w]], here.axes[bodies[w]]
        arms = here.snapshot.connector_ends[of[w]] - position
        straight = np.einsum('eik,ek->ei', axes, arms)
        columns = np.zeros((12, 12))
        for freedom in range(12):
            end, k = divmod(freedom, 6)
            moved, turned = position.astype(complex), axes.astype(complex)
            if k < 3:
                moved[end, k] += 1j * h
            else:
                # exp(i h theta) to first order: what is left out is real.
                turned[end] = turned[end] @ (
                    np.eye(3) + 1j * h * crossed(np.eye(3)[k - 3])).T
            columns[:, freedom] = gradient_of_length(
                rows, ways[w], places[w], moved, turned, straight).imag / h
        worst = max(worst, np.abs(
            0.5 * (columns + columns.T) - second).max() / np.abs(second).max())
    assert 0.0 < worst < 1e-11


@pytest.mark.parametrize('name', CASES)
def test_forces_and_hessian_are_derivatives_of_the_energy(name):
    here = turned_fabric(CASES[name])
    random = np.random.default_rng(2)
    shape = len(here.position), 3
    first, second = (np.hstack([
        1e-2 * random.standard_normal(shape), random.standard_normal(shape)]) for _ in range(2))
    h = 1e-6
    power = (here.moved(h * first).energy - here.moved(-h * first).energy) / (2.0 * h)
    assert power == pytest.approx(-float((here.force * first).sum()), rel=1e-6)
    product = here.times(first)
    assert (second * product).sum() == pytest.approx((first * here.times(second)).sum(), rel=1e-9)
    change = (here.moved(-h * first).force - here.moved(h * first).force) / (2.0 * h)
    assert np.allclose(product[:, :3], change[:, :3], atol=1e-6 * np.abs(change[:, :3]).max())
    # The second derivative along a path: the torques at both ends hold it, too.
    assert (first * product).sum() == pytest.approx((first * change).sum(), rel=1e-6)
    # The matrix is the product column by column.
    matrix = scaled_hessian(here).toarray()
    root = here.fabric.root
    assert np.allclose(
        matrix @ (root * first).ravel(), (product / root).ravel(),
        atol=1e-9 * np.abs(product / root).max())
    # Lengths change with the free parts.
    changes = compatibility_matrix(here) @ (root * first).ravel()
    ahead, behind = (here.moved(sign * h * first).snapshot.connector_length for sign in (1, -1))
    assert np.allclose(changes, (ahead - behind) / (2.0 * h), atol=1e-6 * np.abs(changes).max())


def column(**changes):
    """Return the twisted column with bands that only pull."""
    scene = ico.load_scene('twisted_column')
    return changed(scene, {
        'connector.natural_length': 0.04, 'connector.stiffness_compression': 0.0,
        'contact.stiffness': 2e4, **changes})


@pytest.mark.long
def test_a_twisted_column_rests_where_a_run_with_drag_ends():
    scene = column()
    found = ico.solve_equilibrium(scene, time=2.0)
    assert found.converged and found.verdict.startswith('equilibrium, stable')
    around = found.snapshot.obstructed > 0
    assert around.sum() >= 4
    # Damped more, and from there: a minimum of the same energy does not move.
    held = {
        name: value for name, value in scene.parameters.items()
        if value != '' and not name.startswith(('drives.', 'loads.'))}
    still = ico.Scene.from_parameters({
        **held, 'supports.lid.group': 'lid', 'drag.linear': 0.5, 'drag.angular': 2e-4})
    simulation = ico.compile_scene(still)
    random = np.random.default_rng(1)
    free = np.where(found.reaction[:, :1] == 0.0, 1.0, 0.0)
    simulation.set_state(
        position=found.snapshot.position + 2e-5 * free * random.standard_normal((len(free), 3)),
        orientation=found.snapshot.orientation)
    simulation.advance_to(3.0)
    moved = simulation.snapshot()
    assert np.abs(moved.position - found.snapshot.position).max() < 1e-8
    assert moved.energy['connectors'] == pytest.approx(
        found.snapshot.energy['connectors'], rel=1e-9)


def test_bands_that_push_where_geodesics_change_are_named():
    found = ico.solve_equilibrium(
        ico.load_scene('twisted_column'), time=2.0, largest_step_count=100)
    assert not found.converged
    assert 'connector.stiffness_compression' in found.reason
    named = [int(word) for word in found.reason.split(' are in compression')[0].replace(
        ' and more', '').removeprefix('connectors ').split(', ')]
    assert (found.tension[named] < 0.0).all() and (found.snapshot.obstructed[named] > 0).all()


def test_the_moment_of_a_twist_is_that_of_bands_around_shells():
    """
    A twist of a column with bands around shells: its moment is the derivative of its energy.

    And it differs from that of connectors that pass through.
    """
    moments = []
    for obstruction in ('wrap', 'warn'):
        scene = changed(ico.load_scene('twisted_column'), {
            'connector.natural_length': 0.06, 'connector.obstruction': obstruction})
        points = ico.measure_moment_curve(
            scene, 'twist', [0.4, 0.8, 1.2, 1.5999, 1.6, 1.6001], axis=2)
        assert len(points) == 6 and all(point.residual < 1e-9 for point in points)
        low, middle, high = points[3:]
        assert middle.obstructed > 0
        assert (high.energy - low.energy) / 2e-4 == pytest.approx(middle.moment, rel=1e-5)
        moments.append(middle.moment)
    assert abs(moments[0] / moments[1] - 1.0) > 1e-3
