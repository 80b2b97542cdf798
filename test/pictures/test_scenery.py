# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Floors, walls and plates in pictures lie where they are, behind what they bear."""

import math
from pathlib import Path

from icofabric_sim.pictures.camera import Area, View
from icofabric_sim.pictures.drawing import frame_moments, Renderer
from icofabric_sim.pictures.light import Lighting
from icofabric_sim.pictures.moment import Moment
from icofabric_sim.pictures.scenery import grounds, place_plate, plates
from icofabric_sim.scene.scene import Scene
from matplotlib.image import imread
import numpy as np
import pytest

FLOOR = {'planes.floor.normal': [0.0, 0.0, 2.0], 'planes.floor.offset': -0.04}
AREA = Area(0.0, 0.0, 400.0, 300.0)
VIEW = View(-math.pi / 2, 0.3)


def slab(**changes: object) -> Scene:
    return Scene.from_parameters({'weave.size': [3, 3, 1], **changes})


def at_rest(scene: Scene) -> Moment:
    return Moment(0.0, scene.position, scene.orientation, scene)


def around(scene: Scene) -> list[object]:
    camera = frame_moments([at_rest(scene)], VIEW).camera(AREA)
    return list(grounds(scene, camera, camera.target, 0.2))


def test_a_floor_lies_at_its_height_and_reaches_beyond_the_fabric() -> None:
    shown, = around(slab(**FLOOR))
    assert shown.faces_viewer
    np.testing.assert_allclose(shown.rim[:, 2], -0.02, atol=1e-15)
    assert np.ptp(shown.rim[:, 0]) > np.ptp(slab().position[:, 0])
    # One far off is left out.
    assert not around(slab(**{**FLOOR, 'planes.floor.offset': -4.0})) and not around(slab())


def test_a_floor_that_moves_is_shown_where_its_path_is() -> None:
    scene = slab(**{
        **FLOOR, 'planes.floor.motion': 'ramp', 'planes.floor.linear': [0.1, 0.0, 0.01],
        'planes.floor.duration': 0.5})
    camera = frame_moments([at_rest(scene)], VIEW).camera(AREA)
    for time, height in ((0.0, -0.02), (0.5, -0.0175), (1.0, -0.0125), (math.nan, -0.02)):
        shown, = grounds(scene, camera, camera.target, 0.2, time)
        np.testing.assert_allclose(shown.rim[:, 2], height, atol=1e-12)
        assert shown.offset == pytest.approx(height)


@pytest.mark.parametrize('up, faces', [(1.0, True), (-1.0, False)])
def test_lines_on_a_floor_are_two_pitches_apart(up: float, faces: bool) -> None:
    scene = slab(**{'planes.floor.normal': [0.0, 0.0, up], 'planes.floor.offset': -up * 0.02})
    shown, = around(scene)
    assert shown.faces_viewer is faces
    spacing = 2.0 * scene.geometry.pitch
    upright = [line for line in shown.lines if abs(line[0, 0] - line[1, 0]) < 1e-12]
    level = [line for line in shown.lines if abs(line[0, 1] - line[1, 1]) < 1e-12]
    assert len(upright) > 1 < len(level) and len(upright) + len(level) == len(shown.lines)
    for axis, lines in enumerate((upright, level)):
        places = np.sort([line[0, axis] for line in lines])
        steps = np.diff(places) / spacing
        np.testing.assert_allclose(steps, np.round(steps[0]), atol=1e-9)
        np.testing.assert_allclose(places / spacing, np.round(places / spacing), atol=1e-9)
    np.testing.assert_allclose(shown.lines[:, :, 2], -0.02, atol=1e-12)


def test_shadows_fall_along_the_light_onto_the_plane() -> None:
    lighting = Lighting.of(VIEW.axes)
    shown, = around(slab(**FLOOR))
    points = np.array([[0.0, 0.0, 0.1], [0.1, 0.2, -0.02], [0.0, 0.0, -0.5]])
    cast = shown.shadows(points, lighting)
    np.testing.assert_allclose(cast[:2, 2], -0.02, atol=1e-15)
    np.testing.assert_allclose(np.cross(points[0] - cast[0], lighting.lamp), 0.0, atol=1e-15)
    np.testing.assert_allclose(cast[1], points[1])
    # What is below the floor casts none, and neither does what the light does not reach.
    assert np.isnan(cast[2]).all()
    ceiling, = around(slab(**{**FLOOR, 'planes.floor.normal': [0.0, 0.0, -1.0]}))
    assert np.isnan(ceiling.shadows(points, lighting)).all()


def test_hooks_and_corners_have_no_plate() -> None:
    layer = {'weave.size': [3, 3, 3], 'groups.held': 'z_min', 'supports.held.group': 'held'}
    assert len(plates(Scene.from_parameters(layer))) == 1
    assert not plates(Scene.from_parameters({**layer, 'supports.held.fix': 'tx ty tz'}))
    # A few bodies of a layer are no layer.
    corners = 'z_min and x_min and y_min or z_min and x_max or z_min and y_max and x_min'
    few = {**layer, 'weave.size': [7, 7, 3], 'groups.held': corners}
    assert not plates(Scene.from_parameters(few))


def test_plates_hold_layers_at_a_side_and_move_with_them() -> None:
    parameters = {
        'weave.size': [3, 3, 3], 'groups.wall': 'x_min', 'supports.wall.group': 'wall',
        'groups.top': 'z_max and not x_min', 'drives.top.group': 'top'}
    scene = Scene.from_parameters(parameters)
    wall, lid = plates(scene)
    assert wall.held and not lid.held
    # Beyond the shells, away from the fabric.
    radius = np.linalg.norm(scene.shell.half_edge * np.array([0.0, 1.0, 1.618]))
    assert wall.corners[:, 0].max() < scene.position[:, 0].min() - 0.9 * radius
    assert lid.corners[:, 2].min() > scene.position[:, 2].max() + 0.9 * radius
    camera = frame_moments([at_rest(scene)], View(-math.pi / 2, 0.3)).camera(AREA)
    placed = place_plate(lid, at_rest(scene), camera)
    assert placed.before and not place_plate(
        lid, at_rest(scene), frame_moments([at_rest(scene)], View(0.0, -0.5)).camera(AREA)).before
    # A quarter turn of everything about z, and a shift.
    half = math.sqrt(0.5)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = at_rest(scene)._replace(
        position=scene.position @ turn.T + [0.0, 0.0, 0.4],
        orientation=np.tile([0.0, 0.0, half, half], (scene.body_count, 1)))
    faces = place_plate(lid, moved, camera).faces.reshape(-1, 3)
    expected = lid.corners @ turn.T + [0.0, 0.0, 0.4]
    for corner in faces:
        assert np.linalg.norm(expected - corner, axis=1).min() < 1e-9
    # A group in the middle, or of two layers, has none.
    for group in ('row 1', 'x_min or x_max'):
        assert not plates(Scene.from_parameters({
            'weave.size': [3, 3, 3], 'groups.wall': group, 'supports.wall.group': 'wall'}))


def test_a_floor_is_behind_the_fabric_and_bears_its_shadow(tmp_path: Path) -> None:
    seen = []
    for number, scene in enumerate((slab(), slab(**{**FLOOR, 'planes.floor.offset': -0.035}))):
        path = tmp_path / f'{number}.png'
        Renderer(frame_moments([at_rest(scene)], VIEW), size=(400, 320)).frame(
            at_rest(scene), path)
        seen.append(imread(path)[:, :, :3])
    bare, floor = seen
    dark = bare.max(axis=2) < 0.8
    # Shells hide the floor: all but the pixels at their edges are the same.
    assert dark.sum() > 500 and (bare[dark] == floor[dark]).mean() > 0.9
    empty = (bare > 0.94).all(axis=2)
    shadow = empty & (floor.max(axis=2) < 0.8)
    assert shadow.sum() > 100
    assert (floor[empty] < 0.9).any()


def test_low_and_wide_pictures_have_their_shadows_too(tmp_path: Path) -> None:
    """Where the picture is so low that the size of the fabric, not its outline, says how far."""
    scene = slab(**FLOOR)
    moments = [at_rest(scene)] * 3
    Renderer(frame_moments(moments, View(math.radians(-70.0), math.radians(8.0))),
             size=(1200, 320)).sheet(moments, tmp_path / 'wide.png')
    assert imread(tmp_path / 'wide.png').shape[1] == 1200
