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
The lowest frequencies of a large fabric, in memory that grows with the fabric alone.

The Lanczos iteration (lanczos.py) goes on until they have come out of it. Its vectors are not
kept: they are made again for the shapes. Without them it loses orthogonality and finds values
again; what was found again only is recognised by its vector's part of the start, which is next to
nothing (Cullum and Willoughby 1985, Lanczos Algorithms for Large Symmetric Eigenvalue
Computations, 4.5). Of motions with one frequency a pass finds one; the next begins without it.
"""

from collections.abc import Callable

from icofabric_sim.simulation.model.lanczos import Lanczos
from icofabric_sim.statics.fabric import Configuration
from icofabric_sim.statics.iteration import begin
import numpy as np
from scipy.linalg import eigh_tridiagonal, eigvalsh_tridiagonal

# Steps before the first test of convergence, and how many more until the next.
_FIRST, _LONGER = 100, 1.25
# Residual of a squared frequency, in parts of it.
_RESIDUAL = 1e-8
# Part of the start below which a value was only found again; what is left of a vector without
# those that are known where it is a new one.
_AGAIN, _NEW = 1e-7, 0.1
# Values that differ by less, in parts of themselves or of the largest, are one.
_SAME, _ROUNDING = 1e-7, 1e-12
_PASSES = 8


class NotFoundError(ValueError):
    """Frequencies did not come out of as many products as there may be."""


def lowest_modes(
    here: Configuration, count: int, zero: float, below: Callable[[float], int] | None,
    most: int
) -> tuple[np.ndarray, np.ndarray]:
    """
    `count` squared frequencies above `zero` [1/s^2], rising, and scaled free motions (f, count).

    `below` counts those between zero and a value, which shows whether one is missing; None
    where that is too large to count: then passes are made until one brings nothing new. Raises
    NotFoundError where they do not come out of `most` products.
    """
    layout, free = here.fabric.layout, here.fabric.free
    values, vectors = np.zeros(0), np.zeros((0, int(free.sum())))
    for number in range(_PASSES):
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
            if left > _NEW:
                values = np.append(values, value)
                vectors = np.vstack([vectors, shape / left])
        order = np.argsort(values, kind='stable')[:count]
        new = bool((order >= known).any())
        values, vectors = values[order], vectors[order]
        if len(values) == count and (
                not new or below is not None
                and below((1.0 + 100.0 * _SAME) * float(values[-1])) <= count):
            break
    return _refined(here, vectors)


def _refined(here: Configuration, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and vectors (f, j) of the Hessian on the space of orthonormal vectors (j, f)."""
    free, root = here.fabric.free, here.fabric.root
    products = np.empty_like(vectors)
    for vector, product in zip(vectors, products):
        motion = np.zeros(free.shape)
        motion[free] = vector
        product[:] = (here.times(motion / root) / root)[free]
    values, turns = np.linalg.eigh(vectors @ products.T)
    return values, vectors.T @ turns


def _converged(run: Lanczos, count: int, zero: float) -> tuple[np.ndarray, np.ndarray]:
    """The lowest values above zero, each once, and the weights (i, j) of their vectors."""
    until, matrix = _FIRST, run.matrix
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
            good = matrix.off[size - 1] * np.abs(vectors[-1]) <= _RESIDUAL * found
            sought *= 2
        if len(good) == count and good.all():
            return found, vectors
        if matrix.ended:
            raise NotFoundError(
                f'of the {count} lowest frequencies of this fabric only {good.sum()} came out of '
                f'{matrix.done:,} products: they lie too close to zero or to each other; ask for '
                "fewer, or for which='highest'")
        until = int(_LONGER * until) + 1


def _each_once(
    values: np.ndarray, vectors: np.ndarray, largest: float
) -> tuple[np.ndarray, np.ndarray]:
    """
    Values that differ by rounding taken together, and a vector (m,) for each.

    Several are there because one of them has come out long ago (Paige 1980, Linear Algebra Appl.
    34, 235), and their vectors may be mixed: of all combinations the one without the last step.
    """
    real = np.flatnonzero(np.abs(vectors[0]) > _AGAIN)
    gap = np.diff(values[real]) > _SAME * np.abs(values[real[1:]]) + _ROUNDING * largest
    groups = np.split(real, np.flatnonzero(gap) + 1) if len(real) else []
    singled = [vectors[:, :0]]
    for group in groups:
        part = vectors[:, group]
        start, end = part[0], part[-1]
        if len(group) > 1 and end.any():
            start = start - (start @ end) / (end @ end) * end
        singled.append((part @ (start / np.linalg.norm(start)))[:, None])
    return np.array([values[group[0]] for group in groups]), np.hstack(singled)
