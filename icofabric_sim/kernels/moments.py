# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Energy of bending and twisting of single connectors, for snapshots."""

from icofabric_sim.kernels.records import Moments
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.terms.shared import SMALLEST_SQUARE
import numpy as np


@compiled
def moment_energy(
    moments: Moments, orientation: np.ndarray, ends: np.ndarray
) -> float:
    """
    Return the energy [J] of bending and twisting of all connectors; bodies first.

    `orientation`: unit quaternions (n, 4); `ends` (c, 2, 3) [m].
    """
    total = 0.0
    axes = np.empty((2, 3, 3))
    for c in range(ends.shape[0]):
        for end in range(2):
            b = moments.bodies[c, end]
            x, y = orientation[b, 0], orientation[b, 1]
            z, w = orientation[b, 2], orientation[b, 3]
            axes[end, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
            axes[end, 0, 1], axes[end, 0, 2] = 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
            axes[end, 1, 0], axes[end, 1, 2] = 2.0 * (x * y - w * z), 2.0 * (y * z + w * x)
            axes[end, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
            axes[end, 2, 0], axes[end, 2, 1] = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
            axes[end, 2, 2] = 1.0 - 2.0 * (x * x + y * y)
        square = 0.0
        for k in range(3):
            square += (ends[c, 1, k] - ends[c, 0, k]) ** 2
        bent, twisted = 0.0, 0.0
        for k in range(3):
            d = (ends[c, 1, k] - ends[c, 0, k]) / np.sqrt(max(square, SMALLEST_SQUARE))
            for end in range(2):
                n = 0.0
                for i in range(3):
                    n += moments.direction[c, i] * axes[end, i, k]
                bent += 0.5 * (n - d) ** 2
            for i in range(3):
                twisted += 0.25 * (axes[1, i, k] - axes[0, i, k]) ** 2
        bending = moments.bending[c if c < moments.bending.shape[0] else 0]
        twisting = moments.twisting[c if c < moments.twisting.shape[0] else 0]
        total += bending * bent + twisting * twisted
    return total
