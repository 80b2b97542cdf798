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
Shortest ways around shells by brute force.

Points along all edges, and Dijkstra's algorithm; or every pair of ways, one after the other.
"""

from icofabric_sim.geometry.icosahedron import (
    edge_midpoints,
    EDGES,
    face_geometry,
    FACES,
    NAMED_EDGE_FACES,
    vertices,
)
from icofabric_sim.kernels.wrap.pairs import both_allowed, tighten
from numba import njit
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra


class Surface:
    """
    A shell of half edge 1, with `count` points inside each edge and the six attachment points.
    """

    def __init__(self, count):
        corners, normals = vertices(1.0), face_geometry(1.0).normals
        part = ((np.arange(count) + 0.5) / count)[:, None]
        faces = np.array([
            [f for f in range(20) if set(edge) <= set(FACES[f].tolist())]
            for edge in EDGES.tolist()])
        self.points = np.vstack([
            *(corners[a] + part * (corners[b] - corners[a]) for a, b in EDGES.tolist()),
            edge_midpoints(1.0)])
        self.faces = np.vstack([np.repeat(faces, count, axis=0), NAMED_EDGE_FACES - 1])
        self.normals = normals[self.faces]
        rows, columns = [], []
        for face in range(20):
            there = np.flatnonzero((self.faces == face).any(axis=1))
            one, other = np.meshgrid(there, there)
            rows.append(one.ravel())
            columns.append(other.ravel())
        row, column = np.concatenate(rows), np.concatenate(columns)
        keep = row < column
        row, column = row[keep], column[keep]
        # Two faces may share two points: the same number twice would be added up.
        pairs = np.unique(np.stack([row, column]), axis=1)
        lengths = np.linalg.norm(self.points[pairs[0]] - self.points[pairs[1]], axis=1)
        size = len(self.points)
        graph = coo_array((lengths, tuple(pairs)), shape=(size, size)).tocsr()
        # Over the surface from each attachment point, (6, p).
        self.ways = dijkstra(graph, directed=False, indices=np.arange(size - 6, size))


def shortest(surface, position, axes, edges):
    """
    Length of the shortest way between midpoints of named edges of two shells of half edge 1.

    `position` (2, 3), `axes` (2, 3, 3) whose rows are body axes in the world, `edges` two codes.
    """
    points = [x + surface.points @ turn for x, turn in zip(position, axes)]
    normals = [surface.normals @ turn for turn in axes]
    span = points[1][None] - points[0][:, None]
    free = (np.einsum('pki,pqi->pqk', normals[0], span) >= -1e-12).any(axis=2)
    free &= (np.einsum('qki,pqi->pqk', normals[1], span) <= 1e-12).any(axis=2)
    total = surface.ways[edges[0]][:, None] + surface.ways[edges[1]][None]
    return np.where(free, total + np.linalg.norm(span, axis=2), np.inf).min()


@njit
def shortest_of_all(wrapping, pose, edge, far, far_edge):
    """
    Length of the shortest of all pairs of ways that are taut at both ends; infinite without one.
    """
    shortest = np.inf
    for way in range(-1, wrapping.ways.shape[1]):
        for far_way in range(-1, wrapping.ways.shape[1]):
            found, length = tighten(
                wrapping, pose, edge, way, far, far_edge, far_way, np.inf)
            if length < shortest and both_allowed(wrapping, pose, edge, far, far_edge, found):
                shortest = length
    return shortest
