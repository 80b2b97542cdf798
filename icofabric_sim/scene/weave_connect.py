# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Connectors between the icosahedra at given grid points, for fabrics of any shape.

Two points on the diagonal of a unit square are connected by Table 5; the direction alone
determines the edges.
"""

from bisect import bisect_right
from collections.abc import Iterator
from functools import cached_property
from typing import Literal, NamedTuple

from icofabric_sim.scene.weave_tables import fabric_direction, TABLE_5
import numpy as np

Fastest = Literal['x', 'y']

# Bodies per batch, which bounds temporary arrays; and the most bodies whose connectors are stored.
_BATCH_BODIES, _MAX_STORED_BODIES = 1 << 16, 1 << 18


class Connectors(NamedTuple):
    """Connectors, sorted by lower body, its edge, other body."""

    bodies: np.ndarray  # (C, 2) int32; the lower number first
    edges: np.ndarray  # (C, 2) int8, edge codes at those bodies


class Keys:
    """
    Int64 keys of grid points (N, 3), and the strides (3,) of x, y and z in a key.

    Keys increase in the order of the points: by z, y, x, or for fastest 'y' by z, x, y. The key of
    a neighbour is the key plus strides, and never equals the key of another point.
    """

    def __init__(self, grid: np.ndarray, fastest: Fastest) -> None:
        """Compute the strides for at least one point."""
        self._grid, self._lowest = grid, np.asarray(grid.min(axis=0), np.int64)
        # One more empty position per axis, so that a step over the border matches no point.
        extent = [int(last - first) + 2 for first, last in zip(self._lowest, grid.max(axis=0))]
        if extent[0] * extent[1] * extent[2] > 2**62:
            raise ValueError(
                f'weave.size: grid points spread over {extent} places are too far apart')
        self.strides = np.array(
            [1, extent[0], extent[0] * extent[1]] if fastest == 'x'
            else [extent[1], 1, extent[0] * extent[1]], np.int64)

    def of(self, chosen: slice) -> np.ndarray:
        """Return the keys of some of the points."""
        return np.asarray((self._grid[chosen] - self._lowest) @ self.strides)

    def __getitem__(self, number: int) -> int:
        """Return the key of one point."""
        return int(self.of(slice(number, number + 1))[0])

    def __len__(self) -> int:
        """Count the points."""
        return len(self._grid)


class Connections:
    """
    Connectors between all icosahedra at grid points (N, 3) in strictly increasing order.

    The order is by (z, y, x), or for fastest 'y' by (z, x, y). The sums x + y + z must be all even
    or all odd; the variant only determines the orientation of the bodies. Connectors of large
    fabrics are computed in batches, and stored only when `whole` is used.
    """

    def __init__(
        self, grid: np.ndarray, variant: int, *, fastest: Fastest = 'x', count: int | None = None
    ) -> None:
        """Check the grid without connecting it; `count` is the number of connectors, if known."""
        self._grid, self._count = grid, count
        self._steps: list[tuple[int, int]] = []
        if not len(grid):
            return
        self._keys = Keys(grid, fastest)
        parity = int(np.bitwise_xor.reduce(grid[0]) & 1)
        last = -1
        for start in range(0, len(grid), _BATCH_BODIES):
            piece = slice(start, start + _BATCH_BODIES)
            if bool(np.any((np.bitwise_xor.reduce(grid[piece], axis=1) & 1) != parity)):
                raise ValueError(
                    'the grid points of a weave must have x + y + z all even or all odd')
            key = self._keys.of(piece)
            if not (int(key[0]) > last and bool(np.all(key[1:] > key[:-1]))):
                raise ValueError(
                    f'the grid points of a weave must come in order, {fastest} fastest')
            last = int(key[-1])
        # Neighbours with larger keys: the same 6 of 12 at every body, in order.
        self._steps = [(edge, step) for edge, step in sorted(
            (edge, int(np.dot(fabric_direction(variant, direction), self._keys.strides)))
            for edge, direction in TABLE_5) if step > 0]

    @property
    def count(self) -> int:
        """Number of connectors."""
        if self._count is None:
            self._count = sum(
                int(np.count_nonzero(self._partners(start) >= 0))
                for start in range(0, len(self._grid), _BATCH_BODIES))
        return self._count

    @cached_property
    def whole(self) -> Connectors:
        """All connectors."""
        bodies, filled = np.empty((self.count, 2), np.int32), 0
        edges = np.empty(bodies.shape, np.int8)
        for piece, part in self._found():
            bodies[piece], edges[piece] = part
            filled = piece.stop
        assert filled == self.count
        return Connectors(bodies, edges)

    def pieces(self) -> Iterator[tuple[slice, Connectors]]:
        """Yield batches of connectors in order, with the slice of their numbers."""
        if len(self._grid) > _MAX_STORED_BODIES and 'whole' not in self.__dict__:
            yield from self._found()
            return
        # Small fabrics store their connectors.
        every = self.whole
        for start in range(0, self.count, _BATCH_BODIES):
            piece = slice(start, min(start + _BATCH_BODIES, self.count))
            yield piece, Connectors(every.bodies[piece], every.edges[piece])

    def _found(self) -> Iterator[tuple[slice, Connectors]]:
        codes, number = np.array([edge for edge, _ in self._steps], np.int8), 0
        for start in range(0, len(self._grid), _BATCH_BODIES):
            partner = self._partners(start)
            present = partner >= 0
            if not present.any():
                continue
            each = np.count_nonzero(present, axis=1)
            bodies = np.empty((int(each.sum()), 2), np.int32)
            bodies[:, 0] = np.repeat(
                np.arange(start, start + len(partner), dtype=np.int32), each)
            bodies[:, 1] = partner[present]
            edges = np.empty(bodies.shape, np.int8)
            edges[:, 0] = np.broadcast_to(codes, partner.shape)[present]
            np.bitwise_xor(edges[:, 0], 1, out=edges[:, 1])
            yield slice(number, number + len(bodies)), Connectors(bodies, edges)
            number += len(bodies)

    def _partners(self, start: int) -> np.ndarray:
        """Return neighbours (m, 6) with larger numbers of the batch from `start` on; -1: none."""
        stop = min(start + _BATCH_BODIES, len(self._grid))
        farthest = self._keys[stop - 1] + max(step for _, step in self._steps)
        key = self._keys.of(slice(start, bisect_right(self._keys, farthest, stop)))
        partner = np.empty((stop - start, len(self._steps)), np.int32)
        for column, (_, step) in enumerate(self._steps):
            wanted = key[:stop - start] + step
            place = np.searchsorted(key, wanted)
            place[place == len(key)] = 0
            partner[:, column] = np.where(key[place] == wanted, start + place, -1)
        return partner


def connect_grid(grid: np.ndarray, variant: int, *, fastest: Fastest = 'x') -> Connectors:
    """Return the connectors between all icosahedra at grid points (N, 3), see `Connections`."""
    return Connections(np.asarray(grid), variant, fastest=fastest).whole
