# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Vectors that turn at a constant angular velocity: after a time, and their means over a time."""

from icofabric_sim.kernels.rotations import half_angle_factors, Three
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, splat, Vector, where


@compiled
def turned(vector: Three, cosine: Vector, ux: Vector, uy: Vector, uz: Vector) -> Three:
    """Return a vector turned by the unit quaternion (u, cosine)."""
    x, y, z = vector
    two = splat(2.0)
    tx, ty, tz = two * (uy * z - uz * y), two * (uz * x - ux * z), two * (ux * y - uy * x)
    return (
        x + fma(cosine, tx, uy * tz - uz * ty), y + fma(cosine, ty, uz * tx - ux * tz),
        z + fma(cosine, tz, ux * ty - uy * tx))


@compiled
def turn_factors(later: float, ox: Vector, oy: Vector, oz: Vector) -> Three:
    """
    Return cos x, sin x / |omega| and (1 - cos x) / |omega|^2 with x = |omega| later.

    A vector f that turns at omega is then f cos x + (omega x f) sin x / |omega|
    + omega (omega . f) (1 - cos x) / |omega|^2 (Rodrigues).
    """
    cosine, sine = half_angle_factors(later, ox, oy, oz)
    two, square = splat(2.0), fma(ox, ox, fma(oy, oy, oz * oz))
    versine = two * sine * sine
    return splat(1.0) - versine * square, two * cosine * sine, versine


@compiled
def mean_turn_factors(h: float, ox: Vector, oy: Vector, oz: Vector) -> Three:
    """Return means of the `turn_factors` over a time from 0 to `h` [s]."""
    first, second = mean_factors(h, ox, oy, oz)
    square = fma(ox, ox, fma(oy, oy, oz * oz))
    versine = splat(h * h) * second
    return splat(1.0) - versine * square, splat(h) * first, versine


@compiled
def mean_factors(h: float, ox: Vector, oy: Vector, oz: Vector) -> tuple[Vector, Vector]:
    """Return (1 - cos x) / x^2 and (x - sin x) / x^3 with x = |omega| h, smooth at zero."""
    step, one = splat(h), splat(1.0)
    # cos(x / 2), and sin(x / 2) / x.
    cosine, sine = half_angle_factors(h, ox, oy, oz)
    sine = sine * splat(1.0 / h)
    ux, uy, uz = step * ox, step * oy, step * oz
    square = fma(ux, ux, fma(uy, uy, uz * uz))
    first = splat(2.0) * sine * sine
    # Horner's rule below 1, where the difference would cancel; the next term is 1e-20.
    series = fma(square, splat(-1.0 / 121645100408832000.0), splat(1.0 / 355687428096000.0))
    series = fma(square, series, splat(-1.0 / 1307674368000.0))
    series = fma(square, series, splat(1.0 / 6227020800.0))
    series = fma(square, series, splat(-1.0 / 39916800.0))
    series = fma(square, series, splat(1.0 / 362880.0))
    series = fma(square, series, splat(-1.0 / 5040.0))
    series = fma(square, series, splat(1.0 / 120.0))
    small = square < one
    divisor = where(small, one, square)
    direct = (one - splat(2.0) * sine * cosine) / divisor
    second = where(small, splat(1.0 / 6.0) - square * series, direct)
    return first, second


@compiled
def mean_of_turning(
    fx: Vector, fy: Vector, fz: Vector, ox: Vector, oy: Vector, oz: Vector, h: float
) -> Three:
    """
    Return the mean over `h` of a vector that turns at omega from `f` on (integral of eq 22).

    f + (1 - cos x) / x^2 (h omega x f) + (x - sin x) / x^3 (h omega x (h omega x f)), with
    x = |omega| h.
    """
    step = splat(h)
    ux, uy, uz = step * ox, step * oy, step * oz
    first, second = mean_factors(h, ox, oy, oz)
    cx, cy, cz = uy * fz - uz * fy, uz * fx - ux * fz, ux * fy - uy * fx
    dx, dy, dz = uy * cz - uz * cy, uz * cx - ux * cz, ux * cy - uy * cx
    return (
        fx + fma(first, cx, second * dx), fy + fma(first, cy, second * dy),
        fz + fma(first, cz, second * dz))
