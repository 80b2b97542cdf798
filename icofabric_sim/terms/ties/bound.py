# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Bound of the frequencies of custom connectors, and their energies."""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import Vector
from icofabric_sim.terms.ties.force import add_at_lane, span_of, stretch_of
from icofabric_sim.terms.ties.record import Ties
import numpy as np


@compiled
def add_bound(
    ties: Ties | None, inverse_mass: float, inverse_inertia: float, position: np.ndarray,
    orientation: np.ndarray, block: int, bound: Vector, energy: Vector
) -> tuple[Vector, Vector]:
    """
    Add the bound of the squared frequency [1/s^2] of each body, and half of each energy [J].

    The bound is that of anchors (terms/anchors/bound.py), twice for the terms of du = du_2 - du_1,
    because du^2 <= 2 du_1^2 + 2 du_2^2.
    """
    if ties is None:
        return bound, energy
    else:
        for r in range(ties.start[block], ties.start[block + 1]):
            if ties.present[r] == 0:
                continue
            sx, sy, sz, ux, uy, uz = span_of(ties, position, orientation, r)
            length, stretch, slope = stretch_of(ties, r, ux, uy, uz)
            tension, square = slope * stretch, sx * sx + sy * sy + sz * sz
            cx, cy, cz = sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux
            across = (cx * cx + cy * cy + cz * cz) / (length * length)
            stiff = max(ties.extension[r], ties.compression[r])
            more = 2.0 * stiff * (inverse_mass + across * inverse_inertia)
            more += 2.0 * max(tension, 0.0) / length * (inverse_mass + square * inverse_inertia)
            more += abs(tension) * math.sqrt(square) * inverse_inertia
            bound = add_at_lane(ties.lane[r], more, bound)
            energy = add_at_lane(ties.lane[r], 0.25 * tension * stretch, energy)
        return bound, energy
