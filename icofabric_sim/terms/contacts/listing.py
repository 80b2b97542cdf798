# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Lists of candidate pairs before bodies have moved by some distance, and their arrays.

For methods that step through contacts, whose steps do not depend on the list. The list may hold
more pairs than can touch. So few axes are tried for each pair, the line of centres and the faces
of both (gap.py), and the answer depends on the positions of bodies, not on the stored axes.
"""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.terms.contacts.gap import edge_of, gap_along, ratio_of
from icofabric_sim.terms.contacts.record import Nearby
from icofabric_sim.terms.contacts.search import axes_row, plane_gaps
import numpy as np

# The line of centres and ten normals of faces of either body.
_FEW_AXES = 21


@compiled
def list_pairs(
    nearby: Nearby, position: np.ndarray, least: float, listed: np.ndarray
) -> tuple[int, int]:
    """
    Write pairs (p, 2) of bodies that may touch before any has moved by `least` [m].

    Pairs with planes come last. In the order of neighbour_list.py, plane k as -1 - k. Return the
    number of pairs, and of those with planes; pairs beyond the size of `listed` are not written.
    Axes of bodies must be in place (`survey`).
    """
    which, slots = nearby.counts[1], nearby.slots
    pairs, codes, wanted = nearby.pairs[which], nearby.codes[which], 2.0 * least
    farthest = (wanted + 2.0 * nearby.radius) ** 2
    count = 0
    for p in range(nearby.counts[0]):
        b, c = pairs[p, 0], pairs[p, 1]
        s, t = slots[b], slots[c]
        dx, dy = position[0, t] - position[0, s], position[1, t] - position[1, s]
        dz = position[2, t] - position[2, s]
        if not dx * dx + dy * dy + dz * dz < farthest:
            continue
        first, second = axes_row(nearby.axes, b), axes_row(nearby.axes, c)
        kept, apart = codes[p], False
        half_edge = edge_of(nearby.half_edge, nearby.half_edges, b)
        ratio = ratio_of(nearby.half_edges, b, c)
        if kept < _FEW_AXES:
            apart = gap_along(kept, half_edge, ratio, dx, dy, dz, first, second) >= wanted
        code = 0
        while not apart and code < _FEW_AXES:
            apart = gap_along(code, half_edge, ratio, dx, dy, dz, first, second) >= wanted
            if apart:
                codes[p] = code
            code += 1
        if not apart:
            if count < listed.shape[0]:
                listed[count, 0], listed[count, 1] = b, c
            count += 1
    with_planes = 0
    if plane_gaps(nearby, position) < least:
        for b in range(slots.shape[0]):
            for k in range(nearby.planes.shape[0]):
                if nearby.to_planes[k, b] < least:
                    if count < listed.shape[0]:
                        listed[count, 0], listed[count, 1] = b, -1 - k
                    count += 1
                    with_planes += 1
    return count, with_planes


@compiled
def arrange(
    pairs: np.ndarray, slot_of: np.ndarray, blocks: np.ndarray, room: np.ndarray,
    slots: np.ndarray, start: np.ndarray, slot: np.ndarray, entry: np.ndarray
) -> None:
    """
    Write the slots (p, 2) of pairs (p, 2) of bodies, and the entries of blocks: see `Contacts`.

    `blocks`: first slots of the blocks (b,); `room` holds one number of each slot. Entries of a
    block are sorted by slots, and those of a slot in the order of the pairs.
    """
    for s in range(room.shape[0]):
        room[s] = 0
    for p in range(pairs.shape[0]):
        slots[p, 0] = slot_of[pairs[p, 0]]
        room[slots[p, 0]] += 1
        slots[p, 1] = pairs[p, 1]
        if pairs[p, 1] >= 0:
            slots[p, 1] = slot_of[pairs[p, 1]]
            room[slots[p, 1]] += 1
    at = 0
    for block in range(blocks.shape[0]):
        start[block] = at
        for s in range(blocks[block], blocks[block] + LANES):
            count = room[s]
            room[s] = at
            at += count
    start[blocks.shape[0]] = at
    for p in range(pairs.shape[0]):
        for side in range(2):
            s = slots[p, side]
            if s >= 0:
                e = room[s]
                room[s] = e + 1
                slot[e], entry[e] = s, 2 * p + side


@compiled
def comes_before(a: int, b: int, c: int, d: int) -> bool:
    """Check that the pair (a, b) comes before (c, d) in a list: planes last, by their numbers."""
    if (b < 0) != (d < 0):
        return d < 0
    if a != c:
        return a < c
    return b > d if b < 0 else b < d


@compiled
def find_both(
    pairs: np.ndarray, others: np.ndarray, here: np.ndarray, there: np.ndarray
) -> int:
    """Write the indices in two lists of their common pairs; return how many there are."""
    count, q = 0, 0
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        while q < others.shape[0] and comes_before(others[q, 0], others[q, 1], a, b):
            q += 1
        if q < others.shape[0] and others[q, 0] == a and others[q, 1] == b:
            here[count], there[count] = p, q
            count += 1
    return count


@compiled
def carry_over(
    here: np.ndarray, there: np.ndarray, before: np.ndarray, after: np.ndarray
) -> None:
    """
    Copy rows `there` of all tables `before` (k, q, n) to the rows `here` of `after` (k, p, n).

    Zeros, which most rows hold, are not written, because writing takes memory.
    """
    for number in range(before.shape[0]):
        for k in range(here.shape[0]):
            p, q = here[k], there[k]
            for i in range(before.shape[2]):
                if before[number, q, i] != 0.0:
                    after[number, p, i] = before[number, q, i]
