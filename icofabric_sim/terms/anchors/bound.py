# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Bounds of the frequencies of anchored bodies, and the energies of anchors."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fabs,
    fma,
    maximum,
    rsqrt,
    splat,
    Vector,
    where,
)
from icofabric_sim.terms.anchors.force import anchor_of, reach_of, tension_of
from icofabric_sim.terms.anchors.record import Anchors
from icofabric_sim.terms.loads import Loads
from icofabric_sim.terms.shared import SMALLEST_SQUARE, State


@compiled
def add_row_bound(
    anchors: Anchors | None, inverse_mass: float, inverse_inertia: float, loads: Loads,
    state: State, m: int, s: int, time: float, bound: Vector, energy: Vector
) -> tuple[Vector, Vector]:
    """
    Add the bound of the squared frequency [1/s^2] and energy [J] of row `m` to those of bodies.

    The second variation is k (n.du)^2 + f/l |P du|^2 and moments of f, with du = dx + dtheta x s.
    In mass-scaled coordinates the first has the one eigenvalue k (1/M + |s x n|^2 / Lambda), the
    second is at most f/l (1/M + s^2/Lambda) if f > 0, the last |f| |s| / Lambda. The larger of k_e
    and k_c counts.
    """
    zero = splat(0.0)
    if anchors is None:
        return bound, energy
    else:
        a = anchor_of(anchors, loads.wrench[m])
        if a < 0:
            return bound, energy
        px, py, pz, ux, uy, uz = reach_of(anchors, state, a, s, time)
        inverse, stretch, slope = tension_of(anchors, a, ux, uy, uz)
        tension = slope * stretch
        square = fma(px, px, fma(py, py, pz * pz))
        arm = square * rsqrt(maximum(square, splat(SMALLEST_SQUARE)))
        mass, inertia = splat(inverse_mass), splat(inverse_inertia)
        cx, cy, cz = py * uz - pz * uy, pz * ux - px * uz, px * uy - py * ux
        across = fma(cx, cx, fma(cy, cy, cz * cz)) * inverse * inverse
        stiff = maximum(splat(anchors.extension[a]), splat(anchors.compression[a]))
        more = stiff * fma(across, inertia, mass)
        more = fma(fma(square, inertia, mass), maximum(tension, zero) * inverse, more)
        more = fma(fabs(tension) * arm, inertia, more)
        mine = bits(loads.lanes[m])
        part = splat(0.5) * tension * stretch
        return bound + where(mine, more, zero), energy + where(mine, part, zero)
