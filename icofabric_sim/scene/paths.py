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
"""Paths on which drives move their bodies: smooth pieces one after the other."""

from typing import NamedTuple, TYPE_CHECKING

from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.initial import rotate_by_vector
from icofabric_sim.scene.rates import LARGEST_RATE
import numpy as np

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

_NONE = (0.0,) * 6
_UNTURNED = (0.0, 0.0, 0.0, 1.0)


class PathPiece(NamedTuple):
    """
    Displacement (3) [m] and rotation vector (3) [rad] of a group, world axes, from `start` on.

    cubic[0] + cubic[1] t + cubic[2] t^2 + cubic[3] t^3 + wave sin(rate t + phase), with t from the
    start; beyond a displacement `shift` and a quaternion `turn` of its own.
    """

    start: float  # [s] after the motion began
    cubic: tuple[tuple[float, ...], ...] = (_NONE,) * 4
    wave: tuple[float, ...] = _NONE
    rate: float = 0.0  # [rad/s]
    phase: float = 0.0  # [rad]
    shift: tuple[float, ...] = (0.0, 0.0, 0.0)  # [m]
    turn: tuple[float, ...] = _UNTURNED  # x y z w

    @property
    def is_zero(self) -> bool:
        """Never: also a body that is held is driven."""
        return False

    def at(self, time: float) -> np.ndarray:
        """The six coordinates at a time counted as the start is."""
        t = time - self.start
        cubic = np.array(self.cubic)
        return (
            cubic[0] + t * (cubic[1] + t * (cubic[2] + t * cubic[3]))
            + np.array(self.wave) * np.sin(self.rate * t + self.phase))

    def rates_at(self, time: float) -> np.ndarray:
        """Their derivatives."""
        t = time - self.start
        cubic = np.array(self.cubic)
        return (
            cubic[1] + t * (2.0 * cubic[2] + 3.0 * t * cubic[3])
            + np.array(self.wave) * self.rate * np.cos(self.rate * t + self.phase))

    def pose_at(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Displacement (3,) [m] and quaternion (4,) at a time."""
        d = self.at(time)
        turn = rotate_by_vector(d[3:], np.array([self.turn]))[0]
        return np.array(self.shift) + d[:3], turn

    def twist_at(self, time: float) -> np.ndarray:
        """Velocity of the middle [m/s] and spin [rad/s], (6,), world frame."""
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
        """On from a pose with one velocity [m/s] and one spin [rad/s]."""
        rates = tuple(float(value) for value in (*linear, *angular))
        return cls(
            start, (_NONE, rates, _NONE, _NONE), shift=tuple(pose[0].tolist()),
            turn=tuple(pose[1].tolist()))


def require_followed(
    name: str, file: str, spline: 'CubicSpline', parameters: Parameters
) -> None:
    """Refuse a table whose path of 3 or 6 coordinates is faster than steps can follow."""
    times = spline.x
    slopes = spline(np.append(times, 0.5 * (times[1:] + times[:-1])), 1)
    a = 0.5 * parameters['shell.edge_length']
    for first, size, unit in ((0, a, 'm/s'), (3, 1.0, 'rad/s')):
        fastest = float(np.abs(slopes[:, first:first + 3]).max(initial=0.0))
        if fastest > LARGEST_RATE * size:
            raise ParameterError(
                name, f'{name}: {file} moves with up to {fastest:.3g} {unit}: steps can follow '
                f'{LARGEST_RATE * size:g} {unit} at most')


class Path(NamedTuple):
    """Pieces in the order of time; the first begins with the motion."""

    pieces: tuple[PathPiece, ...]

    @property
    def fastest(self) -> np.ndarray:
        """Velocity [m/s] and spin [rad/s], (2,), that are hardly exceeded."""
        largest = np.zeros(2)
        for piece, after in zip(self.pieces, (*self.pieces[1:], None)):
            # Of the cubic at its ends; between them it is hardly faster.
            ends = [piece.start, piece.start if after is None else after.start]
            sizes = [np.abs(piece.rates_at(time)) for time in ends]
            size = np.maximum(*sizes) + np.abs(np.array(piece.wave)) * piece.rate
            largest = np.maximum(
                largest, [np.linalg.norm(size[:3]), np.linalg.norm(size[3:])])
        return largest
