# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Test which points lie inside a closed triangle mesh.

A ray goes up from each point, and the triangles that it crosses are counted with the sign of their
side. A crossing is decided edge by edge, and always alike for an edge that two triangles share.
The counts of a closed mesh therefore add up to zero for every ray from far outside, also for a ray
exactly through an edge or a corner.
"""

from icofabric_sim.kernels.runtime.compiled import compiled
import numpy as np


@compiled
def mark_inside(
    points: np.ndarray, corners: np.ndarray, first: np.ndarray, members: np.ndarray, low: float,
    width: float, oriented: bool, room: float, inside: np.ndarray
) -> None:
    """
    Mark `points` (n, 3) that are inside `corners` (t, 3, 3), or less than `room` from the inside.

    A point is marked if one of the eight corners of the cube of half edge `room` around it is
    inside. Strip k of the y axis, from low + k width on, is crossed by the triangles
    members[first[k]] to members[first[k + 1] - 1]. `oriented`: the mesh winds round inside points;
    else a ray from inside points crosses it an odd number of times.
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
    """
    Return 1 or -1 by the side of a triangle (3, 3) that the ray up from a point crosses, else 0.
    """
    # Winding of the projected triangle round the point: count its edges that cross the line along
    # x through the point, beyond the point.
    wound = 0
    for k in range(3):
        a, b = corners[k], corners[(k + 1) % 3]
        rising = a[1] <= y < b[1]
        if not (rising or b[1] <= y < a[1]):
            continue
        # From the lower end of the edge, so that both triangles of an edge agree.
        if not rising:
            a, b = b, a
        if (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0.0:
            wound += 1 if rising else -1
    if wound == 0:
        return 0
    a, b, c = corners[0], corners[1], corners[2]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    # The normal has a vertical component; otherwise the projection has no area except by rounding.
    nz = ux * vy - uy * vx
    rise = (uy * vz - uz * vy) * (x - a[0]) + (uz * vx - ux * vz) * (y - a[1])
    height = a[2] - rise / nz if nz != 0.0 else a[2]
    height = min(max(height, min(a[2], b[2], c[2])), max(a[2], b[2], c[2]))
    return wound if height > z else 0
