# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Maxwell arms of connectors: a spring and a dashpot in series, parallel to the connector's own law.

With its own spring a connector is a standard linear solid (Zener 1948): soft in slow deformations,
stiffer in fast ones, dissipative in between. The spring of an arm, of stiffness k_1, has a rest
length q, which is part of the state and creeps towards the length l of the connector:

    tension k_1 (l - q),    dq/dt = (l - q) / tau.

An arm stores k_1 (l - q)^2 / 2 and dissipates k_1 (l - q)^2 / tau. Lengths are bit-identical from
either end, so each end stores its own q, and both stay equal.
"""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    store,
    Vector,
    where,
)
from icofabric_sim.terms.maxwell.record import Maxwell
from icofabric_sim.terms.shared import add_wrench, coefficient_of, Links, SMALLEST_SQUARE, Supports
import numpy as np


@compiled
def add_velocity_force(
    maxwell: Maxwell | None, links: Links | None, supports: Supports | None, inverse_mass: float,
    inverse_inertia: float, rest: np.ndarray | None, slope: np.ndarray, row: int,
    position: np.ndarray, points: np.ndarray, block: int, s: int, spent: Vector
) -> Vector:
    """
    Add the forces of the arms of a block to the slopes of velocity and spin, which end at `row`.

    Slopes of the rest lengths come after these. Return `spent` plus the dissipated power [W]: half
    of that of each arm counts for either end.
    """
    if maxwell is None:
        return spent
    if links is None:
        return spent
    if rest is None:
        return spent
    zero = splat(0.0)
    stride = position.shape[1]
    px, py, pz = load(position, 0, s), load(position, 1, s), load(position, 2, s)
    fx, fy, fz, tx, ty, tz = zero, zero, zero, zero, zero, zero
    taken = zero
    for edge in range(6):
        at = 3 * edge * stride + s
        qx, qy = load_at(points, at), load_at(points, at + stride)
        qz = load_at(points, at + 2 * stride)
        ex, ey, ez = zero, zero, zero
        for link in range(2 * edge, 2 * edge + 2):
            place = links.place[block, link]
            ux, uy = load_at(points, place) - qx, load_at(points, place + stride) - qy
            uz = load_at(points, place + 2 * stride) - qz
            square = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(SMALLEST_SQUARE))
            inverse = rsqrt(square)
            stretch = where(
                bits(links.present[block, link]), square * inverse - load(rest, link, s), zero)
            rate = coefficient_of(maxwell.own_rate, maxwell.rate, link, s)
            creep = rate * stretch
            store(slope, row + link, s, creep)
            pull = coefficient_of(maxwell.own_stiffness, maxwell.stiffness, link, s) * stretch
            taken = fma(pull, creep, taken)
            pull = pull * inverse
            ex, ey, ez = fma(pull, ux, ex), fma(pull, uy, ey), fma(pull, uz, ez)
        ax, ay, az = qx - px, qy - py, qz - pz
        fx, fy, fz = fx + ex, fy + ey, fz + ez
        tx = fma(ay, ez, tx - az * ey)
        ty = fma(az, ex, ty - ax * ez)
        tz = fma(ax, ey, tz - ay * ex)
    add_wrench(
        supports, inverse_mass, inverse_inertia, slope[row - 6:row - 3],
        slope[row - 3:row], s, fx, fy, fz, tx, ty, tz)
    return fma(splat(0.5), taken, spent)
