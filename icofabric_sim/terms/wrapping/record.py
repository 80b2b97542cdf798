# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Constants of connectors that are wrapped over shells."""

from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.terms.shells import Shells
import numpy as np


class Wrapping(Record):
    """The shell that connectors wrap, and their paths over its edges, see path.py."""

    # (6, p, 3) of each attachment point: outward unit normals, body axes, of the 20 faces and of
    # planes through the point and an edge; (6, p) their heights over the centre [m]
    normals: np.ndarray
    heights: np.ndarray
    height: float  # of the faces over the centre [m]
    corners: np.ndarray  # (12, 3) [m], body axes
    points: np.ndarray  # (6, 3) attachment points [m], body axes
    shells: Shells | None  # None: these are the midpoints of the named edges
    # (6, q) int32, planes of each attachment point over which a connector is straight
    start: np.ndarray
    # (6, w, 10) for each path from an attachment point: a corner and the direction of its last
    # edge, the coordinate of the unfolded attachment point along that edge and its distance from
    # the edge, and the range of coordinates through which the path leads [m].
    ways: np.ndarray
    faces: np.ndarray  # (6, w, 2) int32, planes before and after the last edge of a path
