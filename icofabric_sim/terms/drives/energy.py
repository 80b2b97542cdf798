# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Kinetic energy that paths supply."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.terms.drives.path import path_of
from icofabric_sim.terms.drives.record import Drives
from icofabric_sim.terms.gyration import Gyration, turning_square_at
from icofabric_sim.terms.loads import Loads
from icofabric_sim.terms.masses import mass_at, Masses
from icofabric_sim.terms.shared import Blocks, State


@compiled
def add_driven_energy(
    drives: Drives | None, blocks: Blocks, masses: Masses | None, inverse_mass: float,
    inverse_inertia: float, gyration: Gyration | None, loads: Loads, state: State, first: int,
    last: int, total: float
) -> float:
    """
    Add the kinetic energy [J] of driven freedoms in blocks first to last, supplied by paths.
    """
    if drives is None:
        return total
    else:
        for block in range(first, last):
            s = blocks.slot[block]
            for m in range(loads.start[block], loads.start[block + 1]):
                p = path_of(drives, loads.wrench[m])
                if p >= 0:
                    for i in range(LANES):
                        if loads.lanes[m] >> i & 1:
                            mass, inertia = mass_at(
                                masses, inverse_mass, inverse_inertia, s + i)
                            for k in range(3):
                                v = state.linear_velocity[k, s + i]
                                if drives.moves[p, k]:
                                    total += 0.5 * mass * v * v
                            if drives.moves[p, 3]:
                                total += 0.5 * inertia * turning_square_at(
                                    gyration, state.orientation, state.angular_velocity,
                                    s + i)
        return total
