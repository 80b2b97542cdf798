# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Division of a fabric among ranks: ownership of blocks, and exchange of poses.

Each rank owns a run of blocks in the order of a single process, usually layers of the fabric. In
each force evaluation it needs the poses of outside blocks that its connectors lead to or its
bodies may touch.
"""

from collections.abc import Sequence
from typing import NamedTuple

from icofabric_sim.kernels.figures import group_size
from icofabric_sim.kernels.records import Links
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.kernels.runtime.team import TILE
from icofabric_sim.simulation.devices.rank_kernels import POSE
from icofabric_sim.simulation.model.layout import Layout
from icofabric_sim.simulation.stepping.traversal_order import neighbours_of, panel_width
import numpy as np


class Part(NamedTuple):
    """Blocks of a rank, by their numbers in the whole fabric."""

    first: int
    last: int  # the one after its last
    drifts: np.ndarray  # (m,) its blocks as they drift, those that others need first
    border: int  # how many these are, with those that need others
    inner: np.ndarray  # (m - border,) the others, as they are pushed
    ahead: np.ndarray  # (t,) int32, how many have to drift before each tile of them is pushed
    # What comes from each rank: (its number, blocks), rising; and what goes to each.
    needs: tuple[tuple[int, np.ndarray], ...]
    gives: tuple[tuple[int, np.ndarray], ...]

    @property
    def halo(self) -> np.ndarray:
        """Blocks of others that the rank needs, rising."""
        blocks = [blocks for _, blocks in self.needs]
        return np.concatenate([np.zeros(0, np.int64), *blocks])


class HaloBytes(NamedTuple):
    """Bytes that a rank receives in each evaluation of the forces."""

    received: int
    # The same for the bodies alone that its connectors lead to: blocks have other lanes, too.
    least: int


def bounds_of(block_count: int, rank_count: int) -> np.ndarray:
    """
    Return the first block of each rank, followed by the number of blocks, (r + 1,).

    A rank has whole groups of blocks, over which sums are formed (kernels/figures.py).
    """
    size = group_size(block_count)
    count = -(-block_count // size)
    return np.array([
        min(size * (count * rank // rank_count), block_count) for rank in range(rank_count + 1)])


def divide(
    layout: Layout, links: Links | None, rank_count: int,
    near: Sequence[np.ndarray] | None = None
) -> list[Part]:
    """
    Return the part of each rank; `near` are the blocks that its bodies may touch.

    Raises ValueError if there are fewer groups of blocks than ranks.
    """
    block_count = len(layout.blocks.slot)
    size = group_size(block_count)
    most = -(-block_count // size)
    if rank_count > most:
        raise ValueError(
            f'{rank_count} ranks are too many for {layout.body_count} bodies in {most} blocks of '
            f'{size * LANES}: at most one rank a block; start mpiexec with -n {most} or less')
    bounds = bounds_of(block_count, rank_count)
    halos = [
        _halo(layout, links, bounds[rank], bounds[rank + 1]) for rank in range(rank_count)]
    if near is not None:
        halos = [np.union1d(halo, others) for halo, others in zip(halos, near)]
    parts = []
    for rank in range(rank_count):
        first, last = int(bounds[rank]), int(bounds[rank + 1])
        needs = tuple(
            (other, blocks) for other in range(rank_count)
            if len(blocks := _within(halos[rank], bounds[other], bounds[other + 1])))
        gives = tuple(
            (other, blocks) for other in range(rank_count) if other != rank
            and len(blocks := _within(halos[other], first, last)))
        given = np.concatenate([np.zeros(0, np.int64), *(blocks for _, blocks in gives)])
        drifts, border, inner, ahead = _order(layout, links, first, last, given)
        parts.append(Part(first, last, drifts, border, inner, ahead, needs, gives))
    return parts


def halo_bytes(layout: Layout, links: Links | None, part: Part) -> HaloBytes:
    """Return the bytes that a rank receives per evaluation, and the minimum."""
    needed = np.zeros(layout.slot_count, bool)
    if links is not None:
        own = slice(part.first, part.last)
        for lane in range(LANES):
            there = links.present[own] >> lane & 1 > 0
            needed[links.place[own][there] % layout.slot_count + lane] = True
    own_slots = layout.blocks.slot[part.first:part.last, None] + np.arange(LANES)
    needed[own_slots.ravel()] = False
    return HaloBytes(
        received_bytes(part), POSE * np.dtype(float).itemsize * int(np.count_nonzero(needed)))


def received_bytes(part: Part) -> int:
    """Return the bytes that a rank receives per evaluation."""
    return POSE * np.dtype(float).itemsize * LANES * len(part.halo)


def _within(blocks: np.ndarray, first: int, last: int) -> np.ndarray:
    return blocks[np.searchsorted(blocks, first):np.searchsorted(blocks, last)]


def _halo(layout: Layout, links: Links | None, first: int, last: int) -> np.ndarray:
    """Return outside blocks that connectors of blocks first to last lead to, rising."""
    found = [np.zeros(0, np.int64)]
    for _, blocks in neighbours_of(layout, links, np.arange(first, last)):
        seen = np.unique(blocks)
        found.append(seen[(seen < first) | (seen >= last)])
    return np.unique(np.concatenate(found))


def _order(
    layout: Layout, links: Links | None, first: int, last: int, given: np.ndarray
) -> tuple[np.ndarray, int, np.ndarray, np.ndarray]:
    """
    Return drifts, the number needed by others, inner kicks, and the drifts before their tiles.

    `given` are blocks that others need.
    """
    own, width = np.arange(first, last), panel_width(layout)
    border = np.zeros(len(own), bool)
    border[given - first] = True
    for piece, blocks in neighbours_of(layout, links, own):
        border[piece] |= ((blocks < first) | (blocks >= last)).any(axis=1)
    first_row, last_row = layout.rows[:, first:last]
    panel = np.where(border, -1, np.maximum(first_row - 1, 0) // width)
    drifts = own[np.argsort(panel, kind='stable')]
    turn = np.zeros(len(layout.blocks.slot), np.int64)
    turn[drifts] = np.arange(1, len(own) + 1)
    pushes = own[np.argsort(last_row // width, kind='stable')]
    inner = pushes[~border[pushes - first]]
    needed = np.zeros(-(-len(inner) // TILE) * TILE, np.int64)
    needed[:len(inner)] = turn[inner]
    for piece, blocks in neighbours_of(layout, links, inner):
        needed[piece] = np.maximum(needed[piece], turn[blocks].max(axis=1, initial=0))
    ahead = np.maximum.accumulate(needed.reshape(-1, TILE).max(axis=1, initial=0))
    return drifts, int(np.count_nonzero(border)), inner, ahead.astype(np.int32)
