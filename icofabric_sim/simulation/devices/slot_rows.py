# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of arrays to exchange between ranks: slots of a part, without copies where possible."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.transport import Transport
import numpy as np


class SlotRows:
    """Slots of some blocks in rows of arrays, with slots as the last axis."""

    def __init__(self, slots: np.ndarray) -> None:
        """Select blocks by their first `slots`."""
        every = (slots[:, None].astype(np.int64) + np.arange(LANES)).ravel()
        self.count = len(every)
        # What they are in a row; of blocks that lie side by side a slice, which is no copy.
        is_run = self.count and np.array_equal(
            every, np.arange(every[0], every[0] + self.count))
        self.index: Any = slice(int(every[0]), int(every[0]) + self.count) if is_run else every

    def send(self, transport: Transport, tables: Sequence[np.ndarray], rank: int) -> list[Any]:
        """Start to send the rows of all `tables` to a rank."""
        return [
            transport.send(np.ascontiguousarray(row[self.index]), rank)
            for row in _rows(tables)]

    def receive(self, transport: Transport, tables: Sequence[np.ndarray], rank: int) -> None:
        """Receive the rows of all `tables` in place."""
        if isinstance(self.index, slice):
            transport.wait([
                transport.receive(row[self.index], rank) for row in _rows(tables)])
            return
        for row in _rows(tables):
            values = np.empty(self.count)
            transport.wait([transport.receive(values, rank)])
            row[self.index] = values

    def of(self, table: np.ndarray) -> np.ndarray:
        """Return the slots of a table (r, s), without a copy if they are contiguous."""
        chosen: np.ndarray = table[:, self.index]
        return chosen

    def copied(
        self, tables: Sequence[np.ndarray], kept: Sequence[np.ndarray]
    ) -> list[np.ndarray]:
        """Copy the rows of all `tables` to the arrays of earlier copies."""
        rows = list(_rows(tables))
        kept = kept[:len(rows)] if len(kept) >= len(rows) else [
            np.empty(self.count) for _ in rows]
        for row, copy in zip(rows, kept):
            copy[:] = row[self.index]
        return list(kept)

    def put(self, rows: Sequence[np.ndarray], tables: Sequence[np.ndarray]) -> None:
        """Write such copies to tables."""
        for row, copy in zip(_rows(tables), rows):
            row[self.index] = copy

    def copy(self, source: np.ndarray, target: np.ndarray) -> None:
        """Copy the slots from one table to another."""
        target[:, self.index] = source[:, self.index]


class Exchanged(NamedTuple):
    """Arrays that ranks exchange with a state."""

    tables: list[np.ndarray]  # (r, s) each, by slots
    done: list[np.ndarray]  # (m,) each: work and powers of the loads
    history: list[np.ndarray]  # (p, 4) each: stretches and slopes of friction, by pairs


def _rows(tables: Sequence[np.ndarray]) -> Iterator[np.ndarray]:
    for table in tables:
        yield from table
