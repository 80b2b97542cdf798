# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Connectors by the pair of edges that they join: three kinds to a cell, in slabs and without end.
"""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import edge_midpoints, NAMED_EDGES
from icofabric_sim.scene.weave_tables import TABLE_5
from icofabric_sim.statics.periodic import homogenise, solve_bands
import numpy as np
import pytest

PAIRS = ('up down', 'north south', 'west east')
# By pair [N/m].
STIFFNESS = (300.0, 500.0, 800.0)
BY_DIRECTION = {
    name: {'direction': pair, 'stiffness': stiffness}
    for name, pair, stiffness in zip(('vertical', 'along', 'across'), PAIRS, STIFFNESS)}
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def kinds(scene):
    """Which pair each connector joins, by the names of its edges."""
    names = np.array(NAMED_EDGES)[scene.connectors.edges]
    return np.array([[set(ends) == set(pair.split()) for pair in PAIRS].index(True)
                     for ends in names.tolist()])


@pytest.mark.parametrize('weave', [
    {}, {'variant': 2}, {'kind': 'bias', 'azimuth': 0.3},
    {'kind': 'radial', 'radius': 0.4}, {'region': 'sphere 0.09', 'size': [6, 6, 6]}])
def test_a_direction_is_the_pair_of_edges_that_connectors_join(weave):
    scene = make_scene(weave={'size': [4, 4, 4], 'connector_angle': 0.3, **weave},
                       connector_groups=BY_DIRECTION)
    found = kinds(scene)
    assert set(found) == {0, 1, 2}
    assert (scene.connectors.stiffness == np.array(STIFFNESS)[found]).all()
    turned = make_scene(weave={'size': [4, 4, 4], 'connector_angle': 0.3, **weave},
                        connector_groups={'one': {'direction': 'down up', 'damping': 0.2}})
    assert (turned.connectors.damping == np.where(found == 0, 0.2, 0.0)).all()


def test_a_direction_between_groups_is_both_and_the_last_group_counts():
    scene = make_scene((4, 4, 4), groups={'low': 'z_min'}, connector_groups={
        'a': {'between': 'low all', 'direction': 'up down', 'stiffness': 100.0},
        'b': {'between': 'low low', 'stiffness': 200.0}})
    low = np.isin(scene.connectors.bodies, scene.groups['low'])
    expected = np.full(scene.connector_count, 500.0)
    expected[low.any(axis=1) & (kinds(scene) == 0)] = 100.0
    expected[low.all(axis=1)] = 200.0
    assert set(expected) == {100.0, 200.0, 500.0}
    assert (scene.connectors.stiffness == expected).all()


def test_every_property_goes_by_direction():
    scene = make_scene((3, 3, 3), connector_groups={'it': {
        'direction': 'west east', 'natural_length': 0.02, 'bending_stiffness': 0.01,
        'twisting_stiffness': 0.02, 'damping': 0.03, 'break_length_extension': 0.3}})
    mine = kinds(scene) == 2
    rest = scene.geometry.connector_length
    for values, own, other in (
            (scene.connectors.natural_length, 0.02, rest),
            (scene.connectors.bending_stiffness, 0.01, 0.0),
            (scene.connectors.twisting_stiffness, 0.02, 0.0),
            (scene.connectors.damping, 0.03, 0.0),
            (scene.connectors.limits.longest, 0.3, np.inf)):
        assert (values == np.where(mine, own, other)).all()


def cell_energy(scene, strain, turn, stiffness, natural):
    """
    Energy [J] of one cell of point springs, all bodies strained and turned alike.

    Straight from Table 5: of each edge the two connectors that begin at it, half of each.
    """
    pitch, points = scene.geometry.pitch, edge_midpoints(scene.geometry.half_edge)
    angle = np.linalg.norm(turn)
    cross = np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
    turned = np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(
        0.5 * angle / np.pi)**2 * cross @ cross
    gradient = np.zeros((3, 3))
    for (i, j), value in zip(VOIGT, strain):
        gradient[i, j] += 0.5 * value
        gradient[j, i] += 0.5 * value
    energy = 0.0
    for code, step in TABLE_5:
        place = (np.eye(3) + gradient) @ (pitch * np.array(step, float))
        span = place + turned @ (points[code ^ 1] - points[code])
        kind = code // 2
        energy += 0.25 * stiffness[kind] * (np.linalg.norm(span) - natural[kind])**2
    return energy


def second_derivatives(function, count, step):
    """By central differences."""
    unit = step * np.eye(count)
    return np.array([[
        (function(a + b) - function(a - b) - function(b - a) + function(-a - b)) / (4.0 * step**2)
        for b in unit] for a in unit])


@pytest.mark.parametrize('ratios', [(1.0, 1.0, 1.0), (0.97, 0.9, 0.93)])
def test_constants_of_three_kinds_are_those_of_their_energy(ratios):
    scene = make_scene(weave={'size': [3, 3, 3], 'connector_angle': 0.2})
    natural = np.array(ratios) * scene.geometry.connector_length
    scene = scene.with_changes({'connector_groups': {
        name: {**group, 'natural_length': float(length)}
        for (name, group), length in zip(BY_DIRECTION.items(), natural)}})
    # What the fabric's axes are in the world: Table 5 counts along them.
    assert scene.weave.kind == 'orthogonal' and scene.weave.variant == 0

    def energy(y):
        return cell_energy(scene, y[:6], y[6:], STIFFNESS, natural)

    form = second_derivatives(energy, 9, 1e-4)
    strain, mixed, turn = form[:6, :6], form[:6, 6:], form[6:, 6:]
    volume = 2.0 * scene.geometry.pitch**3
    expected = (strain - mixed @ np.linalg.pinv(turn, rcond=1e-6) @ mixed.T) / volume
    found = homogenise(scene)
    scale = np.abs(expected).max()
    assert found.stiffness == pytest.approx(expected, abs=1e-5 * scale)
    gradient = np.array([(energy(d) - energy(-d)) / 2e-6 for d in 1e-6 * np.eye(9)[:6]])
    assert found.stress == pytest.approx(gradient / volume, abs=1e-6 * scale)
    # Three kinds: no two axes are alike.
    assert np.ptp(np.diag(found.stiffness)[:3]) > 0.1 * scale


def test_waves_of_three_kinds_are_those_of_a_moving_slab():
    """Directions permuted, the same waves along permuted axes; long ones by the constants."""
    stiff = {'bending_stiffness': 0.02, 'twisting_stiffness': 0.01}
    scene = make_scene(weave={'size': [3, 3, 3], 'connector_angle': 0.3}, connector=stiff,
                       connector_groups=BY_DIRECTION)
    constants = homogenise(scene)
    number = 1e-3 / scene.geometry.pitch
    for axis, shears in ((0, (5, 4)), (1, (5, 3)), (2, (4, 3))):
        bands = solve_bands(scene, number * np.eye(3)[axis])[0]
        c = np.diag(constants.stiffness)
        speeds = np.sort([np.sqrt(c[i] / constants.density) for i in (axis, *shears)])
        assert np.sort(bands[:3]) == pytest.approx(number * speeds, rel=1e-5)


def test_what_is_no_direction_is_refused():
    for wrong in ('up', 'up north', 'north north', 'x y', 'up down up'):
        with pytest.raises(ico.ParameterError, match='up down, north south or west east'):
            make_scene((3, 3, 3), connector_groups={'g': {'direction': wrong, 'stiffness': 1.0}})
    with pytest.raises(ico.ParameterError, match=r'g\.between is missing.*g\.direction'):
        make_scene((3, 3, 3), connector_groups={'g': {'stiffness': 1.0}})
    with pytest.raises(ico.ParameterError, match='no connector joins west east'):
        make_scene(weave={'size': [6, 1, 2]}, connector_groups={'g': {'direction': 'west east'}})
    with pytest.raises(ico.ParameterError, match='direction only'):
        homogenise(make_scene((3, 3, 3), groups={'low': 'z_min'}, connector_groups={
            'g': {'between': 'low all', 'direction': 'up down', 'stiffness': 1.0}}))
