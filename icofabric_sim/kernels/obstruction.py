# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Detection of connectors that enter the shell to which they are attached.

At an edge two faces join, with normals n1 and n2. A connector of direction d enters the shell if
d.n1 < 0 and d.n2 < 0. Both normals lean by the same angle from the edge's own direction a,
to either side t of the edge, so the condition is d.a + tan |d.t| < 0 with tan = 1 / tau^2.

From any other point p the open segment p + t d, 0 < t < 1, is clipped by all faces: it meets the
interior if some t has n.(p + t d) < rho for every face. This test is exact on a face, an edge, a
vertex and outside. A point inside the shell has its connector inside from the start: not counted.
"""

from typing import Any

from icofabric_sim.kernels.connectors import Six
from icofabric_sim.kernels.outlines import edge_point
from icofabric_sim.kernels.records import Blocks, Connectors, Links, Shells
from icofabric_sim.kernels.rotations import axes_of_lanes
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fabs,
    fma,
    load_at,
    maximum,
    splat,
    Vector,
    where,
)
import numpy as np

# 1 / tau^2: the dihedral angle of the icosahedron is 138.19 degrees.
LEAN = 0.3819660112501051
# Relative tolerance: a connector along a face is outside, even if rounding puts it below the face.
# At the least connector angle (eq 54) all connectors of a woven fabric lie along faces.
ALONG = 1e-12


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
def enters_from(
    shells: Shells | None, orientation: np.ndarray, axes: Six, edge: int, s: int, ux: Vector,
    uy: Vector, uz: Vector
) -> Any:
    """
    Return the mask of bodies at slot `s` whose shells a connector along u [m] enters.

    The connector begins at the attachment point of the named `edge`: its midpoint if `shells` is
    None.
    """
    if shells is None:
        return enters_lanes(axes, ux, uy, uz)
    else:
        return clips_lanes(shells, orientation, edge, s, ux, uy, uz)


@compiled
def clips_lanes(
    shells: Shells, orientation: np.ndarray, edge: int, s: int, ux: Vector, uy: Vector, uz: Vector
) -> Any:
    """
    Return the mask of bodies at slot `s` whose shells a connector along u [m] enters.

    The connector begins at the attachment point of a named `edge`, in any position.
    """
    zero, one = splat(0.0), splat(1.0)
    ax, ay, az, bx, by, bz, cx, cy, cz = axes_of_lanes(orientation, s)
    x = fma(ux, ax, fma(uy, ay, uz * az))
    y = fma(ux, bx, fma(uy, by, uz * bz))
    z = fma(ux, cx, fma(uy, cy, uz * cz))
    begin, end, least = zero, one, one
    for face in range(20):
        out = fma(splat(shells.normals[face, 0]), x, fma(
            splat(shells.normals[face, 1]), y, splat(shells.normals[face, 2]) * z))
        depth = lanes_deeper(shells.deeper, splat(shells.depth[edge, face]), shells.on_face, s)
        least = where(depth < least, depth, least)
        crossing = depth / where(out < zero, out, where(out > zero, out, one))
        begin = where(out < zero, maximum(crossing, begin), begin)
        # A segment outside a face, or directed outwards from it, does not pass below the face.
        last = where(depth > zero, crossing, zero)
        last = where(out > zero, last, where(depth > zero, one, zero))
        end = where(out < zero, end, where(last < end, last, end))
    # A point inside the shell has its connector inside from the start: not counted.
    begin = where(zero < least, end, begin)
    return begin < end


@compiled
def lanes_deeper(deeper: np.ndarray | None, depth: Vector, on_face: float, s: int) -> Vector:
    """
    Return depths [m] of a point below a face, with individually sized shells if there are any.
    """
    if deeper is None:
        return depth
    else:
        own = depth + load_at(deeper, s)
        return where(fabs(own) < splat(on_face), splat(0.0), own)


@compiled
def body_deeper(deeper: np.ndarray | None, depth: float, on_face: float, b: int) -> float:
    """Return the depth [m] of a point below a face of the shell of body `b`."""
    if deeper is None:
        return depth
    else:
        own = depth + deeper[b]
        return 0.0 if abs(own) < on_face else own


@compiled
def axes_at(
    shells: Shells | None, points: np.ndarray, stride: int, edge: int, s: int
) -> Six:
    """
    Return axes [m] of the bodies at slot `s` along and across a named `edge` if `shells` is None.

    The axes are differences of attachment points, which are edge midpoints then.
    """
    if shells is not None:
        zero = splat(0.0)
        return zero, zero, zero, zero, zero, zero
    pair = edge >> 1
    at = 3 * edge * stride + s
    across = (6 * pair + 3 * (1 - (edge & 1))) * stride + s
    # The axis across the edges up and down is x, across north and south y, west and east z.
    side = 6 * ((pair + 1) % 3) * stride + s
    return (
        load_at(points, at) - load_at(points, across),
        load_at(points, at + stride) - load_at(points, across + stride),
        load_at(points, at + 2 * stride) - load_at(points, across + 2 * stride),
        load_at(points, side) - load_at(points, side + 3 * stride),
        load_at(points, side + stride) - load_at(points, side + 4 * stride),
        load_at(points, side + 2 * stride) - load_at(points, side + 5 * stride))


@compiled
def enters_lanes(axes: Six, ux: Vector, uy: Vector, uz: Vector) -> Any:
    """
    Return the mask of bodies whose shells a connector along u [m] enters from an edge midpoint.
    """
    ax, ay, az, tx, ty, tz = axes
    out = fma(ux, ax, fma(uy, ay, uz * az))
    beside = fabs(fma(ux, tx, fma(uy, ty, uz * tz)))
    return fma(splat(LEAN), beside, out) < splat(-ALONG) * beside


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
