# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Verbs that report print JSON and nothing else; the numbers are those of Python."""

import json

from icofabric_sim.commands.main import main
from icofabric_sim.commands.report import print_json
from icofabric_sim.scene.scene import Scene
from icofabric_sim.statics.equilibrium import solve_equilibrium
from icofabric_sim.statics.modes import solve_modes
from icofabric_sim.statics.periodic import homogenise
import numpy as np
import pytest

SCENE = '/**:\n  ros__parameters:\n    weave: {size: [3, 3, 3], connector_angle: 0.3}\n' \
    '    contact.mode: never\n    connector.bending_stiffness: 0.02\n' \
    '    gravity: [0.0, 0.0, -9.81]\n    groups.wall: x_min\n    supports.wall.group: wall\n'


@pytest.fixture
def said(tmp_path, capsys):
    """A way to call a verb on a small beam: its report, and the scene."""
    path = tmp_path / 'beam.yaml'
    path.write_text(SCENE, 'utf-8')

    def call(verb, *words):
        assert main([verb, str(path), *words, '--json']) == 0
        return json.loads(capsys.readouterr().out)
    call.scene = Scene.from_parameters({
        'weave.size': [3, 3, 3], 'weave.connector_angle': 0.3, 'contact.mode': 'never',
        'connector.bending_stiffness': 0.02, 'gravity': [0.0, 0.0, -9.81],
        'groups.wall': 'x_min', 'supports.wall.group': 'wall'})
    return call


def test_statics(said, tmp_path):
    report = said('statics', '--load-steps', '2', '--output', str(tmp_path / 'out'))
    rest = solve_equilibrium(said.scene)
    assert report['verdict'] == rest.verdict == 'equilibrium, stable' and report['converged']
    assert [step['load'] for step in report['steps']] == [0.5, 1.0]
    np.testing.assert_allclose(report['position_m'], rest.snapshot.position, atol=1e-9)
    np.testing.assert_allclose(report['reaction'], rest.reaction, atol=1e-8)
    assert (tmp_path / 'out' / 'bodies.csv').exists()


def test_modes(said):
    report, spectrum = said('modes'), solve_modes(said.scene)
    np.testing.assert_allclose(report['frequencies_rad_per_s'], spectrum.frequencies, rtol=1e-9)
    assert report['mechanism_count'] == spectrum.mechanism_count and report['branches'] == {}


def test_elasticity(said):
    report = said('elasticity', '--kinds', 'pull', '--points', '2', '--strain', '0.02')
    found = homogenise(said.scene)
    np.testing.assert_allclose(report['stiffness_pa'], found.stiffness, rtol=1e-9, atol=1e-6)
    assert report['bulk_modulus_pa'] == pytest.approx(found.bulk_modulus, rel=1e-9)
    x, y = np.eye(3)[:2]
    assert report['poisson_ratio']['x']['y'] == pytest.approx(
        float(found.poisson_ratio(x, y)), rel=1e-9)
    assert len(report['directions']) == 13
    assert report['directions']['xy']['shear_modulus_pa'] == pytest.approx(
        found.directional_moduli(x + y).shear_modulus, rel=1e-9)
    assert list(report['poisson_ratio']) == ['x', 'y', 'z', 'xy', 'xyz']
    first, second = report['curves']['pull']
    assert second['middle_strain'][1] < 0.0 < second['middle_strain'][0]
    assert second['end_force'][0] > 0.0
    assert second['strain'] == 0.02 and second['stress'] > first['stress'] > 0.0


def test_turns(said):
    report = said('elasticity', '--kinds', 'twist', '--points', '2', '--angle', '0.2')
    first, second = report['moment_curves']['twist']
    assert second['angle'] == 0.2 and second['moment'] > first['moment'] > 0.0
    assert second['end_moment'][0] == pytest.approx(second['moment'], rel=1e-9)
    assert second['breaks'] == [] and not report['curves']
    loop = said(
        'elasticity', '--kinds', 'twist', '--points', '2', '--angle', '0.2', '--cycles', '1')
    [cycle] = loop['cycles']['twist']
    assert cycle['loading_work'] > 0.0
    assert abs(cycle['loop_area']) < 1e-9 * cycle['loading_work']
    states = loop['moment_curves']['twist']
    assert len(states) == 4 and states[-1]['rigidity'] is None


def test_numbers_that_json_lacks_are_null(capsys):
    print_json({'a': np.array([1.0, np.nan]), 'b': float('inf'), 'c': (1, 'x', None, np.True_)})
    assert json.loads(capsys.readouterr().out) == {
        'a': [1.0, None], 'b': None, 'c': [1, 'x', None, True]}
