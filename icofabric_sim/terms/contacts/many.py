# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Functions of pairs, applied to n pairs.

Half edges [m] (n, 2) of the first and the second, positions [m] (n, 3), matrices from body to
world axes (n, 3, 3).
"""

from icofabric_sim.kernels.runtime.borrowed import borrowed
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.terms.contacts.axis import separation_on
from icofabric_sim.terms.contacts.distance import signed_distance
from icofabric_sim.terms.contacts.pair import are_apart, Scratch, touch_pair, touch_plane
import numpy as np


@compiled
def touch_pairs(
    half_edge: np.ndarray, xa: np.ndarray, ra: np.ndarray, xb: np.ndarray, rb: np.ndarray,
    scratch: Scratch, touching: np.ndarray, out: np.ndarray
) -> None:
    """Apply `touch_pair` to n pairs, results (n,) and (n, OUT_SIZE)."""
    xa, ra, xb, rb = borrowed(xa), borrowed(ra), borrowed(xb), borrowed(rb)
    out = borrowed(out)
    for k in range(touching.shape[0]):
        touching[k] = touch_pair(
            half_edge[k, 0], half_edge[k, 1], xa[k], ra[k], xb[k], rb[k], scratch, out[k])


@compiled
def touch_planes(
    half_edge: np.ndarray, normal: np.ndarray, offset: float, xa: np.ndarray, ra: np.ndarray,
    scratch: Scratch, touching: np.ndarray, out: np.ndarray
) -> None:
    """Apply `touch_plane` to n shells, the first of (n, 2) half edges, and one plane."""
    for k in range(touching.shape[0]):
        touching[k] = touch_plane(
            half_edge[k, 0], normal, offset, xa[k], ra[k], scratch, out[k])


@compiled
def apart_pairs(
    half_edge: np.ndarray, xa: np.ndarray, ra: np.ndarray, xb: np.ndarray, rb: np.ndarray,
    scratch: Scratch, apart: np.ndarray
) -> None:
    """Apply `are_apart` to n pairs, results (n,)."""
    xa, ra, xb, rb = borrowed(xa), borrowed(ra), borrowed(xb), borrowed(rb)
    for k in range(apart.shape[0]):
        apart[k] = are_apart(
            half_edge[k, 0], half_edge[k, 1], xa[k], ra[k], xb[k], rb[k], scratch)


@compiled
def separations_on(
    half_edge: np.ndarray, xa: np.ndarray, ra: np.ndarray, xb: np.ndarray, rb: np.ndarray,
    axis: np.ndarray, gap: np.ndarray
) -> None:
    """Apply `separation_on` to n pairs along axes (n, 3), results [m] (n,)."""
    xa, ra, xb, rb = borrowed(xa), borrowed(ra), borrowed(xb), borrowed(rb)
    for k in range(gap.shape[0]):
        gap[k] = separation_on(
            half_edge[k, 0], half_edge[k, 1], xa[k], ra[k], xb[k], rb[k], axis[k, 0], axis[k, 1],
            axis[k, 2])


@compiled
def signed_distances(
    half_edge: np.ndarray, xa: np.ndarray, ra: np.ndarray, xb: np.ndarray, rb: np.ndarray,
    distance: np.ndarray, axis: np.ndarray
) -> None:
    """Apply `signed_distance` to n pairs, results (n,) and (n, 3)."""
    xa, ra, xb, rb = borrowed(xa), borrowed(ra), borrowed(xb), borrowed(rb)
    q = np.zeros((3, 3))
    for k in range(distance.shape[0]):
        distance[k] = signed_distance(
            half_edge[k, 0], half_edge[k, 1], xa[k], ra[k], xb[k], rb[k], q, axis[k])
