# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Breakage of the anchors of a run: length limits, broken anchors and times of breakage."""

from collections.abc import Mapping
from typing import Any

from icofabric_sim.scene.anchors import Anchor
from icofabric_sim.simulation.checkpoints.state_tree import remembered_numbers, StateTree
import numpy as np


class AnchorBreaks:
    """Length limits and breakage of anchors; a broken anchor exerts no force."""

    def __init__(self, anchors: Mapping[str, Anchor]) -> None:
        """Start with all `anchors` of the scene unbroken."""
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
        """Broken anchors, (a,) bool."""
        return ~np.isnan(self.since)

    @property
    def left(self) -> np.ndarray:
        """Numbers of the unbroken anchors with a length limit."""
        return np.flatnonzero(
            np.isnan(self.since) & ((self.longest < np.inf) | (self.shortest > 0.0)))

    def add(self, numbers: np.ndarray, time: float) -> None:
        """Break anchors, by their numbers, at `time` [s]."""
        self.since[numbers] = time

    def mend(self) -> None:
        """Reset all anchors to unbroken."""
        self.since[:] = np.nan

    def adopt(self, other: 'AnchorBreaks | None') -> None:
        """
        Break the anchors that were broken in an earlier scene, if name and body are the same.
        """
        if other is None:
            return
        for there in np.flatnonzero(other.broken):
            name = other.names[there]
            if name in self.names:
                here = self.names.index(name)
                if self.body[here] == other.body[there]:
                    self.since[here] = other.since[there]

    def state_tree(self) -> dict[str, Any]:
        """Return the numbers of the broken anchors and their times of breakage."""
        gone = np.flatnonzero(self.broken)
        return {'anchor': gone.astype(float), 'time': self.since[gone]}

    def load_state(self, tree: StateTree | None) -> None:
        """Restore the broken anchors; None stands for no broken anchor."""
        self.mend()
        if tree is None:
            return
        time = tree.array('time')
        numbers = remembered_numbers('anchors', tree.array('anchor'), len(self.names))
        if time.shape != numbers.shape or not np.isfinite(time).all():
            raise ValueError('broken_anchors.time must be a finite time for each broken anchor')
        self.since[numbers] = time
