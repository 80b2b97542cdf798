# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Small vibrations of fabrics with very stiff beside very soft connectors."""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.commands.modes import summary
import numpy as np
import pytest

SIZE = (4, 4, 2)
GROUPS = {'groups': {'left': 'x_min', 'top': 'z_max'}}


def fabric(stiff, soft=1.0, between='left all', **sections):
    """Fabric whose connectors of one group are `stiff`, and all others `soft` [N/m]."""
    return make_scene(SIZE, {
        'connector.stiffness': soft, 'connector_groups.s.stiffness': stiff,
        'connector_groups.s.between': between}, **GROUPS, **sections)


def exact_frequencies(scene):
    """
    Frequencies [rad/s] above zero of a fabric without tension, by the one-sided Jacobi method.

    In extended precision, from sqrt(k) times the gradient of each length (Hestenes 1958).
    """
    wide = np.longdouble
    bodies, position = scene.connectors.bodies, scene.position.astype(wide)
    points = position[bodies] + scene.connectors.points_body.astype(wide)  # axes are the world's
    reach = points[:, 1] - points[:, 0]
    along = reach / np.sqrt((reach**2).sum(axis=1, keepdims=True))
    mass, inertia = scene.masses.mass.astype(wide), scene.masses.inertia.astype(wide)
    stiffness = np.broadcast_to(scene.connectors.laws.extension, len(bodies)).astype(wide)
    columns = np.zeros((len(bodies), len(position), 6), wide)
    for end, sign in ((0, -1), (1, 1)):
        body = bodies[:, end]
        arm = points[:, end] - position[body]
        place = np.arange(len(bodies)), body
        columns[*place, :3] = sign * along / np.sqrt(mass[body % len(mass)])[:, None]
        columns[*place, 3:] = sign * np.cross(arm, along) / np.sqrt(
            inertia[body % len(inertia)])[:, None]
    columns = columns.reshape(len(bodies), -1) * np.sqrt(stiffness)[:, None]
    for _ in range(30):
        largest = wide(0)
        for i in range(len(columns) - 1):
            for j in range(i + 1, len(columns)):
                one, other = columns[i], columns[j]
                a, b, c = one @ one, other @ other, one @ other
                size = abs(c) / np.sqrt(a * b)
                largest = max(largest, size)
                if size < 1e-18:
                    continue
                slope = (b - a) / (2 * c)
                t = (1 if slope >= 0 else -1) / (abs(slope) + np.sqrt(1 + slope**2))
                cosine = 1 / np.sqrt(1 + t**2)
                columns[i], columns[j] = (
                    cosine * (one - t * other), cosine * (t * one + other))
        if largest < 1e-17:
            break
    return np.sort(np.sqrt((columns**2).sum(axis=1)))


@pytest.mark.parametrize('between, stiff', [
    ('left all', 1e6), ('left all', 1e10), ('top top', 1e10), ('left left', 1e14)])
def test_all_frequencies_beside_a_stiff_group_are_exact(between, stiff):
    scene = fabric(stiff, between=between)
    spectrum = ico.solve_modes(scene)
    expected = exact_frequencies(scene)
    # No state of self-stress: each of the 42 connectors makes a frequency.
    assert len(expected) == scene.connector_count == 42
    assert expected[-1] > 0.2 * np.sqrt(stiff) * expected[0]
    assert np.allclose(spectrum.frequencies, expected, rtol=1e-12, atol=0.0)
    assert spectrum.mechanism_count == spectrum.counts.mechanisms == 96 - 42
    assert spectrum.unstable_count == spectrum.unresolved_mode_count == 0
    assert spectrum.relative_errors.max() < 1e-12
    # Shapes: of unit kinetic energy, and independent of each other and of the mechanisms.
    rows = np.concatenate([spectrum.shapes, spectrum.mechanisms])
    rows *= spectrum.configuration.fabric.root
    rows = rows.reshape(96, 96)
    assert np.allclose(rows @ rows.T, np.eye(96), rtol=0.0, atol=1e-12)
    assert 'rounding' not in '\n'.join(summary(spectrum, 0.0))


def test_soft_frequencies_under_tension_tend_to_those_beside_rigid_connectors():
    # The soft ones differ by the ratio of the stiffnesses, so errors fall by it, too.
    lowest, length = {}, float(fabric(2.0).connectors.woven_length)
    for stiff in (1e7, 1e9, 1e12):
        scene = fabric(stiff).with_changes({
            'connector.natural_length': 0.9 * length, 'connector_groups.s.natural_length': length})
        spectrum = ico.solve_modes(scene)
        lowest[stiff] = spectrum.frequencies[:8]
        assert spectrum.relative_errors.max() < 1e-9
        assert spectrum.mechanism_count < spectrum.counts.mechanisms  # tension stiffens some
    assert lowest[1e12][0] > 0.1
    assert np.allclose(lowest[1e9], lowest[1e12], rtol=1e-7)
    assert np.allclose(lowest[1e7], lowest[1e12], rtol=1e-5)
    assert not np.array_equal(lowest[1e7], lowest[1e12])


def test_verdicts_count_mechanisms_by_the_rank():
    scene = fabric(1e10)
    rest = ico.solve_equilibrium(scene)
    assert rest.mechanism_count == ico.solve_modes(scene).counts.mechanisms == 54


def test_digits_that_rounding_takes_are_reported():
    # Bending stiffness is not taken apart.
    spectrum = ico.solve_modes(fabric(1.0).with_changes({
        'connector_groups.s.bending_stiffness': 1e8}))
    assert spectrum.unresolved_mode_count > 0
    said = '\n'.join(summary(spectrum, 0.0))
    assert 'round-off   ' in said
    ordinary = ico.solve_modes(make_scene(SIZE))
    assert ordinary.unresolved_mode_count == 0
    assert 0.0 < ordinary.relative_errors.max() < 1e-10
    assert 'round-off' not in '\n'.join(summary(ordinary, 0.0))


@pytest.mark.parametrize('stiff, count', [(1e2, 0), (1e10, 1)])
def test_constants_of_the_periodic_fabric_report_lost_digits(stiff, count, caplog):
    constants = ico.homogenise(make_scene((3, 3, 3), {
        'connector.stiffness': 1.0, 'connector_groups.s.direction': 'up down',
        'connector_groups.s.stiffness': stiff}))
    assert constants.stiffness.max() > 0.1 * stiff
    assert caplog.text.count('lose accuracy by round-off') == count
