# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Connectors as linear springs between edge midpoints (eqs 1 and 49).
"""

import math

from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.records import Connectors
from icofabric_sim.kernels.rotations import fill_arms
import numpy as np


@compiled
def add_connectors(
    connectors: Connectors | None,
    position: np.ndarray,
    orientation: np.ndarray,
    arms: np.ndarray,
    force: np.ndarray,
    torque: np.ndarray,
) -> None:
    """
    Add the force [N] and the torque about each centre [N m] of every connector.

    World frame; `force` and `torque` are (n, 3).
    """
    if connectors is None:
        return
    fill_arms(orientation, connectors.half_width, arms)
    stiffness = connectors.stiffness
    natural_length = connectors.natural_length
    for c in range(connectors.first.shape[0]):
        i = connectors.first[c]
        j = connectors.second[c]
        edge_i = connectors.first_edge[c]
        edge_j = connectors.second_edge[c]
        pair_i = edge_i >> 1
        pair_j = edge_j >> 1
        sign_i = 1.0 - 2.0 * (edge_i & 1)
        sign_j = 1.0 - 2.0 * (edge_j & 1)
        ix, iy, iz = (
            sign_i * arms[i, pair_i, 0],
            sign_i * arms[i, pair_i, 1],
            sign_i * arms[i, pair_i, 2],
        )
        jx, jy, jz = (
            sign_j * arms[j, pair_j, 0],
            sign_j * arms[j, pair_j, 1],
            sign_j * arms[j, pair_j, 2],
        )
        ux = (position[j, 0] - position[i, 0]) + (jx - ix)
        uy = (position[j, 1] - position[i, 1]) + (jy - iy)
        uz = (position[j, 2] - position[i, 2]) + (jz - iz)
        length = math.sqrt(ux * ux + uy * uy + uz * uz)
        factor = stiffness * (length - natural_length) / length if length > 0.0 else 0.0
        fx, fy, fz = factor * ux, factor * uy, factor * uz
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
        force[j, 0] -= fx
        force[j, 1] -= fy
        force[j, 2] -= fz
        torque[i, 0] += iy * fz - iz * fy
        torque[i, 1] += iz * fx - ix * fz
        torque[i, 2] += ix * fy - iy * fx
        torque[j, 0] -= jy * fz - jz * fy
        torque[j, 1] -= jz * fx - jx * fz
        torque[j, 2] -= jx * fy - jy * fx


@compiled
def connector_ends(
    connectors: Connectors, position: np.ndarray, arms: np.ndarray, ends: np.ndarray
) -> None:
    """
    World positions [m] of both ends of every connector, `ends` (c, 2, 3).
    """
    for c in range(connectors.first.shape[0]):
        for side in range(2):
            b = connectors.first[c] if side == 0 else connectors.second[c]
            edge = connectors.first_edge[c] if side == 0 else connectors.second_edge[c]
            sign = 1.0 - 2.0 * (edge & 1)
            for k in range(3):
                ends[c, side, k] = position[b, k] + sign * arms[b, edge >> 1, k]
