# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Regions to which a fabric is cut: `weave.region`.

The region is centred on the fabric of `weave.size` or `weave.box`, with its axes along those of
the world. The centre of the fabric is midway between the first and last grid positions along each
axis. Bodies whose centres lie inside are kept; centres on the boundary, up to round-off, count as
inside.
"""

import math
from pathlib import Path
from typing import Final, Protocol

from icofabric_sim.checks import number_in
from icofabric_sim.parameters.example_scenes import scene_folders
from icofabric_sim.parameters.named_files import recorded_content, register_content
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.triangle_mesh import load_mesh, parse_mesh, SUFFIXES, TriangleMesh
from icofabric_sim.scene.weave_geometry import ROUNDING_RATIO
import numpy as np

NAME: Final = 'weave.region'
# Shapes and their lengths.
_SHAPES = {'sphere': 'R', 'cylinder': 'R H', 'box': 'X Y Z'}


class Region(Protocol):
    """Shape centred on the origin."""

    @property
    def half_extent(self) -> np.ndarray:
        """Half sides [m] of the axis-aligned bounding box, (3,)."""

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Return the mask (n,) of points (n, 3) [m] inside."""


class Sphere:
    """Ball of a radius [m]."""

    def __init__(self, radius: float) -> None:
        """Store the radius."""
        self._radius = radius
        self.half_extent = np.full(3, radius)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """See `Region`."""
        square = (np.square(points / self._radius)).sum(axis=1)
        return np.asarray(square <= (1.0 + ROUNDING_RATIO) ** 2)


class Cylinder:
    """Cylinder of a radius and a height [m] along the world's z axis."""

    def __init__(self, radius: float, height: float) -> None:
        """Store the lengths."""
        self._radius = radius
        self.half_extent = np.array([radius, radius, 0.5 * height])

    def contains(self, points: np.ndarray) -> np.ndarray:
        """See `Region`."""
        square = np.square(points[:, :2] / self._radius).sum(axis=1)
        high = np.abs(points[:, 2]) <= self.half_extent[2] * (1.0 + ROUNDING_RATIO)
        return np.asarray((square <= (1.0 + ROUNDING_RATIO) ** 2) & high)


class Box:
    """Axis-aligned box of three sides [m]."""

    def __init__(self, *sides: float) -> None:
        """Store the sides along x, y, z."""
        self.half_extent = 0.5 * np.array(sides)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """See `Region`."""
        return np.all(np.abs(points) <= self.half_extent * (1.0 + ROUNDING_RATIO), axis=1)


def sides_text(sides: np.ndarray) -> str:
    """Return three sides as text."""
    return ' x '.join(f'{side:.6g}' for side in sides)


def make_region(text: str) -> Region | None:
    """
    Return the region `sphere R`, `cylinder R H`, `box X Y Z` or a mesh file; None for ''.

    A mesh is in metres; the centre of its bounding box moves to the centre of the fabric. Raises
    ParameterError if the text is no region.
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
    """Return the mesh `name` of a scene, from the recorded files or from disk."""
    content = recorded_content(name)
    if content is not None:
        return parse_mesh(Path(name), content)
    path = _find_file(name)
    mesh = load_mesh(path)
    register_content(name, path.read_bytes())
    return mesh


def _find_file(name: str) -> Path:
    """Return the path of a file, searched in the working directory and the example scenes."""
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
