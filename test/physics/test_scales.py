# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The same scene in other units of length, time and mass gives the same dimensionless run.

Units that are powers of two change no mantissa: where nothing is absolute no bit changes either.
"""

from fabrics import STATE
import icofabric_sim as ico
import numpy as np
import pytest

# What a parameter is measured in: powers of length, time and mass.
UNITS = {
    'shell.edge_length': (1, 0, 0), 'shell.thickness': (1, 0, 0), 'shell.density': (-3, 0, 1),
    'connector.stiffness': (0, -2, 1), 'connector.damping': (0, -1, 1),
    'connector.stiffness_compression': (0, -2, 1), 'gravity': (1, -2, 0),
    'initial_random.velocity_sigma': (1, -1, 0), 'initial_random.spin_sigma': (0, -1, 0),
    'solver.tolerance': (0, -1, 0), 'solver.step': (0, 1, 0), 'publish_rate': (0, -1, 0),
    'planes.floor.offset': (1, 0, 0), 'bodies.b.position': (1, 0, 0),
    'bodies.b.linear_velocity': (1, -1, 0), 'bodies.b.angular_velocity': (0, -1, 0)}
SHELL = {
    'shell.edge_length': 0.02, 'shell.thickness': 0.002, 'shell.density': 1200.0,
    'solver.tolerance': 1e-6, 'solver.threads': 1}
WOVEN = {
    **SHELL, 'weave.size': [2, 2, 2], 'connector.stiffness': 500.0, 'contact.mode': 'never',
    'initial_random.velocity_sigma': 0.5, 'initial_random.spin_sigma': 60.0,
    'initial_random.seed': 1}
LOOSE = {
    **SHELL, 'weave.size': [1, 1, 1], 'weave.connected': False, 'contact.mode': 'auto',
    'bodies.b.position': [0.06, 0.004, 0.003], 'bodies.b.linear_velocity': [-1.0, 0.1, 0.2],
    'bodies.b.angular_velocity': [3.0, -20.0, 8.0], 'solver.method': 'dop8'}
# A shell that falls onto a floor from rest, and one that nothing moves.
DROP = {
    **SHELL, 'weave.size': [1, 1, 1], 'weave.connected': False, 'contact.mode': 'auto',
    'gravity': [0.0, 0.0, -9.81], 'planes.floor.normal': [0.0, 0.0, 1.0],
    'planes.floor.offset': -0.02, 'solver.method': 'dop8'}
# Shells of 5 m, 1 mm and 1 um, in slow and in fast time; masses by powers of four, whose roots
# are exact.
SCALES = [(2.0**8, 2.0**7, 2.0**24), (2.0**-4, 2.0**-20, 2.0**-12), (2.0**-14, 2.0**20, 2.0**-42)]


def scaled(flat, length, time, mass):
    """The same scene in units that are so many times as large."""
    result = dict(flat)
    for name, powers in UNITS.items():
        if name in flat:
            factor = length**powers[0] * time**powers[1] * mass**powers[2]
            value = flat[name]
            result[name] = (
                [factor * x for x in value] if isinstance(value, list) else factor * value)
    return ico.Scene.from_parameters(result)


def run(scene, moments, length=1.0, time=1.0):
    """States at some moments, in units of length and time, and the steps that were taken."""
    simulation = ico.compile_scene(scene)
    states = []
    for moment in moments:
        simulation.advance_to(moment * time)
        snapshot = simulation.snapshot()
        units = {'position': length, 'orientation': 1.0, 'linear_velocity': length / time,
                 'angular_velocity': 1.0 / time}
        states.append([getattr(snapshot, name) / units[name] for name in STATE])
    return states, simulation


@pytest.mark.parametrize('flat, end', [
    ({**WOVEN, 'solver.method': 'leapfrog', 'solver.tolerance': 1e-3}, 0.02),
    ({**WOVEN, 'solver.method': 'dop8'}, 0.02), (LOOSE, 0.05), (DROP, 0.15)],
    ids=['leapfrog', 'dop8', 'collision', 'drop'])
def test_no_bit_depends_on_the_units(flat, end):
    moments = [0.3 * end, end]
    states, simulation = run(scaled(flat, 1.0, 1.0, 1.0), moments)
    assert simulation.status.step_count >= 5
    assert not np.allclose(states[0][0], states[1][0], rtol=0, atol=1e-4)
    if flat['contact.mode'] == 'auto':
        assert simulation.status.deepest_overlap > 0.0
    for length, time, mass in SCALES:
        others, other = run(scaled(flat, length, time, mass), moments, length, time)
        assert other.status.step_count == simulation.status.step_count
        assert other.status.step == time * simulation.status.step
        assert other.error_estimate == simulation.error_estimate
        for state, same in zip(states, others):
            for values, wanted in zip(same, state):
                np.testing.assert_array_equal(values, wanted)


@pytest.mark.parametrize('method', ['leapfrog', 'dop8'])
@pytest.mark.parametrize('time', [2.0**-13, 1.0, 2.0**20])
def test_where_nothing_sets_a_scale_the_step_is_that_of_the_outputs(method, time):
    # One shell that drifts, exactly, in pieces as in one go.
    scene = scaled({
        **SHELL, 'weave.size': [1, 1, 1], 'weave.connected': False, 'contact.mode': 'never',
        'solver.method': method, 'publish_rate': 60.0, 'bodies.b.position': [0.06, 0.0, 0.0],
        'bodies.b.linear_velocity': [-0.5, 0.25, 1.0]}, 1.0, time, 1.0)
    whole, pieces = ico.compile_scene(scene), ico.compile_scene(scene)
    # Of a mantissa of 12 bits.
    assert whole.status.step == pytest.approx(time / 60.0, rel=1e-3)
    end = 0.7 * time
    for moment in (0.001, 0.1, 0.6999):
        pieces.advance_to(moment * time)
        pieces.snapshot()
    for simulation in (whole, pieces):
        simulation.advance_to(end)
    one, two = whole.snapshot(), pieces.snapshot()
    for name in STATE:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    np.testing.assert_allclose(
        one.position[1], np.array([0.06, 0.0, 0.0]) + 0.7 * np.array([-0.5, 0.25, 1.0]),
        rtol=0, atol=1e-14)


def test_a_step_that_never_comes_to_the_end_is_refused():
    scene = scaled({
        **SHELL, 'weave.size': [1, 1, 1], 'weave.connected': False, 'contact.mode': 'never',
        'solver.method': 'leapfrog', 'solver.step': 1e-12}, 1.0, 1.0, 1.0)
    simulation = ico.compile_scene(scene)
    with pytest.raises(ico.SimulationError, match='1e-12 s never come to t = 1000000 s'):
        simulation.advance_to(1e6)
