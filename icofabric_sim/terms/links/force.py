# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Connectors as linear springs between points of two bodies, as a rule edge midpoints (eqs 1, 49).

Every body adds up the forces at its own edges, so each spring is computed twice, once from either
end, with exactly opposite results. The second evaluation costs less than half of what it saves.
Nothing is scattered, so several bodies are computed at once and in any order, by any number of
threads.
"""

from typing import Any

from icofabric_sim.kernels.runtime.compiled import compiled, inlined
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
from icofabric_sim.terms.laws import Laws, replace_factor
from icofabric_sim.terms.links.kinks import Kinks
from icofabric_sim.terms.shared import Links, Six, SMALLEST_SQUARE, Variety
import numpy as np


@inlined
def add_force(
    links: Links | None, kinks: Kinks | None, part: float, points: np.ndarray,
    position: np.ndarray, block: int, s: int
) -> Six:
    """
    Return force [N] and torque about the centre [N m] on the block at slot `s`, world frame.

    `points` holds the attachment points of all bodies. With `kinks`, at a fraction `part` of a
    step in which each connector keeps its slope.
    """
    if links is None:
        zero = splat(0.0)
        return zero, zero, zero, zero, zero, zero
    return alike_or_not(kinks, links, part, points, position, block, s)


@inlined
def alike_or_not(
    kinks: Kinks | None, links: Links, part: float, points: np.ndarray, position: np.ndarray,
    block: int, s: int
) -> Six:
    """
    Return the wrench of all connectors; as plain springs if all are alike and far from kinks.
    """
    if kinks is None:
        return pulls(
            links.attachment, links, None, part, links.variety, links.stiffness,
            links.natural_length, points, position, block, s)
    else:
        if kinks.alike[0] > 0.0:
            return pulls(
                links.attachment, links, None, part, None, kinks.alike[0], kinks.alike[1],
                points, position, block, s)
        return pulls(
            links.attachment, links, kinks, part, links.variety, links.stiffness,
            links.natural_length, points, position, block, s)


@inlined
def pulls(
    attachment: np.ndarray | None, links: Links, kinks: Kinks | None, part: float,
    variety: Variety | None, stiffness: float, natural_length: float, points: np.ndarray,
    position: np.ndarray, block: int, s: int
) -> Six:
    """Return the wrench of connectors that attach on the body axes, or anywhere."""
    k, minus_rest = splat(stiffness), splat(-stiffness * natural_length)
    if attachment is None:
        return pulls_on_axes(
            links, kinks, part, variety, k, minus_rest, points, position.shape[1], block, s)
    else:
        return pulls_anywhere(
            links, kinks, part, variety, k, minus_rest, points, position, block, s)


@compiled
def pulls_anywhere(
    links: Links, kinks: Kinks | None, part: float, variety: Variety | None, stiffness: Vector,
    minus_rest: Vector, points: np.ndarray, position: np.ndarray, block: int, s: int
) -> Six:
    """Return the wrench of connectors with any attachment points."""
    zero, stride = splat(0.0), position.shape[1]
    fx, fy, fz, tx, ty, tz = zero, zero, zero, zero, zero, zero
    x, y, z = load(position, 0, s), load(position, 1, s), load(position, 2, s)
    for edge in range(6):
        at = 3 * edge * stride + s
        px, py = load_at(points, at), load_at(points, at + stride)
        pz = load_at(points, at + 2 * stride)
        ax, ay, az = edge_pull(
            links, kinks, part, variety, points, stride, block, s, 2 * edge, stiffness,
            minus_rest, px, py, pz)
        fx, fy, fz = fx + ax, fy + ay, fz + az
        sx, sy, sz = px - x, py - y, pz - z
        tx = fma(sy, az, tx - sz * ay)
        ty = fma(sz, ax, ty - sx * az)
        tz = fma(sx, ay, tz - sy * ax)
    return fx, fy, fz, tx, ty, tz


@inlined
def pulls_on_axes(
    links: Links, kinks: Kinks | None, part: float, variety: Variety | None, stiffness: Vector,
    minus_rest: Vector, points: np.ndarray, stride: int, block: int, s: int
) -> Six:
    """
    Return the wrench of connectors whose points lie on the body axes, symmetric about the centre.

    `stride`: the number of slots in each row of `points`.
    """
    zero = splat(0.0)
    fx, fy, fz, tx, ty, tz = zero, zero, zero, zero, zero, zero
    for pair in range(3):
        at = 6 * pair * stride + s
        px, py = load_at(points, at), load_at(points, at + stride)
        pz, mx = load_at(points, at + 2 * stride), load_at(points, at + 3 * stride)
        my, mz = load_at(points, at + 4 * stride), load_at(points, at + 5 * stride)
        ax, ay, az = edge_pull(
            links, kinks, part, variety, points, stride, block, s, 4 * pair, stiffness,
            minus_rest, px, py, pz)
        bx, by, bz = edge_pull(
            links, kinks, part, variety, points, stride, block, s, 4 * pair + 2, stiffness,
            minus_rest, mx, my, mz)
        fx, fy, fz = fx + (ax + bx), fy + (ay + by), fz + (az + bz)
        # Both arms lie on one axis of the body: arm x (force at the first - force at the second),
        # with twice the arm here.
        sx, sy, sz = px - mx, py - my, pz - mz
        ax, ay, az = ax - bx, ay - by, az - bz
        tx = fma(sy, az, tx - sz * ay)
        ty = fma(sz, ax, ty - sx * az)
        tz = fma(sx, ay, tz - sy * ax)
    half = splat(0.5)
    return fx, fy, fz, half * tx, half * ty, half * tz


@compiled
def arm_of(
    attachment: np.ndarray | None, points: np.ndarray, position: np.ndarray, edge: int, s: int
) -> tuple[Vector, Vector, Vector]:
    """Return arms [m] from the centres of a block to an attachment point, world frame."""
    stride = position.shape[1]
    at = 3 * edge * stride + s
    if attachment is None:
        half, across = splat(0.5), 3 * (edge ^ 1) * stride + s
        return (
            half * (load_at(points, at) - load_at(points, across)),
            half * (load_at(points, at + stride) - load_at(points, across + stride)),
            half * (load_at(points, at + 2 * stride) - load_at(points, across + 2 * stride)))
    else:
        return (
            load_at(points, at) - load(position, 0, s),
            load_at(points, at + stride) - load(position, 1, s),
            load_at(points, at + 2 * stride) - load(position, 2, s))


@inlined
def edge_pull(
    links: Links, kinks: Kinks | None, part: float, variety: Variety | None, points: np.ndarray,
    stride: int, block: int, s: int, first_link: int, stiffness: Vector, minus_rest: Vector,
    px: Vector, py: Vector, pz: Vector
) -> tuple[Vector, Vector, Vector]:
    """Return the force [N] of the two connectors at one edge, whose points are p."""
    zero = splat(0.0)
    fx, fy, fz = zero, zero, zero
    for link in range(first_link, first_link + 2):
        place = links.place[block, link]
        ux = load_at(points, place) - px
        uy = load_at(points, place + stride) - py
        uz = load_at(points, place + 2 * stride) - pz
        square = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(SMALLEST_SQUARE))
        there = bits(links.present[block, link])
        factor = law_factor(
            links.laws, kinks, part, variety, block, link, s, square, there, stiffness,
            minus_rest)
        factor = where(there, factor, zero)
        fx, fy, fz = fma(factor, ux, fx), fma(factor, uy, fy), fma(factor, uz, fz)
    return fx, fy, fz


@inlined
def law_factor(
    laws: Laws | None, kinks: Kinks | None, part: float, variety: Variety | None,
    block: int, link: int, s: int, square: Vector, there: Any, stiffness: Vector,
    minus_rest: Vector
) -> Vector:
    """Return tension over length [N/m] at a squared length `square`; `there` masks the lanes."""
    factor = step_factor(kinks, part, variety, block, link, s, square, stiffness, minus_rest)
    if variety is None:
        # All are springs.
        return factor
    else:
        return replace_factor(laws, variety, link, s, square, there, factor)


@inlined
def step_factor(
    kinks: Kinks | None, part: float, variety: Variety | None, block: int, link: int, s: int,
    square: Vector, stiffness: Vector, minus_rest: Vector
) -> Vector:
    """
    Return tension over length [N/m]; with `kinks`, on the side on which the step began.

    The tension then includes what crossings add at the fraction `part` of the step, see
    kernels/kinks.py.
    """
    if kinks is None:
        return pull_factor(variety, link, s, square, stiffness, minus_rest)
    else:
        slope, rest = load(kinks.slope, link, s), load(kinks.natural_length, link, s)
        tension = splat(0.0) - slope * rest
        if kinks.active[block, link] != 0:
            tension = tension + crossing_force(kinks, link, s, part)
        return fma(tension, rsqrt(square), slope)


@inlined
def crossing_force(kinks: Kinks, link: int, s: int, part: float) -> Vector:
    """Return the tension [N] that crossings add at the fraction `part` of the step."""
    x = splat(part)
    value = fma(x, load(kinks.forces, 36 + link, s), load(kinks.forces, 24 + link, s))
    return fma(x, fma(x, value, load(kinks.forces, 12 + link, s)), load(kinks.forces, link, s))


@compiled
def pull_factor(
    variety: Variety | None, link: int, s: int, square: Vector, stiffness: Vector,
    minus_rest: Vector
) -> Vector:
    """
    Return tension over length, k (l - D) / l [N/m], of a connector of squared length `square`.

    k is k_e above the natural length and k_c below (eq 2, where at D either holds).
    """
    if variety is None:
        return fma(minus_rest, rsqrt(square), stiffness)
    else:
        k, rest = slope_of(variety, link, s, square)
        return fma(splat(0.0) - k * rest, rsqrt(square), k)


@compiled
def slope_of(variety: Variety, link: int, s: int, square: Vector) -> tuple[Vector, Vector]:
    """
    Return slope k_e or k_c [N/m] and natural length [m] of a connector with an individual law.
    """
    rest = load(variety.natural_length, link, s)
    k = where(
        square > rest * rest, load(variety.extension, link, s),
        load(variety.compression, link, s))
    return k, rest
