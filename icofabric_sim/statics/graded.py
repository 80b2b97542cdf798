# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Vibrations of fabrics whose connectors differ by orders of magnitude in stiffness.

The mass-scaled Hessian is H = B^T B + R: B = sqrt(k) A from the changes of length A of connectors
and anchors (mechanisms.py), R from all other terms, such as tensions. An eigensolver for H has the
round-off of its largest entry, which hides soft motions. One-sided Jacobi rotations compute every
singular value of B to nearly full accuracy, because its rows are scaled (Demmel and Veselic 1992,
SIAM J. Matrix Anal. Appl. 13, 1204; LAPACK's dgejsv: Drmac and Veselic 2008, ibid. 29, 1322). On
the singular vectors V, H is S^2 + V^T R V. A stiff block far above the rest and above R is
eliminated, so that the soft block keeps its accuracy.
"""

from icofabric_sim.statics.fabric import Configuration
from icofabric_sim.statics.mechanisms import count_mechanisms, rows_of, sparse_compatibility
from icofabric_sim.statics.sides import rounding_of
import numpy as np
from scipy import sparse
from scipy.linalg import lapack

# Ratio of stiffnesses above which a fabric counts as graded; ratio of squared frequencies above
# which stiff motions are eliminated, with a relative error of its inverse squared.
_GRADED_RATIO, _GAP_RATIO = 1e4, 1e5
# Squared frequencies below this ratio to the largest of their block count as zero.
ZERO_RATIO = 1e-10
# Round-off error of a squared frequency, as a ratio to the largest.
ROUNDING_RATIO = 1e-15
# Options of dgejsv: scaled columns or rows; all left vectors, right vectors, no vectors.
_SCALED_COLUMNS, _SCALED_ROWS, _ALL_LEFT, _RIGHT, _NO_LEFT, _NO_RIGHT = 0, 2, 1, 0, 3, 3


def is_graded(here: Configuration) -> bool:
    """Return True if the stiffnesses of connectors and anchors differ by orders of magnitude."""
    slope = _slopes(here)
    slope = slope[slope != 0.0]
    return len(slope) > 0 and bool(
        slope.min() > 0.0 and slope.max() > _GRADED_RATIO * slope.min())


def solve_graded(
    here: Configuration, rest: sparse.csr_matrix, unequal: sparse.csr_matrix | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """
    Find all squared frequencies [1/s^2] of a graded configuration.

    Parameters
    ----------
    here
        The configuration.
    rest
        R (f, f), see `without_slopes`.
    unequal
        Additional scaling (f, f) of the degrees of freedom; None: none.

    Returns
    -------
    values : (f,) rising; zero values are exactly 0.
    vectors : (f, f) columns of mass-scaled free degrees of freedom.
    errors : (f,) estimated absolute round-off errors of the values.
    zero : limit below which a squared frequency counts as zero.
    """
    matrix, slope = sparse_compatibility(here), _slopes(here)
    if here.fabric.laws.is_plain:
        # Connectors are part of R.
        slope[:len(slope) - len(here.anchor_slope)] = 0.0
    matrix, slope = matrix[slope != 0.0], slope[slope != 0.0]
    if unequal is not None:
        matrix = sparse.csr_matrix(matrix @ unequal)
    dense = matrix.toarray()
    square, basis = _squares(np.sqrt(slope)[:, None] * dense, count_mechanisms(dense).rank)
    if not rest.nnz:
        return square[::-1], basis[:, ::-1], ROUNDING_RATIO * square[::-1], 0.0
    remainder = basis.T @ (rest @ basis)
    remainder = 0.5 * (remainder + remainder.T)
    size = float(np.abs(remainder).sum(axis=1).max(initial=0.0))
    found, start, mixing = [], 0, 0.0
    # Stiffest first.
    ends = [end for end in range(1, len(square)) if (
        square[end - 1] >= _GAP_RATIO * (square[end] + size))]
    for end in ends:
        stiff, soft = slice(start, end), slice(end, None)
        mixing = max(mixing, (square[end] + size) / square[end - 1])
        top = np.diag(square[stiff]) + remainder[stiff, stiff]
        mixed = np.linalg.solve(top, remainder[stiff, soft])
        remainder[soft, soft] -= remainder[soft, stiff] @ mixed
        basis[:, stiff], basis[:, soft] = (
            basis[:, stiff] + basis[:, soft] @ mixed.T, basis[:, soft] - basis[:, stiff] @ mixed)
        found.append(_eigen_of_block(top, basis[:, stiff]))
        start = end
    found.append(_eigen_of_block(
        np.diag(square[start:]) + remainder[start:, start:], basis[:, start:]))
    zero = ZERO_RATIO * float(np.abs(found[-1][0]).max())
    values, vectors, errors = (np.concatenate(part, axis=-1) for part in zip(*found[::-1]))
    values = np.where(np.abs(values) <= zero, 0.0, values)
    return values, vectors, errors + mixing**2 * np.abs(values), zero


def without_slopes(here: Configuration) -> Configuration:
    """
    Return the configuration with tensions of connectors and anchors but without stiffnesses.

    Its Hessian is R. Tensions within the round-off of lengths are set to 0.
    """
    bare = here.with_slope(np.zeros_like(here.slope), np.zeros((0, 2), np.int64), np.zeros(0))
    length, stretch = here.stretched.length, here.stretched.stretch
    place = np.abs(here.snapshot.connector_ends).max(axis=(1, 2), initial=0.0)
    natural = np.abs(stretch) <= rounding_of(length, place)
    bare.__dict__['stretched'] = here.stretched._replace(
        length=np.where(natural, here.fabric.laws.natural_length, length))
    bare.__dict__['anchor_slope'] = np.zeros_like(here.anchor_slope)
    return bare


def _slopes(here: Configuration) -> np.ndarray:
    """Return the stiffnesses [N/m] of the rows of the compatibility matrix."""
    return np.concatenate([here.slope[rows_of(here)], here.anchor_slope])


def _squares(matrix: np.ndarray, rank: int) -> tuple[np.ndarray, np.ndarray]:
    """Return squared singular values (f,) of B (c, f), descending, and right vectors (f, f)."""
    rows, columns = matrix.shape
    if rows <= columns:
        values, vectors, _, scale, _, info = lapack.dgejsv(
            matrix.T, joba=_SCALED_COLUMNS, jobu=_ALL_LEFT, jobv=_NO_RIGHT)
    else:
        values, _, vectors, scale, _, info = lapack.dgejsv(
            matrix, joba=_SCALED_ROWS, jobu=_NO_LEFT, jobv=_RIGHT)
    if info:
        raise np.linalg.LinAlgError(f'the singular values did not converge (dgejsv: {info})')
    square = np.zeros(columns)
    square[:rank] = (values[:rank] * (scale[0] / scale[1])) ** 2
    return square, np.array(vectors)


def _eigen_of_block(
    matrix: np.ndarray, basis: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return eigenvalues, vectors on a basis, and round-off of the values of one block."""
    values, turns = np.linalg.eigh(matrix)
    error = ROUNDING_RATIO * float(np.abs(values).max(initial=0.0))
    return values, basis @ turns, np.full(len(values), error)
