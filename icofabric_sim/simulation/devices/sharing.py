# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Distribution of a fabric on the first rank: parts, windows of other ranks, and loads.

All methods use it: splitting methods (leader.py) and the embedded pair (pair_leader.py).
"""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import socket
from typing import Any
import weakref

from icofabric_sim.kernels.figures import group_size
from icofabric_sim.kernels.monitor import coarse_up_to, judge, looks_inside
from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.scene.available_memory import available_memory
from icofabric_sim.simulation.devices.division import divide, halo_bytes, HaloBytes, received_bytes
from icofabric_sim.simulation.devices.executor import Remote
from icofabric_sim.simulation.devices.near_pairs import no_contacts, watch_stub
from icofabric_sim.simulation.devices.saved_part import saved_tables, SavedPart
from icofabric_sim.simulation.devices.shared_contacts import (
    look_at,
    note_look,
    REPORT_SIZE,
    SharedContacts,
    wake,
)
from icofabric_sim.simulation.devices.slot_rows import SlotRows
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.unpacked import Unpacked
from icofabric_sim.simulation.devices.window import loads_of, Slots, slots_of, window_of
from icofabric_sim.simulation.errors import RankError
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.stepping.ledger import Ledger
from icofabric_sim.terms.contacts.record import Contacts, Watch
import numpy as np

_numbers = iter(range(2**62))


class Sharing(Remote):
    """Executor that divides a fabric among ranks, and the data that these have received."""

    _stores_powers = False  # at the stages of a Runge-Kutta step
    _arrays_of: Callable[..., Any]  # returns the arrays that steps of this rank change

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
        # Steps of this rank, and whether those with contacts were ready.
        self._own: Any = None
        self._touches = False
        # Arrays of the present call; candidate pairs of the run.
        self._now: Any = None
        self._contacts: Contacts | None = None
        # Blocks of others that bodies of each rank may touch, or might before.
        self._near = [np.zeros(0, np.int64) for _ in range(transport.size)]
        self._divide()
        slot = layout.blocks.slot
        self.rows = [SlotRows(slot[part.first:part.last]) for part in self.parts]
        # Of the windows of the other ranks, once they are cut.
        self._slots: list[Slots] = []
        # Whether ranks know the pairs that were shared last.
        self._is_told = True
        self._acting: tuple[Any, ...] = ()
        self._written: list[np.ndarray] = []
        self._has_loads = False  # whether ranks have loads, if only empty ones
        self._saved = SavedPart(self.rows[0])
        # Where what ranks have saved belongs here; what had flowed, once it has been brought.
        self._saved_for: tuple[State, Loads, np.ndarray | None, bool] | None = None
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

    @contextmanager
    def together(self) -> Iterator[None]:
        """Let all ranks fail if this one fails in the block."""
        self.transport.require_health()
        if self.transport.has_ended:
            raise RankError("the ranks have ended with their 'with' block")
        with self.transport.alone():
            try:
                yield
            except BaseException as error:
                self._is_out = self._is_stale = False
                self.forget_saved()
                # Others wait for poses from here.
                self.transport.fail(error)
                raise

    def _gather_run(self) -> None:
        """Gather the state of the run, with all data of the next step."""
        with self.transport.alone():
            self._gather(self._run, self._contacts, of_run=True, whole=True)

    def have_state(self) -> None:
        """Gather the state at the end of the last step, without what only later steps need."""
        if not self._is_here:
            self._gather(
                self._now, self._call.model.contacts, of_run=self._call.of_run, whole=False)
            self._is_here = True

    def follow_search(self) -> None:
        """Let ranks record displacements from the search that this process has made."""
        watch = self._call.watch
        assert watch is not None
        self.order('watch', watch.frame.copy())

    def examine(self, time: float, ledger: np.ndarray) -> int:
        """Return the status of a health check at `time` [s], summed by ranks if they can."""
        if self._is_summed:
            return self._sum_figures(time, ledger)
        return super().examine(time, ledger)

    def save(self) -> None:
        """Save the state that was just examined, on the ranks or after it was gathered."""
        _, loads, state, saved, work, *_ = self._call
        if self._is_summed:
            self.save_parts(state, work, loads, saved)
            return
        self.forget_saved()
        super().save()

    @property
    def _is_summed(self) -> bool:
        """True if ranks sum for a health check: the first rank alone sums over contacts."""
        return self._call.of_run and self._call.model.contacts is None

    def enter(self) -> None:
        """Distribute the state of the call, unless the ranks hold it already."""
        model, loads, state, _, work, watch, _, of_run = self._call
        self._distribute(model, loads, state, work, watch, of_run=of_run)
        self._is_stale = self._is_stale or of_run

    def _distribute(
        self, model: Model, loads: Loads, state: State, work: Work, watch: Watch | None, *,
        of_run: bool
    ) -> None:
        """
        Send fabric, candidate pairs, loads and state to all ranks, as far as changed.

        All kernels that this rank needs are compiled before.
        """
        contacts = model.contacts
        if not self.shared.is_shared(contacts):
            if self._is_out and self._run is not None:
                self._gather(self._run, self._contacts, of_run=True, whole=True)
                self._is_out = self._is_stale = False
            if self._share(contacts):
                self._own = None
        if self._own is None:
            self._own = self._send_windows(
                model._replace(contacts=None), self._arrays_of(loads, state, work, None, watch))
        if not self._is_told:
            if contacts is not None and not self._touches:
                self._own.make_ready(self._arrays_of(
                    loads, state, work, no_contacts(contacts, model.blocks, self.packed.layout),
                    watch))
                self._touches = True
            self._tell_contacts(contacts)
            self._is_out = False
        if self._send_loads(loads):
            self._is_out = False
        now = self._now = self._arrays_of(
            loads, state, work, None if contacts is None else self.shared.own(
                contacts, self.parts[0], of_run=of_run), watch if of_run else None)
        self._is_here = not (of_run and self._is_out)
        if of_run:
            self._run, self._contacts = now, contacts
        if self._is_here:
            self._scatter(now, contacts, of_run=of_run)
            self._is_out = self._is_out or of_run

    @abstractmethod
    def _send_windows(self, model: Model, arrays: Any) -> Any:
        """Cut the windows of all ranks; return what takes steps of this rank."""

    def _scatter(self, now: Any, contacts: Contacts | None, *, of_run: bool) -> None:
        """Send each rank the state of its bodies; `contacts` are those of the whole fabric."""
        watch = now.watch
        self.order('scatter', of_run, None if watch is None else watch.frame.copy())
        tables, done, history = now.exchanged(contacts)
        if watch is not None:
            tables += [watch.reference, watch.turned]
        requests: list[Any] = []
        for rank in self.others:
            requests += self._send_tables(tables, rank)
            more = [row[self.rows_of_loads(now.loads, rank)] for row in done]
            more += [row[self.shared.which[rank]] for row in history]
            more += self._sampled(now, rank) if of_run else []
            requests += [self.transport.send(row, rank) for row in more]
        self.transport.wait(requests)
        if now.contacts is not None:
            mine = now.exchanged(now.contacts).history
            for target, row in zip(mine, history):
                target[:] = row[self.shared.which[0]]
            wake(now.contacts, slice(None), mine)

    def _send_tables(self, tables: list[np.ndarray], rank: int) -> list[Any]:
        """Start to send the rows of the bodies of a rank."""
        return self.rows[rank].send(self.transport, tables, rank)

    def _sampled(self, now: Any, rank: int) -> list[np.ndarray]:
        """Return further arrays to send with the state of a run."""
        return []

    def _gather(
        self, now: Any, contacts: Contacts | None, *, of_run: bool, whole: bool,
        which: tuple[Any, ...] | None = None
    ) -> None:
        """
        Gather the state of all ranks; `whole`: with all data of the next step.

        `contacts`: those of the whole fabric. `which`: arguments of `exchanged`, if others.
        """
        which = which or self._which(whole=whole)
        self.order('gather', of_run, *which)
        tables, done, history = now.exchanged(contacts, *which)
        if now.contacts is not None:
            self._take_back(now.exchanged(now.contacts, *which).history, history, contacts, 0)
            note_look(contacts, None, look_at(now.contacts, None))
        for rank in self.others:
            self.rows[rank].receive(self.transport, tables, rank)
            for row in done:
                self.receive(row[self.rows_of_loads(now.loads, rank)], rank)
            values = [np.empty((len(self.shared.which[rank]), 4)) for _ in history]
            for row in values:
                self.receive(row, rank)
            self._take_back(values, history, contacts, rank)
            look = np.zeros(REPORT_SIZE)
            self.receive(look, rank)
            note_look(contacts, now.watch, look)
            if of_run:
                self._receive_samples(now, rank, whole=whole)

    def _receive_samples(self, now: Any, rank: int, *, whole: bool) -> None:  # noqa: B027
        """Receive further arrays with the state of a run."""

    @abstractmethod
    def _which(self, *, whole: bool) -> tuple[Any, ...]:
        """Return the arguments of `exchanged` by which ranks send their states."""

    def _take_back(
        self, values: list[np.ndarray], history: list[np.ndarray], contacts: Contacts | None,
        rank: int
    ) -> None:
        """Copy the history of the pairs of a rank to the rows of all pairs."""
        if contacts is not None and history:
            which = self.shared.which[rank]
            for row, value in zip(history, values):
                row[which] = value
            wake(contacts, which, values)

    def _do(self, what: str, *words: Any, of_run: bool = True) -> Any:
        """Let all ranks call a method of their steps; return the result of this rank."""
        self.order('do', of_run, what, words)
        return getattr(self._own, what)(self._run if of_run else self._now, *words)

    def _sum_figures(self, time: float, numbers: np.ndarray) -> int:
        """
        Return the status bits of the state at `time` [s], as `examine`; ranks keep their states.
        """
        arrays = self._run
        limit, inside = float(coarse_up_to(numbers)), bool(looks_inside(numbers))
        own, book = self._do('examine', time, limit, inside), Ledger.over(numbers)
        book.roughest = max(
            book.roughest, self.gather_figures(own, arrays.work.figures))
        # Any number that is too large is none.
        with np.errstate(all='ignore'):
            return judge(
                self.packed.model.contacts, arrays.state, arrays.work.figures, numbers)

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

    def save_parts(self, state: State, work: Work, loads: Loads, saved: State) -> None:
        """Save the state of its bodies on each rank; `saved` is the array for it here."""
        self.order('save')
        own = self.rows_of_loads(loads, 0)
        self._saved.save(state, work, loads.work[own] if self._has_loads else None)
        spent = None if work.spent is None else np.empty_like(work.spent.done)
        self._saved_for, self._flows = (saved, loads, spent, self._has_loads), {}

    def forget_saved(self) -> None:
        """Discard the saved state of the ranks: it was saved here, or is lost."""
        self._saved_for = None

    def _bring_saved(self) -> None:
        """Gather the state that the ranks have saved, unless it is here."""
        if self._saved_for is None or self._flows:
            return
        saved, loads, spent, acted = self._saved_for
        tables, done = saved_tables(saved, spent), np.zeros_like(loads.work)
        self.order('give_saved')
        self._saved.put(tables)
        if acted:
            done[self.rows_of_loads(loads, 0)] = self._saved.rows[-1]
        for rank in self.others:
            self.rows[rank].receive(self.transport, tables, rank)
            if acted:
                self.receive(done[self.rows_of_loads(loads, rank)], rank)
        if self._keeps_work:
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

    def _share(self, contacts: Contacts | None) -> bool:
        """Assign pairs to ranks; return True if windows change."""
        needed = self.shared.split(contacts)
        self._is_told = False
        if not any(
                len(np.setdiff1d(blocks, part.halo))
                for blocks, part in zip(needed, self.parts)):
            return False
        # What was near once may be so again.
        self._near = [np.union1d(*pair) for pair in zip(self._near, needed)]
        self._divide()
        return True

    def _cut_windows(
        self, model: Model, arrays: Any, what: Any, *,
        samples: Sequence[np.ndarray] | None = None
    ) -> None:
        """
        Send each rank its window, and `what` it needs for steps.

        `samples` are blocks of each part that sample the roughness.
        """
        # With their windows ranks lose what they have saved.
        self._bring_saved()
        layout, self._acting = self.packed.layout, ()
        self._slots = [slots_of(model, layout, part) for part in self.parts]
        for rank in self.others:
            chosen = np.zeros(0, np.int64) if samples is None else samples[rank]
            window = window_of(model, layout, self.parts[rank], self._slots[rank], chosen)
            window = window._replace(
                watch=None if arrays.watch is None else watch_stub(arrays.watch),
                spends=arrays.work.spent is not None)
            self.transport.send_order(('window', self.number, window, what), rank)
        self._is_told = False

    def _tell_contacts(self, contacts: Contacts | None) -> None:
        """Send each rank its pairs."""
        for rank in self.others:
            near = None if contacts is None else self.shared.near(
                contacts, rank, self._slots[rank])
            self.transport.send_order(('contacts', self.number, near), rank)
        self._is_told = True

    def _send_loads(self, loads: Loads) -> bool:
        """Send each rank the loads on its bodies if they have changed; return True if sent."""
        anchors, stages = loads.anchors, len(loads.power) if self._stores_powers else 0
        acting = loads.start, loads.wrench, loads.force, anchors, loads.drives, loads.tractions
        # Forces of pulls, and slopes of anchors that break, are written in place.
        written = [loads.force] if anchors is None else [
            values for values in (
                loads.force, anchors.extension, anchors.compression, anchors.damping)
            if values is not None]
        if len(acting) == len(self._acting) and all(
                one is other for one, other in zip(acting, self._acting)) and all(
                np.array_equal(one, other) for one, other in zip(written, self._written)):
            return False
        self._acting, self._written = acting, [values.copy() for values in written]
        self._has_loads = len(loads.wrench) > 0 or stages > 0
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
