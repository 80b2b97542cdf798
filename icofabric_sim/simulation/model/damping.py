# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Packing of the damping coefficients of connectors: one for all, or one for each."""

from icofabric_sim.kernels.records import Links
from icofabric_sim.scene.scene import SceneConnectors
from icofabric_sim.simulation.model.layout import aligned_zeros, Layout
from icofabric_sim.terms.damping.record import Damping
from icofabric_sim.terms.shared import LINK_COUNT
import numpy as np

# Connectors of a batch: bounds the temporary arrays.
_BATCH_SIZE = 1 << 18


def pack_damping(
    connectors: SceneConnectors, layout: Layout, links: Links | None
) -> Damping | None:
    """Pack the damping coefficients c [N s/m] of all connectors; None without damping."""
    damping = connectors.damping
    if links is None or not damping.max(initial=0.0) > 0.0:
        return None
    if len(damping) == 1:
        return Damping(float(damping[0]), None)
    return Damping(float(damping.max()), at_links(damping, layout, links, connectors))


def at_links(
    values: np.ndarray, layout: Layout, links: Links, connectors: SceneConnectors
) -> np.ndarray:
    """Return values of connectors, (c,), by the links of each body, (12, s); 0 at unused links."""
    bodies, edges = connectors.bodies, connectors.edges
    result = aligned_zeros((LINK_COUNT, layout.slot_count))
    block = layout.block_of(np.arange(layout.body_count, dtype=np.int32))
    for start in range(0, len(bodies), _BATCH_SIZE):
        batch = slice(start, start + _BATCH_SIZE)
        for end in range(2):
            own, other = bodies[batch, end], bodies[batch, 1 - end]
            target = 3 * layout.slot_count * edges[batch, 1 - end].astype(np.int64)
            target += layout.slot[other]
            # Of the two connectors of an edge, choose the one that leads to the other body's edge.
            link = 2 * edges[batch, end].astype(np.int64)
            lane = layout.slot[own] - layout.blocks.slot[block[own]]
            link += links.place[block[own], link] + lane != target
            result[link, layout.slot[own]] = values[batch]
    return result
