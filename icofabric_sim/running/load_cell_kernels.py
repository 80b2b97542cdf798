# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of measured forces (reactions, contacts), prepared in a thread on first demand."""

from contextlib import suppress
import threading
import time
from typing import Any

from icofabric_sim.simulation.precompile import MAX_BODY_COUNT
from icofabric_sim.simulation.simulation import Simulation


class LoadCellKernels:
    """Kernels of the measured forces of one simulation; a large scene loads them on first use."""

    def __init__(self, simulation: Simulation) -> None:
        """Start to load the kernels, or to compile them if they are not on disk."""
        self._thread: threading.Thread | None = None
        self._began = time.monotonic()
        if simulation.scene.body_count <= MAX_BODY_COUNT:
            has_contacts = simulation.status.has_contacts
            self._thread = threading.Thread(
                target=_load, args=(simulation, has_contacts), name='load cells', daemon=True)
            self._thread.start()

    @property
    def are_ready(self) -> bool:
        """Return whether measuring needs no compilation, as far as known."""
        return self._thread is None or not self._thread.is_alive()

    @property
    def seconds(self) -> float:
        """Return the wall time [s] since the kernels were requested."""
        return time.monotonic() - self._began


def _load(simulation: Simulation, has_contacts: bool) -> None:
    """Measure in another simulation of the same kernel variant."""
    # An error is reported where the kernels are used.
    with suppress(Exception):
        scene = simulation.scene
        changes: dict[str, Any] = {'solver.threads': 1}
        if has_contacts:
            changes['contact.mode'] = 'always'
        other = Simulation(scene.with_changes(changes), rotation=simulation.rotation)
        other.reactions()
