# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Paths of drives and anchors, as sequences of smooth pieces."""

from typing import NamedTuple, TYPE_CHECKING

from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.initial import rotate_by_vector
from icofabric_sim.scene.rates import MAX_RATE_PER_S
import numpy as np

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

_ZERO6 = (0.0,) * 6
_IDENTITY_QUATERNION = (0.0, 0.0, 0.0, 1.0)


class PathPiece(NamedTuple):
    """
    Displacement (3) [m] and rotation vector (3) [rad] of a group, world axes, from `start` on.

    With t counted from `start`, the six coordinates are cubic[0] + cubic[1] t + cubic[2] t^2 +
    cubic[3] t^3 + wave sin(rate t + phase), added to the displacement `shift` and the rotation
    `turn`.
    """

    start: float  # [s] from the start of the motion
    cubic: tuple[tuple[float, ...], ...] = (_ZERO6,) * 4
    wave: tuple[float, ...] = _ZERO6
    rate: float = 0.0  # [rad/s]
    phase: float = 0.0  # [rad]
    shift: tuple[float, ...] = (0.0, 0.0, 0.0)  # [m]
    turn: tuple[float, ...] = _IDENTITY_QUATERNION  # x y z w

    @property
    def is_zero(self) -> bool:
        """Always False: a body held in place is driven too."""
        return False

    def at(self, time: float) -> np.ndarray:
        """Return the six coordinates at a time, without `shift` and `turn`."""
        t = time - self.start
        cubic = np.array(self.cubic)
        return (
            cubic[0] + t * (cubic[1] + t * (cubic[2] + t * cubic[3]))
            + np.array(self.wave) * np.sin(self.rate * t + self.phase))

    def rates_at(self, time: float) -> np.ndarray:
        """Return the time derivatives of the six coordinates."""
        t = time - self.start
        cubic = np.array(self.cubic)
        return (
            cubic[1] + t * (2.0 * cubic[2] + 3.0 * t * cubic[3])
            + np.array(self.wave) * self.rate * np.cos(self.rate * t + self.phase))

    def pose_at(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the displacement (3,) [m] and the quaternion (4,) at a time."""
        d = self.at(time)
        turn = rotate_by_vector(d[3:], np.array([self.turn]))[0]
        return np.array(self.shift) + d[:3], turn

    def twist_at(self, time: float) -> np.ndarray:
        """Return the velocity of the centroid [m/s] and angular velocity [rad/s], (6,), world."""
        rates, r = self.rates_at(time), self.at(time)[3:]
        angle = float(np.linalg.norm(r))
        second, third = 0.5, 1.0 / 6.0
        if angle > 1e-2:
            second = 2.0 * np.sin(0.5 * angle) ** 2 / angle**2
            third = (angle - np.sin(angle)) / angle**3
        cross = np.cross(r, rates[3:])
        return np.append(rates[:3], rates[3:] + second * cross + third * np.cross(r, cross))

    @classmethod
    def constant_twist(
        cls, start: float, pose: tuple[np.ndarray, np.ndarray], linear: np.ndarray,
        angular: np.ndarray
    ) -> 'PathPiece':
        """Return a piece from a pose with constant velocity [m/s] and angular velocity [rad/s]."""
        rates = tuple(float(value) for value in (*linear, *angular))
        return cls(
            start, (_ZERO6, rates, _ZERO6, _ZERO6), shift=tuple(pose[0].tolist()),
            turn=tuple(pose[1].tolist()))


def require_followed(
    name: str, file: str, spline: 'CubicSpline', parameters: Parameters
) -> None:
    """Refuse a table whose path of 3 or 6 coordinates is faster than time steps can resolve."""
    times = spline.x
    require_resolved(
        name, file, spline(np.append(times, 0.5 * (times[1:] + times[:-1])), 1), parameters)


def require_resolved(
    name: str, file: str, slopes: np.ndarray, parameters: Parameters
) -> None:
    """Refuse a table with velocities (m, 3) or (m, 6) that time steps cannot resolve."""
    a = 0.5 * parameters['shell.edge_length']
    for first, size, unit in ((0, a, 'm/s'), (3, 1.0, 'rad/s')):
        fastest = float(np.abs(slopes[:, first:first + 3]).max(initial=0.0))
        if fastest > MAX_RATE_PER_S * size:
            raise ParameterError(
                name, f'{name}: {file} moves with up to {fastest:.3g} {unit}: time steps resolve '
                f'{MAX_RATE_PER_S * size:g} {unit} at most')


class Path(NamedTuple):
    """Pieces in order of time; the first starts with the motion."""

    pieces: tuple[PathPiece, ...]

    def at(self, time: float) -> np.ndarray:
        """Return the six coordinates at a time [s]."""
        begun = [piece for piece in self.pieces if piece.start <= time]
        return (begun or self.pieces)[-1 if begun else 0].at(time)

    @property
    def fastest(self) -> np.ndarray:
        """Estimated largest speed [m/s] and angular speed [rad/s], (2,)."""
        largest = np.zeros(2)
        for piece, after in zip(self.pieces, (*self.pieces[1:], None)):
            # A cubic is sampled at its ends; between them it is hardly faster.
            ends = [piece.start, piece.start if after is None else after.start]
            sizes = [np.abs(piece.rates_at(time)) for time in ends]
            size = np.maximum(*sizes) + np.abs(np.array(piece.wave)) * piece.rate
            largest = np.maximum(
                largest, [np.linalg.norm(size[:3]), np.linalg.norm(size[3:])])
        return largest
