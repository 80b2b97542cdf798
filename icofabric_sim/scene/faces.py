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
"""Selectors of faces: `toward 0 0 1 and exterior` becomes the faces of each body of a group."""

import itertools
import math
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import face_geometry
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.selectors import Parser
import numpy as np

_COUNT = 20
# Faces whose angles to a direction differ by less than this are equally near [rad].
_SAME_ANGLE = 1e-6
# Where the neighbours of a body are, in units of the pitch W on its axes.
_NEIGHBOURS = np.array([
    p for p in itertools.product((-1.0, 0.0, 1.0), repeat=3) if sum(map(abs, p)) == 2.0])
# Those before a face are 24.1 or 35.3 degrees from its normal, all others at least 48.7.
_BEFORE = math.cos(math.radians(40.0))
_HELP = (
    'use numbers K K ... (1 to 20), toward X Y Z, within ANGLE X Y Z, exterior or all, joined by '
    'and, or, not')


class Shells(NamedTuple):
    """What selectors of faces need: woven rest places of all bodies, and the chosen ones."""

    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) x y z w
    chosen: np.ndarray  # (m,) body numbers
    half_edge: float  # a [m]
    pitch: float  # W [m]


def select_faces(name: str, text: str, shells: Shells) -> np.ndarray:
    """
    Which faces of the chosen bodies the selector `text` of the parameter `name` picks, (m, 20).

    Never none at all.
    """
    mask = _parse(name, text, shells)
    if not mask.any():
        raise ParameterError(
            name, f'{name}: {text!r} selects no face of the {len(shells.chosen)} bodies; {_HELP}')
    return mask


def check_faces(name: str, text: str) -> None:
    """Raise ParameterError where `text` is not a selector of faces."""
    _parse(name, text, None)


def _parse(name: str, text: str, shells: Shells | None) -> np.ndarray:
    words = text.split()
    if not words:
        raise ParameterError(name, f'{name} is an empty selector; {_HELP}')
    parser = _FaceParser(name, text, words, shells)
    mask = parser.any_of()
    if parser.at < len(words):
        parser.fail(f'{words[parser.at]!r} is not expected there')
    return mask


class _FaceParser(Parser):
    """The same grammar as that of bodies, with words for faces."""

    help = _HELP

    def __init__(self, name: str, text: str, words: list[str], shells: Shells | None) -> None:
        super().__init__(name, text, words, None)
        self.shells = shells

    def true(self) -> np.ndarray:
        return np.ones((0 if self.shells is None else len(self.shells.chosen), _COUNT), bool)

    def atom(self, word: str) -> np.ndarray:
        if word == 'numbers':
            mask = ~self.true()
            for number in self.integers(None):
                if not 1 <= number <= _COUNT:
                    self.fail(f'there is no face {number}, faces are 1 to {_COUNT}')
                mask[:, number - 1] = True
            return mask
        if word == 'toward':
            return self.near(self.numbers(3), None)
        if word == 'within':
            angle, *direction = self.numbers(4)
            if not 0.0 <= angle <= np.pi:
                self.fail(f'the angle must lie between 0 and pi rad, got {angle!r}')
            return self.near(direction, angle)
        if word == 'exterior':
            return self.exterior()
        self.fail(f'{word!r} is unknown')

    def near(self, direction: list[float], angle: float | None) -> np.ndarray:
        """Faces that point in a world direction, as woven: the nearest, or all within an angle."""
        size = float(np.linalg.norm(direction))
        if not 0.0 < size < np.inf:
            self.fail('the direction must have a length')
        if self.shells is None:
            return self.true()
        cosine = np.clip(_normals(self.shells) @ (np.array(direction) / size), -1.0, 1.0)
        apart = np.arccos(cosine)
        limit = apart.min(axis=1, keepdims=True) if angle is None else angle
        return apart <= limit + _SAME_ANGLE

    def exterior(self) -> np.ndarray:
        """
        Faces that point out of the fabric: a place for a neighbour before them is empty.

        In every weave a body can have twelve neighbours, half-way between two of its axes and W
        sqrt(2) away. Those nearest to the normal of a face stand before it: one or three.
        """
        if self.shells is None:
            return self.true()
        # Only scenes that ask for it wait for it.
        from scipy.spatial import cKDTree

        shells = self.shells
        axes = cosines_from_quaternions(shells.orientation[shells.chosen])
        places = shells.position[shells.chosen, None] + shells.pitch * np.einsum(
            'pi,nij->npj', _NEIGHBOURS, axes)
        # Takes a quarter of a second to import.

        distance, _ = cKDTree(shells.position).query(places.reshape(-1, 3))
        empty = (distance > 0.5 * shells.pitch).reshape(len(axes), -1)
        cosine = face_geometry(shells.half_edge).normals @ _NEIGHBOURS.T / math.sqrt(2.0)
        return empty @ (cosine > _BEFORE).T


def _normals(shells: Shells) -> np.ndarray:
    """Outward unit normals of the chosen bodies as woven, (m, 20, 3), world frame."""
    axes = cosines_from_quaternions(shells.orientation[shells.chosen])
    return np.einsum('fi,nij->nfj', face_geometry(shells.half_edge).normals, axes)
