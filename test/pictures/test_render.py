# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures: what they show, that it moves, and that it is where it should be."""

import math
from pathlib import Path

from icofabric_sim.bag import BagRecorder
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.commands.main import main
from icofabric_sim.contact import separation
from icofabric_sim.geometry.icosahedron import circumscribed_radius, inscribed_radius
from icofabric_sim.messages import PoseArrayBytes
from icofabric_sim.pictures import fabric_polygons as shapes_module
from icofabric_sim.pictures.camera import Area, Camera, fit_camera, near_ones, View
from icofabric_sim.pictures.drawing import frame_moments, Renderer
from icofabric_sim.pictures.fabric_polygons import (
    BROKEN_COLOR,
    fabric_polygons,
    FREE_COLOR,
    HELD_COLOR,
)
from icofabric_sim.pictures.light import light_on, Lighting
from icofabric_sim.pictures.measures import (
    connector_ends,
    connector_segments,
    fit_scale,
    QUANTITIES,
    Scale,
    strains,
    tensions,
)
from icofabric_sim.pictures.moment import Moment, Push
from icofabric_sim.pictures.render import (
    chosen_bodies,
    draw_sheet,
    nearest_times,
    RunMoments,
    RunPictures,
    spread_times,
)
from icofabric_sim.scene.scene import Scene
from icofabric_sim.scene.shell_gaps import find_contacts, smallest_gap
from icofabric_sim.simulation.simulation import compile_scene
from matplotlib.image import imread
import numpy as np
import pytest
from recorded_runs import record_push, swing_scene

SIZE = (640, 480)
AREA = Area(0.0, 0.0, 640.0, 480.0)


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('bags') / 'swing'
    record_push(path, swing_scene())
    return path


def drawn(path: Path) -> np.ndarray:
    """Pixels that are darker than the backdrop, (height, width) bool."""
    return np.asarray((imread(path)[:, :, :3] < 0.92).any(axis=2))


def one_body(**changes: object) -> Scene:
    return Scene.from_parameters({
        'weave.size': [1, 1, 1], 'initial.turn.group': 'all',
        'initial.turn.rotation': [0.3, -0.8, 0.5], **changes})


def at_rest(scene: Scene) -> Moment:
    return Moment(0.0, scene.initial.position, scene.initial.orientation, scene)


def polygons(scene: Scene, view: View, **choices: object) -> tuple[object, Camera]:
    moment = at_rest(scene)
    camera = frame_moments([moment], view).camera(AREA)
    return fabric_polygons(moment, camera, AREA, **choices), camera


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


def test_the_camera_fits_what_is_shown_and_wastes_no_room() -> None:
    points = np.random.default_rng(3).uniform(-1.0, 1.0, (40, 3)) * [1.0, 2.0, 0.5] + [5.0, 0, 0]
    area = Area(10.0, 20.0, 600.0, 300.0)
    camera = fit_camera(View(0.4, 0.3), points, 0.1, area)
    seen = camera.project(points, area)
    low, high = seen.min(axis=0), seen.max(axis=0)
    assert (low >= [10.0, 20.0]).all() and (high <= [610.0, 320.0]).all()
    filled = (high - low) / [600.0, 300.0]
    assert filled.max() > 0.85
    # Centred.
    np.testing.assert_allclose(0.5 * (low + high), [310.0, 170.0], atol=6.0)
    # What is nearer is larger, in proportion to the distance.
    pair = np.array([camera.target, camera.target + 0.01 * camera.axes[0]])
    near = pair + 0.5 * camera.distance * camera.axes[2]
    widths = [np.ptp(camera.project(ends, area)[:, 0]) for ends in (pair, near)]
    assert widths[1] / widths[0] == pytest.approx(2.0, rel=1e-9)
    assert widths[0] == pytest.approx(0.01 * camera.pixels_per_meter(area), rel=1e-9)
    assert fit_camera(View(0.4, 0.3, 7.0), points, 0.1, area).distance == 7.0


def test_a_lost_body_does_not_make_the_fabric_small() -> None:
    places = np.random.default_rng(5).uniform(-0.1, 0.1, (30, 3))
    places[7] = [40.0, 0.0, 0.0]
    places[9] = np.nan
    np.testing.assert_array_equal(np.flatnonzero(~near_ones(places, 0.3)), [7, 9])
    # Two halves that fly apart are both shown.
    halves = np.concatenate([places[10:20] - [3.0, 0, 0], places[20:] + [3.0, 0, 0]])
    assert near_ones(halves, 0.3).all()


def test_connector_ends_and_tensions_are_those_of_the_simulation() -> None:
    simulation = compile_scene(swing_scene())
    simulation.advance_to(0.2)
    state, scene = simulation.snapshot(), simulation.scene
    ends = connector_ends(scene, state.position, state.orientation)
    np.testing.assert_allclose(ends, state.connector_ends, rtol=0, atol=1e-15)
    strain = state.connector_length / scene.connectors.natural_length - 1.0
    length = connector_segments(
        scene, state.position, state.orientation).lengths(scene.connector_count)
    np.testing.assert_allclose(strains(scene, length), strain, atol=1e-14)
    stretch = state.connector_length - scene.connectors.natural_length
    pull = tensions(scene, length)
    assert np.abs(pull).max() > 0.01
    np.testing.assert_allclose(pull, scene.connectors.stiffness * stretch, atol=1e-10)


def test_contacts_are_found_where_shells_overlap() -> None:
    a = 0.01
    random = np.random.default_rng(11)
    position = random.uniform(-0.05, 0.05, (60, 3))
    orientation = random.normal(size=(60, 4))
    orientation /= np.linalg.norm(orientation, axis=1, keepdims=True)
    found = find_contacts(a, position, orientation)
    first, second = np.triu_indices(60, 1)
    exact = separation(
        a, (position[first], orientation[first]), (position[second], orientation[second]))
    touching = exact.distance < 0.0
    assert 10 < touching.sum() == len(found.bodies)
    np.testing.assert_array_equal(
        found.bodies, np.stack([first, second], axis=1)[touching])
    np.testing.assert_allclose(found.depth, -exact.distance[touching], atol=1e-12)
    least, bodies = smallest_gap(a, position, orientation)
    assert least == pytest.approx(exact.distance.min(), abs=1e-12)
    assert bodies == (first[np.argmin(exact.distance)], second[np.argmin(exact.distance)])
    # Apart the gap is at most the distance.
    apart = smallest_gap(a, 40.0 * position, orientation)
    spread = separation(
        a, (40.0 * position[first], orientation[first]),
        (40.0 * position[second], orientation[second])).distance
    assert 0.8 * spread.min() < apart[0] <= spread.min() + 1e-12


def test_shell_is_drawn_as_its_silhouette() -> None:
    scene = one_body()
    shapes, camera = polygons(scene, View(0.0, 0.0))
    x, y = shapes.corners[..., 0], -shapes.corners[..., 1]
    area = 0.5 * (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)
    # Counter-clockwise for the viewer, as seen from outside: each face, and the face in its rim.
    assert (area > 0.0).all() and len(area) % 2 == 0 and 8 <= len(area) // 2 <= 10
    a, scale = scene.shell.half_edge, camera.pixels_per_meter(AREA)
    low, high = scale * inscribed_radius(a), scale * circumscribed_radius(a)
    assert math.pi * low**2 < area[::2].sum() < 1.1 * math.pi * high**2
    assert (area[1::2] < area[::2]).all()
    distance = np.linalg.norm(shapes.corners - [320.0, 240.0], axis=2)
    assert distance.max() <= 1.1 * high


def test_nearer_is_drawn_later() -> None:
    scene = Scene.from_parameters({
        'weave.size': [1, 1, 1], 'groups.far': 'ids 0', 'supports.far.group': 'far',
        'bodies.near.position': [0.0, -0.1, 0.0]})
    shapes, _ = polygons(scene, View(-math.pi / 2, 0.0))  # from -y
    # The held body is bluish, the free one yellowish.
    bluish = shapes.colors[:, 2] > shapes.colors[:, 0]
    held = int(bluish.sum())
    assert held >= 16 and bluish[:held].all() and not bluish[held:].any()
    assert HELD_COLOR[2] > HELD_COLOR[0] and FREE_COLOR[2] < FREE_COLOR[0]


def test_light_comes_from_above_and_neighbours_cast_shadows() -> None:
    lighting = Lighting.of(View().axes)
    up, down = np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, -1.0]])
    body, alone = np.zeros(1, int), np.zeros((1, 3))
    own = np.full(1, 0.01)
    bright, dark = (light_on(lighting, 0.01 * n, n, body, alone, own) for n in (up, down))
    assert (bright > 1.5 * dark).all()
    roofed = np.array([[0.0, 0.0, 0.0], 0.05 * lighting.lamp])
    shaded = light_on(lighting, 0.01 * up, up, body, roofed, np.full(2, 0.01))
    assert (shaded < 0.7 * bright).all()


def test_very_small_shells_become_discs(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = swing_scene()
    monkeypatch.setattr(shapes_module, '_DISC_PIXELS', 1e9)
    shapes, _ = polygons(scene, View(), marks=False, bodies=np.array([0]))
    assert len(shapes.corners) == 1


def test_broken_connectors_are_stubs_and_only_chosen_bodies_are_drawn() -> None:
    scene = swing_scene()
    moment = at_rest(scene)
    camera = frame_moments([moment]).camera(AREA)
    scale = Scale(QUANTITIES['strain'], 0.01)
    whole = fabric_polygons(moment, camera, AREA, scale=scale, color='strain')
    torn = fabric_polygons(
        moment._replace(broken=np.array([0, 3])), camera, AREA, scale=scale, color='strain')
    marks = [int((shapes.colors == BROKEN_COLOR).all(axis=1).sum()) for shapes in (whole, torn)]
    # As many for each of the four stubs.
    assert marks[0] == 0 < marks[1] and marks[1] % 4 == 0
    few = fabric_polygons(moment, camera, AREA, bodies=scene.groups['tip'])
    assert 0 < len(few.corners) < 0.6 * len(whole.corners)


# Colours.

def test_colours_can_be_told_apart_by_everybody() -> None:
    """Lightness alone orders the scale of sizes; around zero the ends are darker and differ."""
    # Rec. 709 luminance of linear light; red and green confused (deuteranopia, Vienot 1999).
    def linear(colors: np.ndarray) -> np.ndarray:
        return np.asarray(colors) ** 2.2

    def luminance(colors: np.ndarray) -> np.ndarray:
        return np.asarray(linear(colors) @ [0.2126, 0.7152, 0.0722])

    sizes = fit_scale('speed', []).colors(np.linspace(0.0, 0.01, 9))
    assert (np.diff(luminance(sizes)) < -0.01).all()
    signed = Scale(QUANTITIES['strain'], 1.0)
    ends = signed.colors(np.linspace(-1.0, 1.0, 9))
    light = luminance(ends)
    assert light[0] < 0.5 * light[4] > light[8] * 2.0 * 0.5
    confused = linear(ends) @ np.array([[0.293, 0.293, -0.021], [0.707, 0.707, 0.021],
                                        [0.0, 0.0, 1.0]])
    for low, high in zip(confused[:4], confused[:4:-1]):
        assert np.abs(low - high).max() > 0.1


def test_scale_is_round_covers_the_values_and_keeps_signs_apart() -> None:
    scene = swing_scene()
    turned = at_rest(scene)._replace(position=1.013 * scene.position)
    scale = fit_scale('strain', [at_rest(scene), turned])
    spread = np.abs(strains(scene, connector_segments(
        scene, turned.position, turned.orientation).lengths(scene.connector_count)))
    assert np.quantile(spread, 0.9) <= scale.largest <= 3.0 * spread.max()
    assert float(f'{100 * scale.largest:.2g}') == pytest.approx(100 * scale.largest)
    pushed, pulled = scale.colors(np.array([-1.0, 1.0]))
    assert pushed[2] > pushed[0] and pulled[0] > pulled[2]
    assert scale.text(scale.largest).startswith('+') and scale.text(0.0) == '0'


# Times and bodies.

def test_times_are_recorded_ones() -> None:
    times = np.array([0, 10, 20, 35, 50])
    np.testing.assert_array_equal(nearest_times(times, [4, 6, 29, 99]), [0, 10, 35, 50])
    np.testing.assert_array_equal(nearest_times(times, [1, 2]), [0])
    np.testing.assert_array_equal(spread_times(times, 3), [0, 20, 50])
    np.testing.assert_array_equal(spread_times(times, 50), times)
    np.testing.assert_array_equal(spread_times(times, 1), [0])


def test_bodies_are_named_by_groups_numbers_and_selectors() -> None:
    scene = swing_scene()
    np.testing.assert_array_equal(chosen_bodies(scene, 'bodies', 'tip'), scene.groups['tip'])
    np.testing.assert_array_equal(chosen_bodies(scene, 'bodies', '3 5'), [3, 5])
    assert len(chosen_bodies(scene, 'bodies', 'x_min or x_max')) == 2 * len(scene.groups['wall'])
    with pytest.raises(ValueError, match='bodies'):
        chosen_bodies(scene, 'bodies', '300')


def test_moments_of_a_run_have_its_forces_and_speeds(bag: Path) -> None:
    simulation = compile_scene(swing_scene())
    simulation.apply_wrench('tip', (0.0, 0.75, 0.0), time=0.1)
    simulation.apply_body_wrench(3, (0.1, 0.0, 0.0), time=0.1)
    simulation.advance_to(0.15)
    state = simulation.snapshot()
    with RecordedRun(bag) as run:
        moment, = RunMoments(run).at([150_000_000], with_velocity=True)
    pushes = {push.name: push for push in moment.pushes}
    np.testing.assert_allclose(pushes['tip'].force, [0.0, 0.75, 0.0])
    np.testing.assert_allclose(
        pushes['tip'].point, state.position[simulation.scene.groups['tip']].mean(axis=0),
        atol=1e-9)
    assert np.linalg.norm(pushes['body 3'].force) == pytest.approx(0.1)
    with RecordedRun(bag) as run:
        frames = [frame for frame in run.poses() if frame.nanoseconds <= 150_000_000][-2:]
    passed = frames[1].time - frames[0].time
    np.testing.assert_allclose(
        moment.velocity, (frames[1].position - frames[0].position) / passed, atol=1e-12)
    assert np.abs(moment.velocity).max() > 0.1


# Pictures.

def test_frames_are_full_and_move(bag: Path, tmp_path: Path) -> None:
    with RecordedRun(bag) as run:
        times = spread_times(run.pose_times(), 3)
        paths = RunPictures(run, times, size=SIZE).frames(tmp_path / 'frames')
    assert [path.name for path in paths] == [f'frame_000{k}.png' for k in (1, 2, 3)]
    masks = [drawn(path) for path in paths]
    for mask, path in zip(masks, paths):
        assert path.read_bytes().startswith(b'\x89PNG')
        assert mask.shape == (SIZE[1], SIZE[0])
        assert 0.03 < mask.mean() < 0.9
        # Nothing is cut off at the border.
        assert not mask[0].any() and not mask[:, 0].any() and not mask[:, -1].any()
    height = slice(40, 430)  # between caption and legend
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


def test_the_camera_follows_a_body(bag: Path) -> None:
    with RecordedRun(bag) as run:
        pictures = RunPictures(run, size=SIZE, follow='tip')
        renderer = pictures.renderer
        first, *_, last = pictures.moments()
    tip = first.scene.groups['tip']
    area = Area(0.0, 0.0, *map(float, SIZE))
    for moment in (first, last):
        target = renderer.framing.target_of(moment)
        camera = renderer.framing.camera(area).moved_to(target)
        seen = camera.project(moment.position[tip].mean(axis=0)[None], area)
        np.testing.assert_allclose(seen, [[320.0, 240.0]], atol=1e-6)


def test_scale_bar_is_as_long_as_it_says(tmp_path: Path) -> None:
    # Four single bodies at the corners of a square that faces the viewer.
    scene = Scene.from_parameters({
        'weave.size': [1, 1, 1], 'bodies.a.position': [0.2, 0.0, 0.0],
        'bodies.b.position': [0.0, 0.0, 0.2], 'bodies.c.position': [0.2, 0.0, 0.2]})
    moment = at_rest(scene)
    path = tmp_path / 'square.png'
    Renderer(frame_moments([moment], View(-math.pi / 2, 0.0)), size=(900, 700)).frame(
        moment, path)
    picture = imread(path)
    # Shells are yellowish, and so is a mark in the legend below them.
    shells = (picture[:, :, 0] - picture[:, :, 2] > 0.08)[:630]
    rows, columns = (np.flatnonzero(shells.any(axis=axis)) for axis in (1, 0))
    wide, high = columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1
    assert wide == pytest.approx(high, abs=12) and wide > 400
    # The bar of 0.05 m against the distance between the centres, 0.2 m.
    strip = (picture[:, :, :3] < 0.6).all(axis=2)[640:695, 60:400]
    bar = max(len(run) for row in strip
              for run in ''.join('x' if dark else ' ' for dark in row).split())
    width = 2.0 * scene.shell.half_edge * (1.0 + math.sqrt(5.0)) / 2.0
    # The outer shells stand a little nearer with their nearest corners.
    assert bar == pytest.approx(wide * 0.05 / (0.2 + width), rel=0.06)


def test_forces_anchors_and_what_holds_are_drawn(tmp_path: Path) -> None:
    scene = Scene.from_parameters({
        'weave.size': [3, 3, 3], 'weave.connector_angle': 0.3,
        'groups.wall': 'x_min', 'groups.tip': 'x_max', 'supports.wall.group': 'wall',
        'loads.tip.group': 'tip', 'anchors.pin.body': 9, 'anchors.pin.edge': 'up',
        'anchors.pin.position': [0.1, 0.05, 0.25]})
    bare = Scene.from_parameters({'weave.size': [3, 3, 3], 'weave.connector_angle': 0.3})
    pictures = []
    for moment in (at_rest(bare), at_rest(scene)._replace(
            pushes=(Push('tip', scene.position[scene.groups['tip']].mean(axis=0),
                         np.array([2.0, 0.0, 0.0])),))):
        path = tmp_path / 'picture.png'
        Renderer(frame_moments([at_rest(scene)]), size=SIZE).frame(moment, path)
        pictures.append(imread(path)[:, :, :3])

    def amounts(picture: np.ndarray) -> list[int]:
        red, green, blue = np.moveaxis(picture, 2, 0)
        return [int(chosen.sum()) for chosen in (
            (red > 0.6) & (green < 0.25),                          # force
            (green > red + 0.15) & (green > blue + 0.05),          # anchor
            (blue > red + 0.03) & (red < 0.6) & (red > 0.3))]      # plate and held shells
    without, with_them = (amounts(picture) for picture in pictures)
    assert without[:2] == [0, 0]
    assert with_them[0] > 200 and with_them[1] > 20 and with_them[2] > without[2] + 2000


def test_forces_of_contacts_are_drawn_to_scale(tmp_path: Path) -> None:
    scene = one_body()
    point, forces = np.zeros(3), np.array([[4.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    moment = at_rest(scene)._replace(contact_forces=np.stack(
        [np.broadcast_to(point, (2, 3)), forces], axis=1))
    renderer = Renderer(frame_moments([moment], View(-math.pi / 2, 0.0)), size=SIZE)
    renderer.frame(moment, tmp_path / 'picture.png')
    red, green, blue = np.moveaxis(imread(tmp_path / 'picture.png')[:400, :, :3], 2, 0)
    rows, columns = np.nonzero((red < 0.1) & (green > 0.4) & (green < 0.6) & (blue < 0.5))
    # To the right one and a half edges of 20 mm, upwards half of that: seen from the front, the
    # shell of 38 mm across between the two.
    right, up = np.ptp(columns), np.ptp(rows)
    assert up > 20 and right == pytest.approx(2.0 * up, rel=0.15)


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
        '--from', '0.1', '--to', '0.2', '--color', 'speed', '--bodies', 'tip', *small]) == 0
    assert drawn(Path('c/sheet.png')).mean() > 0.03
    assert sorted(path.name for path in tmp_path.iterdir()) == ['a', 'b', 'c']
    assert main(['render', str(bag), '--frames', '1', *small]) == 0
    assert (bag.parent / 'swing_frames' / 'frame_0001.png').exists()
    capsys.readouterr()
    for words, named in (
        (['--times', '7'], '0.3 s'), (['--every', '0'], '--every'), (['--frames', '0'], 'frames'),
        (['--times', 'nan'], '--times'), (['--output', 'a'], 'a already contains frames'),
        (['--from', '7'], '--from 7 s'), (['--from', '0.2', '--to', '0.1'], 'before --from'),
        (['--camera', '3'], '--camera'), (['--camera', '0', '95'], '--camera'),
        (['--camera', '0', '5', '-1'], 'distance'), (['--bodies', 'nowhere'], 'bodies'),
        (['--follow', '99'], 'follow'), (['--size', '5x5'], '--size'),
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
    assert 'does not contain its scene' in capsys.readouterr().err


def test_a_small_picture_explains_all_that_is_in_it() -> None:
    scene = Scene.from_parameters({
        'weave.size': [3, 3, 3], 'groups.wall': 'x_min', 'supports.wall.group': 'wall'})
    whole = at_rest(scene)
    broken = whole._replace(broken=np.array([0]))
    feet = []
    for moment in (whole, broken):
        renderer = Renderer(
            frame_moments([moment]), size=(480, 330), color='strain',
            scale=Scale(QUANTITIES['strain'], 0.01))
        feet.append(np.asarray(renderer.picture(moment)).astype(int)[300:, :330])
    dark = [(np.abs(foot - np.rint(255.0 * BROKEN_COLOR)).max(axis=2) <= 2).sum()
            for foot in feet]
    # The mark of broken connectors, a bar.
    assert dark[0] == 0 and dark[1] > 10
    # Beside what was there before.
    for color in (FREE_COLOR, HELD_COLOR):
        assert (np.abs(feet[1] - np.rint(255.0 * color)).max(axis=2) <= 2).sum() > 20
