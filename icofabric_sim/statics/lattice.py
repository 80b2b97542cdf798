# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Equilibrium of the periodic fabric: a uniform deformation, and the same rotation of every body.

The unit cell has one body, so a state that keeps all bodies equivalent has nine degrees of
freedom: six strains and a rotation. Pre-stress and contact between neighbours are included. The
bands (periodic.py) show whether waves lower the energy of this state.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

from icofabric_sim.checks import renamed_attributes
from icofabric_sim.geometry.rotations import rotate_quaternions
from icofabric_sim.scene.scene import Scene
from icofabric_sim.statics.fabric import Configuration, StaticFabric
from icofabric_sim.statics.friction import FrictionPath
import numpy as np

# Components of the displacement gradient in Voigt's order xx yy zz yz xz xy.
VOIGT: Final = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
# Vector that orders opposite neighbours.
_ORDER: Final = np.array([1.0, np.pi, np.e**3])


@dataclass(frozen=True)
class RelaxSettings:
    """Tunables of the search for the equilibrium of a periodic fabric."""

    # Strain or rotation [rad] of a step: initial and largest.
    first_step: float = 0.02
    max_step: float = 0.1
    max_step_count: int = 300
    # Ratios to the largest curvature of the energy: largest slope at an equilibrium, curvature
    # that counts as zero, and smallest curvature that a step assumes.
    slope_ratio: float = 1e-11
    zero_ratio: float = 1e-8
    min_curvature_ratio: float = 1e-6
    # Strain or rotation [rad] of a step along a negative curvature where the slope vanishes, and
    # the largest number of such steps.
    nudge: float = 1e-3
    max_nudges: int = 4
    # Range of the volume over that of the woven fabric in which an equilibrium is sought.
    min_volume_ratio: float = 0.2**3
    max_volume_ratio: float = 4.0**3
    # Ratios of the actual to the expected decrease: to accept a step, and to enlarge the next.
    accepted_gain_ratio: float = 0.1
    good_gain_ratio: float = 0.7


_RELAX = RelaxSettings()


@renamed_attributes(pressing='contact_vectors')
class LatticeRest(NamedTuple):
    """Equilibrium of a periodic fabric."""

    gradient: np.ndarray  # (3, 3) deformation gradient from the woven state
    turn: np.ndarray  # (4,) x y z w rotation of each body from its woven orientation
    # (p, 3) [m] from a body to neighbours in contact, one of each pair.
    contact_vectors: np.ndarray
    overlap: float  # [m] largest overlap
    first_touches: int  # pairs of a body in contact without force: they resist one way only
    curvature: np.ndarray  # (9,) eigenvalues of the Hessian [J] by strains and rotations, rising
    step_count: int

    @property
    def verdict(self) -> str:
        """Stability against uniform motions: 'stable', 'with zero-energy strains', 'unstable'."""
        least = _RELAX.zero_ratio * float(np.abs(self.curvature).max())
        if self.curvature[0] < -least:
            return 'unstable'
        return 'with zero-energy strains' if self.curvature[0] <= least else 'stable'


class Lattice:
    """Unit cell of a periodic fabric: one body, and its joints to half of its neighbours."""

    def __init__(self, piece: Scene, body: int, *, contact: bool) -> None:
        """Use `body` of the finite `piece`, which contains all neighbours of that body."""
        bodies = piece.connectors.bodies
        place = piece.position - piece.position[body]
        # One of two connectors in opposite directions belongs to the cell.
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
        """Return the piece under a deformation gradient (3, 3) and body rotation (4,)."""
        return deformed_configuration(self.fabric, self._place, gradient, turn)

    def motions(self, gradient: np.ndarray) -> np.ndarray:
        """Return six strains and three rotations of the deformed lattice, (9, n, 6)."""
        place = self._place @ gradient.T
        motions = np.zeros((9, len(place), 6))
        for number, (i, j) in enumerate(VOIGT):
            motions[number, :, i] += 0.5 * place[:, j]
            motions[number, :, j] += 0.5 * place[:, i]
        motions[6:, :, 3:] = np.eye(3)[:, None, :]
        return motions


def deformed_configuration(
    fabric: StaticFabric, place: np.ndarray, gradient: np.ndarray, turn: np.ndarray
) -> Configuration:
    """Return a piece with deformed positions (n, 3) [m] and equally rotated bodies."""
    woven = fabric.scene.orientation
    # The rotation vector of `turn`.
    size = float(np.linalg.norm(turn[:3]))
    angle = 2.0 * np.arctan2(size, turn[3])
    vector = turn[:3] * (angle / size if size > 0.0 else 0.0)
    return Configuration(
        fabric, place @ gradient.T,
        rotate_quaternions(np.tile(vector, (len(woven), 1)), woven.copy()))


def hessian_along(here: Configuration, motions: np.ndarray) -> np.ndarray:
    """Return second derivatives of the energy along motions, (m, m)."""
    energy = np.einsum(
        'inf,jnf->ij', motions, np.array([here.times(motion) for motion in motions]))
    return np.asarray(0.5 * (energy + energy.T))


def relax(lattice: Lattice) -> LatticeRest:
    """
    Minimise the energy of a unit cell, starting from the woven state.

    Uses Newton steps with absolute values of the curvatures, limited so that the energy decreases
    as expected; its change is the integral of its slope along the step. Raises ValueError if
    there is no equilibrium.
    """
    gradient, turn = np.eye(3), np.array([0.0, 0.0, 0.0, 1.0])
    here = lattice.at(gradient, turn)
    slope = _slope(lattice, here, gradient)
    radius, nudges = _RELAX.first_step, 0
    curvature = np.zeros(9)
    for count in range(_RELAX.max_step_count):
        second = hessian_along(here, lattice.motions(gradient))
        curvature, vectors = np.linalg.eigh(second)
        largest = float(np.abs(curvature).max())
        if not np.isfinite(largest) or largest == 0.0:
            break
        if np.abs(slope).max() <= _RELAX.slope_ratio * largest:
            if curvature[0] >= -_RELAX.zero_ratio * largest or nudges >= _RELAX.max_nudges:
                return _rest(lattice, here, gradient, turn, curvature, count)
            nudges += 1
            step = _RELAX.nudge * vectors[:, 0]
        else:
            along = vectors.T @ slope
            step = -vectors @ (
                along / np.maximum(np.abs(curvature), _RELAX.min_curvature_ratio * largest))
            step *= min(1.0, radius / float(np.linalg.norm(step)))
            expected = float(slope @ step + 0.5 * step @ second @ step)
            gained = _change(lattice, gradient, turn, step, slope)
            after = _slope(lattice, *_moved(lattice, gradient, turn, step, 1.0)[:2])
            calmer = np.abs(after).max() < 0.5 * np.abs(slope).max()
            if not (calmer and radius >= _RELAX.first_step) and not (
                    gained <= _RELAX.accepted_gain_ratio * min(expected, 0.0)):
                radius = 0.3 * float(np.linalg.norm(step))
                if radius < 1e-14:
                    break
                continue
            if gained <= _RELAX.good_gain_ratio * expected:
                radius = min(2.0 * radius, _RELAX.max_step)
        here, gradient, turn = _moved(lattice, gradient, turn, step, 1.0)
        slope = _slope(lattice, here, gradient)
        if not _RELAX.min_volume_ratio < float(np.linalg.det(gradient)) < _RELAX.max_volume_ratio:
            break
    raise ValueError(
        'connector.natural_length: the periodic fabric has no equilibrium between a fifth of its '
        'woven size and four times that; give a length closer to the woven length of connectors, '
        f'{float(lattice.fabric.scene.geometry.connector_length)!r} m, or contact.mode always')


def _rest(
    lattice: Lattice, here: Configuration, gradient: np.ndarray, turn: np.ndarray,
    curvature: np.ndarray, count: int
) -> LatticeRest:
    touching = here.contact_state
    pressing = np.zeros((0, 3)) if touching is None else (
        here.position[touching.pairs[:, 1]] - here.position[touching.pairs[:, 0]])
    return LatticeRest(
        gradient, turn, pressing, 0.0 if touching is None else touching.depth,
        here.first_touches, curvature, count)


def _slope(
    lattice: Lattice, here: Configuration, gradient: np.ndarray
) -> np.ndarray:
    """Return derivatives of the energy of a cell by strains and rotations, (9,) [J]."""
    return -np.asarray(np.einsum('inf,nf->i', lattice.motions(gradient), here.force))


def _strain(step: np.ndarray) -> np.ndarray:
    """Return the symmetric displacement gradient (3, 3) of the strains of a step."""
    strain = np.zeros((3, 3))
    for value, (i, j) in zip(step, VOIGT):
        strain[i, j] += 0.5 * value
        strain[j, i] += 0.5 * value
    return strain


def _moved(
    lattice: Lattice, gradient: np.ndarray, turn: np.ndarray, step: np.ndarray, part: float
) -> tuple[Configuration, np.ndarray, np.ndarray]:
    """Return the configuration after a fraction of a step, its deformation and rotation."""
    after = (np.eye(3) + part * _strain(step[:6])) @ gradient
    turned = rotate_quaternions(part * step[None, 6:], turn[None])[0]
    return lattice.at(after, turned), after, turned


def _change(
    lattice: Lattice, gradient: np.ndarray, turn: np.ndarray, step: np.ndarray, slope: np.ndarray
) -> float:
    """Return the change of the energy of a cell in a step [J], by Simpson's rule."""
    total, strain = float(slope @ step), _strain(step[:6])
    for part, weight in ((0.5, 4.0), (1.0, 1.0)):
        here, after, _ = _moved(lattice, gradient, turn, step, part)
        # Rate of the strain there: a function of the first strain, so symmetric as well.
        rate = strain @ np.linalg.inv(np.eye(3) + part * strain)
        going = np.array([
            *(rate[i, j] * (1.0 if i == j else 2.0) for i, j in VOIGT), *step[6:]])
        total += weight * float(_slope(lattice, here, after) @ going)
    return total / 6.0
