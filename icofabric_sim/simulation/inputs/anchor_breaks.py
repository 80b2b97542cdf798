# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The anchors of a run that can break: at which lengths, which have, and since when."""

from collections.abc import Mapping
from typing import Any

from icofabric_sim.scene.anchors import Anchor
from icofabric_sim.simulation.checkpoints.state_tree import remembered_numbers, StateTree
import numpy as np


class AnchorBreaks:
    """Part of what acts on a fabric: a broken anchor pulls nothing any more."""

    def __init__(self, anchors: Mapping[str, Anchor]) -> None:
        """All `anchors` of the scene are whole."""
        self.names = tuple(anchors)
        rows = anchors.values()
        self.body = np.array([anchor.body for anchor in rows])
        self.arm = np.array([anchor.arm for anchor in rows])  # (a, 3) [m], body axes
        self.longest = np.array([anchor.limits.longest for anchor in rows])
        self.shortest = np.array([anchor.limits.shortest for anchor in rows])
        self.law = np.array([anchor.law for anchor in rows])  # (a, 3) k_e, k_c, D
        self.since = np.full(len(self.names), np.nan)  # [s]; NaN while unbroken

    @property
    def broken(self) -> np.ndarray:
        """Which anchors are broken, (a,) bool."""
        return ~np.isnan(self.since)

    @property
    def left(self) -> np.ndarray:
        """Numbers of the anchors that may still break."""
        return np.flatnonzero(
            np.isnan(self.since) & ((self.longest < np.inf) | (self.shortest > 0.0)))

    def add(self, numbers: np.ndarray, time: float) -> None:
        """Break anchors, by their numbers, at `time` [s]."""
        self.since[numbers] = time

    def mend(self) -> None:
        """Make all of them whole."""
        self.since[:] = np.nan

    def adopt(self, other: 'AnchorBreaks | None') -> None:
        """Break what is broken in an earlier scene, where the same edge has that anchor here."""
        if other is None:
            return
        for there in np.flatnonzero(other.broken):
            name = other.names[there]
            if name in self.names:
                here = self.names.index(name)
                if self.body[here] == other.body[there]:
                    self.since[here] = other.since[there]

    def state_tree(self) -> dict[str, Any]:
        """The broken ones, by their numbers."""
        gone = np.flatnonzero(self.broken)
        return {'anchor': gone.astype(float), 'time': self.since[gone]}

    def load_state(self, tree: StateTree | None) -> None:
        """Go on with these, or with all whole."""
        self.mend()
        if tree is None:
            return
        time = tree.array('time')
        numbers = remembered_numbers('anchors', tree.array('anchor'), len(self.names))
        if time.shape != numbers.shape or not np.isfinite(time).all():
            raise ValueError('broken_anchors.time must be a finite time for each broken anchor')
        self.since[numbers] = time
