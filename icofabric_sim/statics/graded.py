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
Vibrations of fabrics whose connectors differ by orders of magnitude in stiffness.

The mass-scaled Hessian is H = B^T B + R: B = sqrt(k) A from the changes of length A of connectors
and anchors (mechanisms.py), R from all else, such as tensions. A solver of H errs by the rounding
of its largest entry, which hides soft motions beside stiff ones. One-sided Jacobi rotations find
each singular value of B to nearly all digits, because its rows are scaled (Demmel and Veselic
1992, SIAM J. Matrix Anal. Appl. 13, 1204; LAPACK's dgejsv: Drmac and Veselic 2008, the same 29,
1322). On its singular vectors V, H is S^2 + V^T R V, of which a stiff part is eliminated where it
is far above the rest and above R: the soft part keeps its own digits.
"""

from icofabric_sim.statics.fabric import Configuration
from icofabric_sim.statics.mechanisms import count_mechanisms, sparse_compatibility
from icofabric_sim.statics.sides import rounding_of
import numpy as np
from scipy import sparse
from scipy.linalg import lapack

# Ratio of stiffnesses from which the extra work is done; ratio of squared frequencies from which
# stiff motions are eliminated, which leaves a relative error of its inverse squared.
_GRADED_RATIO, _GAP_RATIO = 1e4, 1e5
# Squared frequencies below this ratio to the largest that they are computed with are zero.
ZERO_RATIO = 1e-10
# Error of a squared frequency by rounding, as a ratio to the largest.
ROUNDING_RATIO = 1e-15
# What dgejsv is asked: scaled columns, or rows; left vectors, all of them, or right ones; none.
_COLUMNS, _ROWS, _ALL_LEFT, _RIGHT, _NO_LEFT, _NO_RIGHT = 0, 2, 1, 0, 3, 3


def is_graded(here: Configuration) -> bool:
    """Whether connectors and anchors differ so much in stiffness that soft motions need care."""
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
        (f, f) what scales the freedoms once more; None: nothing does.

    Returns
    -------
    values : (f,) rising; zero ones are exactly 0.
    vectors : (f, f) columns of mass-scaled free freedoms.
    errors : (f,) estimated absolute errors of the values by rounding.
    zero : squared frequency below which one counts as zero.
    """
    matrix, slope = sparse_compatibility(here), _slopes(here)
    if here.fabric.laws.is_plain:
        # Connectors are in R.
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
        found.append(_own(top, basis[:, stiff]))
        start = end
    found.append(_own(np.diag(square[start:]) + remainder[start:, start:], basis[:, start:]))
    zero = ZERO_RATIO * float(np.abs(found[-1][0]).max())
    values, vectors, errors = (np.concatenate(part, axis=-1) for part in zip(*found[::-1]))
    values = np.where(np.abs(values) <= zero, 0.0, values)
    return values, vectors, errors + mixing**2 * np.abs(values), zero


def without_slopes(here: Configuration) -> Configuration:
    """
    Return the configuration with the tensions of connectors and anchors, without their slopes.

    Its second derivatives are R. Tensions that rounding of lengths makes are left out.
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
    """Slopes [N/m] of the rows of the compatibility matrix."""
    slope = here.slope[(here.slope != 0.0) & here.snapshot.intact]
    return np.concatenate([slope, here.anchor_slope])


def _squares(matrix: np.ndarray, rank: int) -> tuple[np.ndarray, np.ndarray]:
    """Squared singular values (f,) of B (c, f), falling, and all right singular vectors (f, f)."""
    rows, columns = matrix.shape
    if rows <= columns:
        values, vectors, _, scale, _, info = lapack.dgejsv(
            matrix.T, joba=_COLUMNS, jobu=_ALL_LEFT, jobv=_NO_RIGHT)
    else:
        values, _, vectors, scale, _, info = lapack.dgejsv(
            matrix, joba=_ROWS, jobu=_NO_LEFT, jobv=_RIGHT)
    if info:
        raise np.linalg.LinAlgError(f'the singular values did not converge (dgejsv: {info})')
    square = np.zeros(columns)
    square[:rank] = (values[:rank] * (scale[0] / scale[1])) ** 2
    return square, np.array(vectors)


def _own(
    matrix: np.ndarray, basis: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values and vectors of one part on its basis, and what rounding adds to the values."""
    values, turns = np.linalg.eigh(matrix)
    error = ROUNDING_RATIO * float(np.abs(values).max(initial=0.0))
    return values, basis @ turns, np.full(len(values), error)
