# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Shells whose density a scene gives by layers."""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.commands.main import main
from icofabric_sim.parameters.text import dump_parameters
import numpy as np
import pytest


@pytest.fixture
def layers(tmp_path):
    """A file of a light shell with a heavy skin."""
    path = tmp_path / 'layers.csv'
    path.write_text('distance,density\n0.0131,800\n0.0146,800\n0.0147,5000\n0.0151,5000\n')
    return path


def test_the_scene_has_the_mass_and_inertia_of_the_layers(layers):
    table = np.loadtxt(layers, delimiter=',', skiprows=1).T
    scene = make_scene((2, 2, 2), {'shell.layers': str(layers)})
    expected = ico.Shell.from_layers(0.02, 0.002, *table)
    assert scene.shell == expected and scene.shell != make_scene((2, 2, 2)).shell
    assert (scene.masses.mass == expected.mass).all()
    # Shells fall alike whatever they weigh, and turn by their own inertia.
    run = ico.compile_scene(make_scene((1, 1, 1), {
        'shell.layers': str(layers), 'groups.it': 'all', 'loads.push.group': 'it',
        'loads.push.torque': [0.0, 0.0, 1e-6]}))
    run.advance_to(0.1)
    assert run.snapshot().angular_velocity[0, 2] == pytest.approx(
        0.1 * 1e-6 / expected.inertia, rel=1e-9)


def test_a_run_with_layers_is_recorded_and_verified(layers, tmp_path, capsys):
    scene = tmp_path / 'scene.yaml'
    scene.write_text(dump_parameters({
        'weave.size': [2, 2, 2], 'shell.layers': str(layers), 'duration': 0.02,
        'initial_random.velocity_sigma': 0.05}))
    assert main(['run', str(scene), '--record', str(tmp_path / 'bag'), '--no-growth']) == 0
    # The bag has the content.
    layers.unlink()
    assert main(['verify', str(tmp_path / 'bag')]) == 0
    assert 'identical' in capsys.readouterr().out


@pytest.mark.parametrize('text, words', [
    ('0.01,1000\n', 'at least two lines'), ('0.01,1000\n0.02,1000\n', 'beyond the faces'),
    ('0.01,1000\n0.009,1000\n', 'must increase'), ('0.01,-1\n0.015,1000\n', 'below 0')])
def test_what_makes_no_sense_is_refused_by_name(layers, text, words):
    layers.write_text(text)
    with pytest.raises(ico.ParameterError, match=words) as caught:
        make_scene((2, 2, 2), {'shell.layers': str(layers)})
    assert caught.value.name == 'shell.layers' and 'layers.csv' in str(caught.value)
