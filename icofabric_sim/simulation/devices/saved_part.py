# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Last saved state of the bodies of a rank, with the energies that had flowed."""

from collections.abc import Sequence

from icofabric_sim.kernels.records import State, Work
from icofabric_sim.simulation.devices.slot_rows import SlotRows
from icofabric_sim.simulation.devices.transport import Transport
import numpy as np


class SavedPart:
    """Rows of the blocks of a part: the state, dissipated energy, and the work of loads."""

    def __init__(self, slots: SlotRows) -> None:
        """Start without a saved state; `slots` are those of the part."""
        self._slots = slots
        self.rows: list[np.ndarray] = []

    def save(self, state: State, work: Work, done: np.ndarray | None) -> None:
        """Save a state and dissipated energies; `done` [J]: work of the loads, if any act."""
        tables = saved_tables(state, None if work.spent is None else work.spent.done)
        self.rows = self._slots.copied(tables, self.rows)
        if done is not None:
            self.rows.append(done.copy())

    def give(self, transport: Transport) -> None:
        """Send the saved state to the first rank."""
        transport.wait([transport.send(row, 0) for row in self.rows])

    def put(self, tables: Sequence[np.ndarray]) -> None:
        """Write it to tables of all slots."""
        self._slots.put(self.rows, tables)


def saved_tables(state: State, spent: np.ndarray | None) -> list[np.ndarray]:
    """Return rows (r, s) to save: the state, and dissipated energies `spent` (2, s) [J]."""
    return [*state.rows()] if spent is None else [*state.rows(), spent]
