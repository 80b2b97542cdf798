# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Energy of Maxwell arms and the bound of their frequency."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fabs,
    fma,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    Vector,
    where,
)
from icofabric_sim.terms.maxwell.record import Maxwell
from icofabric_sim.terms.shared import coefficient_of, Links, SMALLEST_SQUARE
import numpy as np


@compiled
def add_bound(
    maxwell: Maxwell | None, links: Links | None, inverse_mass: float, inverse_inertia: float,
    rest: np.ndarray | None, position: np.ndarray, points: np.ndarray, block: int, s: int,
    bound: Vector, energy: Vector
) -> tuple[Vector, Vector]:
    """
    Add the bound of the squared frequency [1/s^2] of arms of a block; add their energy [J].

    The bound is that of connectors (kernels/frequency_bound.py) with (n . du)^2 <= |du|^2. Half of
    the energy of each arm counts for either end.
    """
    if maxwell is None:
        return bound, energy
    if links is None:
        return bound, energy
    if rest is None:
        return bound, energy
    zero, stride = splat(0.0), position.shape[1]
    spread = splat(2.0 * (inverse_mass + links.half_width**2 * inverse_inertia))
    moment = splat(links.half_width * inverse_inertia)
    total, stored = zero, zero
    for edge in range(6):
        at = 3 * edge * stride + s
        for link in range(2 * edge, 2 * edge + 2):
            place = links.place[block, link]
            there = bits(links.present[block, link])
            ux = load_at(points, place) - load_at(points, at)
            uy = load_at(points, place + stride) - load_at(points, at + stride)
            uz = load_at(points, place + 2 * stride) - load_at(points, at + 2 * stride)
            square = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(SMALLEST_SQUARE))
            inverse = rsqrt(square)
            stretch = where(there, square * inverse - load(rest, link, s), zero)
            k = coefficient_of(maxwell.own_stiffness, maxwell.stiffness, link, s)
            pull = k * stretch
            stored = fma(pull, stretch, stored)
            stiff = k + maximum(pull, zero) * inverse
            total = total + where(there, fma(spread, stiff, moment * fabs(pull)), zero)
    return bound + total, energy + splat(0.25) * stored
