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
The icosahedron as contact sees it: half edge 1, centre at the origin, body axes.

Contact computes with lengths over a, half the outer edge, so that nothing depends on their size.
"""

import math

from icofabric_sim.geometry.icosahedron import (
    EDGES,
    face_geometry,
    FACES,
    inscribed_radius,
    TAU,
    vertices,
)
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fabs, fma, maximum, splat, Vector
import numpy as np

# Radii of the spheres inside and around.
INNER = inscribed_radius(1.0)
OUTER = math.sqrt(1.0 + TAU * TAU)
# Faces count from 0 here, in the order of icosahedron.FACES.
CORNERS = vertices(1.0)[FACES]
NORMALS = np.array(face_geometry(1.0).normals)


def _neighbours() -> np.ndarray:
    """Face across the edge from corner k to corner k + 1 of each face, (20, 3)."""
    edges = [[frozenset((int(face[k]), int(face[(k + 1) % 3]))) for k in range(3)]
             for face in FACES]
    return np.array([
        [next(other for other in range(20) if other != own and edge in edges[other])
         for edge in edges[own]] for own in range(20)])


NEIGHBOURS = _neighbours()
# Where RIDGES[i, k] . x > 0 a point is beyond the side k of the pyramid of face i.
RIDGES = NORMALS[NEIGHBOURS] - NORMALS[:, None]
# One of each two opposite faces, filled up with the first to whole vectors; and their normals'
# x, y and z one after the other.
AXIS_COUNT = 16
_HALF = [face for face in range(20) if tuple(NORMALS[face].round(9)) > (0.0, 0.0, 0.0)]
AXIS_FACES = np.array(_HALF + _HALF[:1] * (AXIS_COUNT - len(_HALF)))
AXES = np.ascontiguousarray(NORMALS[AXIS_FACES].T).ravel()
OPPOSITE = np.argmin(NORMALS @ NORMALS.T, axis=1)
# Unit vectors along the edges, one of each two parallel ones, and the same as whole vectors of
# x, y and z, filled up with 0.
EDGE_ENDS = np.ascontiguousarray(vertices(1.0)[EDGES])
_WAYS = (EDGE_ENDS[:, 1] - EDGE_ENDS[:, 0]) / 2.0
EDGE_WAYS = np.array([
    way for k, way in enumerate(_WAYS)
    if not any(abs(way @ other) > 0.999 for other in _WAYS[:k])])
WAY_COUNT = len(EDGE_WAYS)
WAYS = np.concatenate([EDGE_WAYS, np.zeros((AXIS_COUNT - WAY_COUNT, 3))]).T.ravel()


@compiled
def reach(ux: float, uy: float, uz: float) -> float:
    """
    Largest scalar product of a direction in body axes with points of the icosahedron.

    Its vertices are the corners of three golden rectangles, (0, +-1, +-tau) and cyclic.
    """
    ax, ay, az = abs(ux), abs(uy), abs(uz)
    return max(ay + TAU * az, max(ax + TAU * ay, az + TAU * ax))


@compiled
def reach_lanes(ux: Vector, uy: Vector, uz: Vector) -> Vector:
    """The same of several directions."""
    tau = splat(TAU)
    ax, ay, az = fabs(ux), fabs(uy), fabs(uz)
    return maximum(fma(tau, az, ay), maximum(fma(tau, ay, ax), fma(tau, ax, az)))


@compiled
def farthest(ux: float, uy: float, uz: float) -> tuple[float, float, float]:
    """Vertex of that largest scalar product; one of them where several share it."""
    ax, ay, az = abs(ux), abs(uy), abs(uz)
    first, second, third = ay + TAU * az, ax + TAU * ay, az + TAU * ax
    # Choices of numbers, no branches: those would be guessed wrong every other time.
    one = first >= second and first >= third
    two = second >= third
    x = 0.0 if one else (1.0 if two else TAU)
    y = 1.0 if one else (TAU if two else 0.0)
    z = TAU if one else (0.0 if two else 1.0)
    return math.copysign(x, ux), math.copysign(y, uy), math.copysign(z, uz)
