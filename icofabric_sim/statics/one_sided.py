# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Response of a periodic fabric with connectors at their kink to small strains of one sign.

The energy of a cell is k_e delta^2 / 2 for each connector that a motion lengthens by delta and
k_c delta^2 / 2 for each that it shortens, plus a quadratic form of all other terms. It is convex,
piecewise quadratic and homogeneous of degree two. So its minimiser over the rotation of the bodies
(and over the lateral strains of a pull) is proportional to the strain, and a modulus holds for all
small strains of one kind and sign; responses to two strains do not add up. Because the energy is
convex, averaging a motion over all translations does not raise the energy: no larger cell is more
compliant than a cell of one body.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True)
class MinimumSettings:
    """Tunables of the minimisation of the energy of a unit cell."""

    zero_ratio: float = 1e-9  # curvature over the largest that counts as zero
    gradient_ratio: float = 1e-13  # gradient at a minimum over the size of its terms
    max_steps: int = 200


_MINIMUM = MinimumSettings()


class CellEnergy(NamedTuple):
    """Energy [J] of small motions y of a cell: six strains and the rotation (3) of its body."""

    changes: np.ndarray  # (c, 9) [m] derivatives of the lengths of connectors at their kink
    pull: np.ndarray  # (c,) [N/m] in extension
    push: np.ndarray  # (c,) [N/m] in compression
    rest: np.ndarray  # (9, 9) second derivatives of all smooth terms
    # Changes (d, 9) and stretch (d,) [m] of connectors with two stiffnesses away from their kink.
    other_changes: np.ndarray
    stretch: np.ndarray

    def gradient(self, y: np.ndarray) -> np.ndarray:
        """Return the first derivatives, (9,)."""
        delta = self.changes @ y
        return np.asarray(self.changes.T @ (self.slopes(delta) * delta) + self.rest @ y)

    def slopes(self, delta: np.ndarray) -> np.ndarray:
        """Return the stiffnesses [N/m] for changes of length (c,)."""
        return np.where(delta > 0.0, self.pull, self.push)

    def limit(self, y: np.ndarray) -> float:
        """Return the factor of y at which a connector away from its kink reaches it."""
        change = self.other_changes @ y
        nearer = change * self.stretch < 0.0
        return float((-self.stretch[nearer] / change[nearer]).min(initial=np.inf))

    def relaxed(self, fixed: np.ndarray, free: np.ndarray) -> np.ndarray:
        """
        Return y = fixed + free z of minimum energy, (9,); `free` (9, f).

        Newton's method on the pieces with an exact line search ends after finitely many steps
        (Mangasarian 2002, Optim. Methods Softw. 17, 913).
        """
        y = np.asarray(fixed, float).copy()
        largest = np.maximum(self.pull, self.push)
        scale = float(np.abs(self.rest @ y).max() + np.abs(
            self.changes.T).max(initial=0.0) * float(largest @ np.abs(self.changes @ y)))
        for _ in range(_MINIMUM.max_steps):
            gradient = free.T @ self.gradient(y)
            if np.abs(gradient).max(initial=0.0) <= _MINIMUM.gradient_ratio * scale:
                return y
            slopes = self.slopes(self.changes @ y)
            hessian = free.T @ (
                self.changes.T @ (slopes[:, None] * self.changes) + self.rest) @ free
            values, vectors = np.linalg.eigh(0.5 * (hessian + hessian.T))
            along = vectors.T @ gradient
            bent = values > _MINIMUM.zero_ratio * max(float(values[-1]), 0.0)
            step = np.zeros_like(along)
            step[bent] = -along[bent] / values[bent]
            # On a flat piece the energy decreases until the next piece.
            flat = ~bent & (np.abs(along) > _MINIMUM.gradient_ratio * scale)
            step[flat] = -along[flat] / np.linalg.norm(along[flat]) if flat.any() else 0.0
            direction = free @ (vectors @ step)
            part = self._along(y, direction)
            if not part > 0.0:
                return y
            y += part * direction
        raise ArithmeticError(
            f'the relaxed rotation of a cell was not found in {_MINIMUM.max_steps} steps')

    def _along(self, y: np.ndarray, direction: np.ndarray) -> float:
        """Return the factor of a direction up to which the energy decreases."""
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
        # A single piece extends beyond the last end.
        far = 2.0 * before + 1.0
        bend = (float(self.gradient(y + far * direction) @ direction) - slope) / (far - before)
        return before - slope / bend if bend > 0.0 else before


class Response(NamedTuple):
    """Response to a small strain of one kind and sign; valid for multiples up to `limit`."""

    strain: np.ndarray  # (6,) Voigt's order, including lateral strains of a pull
    stress: np.ndarray  # (6,) [Pa] in addition to the stress as woven
    modulus: float  # [Pa] stress along the strain, or along the pull, over the strain
    turn: np.ndarray  # (3,) [rad] rotation of the bodies
    # Multiple of this strain at which the first connector changes side, to first order; infinite
    # if none does. Connectors at their kink are on the side to which the strain moves them.
    limit: float
