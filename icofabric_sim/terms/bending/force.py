# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Forces and torques by bending.

The energy is kappa_b (1 - n . d) at each end, with d the unit vector of the connector and n its
direction in the woven fabric, fixed in the body. It is smooth for any rotation, except for a
connector of zero length.
"""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, load, load_at, rsqrt, splat, where
from icofabric_sim.terms.bending.directions import woven_directions
from icofabric_sim.terms.bending.record import Bending
from icofabric_sim.terms.shared import (
    Links,
    partner_slot,
    since_woven,
    Six,
    SMALLEST_SQUARE,
    stiffness_of,
)
import numpy as np


@compiled
def add_force(
    bending: Bending | None, links: Links, position: np.ndarray, orientation: np.ndarray,
    points: np.ndarray, block: int, s: int, wrench: Six
) -> Six:
    """
    Add the resistance to bending to force [N] and torque about the centre [N m] of a block.

    With u = r_2 - r_1, d = u / l, P = 1 - d d^T and n, m the woven direction turned with the own
    body and the other, the energy kappa (2 - (n + m) . d) has the force -kappa / l P (n + m) at
    the own end, and besides its moment the torque kappa n x d. Differences to d are taken first,
    so that close to the woven state nothing cancels.
    """
    if bending is None:
        return wrench
    else:
        fx, fy, fz, tx, ty, tz = wrench
        zero, one = splat(0.0), splat(1.0)
        stride = position.shape[1]
        cx, cy, cz = load(position, 0, s), load(position, 1, s), load(position, 2, s)
        own = since_woven(bending.woven, orientation, s)
        for edge in range(6):
            at = 3 * edge * stride + s
            px, py = load_at(points, at), load_at(points, at + stride)
            pz = load_at(points, at + 2 * stride)
            qx, qy, qz = zero, zero, zero
            for link in range(2 * edge, 2 * edge + 2):
                place = links.place[block, link]
                kappa = stiffness_of(
                    bending.stiffness, bending.variety, links.present[block, link], link, s)
                ux = load_at(points, place) - px
                uy = load_at(points, place + stride) - py
                uz = load_at(points, place + 2 * stride) - pz
                square = fma(ux, ux, fma(uy, uy, uz * uz))
                there = square > splat(SMALLEST_SQUARE)
                inverse = where(there, rsqrt(where(there, square, one)), zero)
                dx, dy, dz = ux * inverse, uy * inverse, uz * inverse
                other = since_woven(
                    bending.woven, orientation, partner_slot(links, stride, block, link))
                nx, ny, nz, mx, my, mz = woven_directions(bending, own, other, link, s)
                nx, ny, nz = nx - dx, ny - dy, nz - dz
                mx, my, mz = nx + (mx - dx), ny + (my - dy), nz + (mz - dz)
                along = fma(mx, dx, fma(my, dy, mz * dz))
                factor = kappa * inverse
                qx = qx + factor * (along * dx - mx)
                qy = qy + factor * (along * dy - my)
                qz = qz + factor * (along * dz - mz)
                kappa = where(there, kappa, zero)
                tx = fma(kappa, ny * dz - nz * dy, tx)
                ty = fma(kappa, nz * dx - nx * dz, ty)
                tz = fma(kappa, nx * dy - ny * dx, tz)
            fx, fy, fz = fx + qx, fy + qy, fz + qz
            px, py, pz = px - cx, py - cy, pz - cz
            tx = fma(py, qz, tx - pz * qy)
            ty = fma(pz, qx, ty - px * qz)
            tz = fma(px, qy, tz - py * qx)
        return fx, fy, fz, tx, ty, tz
