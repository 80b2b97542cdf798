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
The Lanczos iteration for M^-1/2 H M^-1/2, without a matrix: what steps and modes are found by.

H is the Hessian of a configuration (kernels/hessian.py), M the masses and inertias; eigenvalues
are squared frequencies [1/s^2]. From three-term recurrences: two vectors are kept, not a basis.
"""

from functools import lru_cache
import math
from time import perf_counter
from typing import NamedTuple

from icofabric_sim.kernels.hessian import lanczos_steps
from icofabric_sim.kernels.records import (
    Coulomb,
    Model,
    SecondDerivatives,
    State,
    Supports,
    Work,
)
from icofabric_sim.kernels.tridiagonal import largest_eigenvalue
from icofabric_sim.simulation.model.layout import aligned_empty, Layout
from icofabric_sim.simulation.stepping.portions import Portions
import numpy as np

# Bodies up to which the noise that an iteration starts from is kept.
_FEW = 2_000


class Largest(NamedTuple):
    """The largest eigenvalue, and the weights (i,) of the iteration's vectors in its vector."""

    value: float  # [1/s^2]
    weights: np.ndarray


class Lanczos:
    """The tridiagonal matrix of an iteration, as far as it has come."""

    def __init__(
        self, model: Model, state: State, work: Work, start: np.ndarray, most: int, *,
        own: SecondDerivatives | None = None, pairs: SecondDerivatives | None = None,
        coulomb: Coulomb | None = None
    ) -> None:
        """
        Begin with the unit vector `start` (6, s), for at most so many steps.

        `work` has the attachment points of the state. `own` and `pairs`: what is to be added to
        the Hessian of the connectors, scaled by the roots of masses and inertias; 0 for what is
        held. `coulomb`: charges that count.
        """
        self._model, self._state, self._work = model, state, work
        self._terms = own, pairs, coulomb
        # Slots without a body are read too: they must hold numbers.
        self._moved, self._turns = np.zeros_like(work.points), np.zeros((3, start.shape[1]))
        self.diagonal, self.off = np.zeros(most), np.zeros(most)
        self._portions = Portions(7 * start.shape[1])
        self.begin_with(start)

    def begin_with(self, start: np.ndarray) -> None:
        """Start over."""
        self.done = 0  # steps
        self._current, self._previous = aligned_empty(start.shape), np.zeros_like(start)
        self._current[:] = start

    @property
    def size(self) -> int:
        """Steps until all that the start contains was found, or until now."""
        ended = np.flatnonzero(~(self.off[:self.done] > 0.0))
        return int(ended[0]) + 1 if len(ended) else self.done

    @property
    def ended(self) -> bool:
        """Whether there is nothing left to find."""
        return self.done == len(self.diagonal) or not (self.off[:self.done] > 0.0).all()

    def go_on(self, count: int) -> None:
        """Take so many steps more, or those that are left."""
        last = min(self.done + count, len(self.diagonal))
        self._steps(self.done, last, None, np.ones((1, 1)))
        self.done = last

    def combine(self, start: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Sums (j, 6, s) of the vectors of the first steps, times weights (i, j): once more."""
        shapes = np.zeros((weights.shape[1], *start.shape))
        done = self.done
        self.begin_with(start)
        self._steps(0, len(weights), shapes, weights)
        self.done = done
        return shapes

    def _steps(
        self, first: int, last: int, shapes: np.ndarray | None, weights: np.ndarray
    ) -> None:
        while first < last:
            until, started = min(first + self._portions.count, last), perf_counter()
            lanczos_steps(
                self._model, self._state, self._work.points, self._moved, self._turns,
                *self._terms, self._previous, self._current, self._work.acceleration,
                self.diagonal, self.off, first, until, shapes, weights)
            self._portions.note(until - first, perf_counter() - started)
            if not (self.off[first:until] > 0.0).all():
                # Everything is found.
                return
            first = until


def find_largest(run: Lanczos, upper: float, accuracy: float, every: int) -> Largest:
    """
    Find the largest eigenvalue to a relative accuracy, tested after `every` few steps.

    The Ritz value approaches from below, and an eigenvalue lies within the residual of it; the
    nearer of that and of the proved bound `upper` is returned once they agree.
    """
    value, weights = 0.0, np.ones(1)
    while not run.ended:
        run.go_on(every)
        size = run.size
        if not np.isfinite(run.diagonal[:size]).all():
            return Largest(math.inf, weights)
        weights = np.empty(size)
        ritz = largest_eigenvalue(run.diagonal[:size], run.off[:size - 1], weights)
        value = min(ritz + run.off[size - 1] * abs(float(weights[-1])), max(upper, ritz))
        if value - ritz <= accuracy * abs(ritz):
            break
    return Largest(value, weights)


def _noise(count: int, seed: int) -> np.ndarray:
    """Normal numbers (6, n); those of few bodies are kept, as drawing takes a step's time."""
    return (_kept_noise if count <= _FEW else _drawn_noise)(count, seed)


def _drawn_noise(count: int, seed: int) -> np.ndarray:
    return np.random.RandomState(seed).standard_normal((6, count))


_kept_noise = lru_cache(maxsize=8)(_drawn_noise)


def start_vector(
    layout: Layout, supports: Supports | None, seed: int = 1
) -> np.ndarray:
    """
    Unit vector to start from, (6, s), without held freedoms; zero where all are held.

    Noise has a part of every mode and no symmetry that could hide one.
    """
    start = aligned_empty((6, layout.slot_count))
    start[:] = 0.0
    start[:, layout.slot] = _noise(layout.body_count, seed)
    if supports is not None:
        start[:3] *= supports.inverse_mass > 0.0
        start[3:] *= supports.inverse_inertia > 0.0
    size = float(np.sqrt((start * start).sum()))
    if size > 0.0:
        start /= size
    return start
