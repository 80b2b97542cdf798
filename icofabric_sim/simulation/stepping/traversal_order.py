# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Order in which the threads of a team traverse a fabric, to load bodies from memory once.

Drifts run ahead of kicks by one layer of the fabric. The data in between are read again soon and
should stay in the cache of a core. If a layer is too large, the fabric is traversed in panels in
sequence, each through all layers. The drifts of a panel extend slightly across its border, where
its kicks read. The order does not change results: every block is computed from values that do not
depend on the order.
"""

from collections.abc import Iterator

from icofabric_sim.kernels.records import Links, Sweep
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.kernels.runtime.team import TILE
from icofabric_sim.simulation.model.layout import Layout
import numpy as np

# Slots of a layer of a panel: the attachment points of two such layers take 0.9 MB.
_PANEL = 3200
# Rows by which a panel's drifts lie across its border: its neighbours are one row away.
_OVERLAP = 1
# Blocks whose neighbours are looked up at once: bounds the temporary arrays.
_BATCH_BLOCKS = 1 << 14
# Of a byte whose bits are lanes.
_FIRST_LANE = np.array([max(0, (byte & -byte).bit_length() - 1) for byte in range(256)])
_LAST_LANE = np.array([max(0, byte.bit_length() - 1) for byte in range(256)])


def make_sweeps(
    layout: Layout, links: Links | None, size: int, *, together: bool = False
) -> list[Sweep]:
    """
    Return the order for each of `size` threads, which own equal runs of blocks.

    `together` means that forces need the positions of all bodies, so that all drift before the
    first kick.
    """
    count = len(layout.blocks.slot)
    owners = np.repeat(
        np.arange(size), np.diff([count * member // size for member in range(size + 1)]))
    width = panel_width(layout)
    sweeps = [
        _make_sweep(layout, links, np.flatnonzero(owners == member), width)
        for member in range(size)]
    if not together:
        return sweeps
    return [
        sweep._replace(
            ahead=np.full_like(sweep.ahead, len(sweep.drifts)), border=len(sweep.drifts))
        for sweep in sweeps]


def panel_width(layout: Layout) -> int:
    """Return the number of rows of a panel."""
    panels = -(-layout.blocks.reach * LANES // _PANEL)
    return max(1, -(-(int(layout.rows.max(initial=0)) + 1) // max(1, panels)))


def _make_sweep(layout: Layout, links: Links | None, own: np.ndarray, width: int) -> Sweep:
    # A block at the end of a layer has bodies in its last rows and in the first of the next layer.
    first_row, last_row = layout.rows[:, own]
    pushes = own[np.argsort(last_row // width, kind='stable')].astype(np.uint32)
    border = np.zeros(len(own), bool)
    for part, neighbours in neighbours_of(layout, links, own):
        inside = (neighbours >= own[0]) & (neighbours <= own[-1])
        border[part] = ~inside.all(axis=1)
    # Sorts border blocks to the front; else a block drifts with the panel that needs it first.
    panel = np.where(border, -1, np.maximum(first_row - _OVERLAP, 0) // width)
    drifts = own[np.argsort(panel, kind='stable')].astype(np.uint32)
    turn = np.zeros(len(layout.blocks.slot), np.int32)
    turn[drifts] = np.arange(1, len(own) + 1, dtype=np.int32)
    needed = np.zeros(-(-len(own) // TILE) * TILE, np.int32)
    needed[:len(own)] = turn[pushes]
    for part, neighbours in neighbours_of(layout, links, pushes):
        # Other threads' blocks have no turn here: they are waited for before all pushes.
        needed[part] = np.maximum(needed[part], turn[neighbours].max(axis=1, initial=0))
    ahead = np.maximum.accumulate(needed.reshape(-1, TILE).max(axis=1, initial=0))
    return Sweep(drifts, pushes, ahead.astype(np.int32), int(np.count_nonzero(border)))


def neighbours_of(
    layout: Layout, links: Links | None, blocks: np.ndarray
) -> Iterator[tuple[slice, np.ndarray]]:
    """
    Yield the blocks (p, n) that kicks of each batch of `blocks` read, or own ones without links.
    """
    if links is None:
        return
    number = np.full(layout.slot_count // LANES, -1, np.int32)
    number[layout.blocks.slot // LANES] = np.arange(len(layout.blocks.slot), dtype=np.int32)
    for start in range(0, len(blocks), _BATCH_BLOCKS):
        part = slice(start, min(start + _BATCH_BLOCKS, len(blocks)))
        present = links.present[blocks[part]]
        place = links.place[blocks[part]] % layout.slot_count
        seen = np.concatenate(
            [number[(place + lane[present]) // LANES] for lane in (_FIRST_LANE, _LAST_LANE)], 1)
        absent = np.tile(present == 0, (1, 2))
        yield part, np.where(absent, blocks[part, None], seen)
