# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Pictures: what they show, that it moves, and that it is where it should be."""

import math
from pathlib import Path

from icofabric_sim.bag import BagRecorder
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.commands.main import main
from icofabric_sim.geometry.icosahedron import circumscribed_radius, inscribed_radius
from icofabric_sim.messages import PoseArrayBytes
from icofabric_sim.messages.topics import STRAIN_CLASSES
from icofabric_sim.pictures.drawing import Moment, Renderer
from icofabric_sim.pictures.fabric_polygons import (
    bounds_of,
    connector_ends,
    fabric_polygons,
    FREE_COLOR,
    HELD_COLOR,
    strain_classes,
    View,
)
from icofabric_sim.pictures.render import draw_sheet, nearest_times, RunPictures, spread_times
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import compile_scene
from matplotlib.image import imread
import numpy as np
import pytest
from recorded_runs import record_push, swing_scene

SIZE = (640, 480)


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('bags') / 'swing'
    record_push(path, swing_scene())
    return path


def drawn(path: Path) -> np.ndarray:
    """Pixels that are not white, (height, width) bool."""
    picture = imread(path)
    assert picture.ndim == 3
    return np.asarray((picture[:, :, :3] < 0.98).any(axis=2))


def one_body(**changes: object) -> Scene:
    return Scene.from_parameters({
        'weave.size': [1, 1, 1], 'initial.turn.group': 'all',
        'initial.turn.rotation': [0.3, -0.8, 0.5], **changes})


# Geometry.

@pytest.mark.parametrize('azimuth, elevation, right, up', [
    (0.0, 0.0, (0, 1, 0), (0, 0, 1)),
    (-math.pi / 2, 0.0, (1, 0, 0), (0, 0, 1)),
    (-math.pi / 2, math.pi / 2, (1, 0, 0), (0, 1, 0)),
])
def test_view_axes(
        azimuth: float, elevation: float, right: tuple[int, ...], up: tuple[int, ...]) -> None:
    axes = View(azimuth, elevation).axes
    np.testing.assert_allclose(axes[:2], [right, up], atol=1e-15)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(np.cross(axes[0], axes[1]), axes[2], atol=1e-15)


def test_connector_ends_are_those_of_the_simulation() -> None:
    simulation = compile_scene(swing_scene())
    simulation.advance_to(0.2)
    state = simulation.snapshot()
    ends = connector_ends(simulation.scene, state.position, state.orientation)
    np.testing.assert_allclose(ends, state.connector_ends, rtol=0, atol=1e-15)
    strain = state.connector_length / simulation.scene.connectors.natural_length - 1.0
    classes = strain_classes(simulation.scene, ends)
    assert len(set(classes.tolist())) > 2
    for number, value in zip(classes, strain):
        assert value > STRAIN_CLASSES[number].above
        assert number + 1 == len(STRAIN_CLASSES) or value <= STRAIN_CLASSES[number + 1].above


def test_shell_is_drawn_as_its_silhouette() -> None:
    scene = one_body()
    state = scene.initial
    view = View()
    bounds = bounds_of(state.position, scene.shell.half_edge, view)
    shapes = fabric_polygons(
        scene, state.position, state.orientation, view=view, bounds=bounds, line_width=1e-3)
    # A point reflection maps the icosahedron to itself: half of the faces look at the viewer.
    assert len(shapes.corners) == 10
    x, y = shapes.corners[..., 0], shapes.corners[..., 1]
    area = 0.5 * (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)
    # Counter-clockwise for the viewer, as seen from outside.
    assert (area > 0.0).all()
    a = scene.shell.half_edge
    low, high = inscribed_radius(a), circumscribed_radius(a)
    assert math.pi * low**2 < area.sum() < math.pi * high**2
    centre = state.position @ view.axes[:2].T
    distance = np.linalg.norm(shapes.corners - centre, axis=2)
    assert distance.max() <= high * (1 + 1e-12)


def test_nearer_is_drawn_later() -> None:
    scene = Scene.from_parameters({
        'weave.size': [1, 1, 1], 'groups.far': 'ids 0', 'supports.far.group': 'far',
        'bodies.near.position': [0.0, -0.1, 0.0]})
    state = scene.initial
    view = View(-math.pi / 2, 0.0)  # from -y
    bounds = bounds_of(state.position, scene.shell.half_edge, view)
    shapes = fabric_polygons(
        scene, state.position, state.orientation, view=view, bounds=bounds, line_width=1e-3)
    # The held body is bluish, the free one yellowish.
    bluish = shapes.colors[:, 2] > shapes.colors[:, 0]
    half = len(bluish) // 2
    assert half == 10 and bluish[:half].all() and not bluish[half:].any()
    assert HELD_COLOR[2] > HELD_COLOR[0] and FREE_COLOR[2] < FREE_COLOR[0]


def test_many_bodies_become_discs(monkeypatch: pytest.MonkeyPatch) -> None:
    from icofabric_sim.pictures import fabric_polygons as module
    scene = swing_scene()
    state = scene.initial
    view = View()
    bounds = bounds_of(state.position, scene.shell.half_edge, view)
    monkeypatch.setattr(module, 'LARGEST_SHELL_COUNT', 5)
    shapes = fabric_polygons(
        scene, state.position, state.orientation, view=view, bounds=bounds, line_width=1e-3)
    assert len(shapes.corners) == scene.body_count + scene.connector_count


# Times.

def test_times_are_recorded_ones() -> None:
    times = np.array([0, 10, 20, 35, 50])
    np.testing.assert_array_equal(nearest_times(times, [4, 6, 29, 99]), [0, 10, 35, 50])
    np.testing.assert_array_equal(nearest_times(times, [1, 2]), [0])
    np.testing.assert_array_equal(spread_times(times, 3), [0, 20, 50])
    np.testing.assert_array_equal(spread_times(times, 50), times)
    np.testing.assert_array_equal(spread_times(times, 1), [0])


# Pictures.

def test_frames_are_full_and_move(bag: Path, tmp_path: Path) -> None:
    with RecordedRun(bag) as run:
        times = spread_times(run.pose_times(), 3)
        paths = RunPictures(run, size=SIZE).frames(times, tmp_path / 'frames')
    assert [path.name for path in paths] == [f'frame_000{k}.png' for k in (1, 2, 3)]
    masks = [drawn(path) for path in paths]
    for mask, path in zip(masks, paths):
        assert path.read_bytes().startswith(b'\x89PNG')
        assert mask.shape == (SIZE[1], SIZE[0])
        assert 0.03 < mask.mean() < 0.9
        # Nothing is cut off at the border.
        assert not mask[0].any() and not mask[:, 0].any() and not mask[:, -1].any()
    height = slice(90, 400)  # between caption and legend
    for one, two in zip(masks, masks[1:]):
        assert (one[height] != two[height]).mean() > 0.01


def test_same_moment_gives_the_same_file(bag: Path, tmp_path: Path) -> None:
    for name in ('one.png', 'two.png'):
        draw_sheet(bag, tmp_path / name, moments=2, size=SIZE)
    assert (tmp_path / 'one.png').read_bytes() == (tmp_path / 'two.png').read_bytes()


def test_sheet_shows_all_moments(bag: Path, tmp_path: Path) -> None:
    times = draw_sheet(bag, tmp_path / 'sheet.png', moments=4, size=SIZE)
    assert len(times) == 4 and times[0] == 0.0 and times[-1] == pytest.approx(0.3)
    one = draw_sheet(bag, tmp_path / 'one.png', moments=1, size=SIZE)
    assert one == [0.0]
    mask = drawn(tmp_path / 'sheet.png')
    assert mask.shape[1] == SIZE[0] and mask.shape[0] <= SIZE[1]
    assert mask.mean() > 0.03


def test_scale_is_the_same_in_both_directions_and_as_long_as_it_says(tmp_path: Path) -> None:
    # Four single bodies at the corners of a square that faces the viewer.
    scene = Scene.from_parameters({
        'weave.size': [1, 1, 1], 'bodies.a.position': [0.2, 0.0, 0.0],
        'bodies.b.position': [0.0, 0.0, 0.2], 'bodies.c.position': [0.2, 0.0, 0.2]})
    state = scene.initial
    view = View(-math.pi / 2, 0.0)
    bounds = bounds_of(state.position, scene.shell.half_edge, view)
    path = tmp_path / 'square.png'
    Renderer(bounds, view=view, size=(900, 700)).frame(
        Moment(0.0, state.position, state.orientation, scene), path)
    picture = imread(path)
    # Shells are yellowish, and so is a mark in the legend below them.
    shells = (picture[:, :, 0] - picture[:, :, 2] > 0.08)[:630]
    rows, columns = (np.flatnonzero(shells.any(axis=axis)) for axis in (1, 0))
    wide, high = columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1
    assert wide == pytest.approx(high, abs=3) and wide > 400
    # The bar of 0.05 m against the distance between the centres, 0.2 m.
    strip = drawn(path)[590:640, 10:400]
    bar = max(int(row.sum()) for row in strip)
    width = 2.0 * scene.shell.half_edge * (1.0 + math.sqrt(5.0)) / 2.0
    assert bar == pytest.approx(wide * 0.05 / (0.2 + width), abs=4)


# icofabric render.

def test_verb_draws_frames_and_sheet(
        bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    small = ['--size', '400x320']
    assert main(['render', str(bag), '--times', '0', '0.1', '0.3', '--output', 'a', *small]) == 0
    assert len(list(Path('a').glob('*.png'))) == 3
    assert main(['render', str(bag), '--every', '0.1', '--output', 'b', *small]) == 0
    assert len(list(Path('b').glob('*.png'))) == 4
    assert main([
        'render', str(bag), '--frames', '2', '--sheet', 'c/sheet.png', '--view', '0', '30',
        *small]) == 0
    assert drawn(Path('c/sheet.png')).mean() > 0.03
    assert sorted(path.name for path in tmp_path.iterdir()) == ['a', 'b', 'c']
    assert main(['render', str(bag), '--frames', '1', *small]) == 0
    assert (bag.parent / 'swing_frames' / 'frame_0001.png').exists()
    capsys.readouterr()
    for words, named in (
        (['--times', '7'], '0.3 s'), (['--every', '0'], '--every'), (['--frames', '0'], 'frames'),
        (['--times', 'nan'], '--times'), (['--output', 'a'], 'a holds frames'),
    ):
        assert main(['render', str(bag), *words]) == 2
        error = capsys.readouterr().err
        assert named in error and len(error.splitlines()) == 1


def test_bag_without_its_scene_cannot_be_drawn(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with BagRecorder(tmp_path / 'bag') as recorder:
        recorder.add_topic('/robot/poses', PoseArrayBytes.TYPE)
        recorder.write('/robot/poses', 0, PoseArrayBytes('world', 2).stamped(0))
    assert main(['render', str(tmp_path / 'bag')]) == 1
    assert 'does not hold its scene' in capsys.readouterr().err
