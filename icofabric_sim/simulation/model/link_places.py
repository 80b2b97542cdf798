# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Indices of connectors in the tables of kernels, which hold each connector once at either end."""

from typing import NamedTuple

from icofabric_sim.kernels.records import Breakage, Links
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.scene.breakage import BreakLimits
from icofabric_sim.simulation.model.layout import aligned_empty, Layout
from icofabric_sim.terms.shared import Connectors, LINK_COUNT, LINKS_PER_EDGE
import numpy as np


class LinkPlaces(NamedTuple):
    """Indices of both ends of some connectors in the tables of `Links`; arrays of shape (2, m)."""

    block: np.ndarray
    link: np.ndarray
    slot: np.ndarray

    @property
    def lane(self) -> np.ndarray:
        """Lanes within the blocks."""
        return np.asarray(self.slot % LANES)


def link_places(
    layout: Layout, links: Links, connectors: Connectors, chosen: np.ndarray | slice
) -> LinkPlaces:
    """
    Return the indices of the `chosen` connectors.

    Two connectors leave each edge. The place of the other end distinguishes them, also once they
    are broken.
    """
    bodies = np.array([connectors.first[chosen], connectors.second[chosen]])
    edges = np.array([connectors.first_edge[chosen], connectors.second_edge[chosen]], np.int64)
    slot = layout.slot[bodies].astype(np.int64)
    block, lane = layout.block_of(bodies), slot % LANES
    leads_to = 3 * layout.slot_count * edges[::-1] + slot[::-1] - lane
    link = LINKS_PER_EDGE * edges
    for side in range(LINKS_PER_EDGE):
        there = LINKS_PER_EDGE * edges + side
        is_it = links.place[block, there] == leads_to
        link[is_it] = there[is_it]
    return LinkPlaces(block, link, slot)


def pack_breakage(
    layout: Layout, links: Links, connectors: Connectors, limits: BreakLimits
) -> Breakage:
    """Pack the length limits of the connectors at each body; unused links never break."""
    places = link_places(layout, links, connectors, slice(None))

    def rows(values: np.ndarray | None, empty: float, count: int = LINK_COUNT) -> np.ndarray:
        array = aligned_empty((count, layout.slot_count))
        array[:] = empty
        if values is not None:
            array[places.link, places.slot] = values
        return array

    return Breakage(
        longest=rows(limits.longest, np.inf), shortest=rows(limits.shortest, 0.0),
        length=rows(None, 0.0), rate=rows(None, 0.0), excess=rows(None, -1.0),
        moving=rows(None, 0.0, 18).reshape(-1))
