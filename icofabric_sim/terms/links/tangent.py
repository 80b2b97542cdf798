# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Product of the Hessian of the energy of connectors with small motions."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    Vector,
    where,
)
from icofabric_sim.terms.laws import replace_largest_slope, replace_pull
from icofabric_sim.terms.links.force import arm_of, slope_of
from icofabric_sim.terms.shared import Links, Six, SMALLEST_SQUARE, Variety
import numpy as np


@compiled
def add_product(
    links: Links | None, points: np.ndarray, position: np.ndarray, moved: np.ndarray,
    motion: Six, block: int, s: int
) -> Six:
    """
    Return the second derivative of the energy along a motion, for the bodies of a block.

    The configuration is x + dx, exp(dtheta) R; with u = r_2 - r_1, n = u / l, f = k (l - D), s_i
    the arms: d2E = du.G du + f n.[dtheta_2 x (dtheta_2 x s_2) - dtheta_1 x (dtheta_1 x s_1)],
    where du = du_2 - du_1, du_i = dx_i + dtheta_i x s_i and G = k n n^T + f/l (1 - n n^T).
    The form is symmetric also out of equilibrium. Either end counts as the first for its own body.
    """
    zero = splat(0.0)
    fx, fy, fz, mx, my, mz = zero, zero, zero, zero, zero, zero
    if links is None:
        return fx, fy, fz, mx, my, mz
    _, _, _, tx, ty, tz = motion
    half, stride = splat(0.5), position.shape[1]
    stiffness, minus_rest = splat(links.stiffness), splat(-links.natural_length)
    for edge in range(6):
        sx, sy, sz = arm_of(links.attachment, points, position, edge, s)
        at = 3 * edge * stride + s
        for link in range(2 * edge, 2 * edge + 2):
            place = links.place[block, link]
            there = bits(links.present[block, link])
            ux = load_at(points, place) - load_at(points, at)
            uy = load_at(points, place + stride) - load_at(points, at + stride)
            uz = load_at(points, place + 2 * stride) - load_at(points, at + 2 * stride)
            vx = load_at(moved, place) - load_at(moved, at)
            vy = load_at(moved, place + stride) - load_at(moved, at + stride)
            vz = load_at(moved, place + 2 * stride) - load_at(moved, at + 2 * stride)
            # A connector of zero length has no direction and adds nothing.
            square = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(SMALLEST_SQUARE))
            inverse = where(
                there, where(square > splat(SMALLEST_SQUARE), rsqrt(square), zero), zero)
            k, pull = slope_and_pull(
                links.variety, link, s, square, inverse, stiffness, minus_rest)
            length = square * inverse
            pull = replace_pull(links.laws, links.variety, link, s, length, pull)
            k = replace_largest_slope(links.laws, links.variety, link, s, length, k)
            pull = where(inverse > zero, pull, zero)
            nx, ny, nz = ux * inverse, uy * inverse, uz * inverse
            along = fma(nx, vx, fma(ny, vy, nz * vz))
            across = pull * inverse
            # k along n + f/l (du - along n); n is 0 where there is no connector.
            more = (k - across) * along
            gx, gy, gz = fma(more, nx, across * vx), fma(more, ny, across * vy), fma(
                more, nz, across * vz)
            fx, fy, fz = fx - gx, fy - gy, fz - gz
            ns = fma(nx, sx, fma(ny, sy, nz * sz))
            nt = half * fma(nx, tx, fma(ny, ty, nz * tz))
            st = half * fma(sx, tx, fma(sy, ty, sz * tz))
            mx = mx - (sy * gz - sz * gy) - pull * (nx * st + sx * nt - ns * tx)
            my = my - (sz * gx - sx * gz) - pull * (ny * st + sy * nt - ns * ty)
            mz = mz - (sx * gy - sy * gx) - pull * (nz * st + sz * nt - ns * tz)
    return fx, fy, fz, mx, my, mz


@compiled
def slope_and_pull(
    variety: Variety | None, link: int, s: int, square: Vector, inverse: Vector,
    stiffness: Vector, minus_rest: Vector
) -> tuple[Vector, Vector]:
    """
    Return slope of the tension [N/m] and tension [N] of a connector of squared length `square`.
    """
    if variety is None:
        return stiffness, stiffness * fma(square, inverse, minus_rest)
    else:
        k, rest = slope_of(variety, link, s, square)
        # The larger of k_e and k_c: a step has to be stable on either side of the natural length.
        most = maximum(load(variety.extension, link, s), load(variety.compression, link, s))
        return most, k * (square * inverse - rest)
