# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Hessian matrix of a configuration, and the numbers of its zero and negative eigenvalues.

A body and its neighbours occupy 13 points of a face-centred cubic lattice, and the colour
(x + 3 y + 4 z) mod 13 of a grid point differs for all of them. So 13 times 6 products with
vectors that are 1 at all bodies of one colour give the whole matrix of any fabric.
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

# Largest numbers of degrees of freedom for which all eigenvalues are computed, a factorisation is
# stored for the lowest ones, and an elimination counts. The memory of an elimination grows with
# the power 4/3 of their number, its time with the square: 0.9 GB and 37 s at 292,000.
DENSE, FACTORED, COUNTED = 2_400, 60_000, 400_000
# Degrees of freedom up to which all eigenvalues are as fast as a factorisation on a busy machine.
_SMALL_FREEDOMS = 60
# Products for the ends of the spectrum of a larger fabric.
_END_PRODUCTS = 400
# Bodies of a part that is eliminated at once.
_PART_BODIES = 12
_COLOURS = 13
_COLOUR_WEIGHTS = np.array([1, 3, 4])
# Squared frequencies below this ratio to the largest are zero. The elimination of a large matrix
# has a larger round-off, because thousands of its pivots are small; with ratios from 1e-10 to 1e-7
# the counts of slabs of 4,631 bodies were equal.
_ZERO_RATIO, LARGE_ZERO_RATIO = 1e-10, 1e-9


class Curvature(NamedTuple):
    """
    Numbers of zero and negative eigenvalues of the Hessian; -1: not counted.

    For a fabric that is too large to count, `negative` 1 means one or more.
    """

    zero: int
    negative: int


def scaled_hessian(here: Configuration) -> sparse.csr_matrix:
    """
    Return the mass-scaled Hessian; its eigenvalues are squared frequencies [1/s^2].

    Rows and columns are the degrees of freedom that are True in `fabric.free`, body by body.
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
    # Contacts and custom connectors couple any two bodies, wrapped connectors joined ones.
    bodies, blocks = here.pair_blocks
    if len(bodies):
        places = own[bodies].reshape(-1, 12)
        weights = scale[bodies].reshape(-1, 12)
        rows.append(np.repeat(places, 12, axis=1).ravel())
        columns.append(np.tile(places, (1, 12)).ravel())
        values.append((blocks * weights[:, :, None] * weights[:, None, :]).ravel())
    if fabric.model.coulomb is not None:
        # Charges couple all bodies, dipoles their rotations, too.
        coupled = 3 if fabric.model.coulomb.moment is None else 6
        places, weights = own[:, :coupled].ravel(), scale[:, :coupled].ravel()
        block = weights[:, None] * (here.mutual_hessian() if coupled == 6 else coulomb_matrix(
            fabric.model.coulomb.strength, here.position, fabric.relative_charge)) * weights
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
    # Make the matrix exactly symmetric; the kernels are symmetric up to round-off.
    return sparse.csr_matrix(0.5 * (matrix + matrix.T))


def is_counted(here: Configuration) -> bool:
    """
    Return True if an elimination can count the eigenvalues of a configuration.

    Charges couple all bodies, so that the matrix is dense.
    """
    most = COUNTED if here.fabric.model.coulomb is None else min(COUNTED, DENSE)
    return int(here.fabric.free.sum()) <= most


def _colours_of(fabric: StaticFabric) -> np.ndarray:
    grid = fabric.scene.weave.grid.astype(np.int64)
    colours = np.zeros(fabric.scene.body_count, np.int64)
    colours[:len(grid)] = grid @ _COLOUR_WEIGHTS % _COLOURS
    return colours


def _partners(fabric: StaticFabric, colours: np.ndarray) -> np.ndarray:
    """Return the body of each colour among each body and its neighbours, (13, n); -1: none."""
    count = fabric.scene.body_count
    partner = np.full((_COLOURS, count), -1, np.int64)
    if len(fabric.scene.woven):
        bodies = fabric.scene.woven.bodies
        for first, second in ((0, 1), (1, 0)):
            partner[colours[bodies[:, second]], bodies[:, first]] = bodies[:, second]
    partner[colours, np.arange(count)] = np.arange(count)
    return partner


def judge_curvature(here: Configuration) -> Curvature:
    """Count the free motions of zero energy and those that lower the energy."""
    if not is_counted(here):
        return judge_ends(*ends_of_spectrum(here))
    return curvature_of(here, scaled_hessian(here))


def judge_ends(lowest: float, largest: float) -> Curvature:
    """Return the curvature of a fabric too large to count, from the ends of its spectrum."""
    return Curvature(-1, -1 if lowest >= -LARGE_ZERO_RATIO * largest else 1)


@one_thread()
def curvature_of(here: Configuration, matrix: sparse.csr_matrix) -> Curvature:
    """Count the zero and negative eigenvalues of the scaled Hessian `matrix`."""
    size = matrix.shape[0]
    if not size:
        return Curvature(0, 0)
    if size <= DENSE:
        if is_graded(here):
            values, *_ = solve_graded(here, scaled_hessian(without_slopes(here)))
            return Curvature(
                int(np.count_nonzero(values == 0.0)), int(np.count_nonzero(values < 0.0)))
        # If all are well above zero, one elimination decides, in a tenth of the time.
        if size > _SMALL_FREEDOMS and here.fabric.model.coulomb is None and not count_under(
                here, matrix, _ZERO_RATIO * row_sum(matrix)):
            return Curvature(0, 0)
        return count_signs(np.linalg.eigvalsh(matrix.toarray()), _ZERO_RATIO)
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
    Estimate the lowest and largest squared frequency [1/s^2] by Lanczos' iteration.

    Both estimates lie within the spectrum. The matrix is not formed, to save memory.
    """
    run, start = begin(here, min(_END_PRODUCTS, int(here.fabric.free.sum())))
    if not start.any():
        return 0.0, 0.0
    run.go_on(_END_PRODUCTS)
    matrix = run.matrix
    values = eigvalsh_tridiagonal(matrix.diagonal[:matrix.size], matrix.off[:matrix.size - 1])
    return float(values[0]), float(values[-1])


def zero_limit(matrix: sparse.csr_matrix) -> float:
    """Return the squared frequency [1/s^2] below which those of a large matrix are zero."""
    return LARGE_ZERO_RATIO * row_sum(matrix)


def count_signs(values: np.ndarray, zero: float) -> Curvature:
    """Count zero and negative ones of all eigenvalues, with the relative limit `zero`."""
    limit = zero * float(np.abs(values).max(initial=0.0))
    return Curvature(
        int(np.count_nonzero(np.abs(values) <= limit)), int(np.count_nonzero(values < -limit)))


def row_sum(matrix: sparse.csr_matrix) -> float:
    """Return the largest absolute row sum, an upper bound of eigenvalues (Gershgorin)."""
    return float(np.asarray(abs(matrix).sum(axis=1)).max(initial=0.0))


class Factor(NamedTuple):
    """Factors of a shifted matrix, and their order of elimination."""

    order: np.ndarray
    factors: SuperLU

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return the solution of the linear system for a right-hand side."""
        result = np.empty_like(right)
        result[self.order] = self.factors.solve(right[self.order])
        return result


def factorise(here: Configuration, matrix: sparse.csr_matrix, shift: float) -> Factor:
    """Factorise the scaled Hessian less `shift` [1/s^2], in the order of nested dissection."""
    fabric = here.fabric
    grid, count = fabric.scene.weave.grid, fabric.scene.body_count
    # Loose bodies have no connectors.
    bodies = np.concatenate([np.arange(len(grid), count), dissection_order(grid)])
    order = _freedom_order(fabric, bodies)
    shifted = matrix[order][:, order] - shift * sparse.identity(len(order))
    return Factor(order, splu(
        sparse.csc_matrix(shifted), permc_spec='NATURAL', diag_pivot_thresh=0.0,
        options={'SymmetricMode': True}))


def count_under(here: Configuration, matrix: sparse.csr_matrix, shift: float) -> int:
    """
    Count the eigenvalues of the scaled Hessian below `shift` [1/s^2], in little memory.

    Returns -1 if the elimination cannot decide.
    """
    fabric = here.fabric
    grid, count = fabric.scene.weave.grid, fabric.scene.body_count
    parts = [np.array([body]) for body in range(len(grid), count)]
    parts += dissection_parts(grid, _PART_BODIES)
    own = fabric.free.sum(axis=1)
    ends = np.cumsum([int(own[part].sum()) for part in parts])
    order = _freedom_order(fabric, np.concatenate(parts))
    return count_negative(matrix[order][:, order], ends, shift)


def _freedom_order(fabric: StaticFabric, bodies: np.ndarray) -> np.ndarray:
    """Return the numbers of the free degrees of freedom of bodies, in their order."""
    free = fabric.free.ravel()
    freedoms = (6 * bodies[:, None] + np.arange(6)).ravel()
    return np.asarray((np.cumsum(free) - 1)[freedoms[free[freedoms]]])


def count_below(factor: Factor) -> int:
    """
    Count the eigenvalues below the shift: the negative pivots (Sylvester's law of inertia).

    Returns -1 if rows were exchanged, which invalidates the count.
    """
    factors = factor.factors
    if not np.array_equal(factors.perm_r, factors.perm_c):
        return -1
    return int(np.count_nonzero(factors.U.diagonal() < 0.0))


def count_by_elimination(here: Configuration) -> Counts | None:
    """
    Return the mechanism counts of a large fabric, from the pivots of A^T A with a small shift.

    Returns None if the elimination cannot decide.
    """
    matrix = sparse_compatibility(here)
    connectors, freedoms = matrix.shape
    if not matrix.nnz:
        return Counts(freedoms, connectors, 0)
    square = sparse.csr_matrix(matrix.T @ matrix)
    zero = count_under(here, square, _ZERO_RATIO * row_sum(square))
    return None if zero < 0 else Counts(freedoms, connectors, freedoms - zero)
