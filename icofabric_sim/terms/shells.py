# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Shells of bodies, and the detection of connectors that enter those that they are attached to.

At an edge two faces join, with normals n1 and n2. A connector of direction d enters the shell if
d.n1 < 0 and d.n2 < 0. Both normals lean by the same angle from the edge's own direction a,
to either side t of the edge, so the condition is d.a + tan |d.t| < 0 with tan = 1 / tau^2.

From any other point p the open segment p + t d, 0 < t < 1, is clipped by all faces: it meets the
interior if some t has n.(p + t d) < rho for every face. This test is exact on a face, an edge, a
vertex and outside. A point inside the shell has its connector inside from the start: not counted.
"""

from typing import Any

from icofabric_sim.kernels.rotations import axes_of_lanes
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fabs, fma, load_at, maximum, splat, Vector, where
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.terms.shared import Six
import numpy as np

# 1 / tau^2: the dihedral angle of the icosahedron is 138.19 degrees.
LEAN = 0.3819660112501051
# Relative tolerance: a connector along a face is outside, even if rounding puts it below the face.
# At the least connector angle (eq 54) all connectors of a woven fabric lie along faces.
ALONG = 1e-12


class Shells(Record):
    """Faces of a shell relative to its attachment points, if these are not edge midpoints."""

    normals: np.ndarray  # (20, 3) outward unit normals, body axes
    depth: np.ndarray  # (6, 20) [m] of each point below each face; exactly 0 on it
    # Additional depth in individually sized shells [m], by slots (s,) and by bodies (n,).
    deeper: np.ndarray | None = None
    deeper_of_bodies: np.ndarray | None = None
    on_face: float = 0.0  # [m] a point this close to a face lies on it


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
