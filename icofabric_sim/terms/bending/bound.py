# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Energy of bending and the bound of its frequency."""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    fabs,
    fma,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    sqrt,
    Vector,
)
from icofabric_sim.terms.bending.directions import woven_directions
from icofabric_sim.terms.bending.record import Bending
from icofabric_sim.terms.shared import (
    Links,
    partner_slot,
    since_woven,
    SMALLEST_SQUARE,
    stiffness_of,
)
import numpy as np

# Largest |d''| l^2 / |u'|^2 of the unit vector d of u: sqrt(p (4 - 3 p)) at p = 2/3, twice for
# |u'|^2 <= 2 |du_1|^2 + 2 |du_2|^2.
_CURVATURE_RATIO = 4.0 / math.sqrt(3.0)


@compiled
def add_bound(
    bending: Bending | None, links: Links, inverse_mass: float, inverse_inertia: float,
    position: np.ndarray, orientation: np.ndarray, points: np.ndarray, block: int, s: int,
    bound: Vector, energy: Vector
) -> tuple[Vector, Vector]:
    """
    Add the bound of the squared frequency [1/s^2] by bending alone of a block, and its energy [J].

    With E = kappa |n - d|^2 / 2 for each end, E'' = kappa |n' - d'|^2 + kappa (n - d) . (n'' -
    d''). In the first term n' - d' = x_1 - y_2, with x_1 = dtheta_1 x n + P du_1 / l of the own
    body, y_2 = P du_2 / l of the other, and |x - y|^2 <= 2 x^2 + 2 y^2: a block-diagonal form, its
    largest eigenvalue bounded by the largest absolute row sum. In the second |n''| <=
    |dtheta|^2 and |d''| <= 2 / sqrt(3) |u'|^2 / l^2 + |s| (|dtheta_1|^2 + |dtheta_2|^2) / l. The
    sum of the bounds of two energies bounds that of their sum.
    """
    if bending is None:
        return bound, energy
    else:
        zero = splat(0.0)
        stride = position.shape[1]
        root_m, root_i = splat(math.sqrt(inverse_mass)), splat(math.sqrt(inverse_inertia))
        cx, cy, cz = load(position, 0, s), load(position, 1, s), load(position, 2, s)
        own = since_woven(bending.woven, orientation, s)
        total, rest = zero, zero
        sums = (
            zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero,
            zero, zero, zero, zero, zero, zero, zero)
        for link in range(12):
            at = 3 * (link >> 1) * stride + s
            px, py = load_at(points, at), load_at(points, at + stride)
            pz = load_at(points, at + 2 * stride)
            sx, sy, sz = px - cx, py - cy, pz - cz
            place = links.place[block, link]
            kappa = stiffness_of(
                bending.stiffness, bending.variety, links.present[block, link], link, s)
            ux, uy = load_at(points, place) - px, load_at(points, place + stride) - py
            uz = load_at(points, place + 2 * stride) - pz
            square = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(SMALLEST_SQUARE))
            inverse = rsqrt(square)
            d = (ux * inverse, uy * inverse, uz * inverse)
            other = since_woven(
                bending.woven, orientation, partner_slot(links, stride, block, link))
            nx, ny, nz, mx, my, mz = woven_directions(bending, own, other, link, s)
            ex, ey, ez = nx - d[0], ny - d[1], nz - d[2]
            mx, my, mz = mx - d[0], my - d[1], mz - d[2]
            bent = fma(ex, ex, fma(ey, ey, ez * ez))
            far = fma(mx, mx, fma(my, my, mz * mz))
            total = fma(kappa, bent, total)
            # Terms that vanish in the woven state.
            bent = sqrt(bent)
            both = bent + sqrt(far)
            arm = fma(sx, sx, fma(sy, sy, sz * sz))
            near = splat(inverse_mass) + arm * splat(inverse_inertia)
            more = fma(
                both, fma(splat(_CURVATURE_RATIO) * inverse * inverse, near,
                          sqrt(arm) * inverse * splat(inverse_inertia)),
                bent * splat(inverse_inertia))
            rest = fma(kappa, more, rest)
            weight = sqrt(kappa + kappa)
            for k in range(3):
                qx = splat(1.0 if k == 0 else 0.0) - d[k] * d[0]
                qy = splat(1.0 if k == 1 else 0.0) - d[k] * d[1]
                qz = splat(1.0 if k == 2 else 0.0) - d[k] * d[2]
                flat = weight * inverse
                a, b, c = flat * qx * root_m, flat * qy * root_m, flat * qz * root_m
                tx, ty, tz = sy * qz - sz * qy, sz * qx - sx * qz, sx * qy - sy * qx
                tx, ty, tz = flat * tx, flat * ty, flat * tz
                sums = gram(sums, a, b, c, tx * root_i, ty * root_i, tz * root_i)
                # n x e_k.
                if k == 0:
                    ty, tz = fma(weight, nz, ty), tz - weight * ny
                elif k == 1:
                    tx, tz = tx - weight * nz, fma(weight, nx, tz)
                else:
                    tx, ty = fma(weight, ny, tx), ty - weight * nx
                sums = gram(sums, a, b, c, tx * root_i, ty * root_i, tz * root_i)
        return bound + (largest_row(sums) + rest), energy + splat(0.5) * total


@compiled
def gram(
    b: tuple[Vector, ...], r0: Vector, r1: Vector, r2: Vector, r3: Vector, r4: Vector, r5: Vector
) -> tuple[Vector, ...]:
    """Add r r^T to a symmetric 6 x 6 matrix, given by the 21 elements of its upper half."""
    return (
        fma(r0, r0, b[0]), fma(r0, r1, b[1]), fma(r0, r2, b[2]), fma(r0, r3, b[3]),
        fma(r0, r4, b[4]), fma(r0, r5, b[5]), fma(r1, r1, b[6]), fma(r1, r2, b[7]),
        fma(r1, r3, b[8]), fma(r1, r4, b[9]), fma(r1, r5, b[10]), fma(r2, r2, b[11]),
        fma(r2, r3, b[12]), fma(r2, r4, b[13]), fma(r2, r5, b[14]), fma(r3, r3, b[15]),
        fma(r3, r4, b[16]), fma(r3, r5, b[17]), fma(r4, r4, b[18]), fma(r4, r5, b[19]),
        fma(r5, r5, b[20]))


@compiled
def largest_row(b: tuple[Vector, ...]) -> Vector:
    """
    Return the largest absolute row sum of a matrix of `gram`, whose diagonal is not negative.
    """
    b1, b2, b3, b4, b5 = fabs(b[1]), fabs(b[2]), fabs(b[3]), fabs(b[4]), fabs(b[5])
    b7, b8, b9, b10 = fabs(b[7]), fabs(b[8]), fabs(b[9]), fabs(b[10])
    b12, b13, b14 = fabs(b[12]), fabs(b[13]), fabs(b[14])
    b16, b17, b19 = fabs(b[16]), fabs(b[17]), fabs(b[19])
    largest = maximum(b[0] + b1 + b2 + b3 + b4 + b5, b1 + b[6] + b7 + b8 + b9 + b10)
    largest = maximum(largest, b2 + b7 + b[11] + b12 + b13 + b14)
    largest = maximum(largest, b3 + b8 + b12 + b[15] + b16 + b17)
    largest = maximum(largest, b4 + b9 + b13 + b16 + b[18] + b19)
    return maximum(largest, b5 + b10 + b14 + b17 + b19 + b[20])
