# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Watches for connectors that are longer or shorter than the table of their law says."""

from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.snapshot import Snapshot
import numpy as np


class TableWatch:
    """
    Remembers the first connector that was seen beyond its table, at the health checks.

    Forces note that they met a length beyond its table: lengths are computed only after that.
    """

    def __init__(self, packed: PackedScene) -> None:
        """Watch the connectors of a scene with tables."""
        self._packed, self.found = packed, ''  # sentence
        self._suspected = True
        self._always = packed.model.wrapping is not None  # pieces are those of straight lengths
        links = packed.model.links
        assert links is not None and links.tables is not None
        self._beyond = links.tables.beyond

    @property
    def is_watching(self) -> bool:
        """Whether something is still to be found."""
        return not self.found or self.may_stop

    @property
    def may_stop(self) -> bool:
        """Whether a run stops beyond some table."""
        return bool(self._packed.tables.stops.any())

    def is_suspect(self) -> bool:
        """Whether a connector was beyond its table in a state since the last check."""
        return self._always or self._beyond[0] > 0.0

    def was_suspect(self) -> bool:
        """Return whether a state since the last check but one is suspect, and begin anew."""
        before, self._suspected = self._suspected, self.is_suspect()
        self._beyond[0] = 0.0
        return before or self._suspected

    def describe(
        self, time: float, state: State, broken_since: np.ndarray | None
    ) -> tuple[str, bool]:
        """Describe what is beyond its table at a `time` [s], and return whether that stops."""
        packed = self._packed
        assert packed.connectors is not None
        first, second = packed.connectors.first, packed.connectors.second
        bodies = packed.layout.unpack(state)
        snapshot = Snapshot(time, *bodies, len(first), packed, {}, broken_since)
        length = snapshot.connector_length
        if broken_since is not None:
            length = np.where(snapshot.intact, length, np.nan)
        text, stops = packed.tables.describe_beyond(length, np.column_stack([first, second]))
        return text and f'{text}, seen at t = {time:.6g} s', stops
