# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Which points lie inside a closed triangle mesh.

A ray goes up from each point, and the triangles that it passes are counted with the sign of their
side. Whether it passes one is decided edge by edge, and always alike for an edge that two
triangles share: the counts of a closed mesh add up to nothing far outside, to the last ray, also
where one goes exactly through an edge or a corner.
"""

from icofabric_sim.kernels.runtime.compiled import compiled
import numpy as np


@compiled
def mark_inside(
    points: np.ndarray, corners: np.ndarray, first: np.ndarray, members: np.ndarray, low: float,
    width: float, oriented: bool, room: float, inside: np.ndarray
) -> None:
    """
    Whether each of `points` (n, 3), or a place `room` beside it, is inside `corners` (t, 3, 3).

    Strip k of the y axis, from low + k width on, is crossed by the triangles members[first[k]] to
    members[first[k + 1] - 1]. `oriented`: inside is where the mesh winds round; else where
    a ray crosses it an odd number of times.
    """
    strips = first.shape[0] - 1
    for i in range(points.shape[0]):
        for corner in range(8):
            x = points[i, 0] + (room if corner & 1 else -room)
            y = points[i, 1] + (room if corner & 2 else -room)
            z = points[i, 2] + (room if corner & 4 else -room)
            strip = int(np.floor((y - low) / width))
            if strip < 0 or strip >= strips:
                continue
            wound, crossed = 0, 0
            for m in range(first[strip], first[strip + 1]):
                side = passed(corners[members[m]], x, y, z)
                wound += side
                crossed += abs(side)
            if (wound != 0) if oriented else (crossed % 2 != 0):
                inside[i] = True
                break


@compiled
def passed(corners: np.ndarray, x: float, y: float, z: float) -> int:
    """1 or -1 where the ray up from a point passes a triangle (3, 3), by its side; else 0."""
    # Winding of the triangle's shadow round the point: of its edges that cross the line along x
    # through the point, those beyond it.
    wound = 0
    for k in range(3):
        a, b = corners[k], corners[(k + 1) % 3]
        rising = a[1] <= y < b[1]
        if not (rising or b[1] <= y < a[1]):
            continue
        # From its lower end, whichever the triangle calls first: the same for both that share it.
        if not rising:
            a, b = b, a
        if (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0.0:
            wound += 1 if rising else -1
    if wound == 0:
        return 0
    a, b, c = corners[0], corners[1], corners[2]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    # The normal is not level, or there would be no shadow to be in but for rounding.
    nz = ux * vy - uy * vx
    rise = (uy * vz - uz * vy) * (x - a[0]) + (uz * vx - ux * vz) * (y - a[1])
    height = a[2] - rise / nz if nz != 0.0 else a[2]
    height = min(max(height, min(a[2], b[2], c[2])), max(a[2], b[2], c[2]))
    return wound if height > z else 0
