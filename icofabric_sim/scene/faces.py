# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Selectors of faces: resolve `toward 0 0 1 and exterior` to faces of each body of a group."""

import itertools
import math
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import face_geometry
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.selectors import Parser
import numpy as np

_FACE_COUNT = 20
# Faces whose angles to a direction differ by less than this [rad] count as equally near.
_EQUAL_ANGLE_RAD = 1e-6
# Displacements to the neighbours of a body, in body axes and units of the pitch W.
_NEIGHBOURS = np.array([
    p for p in itertools.product((-1.0, 0.0, 1.0), repeat=3) if sum(map(abs, p)) == 2.0])
# Neighbours in front of a face are 24.1 or 35.3 degrees from its normal, all others at least 48.7.
_MIN_FRONT_COSINE = math.cos(math.radians(40.0))
_HELP = (
    'use numbers K K ... (1 to 20), toward X Y Z, within ANGLE X Y Z, exterior or all, combined '
    'by and, or, not')


class Shells(NamedTuple):
    """Woven state of all bodies, and the bodies whose faces a selector chooses."""

    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) x y z w
    chosen: np.ndarray  # (m,) body numbers
    half_edge: float  # a [m]
    pitch: float  # W [m]


def select_faces(name: str, text: str, shells: Shells) -> np.ndarray:
    """
    Return the mask (m, 20) of faces that the selector `text` of the parameter `name` chooses.

    Raises ParameterError if no face is chosen.
    """
    mask = _parse(name, text, shells)
    if not mask.any():
        raise ParameterError(
            name, f'{name}: {text!r} selects no face of the {len(shells.chosen)} bodies; {_HELP}')
    return mask


def check_faces(name: str, text: str) -> None:
    """Raise ParameterError if `text` is not a selector of faces."""
    _parse(name, text, None)


def _parse(name: str, text: str, shells: Shells | None) -> np.ndarray:
    words = text.split()
    if not words:
        raise ParameterError(name, f'{name} is an empty selector; {_HELP}')
    parser = _FaceParser(name, text, words, shells)
    mask = parser.any_of()
    if parser.at < len(words):
        parser.fail(f'unexpected {words[parser.at]!r}')
    return mask


class _FaceParser(Parser):
    """Parser with the grammar of body selectors and words for faces."""

    help = _HELP

    def __init__(self, name: str, text: str, words: list[str], shells: Shells | None) -> None:
        super().__init__(name, text, words, None)
        self.shells = shells

    def true(self) -> np.ndarray:
        return np.ones((0 if self.shells is None else len(self.shells.chosen), _FACE_COUNT), bool)

    def atom(self, word: str) -> np.ndarray:
        if word == 'numbers':
            mask = ~self.true()
            for number in self.integers(None):
                if not 1 <= number <= _FACE_COUNT:
                    self.fail(f'there is no face {number}; faces are numbered 1 to {_FACE_COUNT}')
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
        """Select faces by a world direction, as woven: the nearest, or all within an angle."""
        size = float(np.linalg.norm(direction))
        if not 0.0 < size < np.inf:
            self.fail('the direction must be a nonzero vector')
        if self.shells is None:
            return self.true()
        cosine = np.clip(_normals(self.shells) @ (np.array(direction) / size), -1.0, 1.0)
        apart = np.arccos(cosine)
        limit = apart.min(axis=1, keepdims=True) if angle is None else angle
        return apart <= limit + _EQUAL_ANGLE_RAD

    def exterior(self) -> np.ndarray:
        """
        Select faces that point out of the fabric: a neighbour position in front of them is empty.

        In every weave a body can have twelve neighbours, halfway between two of its axes at the
        distance W sqrt(2). The one or three nearest to a face's normal are in front of the face.
        """
        if self.shells is None:
            return self.true()
        # A slow import, needed only by scenes with this selector.
        from scipy.spatial import cKDTree

        shells = self.shells
        axes = cosines_from_quaternions(shells.orientation[shells.chosen])
        places = shells.position[shells.chosen, None] + shells.pitch * np.einsum(
            'pi,nij->npj', _NEIGHBOURS, axes)

        distance, _ = cKDTree(shells.position).query(places.reshape(-1, 3))
        empty = (distance > 0.5 * shells.pitch).reshape(len(axes), -1)
        cosine = face_geometry(shells.half_edge).normals @ _NEIGHBOURS.T / math.sqrt(2.0)
        return empty @ (cosine > _MIN_FRONT_COSINE).T


def _normals(shells: Shells) -> np.ndarray:
    """Return the outward unit normals of the chosen bodies as woven, (m, 20, 3), world frame."""
    axes = cosines_from_quaternions(shells.orientation[shells.chosen])
    return np.einsum('fi,nij->nfj', face_geometry(shells.half_edge).normals, axes)
