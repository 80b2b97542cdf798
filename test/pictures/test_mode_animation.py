# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Modes in motion: pictures that move, and bags that players take."""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.bag.summary import summarise_bag
from icofabric_sim.commands.main import main
from icofabric_sim.pictures.mode_animation import HALF, PERIOD, write_bag, write_gif
from icofabric_sim.running.replay.source import ReplaySource
import numpy as np
from PIL import Image
import pytest


@pytest.fixture(scope='module')
def beam():
    return make_scene(
        (3, 2, 2), groups={'wall': 'x_min'}, supports={'wall': {'group': 'wall'}},
        connector={'bending_stiffness': 5e-3})


@pytest.fixture(scope='module')
def modes(beam):
    return ico.solve_modes(beam, count=2)


def test_a_swing_as_a_picture_that_moves(beam, modes, tmp_path):
    path, seen = tmp_path / 'new' / 'mode.gif', []
    write_gif(path, 'beam', beam, modes.snapshot, modes.shapes[0], progress=seen.append)
    assert seen == list(range(1, HALF + 2))
    with Image.open(path) as picture:
        assert picture.n_frames == 2 * HALF and picture.info['loop'] == 0
        assert picture.n_frames * picture.info['duration'] == pytest.approx(
            1000.0 * PERIOD, rel=0.05)
        frames = []
        for number in (0, HALF, 1, 2 * HALF - 1):
            picture.seek(number)
            frames.append(np.array(picture.convert('RGB'), int))
    start, end, after, before = frames
    # It moves, and comes back the way it went.
    assert np.abs(start - end).max() > 50
    assert np.array_equal(after, before) and not np.array_equal(after, start)


def test_swings_as_a_bag(beam, modes, tmp_path):
    folder = tmp_path / 'swing'
    write_bag(folder, 'mode 0', beam, modes.snapshot, modes.shapes[0])
    with RecordedRun(folder) as run:
        frames = list(run.poses())
        assert run.custom['animation'] == 'mode 0'
        assert run.scene_at(run.start).body_count == beam.body_count
    moved = np.array([frame.position for frame in frames]) - modes.snapshot.position
    times = np.array([frame.time for frame in frames])
    shape = modes.shapes[0][:, :3]
    along = (moved * shape).sum(axis=(1, 2)) / (shape**2).sum()
    # One swing in PERIOD seconds, along the mode alone.
    assert along == pytest.approx(along[0] * np.cos(2.0 * np.pi * times / PERIOD), abs=1e-9)
    assert np.abs(moved - along[:, None, None] * shape).max() < 1e-12
    assert 0.1 < np.abs(moved).max() / beam.geometry.half_edge <= 1.0 + 1e-9
    with ReplaySource(folder) as source:
        assert {'poses', 'connectors', 'weave'} <= {
            name.rpartition('/')[2] for name in source.topics}
    lines = '\n'.join(summarise_bag(folder).lines())
    assert '; not simulated' in lines and 'killed' not in lines


def test_the_verb(tmp_path, capsys):
    scene, bag = 'stiff_cantilever', tmp_path / 'bag'
    few = ['modes', scene, '-p', 'weave.size:=[3, 2, 2]', '--count', '2', '--animate']
    assert main([*few, str(bag), '--mode', '1']) == 0
    assert 'mode 1' in capsys.readouterr().out
    assert main(['verify', str(bag)]) == 2
    assert 'animation' in capsys.readouterr().err
    for more, word in (
            ([str(bag)], 'exists'), ([str(tmp_path / 'a.mp4')], '.gif'),
            ([str(tmp_path / 'a.gif'), '--mode', '2'], 'mode 2 does not exist'),
            ([str(tmp_path / 'a.gif'), '--mode', '-1'], 'from 0'),
            ([str(tmp_path / 'b'), '--mechanism', '500'], 'motion 500 does not exist')):
        assert main([*few, *more]) == 2
        assert word in capsys.readouterr().err
    assert main(['modes', scene, '--mode', '1']) == 2
