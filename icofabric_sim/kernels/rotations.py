# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Rotations of bodies: unit quaternions (10 N form) or direction cosines (15 N form).

Slots last: an orientation array of shape (4, s) holds quaternions x y z w (eqs 21-27); one of
shape (3, 3, s) holds mu_ij = e_i . e0_j (eqs 16-20), whose row i is body axis i in world
components. The number of dimensions is a constant of the compiled kernel.
"""

import math

from icofabric_sim.kernels.runtime.compiled import compiled, inlined
from icofabric_sim.kernels.runtime.lanes import (
    any_lane,
    fma,
    insert,
    lane,
    LANES,
    load,
    splat,
    store,
    store_at,
    Vector,
)
import numpy as np

# Largest square of the half angle for which the series below are exact to rounding.
_SERIES = 1.0 / 64.0

Three = tuple[Vector, Vector, Vector]
# World components of the body axes x, y and z.
Nine = tuple[Vector, Vector, Vector, Vector, Vector, Vector, Vector, Vector, Vector]


@compiled
def rows_of(orientation: np.ndarray) -> np.ndarray:
    """Return orientations as (4, s) or (9, s)."""
    if orientation.ndim == 3:
        return orientation.reshape(9, orientation.shape[2])
    else:
        return orientation


@compiled
def to_world(
    orientation: np.ndarray, s: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return world components of a vector on the axes of the body in slot `s` (eq 26)."""
    if orientation.ndim == 2:
        qx, qy, qz, qw = orientation[0, s], orientation[1, s], orientation[2, s], orientation[3, s]
        tx = 2.0 * (qy * z - qz * y)
        ty = 2.0 * (qz * x - qx * z)
        tz = 2.0 * (qx * y - qy * x)
        return (
            x + qw * tx + qy * tz - qz * ty,
            y + qw * ty + qz * tx - qx * tz,
            z + qw * tz + qx * ty - qy * tx,
        )
    else:
        return (
            x * orientation[0, 0, s] + y * orientation[1, 0, s] + z * orientation[2, 0, s],
            x * orientation[0, 1, s] + y * orientation[1, 1, s] + z * orientation[2, 1, s],
            x * orientation[0, 2, s] + y * orientation[1, 2, s] + z * orientation[2, 2, s],
        )


@compiled
def turn_to_world(
    orientation: np.ndarray, s: int, x: Vector, y: Vector, z: Vector
) -> tuple[Vector, Vector, Vector]:
    """Return world components of vectors on the axes of the bodies of a block (eq 26)."""
    if orientation.ndim == 2:
        qx, qy = load(orientation, 0, s), load(orientation, 1, s)
        qz, qw = load(orientation, 2, s), load(orientation, 3, s)
        two = splat(2.0)
        tx, ty, tz = qy * z - qz * y, qz * x - qx * z, qx * y - qy * x
        tx, ty, tz = two * tx, two * ty, two * tz
        return (
            x + fma(qw, tx, qy * tz - qz * ty), y + fma(qw, ty, qz * tx - qx * tz),
            z + fma(qw, tz, qx * ty - qy * tx))
    else:
        east, north, up = orientation[0], orientation[1], orientation[2]
        return (
            fma(x, load(east, 0, s), fma(y, load(north, 0, s), z * load(up, 0, s))),
            fma(x, load(east, 1, s), fma(y, load(north, 1, s), z * load(up, 1, s))),
            fma(x, load(east, 2, s), fma(y, load(north, 2, s), z * load(up, 2, s))))


@compiled
def axes_of_lanes(orientation: np.ndarray, s: int) -> Nine:
    """Return world components of the body axes (eqs 16 and 26) of the block at slot `s`."""
    if orientation.ndim == 2:
        x, y = load(orientation, 0, s), load(orientation, 1, s)
        z, w = load(orientation, 2, s), load(orientation, 3, s)
        one, two = splat(1.0), splat(2.0)
        return (
            one - two * fma(y, y, z * z), two * fma(x, y, w * z), two * (x * z - w * y),
            two * (x * y - w * z), one - two * fma(x, x, z * z), two * fma(y, z, w * x),
            two * fma(x, z, w * y), two * (y * z - w * x), one - two * fma(x, x, y * y))
    else:
        east, north, up = orientation[0], orientation[1], orientation[2]
        return (
            load(east, 0, s), load(east, 1, s), load(east, 2, s),
            load(north, 0, s), load(north, 1, s), load(north, 2, s),
            load(up, 0, s), load(up, 1, s), load(up, 2, s))


@compiled
def on_axes(axes: Nine, x: Vector, y: Vector, z: Vector) -> Three:
    """Return world components of a vector given on body axes."""
    return (
        fma(x, axes[0], fma(y, axes[3], z * axes[6])),
        fma(x, axes[1], fma(y, axes[4], z * axes[7])),
        fma(x, axes[2], fma(y, axes[5], z * axes[8])))


@inlined
def half_angle_factors(h: float, ox: Vector, oy: Vector, oz: Vector) -> tuple[Vector, Vector]:
    """Return cos(|omega| h / 2) and sin(|omega| h / 2) / |omega|, smooth at zero."""
    half = 0.5 * h
    square = fma(ox, ox, fma(oy, oy, oz * oz)) * splat(half * half)
    # Horner's rule; the first term left out is 1e-19 at the end of the range.
    cosine = fma(square, splat(-1.0 / 3628800.0), splat(1.0 / 40320.0))
    cosine = fma(square, cosine, splat(-1.0 / 720.0))
    cosine = fma(square, cosine, splat(1.0 / 24.0))
    cosine = fma(square, cosine, splat(-0.5))
    cosine = fma(square, cosine, splat(1.0))
    sine = fma(square, splat(-1.0 / 39916800.0), splat(1.0 / 362880.0))
    sine = fma(square, sine, splat(-1.0 / 5040.0))
    sine = fma(square, sine, splat(1.0 / 120.0))
    sine = fma(square, sine, splat(-1.0 / 6.0))
    sine = fma(square, sine, splat(1.0))
    if any_lane(square > splat(_SERIES)):
        for i in range(LANES):
            value = lane(square, i)
            if value > _SERIES:
                angle = math.sqrt(value)
                cosine = insert(cosine, i, math.cos(angle))
                sine = insert(sine, i, math.sin(angle) / angle)
    return cosine, sine * splat(half)


@inlined
def rotate(
    orientation: np.ndarray, s: int, h: float, ox: Vector, oy: Vector, oz: Vector
) -> None:
    """
    Apply the exact rotation of the block at slot `s` over `h` at constant omega, world axes.

    Solves dq/dt = omega q / 2 (eq 22), or de_i/dt = omega x e_i (eq 19).
    """
    cosine, sine = half_angle_factors(h, ox, oy, oz)
    zero = splat(0.0)
    ux, uy, uz = sine * ox, sine * oy, sine * oz
    mx, my, mz = zero - ux, zero - uy, zero - uz
    if orientation.ndim == 2:
        x, y = load(orientation, 0, s), load(orientation, 1, s)
        z, w = load(orientation, 2, s), load(orientation, 3, s)
        nx = fma(cosine, x, fma(ux, w, fma(uy, z, mz * y)))
        ny = fma(cosine, y, fma(uy, w, fma(uz, x, mx * z)))
        nz = fma(cosine, z, fma(uz, w, fma(ux, y, my * x)))
        nw = fma(cosine, w, fma(mx, x, fma(my, y, mz * z)))
        # One Newton step towards unit length: rounding does not accumulate.
        norm = fma(nx, nx, fma(ny, ny, fma(nz, nz, nw * nw)))
        scale = fma(splat(-0.5), norm, splat(1.5))
        store(orientation, 0, s, nx * scale)
        store(orientation, 1, s, ny * scale)
        store(orientation, 2, s, nz * scale)
        store(orientation, 3, s, nw * scale)
    else:
        two = splat(2.0)
        for i in range(3):
            axis = orientation[i]
            x, y, z = load(axis, 0, s), load(axis, 1, s), load(axis, 2, s)
            tx = two * fma(uy, z, mz * y)
            ty = two * fma(uz, x, mx * z)
            tz = two * fma(ux, y, my * x)
            store(axis, 0, s, fma(cosine, tx, fma(uy, tz, fma(mz, ty, x))))
            store(axis, 1, s, fma(cosine, ty, fma(uz, tx, fma(mx, tz, y))))
            store(axis, 2, s, fma(cosine, tz, fma(ux, ty, fma(my, tx, z))))
        orthonormalise(orientation, s)


@compiled
def orthonormalise(orientation: np.ndarray, s: int) -> None:
    """
    Take one Newton step of the polar decomposition, M (3 - M^T M) / 2, in place, of a block.

    Rounding does not accumulate.
    """
    first, second, third = orientation[0], orientation[1], orientation[2]
    half = splat(-0.5)
    g00, g01, g02 = _products(first, second, third, s, 0, 0), _products(
        first, second, third, s, 0, 1), _products(first, second, third, s, 0, 2)
    g11, g12 = _products(first, second, third, s, 1, 1), _products(first, second, third, s, 1, 2)
    g22 = _products(first, second, third, s, 2, 2)
    g00, g11, g22 = g00 - splat(3.0), g11 - splat(3.0), g22 - splat(3.0)
    for i in range(3):
        axis = orientation[i]
        x, y, z = load(axis, 0, s), load(axis, 1, s), load(axis, 2, s)
        store(axis, 0, s, half * fma(x, g00, fma(y, g01, z * g02)))
        store(axis, 1, s, half * fma(x, g01, fma(y, g11, z * g12)))
        store(axis, 2, s, half * fma(x, g02, fma(y, g12, z * g22)))


@compiled
def _products(
    first: np.ndarray, second: np.ndarray, third: np.ndarray, s: int, i: int, j: int
) -> Vector:
    """Return element (i, j) of M^T M."""
    return fma(
        load(first, i, s), load(first, j, s),
        fma(load(second, i, s), load(second, j, s), load(third, i, s) * load(third, j, s)))


@compiled
def arm_lanes(
    orientation: np.ndarray, s: int, half_width: float, axis: int
) -> tuple[Vector, Vector, Vector]:
    """
    Return arms [m] from the centres to the first edge on a body axis (0 x, 1 y, 2 z), world frame.

    Those are the edges north, west and up; the opposite edge has the opposite arm.
    """
    h = splat(half_width)
    if orientation.ndim == 2:
        x, y = load(orientation, 0, s), load(orientation, 1, s)
        z, w = load(orientation, 2, s), load(orientation, 3, s)
        zero, two = splat(0.0), splat(2.0 * half_width)
        if axis == 2:
            return (
                two * fma(x, z, w * y),
                two * fma(y, z, (zero - w) * x),
                fma(zero - two, fma(x, x, y * y), h))
        elif axis == 0:
            return (
                fma(zero - two, fma(y, y, z * z), h),
                two * fma(x, y, w * z),
                two * fma(x, z, (zero - w) * y))
        else:
            return (
                two * fma(x, y, (zero - w) * z),
                fma(zero - two, fma(x, x, z * z), h),
                two * fma(y, z, w * x))
    else:
        row = orientation[axis]
        return h * load(row, 0, s), h * load(row, 1, s), h * load(row, 2, s)


@inlined
def place_points(
    half_width: float, position: np.ndarray, orientation: np.ndarray, points: np.ndarray, s: int
) -> None:
    """Write the attachment points [m] of the block at slot `s`: the six edge midpoints (eq 49)."""
    stride = position.shape[1]
    x, y, z = load(position, 0, s), load(position, 1, s), load(position, 2, s)
    for pair in range(3):
        ax, ay, az = arm_lanes(orientation, s, half_width, (pair + 2) % 3)
        at = 6 * pair * stride + s
        store_at(points, at, x + ax)
        store_at(points, at + stride, y + ay)
        store_at(points, at + 2 * stride, z + az)
        store_at(points, at + 3 * stride, x - ax)
        store_at(points, at + 4 * stride, y - ay)
        store_at(points, at + 5 * stride, z - az)


@compiled
def place_anywhere(
    attachment: np.ndarray, position: np.ndarray, orientation: np.ndarray, points: np.ndarray,
    s: int
) -> None:
    """Write the attachment points [m] of the block at slot `s`: any six, (6, 3) in body axes."""
    stride = position.shape[1]
    x, y, z = load(position, 0, s), load(position, 1, s), load(position, 2, s)
    axes = axes_of_lanes(orientation, s)
    for edge in range(6):
        ax, ay, az = on_axes(
            axes, splat(attachment[edge, 0]), splat(attachment[edge, 1]),
            splat(attachment[edge, 2]))
        at = 3 * edge * stride + s
        store_at(points, at, x + ax)
        store_at(points, at + stride, y + ay)
        store_at(points, at + 2 * stride, z + az)
