# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Candidate pairs and displacements on a rank other than the first."""

from icofabric_sim.kernels.records import Blocks, Contacts, State
from icofabric_sim.simulation.devices.near_pairs import contacts_of, NearPairs, watch_of
from icofabric_sim.simulation.devices.window import Window
import numpy as np


class Surroundings:
    """Candidate pairs of a run and of its trials, and the watch."""

    def __init__(self, window: Window) -> None:
        """Start without candidate pairs."""
        self._slot_count = window.slot_count
        # Whose poses are known.
        self._followed = Blocks(window.model.blocks.slot, window.known, 0)
        self.watch = None if window.watch is None else watch_of(window.watch, window.slot_count)
        # By whether it is the run's.
        self.contacts: dict[bool, Contacts] = {}

    def take_pairs(self, near: NearPairs | None) -> None:
        """Use these candidate pairs."""
        self.contacts = {} if near is None else {
            of_run: contacts_of(near, self._followed.slot, self._followed, self._slot_count)
            for of_run in (True, False)}

    def watch_from(self, state: State, frame: np.ndarray) -> None:
        """Record displacements from the poses of a state."""
        assert self.watch is not None
        self.watch.frame[:] = frame
        np.copyto(self.watch.reference, state.position)
        np.copyto(self.watch.turned, state.orientation)
