# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Distribution of a fabric on the first rank: parts, windows of other ranks, and loads.

All methods use it: splitting methods (leader.py) and the embedded pair (pair_leader.py).
"""

from collections.abc import Callable, Sequence
import socket
from typing import Any
import weakref

from icofabric_sim.kernels.figures import group_size
from icofabric_sim.kernels.records import Contacts, Loads, Model, State, Watch, Work
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.scene.available_memory import available_memory
from icofabric_sim.simulation.devices.division import divide, halo_bytes, HaloBytes, received_bytes
from icofabric_sim.simulation.devices.near_pairs import watch_stub
from icofabric_sim.simulation.devices.saved_part import saved_tables, SavedPart
from icofabric_sim.simulation.devices.shared_contacts import SharedContacts
from icofabric_sim.simulation.devices.slot_rows import SlotRows
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.unpacked import Unpacked
from icofabric_sim.simulation.devices.window import loads_of, Slots, slots_of, window_of
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.stepping.executor import Executor
import numpy as np

_numbers = iter(range(2**62))


class Sharing(Executor):
    """Executor that divides a fabric among ranks, and the data that these have received."""

    is_remote = True

    def __init__(
        self, transport: Transport, packed: PackedScene, bytes_of: Callable[[int], int]
    ) -> None:
        """
        Divide a fabric; a window of n slots needs `bytes_of(n)`.

        Raises ValueError if ranks are too many or lack memory.
        """
        self.transport, self.packed, self._bytes_of = transport, packed, bytes_of
        self.rank_count, layout = transport.size, packed.layout
        # By which the ranks know it.
        self.number = next(_numbers)
        self.shared = SharedContacts(layout, transport.size)
        # Blocks of others that bodies of each rank may touch, or might before.
        self._near = [np.zeros(0, np.int64) for _ in range(transport.size)]
        self._divide()
        slot = layout.blocks.slot
        self.rows = [SlotRows(slot[part.first:part.last]) for part in self.parts]
        # Of the windows of the other ranks, once they are cut.
        self._slots: list[Slots] = []
        # Whether ranks know the pairs that were shared last.
        self.is_told = True
        self._acting: tuple[Any, ...] = ()
        self._written: list[np.ndarray] = []
        self.acts = False  # whether anything acts on any body
        self._has_loads = False  # whether ranks have loads, if only empty ones
        self._saved = SavedPart(self.rows[0])
        # Where what ranks have saved belongs here; what had flowed, once it has been brought.
        self._saved_for: tuple[State, Loads, np.ndarray | None, bool, bool] | None = None
        self._flows: dict[str, np.ndarray] = {}
        # The state in which the run began, until one that was saved has come here.
        self.begun: Unpacked | None = None
        self._require_room()
        transport.holders.add(self)
        # At the end of the interpreter there is no further order that it could go with.
        weakref.finalize(self, transport.dropped.append, self.number).atexit = False

    def _divide(self) -> None:
        self.parts = divide(
            self.packed.layout, self.packed.model.links, self.rank_count, self._near)
        self.halo_bytes = max(map(received_bytes, self.parts))

    @property
    def has_saved(self) -> bool:
        """True if each rank has its part of the state that was saved last."""
        return self._saved_for is not None

    def gather_saved(self) -> dict[str, np.ndarray]:
        """Gather the saved state; return the energies that had flowed by then [J], by name."""
        try:
            with self.transport.alone():
                self._bring_saved()
        finally:
            self.forget_saved()
        return self._flows

    def save_parts(
        self, state: State, work: Work, loads: Loads, saved: State, *, keeps_work: bool
    ) -> None:
        """
        Save the state of its bodies on each rank; `saved` is the array for it here.

        `keeps_work`: the work of the loads belongs into their `earlier_work`.
        """
        self.order('save')
        own = self.rows_of_loads(loads, 0)
        self._saved.save(state, work, loads.work[own] if self._has_loads else None)
        spent = None if work.spent is None else np.empty_like(work.spent.done)
        self._saved_for, self._flows = (saved, loads, spent, self._has_loads, keeps_work), {}

    def forget_saved(self) -> None:
        """Discard the saved state of the ranks: it was saved here, or is lost."""
        self._saved_for = None

    def _bring_saved(self) -> None:
        """Gather the state that the ranks have saved, unless it is here."""
        if self._saved_for is None or self._flows:
            return
        saved, loads, spent, acted, keeps_work = self._saved_for
        tables, done = saved_tables(saved, spent), np.zeros_like(loads.work)
        self.order('give_saved')
        self._saved.put(tables)
        if acted:
            done[self.rows_of_loads(loads, 0)] = self._saved.rows[-1]
        for rank in self.others:
            self.rows[rank].receive(self.transport, tables, rank)
            if acted:
                self.receive(done[self.rows_of_loads(loads, rank)], rank)
        if keeps_work:
            loads.earlier_work[:] = done
        self._flows = {'work': done} if spent is None else {'work': done, 'spent': spent}
        self.begun = None

    def gather_figures(self, own: np.ndarray, figures: np.ndarray) -> float:
        """
        Receive the `figures` of all groups, and return the largest roughness.

        `own` are those of this rank: as the others send theirs, with the roughest at the end.
        """
        size = group_size(len(self.packed.layout.blocks.slot))
        at, roughest = len(own) - 1, float(own[-1, 0])
        figures[:at] = own[:-1]
        for rank in self.others:
            part = self.parts[rank]
            there = np.empty((-(-(part.last - part.first) // size) + 1, own.shape[1]))
            self.receive(there, rank)
            figures[at:at + len(there) - 1] = there[:-1]
            at, roughest = at + len(there) - 1, max(roughest, float(there[-1, 0]))
        return roughest

    def largest_of(self, own: np.ndarray) -> np.ndarray:
        """Return the largest values of all ranks; NaN if one is NaN."""
        found = [own]
        for rank in self.others:
            found.append(np.empty_like(own))
            self.receive(found[-1], rank)
        largest: np.ndarray = np.max(found, axis=0)
        return largest

    def gather_sums(self, own: np.ndarray, sums: np.ndarray) -> None:
        """Receive the `sums` (..., g) of all groups; `own` are those of this rank."""
        size = group_size(len(self.packed.layout.blocks.slot))
        at = own.shape[-1]
        sums[..., :at] = own
        for rank in self.others:
            part = self.parts[rank]
            there = np.empty((*own.shape[:-1], -(-(part.last - part.first) // size)))
            self.receive(there, rank)
            sums[..., at:at + there.shape[-1]] = there
            at += there.shape[-1]

    def bring_all(self) -> None:
        """Gather the present and the saved state, before the ranks end."""
        self.gather()
        with self.transport.alone():
            self._bring_saved()

    @property
    def group_count(self) -> int:
        """Number of groups of blocks over which sums are formed."""
        blocks = len(self.packed.layout.blocks.slot)
        return -(-blocks // group_size(blocks))

    @property
    def slots_of_first(self) -> np.ndarray:
        """Runs of LANES slots that steps of the first rank read, by their numbers."""
        return self._slots[0].kept

    @property
    def others(self) -> range:
        """Numbers of the other ranks."""
        return range(1, self.transport.size)

    @property
    def halos(self) -> list[HaloBytes]:
        """Bytes that each rank receives per force evaluation."""
        return [
            halo_bytes(self.packed.layout, self.packed.model.links, part) for part in self.parts]

    def order(self, name: str, *rest: Any) -> None:
        """Send all other ranks an order for this fabric."""
        self.transport.order((name, self.number, *rest))

    def share(self, contacts: Contacts | None) -> bool:
        """Assign pairs to ranks; return True if windows change."""
        needed = self.shared.split(contacts)
        self.is_told = False
        if not any(
                len(np.setdiff1d(blocks, part.halo))
                for blocks, part in zip(needed, self.parts)):
            return False
        # What was near once may be so again.
        self._near = [np.union1d(*pair) for pair in zip(self._near, needed)]
        self._divide()
        return True

    def send_windows(
        self, model: Model, watch: Watch | None, what: Any, *, spends: bool,
        samples: Sequence[np.ndarray] | None = None
    ) -> None:
        """
        Send each rank its window, and `what` it needs for steps.

        `samples` are blocks of each part that sample the roughness; `spends` means dissipative
        forces.
        """
        # With their windows ranks lose what they have saved.
        self._bring_saved()
        layout, self._acting = self.packed.layout, ()
        self._slots = [slots_of(model, layout, part) for part in self.parts]
        for rank in self.others:
            chosen = np.zeros(0, np.int64) if samples is None else samples[rank]
            window = window_of(model, layout, self.parts[rank], self._slots[rank], chosen)
            window = window._replace(
                watch=None if watch is None else watch_stub(watch), spends=spends)
            self.transport.send_order(('window', self.number, window, what), rank)
        self.is_told = False

    def tell_contacts(self, contacts: Contacts | None) -> None:
        """Send each rank its pairs."""
        for rank in self.others:
            near = None if contacts is None else self.shared.near(
                contacts, rank, self._slots[rank])
            self.transport.send_order(('contacts', self.number, near), rank)
        self.is_told = True

    def send_loads(self, loads: Loads, *, stages: int) -> bool:
        """
        Send each rank the loads on its bodies if they have changed; return True if sent.

        `stages` is the number of stages of a Runge-Kutta step whose powers are stored.
        """
        anchors = loads.anchors
        acting = loads.start, loads.wrench, loads.force, anchors, loads.drives, loads.tractions
        # Forces of pulls, and slopes of anchors that break, are written in place.
        written = [loads.force] if anchors is None else [
            loads.force, anchors.extension, anchors.compression]
        if len(acting) == len(self._acting) and all(
                one is other for one, other in zip(acting, self._acting)) and all(
                np.array_equal(one, other) for one, other in zip(written, self._written)):
            return False
        self._acting, self._written = acting, [values.copy() for values in written]
        self.acts = len(loads.wrench) > 0
        self._has_loads = self.acts or stages > 0
        for rank in self.others:
            own = None
            if self._has_loads:
                own = loads_of(loads, self.parts[rank], self._slots[rank], stages=stages)
            self.transport.send_order(('loads', self.number, own), rank)
        return True

    def rows_of_loads(self, loads: Loads, rank: int) -> slice:
        """Return the rows of the work on the bodies of a rank."""
        part = self.parts[rank]
        return slice(
            LANES * int(loads.start[part.first]), LANES * int(loads.start[part.last]))

    def receive(self, values: np.ndarray, rank: int) -> None:
        """Receive an array in place."""
        self.transport.wait([self.transport.receive(values, rank)])

    def _require_room(self) -> None:
        """Raise ValueError if a machine lacks memory for windows, before any is allocated."""
        transport = self.transport
        with transport.alone():
            transport.order(('room',))
            machines = [(socket.gethostname(), available_memory()), *transport.answers()]
        wanted: dict[str, int] = {}
        ranks: dict[str, list[int]] = {}
        for rank, (name, _) in enumerate(machines):
            if rank:
                part = self.parts[rank]
                slots = LANES * (part.last - part.first + 2 * len(part.halo))
                wanted[name] = wanted.get(name, 0) + self._bytes_of(slots)
                ranks.setdefault(name, []).append(rank)
        for name, need in wanted.items():
            left = min(amount for machine, amount in machines if machine == name)
            if need > left:
                members = ', '.join(map(str, ranks[name]))
                raise ValueError(
                    f'rank {members} on {name}: windows of {self.packed.layout.body_count:,} '
                    f'bodies need about {need / 1e9:.3g} GB there, and {left / 1e9:.3g} GB are '
                    'left; take more machines, or a smaller weave.size')
