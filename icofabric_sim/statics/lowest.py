# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Lowest frequencies of a large fabric, in memory proportional to its size.

The Lanczos iteration (lanczos.py) runs until these frequencies have converged. Its vectors are not
stored but recomputed for the shapes. Without reorthogonalisation the iteration finds spurious
copies of eigenvalues. A copy is recognised because its vector has almost no component along the
start vector (Cullum and Willoughby 1985, Lanczos Algorithms for Large Symmetric Eigenvalue
Computations, 4.5). A pass finds one motion of each multiple frequency; the next pass starts
orthogonal to the motions found.
"""

from collections.abc import Callable
from dataclasses import dataclass

from icofabric_sim.simulation.model.lanczos import Lanczos
from icofabric_sim.statics.fabric import Configuration
from icofabric_sim.statics.iteration import begin
import numpy as np
from scipy.linalg import eigh_tridiagonal, eigvalsh_tridiagonal


@dataclass(frozen=True)
class LanczosSettings:
    """Tunables of the Lanczos iteration for the lowest frequencies."""

    first_steps: int = 100  # steps before the first test of convergence
    step_factor: float = 1.25  # factor of steps until the next test: tests solve an eigenproblem
    residual_ratio: float = 1e-8  # relative residual of a squared frequency
    # Component along the start vector below which a value is spurious.
    spurious_ratio: float = 1e-7
    new_ratio: float = 0.1  # norm of a vector orthogonal to the known ones above which it is new
    # Values count as equal if they differ by less, relative to themselves or to the largest.
    equal_ratio: float = 1e-7
    rounding_ratio: float = 1e-12
    # Runs from new start vectors: a single run finds one motion of equal frequencies.
    max_passes: int = 8


_LANCZOS = LanczosSettings()


class NotFoundError(ValueError):
    """Frequencies did not converge within the largest number of products."""


def lowest_modes(
    here: Configuration, count: int, zero: float, below: Callable[[float], int] | None,
    most: int
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the lowest `count` squared frequencies above `zero` [1/s^2], and motions (f, count).

    Motions are mass-scaled, on free degrees of freedom. `below` counts the frequencies between
    zero and a value and so detects missing ones; without it (fabrics too large to count) passes
    continue until one finds nothing new. Raises NotFoundError if they do not converge within
    `most` products.
    """
    layout, free = here.fabric.layout, here.fabric.free
    values, vectors = np.zeros(0), np.zeros((0, int(free.sum())))
    for number in range(_LANCZOS.max_passes):
        run, start = begin(here, min(most, 4 * len(vectors.T)), seed=number + 1)
        if number:
            scaled = layout.gather(start)[free]
            scaled -= vectors.T @ (vectors @ scaled)
            spread = np.zeros(free.shape)
            spread[free] = scaled / np.linalg.norm(scaled)
            run.begin_with(start := layout.spread(spread))
        found, weights = _converged(run, count, zero)
        shapes = np.array([layout.gather(shape)[free] for shape in run.combine(start, weights)])
        known = len(values)
        for value, shape in zip(found, shapes):
            shape = shape / np.linalg.norm(shape)
            for _ in range(2):
                shape = shape - vectors.T @ (vectors @ shape)
            left = float(np.linalg.norm(shape))
            if left > _LANCZOS.new_ratio:
                values = np.append(values, value)
                vectors = np.vstack([vectors, shape / left])
        order = np.argsort(values, kind='stable')[:count]
        new = bool((order >= known).any())
        values, vectors = values[order], vectors[order]
        if len(values) == count and (
                not new or below is not None
                and below((1.0 + 100.0 * _LANCZOS.equal_ratio) * float(values[-1])) <= count):
            break
    return _refined(here, vectors)


def _refined(here: Configuration, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Ritz values and vectors (f, j) of the Hessian on orthonormal vectors (j, f)."""
    free, root = here.fabric.free, here.fabric.root
    products = np.empty_like(vectors)
    for vector, product in zip(vectors, products):
        motion = np.zeros(free.shape)
        motion[free] = vector
        product[:] = (here.times(motion / root) / root)[free]
    values, turns = np.linalg.eigh(vectors @ products.T)
    return values, vectors.T @ turns


def _converged(run: Lanczos, count: int, zero: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest distinct values above zero, and the weights (i, j) of their vectors."""
    until, matrix = _LANCZOS.first_steps, run.matrix
    while True:
        run.go_on(until - matrix.done)
        size = matrix.size
        diagonal, off = matrix.diagonal[:size], matrix.off[:size - 1]
        largest = float(eigvalsh_tridiagonal(diagonal, off, 'i', (size - 1, size - 1))[0])
        first = len(eigvalsh_tridiagonal(diagonal, off, 'v', (-np.inf, zero)))
        vectors = np.zeros((size, 0))
        good = np.zeros(0, bool)
        sought = 2 * count + 4
        while len(good) < count and first + sought // 2 < size:
            found, vectors = eigh_tridiagonal(diagonal, off, select='i', select_range=(
                first, min(first + sought, size) - 1))
            found, vectors = _each_once(found, vectors, largest)
            found, vectors = found[:count], vectors[:, :count]
            good = matrix.off[size - 1] * np.abs(vectors[-1]) <= _LANCZOS.residual_ratio * found
            sought *= 2
        if len(good) == count and good.all():
            return found, vectors
        if matrix.ended:
            raise NotFoundError(
                f'only {good.sum()} of the {count} lowest frequencies of this fabric converged '
                f'within {matrix.done:,} products: they lie too close to zero or to each other; '
                "request fewer, or which='highest'")
        until = int(_LANCZOS.step_factor * until) + 1


def _each_once(
    values: np.ndarray, vectors: np.ndarray, largest: float
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return values without copies that differ by round-off, and a vector (m,) for each.

    Copies appear after a value has converged (Paige 1980, Linear Algebra Appl. 34, 235), and their
    vectors may be mixed; the result is the combination without the last step.
    """
    real = np.flatnonzero(np.abs(vectors[0]) > _LANCZOS.spurious_ratio)
    gap = np.diff(values[real]) > (
        _LANCZOS.equal_ratio * np.abs(values[real[1:]]) + _LANCZOS.rounding_ratio * largest)
    groups = np.split(real, np.flatnonzero(gap) + 1) if len(real) else []
    singled = [vectors[:, :0]]
    for group in groups:
        part = vectors[:, group]
        start, end = part[0], part[-1]
        if len(group) > 1 and end.any():
            start = start - (start @ end) / (end @ end) * end
        singled.append((part @ (start / np.linalg.norm(start)))[:, None])
    return np.array([values[group[0]] for group in groups]), np.hstack(singled)
