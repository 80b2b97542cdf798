# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Sums over all bodies outside health checks: of velocities, and of squares of accelerations.

Sums are formed over groups of blocks, and the groups in their order, as in figures.py.
"""

from icofabric_sim.kernels.records import Blocks
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lane_reductions import sum_of_lanes
from icofabric_sim.kernels.runtime.lanes import bits, fma, load, splat, where
from icofabric_sim.terms.masses import Masses, weights_of
import numpy as np


@compiled
def note_sums(
    blocks: Blocks, rows: np.ndarray, sums: np.ndarray, size: int, first: int, last: int, end: int
) -> None:
    """
    Add up rows (k, s) over groups first to last of `size` blocks, none from block `end` on.

    Results go into sums (k, g).
    """
    for group in range(first, last):
        for k in range(rows.shape[0]):
            total = splat(0.0)
            for block in range(group * size, min(group * size + size, end)):
                there = bits(blocks.alive[block])
                total = total + where(there, load(rows, k, blocks.slot[block]), splat(0.0))
            sums[k, group] = sum_of_lanes(total)


@compiled
def note_squares(
    blocks: Blocks, masses: Masses | None, acceleration: np.ndarray, fall: np.ndarray,
    sums: np.ndarray, size: int, first: int, last: int, end: int
) -> None:
    """
    Sum squares of accelerations (6, s) over groups first to last of `size` blocks.

    Results go into sums (2, g). Linear accelerations [m/s^2] without a `fall` (3,) count times
    masses, and angular ones [rad/s^2] times inertias, both in the units of `weights_of`. None from
    block `end` on.
    """
    for group in range(first, last):
        linear, angular = splat(0.0), splat(0.0)
        for block in range(group * size, min(group * size + size, end)):
            s = blocks.slot[block]
            heavy, slow = weights_of(masses, s)
            line, turn = splat(0.0), splat(0.0)
            for k in range(3):
                a = load(acceleration, k, s) - splat(fall[k])
                b = load(acceleration, k + 3, s)
                line, turn = fma(a, a, line), fma(b, b, turn)
            # Slots without a body have the acceleration of gravity, too.
            there = bits(blocks.alive[block])
            linear = linear + where(there, heavy * line, splat(0.0))
            angular = angular + where(there, slow * turn, splat(0.0))
        sums[0, group], sums[1, group] = sum_of_lanes(linear), sum_of_lanes(angular)
