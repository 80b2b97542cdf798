# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Connectors that also resist bending at their ends, and twisting of their two bodies.

Bending: kappa_b (1 - n . d) at each end, with d the unit vector of the connector and n its
direction in the woven fabric, fixed in the body. Twisting: kappa_t (1 - cos phi), with phi the
angle of the rotation of one body against the other since then, 1 - cos phi = (3 - tr Q) / 2. Both
are smooth for any rotation, except for a connector of zero length. Like springs they are computed
from either end with opposite forces.
"""

from icofabric_sim.kernels.connectors import Six
from icofabric_sim.kernels.records import Bending, Links, Moments, Twisting
from icofabric_sim.kernels.rotations import axes_of_lanes, Nine, on_axes, Three
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    load,
    load_at,
    rsqrt,
    splat,
    Vector,
    where,
)
import numpy as np

# Squared lengths [m^2] up to this bound have no direction and no bending moment.
_SMALLEST_SQUARE = 1e-300


@compiled
def partner_slot(links: Links, stride: int, block: int, link: int) -> int:
    """
    Return the slot of lane 0's partner; a connector ends at the edge opposite to its first edge.
    """
    slot: int = links.place[block, link] - 3 * ((link >> 1) ^ 1) * stride
    return slot


@compiled
def stiffness_of(
    uniform: float, variety: np.ndarray | None, present: int, link: int, s: int
) -> Vector:
    """Return the stiffness [N m/rad] of a connector against a moment, 0 without a connector."""
    if variety is None:
        return where(bits(present), splat(uniform), splat(0.0))
    else:
        return where(bits(present), load(variety, link, s), splat(0.0))


@compiled
def since_woven(woven: np.ndarray | None, orientation: np.ndarray, s: int) -> Nine:
    """
    Return the rotation of each body since the woven state, by columns, in world components.

    Columns are the body axes, or, if `woven` orientations differ, the turned world axes.
    """
    if woven is None:
        return axes_of_lanes(orientation, s)
    else:
        e = axes_of_lanes(orientation, s)
        a = (load(woven, 0, s), load(woven, 1, s), load(woven, 2, s))
        b = (load(woven, 3, s), load(woven, 4, s), load(woven, 5, s))
        c = (load(woven, 6, s), load(woven, 7, s), load(woven, 8, s))
        x = on_axes(e, a[0], b[0], c[0])
        y = on_axes(e, a[1], b[1], c[1])
        z = on_axes(e, a[2], b[2], c[2])
        return x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]


@compiled
def woven_direction(
    direction: np.ndarray, directions: np.ndarray | None, link: int, s: int
) -> Three:
    """Return the direction of a connector in the woven fabric, in the axes of `since_woven`."""
    if directions is None:
        return splat(direction[link, 0]), splat(direction[link, 1]), splat(direction[link, 2])
    else:
        return (
            load(directions, 3 * link, s), load(directions, 3 * link + 1, s),
            load(directions, 3 * link + 2, s))


@compiled
def woven_directions(
    bending: Bending, own: Nine, other: Nine, link: int, s: int
) -> tuple[Vector, Vector, Vector, Vector, Vector, Vector]:
    """Return the woven direction turned with its own body and with the other, world components."""
    x, y, z = woven_direction(bending.direction, bending.directions, link, s)
    nx, ny, nz = on_axes(own, x, y, z)
    mx, my, mz = on_axes(other, x, y, z)
    return nx, ny, nz, mx, my, mz


@compiled
def add_bending(
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
                there = square > splat(_SMALLEST_SQUARE)
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


@compiled
def add_twisting(
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


@compiled
def apart(e: Nine, g: Nine) -> Vector:
    """
    Return 1 - cos phi between the axes of two bodies, sum |g_i - e_i|^2 / 4, without cancellation.
    """
    total = splat(0.0)
    for k in range(9):
        total = fma(g[k] - e[k], g[k] - e[k], total)
    return splat(0.25) * total


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
            d = (ends[c, 1, k] - ends[c, 0, k]) / np.sqrt(max(square, _SMALLEST_SQUARE))
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
