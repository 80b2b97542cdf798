# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Reports on connectors that run into the shell that they are attached to."""

import logging

from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.snapshot import Snapshot
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')

# Where nothing but a warning depends on it, connectors in shells are looked for at every so many
# health checks: that takes 0.6 % of the time of a bare scene, and a quarter of that so.
_CHECKS = 4


class Obstruction:
    """
    First connector that a health check found in the shell of one of its bodies.

    Every fourth health check counts them (kernels/obstruction.py), every one where that ends
    the run; what is between two of these, and over before the second, is not seen, but within
    steps that events end (events/entering.py).
    """

    def __init__(self, choice: str, packed: PackedScene) -> None:
        """Follow the `choice` of connector.obstruction."""
        self.stops, self._wraps = choice == 'stop', choice == 'wrap'
        self._packed = packed
        self.found = ''  # sentence
        # From one health check that counts them to the next.
        self.checks = 1 if self.stops else _CHECKS

    @property
    def is_watching(self) -> bool:
        """True if an obstruction could still be found."""
        return not self.found and self._packed.model.links is not None

    def note(self, time: float, state: State, broken_since: np.ndarray | None) -> None:
        """Describe the first obstructed connector in a `state`, and warn unless the run stops."""
        packed = self._packed
        assert packed.connectors is not None
        bodies = packed.layout.unpack(state)
        snapshot = Snapshot(
            time, *bodies, len(packed.connectors.first), packed, {}, broken_since)
        obstructed = snapshot.without_geodesic if self._wraps else snapshot.obstructed
        which = np.flatnonzero(obstructed)
        # Rounding may see it otherwise than the health check did.
        number = int(which[0]) if len(which) else 0
        pair = int(packed.connectors.first[number]), int(packed.connectors.second[number])
        own = pair[0] if obstructed[number] & 1 else pair[1]
        what = 'finds no way around' if self._wraps else 'enters'
        self.found = (
            f'connector {number}, between bodies {pair[0]} and {pair[1]}, {what} the shell of '
            f'body {own} that it is attached to, seen at the health check at t = {time:.6g} s'
            + (f' ({len(which):,} connectors do so)' if len(which) > 1 else ''))
        if not self.stops:
            _LOGGER.warning(
                '%s: it is computed as if it passed through (connector.obstruction)', self.found)
