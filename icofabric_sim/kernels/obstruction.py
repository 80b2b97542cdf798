# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors that enter the shells to which they are attached, see terms/shells.py."""

from icofabric_sim.kernels.outlines import edge_point
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import bits, load_at, splat, Vector, where
from icofabric_sim.terms.shared import Blocks, Connectors, Links
from icofabric_sim.terms.shells import ALONG, axes_at, body_deeper, enters_from, LEAN, Shells
import numpy as np


@compiled
def obstructed_lanes(
    links: Links | None, shells: Shells | None, blocks: Blocks, orientation: np.ndarray,
    points: np.ndarray, stride: int, first: int, last: int
) -> Vector:
    """
    Count connectors that enter the shells of bodies in each lane, over blocks first to last.

    A connector that enters shells at both of its ends counts twice.
    """
    total = splat(0.0)
    if links is None:
        return total
    else:
        for block in range(first, last):
            total = total + obstructed_in(
                shells, links, orientation, points, stride, block, blocks.slot[block])
        return total


@compiled
def obstructed_in(
    shells: Shells | None, links: Links, orientation: np.ndarray, points: np.ndarray,
    stride: int, block: int, s: int
) -> Vector:
    """Count connectors that enter the shells of a block."""
    zero, one = splat(0.0), splat(1.0)
    total = zero
    for edge in range(6):
        at = 3 * edge * stride + s
        px, py = load_at(points, at), load_at(points, at + stride)
        pz = load_at(points, at + 2 * stride)
        axes = axes_at(shells, points, stride, edge, s)
        for link in range(2 * edge, 2 * edge + 2):
            place = links.place[block, link]
            ux = load_at(points, place) - px
            uy = load_at(points, place + stride) - py
            uz = load_at(points, place + 2 * stride) - pz
            inside = where(
                enters_from(shells, orientation, axes, edge, s, ux, uy, uz), one, zero)
            total = total + where(bits(links.present[block, link]), inside, zero)
    return total


@compiled
def find_obstructed(
    connectors: Connectors, shells: Shells | None, position: np.ndarray, orientation: np.ndarray,
    found: np.ndarray
) -> None:
    """
    Mark connectors that enter shells: bit 0 of `found` (c,) at the first end, bit 1 at the second.

    Bodies first: `position` (n, 3), `orientation` (n, 4) unit quaternions.
    """
    for c in range(found.shape[0]):
        first, second = connectors.first[c], connectors.second[c]
        x0, y0, z0 = edge_point(connectors, position, orientation, first, connectors.first_edge[c])
        x1, y1, z1 = edge_point(
            connectors, position, orientation, second, connectors.second_edge[c])
        dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
        number = 0
        if enters(shells, orientation, first, connectors.first_edge[c], dx, dy, dz):
            number += 1
        if enters(shells, orientation, second, connectors.second_edge[c], -dx, -dy, -dz):
            number += 2
        found[c] = number


@compiled
def enters(
    shells: Shells | None, orientation: np.ndarray, b: int, edge: int, dx: float, dy: float,
    dz: float
) -> bool:
    """Check that a connector along d [m] from an edge of body `b` enters the shell of the body."""
    x, y, z, w = orientation[b, 0], orientation[b, 1], orientation[b, 2], orientation[b, 3]
    # Components on the axes of the body: the inverse of eq 26.
    tx, ty, tz = 2.0 * (dy * z - dz * y), 2.0 * (dz * x - dx * z), 2.0 * (dx * y - dy * x)
    bx = dx + w * tx + (ty * z - tz * y)
    by = dy + w * ty + (tz * x - tx * z)
    bz = dz + w * tz + (tx * y - ty * x)
    if shells is not None:
        return clips(shells, b, edge, bx, by, bz)
    pair = edge >> 1
    if pair == 0:
        out, beside = bz, bx
    elif pair == 1:
        out, beside = bx, by
    else:
        out, beside = by, bz
    sign = 1.0 - 2.0 * (edge & 1)
    return sign * out + LEAN * abs(beside) < -ALONG * abs(beside)


@compiled
def clips(shells: Shells, b: int, edge: int, x: float, y: float, z: float) -> bool:
    """
    Check that the open segment from an attachment point along (x, y, z) [m] meets the interior.

    Vector on the axes of body `b`.
    """
    begin, end, least = 0.0, 1.0, 1.0
    below = -ALONG * (abs(x) + abs(y) + abs(z))
    for face in range(20):
        out = (
            shells.normals[face, 0] * x + shells.normals[face, 1] * y
            + shells.normals[face, 2] * z)
        depth = body_deeper(
            shells.deeper_of_bodies, shells.depth[edge, face], shells.on_face, b)
        least = min(least, depth)
        if out < below:
            begin = max(begin, depth / out)
        elif not depth > 0.0:
            return False
        elif out > 0.0:
            end = min(end, depth / out)
    return begin < end and not least > 0.0
