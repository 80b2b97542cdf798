# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The scripts in examples/ that need no ROS compute what they say."""

import base64
import io
import json
from pathlib import Path
import re
import runpy

from matplotlib import image
import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parent.parent / 'examples'


def load(name):
    return runpy.run_path(str(EXAMPLES / f'{name}.py'))


def test_a_closer_fabric_is_stiffer(tmp_path):
    example = load('sweep_angle')
    rows = example['sweep']([0.2, 0.4, 0.6])
    assert (np.diff(rows[:, 1:], axis=0) < 0.0).all() and (rows > 0.0).all()
    # The column of docs/statics.md at 0.3 rad: 0.919 k / W along x.
    [[_, along, *_]] = example['sweep']([0.3])
    pitch = example['ico'].Scene.from_parameters(
        {**example['BASE'], 'weave.connector_angle': 0.3}).geometry.pitch
    assert along * pitch / 500.0 == pytest.approx(0.919, abs=1e-3)
    example['draw'](rows, tmp_path / 'deep' / 'plot.svg')
    assert 'modulus' in (tmp_path / 'deep' / 'plot.svg').read_text('utf-8') or (
        tmp_path / 'deep' / 'plot.svg').stat().st_size > 5_000


def test_a_slab_tears_where_stress_drops():
    scene, points, broken = load('tear')['tear']([0.03, 0.06, 0.08, 0.1])
    assert broken[0] == broken[1] == [] and len(broken[2]) > 0
    assert points[1].stress > points[0].stress and points[2].stress < points[1].stress
    assert sum(map(len, broken)) == points[-1].broken < scene.connector_count
    assert len({*sum(broken, [])}) == points[-1].broken


@pytest.mark.long
def test_statics_and_motion_bend_a_beam_alike():
    verdict, (solved, ran), _, apart = load('bend')['bend']((3, 3, 3), 2.0)
    assert verdict == 'equilibrium, stable'
    assert solved > 1e-4 and ran == pytest.approx(solved, rel=1e-3) and apart < 1e-3 * solved


@pytest.mark.long
@pytest.mark.parametrize('size', [1.0, 2.5])
def test_an_indenter_feels_what_the_floor_bears_and_a_heavy_ball_bounces(size):
    example = load('indent')
    depths = np.array([0.001, 0.00101, 0.003])
    rows = np.array(example['indent'](depths.tolist(), size))
    depth, force, floor, pairs, energy = rows.T
    assert depth == pytest.approx(depths) and (pairs > 0).all()
    assert force == pytest.approx(floor, rel=1e-8) and (np.diff(force) > 0.0).all()
    # Its work: the force is the derivative of the energy.
    assert energy[1] - energy[0] == pytest.approx(
        0.5 * (force[0] + force[1]) * (depth[1] - depth[0]), rel=1e-4)
    kept, velocity = example['strike'](0.1, size, 0.5, 0.1)
    assert 0.2 < kept < 0.98 and velocity > 0.1


def test_wind_of_your_own_blows_downwind_and_its_work_is_counted():
    example = load('own_force')
    low, high = (
        example['wind'](0.0, np.array([0.0, 0.0, height]), None, np.zeros(3), np.zeros(3))[0]
        for height in (0.0, 0.1))
    # As the first line of its text says.
    assert 'grows with height' in example['__doc__'] and 0.0 < low[1] < 0.9 * high[1]
    moved, simulation = example['blow'](0.2)
    energy = simulation.snapshot().energy
    assert moved > 1e-5 and energy['work_in'] > 0.0
    assert abs(energy['balance_error']) < 1e-4 * energy['work_in']


def test_the_notebook_says_what_its_outputs_say():
    pytest.importorskip('ipykernel', reason='requirements-test.txt lists it')
    notebook = json.loads((EXAMPLES / 'first_steps.ipynb').read_text('utf-8'))
    run = runpy.run_path(str(EXAMPLES.parent / 'docs' / 'run_notebook.py'))['run']

    def said(document):
        return '\n'.join(
            ''.join(output.get('text', []) or output['data']['text/plain'])
            for cell in document['cells'] for output in cell.get('outputs', []))
    kept, number = said(notebook), r'-?[0-9]+(?:\.[0-9]*)?(?:e-?[0-9]+)?'
    found = said(run(notebook, EXAMPLES))
    assert len(kept) > 200 and 'equilibrium, stable' in kept
    assert re.sub(number, '', found) == re.sub(number, '', kept)
    # But for what is left over of forces, which is rounding.
    pairs = zip(re.findall(number, found), re.findall(number, kept))
    assert all(float(one) == pytest.approx(float(other), rel=1e-2) for one, other in pairs
               if float(other) > 1e-6)
    # A plain kernel shows the plot, once.
    [shown] = [output for cell in notebook['cells'] for output in cell.get('outputs', [])
               if 'image/png' in output.get('data', {})]
    picture = image.imread(io.BytesIO(base64.b64decode(shown['data']['image/png'])))
    assert picture.shape[1] > 300 and picture[:, :, :3].std() > 0.05
