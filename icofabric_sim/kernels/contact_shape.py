# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The icosahedron as contact sees it: half edge 1, centre at the origin, body axes.

Contact computes with lengths over a, half the outer edge, so that nothing depends on their size.
"""

import math

from icofabric_sim.icosahedron import face_geometry, FACES, inscribed_radius, TAU, vertices
from icofabric_sim.kernels.compiled import compiled
import numpy as np

# Radii of the spheres inside and around.
INNER = inscribed_radius(1.0)
OUTER = math.sqrt(1.0 + TAU * TAU)
# Faces count from 0 here, in the order of icosahedron.FACES.
CORNERS = vertices(1.0)[FACES]
NORMALS = np.array(face_geometry(1.0).normals)


def _neighbours() -> np.ndarray:
    """
    Face across the edge from corner k to corner k + 1 of each face, (20, 3).
    """
    edges = [[frozenset((int(face[k]), int(face[(k + 1) % 3]))) for k in range(3)]
             for face in FACES]
    return np.array([
        [next(other for other in range(20) if other != own and edge in edges[other])
         for edge in edges[own]] for own in range(20)])


NEIGHBOURS = _neighbours()


@compiled
def reach(ux: float, uy: float, uz: float) -> float:
    """
    Largest scalar product of a direction in body axes with points of the icosahedron.

    Its vertices are the corners of three golden rectangles, (0, +-1, +-tau) and cyclic.
    """
    ax, ay, az = abs(ux), abs(uy), abs(uz)
    return max(ay + TAU * az, max(ax + TAU * ay, az + TAU * ax))


@compiled
def farthest(ux: float, uy: float, uz: float) -> tuple[float, float, float]:
    """
    Vertex of that largest scalar product; one of them where several share it.
    """
    ax, ay, az = abs(ux), abs(uy), abs(uz)
    first, second, third = ay + TAU * az, ax + TAU * ay, az + TAU * ax
    if first >= second and first >= third:
        return 0.0, math.copysign(1.0, uy), math.copysign(TAU, uz)
    if second >= third:
        return math.copysign(1.0, ux), math.copysign(TAU, uy), 0.0
    return math.copysign(TAU, ux), 0.0, math.copysign(1.0, uz)


@compiled
def face_beyond(x: float, y: float, z: float) -> int:
    """
    The face whose pyramid, with its apex in the centre, holds a point; any where several do.
    """
    best, most = 0, -1.0
    for face in range(20):
        height = NORMALS[face, 0] * x + NORMALS[face, 1] * y + NORMALS[face, 2] * z
        if height > most:
            best, most = face, height
    return best
