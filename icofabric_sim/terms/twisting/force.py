# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Torques by twisting.

The energy is kappa_t (1 - cos phi), with phi the angle of the rotation of one body against the
other since the weave, 1 - cos phi = (3 - tr Q) / 2.
"""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, splat
from icofabric_sim.terms.shared import Links, partner_slot, since_woven, Six, stiffness_of
from icofabric_sim.terms.twisting.record import Twisting
import numpy as np


@compiled
def add_force(
    twisting: Twisting | None, links: Links, orientation: np.ndarray, block: int, s: int,
    wrench: Six
) -> Six:
    """
    Add the resistance to twisting to the torques [N m] of a block: kappa sin(phi) about its axis.

    With e_i and g_i the axes of the own body and the other, Q = sum g_i e_i^T and sin(phi) times
    its axis is sum e_i x g_i / 2.
    """
    if twisting is None:
        return wrench
    else:
        fx, fy, fz, tx, ty, tz = wrench
        half = splat(0.5)
        stride = orientation.shape[orientation.ndim - 1]
        e = since_woven(twisting.woven, orientation, s)
        for link in range(12):
            kappa = half * stiffness_of(
                twisting.stiffness, twisting.variety, links.present[block, link], link, s)
            g = since_woven(
                twisting.woven, orientation, partner_slot(links, stride, block, link))
            # Without fused operations, so that the torque from the other end is exactly opposite.
            x = e[1] * g[2] - e[2] * g[1] + (e[4] * g[5] - e[5] * g[4]) + (
                e[7] * g[8] - e[8] * g[7])
            y = e[2] * g[0] - e[0] * g[2] + (e[5] * g[3] - e[3] * g[5]) + (
                e[8] * g[6] - e[6] * g[8])
            z = e[0] * g[1] - e[1] * g[0] + (e[3] * g[4] - e[4] * g[3]) + (
                e[6] * g[7] - e[7] * g[6])
            tx, ty, tz = fma(kappa, x, tx), fma(kappa, y, ty), fma(kappa, z, tz)
        return fx, fy, fz, tx, ty, tz
