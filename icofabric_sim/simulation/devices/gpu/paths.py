# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Bodies on prescribed paths on a GPU: the formulas of terms/drives/path.py for one body.

A row of the loads with a negative number is a path, or an anchor after all paths.
"""

from importlib import import_module
from typing import Any

from icofabric_sim.simulation.devices.gpu.forces import place_of, turn_of
from icofabric_sim.simulation.devices.gpu.options import OPTIONS
from icofabric_sim.simulation.devices.gpu.records import Acting, Fabric
from icofabric_sim.simulation.devices.gpu.rotations import sine_and_cosine, turned_by

wp: Any = import_module('warp')

_DOUBLE = wp.float64
_ZERO_F64, _HALF, _ONE, _TWO, _THREE = (wp.constant(_DOUBLE(x)) for x in (0.0, 0.5, 1.0, 2.0, 3.0))
# Largest squared angle of the series, and their coefficients, see `place_row`.
_SERIES = wp.constant(_DOUBLE(1e-4))
_S2, _S4, _S6 = (wp.constant(_DOUBLE(x)) for x in (1.0 / 48.0, 1.0 / 3840.0, 1.0 / 645120.0))
_C2, _C4, _C6 = (wp.constant(_DOUBLE(x)) for x in (0.125, 1.0 / 384.0, 1.0 / 46080.0))
_T2, _T4, _T6 = (wp.constant(_DOUBLE(x)) for x in (1.0 / 24.0, 1.0 / 720.0, 1.0 / 40320.0))
_U0, _U2, _U4, _U6 = (
    wp.constant(_DOUBLE(x)) for x in (1.0 / 6.0, 1.0 / 120.0, 1.0 / 5040.0, 1.0 / 362880.0))


@wp.func
def path_of(acting: Acting, m: int):
    """Return the path of the bodies of row `m`; negative without a path."""
    p = -1 - acting.wrench[m]
    if p >= acting.paths:
        return -1
    return p


@wp.func
def is_of(acting: Acting, m: int, lane: int):
    """Return True if row `m` acts on the body in a lane."""
    return (int(acting.lanes[m]) >> lane) & 1 == 1


@wp.func
def moves(acting: Acting, p: int, k: int):
    """Return True if path `p` prescribes x, y, z (0 to 2) or the rotation (3)."""
    return int(acting.path_moves[4 * p + k]) != 0


@wp.func
def coordinate(acting: Acting, p: int, k: int, t: wp.float64, sine: wp.float64):
    """Return coordinate `k` of a path at `t` after its segment started."""
    at = 24 * p + k
    return acting.path_cubic[at] + t * (acting.path_cubic[at + 6] + t * (
        acting.path_cubic[at + 12] + t * acting.path_cubic[at + 18])) + (
            acting.path_wave[6 * p + k] * sine)


@wp.func
def speed_of(acting: Acting, p: int, k: int, t: wp.float64, cosine: wp.float64):
    """Return the derivative of coordinate `k` of a path."""
    at = 24 * p + k
    return acting.path_cubic[at + 6] + t * (_TWO * acting.path_cubic[at + 12] + t * (
        _THREE * acting.path_cubic[at + 18])) + (
            acting.path_wave[6 * p + k] * acting.path_rate[p] * cosine)


@wp.func
def driven(
    acting: Acting, m: int, s: int, n: int, time: wp.float64, place: wp.vec3d, turn: wp.vec4d,
    velocity: wp.vec3d, spin: wp.vec3d
):
    """Return pose and velocities of a body on the path of row `m` at a `time` [s]."""
    p = path_of(acting, m)
    t = time - acting.path_start[p]
    sine, cosine = sine_and_cosine(acting.path_rate[p] * t + acting.path_phase[p])
    r = wp.vec3d(
        coordinate(acting, p, 3, t, sine), coordinate(acting, p, 4, t, sine),
        coordinate(acting, p, 5, t, sine))
    a = wp.vec3d(
        speed_of(acting, p, 3, t, cosine), speed_of(acting, p, 4, t, cosine),
        speed_of(acting, p, 5, t, cosine))
    square = wp.dot(r, r)
    half = _HALF - square * (_S2 - square * (_S4 - square * _S6))
    whole = _ONE - square * (_C2 - square * (_C4 - square * _C6))
    second = _HALF - square * (_T2 - square * (_T4 - square * _T6))
    third = _U0 - square * (_U2 - square * (_U4 - square * _U6))
    if square > _SERIES:
        angle = wp.sqrt(square)
        up, along = sine_and_cosine(_HALF * angle)
        full, rest = sine_and_cosine(angle)
        half = up / angle
        whole = along
        second = _TWO * half * half
        third = (angle - full) / (square * angle)
    b = wp.cross(r, a)
    turning = a + second * b + third * wp.cross(r, b)
    # Q = exp(r) Q0.
    u = half * r
    g = wp.vec3d(acting.path_turn[4 * p], acting.path_turn[4 * p + 1], acting.path_turn[4 * p + 2])
    w = acting.path_turn[4 * p + 3]
    q = whole * g + w * u + wp.cross(u, g)
    qw = whole * w - wp.dot(u, g)
    arm = turned_by(
        wp.vec3d(acting.path_arm[s], acting.path_arm[n + s], acting.path_arm[2 * n + s]), qw, q)
    carried = wp.cross(turning, arm)
    # Arguments must not be modified.
    x, v0, o, q0 = _ONE * place, _ONE * velocity, spin, turn
    for k in range(3):
        if moves(acting, p, k):
            x[k] = acting.path_base[3 * p + k] + coordinate(acting, p, k, t, sine) + arm[k]
            v0[k] = speed_of(acting, p, k, t, cosine) + carried[k]
    if moves(acting, p, 3):
        o = turning
        v = wp.vec3d(
            acting.path_first[s], acting.path_first[n + s], acting.path_first[2 * n + s])
        z = acting.path_first[3 * n + s]
        vector = qw * v + z * q + wp.cross(q, v)
        q0 = wp.vec4d(vector[0], vector[1], vector[2], qw * z - wp.dot(q, v))
    return x, q0, v0, o


@wp.func
def on_paths(
    acting: Acting, block: int, lane: int, s: int, n: int, time: wp.float64, place: wp.vec3d,
    turn: wp.vec4d, velocity: wp.vec3d, spin: wp.vec3d
):
    """Return pose and velocities of a body after all of its paths, if any."""
    x, q, v, o = place, turn, velocity, spin
    for m in range(acting.start[block], acting.start[block + 1]):
        if is_of(acting, m, lane) and path_of(acting, m) >= 0:
            x, q, v, o = driven(acting, m, s, n, time, x, q, v, o)
    return x, q, v, o


@wp.func
def standing(acting: Acting, block: int, lane: int, velocity: wp.vec3d):
    """Return a velocity without components along the paths of a body, where loads do no work."""
    v = _ONE * velocity
    for m in range(acting.start[block], acting.start[block + 1]):
        p = path_of(acting, m)
        if is_of(acting, m, lane) and p >= 0:
            for k in range(3):
                if moves(acting, p, k):
                    v[k] = _ZERO_F64
    return v


@wp.func
def path_power(
    acting: Acting, p: int, mass: wp.float64, inertia: wp.float64, velocity: wp.vec3d,
    spin: wp.vec3d, linear: wp.vec3d, angular: wp.vec3d
):
    """Return the power [W] of forces that accelerate a body along the freedoms of path `p`."""
    total = wp.float64(0.0)
    for k in range(3):
        if moves(acting, p, k):
            total = total + linear[k] * velocity[k]
    turning = wp.float64(0.0)
    if moves(acting, p, 3):
        turning = wp.dot(angular, spin)
    return mass * total + inertia * turning


@wp.func
def left_free(acting: Acting, p: int, linear: wp.vec3d, angular: wp.vec3d):
    """Return the accelerations of a body without those along the freedoms of path `p`."""
    a, b = _ONE * linear, angular
    for k in range(3):
        if moves(acting, p, k):
            a[k] = _ZERO_F64
    if moves(acting, p, 3):
        b = wp.vec3d(_ZERO_F64, _ZERO_F64, _ZERO_F64)
    return a, b


@wp.func
def resisted(
    fabric: Fabric, acting: Acting, block: int, lane: int, mass: wp.float64, inertia: wp.float64,
    velocity: wp.vec3d, spin: wp.vec3d, linear: wp.vec3d, angular: wp.vec3d, h: wp.float64,
    again: wp.float64
):
    """
    Return the accelerations of a body without those that the reactions of its paths balance.

    The work of the paths over kicks of `h` and `again` is added in this order.
    """
    a, b = linear, angular
    for m in range(acting.start[block], acting.start[block + 1]):
        p = path_of(acting, m)
        if is_of(acting, m, lane) and p >= 0:
            power = path_power(acting, p, mass, inertia, velocity, spin, a, b)
            at = fabric.lanes * m + lane
            more = acting.work[at] - h * power
            if again != _ZERO_F64:
                more = more - again * power
            acting.work[at] = more
            a, b = left_free(acting, p, a, b)
    return a, b


@wp.func
def borne(
    acting: Acting, block: int, lane: int, velocity: wp.vec3d, spin: wp.vec3d,
    kicked: wp.vec3d, turned: wp.vec3d
):
    """Return the velocities after loads, without changes that the reactions of paths balance."""
    v, o = _ONE * kicked, turned
    for m in range(acting.start[block], acting.start[block + 1]):
        p = path_of(acting, m)
        if is_of(acting, m, lane) and p >= 0:
            for k in range(3):
                if moves(acting, p, k):
                    v[k] = velocity[k]
            if moves(acting, p, 3):
                o = spin
    return v, o


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def place_driven(
    fabric: Fabric, acting: Acting, time: wp.float64, pose: wp.array(dtype=wp.float64),
    motion: wp.array(dtype=wp.float64)
):
    """Set all driven bodies to the poses of their paths at a `time` [s]."""
    thread = wp.tid()
    block = thread / fabric.lanes
    lane = thread - block * fabric.lanes
    if (int(fabric.alive[block]) >> lane) & 1 == 0:
        return
    if acting.start[block] == acting.start[block + 1]:
        return
    s, n = fabric.slot[block] + lane, fabric.stride
    velocity = wp.vec3d(motion[s], motion[n + s], motion[2 * n + s])
    spin = wp.vec3d(motion[3 * n + s], motion[4 * n + s], motion[5 * n + s])
    x, q, v, o = on_paths(
        acting, block, lane, s, n, time, place_of(pose, n, s), turn_of(pose, n, s), velocity, spin)
    for k in range(3):
        pose[k * n + s] = x[k]
        motion[k * n + s] = v[k]
        motion[(k + 3) * n + s] = o[k]
    for k in range(4):
        pose[(k + 3) * n + s] = q[k]
