# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Initial state of a run by body, until ranks have their parts.

So the first rank does not need arrays of the whole state: `Layout.pack`, part by part.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import Any

from icofabric_sim.kernels.records import State
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.simulation.devices.slot_rows import SlotRows
from icofabric_sim.simulation.model.layout import aligned_zeros, Layout, pieces
import numpy as np


class Unpacked:
    """A state that is not packed, and its destination."""

    def __init__(self, layout: Layout, initial: InitialState) -> None:
        """Allocate the state without filling it."""
        self._layout, self._initial = layout, initial
        self.state = State(*(
            aligned_zeros((values.shape[1], layout.slot_count)) for values in initial))

    @cached_property
    def _bodies(self) -> np.ndarray:
        """Numbers of the bodies by their slots; -1 without a body."""
        numbers = np.full(self._layout.slot_count, -1, np.int32)
        numbers[self._layout.slot] = np.arange(self._layout.body_count, dtype=np.int32)
        return numbers

    def set_aside(self) -> None:
        """Free memory once all ranks have their parts."""
        self.__dict__.pop('_bodies', None)

    def rows(self, index: Any) -> Iterator[np.ndarray]:
        """Yield rows of the state at some slots, in the order of `State.rows`."""
        number = self._bodies[index]
        there = number >= 0
        number = number[there]
        for values in self._initial:
            for k in range(values.shape[1]):
                # A unit orientation, so that slots without a body compute with ordinary numbers.
                row = np.full(len(there), float(values.shape[1] == 4 and k == 3))
                row[there] = values[number, k]
                yield row

    def bounds(self) -> np.ndarray:
        """Return `bounds_of_state` of beside.py for all bodies."""
        place, _, velocity, _ = self._initial
        found = [np.concatenate([
            velocity[piece].max(axis=0), (-velocity[piece]).max(axis=0),
            [np.abs(place[piece]).max()]]) for piece in pieces(len(place))]
        largest: np.ndarray = np.max(found, axis=0)
        return largest

    def put(self, slots: SlotRows | None = None, room: State | None = None) -> None:
        """Write the state at some slots, None: all, to its room or to another one."""
        index = slice(None) if slots is None else slots.index
        rows = self.rows(index)
        for table in (room or self.state).rows():
            for target in table:
                target[index] = next(rows)


def complete(layout: Layout, state: State) -> None:
    """Write finite numbers to slots without a block, which no rank has."""
    runs = np.ones(layout.slot_count // LANES, bool)
    runs[layout.blocks.slot // LANES] = False
    state.orientation[3].reshape(-1, LANES)[runs] = 1.0
