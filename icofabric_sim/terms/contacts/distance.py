# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Exact distance or overlap of two icosahedra, by testing all of their features.

For users and tests; a simulation needs neither. The least displacement that separates overlapping
convex bodies is along the normal of a face of either or across an edge of both (the facets of
their Minkowski sum). The nearest points of separate bodies are those of a vertex and a face or of
two edges. Axes of the first body, lengths over its a; `ratio` is the second's a over that.
"""

import math

from icofabric_sim.geometry.icosahedron import FACES, vertices
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.terms.contacts.axis import ROUNDING, turn, turn_back
from icofabric_sim.terms.contacts.shape import (
    CORNERS,
    EDGE_ENDS,
    EDGE_WAYS,
    INNER,
    NORMALS,
    reach,
    WAY_COUNT,
)
import numpy as np

VERTICES = vertices(1.0)
# Inward normals of the sides of a face within its plane: from the corners k to k + 1.
SIDES = np.array([[np.cross(NORMALS[f], CORNERS[f, (k + 1) % 3] - CORNERS[f, k])
                   for k in range(3)] for f in range(len(FACES))])
# Edges at a smaller angle than this are parallel; faces have the same normals then.
_PARALLEL = 1e-12


@compiled
def gap_on(
    q: np.ndarray, ratio: float, cx: float, cy: float, cz: float, ux: float, uy: float, uz: float
) -> float:
    """
    Return the gap along a unit vector or its opposite, whichever leads to the second body at c.
    """
    bx, by, bz = turn_back(q, ux, uy, uz)
    return abs(ux * cx + uy * cy + uz * cz) - reach(ux, uy, uz) - (
        ratio * reach(bx, by, bz))


@compiled
def widest_gap(
    q: np.ndarray, ratio: float, cx: float, cy: float, cz: float, axis: np.ndarray
) -> float:
    """
    Return the largest gap of all normals of the Minkowski sum: minus the depth of an overlap.

    Write the unit axis (3,), towards the second body; q (3, 3) leads from its axes.
    """
    most, x, y, z = -math.inf, 0.0, 0.0, 0.0
    for face in range(20):
        ux, uy, uz = NORMALS[face, 0], NORMALS[face, 1], NORMALS[face, 2]
        gap = gap_on(q, ratio, cx, cy, cz, ux, uy, uz)
        if gap > most:
            most, x, y, z = gap, ux, uy, uz
        ux, uy, uz = turn(q, ux, uy, uz)
        gap = gap_on(q, ratio, cx, cy, cz, ux, uy, uz)
        if gap > most:
            most, x, y, z = gap, ux, uy, uz
    for other in range(WAY_COUNT):
        fx, fy, fz = turn(q, EDGE_WAYS[other, 0], EDGE_WAYS[other, 1], EDGE_WAYS[other, 2])
        for own in range(WAY_COUNT):
            ex, ey, ez = EDGE_WAYS[own, 0], EDGE_WAYS[own, 1], EDGE_WAYS[own, 2]
            ux, uy, uz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
            length = math.sqrt(ux * ux + uy * uy + uz * uz)
            if not length > _PARALLEL:
                continue
            ux, uy, uz = ux / length, uy / length, uz / length
            gap = gap_on(q, ratio, cx, cy, cz, ux, uy, uz)
            if gap > most:
                most, x, y, z = gap, ux, uy, uz
    if x * cx + y * cy + z * cz < 0.0:
        x, y, z = -x, -y, -z
    axis[0], axis[1], axis[2] = x, y, z
    return most


@compiled
def nearest_of_vertices(
    q: np.ndarray, own: float, other: float, cx: float, cy: float, cz: float, best: float,
    axis: np.ndarray
) -> float:
    """
    Return the least distance of a second body's vertex from a first body's face, at most `best`.

    Only vertices above the face count; then also write the axis (3,). Half edges are `own` and
    `other`.
    """
    for vertex in range(12):
        x, y, z = turn(q, VERTICES[vertex, 0], VERTICES[vertex, 1], VERTICES[vertex, 2])
        x, y, z = other * x + cx, other * y + cy, other * z + cz
        for face in range(20):
            height = (NORMALS[face, 0] * x + NORMALS[face, 1] * y
                      + NORMALS[face, 2] * z - own * INNER)
            if height < 0.0 or height >= best:
                continue
            above = True
            for k in range(3):
                above &= (SIDES[face, k, 0] * (x - own * CORNERS[face, k, 0])
                          + SIDES[face, k, 1] * (y - own * CORNERS[face, k, 1])
                          + SIDES[face, k, 2] * (z - own * CORNERS[face, k, 2])) >= 0.0
            if above:
                best = height
                axis[0], axis[1], axis[2] = NORMALS[face, 0], NORMALS[face, 1], NORMALS[face, 2]
    return best


@compiled
def nearest_of_edges(
    q: np.ndarray, ratio: float, cx: float, cy: float, cz: float, best: float, axis: np.ndarray
) -> float:
    """Return the least distance of an edge of one body from one of the other, at most `best`."""
    whole = 4.0 * ratio * ratio
    for other in range(30):
        start, end = EDGE_ENDS[other, 0], EDGE_ENDS[other, 1]
        fx, fy, fz = turn(q, end[0] - start[0], end[1] - start[1], end[2] - start[2])
        bx, by, bz = turn(q, start[0], start[1], start[2])
        fx, fy, fz = ratio * fx, ratio * fy, ratio * fz
        bx, by, bz = ratio * bx + cx, ratio * by + cy, ratio * bz + cz
        for own in range(30):
            ax, ay, az = EDGE_ENDS[own, 0, 0], EDGE_ENDS[own, 0, 1], EDGE_ENDS[own, 0, 2]
            ex, ey, ez = (EDGE_ENDS[own, 1, 0] - ax, EDGE_ENDS[own, 1, 1] - ay,
                          EDGE_ENDS[own, 1, 2] - az)
            dx, dy, dz = bx - ax, by - ay, bz - az
            # Coordinates s and t on the edges, from 0 to 1; the first edge is 2 long.
            along = ex * fx + ey * fy + ez * fz
            own_part = ex * dx + ey * dy + ez * dz
            other_part = fx * dx + fy * dy + fz * dz
            square = 4.0 * whole - along * along
            s = 0.0
            if square > 0.0:
                s = min(1.0, max(0.0, (whole * own_part - along * other_part) / square))
            t = min(1.0, max(0.0, (along * s - other_part) / whole))
            s = min(1.0, max(0.0, (along * t + own_part) / 4.0))
            dx, dy, dz = (dx + t * fx - s * ex, dy + t * fy - s * ey, dz + t * fz - s * ez)
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            if distance < best:
                best = distance
                if distance > 0.0:
                    axis[0], axis[1], axis[2] = dx / distance, dy / distance, dz / distance
    return best


@compiled
def signed_distance(
    half_edge: float, other_edge: float, xa: np.ndarray, ra: np.ndarray, xb: np.ndarray,
    rb: np.ndarray, q: np.ndarray, axis: np.ndarray
) -> float:
    """
    Return the distance [m] of two shells of these half edges [m]; minus the depth of an overlap.

    Centres [m] (3,), matrices from body to world axes (3, 3); q (3, 3) is overwritten. Write the
    unit axis (3,) from the first body to the second, world frame: along it the bodies have this
    distance, or separate after the shortest displacement.
    """
    ratio = other_edge / half_edge
    for r in range(3):
        for c in range(3):
            q[r, c] = ra[0, r] * rb[0, c] + ra[1, r] * rb[1, c] + ra[2, r] * rb[2, c]
    cx, cy, cz = turn_back(ra, (xb[0] - xa[0]) / half_edge, (xb[1] - xa[1]) / half_edge,
                           (xb[2] - xa[2]) / half_edge)
    answer = widest_gap(q, ratio, cx, cy, cz, axis)
    # Below the rounding error of a vertex above a face the gap is the distance.
    if answer > ROUNDING:
        answer = nearest_of_edges(q, ratio, cx, cy, cz, math.inf, axis)
        answer = nearest_of_vertices(q, 1.0, ratio, cx, cy, cz, answer, axis)
        # The same seen from the second body.
        for r in range(3):
            for c in range(r):
                q[r, c], q[c, r] = q[c, r], q[r, c]
        bx, by, bz = turn(q, -cx, -cy, -cz)
        before = answer
        x, y, z = axis[0], axis[1], axis[2]
        answer = nearest_of_vertices(q, ratio, 1.0, bx, by, bz, answer, axis)
        if answer < before:
            x, y, z = turn_back(q, -axis[0], -axis[1], -axis[2])
    else:
        x, y, z = axis[0], axis[1], axis[2]
    axis[0], axis[1], axis[2] = turn(ra, x, y, z)
    return answer * half_edge
