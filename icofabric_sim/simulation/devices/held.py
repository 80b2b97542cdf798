# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Data of a fabric on a rank other than the first: window, candidate pairs and saved state."""

from abc import ABC, abstractmethod
from typing import Any

from icofabric_sim.kernels.records import Blocks
from icofabric_sim.simulation.devices.near_pairs import contacts_of, NearPairs, watch_of
from icofabric_sim.simulation.devices.saved_part import SavedPart
from icofabric_sim.simulation.devices.shared_contacts import look_at, wake
from icofabric_sim.simulation.devices.slot_rows import SlotRows
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.window import Window
from icofabric_sim.terms.contacts.record import Contacts
import numpy as np


class Held(ABC):
    """Window of a rank with the states of a run and of its trials; its methods are orders."""

    def __init__(self, transport: Transport, window: Window, steps: Any) -> None:
        """Start without candidate pairs; `steps` takes those of this rank."""
        self._transport, self._window, self._steps = transport, window, steps
        slot, exchange = window.model.blocks.slot, window.exchange
        self._rows = SlotRows(slot[exchange.first:exchange.last])
        self._saved = SavedPart(self._rows)
        # Whose poses are known.
        self._followed = Blocks(slot, window.known, 0)
        self._watch = None if window.watch is None else watch_of(window.watch, window.slot_count)
        # By whether it is the run's.
        self._contacts: dict[bool, Contacts] = {}

    def contacts(self, near: NearPairs | None) -> None:
        """Use these candidate pairs."""
        self._contacts = {} if near is None else {
            of_run: contacts_of(
                near, self._followed.slot, self._followed, self._window.slot_count)
            for of_run in (True, False)}

    def watch(self, frame: np.ndarray) -> None:
        """Record displacements from the present poses."""
        state, watch = self._arrays(True).state, self._watch
        assert watch is not None
        watch.frame[:] = frame
        np.copyto(watch.reference, state.position)
        np.copyto(watch.turned, state.orientation)

    def do(self, of_run: bool, what: str, words: tuple[Any, ...]) -> None:
        """Call a method of the steps, and send its result, if any, to the first rank."""
        self._answer(getattr(self._steps, what)(self._arrays(of_run), *words))

    def save(self) -> None:
        """Save the state and the work of loads."""
        loads, state, work, *_ = self._arrays(True)
        self._saved.save(state, work, None if loads is None else loads.work)

    def give_saved(self) -> None:
        """Send the saved state to the first rank."""
        self._saved.give(self._transport)

    def scatter(self, of_run: bool, frame: np.ndarray | None) -> None:
        """Receive the state from the first rank."""
        now, watch = self._arrays(of_run), self._watch
        tables, done, history = now.exchanged(now.contacts)
        if of_run and watch is not None:
            tables += [watch.reference, watch.turned]
            watch.frame[:] = frame
            watch.far[0] = 0.0
        self._rows.receive(self._transport, tables, 0)
        self._transport.wait([
            self._transport.receive(row, 0)
            for row in [*done, *history, *(self._sampled() if of_run else [])]])
        if now.contacts is not None:
            wake(now.contacts, slice(None), history)

    def gather(self, of_run: bool, *which: Any) -> None:
        """Send the state to the first rank; `which` are arguments of `exchanged`."""
        now = self._arrays(of_run)
        tables, done, history = now.exchanged(now.contacts, *which)
        requests = self._rows.send(self._transport, tables, 0)
        more = [*done, *history, look_at(now.contacts, now.watch)]
        more += self._reported(*which) if of_run else []
        requests += [self._transport.send(row, 0) for row in more]
        self._transport.wait(requests)

    def _sampled(self) -> list[np.ndarray]:
        """Return further arrays to receive with the state of a run."""
        return []

    def _reported(self, *which: Any) -> list[np.ndarray]:
        """Return further arrays to send with the state of a run."""
        return []

    @abstractmethod
    def _arrays(self, of_run: bool) -> Any:
        """Return the arrays that steps change."""

    def _answer(self, numbers: np.ndarray | None) -> None:
        if numbers is not None:
            self._transport.wait([self._transport.send(numbers, 0)])
