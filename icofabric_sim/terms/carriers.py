# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Places and velocities of moving planes, from their carriers: see terms/platens."""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import LANES
import numpy as np


@compiled
def slot_of(carriers: np.ndarray | None, s: int) -> int:
    """Return slot `s` of a body, or of the carrier of plane -1 - s; -1 for a plane at rest."""
    if carriers is None:
        return s
    else:
        return s if s >= 0 else int(carriers[-1 - s])


@compiled
def offset_of(
    planes: np.ndarray, carriers: np.ndarray | None, position: np.ndarray, k: int
) -> float:
    """Return the offset [m] of plane `k`, moved with its carrier."""
    offset = float(planes[k, 3])
    if carriers is None:
        return offset
    else:
        s = carriers[k]
        if s >= 0:
            for axis in range(3):
                offset += planes[k, axis] * position[axis, s]
        return offset


@compiled
def share_of(carriers: np.ndarray | None, k: int) -> float:
    """Return the fraction of a gap to plane `k` that each side may close: 1/2 if both move."""
    if carriers is None:
        return 1.0
    else:
        return 1.0 if carriers[k] < 0 else 0.5


@compiled
def moving_lanes(carried: np.ndarray | None, alive: int, s: int) -> int:
    """Return the lanes of a block with bodies, `alive`, or carriers of planes."""
    if carried is None:
        return alive
    else:
        return np.uint8(alive | carried[s // LANES])  # type: ignore[return-value]


@compiled
def plane_speed(carriers: np.ndarray | None, velocity: np.ndarray) -> float:
    """Return the largest speed [m/s] of a plane."""
    fastest = 0.0
    if carriers is None:
        return fastest
    else:
        for k in range(carriers.shape[0]):
            s = carriers[k]
            if s >= 0:
                fastest = max(
                    fastest, velocity[0, s] ** 2 + velocity[1, s] ** 2 + velocity[2, s] ** 2)
        return math.sqrt(fastest)
