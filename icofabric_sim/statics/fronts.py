# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Count the eigenvalues of a sparse symmetric matrix below a shift, without storing its factors.

By Sylvester's law of inertia their number is that of the negative pivots of an elimination. The
elimination is multifrontal (Duff and Reid 1983, ACM Trans. Math. Softw. 9, 302): the degrees of
freedom of a part of the fabric are eliminated in a small dense matrix, its front. Only the update
of the surrounding degrees of freedom is passed on. Factors, which would need most of the memory,
are never stored.
"""

from icofabric_sim.kernels.fronts import add_update, pack_lower
import numpy as np
from scipy import sparse
from scipy.linalg import ldl
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf


def count_negative(matrix: sparse.csr_matrix, ends: np.ndarray, shift: float) -> int:
    """
    Count the eigenvalues of a matrix, in order of elimination, below `shift`; -1: undecided.

    `ends` (t,) are the increasing ends of the parts that are eliminated together; the last one is
    the size of the matrix.
    """
    upper = sparse.triu(matrix, format='csr')
    starts = np.concatenate([[0], ends[:-1]])
    waiting: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {}
    negative = 0
    for part, (first, last) in enumerate(zip(starts.tolist(), ends.tolist())):
        if first == last:
            continue
        begin, end = upper.indptr[first], upper.indptr[last]
        columns, values = upper.indices[begin:end], upper.data[begin:end]
        rows = np.repeat(
            np.arange(last - first), np.diff(upper.indptr[first:last + 1]))
        handed = waiting.pop(part, [])
        border = np.unique(np.concatenate([
            columns[columns >= last], *(places[places >= last] for places, _ in handed)]))
        own, side, rest = (
            np.zeros(shape, order='F') for shape in (
                (last - first, last - first), (len(border), last - first),
                (len(border), len(border))))
        inside = columns < last
        own[columns[inside] - first, rows[inside]] = values[inside]
        own[np.diag_indices(last - first)] -= shift
        side[np.searchsorted(border, columns[~inside]), rows[~inside]] = values[~inside]
        while handed:
            places, update = handed.pop()
            add_update(own, side, rest, np.where(
                places < last, places - first,
                last - first + np.searchsorted(border, places)), update)
            del update
        found = _eliminate(own, side, rest)
        if found < 0:
            return -1
        negative += found
        if len(border):
            update = np.empty(len(border) * (len(border) + 1) // 2)
            pack_lower(rest, update)
            after = int(np.searchsorted(ends, border[0], side='right'))
            waiting.setdefault(after, []).append((border, update))
    return negative


def _eliminate(own: np.ndarray, side: np.ndarray, rest: np.ndarray) -> int:
    """Count the negative pivots of `own` and add its update to `rest` (lower triangles)."""
    factor, failed = dpotrf(own, lower=1, clean=0)
    if not failed:
        if len(rest):
            along = dtrsm(1.0, factor, side, side=1, lower=1, trans_a=1, overwrite_b=1)
            dsyrk(-1.0, along, beta=1.0, c=rest, lower=1, overwrite_c=1)
        return 0
    # Pivots of one and two degrees of freedom (Bunch and Kaufman 1977).
    lower, pivots, order = ldl(own, lower=True)
    if not np.isfinite(pivots).all():
        return -1
    value, pair = np.diagonal(pivots).copy(), np.diagonal(pivots, -1)
    along = side[:, order]
    if len(rest):
        along = dtrsm(
            1.0, np.asfortranarray(lower[order]), np.asfortranarray(along), side=1, lower=1,
            trans_a=1, diag=1, overwrite_b=1)
    for k in np.flatnonzero(pair):
        values, vectors = np.linalg.eigh(pivots[k:k + 2, k:k + 2])
        value[k:k + 2] = values
        along[:, k:k + 2] = along[:, k:k + 2] @ vectors
    if not (value != 0.0).all():
        return -1
    if len(rest):
        along /= np.sqrt(np.abs(value))
        for sign in (1.0, -1.0):
            chosen = np.asfortranarray(along[:, value * sign > 0.0])
            if chosen.shape[1]:
                dsyrk(-sign, chosen, beta=1.0, c=rest, lower=1, overwrite_c=1)
    return int(np.count_nonzero(value < 0.0))
