# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Hinges: penalty springs of natural length 0, alone or along an axis."""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.messages.markers import ConnectorMarkers
import numpy as np
import pytest
from scipy.integrate import solve_ivp

DEPTH, STIFFNESS = 0.015, 2e5
HUNG = {
    'contact.mode': 'never', 'supports.s.group': 'held', 'groups.held': 'ids 0',
    'bodies.x.position': [0.0, 0.0, -2.0 * DEPTH], 'connectors.h.kind': 'hinge',
    # The held body comes second.
    'connectors.h.bodies': [1, 0], 'connectors.h.points': [0.0, 0.0, DEPTH, 0.0, 0.0, 0.0],
    'connectors.h.stiffness': STIFFNESS}


def test_a_body_on_a_hinge_swings_as_a_compound_pendulum():
    """(Lambda + M d^2) theta'' = -M g d sin theta, up to an opening of about M g / k."""
    rate = 25.0
    scene = make_scene((1, 1, 1), {
        **HUNG, 'gravity': [0.0, 0.0, -9.81], 'bodies.x.angular_velocity': [rate, 0.0, 0.0],
        # omega x r with r = (0, 0, -d).
        'bodies.x.linear_velocity': [0.0, rate * DEPTH, 0.0]})
    simulation = ico.compile_scene(scene)
    mass, inertia = scene.shell.mass, scene.shell.inertia
    square = mass * 9.81 * DEPTH / (inertia + mass * DEPTH**2)
    times = np.linspace(0.0, 0.3, 7)
    angle = solve_ivp(
        lambda t, y: [y[1], -square * np.sin(y[0])], (0.0, 0.3), [0.0, rate], 'DOP853',
        rtol=1e-10, atol=1e-12, t_eval=times).y[0]
    assert np.abs(angle).max() > 0.5
    for time, wanted in zip(times[1:], angle[1:]):
        simulation.advance_to(float(time))
        found = simulation.snapshot()
        expected = [0.0, DEPTH * np.sin(wanted), -DEPTH - DEPTH * np.cos(wanted)]
        np.testing.assert_allclose(found.position[1], expected, atol=2e-5)
        assert found.connector_length[0] < 5e-6
    assert simulation.balance.worst < 1e-4
    # A hinge has no strain.
    assert len(list(ConnectorMarkers(scene).messages(found, 0))) == 6


@pytest.mark.parametrize('axis, count', [([0.0, 0.0, 0.0], 3), ([3.0, 0.0, 0.0], 1)])
def test_a_hinge_leaves_rotations_and_sinks_by_its_stiffness(axis, count):
    scene = make_scene((1, 1, 1), {
        **HUNG, 'gravity': [0.0, 0.0, -9.81], 'connectors.h.axis': axis})
    assert scene.connector_count == (2 if count == 1 else 1)
    rest = ico.solve_equilibrium(scene)
    sunk = scene.shell.mass * 9.81 / STIFFNESS
    assert rest.converged
    np.testing.assert_allclose(
        rest.snapshot.position[1], [0.0, 0.0, -2.0 * DEPTH - sunk], atol=1e-12)
    modes = ico.solve_modes(scene, at=rest.snapshot)
    assert modes.counts.mechanisms == count
    # Gravity makes pendulums of rotations about horizontal axes.
    mass, inertia = scene.shell.mass, scene.shell.inertia
    swing = np.sqrt(mass * 9.81 * DEPTH / (inertia + mass * DEPTH**2))
    soft = modes.frequencies[modes.frequencies < 100.0]
    np.testing.assert_allclose(soft, [swing] * (2 if count == 3 else 1), rtol=1e-3)
    assert modes.mechanism_count == (1 if count == 3 else 0)
    if count == 1:
        # About z, (k / 2) a^2 at either end resists the rotation.
        a = scene.geometry.half_edge
        turning = np.sqrt(STIFFNESS * a**2 / inertia)
        assert np.abs(modes.frequencies / turning - 1.0).min() < 1e-3


def test_a_hinge_breaks_at_its_opening():
    scene = make_scene((1, 1, 1), {
        **HUNG, 'connectors.h.stiffness': 100.0, 'bodies.x.linear_velocity': [0.0, 0.0, -1.0],
        'connectors.h.break_length_extension': 1e-3})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.01)
    found = simulation.snapshot()
    assert not found.intact.any()
    assert found.energy['lost_at_breaks'] == pytest.approx(50.0 * 1e-6, rel=1e-6)


@pytest.mark.parametrize('changes, name, words', [
    ({'points': [0.0, 0.0, 0.01, 0.0, 0.0, 0.01]}, 'connectors.h.points', 'm apart at rest'),
    ({'natural_length': 0.01}, 'connectors.h.natural_length', 'a hinge has none'),
    ({'damping': 0.01}, 'connectors.h.damping', 'a hinge has none'),
    ({'kind': 'spring', 'axis': [0.0, 0.0, -1.0]}, 'connectors.h.axis', 'only hinges have it'),
])
def test_bad_hinges_are_refused_by_name(changes, name, words):
    with pytest.raises(ico.ParameterError, match=name) as caught:
        make_scene((1, 1, 1), {
            **HUNG, **{f'connectors.h.{field}': value for field, value in changes.items()}})
    assert words in str(caught.value)
