# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Broken connectors of a run, a part of its state.

For kernels, broken connectors do not exist: their bits in the links are cleared.
"""

from typing import Any

from icofabric_sim.simulation.checkpoints.state_tree import remembered_numbers, StateTree
from icofabric_sim.simulation.model.link_places import link_places
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.ties import mark_ties
import numpy as np


class Broken:
    """Broken connectors, and their times of breakage."""

    def __init__(self, packed: PackedScene) -> None:
        """Start with all connectors of the scene unbroken."""
        self._packed = packed
        self._since: np.ndarray | None = None

    @property
    def count(self) -> int:
        """Number of broken connectors."""
        return 0 if self._since is None else int(np.isfinite(self._since).sum())

    @property
    def since(self) -> np.ndarray | None:
        """Times of breakage [s], (c,), NaN while unbroken; None if no connector is broken."""
        return None if self._since is None else self._since.copy()

    def add(self, connectors: np.ndarray, time: float | np.ndarray) -> None:
        """Break connectors, by their numbers, at `time` [s]."""
        packed = self._packed
        assert packed.connectors is not None
        if self._since is None:
            self._since = np.full(len(packed.connectors.first), np.nan)
        self._since[connectors] = time
        self._mark(connectors, present=False)

    def mend(self) -> None:
        """Reset all connectors to unbroken."""
        if self._since is not None:
            connectors, self._since = np.flatnonzero(np.isfinite(self._since)), None
            self._mark(connectors, present=True)

    def adopt(self, other: 'Broken') -> None:
        """
        Break the connectors that were broken in an earlier scene and join the same edges here.
        """
        if other._since is None or self._packed.connectors is None:
            return
        gone = np.flatnonzero(np.isfinite(other._since))
        own = {key: number for number, key in enumerate(_keys(self._packed, slice(None)))}
        pairs = [
            (own[key], since)
            for key, since in zip(_keys(other._packed, gone), other._since[gone]) if key in own]
        if pairs:
            numbers, since = zip(*pairs)
            self.add(np.array(numbers), np.array(since))

    def state_tree(self) -> dict[str, Any]:
        """Return the broken connectors in the order of their numbers."""
        since = np.zeros(0) if self._since is None else self._since
        gone = np.flatnonzero(np.isfinite(since))
        return {'connector': gone.astype(float), 'time': since[gone]}

    def load_state(self, tree: StateTree | None) -> None:
        """Restore the broken connectors; None stands for no broken connector."""
        self.mend()
        if tree is None:
            return
        connectors, time = tree.array('connector'), tree.array('time')
        numbers = connector_numbers(connectors, self._packed)
        if time.shape != numbers.shape or not np.isfinite(time).all():
            raise ValueError('broken.time must be a finite time for each broken connector')
        self.add(numbers, time)

    def _mark(self, connectors: np.ndarray, *, present: bool) -> None:
        packed = self._packed
        custom = connectors[connectors >= packed.woven.stop] - packed.woven.stop
        if len(custom):
            assert packed.model.ties is not None
            mark_ties(packed.model.ties, custom, present=present)
        connectors, links = connectors[connectors < packed.woven.stop], packed.model.links
        if not len(connectors):
            return
        assert packed.connectors is not None and links is not None
        places = link_places(packed.layout, links, packed.connectors, connectors)
        bit = (1 << places.lane).astype(np.uint8)
        if present:
            np.bitwise_or.at(links.present, (places.block, places.link), bit)
        else:
            np.bitwise_and.at(links.present, (places.block, places.link), ~bit)


def connector_numbers(values: np.ndarray, packed: PackedScene) -> np.ndarray:
    """Return stored numbers of connectors; raise ValueError if the scene lacks one of them."""
    count = 0 if packed.connectors is None else len(packed.connectors.first)
    return remembered_numbers('connectors', values, count)


def _keys(packed: PackedScene, chosen: np.ndarray | slice) -> list[tuple[Any, ...]]:
    """Return the bodies and edges, or points of custom ones, that the connectors join."""
    connectors = packed.connectors
    assert connectors is not None
    ends = np.column_stack([connectors.first_edge, connectors.second_edge])
    points: list[tuple[Any, ...]] = list(map(tuple, ends[packed.woven].tolist()))
    if packed.custom is not None:
        points += map(tuple, packed.custom.points.reshape(-1, 6).tolist())
    return [
        (one, two, *points[number]) for one, two, number in zip(
            connectors.first[chosen].tolist(), connectors.second[chosen].tolist(),
            np.arange(len(points))[chosen].tolist())]
