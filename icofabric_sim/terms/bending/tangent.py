# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Second derivative of the energy of bending along small motions.

The configuration is x + dx, exp(dtheta) R, as in kernels/hessian.py. Either end counts as the
first for its own body.
"""

from icofabric_sim.kernels.rotations import Three
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, load, load_at, rsqrt, splat, Vector, where
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
def add_product(
    bending: Bending | None, links: Links, position: np.ndarray, orientation: np.ndarray,
    points: np.ndarray, moved: np.ndarray, turns: np.ndarray, block: int, s: int, total: Six
) -> Six:
    """
    Add the product for bending; `turns` (3, s) holds the rotation vectors of all bodies.

    With a = du_2 - du_1, w = n + m (see force.py), w' = dtheta_1 x n + dtheta_2 x m, P = 1 -
    d d^T, b = P w / l: of E = -kappa w . d, G a = kappa / l [d (b . a) + b (d . a) + (w . d) / l
    P a], g = G a - kappa / l P w'. The own rows are -g and -s x g - kappa / l n x P a, plus the
    second derivatives of the arm s (with the force -kappa b) and of n (with -kappa d).
    """
    if bending is None:
        return total
    else:
        zero, one = splat(0.0), splat(1.0)
        stride = position.shape[1]
        own = since_woven(bending.woven, orientation, s)
        turn = (load(turns, 0, s), load(turns, 1, s), load(turns, 2, s))
        fx, fy, fz, tx, ty, tz = total
        for link in range(12):
            at, place = 3 * (link >> 1) * stride + s, links.place[block, link]
            there = partner_slot(links, stride, block, link)
            kappa = stiffness_of(
                bending.stiffness, bending.variety, links.present[block, link], link, s)
            p = (
                load_at(points, at), load_at(points, at + stride),
                load_at(points, at + 2 * stride))
            u = (
                load_at(points, place) - p[0], load_at(points, place + stride) - p[1],
                load_at(points, place + 2 * stride) - p[2])
            a = (
                load_at(moved, place) - load_at(moved, at),
                load_at(moved, place + stride) - load_at(moved, at + stride),
                load_at(moved, place + 2 * stride) - load_at(moved, at + 2 * stride))
            arm = (
                p[0] - load(position, 0, s), p[1] - load(position, 1, s),
                p[2] - load(position, 2, s))
            square = inner(u, u)
            far = square > splat(SMALLEST_SQUARE)
            kappa = where(far, kappa, zero)
            inverse = where(far, rsqrt(where(far, square, one)), zero)
            d = (u[0] * inverse, u[1] * inverse, u[2] * inverse)
            nx, ny, nz, mx, my, mz = woven_directions(
                bending, own, since_woven(bending.woven, orientation, there), link, s)
            n, m = (nx, ny, nz), (mx, my, mz)
            other = (load(turns, 0, there), load(turns, 1, there), load(turns, 2, there))
            v, w = cross(turn, n), cross(other, m)
            w = (v[0] + w[0], v[1] + w[1], v[2] + w[2])
            along = inner(n, d) + inner(m, d)
            b = (
                inverse * (nx + mx - along * d[0]), inverse * (ny + my - along * d[1]),
                inverse * (nz + mz - along * d[2]))
            ad, wd = inner(a, d), inner(w, d)
            # P a / l and P w'.
            pa = (
                inverse * (a[0] - ad * d[0]), inverse * (a[1] - ad * d[1]),
                inverse * (a[2] - ad * d[2]))
            ba = inner(b, a)
            factor = kappa * inverse
            g = (
                factor * (fma(ba, d[0], fma(ad, b[0], along * pa[0])) - (w[0] - wd * d[0])),
                factor * (fma(ba, d[1], fma(ad, b[1], along * pa[1])) - (w[1] - wd * d[1])),
                factor * (fma(ba, d[2], fma(ad, b[2], along * pa[2])) - (w[2] - wd * d[2])))
            fx, fy, fz = fx - g[0], fy - g[1], fz - g[2]
            c, e = cross(arm, g), cross(n, pa)
            f, h = turned_twice(turn, arm, b), turned_twice(turn, n, d)
            tx = tx - c[0] + kappa * (f[0] - e[0] - h[0])
            ty = ty - c[1] + kappa * (f[1] - e[1] - h[1])
            tz = tz - c[2] + kappa * (f[2] - e[2] - h[2])
        return fx, fy, fz, tx, ty, tz


@compiled
def cross(a: Three, b: Three) -> Three:
    """Return the cross product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def inner(a: Three, b: Three) -> Vector:
    """Return the scalar product."""
    return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2]))


@compiled
def turned_twice(turn: Three, arm: Three, along: Three) -> Three:
    """Return half the gradient over `turn` of along . [turn x (turn x arm)]."""
    half = splat(0.5)
    first, second, third = half * inner(turn, arm), half * inner(turn, along), inner(along, arm)
    return (
        fma(along[0], first, fma(arm[0], second, splat(0.0) - third * turn[0])),
        fma(along[1], first, fma(arm[1], second, splat(0.0) - third * turn[1])),
        fma(along[2], first, fma(arm[2], second, splat(0.0) - third * turn[2])))
