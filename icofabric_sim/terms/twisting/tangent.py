# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Second derivative of the energy of twisting along small motions."""

from icofabric_sim.kernels.rotations import Three
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, load, splat, Vector
from icofabric_sim.terms.shared import Links, partner_slot, since_woven, Six, stiffness_of
from icofabric_sim.terms.twisting.record import Twisting
import numpy as np


@compiled
def add_product(
    twisting: Twisting | None, links: Links, orientation: np.ndarray, turns: np.ndarray,
    block: int, s: int, total: Six
) -> Six:
    """
    Add the product for twisting: kappa / 2 [tr Q (t_1 - t_2) - (Q + Q^T) t_1 / 2 + Q t_2].

    Q = sum g_i e_i^T, e_i and g_i the axes of the own body and the other, t the rotation vectors.
    """
    if twisting is None:
        return total
    else:
        half = splat(0.5)
        stride = orientation.shape[orientation.ndim - 1]
        own = since_woven(twisting.woven, orientation, s)
        turn = (load(turns, 0, s), load(turns, 1, s), load(turns, 2, s))
        fx, fy, fz, tx, ty, tz = total
        for link in range(12):
            there = partner_slot(links, stride, block, link)
            kappa = half * stiffness_of(
                twisting.stiffness, twisting.variety, links.present[block, link], link, s)
            axes = since_woven(twisting.woven, orientation, there)
            other = (load(turns, 0, there), load(turns, 1, there), load(turns, 2, there))
            trace, x, y, z = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
            for i in range(3):
                e = (own[3 * i], own[3 * i + 1], own[3 * i + 2])
                g = (axes[3 * i], axes[3 * i + 1], axes[3 * i + 2])
                trace = trace + inner(e, g)
                on_g = inner(e, other) - half * inner(e, turn)
                on_e = half * inner(g, turn)
                x = x + (g[0] * on_g - e[0] * on_e)
                y = y + (g[1] * on_g - e[1] * on_e)
                z = z + (g[2] * on_g - e[2] * on_e)
            tx = fma(kappa, fma(trace, turn[0] - other[0], x), tx)
            ty = fma(kappa, fma(trace, turn[1] - other[1], y), ty)
            tz = fma(kappa, fma(trace, turn[2] - other[2], z), tz)
        return fx, fy, fz, tx, ty, tz


@compiled
def inner(a: Three, b: Three) -> Vector:
    """Return the scalar product."""
    return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2]))
