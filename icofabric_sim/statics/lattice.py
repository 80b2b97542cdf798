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
Rest of the fabric without end: places follow one deformation, bodies turn alike.

With one body to a cell that is all that can relax without parting bodies that are alike: six
strains and a turn. Pre-stress and the push of shells on their neighbours count. Whether waves
lower the energy of that state the bands say (periodic.py).
"""

from typing import Final, NamedTuple

from icofabric_sim.geometry.rotations import turned_by
from icofabric_sim.scene.scene import Scene
from icofabric_sim.statics.fabric import Configuration, StaticFabric
from icofabric_sim.statics.friction import FrictionPath
import numpy as np

# Voigt's order xx yy zz yz xz xy: a strain of 1 is a displacement gradient of this.
VOIGT: Final = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
# Tells one of two opposite neighbours from the other.
_ORDER: Final = np.array([1.0, np.pi, np.e**3])
# Strain or turn [rad] of a step, at first and at most.
_FIRST, _LONGEST = 0.02, 0.1
_STEPS: Final = 300
# Over the largest curvature of the energy: its slope at rest at most, a curvature that counts as
# zero, and the least one that a step assumes.
_RESTING, _FLAT, _LEAST = 1e-11, 1e-8, 1e-6
# Along a curvature below zero a search goes on by so much, so many times.
_NUDGE, _NUDGES = 1e-3, 4
# Volume over that of the woven fabric beyond which no rest is looked for.
_LEAST_VOLUME, _LARGEST_VOLUME = 0.2**3, 4.0**3
# What a step gains over what was expected of it: enough to take it, and to take longer ones.
_TAKEN, _GOOD = 0.1, 0.7


class LatticeRest(NamedTuple):
    """An endless fabric at rest."""

    gradient: np.ndarray  # (3, 3) of the places, by those as woven
    turn: np.ndarray  # (4,) x y z w of each body, by its orientation as woven
    pressing: np.ndarray  # (p, 3) [m] from each body to those that it presses on, once for a pair
    overlap: float  # [m] the deepest
    first_touches: int  # pairs of a body that touch without a push: they resist one way only
    curvature: np.ndarray  # (9,) of the energy [J], rising; of strains and turns alike
    step_count: int

    @property
    def verdict(self) -> str:
        """Whether other strains and turns would lower the energy, or cost none."""
        least = _FLAT * float(np.abs(self.curvature).max())
        if self.curvature[0] < -least:
            return 'unstable'
        return 'with soft strains' if self.curvature[0] <= least else 'stable'


class Lattice:
    """A cell of an endless fabric: a body of a piece, and what joins it to half of the others."""

    def __init__(self, piece: Scene, body: int, *, contact: bool) -> None:
        """Take `body` of the `piece`, which has all its neighbours there."""
        bodies = piece.connectors.bodies
        place = piece.position - piece.position[body]
        # Of the two connectors in opposite directions one belongs to the cell.
        own = np.flatnonzero((bodies == body).any(axis=1))
        ahead = place[bodies[own].sum(axis=1) - body] @ _ORDER > 0.0
        self.fabric = StaticFabric(
            piece, only=own[ahead], contact=contact,
            friction=FrictionPath.of(piece) if contact else None)
        self._place, self._piece = place, piece
        if self.fabric.contacts is not None:
            others = np.flatnonzero(place @ _ORDER > 0.0)
            self.fabric.contacts.restrict(
                np.column_stack([np.full(len(others), body), others]))
        self.body = body

    def at(self, gradient: np.ndarray, turn: np.ndarray) -> Configuration:
        """Where the piece is by a deformation gradient (3, 3) and a turn (4,) of each body."""
        return placed(self.fabric, self._place, gradient, turn)

    def motions(self, gradient: np.ndarray) -> np.ndarray:
        """The six strains and three turns of the deformed lattice, (9, n, 6)."""
        place = self._place @ gradient.T
        motions = np.zeros((9, len(place), 6))
        for number, (i, j) in enumerate(VOIGT):
            motions[number, :, i] += 0.5 * place[:, j]
            motions[number, :, j] += 0.5 * place[:, i]
        motions[6:, :, 3:] = np.eye(3)[:, None, :]
        return motions


def placed(
    fabric: StaticFabric, place: np.ndarray, gradient: np.ndarray, turn: np.ndarray
) -> Configuration:
    """A piece whose places (n, 3) [m] are deformed, and whose bodies are turned alike."""
    woven = fabric.scene.orientation
    # The turn, as a rotation vector.
    size = float(np.linalg.norm(turn[:3]))
    angle = 2.0 * np.arctan2(size, turn[3])
    vector = turn[:3] * (angle / size if size > 0.0 else 0.0)
    return Configuration(
        fabric, place @ gradient.T, turned_by(np.tile(vector, (len(woven), 1)), woven.copy()))


def form(here: Configuration, motions: np.ndarray) -> np.ndarray:
    """Second derivatives of the energy along motions, (m, m)."""
    energy = np.einsum(
        'inf,jnf->ij', motions, np.array([here.times(motion) for motion in motions]))
    return np.asarray(0.5 * (energy + energy.T))


def relax(lattice: Lattice) -> LatticeRest:
    """
    Where the energy of a cell is least, from the woven state on.

    Newton steps with the sizes of the curvatures, as long as the energy falls as expected; its
    change is the integral of its slope along the step. Raises ValueError where there is no rest.
    """
    gradient, turn = np.eye(3), np.array([0.0, 0.0, 0.0, 1.0])
    here = lattice.at(gradient, turn)
    slope = _slope(lattice, here, gradient)
    radius, nudges = _FIRST, 0
    curvature = np.zeros(9)
    for count in range(_STEPS):
        second = form(here, lattice.motions(gradient))
        curvature, vectors = np.linalg.eigh(second)
        largest = float(np.abs(curvature).max())
        if not np.isfinite(largest) or largest == 0.0:
            break
        if np.abs(slope).max() <= _RESTING * largest:
            if curvature[0] >= -_FLAT * largest or nudges >= _NUDGES:
                return _rest(lattice, here, gradient, turn, curvature, count)
            nudges += 1
            step = _NUDGE * vectors[:, 0]
        else:
            along = vectors.T @ slope
            step = -vectors @ (along / np.maximum(np.abs(curvature), _LEAST * largest))
            step *= min(1.0, radius / float(np.linalg.norm(step)))
            expected = float(slope @ step + 0.5 * step @ second @ step)
            gained = _change(lattice, gradient, turn, step, slope)
            after = _slope(lattice, *_moved(lattice, gradient, turn, step, 1.0)[:2])
            calmer = np.abs(after).max() < 0.5 * np.abs(slope).max()
            if not (calmer and radius >= _FIRST) and not gained <= _TAKEN * min(expected, 0.0):
                radius = 0.3 * float(np.linalg.norm(step))
                if radius < 1e-14:
                    break
                continue
            if gained <= _GOOD * expected:
                radius = min(2.0 * radius, _LONGEST)
        here, gradient, turn = _moved(lattice, gradient, turn, step, 1.0)
        slope = _slope(lattice, here, gradient)
        if not _LEAST_VOLUME < float(np.linalg.det(gradient)) < _LARGEST_VOLUME:
            break
    raise ValueError(
        'connector.natural_length: the endless fabric finds no rest between a fifth of its woven '
        'size and four times that; take a length nearer to that of the connectors as woven, '
        f'{float(lattice.fabric.scene.geometry.connector_length)!r} m, or contact.mode always')


def _rest(
    lattice: Lattice, here: Configuration, gradient: np.ndarray, turn: np.ndarray,
    curvature: np.ndarray, count: int
) -> LatticeRest:
    touching = here.touching
    pressing = np.zeros((0, 3)) if touching is None else (
        here.position[touching.pairs[:, 1]] - here.position[touching.pairs[:, 0]])
    return LatticeRest(
        gradient, turn, pressing, 0.0 if touching is None else touching.depth,
        here.first_touches, curvature, count)


def _slope(
    lattice: Lattice, here: Configuration, gradient: np.ndarray
) -> np.ndarray:
    """Derivatives of the energy of a cell by strains and turns, (9,) [J]."""
    return -np.asarray(np.einsum('inf,nf->i', lattice.motions(gradient), here.force))


def _strain(step: np.ndarray) -> np.ndarray:
    """The displacement gradient (3, 3) of the strains of a step, symmetric."""
    strain = np.zeros((3, 3))
    for value, (i, j) in zip(step, VOIGT):
        strain[i, j] += 0.5 * value
        strain[j, i] += 0.5 * value
    return strain


def _moved(
    lattice: Lattice, gradient: np.ndarray, turn: np.ndarray, step: np.ndarray, part: float
) -> tuple[Configuration, np.ndarray, np.ndarray]:
    """The configuration after a part of a step, its deformation gradient, and its turn."""
    after = (np.eye(3) + part * _strain(step[:6])) @ gradient
    turned = turned_by(part * step[None, 6:], turn[None])[0]
    return lattice.at(after, turned), after, turned


def _change(
    lattice: Lattice, gradient: np.ndarray, turn: np.ndarray, step: np.ndarray, slope: np.ndarray
) -> float:
    """By how much the energy of a cell changes in a step [J], by Simpson's rule."""
    total, strain = float(slope @ step), _strain(step[:6])
    for part, weight in ((0.5, 4.0), (1.0, 1.0)):
        here, after, _ = _moved(lattice, gradient, turn, step, part)
        # How the strain goes on there: a function of the first, so symmetric as well.
        rate = strain @ np.linalg.inv(np.eye(3) + part * strain)
        going = np.array([
            *(rate[i, j] * (1.0 if i == j else 2.0) for i, j in VOIGT), *step[6:]])
        total += weight * float(_slope(lattice, here, after) @ going)
    return total / 6.0
