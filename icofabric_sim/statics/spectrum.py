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
The Hessian of a configuration as a matrix, and how many of its eigenvalues are zero or negative.

A body and its neighbours lie on 13 points of a face-centred cubic lattice, and the number
(x + 3 y + 4 z) mod 13 of a grid point is different for all of them. So 13 times 6 products with
vectors that are 1 at all bodies of one number give the whole matrix, of any fabric.
"""

from typing import NamedTuple

from icofabric_sim.statics.charges import coulomb_matrix
from icofabric_sim.statics.dissection import dissection_order, dissection_parts
from icofabric_sim.statics.fabric import Configuration, StaticFabric
from icofabric_sim.statics.fronts import count_negative
from icofabric_sim.statics.graded import is_graded, solve_graded, without_slopes
from icofabric_sim.statics.iteration import begin
from icofabric_sim.statics.mechanisms import Counts, sparse_compatibility
from icofabric_sim.statics.one_thread import one_thread
import numpy as np
from scipy import sparse
from scipy.linalg import eigvalsh_tridiagonal
from scipy.sparse.linalg import splu, SuperLU

# Freedoms up to which all eigenvalues are computed, up to which a factorisation is kept for the
# lowest, and up to which an elimination counts: its memory grows with the power 4/3 and its time
# with the square of their number, 37 s and 0.9 GB at 292,000.
DENSE, FACTORED, COUNTED = 2_400, 60_000, 400_000
# Freedoms up to which computing all is as fast as a factorisation, however busy the machine is.
_SMALL = 60
# Products with which the lowest eigenvalue of a larger fabric is sought.
_LOOKS = 400
# Bodies of a part that is eliminated at once.
_PART = 12
_COLOURS = 13
_STEPS = np.array([1, 3, 4])
# Squared frequencies below this part of the largest are zero. In an elimination of a large matrix
# rounding is larger, because thousands of its pivots are small; from 1e-10 to 1e-7 the counts of
# slabs of 4,631 bodies were the same.
_ZERO, LARGE_ZERO = 1e-10, 1e-9


class Curvature(NamedTuple):
    """
    How many eigenvalues of the Hessian are zero, and how many negative; -1: not counted.

    Of a fabric that is too large to count, 1 negative one stands for some.
    """

    zero: int
    negative: int


def scaled_hessian(here: Configuration) -> sparse.csr_matrix:
    """
    The mass-scaled Hessian of the free freedoms: its eigenvalues are squared frequencies [1/s^2].

    Rows and columns are the freedoms that are True in `fabric.free`, body by body.
    """
    fabric = here.fabric
    free = fabric.free
    scale = np.where(free, 1.0 / fabric.root, 0.0)
    colours = _colours_of(fabric)
    partner = _partners(fabric, colours)
    count = len(free)
    own = np.arange(6 * count, dtype=np.int32).reshape(count, 6)
    rows, columns, values = [], [], []
    for colour in range(_COLOURS):
        there = np.flatnonzero(partner[colour] >= 0)
        if not len(there):
            continue
        with_it = partner[colour][there]
        for freedom in range(6):
            vector = np.zeros((count, 6))
            chosen = np.unique(with_it)
            vector[chosen, freedom] = scale[chosen, freedom]
            product = scale * here.times(vector, pairs=False)
            block = product[there]
            keep = block != 0.0
            rows.append(own[there][keep])
            columns.append(np.broadcast_to(own[with_it, freedom][:, None], keep.shape)[keep])
            values.append(block[keep])
    # Contacts join any bodies, connectors around shells two that are joined already.
    bodies, blocks = here.pair_blocks
    if len(bodies):
        places = own[bodies].reshape(-1, 12)
        weights = scale[bodies].reshape(-1, 12)
        rows.append(np.repeat(places, 12, axis=1).ravel())
        columns.append(np.tile(places, (1, 12)).ravel())
        values.append((blocks * weights[:, :, None] * weights[:, None, :]).ravel())
    if fabric.model.coulomb is not None:
        # And charges all of them.
        places = np.arange(6 * count).reshape(count, 6)[:, :3].ravel()
        weights = scale[:, :3].ravel()
        block = weights[:, None] * coulomb_matrix(
            fabric.model.coulomb.strength, here.position, fabric.relative_charge) * weights
        rows.append(np.repeat(places, len(places)))
        columns.append(np.tile(places, len(places)))
        values.append(block.ravel())
    matrix = sparse.csr_matrix(
        (np.concatenate(values or [np.zeros(0)]),
         (np.concatenate(rows or [np.zeros(0, np.int32)]),
          np.concatenate(columns or [np.zeros(0, np.int32)]))), shape=(6 * count, 6 * count))
    del rows, columns, values
    chosen = np.flatnonzero(free.ravel())
    matrix = matrix[chosen][:, chosen]
    # Symmetric to the last bit, which the kernels are only to rounding.
    return sparse.csr_matrix(0.5 * (matrix + matrix.T))


def is_counted(here: Configuration) -> bool:
    """
    Whether eigenvalues of a configuration are counted: an elimination of its matrix is possible.

    Charges join every body with every other, so that nothing of it is empty.
    """
    most = COUNTED if here.fabric.model.coulomb is None else min(COUNTED, DENSE)
    return int(here.fabric.free.sum()) <= most


def _colours_of(fabric: StaticFabric) -> np.ndarray:
    grid = fabric.scene.weave.grid.astype(np.int64)
    colours = np.zeros(fabric.scene.body_count, np.int64)
    colours[:len(grid)] = grid @ _STEPS % _COLOURS
    return colours


def _partners(fabric: StaticFabric, colours: np.ndarray) -> np.ndarray:
    """The body of each colour that each body is or is joined to, (13, n); -1: none."""
    count = fabric.scene.body_count
    partner = np.full((_COLOURS, count), -1, np.int64)
    if fabric.scene.connector_count:
        bodies = fabric.scene.connectors.bodies
        for first, second in ((0, 1), (1, 0)):
            partner[colours[bodies[:, second]], bodies[:, first]] = bodies[:, second]
    partner[colours, np.arange(count)] = np.arange(count)
    return partner


def judge_curvature(here: Configuration) -> Curvature:
    """Count the free motions that cost no energy and those that lower it."""
    if not is_counted(here):
        return judge_ends(*ends_of_spectrum(here))
    return curvature_of(here, scaled_hessian(here))


def judge_ends(lowest: float, largest: float) -> Curvature:
    """What follows from the ends of the spectrum of a fabric that is too large to count."""
    return Curvature(-1, -1 if lowest >= -LARGE_ZERO * largest else 1)


@one_thread()
def curvature_of(here: Configuration, matrix: sparse.csr_matrix) -> Curvature:
    """The same of a matrix that is at hand."""
    size = matrix.shape[0]
    if not size:
        return Curvature(0, 0)
    if size <= DENSE:
        if is_graded(here):
            values, *_ = solve_graded(here, scaled_hessian(without_slopes(here)))
            return Curvature(
                int(np.count_nonzero(values == 0.0)), int(np.count_nonzero(values < 0.0)))
        # Where all of them are clear of zero one factorisation decides, in a tenth of the time.
        if size > _SMALL and here.fabric.model.coulomb is None and not count_under(
                here, matrix, _ZERO * row_sum(matrix)):
            return Curvature(0, 0)
        return count_signs(np.linalg.eigvalsh(matrix.toarray()), _ZERO)
    limit = zero_limit(matrix)
    if not is_counted(here):
        return judge_ends(*ends_of_spectrum(here))
    above = count_under(here, matrix, limit)
    if not above:
        return Curvature(0, 0)
    below = count_under(here, matrix, -limit)
    if below < 0 or above < 0:
        return Curvature(-1, -1)
    return Curvature(above - below, below)


def ends_of_spectrum(here: Configuration) -> tuple[float, float]:
    """
    Lowest and largest squared frequency [1/s^2] as Lanczos' iteration sees them, from inside.

    Without the matrix, so that little memory is needed.
    """
    run, start = begin(here, min(_LOOKS, int(here.fabric.free.sum())))
    if not start.any():
        return 0.0, 0.0
    run.go_on(_LOOKS)
    matrix = run.matrix
    values = eigvalsh_tridiagonal(matrix.diagonal[:matrix.size], matrix.off[:matrix.size - 1])
    return float(values[0]), float(values[-1])


def zero_limit(matrix: sparse.csr_matrix) -> float:
    """Squared frequency [1/s^2] below which one of a large matrix counts as zero."""
    return LARGE_ZERO * row_sum(matrix)


def count_signs(values: np.ndarray, zero: float) -> Curvature:
    """Of all eigenvalues."""
    limit = zero * float(np.abs(values).max(initial=0.0))
    return Curvature(
        int(np.count_nonzero(np.abs(values) <= limit)), int(np.count_nonzero(values < -limit)))


def row_sum(matrix: sparse.csr_matrix) -> float:
    """The largest sum of sizes in a row, which no eigenvalue exceeds (Gershgorin)."""
    return float(np.asarray(abs(matrix).sum(axis=1)).max(initial=0.0))


class Factor(NamedTuple):
    """Factors of a matrix less a multiple of the unit matrix, and their order of elimination."""

    order: np.ndarray
    factors: SuperLU

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution of the system for a vector."""
        result = np.empty_like(right)
        result[self.order] = self.factors.solve(right[self.order])
        return result


def factorise(here: Configuration, matrix: sparse.csr_matrix, shift: float) -> Factor:
    """Factor of the scaled Hessian less `shift` [1/s^2], by nested dissection of the fabric."""
    fabric = here.fabric
    grid, count = fabric.scene.weave.grid, fabric.scene.body_count
    # Loose bodies are joined to nothing.
    bodies = np.concatenate([np.arange(len(grid), count), dissection_order(grid)])
    order = _freedom_order(fabric, bodies)
    shifted = matrix[order][:, order] - shift * sparse.identity(len(order))
    return Factor(order, splu(
        sparse.csc_matrix(shifted), permc_spec='NATURAL', diag_pivot_thresh=0.0,
        options={'SymmetricMode': True}))


def count_under(here: Configuration, matrix: sparse.csr_matrix, shift: float) -> int:
    """
    How many eigenvalues of the scaled Hessian lie below `shift` [1/s^2], in little memory.

    -1 where an elimination cannot decide.
    """
    fabric = here.fabric
    grid, count = fabric.scene.weave.grid, fabric.scene.body_count
    parts = [np.array([body]) for body in range(len(grid), count)]
    parts += dissection_parts(grid, _PART)
    own = fabric.free.sum(axis=1)
    ends = np.cumsum([int(own[part].sum()) for part in parts])
    order = _freedom_order(fabric, np.concatenate(parts))
    return count_negative(matrix[order][:, order], ends, shift)


def _freedom_order(fabric: StaticFabric, bodies: np.ndarray) -> np.ndarray:
    """Numbers of the free freedoms of bodies, in their order."""
    free = fabric.free.ravel()
    freedoms = (6 * bodies[:, None] + np.arange(6)).ravel()
    return np.asarray((np.cumsum(free) - 1)[freedoms[free[freedoms]]])


def count_below(factor: Factor) -> int:
    """
    How many eigenvalues lie below the shift: the negative pivots (Sylvester's law of inertia).

    -1 where rows had to be exchanged, which would spoil the count.
    """
    factors = factor.factors
    if not np.array_equal(factors.perm_r, factors.perm_c):
        return -1
    return int(np.count_nonzero(factors.U.diagonal() < 0.0))


def count_by_elimination(here: Configuration) -> Counts | None:
    """
    The counts of a large fabric, from the signs of the pivots of A^T A less a little.

    None where an elimination cannot decide.
    """
    matrix = sparse_compatibility(here)
    connectors, freedoms = matrix.shape
    if not matrix.nnz:
        return Counts(freedoms, connectors, 0)
    square = sparse.csr_matrix(matrix.T @ matrix)
    zero = count_under(here, square, _ZERO * row_sum(square))
    return None if zero < 0 else Counts(freedoms, connectors, freedoms - zero)
