# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Rotations of bodies: unit quaternions (10 N form) or direction cosines (15 N form).

An orientation array of shape (n, 4) holds quaternions x y z w (eqs 21-27); one of shape
(n, 3, 3) holds mu_ij = e_i . e0_j (eqs 16-20), whose row i is body axis i in world components.
The shape is a constant of the compiled kernel.
"""

import math

from icofabric_sim.kernels.compiled import compiled
import numpy as np


@compiled
def fill_arms(orientation: np.ndarray, half_width: float, arms: np.ndarray) -> None:
    """
    Arms from the centres to the midpoints of the up, north and west edges [m], world frame.

    `arms` (n, 3, 3): arms[b, edge >> 1] belongs to the edge pair (up, down), (north, south),
    (west, east), that is to the body axes z, x, y; the second edge of a pair has the opposite arm.
    """
    h = half_width
    if orientation.ndim == 2:
        for b in range(orientation.shape[0]):
            x, y, z, w = orientation[b, 0], orientation[b, 1], orientation[b, 2], orientation[b, 3]
            arms[b, 0, 0] = h * 2.0 * (x * z + w * y)
            arms[b, 0, 1] = h * 2.0 * (y * z - w * x)
            arms[b, 0, 2] = h * (1.0 - 2.0 * (x * x + y * y))
            arms[b, 1, 0] = h * (1.0 - 2.0 * (y * y + z * z))
            arms[b, 1, 1] = h * 2.0 * (x * y + w * z)
            arms[b, 1, 2] = h * 2.0 * (x * z - w * y)
            arms[b, 2, 0] = h * 2.0 * (x * y - w * z)
            arms[b, 2, 1] = h * (1.0 - 2.0 * (x * x + z * z))
            arms[b, 2, 2] = h * 2.0 * (y * z + w * x)
    else:
        for b in range(orientation.shape[0]):
            for pair in range(3):
                axis = (pair + 2) % 3
                for i in range(3):
                    arms[b, pair, i] = h * orientation[b, axis, i]


@compiled
def to_world(
    orientation: np.ndarray, b: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """
    World components of a vector given on the axes of body `b` (eq 26).
    """
    if orientation.ndim == 2:
        qx, qy, qz, qw = orientation[b, 0], orientation[b, 1], orientation[b, 2], orientation[b, 3]
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
            x * orientation[b, 0, 0] + y * orientation[b, 1, 0] + z * orientation[b, 2, 0],
            x * orientation[b, 0, 1] + y * orientation[b, 1, 1] + z * orientation[b, 2, 1],
            x * orientation[b, 0, 2] + y * orientation[b, 1, 2] + z * orientation[b, 2, 2],
        )


@compiled
def half_angle_factors(h: float, ox: float, oy: float, oz: float) -> tuple[float, float]:
    """
    cos(|omega| h / 2) and sin(|omega| h / 2) / |omega|, smooth at zero.
    """
    square = (ox * ox + oy * oy + oz * oz) * (0.25 * h * h)
    if square < 1e-8:
        # Series to the sixth power of the half angle: the next is below rounding here.
        cosine = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square / 720.0))
        sine = 0.5 * h * (1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0 - square / 5040.0)))
        return cosine, sine
    angle = math.sqrt(square)
    return math.cos(angle), 0.5 * h * math.sin(angle) / angle


@compiled
def rotate(orientation: np.ndarray, b: int, h: float, ox: float, oy: float, oz: float) -> None:
    """
    Exact flow over `h` at constant omega, world axes.

    Of dq/dt = omega q / 2 (eq 22), or of de_i/dt = omega x e_i (eq 19).
    """
    c, s = half_angle_factors(h, ox, oy, oz)
    ux, uy, uz = s * ox, s * oy, s * oz
    if orientation.ndim == 2:
        x, y, z, w = orientation[b, 0], orientation[b, 1], orientation[b, 2], orientation[b, 3]
        nx = c * x + ux * w + uy * z - uz * y
        ny = c * y + uy * w + uz * x - ux * z
        nz = c * z + uz * w + ux * y - uy * x
        nw = c * w - ux * x - uy * y - uz * z
        # One Newton step towards unit length: rounding does not accumulate.
        scale = 1.5 - 0.5 * (nx * nx + ny * ny + nz * nz + nw * nw)
        orientation[b, 0] = nx * scale
        orientation[b, 1] = ny * scale
        orientation[b, 2] = nz * scale
        orientation[b, 3] = nw * scale
    else:
        for i in range(3):
            x, y, z = orientation[b, i, 0], orientation[b, i, 1], orientation[b, i, 2]
            tx = 2.0 * (uy * z - uz * y)
            ty = 2.0 * (uz * x - ux * z)
            tz = 2.0 * (ux * y - uy * x)
            orientation[b, i, 0] = x + c * tx + uy * tz - uz * ty
            orientation[b, i, 1] = y + c * ty + uz * tx - ux * tz
            orientation[b, i, 2] = z + c * tz + ux * ty - uy * tx
        orthonormalise(orientation, b)


@compiled
def orthonormalise(orientation: np.ndarray, b: int) -> None:
    """
    One Newton step of the polar decomposition, M (3 - M^T M) / 2, in place.

    Rounding does not accumulate.
    """
    m = orientation[b]
    g00 = m[0, 0] * m[0, 0] + m[1, 0] * m[1, 0] + m[2, 0] * m[2, 0]
    g01 = m[0, 0] * m[0, 1] + m[1, 0] * m[1, 1] + m[2, 0] * m[2, 1]
    g02 = m[0, 0] * m[0, 2] + m[1, 0] * m[1, 2] + m[2, 0] * m[2, 2]
    g11 = m[0, 1] * m[0, 1] + m[1, 1] * m[1, 1] + m[2, 1] * m[2, 1]
    g12 = m[0, 1] * m[0, 2] + m[1, 1] * m[1, 2] + m[2, 1] * m[2, 2]
    g22 = m[0, 2] * m[0, 2] + m[1, 2] * m[1, 2] + m[2, 2] * m[2, 2]
    for i in range(3):
        x, y, z = m[i, 0], m[i, 1], m[i, 2]
        m[i, 0] = 1.5 * x - 0.5 * (x * g00 + y * g01 + z * g02)
        m[i, 1] = 1.5 * y - 0.5 * (x * g01 + y * g11 + z * g12)
        m[i, 2] = 1.5 * z - 0.5 * (x * g02 + y * g12 + z * g22)
