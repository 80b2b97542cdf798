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
"""Floors and walls in pictures lie where they are, behind what they bear."""

import math
from pathlib import Path

from icofabric_sim.pictures.drawing import Moment, Renderer
from icofabric_sim.pictures.fabric_polygons import bounds_of, View
from icofabric_sim.pictures.plane_pictures import plane_pictures
from icofabric_sim.scene.scene import Scene
from matplotlib.image import imread
import numpy as np
import pytest

FLOOR = {'planes.floor.normal': [0.0, 0.0, 2.0], 'planes.floor.offset': -0.04}
SIDE, ABOVE = View(-math.pi / 2, 0.0), View(-math.pi / 2, math.pi / 2)


def slab(**changes: object) -> Scene:
    return Scene.from_parameters({'weave.size': [3, 3, 1], **changes})


def pictures_of(scene: Scene, view: View) -> list[object]:
    return list(plane_pictures(
        scene, view, bounds_of(scene.position, scene.shell.half_edge, view)))


def test_a_floor_seen_from_its_side_is_a_line_at_its_height() -> None:
    shown, = pictures_of(slab(**FLOOR), SIDE)
    assert np.ptp(shown.corners[:, 0]) > np.ptp(slab().position[:, 0])
    np.testing.assert_allclose(shown.corners[:, 1], -0.02, atol=1e-15)
    # Below all that is shown it is left out.
    assert not pictures_of(slab(**{**FLOOR, 'planes.floor.offset': -1.0}), SIDE)
    assert not pictures_of(slab(), SIDE)


@pytest.mark.parametrize('up, faces', [(1.0, True), (-1.0, False)])
def test_lines_on_a_floor_are_two_pitches_apart(up: float, faces: bool) -> None:
    scene = slab(**{'planes.floor.normal': [0.0, 0.0, up], 'planes.floor.offset': -up * 0.02})
    shown, = pictures_of(scene, ABOVE)
    assert shown.faces_viewer is faces
    low, high = shown.corners.min(axis=0), shown.corners.max(axis=0)
    assert (low < scene.position[:, :2].min(axis=0)).all()
    spacing = 2.0 * scene.geometry.pitch
    upright = [line for line in shown.lines if abs(line[0, 0] - line[1, 0]) < 1e-12]
    level = [line for line in shown.lines if abs(line[0, 1] - line[1, 1]) < 1e-12]
    assert len(upright) > 1 < len(level) and len(upright) + len(level) == len(shown.lines)
    for axis, lines in enumerate((upright, level)):
        places = np.sort([line[0, axis] for line in lines])
        np.testing.assert_allclose(np.diff(places), spacing, atol=1e-12)
        np.testing.assert_allclose(places / spacing, np.round(places / spacing), atol=1e-9)
        # From one side of what is shown to the other.
        ends = np.sort(np.array(lines)[:, :, 1 - axis], axis=1)
        np.testing.assert_allclose(
            ends, np.tile([low[1 - axis], high[1 - axis]], (len(lines), 1)), atol=1e-12)


def test_corners_of_a_slanted_plane_are_in_order_around_it() -> None:
    scene = slab(**{'planes.roof.normal': [-0.3, 0.5, -1.0], 'planes.roof.offset': -0.01})
    shown, = pictures_of(scene, View())
    assert not shown.faces_viewer and len(shown.corners) >= 3
    side, after = (np.roll(shown.corners, -k, axis=0) - shown.corners for k in (1, 2))
    turns = side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0]
    assert (turns >= -1e-15).all() or (turns <= 1e-15).all()
    assert np.ptp(shown.corners, axis=0).min() > 0.02


def test_a_floor_is_behind_the_fabric_and_a_veil_before_it(tmp_path: Path) -> None:
    bare, below = slab(), slab(**{**FLOOR, 'planes.floor.offset': -0.035})
    before = slab(**{'planes.wall.normal': [0.0, 1.0, 0.0], 'planes.wall.offset': -0.03})
    seen = []
    for number, scene in enumerate((bare, below, before)):
        view = View(-math.pi / 2, 0.3)
        bounds = bounds_of(scene.position, scene.shell.half_edge, view)
        path = tmp_path / f'{number}.png'
        Renderer(bounds, view=view, size=(400, 300)).frame(
            Moment(0.0, scene.position, scene.orientation, scene), path)
        seen.append(imread(path)[:, :, :3])
    empty = (seen[0] > 0.999).all(axis=2)
    # Shells hide the floor; where nothing was there is something now.
    dark = seen[0].max(axis=2) < 0.8
    # All but the pixels at their edges.
    assert (seen[0][dark] == seen[1][dark]).mean() > 0.95
    assert (seen[1][empty] < 0.98).any()
    assert dark.sum() > 500 and (seen[2][dark] > seen[0][dark]).mean() > 0.5
