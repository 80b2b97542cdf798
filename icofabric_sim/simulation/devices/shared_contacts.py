# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Contacts of a shared run on the first rank: assignment of pairs to ranks, and their history.

The search is that of one process, in a gathered state. Each rank gets the pairs with at least one
of its bodies (near_pairs.py). The history of pairs is sent and gathered with the state.
"""

from collections.abc import Sequence

from icofabric_sim.kernels.records import Blocks
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.division import bounds_of, Part
from icofabric_sim.simulation.devices.near_pairs import constants_of, contacts_of, NearPairs
from icofabric_sim.simulation.devices.window import Slots
from icofabric_sim.simulation.model.layout import Layout
from icofabric_sim.terms.contacts.record import ContactLosses, Contacts, Watch
from icofabric_sim.terms.contacts.sleeping import AWAKE
import numpy as np

# Numbers of a look: the largest square of a way since the last [m^2], the deepest overlap in the
# last evaluation and in all since the last look [m].
REPORT_SIZE = 3


def look_at(contacts: Contacts | None, watch: Watch | None) -> np.ndarray:
    """Return displacements and overlaps since the last call, and reset them."""
    look = np.zeros(REPORT_SIZE)
    if watch is not None:
        look[0], watch.far[0] = watch.far[0], 0.0
    if contacts is not None:
        look[1:] = contacts.deepest[:2]
        contacts.deepest[1] = 0.0
    return look


def note_look(contacts: Contacts | None, watch: Watch | None, look: np.ndarray) -> None:
    """Merge displacements and overlaps of a rank into those of the whole fabric."""
    if watch is not None:
        watch.far[0] = max(watch.far[0], look[0])
    if contacts is not None:
        contacts.deepest[:2] = np.maximum(contacts.deepest[:2], look[1:])


class SharedContacts:
    """The shared list of pairs, and the part of the first rank."""

    def __init__(self, layout: Layout, rank_count: int) -> None:
        """Start without pairs."""
        self._layout, self._count = layout, rank_count
        slots = layout.blocks.slot
        self._turns = np.full(max(layout.slot_count // LANES, 1), -1, np.int64)
        self._turns[slots // LANES] = np.arange(len(slots))
        self._bounds = bounds_of(len(slots), rank_count)
        self._pairs: np.ndarray | None = None
        # Numbers of each rank's pairs among all.
        self.which: list[np.ndarray] = []
        # Of the first rank: of the run, and of what is tried beside it.
        self._own: dict[bool, Contacts] = {}

    def is_shared(self, contacts: Contacts | None) -> bool:
        """Return True if ranks have the pairs of these contacts."""
        return self._pairs is (None if contacts is None else contacts.pairs)

    def split(self, contacts: Contacts | None) -> list[np.ndarray]:
        """Assign pairs to ranks; return the blocks of others that each rank needs for them."""
        self._own = {}
        if contacts is None:
            self._pairs, self.which = None, []
            return [np.zeros(0, np.int64) for _ in range(self._count)]
        self._pairs = contacts.pairs
        block = self._blocks_of(contacts.pairs)
        owner = np.searchsorted(self._bounds, block, side='right') - 1
        owner[block < 0] = -1
        self.which, needed = [], []
        for rank in range(self._count):
            mine = owner == rank
            which = np.flatnonzero(mine.any(axis=1))
            others = block[which][~mine[which] & (block[which] >= 0)]
            self.which.append(which)
            needed.append(np.unique(others))
        return needed

    def near(self, contacts: Contacts, rank: int, slots: Slots) -> NearPairs:
        """Return the pairs of a rank, in the slots of its window."""
        pairs = contacts.pairs[self.which[rank]].astype(np.int64)
        moved = np.zeros(slots.whole // LANES, np.int64)
        moved[slots.kept] = np.arange(len(slots.kept))
        there = np.where(pairs < 0, pairs, LANES * moved[pairs // LANES] + pairs % LANES)
        return NearPairs(there.astype(np.int32), constants_of(contacts))

    def own(self, contacts: Contacts, part: Part, *, of_run: bool) -> Contacts:
        """Return the contacts of the first rank, in the arrays of the whole fabric."""
        if of_run not in self._own:
            near = NearPairs(
                np.ascontiguousarray(contacts.pairs[self.which[0]]), constants_of(contacts))
            blocks = self._layout.blocks
            known = np.concatenate([np.arange(part.first, part.last), part.halo])
            self._own[of_run] = contacts_of(
                near, blocks.slot, Blocks(blocks.slot[known], blocks.alive[known], 0),
                self._layout.slot_count, contacts.touch_address)
        return self._own[of_run]

    def _blocks_of(self, slots: np.ndarray) -> np.ndarray:
        """Return the blocks of slots; -1 for planes."""
        return np.where(slots < 0, -1, self._turns[np.maximum(slots, 0) // LANES])


def wake(contacts: Contacts, which: np.ndarray | slice, values: Sequence[np.ndarray]) -> None:
    """
    Wake pairs with friction springs, as they touched on another rank.

    What sleeps is known to have lost all that it had, and would keep it here.
    """
    if values:
        stretched = np.any([rows.any(axis=1) for rows in values], axis=0)
        until = contacts.sleep.until[which]
        until[stretched] = AWAKE
        contacts.sleep.until[which] = until


def friction_of(contacts: Contacts | None) -> ContactLosses | None:
    """Return the losses of contacts with friction springs, which have a history."""
    losses = None if contacts is None else contacts.losses
    return losses if losses is not None and losses.friction > 0.0 else None
