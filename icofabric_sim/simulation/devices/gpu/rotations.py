# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Rotations on a GPU: the formulas of kernels/rotations.py and turning.py for one body.

Sines are computed by additions and multiplications alone, so that every device rounds them
equally.
"""

from importlib import import_module
from typing import Any

wp: Any = import_module('warp')

_DOUBLE = wp.float64
_ZERO_F64, _HALF, _ONE, _TWO = (wp.constant(_DOUBLE(x)) for x in (0.0, 0.5, 1.0, 2.0))
# Square of the half angle up to which the series below are exact to rounding.
_SERIES = wp.constant(_DOUBLE(1.0 / 64.0))
_C2, _C4, _C6, _C8, _C10 = (
    wp.constant(_DOUBLE(x)) for x in (
        -0.5, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40320.0, -1.0 / 3628800.0))
_S3, _S5, _S7, _S9, _S11 = (
    wp.constant(_DOUBLE(x)) for x in (
        -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362880.0, -1.0 / 39916800.0))
# fdlibm's polynomials of the sine and the cosine up to pi / 4, and pi / 2 in three parts.
_SINE_3, _SINE_5, _SINE_7, _SINE_9, _SINE_11, _SINE_13 = (
    wp.constant(_DOUBLE(x)) for x in (
        -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
        2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10))
_COSINE_4, _COSINE_6, _COSINE_8, _COSINE_10, _COSINE_12, _COSINE_14 = (
    wp.constant(_DOUBLE(x)) for x in (
        4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
        -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11))
_PER_QUARTER, _QUARTER_1, _QUARTER_2, _QUARTER_3 = (
    wp.constant(_DOUBLE(x)) for x in (
        6.36619772367581382433e-01, 1.57079632673412561417e+00, 6.07710050630396597660e-11,
        2.02226624879595063154e-21))
# Coefficients of mean_factors, from x^18 down.
_M18, _M16, _M14, _M12, _M10, _M8, _M6, _M4 = (
    wp.constant(_DOUBLE(x)) for x in (
        -1.0 / 121645100408832000.0, 1.0 / 355687428096000.0, -1.0 / 1307674368000.0,
        1.0 / 6227020800.0, -1.0 / 39916800.0, 1.0 / 362880.0, -1.0 / 5040.0, 1.0 / 120.0))
_SIXTH = wp.constant(_DOUBLE(1.0 / 6.0))


@wp.func
def sine_and_cosine(x: wp.float64):
    """Return sine and cosine to about one unit in the last place, for angles up to 1e6 rad."""
    quarters = wp.rint(x * _PER_QUARTER)
    r = ((x - quarters * _QUARTER_1) - quarters * _QUARTER_2) - quarters * _QUARTER_3
    z = r * r
    sine = r + r * z * (_SINE_3 + z * (_SINE_5 + z * (_SINE_7 + z * (
        _SINE_9 + z * (_SINE_11 + z * _SINE_13)))))
    cosine = _ONE - (_HALF * z - z * z * (_COSINE_4 + z * (_COSINE_6 + z * (_COSINE_8 + z * (
        _COSINE_10 + z * (_COSINE_12 + z * _COSINE_14))))))
    turn = wp.int64(quarters) & wp.int64(3)
    first, second = sine, cosine
    if turn == wp.int64(1):
        first, second = cosine, -sine
    if turn == wp.int64(2):
        first, second = -sine, -cosine
    if turn == wp.int64(3):
        first, second = -cosine, sine
    return first, second


@wp.func
def half_angle_factors(h: wp.float64, spin: wp.vec3d):
    """Return cos(|omega| h / 2) and sin(|omega| h / 2) / |omega|, smooth at zero."""
    half = _HALF * h
    square = wp.dot(spin, spin) * (half * half)
    cosine = _ONE + square * (_C2 + square * (_C4 + square * (_C6 + square * (
        _C8 + square * _C10))))
    sine = _ONE + square * (_S3 + square * (_S5 + square * (_S7 + square * (
        _S9 + square * _S11))))
    if square > _SERIES:
        angle = wp.sqrt(square)
        whole, other = sine_and_cosine(angle)
        sine = whole / angle
        cosine = other
    return cosine, sine * half


@wp.func
def rotated(q: wp.vec4d, spin: wp.vec3d, h: wp.float64):
    """Return a unit quaternion x y z w after `h` at constant omega, world axes (eq 22)."""
    cosine, sine = half_angle_factors(h, spin)
    ux, uy, uz = sine * spin[0], sine * spin[1], sine * spin[2]
    nx = cosine * q[0] + (ux * q[3] + (uy * q[2] - uz * q[1]))
    ny = cosine * q[1] + (uy * q[3] + (uz * q[0] - ux * q[2]))
    nz = cosine * q[2] + (uz * q[3] + (ux * q[1] - uy * q[0]))
    nw = cosine * q[3] - (ux * q[0] + (uy * q[1] + uz * q[2]))
    # One Newton step towards unit length: rounding does not accumulate.
    scale = _ONE + _HALF * (_ONE - (nx * nx + (ny * ny + (nz * nz + nw * nw))))
    return wp.vec4d(nx * scale, ny * scale, nz * scale, nw * scale)


@wp.func
def to_world(q: wp.vec4d, v: wp.vec3d):
    """Return the world components of a vector given in body axes (eq 26)."""
    axis = wp.vec3d(q[0], q[1], q[2])
    t = _TWO * wp.cross(axis, v)
    return v + (q[3] * t + wp.cross(axis, t))


@wp.func
def axes_of(q: wp.vec4d):
    """Return the body axes in world components: rows of a matrix (eqs 16 and 26)."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    return wp.mat33d(
        _ONE - _TWO * (y * y + z * z), _TWO * (x * y + w * z), _TWO * (x * z - w * y),
        _TWO * (x * y - w * z), _ONE - _TWO * (x * x + z * z), _TWO * (y * z + w * x),
        _TWO * (x * z + w * y), _TWO * (y * z - w * x), _ONE - _TWO * (x * x + y * y))


@wp.func
def on_axes(axes: wp.mat33d, v: wp.vec3d):
    """Return the world components of a vector given in body axes."""
    return wp.vec3d(
        v[0] * axes[0, 0] + (v[1] * axes[1, 0] + v[2] * axes[2, 0]),
        v[0] * axes[0, 1] + (v[1] * axes[1, 1] + v[2] * axes[2, 1]),
        v[0] * axes[0, 2] + (v[1] * axes[1, 2] + v[2] * axes[2, 2]))


@wp.func
def arm_on_axis(q: wp.vec4d, half_width: wp.float64, pair: int):
    """
    Return the arm [m], world frame, to the first edge of a pair: up (0), north (1), west (2).
    """
    x, y, z, w = q[0], q[1], q[2], q[3]
    two = _TWO * half_width
    if pair == 0:
        return wp.vec3d(
            two * (x * z + w * y), two * (y * z - w * x), half_width - two * (x * x + y * y))
    if pair == 1:
        return wp.vec3d(
            half_width - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y))
    return wp.vec3d(
        two * (x * y - w * z), half_width - two * (x * x + z * z), two * (y * z + w * x))


@wp.func
def turned_by(v: wp.vec3d, cosine: wp.float64, axis: wp.vec3d):
    """Return a vector rotated by the unit quaternion (axis, cosine)."""
    t = _TWO * wp.cross(axis, v)
    return v + (cosine * t + wp.cross(axis, t))


@wp.func
def mean_of_turning(v: wp.vec3d, spin: wp.vec3d, h: wp.float64):
    """
    Return the mean over `h` of a vector that rotates at omega from `v`, see terms/turning.py.
    """
    cosine, sine = half_angle_factors(h, spin)
    sine = sine * (_ONE / h)
    u = h * spin
    square = wp.dot(u, u)
    first = _TWO * sine * sine
    second = _SIXTH - square * (_M4 + square * (_M6 + square * (_M8 + square * (
        _M10 + square * (_M12 + square * (_M14 + square * (_M16 + square * _M18)))))))
    if square >= _ONE:
        second = (_ONE - _TWO * sine * cosine) / square
    c = wp.cross(u, v)
    return v + (first * c + second * wp.cross(u, c))
