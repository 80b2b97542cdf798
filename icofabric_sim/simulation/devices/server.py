# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""A rank other than the first: holds windows, and does what it is told until the run ends."""

from collections.abc import Callable
from dataclasses import dataclass, field
import socket
from typing import Any

from icofabric_sim.kernels.records import Blocks, Contacts, Loads, Meter, State, Watch, Work
from icofabric_sim.scene.available_memory import available_memory
from icofabric_sim.simulation.devices.near_pairs import contacts_of, NearPairs, watch_of
from icofabric_sim.simulation.devices.part_steps import Arrays, PartSteps, Stretch, Weights
from icofabric_sim.simulation.devices.shared_contacts import look_at, remembered_by, wake
from icofabric_sim.simulation.devices.slot_rows import SlotRows, tables_of
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.window import resting, Window
from icofabric_sim.simulation.model.layout import aligned_empty, kinks_room
import numpy as np


@dataclass
class _Held:
    """A window with its states: of the run, and of what is tried beside it."""

    steps: PartSteps
    rows: SlotRows
    states: dict[bool, tuple[State, Work]]  # by whether it is the run's
    loads: Loads | None = None
    works: dict[bool, np.ndarray] = field(default_factory=dict)
    followed: Blocks | None = None  # whose poses are known
    watch: Watch | None = None
    contacts: dict[bool, Contacts] = field(default_factory=dict)

    def arrays(self, of_run: bool) -> Arrays:
        """Return what steps change."""
        state, work = self.states[of_run]
        loads = self.loads
        return Arrays(
            None if loads is None else loads._replace(work=self.works[of_run]), state, work,
            self.contacts.get(of_run), self.watch if of_run else None)


class Server:
    """Serves the first rank."""

    def __init__(self, transport: Transport) -> None:
        """Hold nothing yet."""
        self._transport = transport
        self._held: dict[int, _Held] = {}

    def serve(self) -> int:
        """
        Do what is ordered until the end; returns the exit status with which the first rank ends.

        Raises RankError where some rank has failed.
        """
        does: dict[str, Callable[..., None]] = {
            'room': self._room, 'window': self._window, 'loads': self._loads,
            'scatter': self._scatter, 'take': self._take, 'gather': self._gather,
            'contacts': self._contacts, 'watch': self._watch, 'forget': self._forget}
        while True:
            name, *rest = self._transport.next_order()
            if name == 'end':
                return int(rest[0])
            does[name](*rest)

    def _room(self) -> None:
        """Say on which machine this is, and how many bytes are left there."""
        self._transport.answer((socket.gethostname(), available_memory()))

    def _window(self, number: int, window: Window, weights: Weights) -> None:
        states = {}
        points = np.zeros(0)
        if window.model.links is not None:
            points = aligned_empty((18 * window.slot_count,))
        points[:] = 0.0
        changes = np.array([
            (-1.0) ** k for k in range(weights.differences + 1)]) * weights.pascal
        # Nothing of them is kept from step to step.
        kinks = kinks_room(
            window.model.links, window.slot_count, len(window.model.blocks.slot)
        ) if weights.mends_kinks else None
        for of_run in (True, False):
            acceleration = aligned_empty((6, window.slot_count))
            acceleration[:] = 0.0
            # The points are placed anew in each evaluation, so both states share them.
            spent = None
            if window.spends:
                spent = Meter(np.zeros((16, 0)), aligned_empty((2, window.slot_count)))
                spent.done[:] = 0.0
            states[of_run] = resting(window.slot_count), Work(
                points, acceleration, None, None, aligned_empty((7, 0)), changes,
                aligned_empty((0,)), spent, None, None, kinks)
        slot, exchange = window.model.blocks.slot, window.exchange
        self._held[number] = _Held(
            PartSteps(self._transport, window.model, exchange, weights),
            SlotRows(slot[exchange.first:exchange.last]), states,
            followed=Blocks(slot, window.known, 0),
            watch=None if window.watch is None else watch_of(window.watch, window.slot_count))

    def _contacts(self, number: int, near: NearPairs | None) -> None:
        held = self._held[number]
        held.contacts = {}
        if near is None or held.followed is None:
            return
        for of_run in (True, False):
            slot_count = held.states[of_run][0].position.shape[1]
            held.contacts[of_run] = contacts_of(
                near, held.followed.slot, held.followed, slot_count)

    def _watch(self, number: int, frame: np.ndarray) -> None:
        """Watch bodies from where they are."""
        held = self._held[number]
        assert held.watch is not None
        state = held.states[True][0]
        held.watch.frame[:] = frame
        np.copyto(held.watch.reference, state.position)
        np.copyto(held.watch.turned, state.orientation)

    def _loads(self, number: int, loads: Loads | None) -> None:
        held = self._held[number]
        held.loads = loads
        if loads is not None:
            held.works = {True: loads.work, False: np.zeros_like(loads.work)}

    def _scatter(self, number: int, of_run: bool, frame: np.ndarray | None) -> None:
        held = self._held[number]
        loads, state, work, contacts, watch = held.arrays(of_run)
        tables = tables_of(state, work, contacts, whole=True)
        if watch is not None:
            tables += [watch.reference, watch.turned]
            watch.frame[:] = frame
            watch.far[0] = 0.0
        held.rows.receive(self._transport, tables, 0)
        more = [] if loads is None else [loads.work]
        more += remembered_by(contacts)
        if of_run:
            more += list(held.steps.difference)
        self._transport.wait([self._transport.receive(row, 0) for row in more])
        if contacts is not None:
            wake(contacts, slice(None), remembered_by(contacts))
        held.steps.roughest = 0.0

    def _take(self, number: int, stretch: Stretch) -> None:
        held = self._held[number]
        arrays = held.arrays(stretch.is_checked)
        held.steps.take(arrays, stretch)
        if stretch.is_watched:
            requests = [self._transport.send(look_at(arrays.contacts, arrays.watch), 0)]
            if stretch.is_guarded and arrays.contacts is not None:
                own = held.steps.blocks
                requests.append(self._transport.send(arrays.contacts.pushes[own], 0))
            self._transport.wait(requests)

    def _gather(self, number: int, of_run: bool, whole: bool) -> None:
        held = self._held[number]
        loads, state, work, contacts, watch = held.arrays(of_run)
        requests = held.rows.send(
            self._transport, tables_of(state, work, contacts, whole=whole), 0)
        more: list[Any] = [] if loads is None else [loads.work]
        more += [*remembered_by(contacts), look_at(contacts, watch)]
        if of_run:
            more.append(np.array([held.steps.take_roughest()]))
            if whole:
                more += list(held.steps.difference)
        requests += [self._transport.send(row, 0) for row in more]
        self._transport.wait(requests)

    def _forget(self, number: int) -> None:
        self._held.pop(number, None)
