# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of measured forces (reactions, contacts), prepared in a thread on first demand."""

from contextlib import suppress
import threading
import time

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.precompile import MAX_BODY_COUNT
from icofabric_sim.simulation.simulation import measure_forces, Simulation


class LoadCellKernels:
    """Kernels of the measured forces of one simulation; a large scene loads them on first use."""

    def __init__(self, simulation: Simulation) -> None:
        """Start to load the kernels, or to compile them if they are not on disk."""
        self._thread: threading.Thread | None = None
        self._began = time.monotonic()
        if simulation.scene.body_count <= MAX_BODY_COUNT:
            scene = simulation.scene
            if simulation.status.has_contacts:
                scene = scene.with_changes({'contact.mode': 'always'})
            self._thread = threading.Thread(
                target=_load, args=(scene, simulation.rotation), name='load cells', daemon=True)
            self._thread.start()

    @property
    def are_ready(self) -> bool:
        """Return whether measuring needs no compilation, as far as known."""
        return self._thread is None or not self._thread.is_alive()

    @property
    def seconds(self) -> float:
        """Return the wall time [s] since the kernels were requested."""
        return time.monotonic() - self._began


def _load(scene: Scene, rotation: str) -> None:
    # An error is reported where the kernels are used.
    with suppress(Exception):
        measure_forces(scene, rotation)
