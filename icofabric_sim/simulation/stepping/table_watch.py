# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Report of connectors whose length is beyond the table of their law."""

from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.snapshot import Snapshot
import numpy as np


class TableWatch:
    """
    First connector whose length was beyond its table at a health check.

    Force kernels set a flag at a length beyond its table; lengths are computed only then.
    """

    def __init__(self, packed: PackedScene) -> None:
        """Watch the connectors of a scene, if some have tables."""
        self._packed, self.found = packed, ''  # sentence
        self._suspected = True
        # Force kernels compare straight lengths, which geodesics exceed.
        self._always = packed.model.wrapping is not None
        links = packed.model.links
        laws = None if links is None else links.laws
        tables = None if laws is None else laws.tables
        self._beyond = None if tables is None else tables.beyond  # (1,) written by kernels

    @property
    def is_watching(self) -> bool:
        """True while a length beyond a table is still to be reported."""
        return self._beyond is not None and (not self.found or self.may_stop)

    @property
    def may_stop(self) -> bool:
        """True if a run stops beyond some table."""
        return bool(self._packed.curves.stops.any())

    def is_suspect(self) -> bool:
        """Return True if a connector was beyond its table in a state since the last check."""
        return self._always or (self._beyond is not None and self._beyond[0] > 0.0)

    def was_suspect(self) -> bool:
        """Return True if a state since the last check but one is suspect; restart the count."""
        before, self._suspected = self._suspected, self.is_suspect()
        if self._beyond is not None:
            self._beyond[0] = 0.0
        return before or self._suspected

    def describe(
        self, time: float, state: State, broken_since: np.ndarray | None
    ) -> tuple[str, bool]:
        """Return a text on connectors beyond their tables at `time` [s], and if the run stops."""
        packed = self._packed
        assert packed.connectors is not None
        first, second = packed.connectors.first, packed.connectors.second
        bodies = packed.layout.unpack(state)
        snapshot = Snapshot(time, *bodies, len(first), packed, {}, broken_since)
        length = snapshot.connector_length
        if broken_since is not None:
            length = np.where(snapshot.intact, length, np.nan)
        text, stops = packed.curves.describe_beyond(length, np.column_stack([first, second]))
        return text and f'{text}, seen at t = {time:.6g} s', stops
