# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs of icosahedra at first touch, and an independent way to integrate over their overlap."""

from icofabric_sim.geometry.icosahedron import face_geometry, inscribed_radius, vertices
from icofabric_sim.terms.contacts.axis import find_facet
from icofabric_sim.terms.contacts.pair import (
    approach,
    contact_scratch,
    OUT_SIZE,
    press_surface,
    push,
    touch_pair,
    touch_plane,
)
from icofabric_sim.terms.contacts.surface import add_plane, SUM_COUNT, SUMS
import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection
from scipy.spatial.transform import Rotation

NORMALS = face_geometry(1.0).normals
VERTICES = vertices(1.0)
RHO = inscribed_radius(1.0)
SCRATCH = contact_scratch()
KINDS = ('random', 'alike', 'face on face', 'tilted face', 'vertex on vertex', 'vertex on face',
         'edge on edge', 'parallel edges', 'quarter turns')


def touch(xa, ra, xb, rb, half_edge=1.0, other_edge=None):
    """What `touch_pair` says, as (whether, out)."""
    out = np.full(OUT_SIZE, np.nan)
    touching = touch_pair(
        half_edge, other_edge or half_edge, np.array(xa, float), np.array(ra, order='C'),
        np.array(xb, float), np.array(rb, order='C'), SCRATCH, out)
    return touching, out


def touch_floor(normal, offset, xa, ra, half_edge=1.0):
    """The same of `touch_plane`."""
    out = np.full(OUT_SIZE, np.nan)
    touching = touch_plane(half_edge, np.array(normal, float), float(offset),
                           np.array(xa, float), np.array(ra, order='C'), SCRATCH, out)
    return touching, out


def by_polygons(xa, ra, xb, rb):
    """
    What all polygons between two bodies that overlap say, as `touch`; their sums are in SCRATCH.
    """
    out, room, d = np.zeros(OUT_SIZE), SCRATCH.room, xb - xa
    c = approach(1.0, 1.0, *d, ra, rb, room)
    verdict, *found = find_facet(room, *c)
    touching, *_, gap = press_surface(1.0, ra, verdict, *c, *found, room, SCRATCH.marks, out)
    out[6:9] = np.cross(d, out[0:3]) - out[3:6]
    out[11], out[15:18] = -gap, out[15:18] - 0.5 * d
    return touching, out


def floor_by_polygons(normal, offset, xa, ra):
    """The same of a plane."""
    out, room = np.zeros(OUT_SIZE), SCRATCH.room
    room[SUMS:SUMS + SUM_COUNT] = 0.0
    add_plane(room, *(ra.T @ normal), offset - normal @ xa)
    push(1.0, ra, room, out)
    return out


def wrench(out):
    """Forces and torques about their own centres on A and B, (12,)."""
    return np.concatenate([out[0:3], out[3:6], -out[0:3], out[6:9]])


def turned(rotation, axis, angle):
    """A matrix after a further turn about an axis of the world."""
    axis = np.asarray(axis) / np.linalg.norm(axis)
    return Rotation.from_rotvec(axis * angle).as_matrix() @ rotation


def facing(rotation, own, target):
    """The rotation turned so that a direction in body axes looks along another of the world."""
    now = rotation @ own
    return Rotation.align_vectors([target], [now])[0].as_matrix() @ rotation


def pose(kind, rng):
    """Two matrices and a unit vector, along which the second body comes to the first."""
    ra, rb = (Rotation.random(random_state=rng).as_matrix() for _ in range(2))
    way = rng.normal(size=3)
    if kind == 'alike':
        rb = ra.copy()
        mid = (VERTICES[0] + VERTICES[1]) / 2.0
        choice = [VERTICES[rng.integers(12)], NORMALS[rng.integers(20)], mid,
                  rng.normal(size=3), np.array([1.0, 1.0, 0.0])]
        way = ra @ choice[rng.integers(5)]
    elif kind in ('face on face', 'tilted face'):
        way = ra @ NORMALS[rng.integers(20)]
        rb = turned(facing(rb, NORMALS[rng.integers(20)], -way), way, 6.0 * rng.random())
        if kind == 'tilted face':
            rb = turned(rb, rng.normal(size=3), 10.0 ** rng.uniform(-7, -1))
        if rng.random() < 0.7:
            way = way + rng.choice([0.1, 0.3]) * rng.normal(size=3)
    elif kind.startswith('vertex'):
        way = ra @ VERTICES[rng.integers(12)]
        other = VERTICES[rng.integers(12)] if kind == 'vertex on vertex' else (
            NORMALS[rng.integers(20)])
        rb = facing(rb, other, -way)
        if kind == 'vertex on face':
            way = way + 0.02 * rng.normal(size=3)
    elif kind in ('edge on edge', 'parallel edges'):
        way = ra @ np.eye(3)[rng.integers(3)]
        rb = facing(ra, np.eye(3)[rng.integers(3)], -way)
        if kind == 'edge on edge':
            rb = turned(rb, way, rng.random() * 6.0)
            way = way + 0.05 * rng.normal(size=3)
    elif kind == 'quarter turns':
        rb = ra @ np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        way = ra @ (rng.integers(0, 3, size=3) + np.array([1.0, 0.0, 0.0]))
    return np.ascontiguousarray(ra), np.ascontiguousarray(rb), way / np.linalg.norm(way)


def first_touch(ra, rb, way):
    """Distance of the centres at which they begin to touch."""
    low, high = 1.0, 4.0
    for _ in range(54):
        middle = (low + high) / 2.0
        if touch(np.zeros(3), ra, middle * way, rb)[0]:
            low = middle
        else:
            high = middle
    return low


def half_spaces(x, rotation, half_edge=1.0):
    """Rows (n, -rho - n . x): n . y + b is minus the depth of y below a face."""
    normals = NORMALS @ rotation.T
    return np.c_[normals, -half_edge * RHO - normals @ x]


def moments(*bodies):
    """
    M_0 and M_1 of the overlap of half spaces, cell by cell of the face that is nearest.

    Each cell is the hull of its corners, cut into tetrahedra, over which a depth is linear.
    """
    rows = np.concatenate(bodies)
    volume = first = 0.0
    for k, own in enumerate(rows):
        # depth_k <= depth_j for all others, depth_k >= 0.
        cell = np.concatenate([np.delete(rows, k, axis=0) - own, own[None]])
        inside = deepest(cell)
        if inside is None:
            continue
        corners = HalfspaceIntersection(cell, inside).intersections
        for triangle in ConvexHull(corners).simplices:
            p = np.concatenate([corners[triangle], inside[None]])
            part = abs(np.linalg.det(p[:3] - inside)) / 6.0
            volume += part
            first -= part * (own[:3] @ p.mean(axis=0) + own[3])
    return volume, first


def deepest(rows):
    """The centre of the largest ball inside half spaces, or None."""
    sizes = np.linalg.norm(rows[:, :3], axis=1)
    some = sizes > 1e-9
    if (rows[~some, 3] > 0.0).any():
        return None
    found = linprog([0, 0, 0, -1.0], A_ub=np.c_[rows[some, :3], sizes[some]],
                    b_ub=-rows[some, 3], bounds=[(None, None)] * 3 + [(0.0, None)],
                    method='highs')
    return found.x[:3] if found.status == 0 and found.x[3] > 1e-9 else None
