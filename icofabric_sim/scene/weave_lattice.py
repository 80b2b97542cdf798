# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Grid points of a fabric: a slab along the fabric's axes, or a box cut out of a turned fabric.

Grids are int32 points (N, 3) in the order that `connect_grid` requires.
"""

from collections.abc import Callable, Sequence
import math

from icofabric_sim.scene.weave_geometry import ROUNDING_RATIO
from icofabric_sim.scene.weave_index import (
    centre_rule,
    checked_size,
    gap_parity,
    indices_from_alpha,
    slab_count,
)
import numpy as np

# Round-off margin of intervals, in grid positions; `_inside` makes the exact decision.
_MARGIN_PITCHES = 1e-3
_BATCH_POINTS = 1 << 18  # bounds temporary arrays


def slab_grid(variant: int, size: tuple[int, int, int]) -> np.ndarray:
    """Return the grid points of an orthogonal slab in the order of alpha."""
    size = checked_size(size)
    grid = np.empty((slab_count(variant, size), 3), np.int32)
    for start in range(0, len(grid), _BATCH_POINTS):
        alpha = np.arange(start, min(start + _BATCH_POINTS, len(grid)), dtype=np.int64)
        indices = indices_from_alpha(variant, size, alpha)
        grid[alpha[0]:alpha[-1] + 1] = centre_rule(
            variant, indices[:, 0], indices[:, 1], indices[:, 2])
    return grid


def part_bounds(
        size: Sequence[int], reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the first and last positions of a slab within `reach` (3,) of its centre, int64 (3,).

    The range is empty if the last is before the first.
    """
    last = np.array(size, np.float64) - 1.0
    reach = reach * (1.0 + ROUNDING_RATIO) + _MARGIN_PITCHES
    low = np.ceil(np.maximum(0.5 * last - reach, 0.0))
    high = np.floor(np.minimum(0.5 * last + reach, last))
    return low.astype(np.int64), np.maximum(high, low - 1.0).astype(np.int64)


def part_grid(
        variant: int, low: np.ndarray, high: np.ndarray,
        chosen: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """
    Return the grid points with an icosahedron from `low` to `high` (3,) that `chosen` accepts.

    Sorted by z, y, x. Needs little more memory than the result.
    """
    if np.any(high < low):
        return np.empty((0, 3), np.int32)
    rows, lines = int(high[1] - low[1]) + 1, int(high[2] - low[2]) + 1
    length = int(high[0] - low[0]) + 1
    piece = max(1, _BATCH_POINTS // length)
    kept = [np.empty((0, 3), np.int32)]
    for start in range(0, rows * lines, piece):
        line = np.arange(start, min(start + piece, rows * lines), dtype=np.int64)
        y, z = low[1] + line % rows, low[2] + line // rows
        first = low[0] + (low[0] + y + z + gap_parity(variant)) % 2
        x, y, z = _expanded(first, np.full(len(line), high[0]), 2, y, z)
        points = np.stack((x, y, z), axis=1).astype(np.int32)
        kept.append(points[chosen(points)])
    return np.concatenate(kept)


def turned_box_grid(variant: int, rotation: np.ndarray, half_extent: np.ndarray) -> np.ndarray:
    """
    Return the grid points with an icosahedron inside an upright box after turning the fabric.

    `rotation` (3, 3) rotates fabric axes to the world. The box is |rotation @ point| <=
    `half_extent` (3,) in grid positions about the grid point (0, 0, 0); points on its boundary, up
    to round-off, count as inside. Sorted by z, y, x.

    Only lines that can intersect the box are listed: the projection of the box on the fabric's z
    axis is an interval, on the y-z plane a hexagon. So time and memory grow with the result, not
    with the bounding cube of a slender turned box.
    """
    # |normals @ (x, y, z)| <= half_extent: the box itself.
    normals = np.asarray(rotation, np.float64)
    # The projection on the y-z plane is the sum of three segments, bounded by three pairs of lines
    # along these segments; the projection on the z axis is the sum of their lengths.
    segments = half_extent[:, None] * normals[:, 1:]
    shadow_normals = np.stack((-segments[:, 1], segments[:, 0]), axis=1)
    shadow_extent = np.abs(shadow_normals @ segments.T).sum(axis=1)
    top = int(math.floor(np.abs(segments[:, 1]).sum() + _MARGIN_PITCHES))

    z = np.arange(-top, top + 1, dtype=np.int64)
    first, last = _interval(shadow_normals, shadow_extent, z[:, None])
    y, z = _expanded(np.ceil(first), np.floor(last), 1, z)
    first, last = _interval(normals, half_extent, np.stack((y, z), axis=1))
    # The first point of the right parity, then every second point.
    first = np.ceil(first)
    first += (first + y + z + gap_parity(variant)) % 2
    x, y, z = _expanded(first, np.floor(last), 2, y, z)
    grid = np.stack((x, y, z), axis=1)
    return grid[_inside(normals, half_extent, grid)].astype(np.int32)


def turned_points(rotation: np.ndarray, points: np.ndarray) -> np.ndarray:
    """
    Apply a rotation matrix (3, 3) to points (N, 3).

    Written out, because the round-off of a matrix product depends on the machine.
    """
    x, y, z = (points[:, axis].astype(np.float64) for axis in range(3))
    turned = np.empty((len(points), 3))
    for axis in range(3):
        turned[:, axis] = rotation[axis, 0] * x
        turned[:, axis] += rotation[axis, 1] * y
        turned[:, axis] += rotation[axis, 2] * z
    return turned


def _interval(
        normals: np.ndarray, extent: np.ndarray, others: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
    # Range of the first coordinate with |normals @ (first, *others)| <= extent, for each row of
    # `others`. A constraint (nearly) parallel to the line imposes no bound.
    low = np.full(len(others), -np.inf)
    high = np.full(len(others), np.inf)
    for normal, limit in zip(normals, extent):
        if not abs(normal[0]) > 1e-9 * float(np.abs(normal).max()):
            continue
        middle = -(others @ normal[1:]) / normal[0]
        reach = abs(limit / normal[0]) + _MARGIN_PITCHES
        np.maximum(low, middle - reach, out=low)
        np.minimum(high, middle + reach, out=high)
    return low, high


def _expanded(
        first: np.ndarray, last: np.ndarray, stride: int, *lines: np.ndarray
        ) -> tuple[np.ndarray, ...]:
    # Each line's coordinates repeated over first, first + stride, ..., last.
    count = np.maximum((last - first) // stride + 1, 0).astype(np.int64)
    start = np.repeat(first.astype(np.int64) - stride * (np.cumsum(count) - count), count)
    start += stride * np.arange(len(start), dtype=np.int64)
    return (start, *(np.repeat(line, count) for line in lines))


def _inside(normals: np.ndarray, half_extent: np.ndarray, grid: np.ndarray) -> np.ndarray:
    turned = np.abs(turned_points(normals, grid))
    return np.all(turned <= half_extent * (1.0 + ROUNDING_RATIO), axis=1)
