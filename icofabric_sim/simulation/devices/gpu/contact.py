# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Contact on a GPU: the law of terms/contacts/pair.py and surface.py, with one thread per pair.

All 400 pairs of faces are evaluated, also where the processor uses a closed form or starts from a
known pair. Three signs reject most pairs, and no thread waits for the search of another thread.
Each body then sums the forces of its pairs in order, without scattered writes.
"""

from importlib import import_module
from typing import Any

from icofabric_sim.simulation.devices.gpu.forces import place_of, turn_of
from icofabric_sim.simulation.devices.gpu.kernels import time_at
from icofabric_sim.simulation.devices.gpu.options import OPTIONS
from icofabric_sim.simulation.devices.gpu.records import Clock, Fabric, Nearness
from icofabric_sim.simulation.devices.gpu.rotations import axes_of, on_axes
from icofabric_sim.terms.contacts.shape import INNER, OUTER
import numpy as np

wp: Any = import_module('warp')

_DOUBLE = wp.float64
_ZERO_F64, _HALF, _ONE, _TWO, _THREE, _FOUR, _TWELVE = (
    wp.constant(_DOUBLE(x)) for x in (0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 12.0))
_RHO, _OUTER = wp.constant(_DOUBLE(INNER)), wp.constant(_DOUBLE(OUTER))
# As on the processor: round-off of a gap, distance of coincident centres, limit of parallel faces,
# and smallest volume.
_ROUND_OFF, _COINCIDENT, _PARALLEL_FACES, _MIN_VOLUME = (
    wp.constant(_DOUBLE(x)) for x in (1e-14, 1e-6, 1e-24, 1e-200))
_EIGHT = wp.constant(_DOUBLE(8.0))
# Squared sine of an angle below which edges are parallel. Overlap over a up to which the overlap
# along faces and centres may exceed the smallest one.
_PARALLEL, _SHALLOW = wp.constant(_DOUBLE(1e-12)), wp.constant(_DOUBLE(0.02))
# A polygon: x, y, z and depth of its corners. A pyramid has at most four corners, and each of
# three clipping sides adds one.
_Polygon = wp.types.matrix(shape=(8, 4), dtype=_DOUBLE)
# M_0, M_1, and the integrals of n, p n, x cross n, p x cross n.
_Sums = wp.types.vector(length=14, dtype=_DOUBLE)
# Results of a pair: force on the first body, torques on both for a stiffness of 1 N/m, and the
# contact flag.
PUSH_SIZE = 10
# Displacements that one thread folds.
SHARE = 256


@wp.func
def turned(m: wp.mat33d, v: wp.vec3d):
    """Return a matrix times a vector, with separate rounding: the product of Warp may be fused."""
    return wp.vec3d(
        m[0, 0] * v[0] + (m[0, 1] * v[1] + m[0, 2] * v[2]),
        m[1, 0] * v[0] + (m[1, 1] * v[1] + m[1, 2] * v[2]),
        m[2, 0] * v[0] + (m[2, 1] * v[1] + m[2, 2] * v[2]))


@wp.func
def between_axes(own: wp.mat33d, other: wp.mat33d):
    """Return the matrix from the axes of the second body to those of the first; rows are axes."""
    q = wp.mat33d()
    for i in range(3):
        for j in range(3):
            q[i, j] = own[i, 0] * other[j, 0] + (own[i, 1] * other[j, 1] + own[i, 2] * other[j, 2])
    return q


@wp.func
def across(near: Nearness, n: wp.vec3d):
    """Return half the width of a shell of half edge 1 along a vector, by pairs of vertices."""
    most = wp.float64(0.0)
    for k in range(6):
        most = wp.max(most, wp.abs(wp.dot(n, near.vertices[k])))
    return most


@wp.func
def section(near: Nearness, i: int, m: wp.vec3d, offset: wp.float64):
    """Cut pyramid i by the plane of equal depths, see `put_section`; return corners and count."""
    found, count = _Polygon(), int(0)
    centre = _RHO - offset
    for k in range(3):
        after = wp.where(k == 2, 0, k + 1)
        here, there = near.corners[3 * i + k], near.corners[3 * i + after]
        e, f = offset - wp.dot(m, here), offset - wp.dot(m, there)
        # If the centre is deeper below the other face than below its own, signs are reversed.
        inside, beyond = e > _ZERO_F64, f > _ZERO_F64
        if centre <= _ZERO_F64:
            inside, beyond = e < _ZERO_F64, f < _ZERO_F64
        if inside:
            # On the line from the centre to this corner.
            whole = _ONE / (centre + e)
            t = centre * whole
            for axis in range(3):
                found[count, axis] = t * here[axis]
            found[count, 3] = _RHO * (e * whole)
            count = count + 1
        if inside != beyond:
            # On the edge to the next corner.
            t = e / (e - f)
            for axis in range(3):
                found[count, axis] = here[axis] + t * (there[axis] - here[axis])
            found[count, 3] = _ZERO_F64
            count = count + 1
    return found, count


@wp.func
def clipped(polygon: _Polygon, count: int, r: wp.vec3d, limit: wp.float64):
    """Clip a polygon to r . x <= limit; return corners and count."""
    kept, left = _Polygon(), int(0)
    last = count - 1
    before = r[0] * polygon[last, 0] + r[1] * polygon[last, 1] + r[2] * polygon[last, 2] - limit
    for k in range(count):
        value = r[0] * polygon[k, 0] + r[1] * polygon[k, 1] + r[2] * polygon[k, 2] - limit
        if (value > _ZERO_F64) != (before > _ZERO_F64):
            t = before / (before - value)
            for n in range(4):
                kept[left, n] = polygon[last, n] + t * (polygon[k, n] - polygon[last, n])
            left = left + 1
        if value <= _ZERO_F64:
            for n in range(4):
                kept[left, n] = polygon[k, n]
            left = left + 1
        last = k
        before = value
    return kept, left


@wp.func
def corner_of(polygon: _Polygon, k: int):
    """Return the position of a corner."""
    return wp.vec3d(polygon[k, 0], polygon[k, 1], polygon[k, 2])


@wp.func
def with_polygon(
    sums: _Sums, polygon: _Polygon, count: int, n: wp.vec3d, h: wp.float64, facing: wp.float64
):
    """
    Add the integrals over a polygon with unit normal n, see `add_integrals`.

    `facing` is the contribution of the field of a plane, see `add_plane`; 0 for shells.
    """
    found = sums
    first = corner_of(polygon, 0)
    p0 = polygon[0, 3]
    area, depth, squares = wp.float64(0.0), wp.float64(0.0), wp.float64(0.0)
    zeroth, powers = wp.float64(0.0), wp.float64(0.0)
    at, deep = wp.vec3d(), wp.vec3d()
    second = corner_of(polygon, 1)
    p1 = polygon[1, 3]
    for k in range(2, count):
        third = corner_of(polygon, k)
        p2 = polygon[k, 3]
        part = _HALF * wp.abs(wp.dot(n, wp.cross(second - first, third - first)))
        e1 = p0 + p1 + p2
        e2 = p0 * p1 + p1 * p2 + p2 * p0
        e3 = p0 * p1 * p2
        shared = part / ((_RHO - p0) * (_RHO - p1) * (_RHO - p2))
        zeroth = zeroth + shared * (_RHO * (_RHO * e1 - e2) + e3)
        powers = powers + shared * (_RHO * (_RHO * (e1 * e1 - e2) - (e1 * e2 - e3)) + e1 * e3)
        area = area + part
        depth = depth + part * e1
        squares = squares + part * (e1 * e1 - e2)
        middle = first + second + third
        at = at + part * middle
        deep = deep + part * (e1 * middle + (p0 * first + p1 * second + p2 * third))
        second = third
        p1 = p2
    found[0] = found[0] + (h * zeroth + facing * depth) / _THREE
    found[1] = found[1] + (h * powers + facing * squares) / _TWELVE
    turning, deeper = wp.cross(at, n) / _THREE, wp.cross(deep, n) / _TWELVE
    for axis in range(3):
        found[2 + axis] = found[2 + axis] + area * n[axis]
        found[5 + axis] = found[5 + axis] + depth / _THREE * n[axis]
        found[8 + axis] = found[8 + axis] + turning[axis]
        found[11 + axis] = found[11 + axis] + deeper[axis]
    return found


@wp.func
def with_faces(near: Nearness, sums: _Sums, i: int, j: int, c: wp.vec3d, q: wp.mat33d):
    """Add the polygon between face i of a body and face j of another at c, see `add_polygon`."""
    m = turned(q, near.normals[j])
    centre = wp.dot(m, c)
    polygon, count = section(near, i, m, _RHO + centre)
    side = int(0)
    while count > 0 and side < 3:
        r = turned(q, near.normals[near.neighbours[3 * j + side]]) - m
        polygon, count = clipped(polygon, count, r, wp.dot(r, c))
        side = side + 1
    n = near.normals[i] - m
    square = wp.dot(n, n)
    # For parallel faces, planes of equal depth are nowhere or everywhere.
    if count > 2 and square > _PARALLEL_FACES:
        n = n * (_ONE / wp.sqrt(square))
        return with_polygon(sums, polygon, count, n, wp.dot(n, c), _ZERO_F64)
    return sums


@wp.func
def with_plane(near: Nearness, sums: _Sums, i: int, m: wp.vec3d, offset: wp.float64):
    """Add the polygon between face i and a plane, see `add_section`."""
    polygon, count = section(near, i, m, offset)
    n = near.normals[i] - m
    square = wp.dot(n, n)
    if count > 2 and square > _PARALLEL_FACES:
        scale = _ONE / wp.sqrt(square)
        n = n * scale
        return with_polygon(
            sums, polygon, count, n, (_RHO - offset) * scale, -wp.dot(m, n))
    return sums


@wp.func
def pushed(sums: _Sums, half_edge: wp.float64, own: wp.mat33d):
    """Return force [N] and torque [N m] on the first body for a stiffness of 1 N/m, see `push`."""
    mean = sums[1] / sums[0]
    factor = -_FOUR * (_FOUR * mean) * half_edge / sums[0]
    force = factor * (
        wp.vec3d(sums[5], sums[6], sums[7]) - mean * wp.vec3d(sums[2], sums[3], sums[4]))
    torque = factor * half_edge * (
        wp.vec3d(sums[11], sums[12], sums[13]) - mean * wp.vec3d(sums[8], sums[9], sums[10]))
    return on_axes(own, force), on_axes(own, torque)


@wp.func
def gap_of(near: Nearness, c: wp.vec3d, q: wp.mat33d):
    """
    Return the widest gap along the line of centres and the normals of faces, over a.

    A positive gap proves that two shells are apart; a negative gap is at most minus their depth.
    """
    length = wp.sqrt(wp.dot(c, c))
    u = c / length
    gap = length - across(near, u) - across(near, on_axes(q, u))
    far = on_axes(q, c)
    for face in range(20):
        n = near.normals[face]
        gap = wp.max(gap, wp.dot(n, c) - _RHO - across(near, on_axes(q, n)))
        gap = wp.max(gap, wp.dot(n, far) - _RHO - across(near, turned(q, n)))
    return gap


@wp.func
def gap_across_edges(near: Nearness, c: wp.vec3d, q: wp.mat33d, least: wp.float64):
    """Return the widest gap, given that of `gap_of`, by also testing products of edges."""
    gap = least + wp.float64(0.0)
    for own in range(15):
        for other in range(15):
            n = wp.cross(near.edges[own], turned(q, near.edges[other]))
            square = wp.dot(n, n)
            if square > _PARALLEL:
                u = n / wp.sqrt(square)
                far = across(near, u) + across(near, on_axes(q, u))
                gap = wp.max(gap, wp.abs(wp.dot(u, c)) - far)
    return gap


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def touch(fabric: Fabric, near: Nearness, pose: wp.array(dtype=wp.float64)):
    """Evaluate the listed pairs, one per thread."""
    p = wp.tid()
    if p >= near.count[0]:
        return
    s, t, n = near.pairs[2 * p], near.pairs[2 * p + 1], fabric.stride
    a = near.half_edge
    place, own = place_of(pose, n, s), axes_of(turn_of(pose, n, s))
    force, torque, other = wp.vec3d(), wp.vec3d(), wp.vec3d()
    touches, overlap = wp.float64(0.0), wp.float64(0.0)
    sums = _Sums()
    if t < 0:
        k = 4 * (-1 - t)
        normal = wp.vec3d(near.planes[k], near.planes[k + 1], near.planes[k + 2])
        height = (wp.dot(normal, place) - near.planes[k + 3]) / a
        m = turned(own, normal)
        depth = across(near, m) - height
        if height < _OUTER and depth > _ZERO_F64:
            for i in range(20):
                sums = with_plane(near, sums, i, m, -height)
            if sums[0] > _MIN_VOLUME:
                force, torque = pushed(sums, a, own)
                touches, overlap = _ONE, depth * a
    else:
        d = place_of(pose, n, t) - place
        if wp.dot(d, d) < _FOUR * _OUTER * _OUTER * a * a:
            c = turned(own, d / a)
            q = between_axes(own, axes_of(turn_of(pose, n, t)))
            if wp.max(wp.abs(c[0]), wp.max(wp.abs(c[1]), wp.abs(c[2]))) > _COINCIDENT:
                gap = gap_of(near, c, q)
                if gap <= _ROUND_OFF:
                    for i in range(20):
                        for j in range(20):
                            sums = with_faces(near, sums, i, j, c, q)
                    if sums[0] > _MIN_VOLUME:
                        force, torque = pushed(sums, a, own)
                        other = wp.cross(d, force) - torque
                        if gap < -_SHALLOW:
                            gap = gap_across_edges(near, c, q, gap)
                        touches, overlap = _ONE, wp.max(_ZERO_F64, -gap) * a
            else:
                touches, overlap = _ONE, _TWO * _RHO * a
    at = PUSH_SIZE * p
    for k in range(3):
        near.pushes[at + k] = force[k]
        near.pushes[at + 3 + k] = torque[k]
        near.pushes[at + 6 + k] = other[k]
    near.pushes[at + 9] = touches
    near.depths[2 * p] = overlap
    near.depths[2 * p + 1] = wp.max(near.depths[2 * p + 1], overlap)


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def add_up(fabric: Fabric, near: Nearness):
    """Sum the forces [N] and torques [N m] of each body over its pairs in order."""
    s = wp.tid()
    force, torque = wp.vec3d(), wp.vec3d()
    for e in range(near.start[s], near.start[s + 1]):
        p, side = near.entry[e] >> 1, near.entry[e] & 1
        at = PUSH_SIZE * p
        if near.pushes[at + 9] != _ZERO_F64:
            k = wp.where(side == 0, near.stiffness, -near.stiffness)
            turning = at + 3 + 3 * side
            force = force + k * wp.vec3d(
                near.pushes[at], near.pushes[at + 1], near.pushes[at + 2])
            torque = torque + near.stiffness * wp.vec3d(
                near.pushes[turning], near.pushes[turning + 1], near.pushes[turning + 2])
    for k in range(3):
        near.rows[k * fabric.stride + s] = force[k]
        near.rows[(k + 3) * fabric.stride + s] = torque[k]


@wp.func
def way_of(near: Nearness, pose: wp.array(dtype=wp.float64), n: int, s: int, time: wp.float64):
    """Return the squared displacement [m^2] of a body since the last search, at a `time` [s]."""
    t = time - near.frame[0]
    way, turn = wp.float64(0.0), wp.float64(0.0)
    for k in range(3):
        shift = t * (near.frame[1 + k] + t * near.frame[4 + k])
        u = pose[k * n + s] - near.reference[k * n + s] - shift
        way = way + u * u
    for k in range(3, 7):
        u = pose[k * n + s] - near.reference[k * n + s]
        turn = turn + u * u
    return _TWO * way + _EIGHT * near.radius * near.radius * turn


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def note_ways(
    fabric: Fabric, near: Nearness, clock: Clock, step: int, drifts: int,
    pose: wp.array(dtype=wp.float64)
):
    """Update the largest squared displacement [m^2] of each body since the last search."""
    thread = wp.tid()
    block = thread / fabric.lanes
    lane = thread - block * fabric.lanes
    if (int(fabric.alive[block]) >> lane) & 1 == 0:
        return
    s, n = fabric.slot[block] + lane, fabric.stride
    near.ways[s] = wp.max(
        near.ways[s], way_of(near, pose, n, s, time_at(clock, step, drifts)))


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def fold_ways(values: wp.array(dtype=wp.float64), count: int, found: wp.array(dtype=wp.float64)):
    """Return the largest of each share of values in `found`, and reset the values."""
    share = wp.tid()
    most = wp.float64(0.0)
    for k in range(SHARE * share, wp.min(SHARE * share + SHARE, count)):
        most = wp.max(most, values[k])
        values[k] = _ZERO_F64
    found[share] = most


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def fold_pushes(fabric: Fabric, near: Nearness, found: wp.array(dtype=wp.float64)):
    """Sum squared mass-scaled contact forces of each block, see terms/contacts/stiffness.py."""
    block = wp.tid()
    n, total = fabric.stride, wp.float64(0.0)
    for lane in range(fabric.lanes):
        s = fabric.slot[block] + lane
        forces, torques = wp.float64(0.0), wp.float64(0.0)
        for k in range(3):
            forces = forces + near.rows[k * n + s] * near.rows[k * n + s]
            torques = torques + near.rows[(k + 3) * n + s] * near.rows[(k + 3) * n + s]
        total = total + (fabric.inverse_mass * forces + fabric.inverse_inertia * torques)
    found[block] = total


def one_of_each(vectors: np.ndarray) -> np.ndarray:
    """Return the first of each pair of opposite or equal vectors (n, 3)."""
    chosen: list[np.ndarray] = []
    for row in vectors:
        if not any(np.allclose(row, -other) or np.allclose(row, other) for other in chosen):
            chosen.append(row)
    return np.array(chosen)
