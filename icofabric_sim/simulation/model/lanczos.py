# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Lanczos iteration for the eigenvalues of M^-1/2 H M^-1/2, for step sizes and vibration modes.

H is the Hessian of a configuration (kernels/hessian.py), M the masses and inertias; eigenvalues
are squared frequencies [1/s^2]. The matrix is never assembled. The three-term recurrence keeps two
vectors instead of a basis.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
import math
from time import perf_counter
from typing import NamedTuple, Protocol

from icofabric_sim.kernels.figures import group_size
from icofabric_sim.kernels.lanczos import added_up, lanczos_steps, note_products
from icofabric_sim.kernels.records import Model, SecondDerivatives, State, Supports, Work
from icofabric_sim.kernels.tridiagonal import largest_eigenvalue
from icofabric_sim.simulation.model.layout import aligned_empty, Layout
from icofabric_sim.simulation.model.shared_kinds import BESIDE_CONNECTORS, without
from icofabric_sim.simulation.stepping.portions import Portions
from icofabric_sim.terms.coulomb.record import Coulomb
import numpy as np

# Up to this number of bodies, the noise of start vectors is cached.
_CACHED_BODY_COUNT = 2_000


class Largest(NamedTuple):
    """The largest eigenvalue, and the weights (i,) of the Lanczos vectors in its eigenvector."""

    value: float  # [1/s^2]
    weights: np.ndarray


@dataclass
class Tridiagonal:
    """The tridiagonal matrix of the completed steps; off[i] couples steps i and i + 1."""

    diagonal: np.ndarray  # (m,) for the largest number of steps
    off: np.ndarray
    done: int = 0  # steps

    @classmethod
    def of(cls, most: int) -> 'Tridiagonal':
        """Return an empty matrix for at most `most` steps."""
        return cls(np.zeros(most), np.zeros(most))

    @property
    def size(self) -> int:
        """
        Number of rows of the matrix: completed steps, or fewer if the start vector is exhausted.
        """
        ended = np.flatnonzero(~(self.off[:self.done] > 0.0))
        return int(ended[0]) + 1 if len(ended) else self.done

    @property
    def ended(self) -> bool:
        """True if no more step can extend the matrix."""
        return self.done == len(self.diagonal) or not (self.off[:self.done] > 0.0).all()


class Iteration(Protocol):
    """Interface of an iteration that extends its tridiagonal matrix step by step."""

    @property
    def matrix(self) -> Tridiagonal:
        """Matrix of the completed steps."""

    def go_on(self, count: int) -> None:
        """Take `count` more steps, or fewer if fewer remain."""


class Lanczos:
    """A Lanczos iteration over a whole fabric."""

    def __init__(
        self, model: Model, state: State, work: Work, start: np.ndarray, most: int, *,
        own: SecondDerivatives | None = None, pairs: SecondDerivatives | None = None,
        coulomb: Coulomb | None = None
    ) -> None:
        """
        Start from the unit vector `start` (6, s), for at most `most` steps.

        `work` holds the attachment points of the state. `own` and `pairs` are second derivatives
        that are added to the Hessian of the connectors, scaled by the roots of masses and
        inertias; they are 0 for held degrees of freedom. `coulomb` are charges with mutual forces.
        """
        self._model, self._state = without(model, *BESIDE_CONNECTORS), without(state, 'rest')
        self._work = work
        self._terms = own, pairs, coulomb
        # Slots without a body are read, too: they must hold finite numbers.
        self._moved, self._turns = np.zeros_like(work.points), np.zeros((3, start.shape[1]))
        self._sums = np.zeros(-(-len(model.blocks.slot) // work.group))
        self.matrix = Tridiagonal.of(most)
        self._portions = Portions(7 * start.shape[1])
        self.begin_with(start)

    def begin_with(self, start: np.ndarray) -> None:
        """Restart from a vector `start` (6, s)."""
        self.matrix.done = 0
        self._current, self._previous = aligned_empty(start.shape), np.zeros_like(start)
        self._current[:] = start

    def go_on(self, count: int) -> None:
        """Take `count` more steps, or fewer if fewer remain."""
        matrix = self.matrix
        last = min(matrix.done + count, len(matrix.diagonal))
        self._steps(matrix.done, last, None, np.ones((1, 1)))
        matrix.done = last

    def combine(self, start: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """
        Repeat the first i steps and return sums (j, 6, s) of their vectors, weighted by (i, j).
        """
        shapes = np.zeros((weights.shape[1], *start.shape))
        done = self.matrix.done
        self.begin_with(start)
        self._steps(0, len(weights), shapes, weights)
        self.matrix.done = done
        return shapes

    def _steps(
        self, first: int, last: int, shapes: np.ndarray | None, weights: np.ndarray
    ) -> None:
        matrix = self.matrix
        while first < last:
            until, started = min(first + self._portions.count, last), perf_counter()
            lanczos_steps(
                self._model, self._state, self._work.points, self._moved, self._turns,
                *self._terms, self._previous, self._current, self._work.acceleration,
                self._sums, self._work.group, matrix.diagonal, matrix.off, first, until, shapes,
                weights)
            self._portions.note(until - first, perf_counter() - started)
            if not (matrix.off[first:until] > 0.0).all():
                # The start vector is exhausted.
                return
            first = until


def find_largest(run: Iteration, upper: float, accuracy: float, every: int) -> Largest:
    """
    Find the largest eigenvalue to a relative `accuracy`, tested every `every` steps.

    The Ritz value approaches the eigenvalue from below, and an eigenvalue lies within its
    residual. The smaller of this residual bound and the proved bound `upper` is returned once the
    Ritz value agrees with that bound.
    """
    value, weights, matrix = 0.0, np.ones(1), run.matrix
    while not matrix.ended:
        run.go_on(every)
        size = matrix.size
        if not np.isfinite(matrix.diagonal[:size]).all():
            return Largest(math.inf, weights)
        weights = np.empty(size)
        ritz = largest_eigenvalue(matrix.diagonal[:size], matrix.off[:size - 1], weights)
        value = min(ritz + matrix.off[size - 1] * abs(float(weights[-1])), max(upper, ritz))
        if value - ritz <= accuracy * abs(ritz):
            break
    return Largest(value, weights)


def start_vector(
    layout: Layout, supports: Supports | None, seed: int = 1
) -> np.ndarray:
    """
    Return a unit start vector (6, s) without held degrees of freedom; zero if all are held.

    Noise contains every mode and has no symmetry that would exclude one.
    """
    start = aligned_empty((6, layout.slot_count))
    for target, row in zip(start, start_rows(layout, supports, seed)):
        target[:] = row
    count = len(layout.blocks.slot)
    size = group_size(count)
    sums = np.zeros(-(-count // size))
    note_products(layout.blocks, start, start, sums, size, 0, len(sums), count)
    square = added_up(sums)
    if square > 0.0:
        start /= math.sqrt(square)
    return start


def start_rows(
    layout: Layout, supports: Supports | None, seed: int = 1
) -> Iterator[np.ndarray]:
    """Yield the rows (s,) of the start vector before normalisation."""
    for k, values in enumerate(_noise(layout.body_count, seed)):
        row = np.zeros(layout.slot_count)
        row[layout.slot] = values
        if supports is not None:
            row *= (supports.inverse_mass[k] if k < 3 else supports.inverse_inertia[0]) > 0.0
        yield row


def _noise(count: int, seed: int) -> Iterator[np.ndarray]:
    """Return six rows (n,) of normal random numbers; rows for small fabrics are cached."""
    if count <= _CACHED_BODY_COUNT:
        return iter(_kept_noise(count, seed))
    source = np.random.RandomState(seed)
    return (source.standard_normal(count) for _ in range(6))


@lru_cache(maxsize=8)
def _kept_noise(count: int, seed: int) -> np.ndarray:
    return np.random.RandomState(seed).standard_normal((6, count))
