# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Energy of twisting and the bound of its frequency."""

import math

from icofabric_sim.kernels.rotations import Nine
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, splat, Vector
from icofabric_sim.terms.shared import Links, partner_slot, since_woven, stiffness_of
from icofabric_sim.terms.twisting.record import Twisting
import numpy as np

# Largest of (2 + 2 cos phi + sin phi) / 2 over all angles, (2 + sqrt 5) / 2.
_TWIST_RATIO = 0.5 * (2.0 + math.sqrt(5.0))


@compiled
def add_bound(
    twisting: Twisting | None, links: Links, inverse_inertia: float, orientation: np.ndarray,
    block: int, s: int, bound: Vector, energy: Vector
) -> tuple[Vector, Vector]:
    """
    Add the bound of the squared frequency [1/s^2] by twisting alone, and the energy [J].

    E'' = kappa / 2 (tr Q |b|^2 - b . Q b + dtheta_1 . (Q - Q^T) dtheta_2) with b = dtheta_1 -
    dtheta_2. tr Q - Q has no larger eigenvalue than 1 + cos phi in its symmetric part, and the
    last term is at most sin phi (|dtheta_1|^2 + |dtheta_2|^2), so that E'' is at most kappa
    (2 + 2 cos phi + sin phi) / 2 times the same sum. Half of the energy counts for either end.
    """
    if twisting is None:
        return bound, energy
    else:
        zero = splat(0.0)
        stride = orientation.shape[orientation.ndim - 1]
        own = since_woven(twisting.woven, orientation, s)
        sums, total = zero, zero
        for link in range(12):
            kappa = stiffness_of(
                twisting.stiffness, twisting.variety, links.present[block, link], link, s)
            other = since_woven(
                twisting.woven, orientation, partner_slot(links, stride, block, link))
            sums = fma(kappa, apart(own, other), sums)
            total = total + kappa
        return (
            bound + splat(_TWIST_RATIO * inverse_inertia) * total, energy + splat(0.5) * sums)


@compiled
def apart(e: Nine, g: Nine) -> Vector:
    """
    Return 1 - cos phi between the axes of two bodies, sum |g_i - e_i|^2 / 4, without cancellation.
    """
    total = splat(0.0)
    for k in range(9):
        total = fma(g[k] - e[k], g[k] - e[k], total)
    return splat(0.25) * total
