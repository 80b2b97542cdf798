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
Connectors that a step takes across their natural length, and shells that it parts or presses.

Where k_e is not k_c the slope of a connector jumps there, and shells that are open do not press.
The quadratic model of an energy knows one stiffness of each connector. Here its kinks are added to
it, to first order of the lengths: a function that is quadratic in pieces. Newton's method on the
pieces with an exact search along each step finds its minimiser (Mangasarian 2002, Optim. Methods
Softw. 17, 913). With the tangent alone stiff connectors change side at every step, which then are
as short as their stretch, and so are steps of shells that meet. A contact is a spring that only
pushes, as long as its depth.
"""

from icofabric_sim.statics.fabric import Configuration
from icofabric_sim.statics.kinks import end_wrenches
import numpy as np

_HALVINGS = 40


class Crossings:
    """What kinks add to the tangent of a configuration, along a step that is built up in parts."""

    def __init__(self, here: Configuration, reach: float = 0.0) -> None:
        """The step is zero; contacts count that are closer than `reach` [m], if it is above 0."""
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
        """Changes of the lengths [m] by a motion (n, 6)."""
        return np.asarray(np.einsum('eci,eci->c', motion[self._bodies.T], self._wrench))

    def advance(self, changes: np.ndarray) -> bool:
        """Add a part with these changes of lengths to the step; whether it crosses any kink."""
        before = self._excess(self._step)
        self._step = self._step + changes
        return not np.array_equal(before, self._excess(self._step))

    def energy(self, part: float) -> float:
        """What kinks add [J] to the tangent's energy along a part of the step."""
        step = part * self._step
        return 0.5 * float(self._excess(step) @ (self._start + step)**2)

    def best_part(self, changes: np.ndarray, slope: float, bend: float) -> float:
        """
        Up to which part of a motion with these changes of lengths the energy falls, at most 1.

        `slope` [J] and `bend` [J]: first and second derivative of the tangent's energy along it.
        """
        def rise(part: float) -> float:
            step = self._step + part * changes
            pull = self._excess(step) * (self._start + step)
            return slope + part * bend + float(pull @ changes)

        low, high = 0.0, 1.0
        if rise(high) <= 0.0:
            return high
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if rise(middle) <= 0.0 else (low, middle)
        return low

    def gradient(self) -> np.ndarray:
        """First derivatives (n, 6) of what kinks add, at the end of the step."""
        gradient = np.zeros((self._here.fabric.scene.body_count, 6))
        pull = self._excess(self._step) * (self._start + self._step)
        for bodies, wrench in zip(self._bodies.T, self._wrench):
            np.add.at(gradient, bodies, pull[:, None] * wrench)
        return gradient

    def model(self) -> Configuration:
        """The configuration with the stiffnesses that connectors have at the end of the step."""
        slope, count = self._here.slope.copy(), len(self._of)
        excess = self._excess(self._step)
        slope[self._of] += excess[:count]
        changed = count + np.flatnonzero(excess[count:])
        rows = np.concatenate(list(self._wrench[:, changed]), axis=1)
        return self._here.with_slope(slope, self._bodies[changed], (
            excess[changed, None, None] * rows[:, :, None] * rows[:, None, :]))

    def _excess(self, step: np.ndarray) -> np.ndarray:
        """By how much [N/m] stiffnesses at a step exceed those of the tangent."""
        return np.where(self._start + step > 0.0, self._pull, self._push) - self._tangent
