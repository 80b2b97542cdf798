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
What small strains of one sign meet in an endless fabric whose connectors are at their kink.

The energy of a cell is k_e delta^2 / 2 for each connector that a motion lengthens by delta and
k_c delta^2 / 2 for each that it shortens, beside a quadratic form of all else: convex, piecewise
quadratic, and four times as large for a motion twice as large. So its minimiser over the rotation
of the bodies (and over the strains across a pull) grows in proportion to the strain, and a modulus
holds for all small strains of one kind and sign; those of two strains do not add up. Because the
energy is convex, the mean of a motion and of all its translates costs no more than it: no larger
cell yields more than one of one body.
"""

from typing import NamedTuple

import numpy as np

# Curvatures below this part of the largest are zero.
_ZERO = 1e-9
# Gradient at a minimum, in parts of what its terms are.
_GRADIENT = 1e-13
_STEPS = 200


class CellEnergy(NamedTuple):
    """
    Energy [J] of small motions of a cell: y are its strains (6) and its bodies' rotation (3).
    """

    changes: np.ndarray  # (c, 9) [m] of the lengths of the connectors at their kink
    pull: np.ndarray  # (c,) [N/m] where they get longer
    push: np.ndarray  # (c,) [N/m] where they get shorter
    rest: np.ndarray  # (9, 9) second derivatives of all that has one tangent
    # Of connectors with a kink that are elsewhere: changes (d, 9) and stretch (d,) [m].
    other_changes: np.ndarray
    stretch: np.ndarray

    def gradient(self, y: np.ndarray) -> np.ndarray:
        """First derivatives, (9,)."""
        delta = self.changes @ y
        return np.asarray(self.changes.T @ (self.slopes(delta) * delta) + self.rest @ y)

    def slopes(self, delta: np.ndarray) -> np.ndarray:
        """Stiffnesses [N/m] that changes of length (c,) meet."""
        return np.where(delta > 0.0, self.pull, self.push)

    def limit(self, y: np.ndarray) -> float:
        """How many times y may be taken before a connector that is not at its kink comes to it."""
        change = self.other_changes @ y
        nearer = change * self.stretch < 0.0
        return float((-self.stretch[nearer] / change[nearer]).min(initial=np.inf))

    def relaxed(self, fixed: np.ndarray, free: np.ndarray) -> np.ndarray:
        """
        The y = fixed + free z of the least energy, (9,); `free` (9, f).

        Newton's method on the pieces with an exact search along each step ends after finitely
        many (Mangasarian 2002, Optim. Methods Softw. 17, 913).
        """
        y = np.asarray(fixed, float).copy()
        largest = np.maximum(self.pull, self.push)
        scale = float(np.abs(self.rest @ y).max() + np.abs(
            self.changes.T).max(initial=0.0) * float(largest @ np.abs(self.changes @ y)))
        for _ in range(_STEPS):
            gradient = free.T @ self.gradient(y)
            if np.abs(gradient).max(initial=0.0) <= _GRADIENT * scale:
                return y
            slopes = self.slopes(self.changes @ y)
            hessian = free.T @ (
                self.changes.T @ (slopes[:, None] * self.changes) + self.rest) @ free
            values, vectors = np.linalg.eigh(0.5 * (hessian + hessian.T))
            along = vectors.T @ gradient
            bent = values > _ZERO * max(float(values[-1]), 0.0)
            step = np.zeros_like(along)
            step[bent] = -along[bent] / values[bent]
            # Where this piece is flat the energy falls until another one begins.
            flat = ~bent & (np.abs(along) > _GRADIENT * scale)
            step[flat] = -along[flat] / np.linalg.norm(along[flat]) if flat.any() else 0.0
            direction = free @ (vectors @ step)
            part = self._along(y, direction)
            if not part > 0.0:
                return y
            y += part * direction
        raise ArithmeticError(
            f'the relaxed rotation of a cell was not found in {_STEPS} steps')

    def _along(self, y: np.ndarray, direction: np.ndarray) -> float:
        """The part of a direction at whose end the energy no longer falls."""
        delta, change = self.changes @ y, self.changes @ direction
        with np.errstate(divide='ignore', invalid='ignore'):
            ends = np.where(change != 0.0, -delta / change, np.inf)
        ends = np.sort(ends[(ends > 0.0) & np.isfinite(ends)])
        before = 0.0
        slope = float(self.gradient(y) @ direction)
        for end in ends.tolist():
            after = float(self.gradient(y + end * direction) @ direction)
            if after >= 0.0:
                return before + (end - before) * slope / (slope - after)
            before, slope = end, after
        # Beyond the last end all is one piece.
        far = 2.0 * before + 1.0
        bend = (float(self.gradient(y + far * direction) @ direction) - slope) / (far - before)
        return before - slope / bend if bend > 0.0 else before


class Response(NamedTuple):
    """
    What a small strain of one kind and sign meets; holds for any part of it up to its `limit`.
    """

    strain: np.ndarray  # (6,) Voigt's order, that across a pull included
    stress: np.ndarray  # (6,) [Pa] beside the stress as woven
    modulus: float  # [Pa] stress along the strain, or along the pull, over it
    turn: np.ndarray  # (3,) [rad] rotation of the bodies
    # How many times this strain the first connector changes side at, to first order; infinite
    # where none does. Connectors at their kink are on the side to which it takes them.
    limit: float
