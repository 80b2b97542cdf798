# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Connectors between the icosahedra at given grid points, whatever the shape of the fabric.

Each pair of points at a diagonal of a unit square is connected as Table 5 says; its edges follow
from the direction alone. Works for slabs and for fabrics cut in any way.
"""

from typing import Literal, NamedTuple

from icofabric_sim.scene.weave_tables import fabric_direction, TABLE_5
import numpy as np

Fastest = Literal['x', 'y']


class Connectors(NamedTuple):
    """Connectors in order: by lower body, its edge, other body."""

    bodies: np.ndarray  # (C, 2) int32; the lower number first
    edges: np.ndarray  # (C, 2) int8, edge codes at those bodies


def no_connectors() -> Connectors:
    """Return the connectors of a fabric without any."""
    return Connectors(np.empty((0, 2), np.int32), np.empty((0, 2), np.int8))


def grid_keys(grid: np.ndarray, fastest: Fastest) -> tuple[np.ndarray, np.ndarray]:
    """
    Return an int64 key (N,) for each grid point, and the strides (3,) of x, y and z in it.

    Keys grow with the order of the points: by z, then y, then x, or for fastest 'y' by z, then x,
    then y. A step to a neighbour is the addition of its strides, and never meets another point.
    """
    points = np.asarray(grid, np.int64)
    lowest = points.min(axis=0)
    # One empty place more on each axis, so that a step over the border ends nowhere.
    extent = [int(length) + 2 for length in points.max(axis=0) - lowest]
    if extent[0] * extent[1] * extent[2] > 2**62:
        raise ValueError(f'weave.size: grid points spread over {extent} places are too far apart')
    strides = np.array(
        [1, extent[0], extent[0] * extent[1]] if fastest == 'x'
        else [extent[1], 1, extent[0] * extent[1]], np.int64)
    return (points - lowest) @ strides, strides


def connect_grid(grid: np.ndarray, variant: int, *, fastest: Fastest = 'x') -> Connectors:
    """
    Connect all icosahedra at grid points (N, 3), given in strictly increasing order.

    The order is by (z, y, x), or for fastest 'y' by (z, x, y). All points must have one parity of
    x + y + z; of the variant only the orientation of the bodies counts, so any parity will do.
    """
    count = len(grid)
    if count == 0:
        return no_connectors()
    parity = np.bitwise_xor.reduce(grid, axis=1) & 1
    if bool(np.any(parity != parity[0])):
        raise ValueError('the grid points of a weave must have x + y + z all even or all odd')
    key, strides = grid_keys(grid, fastest)
    if not bool(np.all(key[1:] > key[:-1])):
        raise ValueError(f'the grid points of a weave must come in order, {fastest} fastest')
    # The neighbours that come later: the same 6 of 12 at every body, already in order.
    steps = sorted(
        (edge, int(np.dot(fabric_direction(variant, direction), strides)))
        for edge, direction in TABLE_5)
    steps = [(edge, step) for edge, step in steps if step > 0]
    partner = np.empty((count, len(steps)), np.int32)
    for column, (_, step) in enumerate(steps):
        wanted = key + step
        place = np.searchsorted(key, wanted)
        place[place == count] = 0
        partner[:, column] = np.where(key[place] == wanted, place, -1)
    present = partner >= 0
    bodies = np.empty((np.count_nonzero(present), 2), np.int32)
    bodies[:, 0] = np.repeat(np.arange(count, dtype=np.int32), np.count_nonzero(present, axis=1))
    bodies[:, 1] = partner[present]
    edges = np.empty(bodies.shape, np.int8)
    codes = np.array([edge for edge, _ in steps], np.int8)
    edges[:, 0] = np.broadcast_to(codes, partner.shape)[present]
    np.bitwise_xor(edges[:, 0], 1, out=edges[:, 1])
    return Connectors(bodies, edges)
