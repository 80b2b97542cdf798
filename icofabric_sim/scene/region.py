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
"""
Regions that a fabric is cut to: `weave.region`.

A region has its middle in the middle of the fabric that it is cut from, and its axes are the
world's. The fabric that it is cut from is that of `weave.size` or `weave.box`: its middle is that
of the cells of its grid, so of the slab from its first to its last places along each axis. Bodies
whose centres lie inside stay; centres on the border, up to rounding, belong to the region.
"""

import math
from pathlib import Path
from typing import Final, Protocol

from icofabric_sim.checks import number_in
from icofabric_sim.parameters.named_files import note_content, recorded_content
from icofabric_sim.parameters.ready_scenes import scene_folders
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.triangle_mesh import load_mesh, parse_mesh, SUFFIXES, TriangleMesh
from icofabric_sim.scene.weave_geometry import ROUNDING
import numpy as np

NAME: Final = 'weave.region'
# Words of the regions with their lengths.
_SHAPES = {'sphere': 'R', 'cylinder': 'R H', 'box': 'X Y Z'}


class Region(Protocol):
    """A shape about the origin."""

    @property
    def half_extent(self) -> np.ndarray:
        """Half the sides [m] of the upright box around it, (3,)."""

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Which of the points (n, 3) [m] belong to it, (n,) bool."""


class Sphere:
    """A ball of a radius [m]."""

    def __init__(self, radius: float) -> None:
        """All points at most `radius` away."""
        self._radius = radius
        self.half_extent = np.full(3, radius)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """See `Region`."""
        square = (np.square(points / self._radius)).sum(axis=1)
        return np.asarray(square <= (1.0 + ROUNDING) ** 2)


class Cylinder:
    """An upright cylinder of a radius and a height [m]."""

    def __init__(self, radius: float, height: float) -> None:
        """Its axis is the world's z axis."""
        self._radius = radius
        self.half_extent = np.array([radius, radius, 0.5 * height])

    def contains(self, points: np.ndarray) -> np.ndarray:
        """See `Region`."""
        square = np.square(points[:, :2] / self._radius).sum(axis=1)
        high = np.abs(points[:, 2]) <= self.half_extent[2] * (1.0 + ROUNDING)
        return np.asarray((square <= (1.0 + ROUNDING) ** 2) & high)


class Box:
    """An upright box of three sides [m]."""

    def __init__(self, *sides: float) -> None:
        """Along the world's axes."""
        self.half_extent = 0.5 * np.array(sides)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """See `Region`."""
        return np.all(np.abs(points) <= self.half_extent * (1.0 + ROUNDING), axis=1)


def sides_text(sides: np.ndarray) -> str:
    """Return three sides in words."""
    return ' x '.join(f'{side:.6g}' for side in sides)


def make_region(text: str) -> Region | None:
    """
    Region of `sphere R`, `cylinder R H`, `box X Y Z` or a mesh file; None of an empty text.

    Raises ParameterError that says what is wrong. A mesh is in metres, and moved so that the
    middle of the box around it comes to the middle of the fabric.
    """
    words = text.split()
    if not words:
        return None
    if words[0] not in _SHAPES:
        if not words[-1].lower().endswith(SUFFIXES):
            known = ', '.join(f'{word} {lengths}' for word, lengths in _SHAPES.items())
            raise ParameterError(
                NAME, f'{NAME} {text!r} is not a region; known: {known}, with lengths in m, or '
                'the path of a closed mesh (.stl, .obj)')
        try:
            return _mesh(text.strip())
        except ValueError as error:
            raise ParameterError(NAME, f'{NAME}: {error}') from error
    lengths = _lengths(text, words)
    if words[0] == 'sphere':
        return Sphere(*lengths)
    return Cylinder(*lengths) if words[0] == 'cylinder' else Box(*lengths)


def _mesh(name: str) -> TriangleMesh:
    """The mesh that a scene calls `name`, from a record or a file."""
    content = recorded_content(name)
    if content is not None:
        return parse_mesh(Path(name), content)
    path = _found(name)
    mesh = load_mesh(path)
    note_content(name, path.read_bytes())
    return mesh


def _found(name: str) -> Path:
    """Path of a file, or where it is beside the ready scenes."""
    path = Path(name).expanduser()
    places = [path] if path.is_absolute() else [
        path, *(folder / path for folder in scene_folders())]
    return next((place for place in places if place.is_file()), path)


def _lengths(text: str, words: list[str]) -> list[float]:
    names = _SHAPES[words[0]].split()
    try:
        lengths = [number_in(word) for word in words[1:]]
    except ValueError:
        lengths = []
    if len(lengths) != len(names) or not all(0.0 < length < math.inf for length in lengths):
        raise ParameterError(
            NAME, f'{NAME} {text!r}: a {words[0]} needs {len(names)} positive, finite '
            f'{"length" if len(names) == 1 else "lengths"} in m: {words[0]} {" ".join(names)}')
    return lengths
