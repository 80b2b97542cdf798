# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Directions of connectors in the woven fabric."""

from icofabric_sim.kernels.rotations import Nine, on_axes, Three
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import load, splat, Vector
from icofabric_sim.terms.bending.record import Bending
import numpy as np


@compiled
def woven_direction(
    direction: np.ndarray, directions: np.ndarray | None, link: int, s: int
) -> Three:
    """Return the direction of a connector in the woven fabric, in the axes of `since_woven`."""
    if directions is None:
        return splat(direction[link, 0]), splat(direction[link, 1]), splat(direction[link, 2])
    else:
        return (
            load(directions, 3 * link, s), load(directions, 3 * link + 1, s),
            load(directions, 3 * link + 2, s))


@compiled
def woven_directions(
    bending: Bending, own: Nine, other: Nine, link: int, s: int
) -> tuple[Vector, Vector, Vector, Vector, Vector, Vector]:
    """Return the woven direction turned with its own body and with the other, world components."""
    x, y, z = woven_direction(bending.direction, bending.directions, link, s)
    nx, ny, nz = on_axes(own, x, y, z)
    mx, my, mz = on_axes(other, x, y, z)
    return nx, ny, nz, mx, my, mz
