# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Shortest ways around shells by brute force.

Points along all edges, and Dijkstra's algorithm; or every pair of ways, one after the other.
"""

from icofabric_sim.geometry.icosahedron import (
    edge_midpoints,
    EDGES,
    face_geometry,
    FACES,
    inscribed_radius,
    vertices,
)
from icofabric_sim.terms.wrapping.pairs import both_allowed, tighten
from numba import njit
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

CORNERS, NORMALS, HEIGHT = vertices(1.0), face_geometry(1.0).normals, inscribed_radius(1.0)


class Surface:
    """
    A shell of half edge 1, with `count` points inside each edge and six attachment points (6, 3).
    """

    def __init__(self, count, attachments=None):
        part = ((np.arange(count) + 0.5) / count)[:, None]
        faces = np.array([
            [f for f in range(20) if set(edge) <= set(FACES[f].tolist())]
            for edge in EDGES.tolist()])
        self.points = np.vstack([
            CORNERS[a] + part * (CORNERS[b] - CORNERS[a]) for a, b in EDGES.tolist()])
        self.attachments = edge_midpoints(1.0) if attachments is None else attachments
        self.faces = np.repeat(faces, count, axis=0)
        self.normals = NORMALS[self.faces]
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
        size = len(self.points)
        for k, point in enumerate(self.attachments):
            seen = np.flatnonzero(~enters(point, self.points))
            pairs = np.hstack([pairs, np.stack([seen, np.full(len(seen), size + k)])])
        places = np.vstack([self.points, self.attachments])
        lengths = np.linalg.norm(places[pairs[0]] - places[pairs[1]], axis=1)
        graph = coo_array((lengths, tuple(pairs)), shape=(size + 6, size + 6)).tocsr()
        # From each attachment point to the points along edges, (6, p).
        self.ways = dijkstra(
            graph, directed=False, indices=np.arange(size, size + 6))[:, :size]


def enters(start, ends):
    """Whether straight lines from a point to points (k, 3) lead through a shell of half edge 1."""
    over = NORMALS @ start - HEIGHT + 1e-9
    slopes = (ends - start) @ NORMALS.T
    with np.errstate(divide='ignore', invalid='ignore'):
        crossing = -over / slopes
    begin = np.where(slopes < 0.0, crossing, 0.0).max(axis=1).clip(0.0)
    end = np.where(slopes > 0.0, crossing, 1.0).min(axis=1).clip(None, 1.0)
    outside = ((slopes == 0.0) & (over >= 0.0)).any(axis=1)
    return (begin < end) & ~outside


def shortest(surface, position, axes, edges):
    """
    Length of the shortest way between attachment points of two shells of half edge 1.

    `position` (2, 3), `axes` (2, 3, 3) whose rows are body axes in the world, `edges` two codes.
    """
    points = [x + surface.points @ turn for x, turn in zip(position, axes)]
    normals = [surface.normals @ turn for turn in axes]
    span = points[1][None] - points[0][:, None]
    free = (np.einsum('pki,pqi->pqk', normals[0], span) >= -1e-12).any(axis=2)
    free &= (np.einsum('qki,pqi->pqk', normals[1], span) <= 1e-12).any(axis=2)
    total = surface.ways[edges[0]][:, None] + surface.ways[edges[1]][None]
    best = np.where(free, total + np.linalg.norm(span, axis=2), np.inf).min()
    ends = [
        x + surface.attachments[edge] @ turn for x, turn, edge in zip(position, axes, edges)]
    # Straight from one attachment point to a point of the other shell, and to the other one.
    for own, other in ((0, 1), (1, 0)):
        targets = np.vstack([points[other], ends[other]])
        way = np.append(surface.ways[edges[other]], 0.0)
        seen = ~enters(
            surface.attachments[edges[own]], (targets - position[own]) @ axes[own].T)
        back = ends[own] - targets
        seen[:-1] &= (np.einsum('pki,pi->pk', normals[other], back[:-1]) >= -1e-12).any(axis=1)
        seen[-1] &= not enters(
            surface.attachments[edges[other]],
            ((ends[own] - position[other]) @ axes[other].T)[None])[0]
        best = min(best, np.where(seen, way + np.linalg.norm(back, axis=1), np.inf).min())
    return best


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
