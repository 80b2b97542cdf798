# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Lengths and paths of wrapped connectors, one by one."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.terms.shared import Connectors
from icofabric_sim.terms.wrapping.pairs import taut
from icofabric_sim.terms.wrapping.path import apart, leaving, LOST, pose_of, wound
from icofabric_sim.terms.wrapping.record import Wrapping
import numpy as np


@compiled
def measure_wrapped(
    wrapping: Wrapping, connectors: Connectors, position: np.ndarray, orientation: np.ndarray,
    found: np.ndarray, lengths: np.ndarray, lost: np.ndarray
) -> None:
    """
    Write lengths [m] of wrapped connectors, where `found` (c,) is not 0, and ends without a path.

    Slots last: `position` (3, n), `orientation` (4, n); `lengths` (c,), `lost` (c,) with bit 0
    for the first end, bit 1 for the second.
    """
    for c in range(found.shape[0]):
        lost[c] = 0
        if found[c] != 0:
            edge, far_edge = int(connectors.first_edge[c]), int(connectors.second_edge[c])
            pose = pose_of(position, orientation, connectors.first[c])
            far = pose_of(position, orientation, connectors.second[c])
            way, place, far_way, far_place = taut(wrapping, pose, edge, far, far_edge)
            p = leaving(wrapping, pose, edge, way, place)
            q = leaving(wrapping, far, far_edge, far_way, far_place)
            lengths[c] = apart(p, q) + wound(wrapping, edge, way, place) + wound(
                wrapping, far_edge, far_way, far_place)
            lost[c] = (1 if way == LOST else 0) + (2 if far_way == LOST else 0)


@compiled
def find_ways(
    wrapping: Wrapping, connectors: Connectors, position: np.ndarray, orientation: np.ndarray,
    chosen: np.ndarray, ways: np.ndarray, places: np.ndarray
) -> None:
    """
    Write paths and places along their last edges [m] at both ends of `chosen` connectors, (w, 2).

    Slots last: `position` (3, n), `orientation` (4, n).
    """
    for i in range(chosen.shape[0]):
        c = chosen[i]
        ways[i, 0], places[i, 0], ways[i, 1], places[i, 1] = taut(
            wrapping, pose_of(position, orientation, connectors.first[c]),
            int(connectors.first_edge[c]),
            pose_of(position, orientation, connectors.second[c]), int(connectors.second_edge[c]))
