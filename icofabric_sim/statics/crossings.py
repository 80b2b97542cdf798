# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Kinks within a step: connectors that cross their natural length, and contacts that open or close.

If k_e differs from k_c, the stiffness of a connector jumps at its natural length; an open contact
has no stiffness. A quadratic model of the energy has one stiffness per connector. This module adds
the kinks to the model, to first order in the lengths, so that the model becomes piecewise
quadratic. Newton's method on the pieces, with an exact line search, finds its minimiser
(Mangasarian 2002, Optim. Methods Softw. 17, 913). With the tangent alone, stiff connectors would
change sides in every step, and steps would be as short as their stretches; the same holds for
contacts. A contact is modelled as a spring that acts only in compression.
"""

from icofabric_sim.statics.fabric import Configuration
from icofabric_sim.statics.kinks import end_wrenches
import numpy as np

_BISECTION_STEPS = 40


class Crossings:
    """Energy of kinks in addition to the tangent model, along a step that is built up in parts."""

    def __init__(self, here: Configuration, reach: float = 0.0) -> None:
        """Start with a zero step; `reach` > 0 [m] includes pairs of shells closer than that."""
        fabric = here.fabric
        self._here = here
        self._of = np.flatnonzero(fabric.counted & fabric.laws.kinked)
        self._bodies = fabric.scene.connectors.bodies[self._of]
        self._wrench = end_wrenches(here, self._of)
        self._pull, self._push = fabric.laws.stiffnesses(self._of)
        self._start, self._tangent = here.stretched.stretch[self._of], here.slope[self._of]
        if fabric.contacts is not None and reach > 0.0:
            pairs, depth, slopes, touching = fabric.contacts.close(
                here.position, here.axes, reach)
            stiffness = np.full(len(pairs), fabric.contacts.stiffness)
            self._bodies = np.concatenate([self._bodies, pairs])
            self._wrench = np.concatenate([self._wrench, slopes], axis=1)
            self._pull = np.concatenate([self._pull, stiffness])
            self._push = np.concatenate([self._push, 0.0 * stiffness])
            self._start = np.concatenate([self._start, depth])
            self._tangent = np.concatenate([self._tangent, np.where(touching, stiffness, 0.0)])
        self._step = np.zeros(len(self._start))

    def changes(self, motion: np.ndarray) -> np.ndarray:
        """Return the changes of length [m] by a motion (n, 6)."""
        return np.asarray(np.einsum('eci,eci->c', motion[self._bodies.T], self._wrench))

    def advance(self, changes: np.ndarray) -> bool:
        """Extend the step by these changes of length; return True if it crosses a kink."""
        before = self._excess(self._step)
        self._step = self._step + changes
        return not np.array_equal(before, self._excess(self._step))

    def energy(self, part: float) -> float:
        """Return the energy of the kinks [J] at a fraction `part` of the step."""
        step = part * self._step
        return 0.5 * float(self._excess(step) @ (self._start + step)**2)

    def best_part(self, changes: np.ndarray, slope: float, bend: float) -> float:
        """
        Return the fraction (at most 1) of a motion up to which the energy decreases.

        `changes` are the motion's changes of length; `slope` [J] and `bend` [J] the first and
        second derivative of the tangent's energy along the motion.
        """
        def rise(part: float) -> float:
            step = self._step + part * changes
            pull = self._excess(step) * (self._start + step)
            return slope + part * bend + float(pull @ changes)

        low, high = 0.0, 1.0
        if rise(high) <= 0.0:
            return high
        for _ in range(_BISECTION_STEPS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if rise(middle) <= 0.0 else (low, middle)
        return low

    def gradient(self) -> np.ndarray:
        """Return the gradient (n, 6) of the energy of the kinks at the end of the step."""
        gradient = np.zeros((self._here.fabric.scene.body_count, 6))
        pull = self._excess(self._step) * (self._start + self._step)
        for bodies, wrench in zip(self._bodies.T, self._wrench):
            np.add.at(gradient, bodies, pull[:, None] * wrench)
        return gradient

    def model(self) -> Configuration:
        """Return the configuration with the stiffnesses at the end of the step."""
        slope, count = self._here.slope.copy(), len(self._of)
        excess = self._excess(self._step)
        slope[self._of] += excess[:count]
        changed = count + np.flatnonzero(excess[count:])
        rows = np.concatenate(list(self._wrench[:, changed]), axis=1)
        return self._here.with_slope(slope, self._bodies[changed], (
            excess[changed, None, None] * rows[:, :, None] * rows[:, None, :]))

    def _excess(self, step: np.ndarray) -> np.ndarray:
        """Return the stiffnesses [N/m] at a step less those of the tangent."""
        return np.where(self._start + step > 0.0, self._pull, self._push) - self._tangent
