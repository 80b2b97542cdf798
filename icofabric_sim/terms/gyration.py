# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Bodies whose inertia is not isotropic: Euler's equations, with the gyroscopic term of eq 45.

I d(omega)/dt = N - omega x (I omega), where I has the principal moments I_k.
In other modules a body has one inertia Lambda, its smallest moment, and torques add N / Lambda to
slopes of spins. This module converts these slopes to d(omega)/dt. With m_k = I_k / Lambda, on the
principal axes:

    d(omega)_k / dt = ((N / Lambda)_k - (omega x (m omega))_k) / m_k.
"""

from icofabric_sim.kernels.rotations import axes_of_lanes, Nine, on_axes, Three, to_world
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, load, store, Vector
from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Gyration(Record):
    """Anisotropic inertias, see terms/gyration.py."""

    # (3, s) principal moments of inertia over the smallest of the body
    moments: np.ndarray
    axes: np.ndarray | None  # (9, s) principal axes in body axes, by rows; None: the body axes


@compiled
def principal_axes(tilted: np.ndarray | None, orientation: np.ndarray, s: int) -> Nine:
    """Return the principal axes of the bodies of a block in world components."""
    if tilted is None:
        return axes_of_lanes(orientation, s)
    else:
        axes = axes_of_lanes(orientation, s)
        a = on_axes(axes, load(tilted, 0, s), load(tilted, 1, s), load(tilted, 2, s))
        b = on_axes(axes, load(tilted, 3, s), load(tilted, 4, s), load(tilted, 5, s))
        c = on_axes(axes, load(tilted, 6, s), load(tilted, 7, s), load(tilted, 8, s))
        return a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]


@compiled
def principal_axis_at(
    tilted: np.ndarray | None, orientation: np.ndarray, k: int, s: int
) -> tuple[float, float, float]:
    """Return a principal axis of one slot in world components."""
    if tilted is None:
        return to_world(
            orientation, s, 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
    else:
        return to_world(
            orientation, s, tilted[3 * k, s], tilted[3 * k + 1, s], tilted[3 * k + 2, s])


@compiled
def turn_by_moments(
    gyration: Gyration | None, orientation: np.ndarray, velocity: np.ndarray, angular: np.ndarray,
    s: int
) -> None:
    """Convert torques over Lambda in `angular` to slopes of spins, for a block."""
    if gyration is None:
        return
    else:
        axes = principal_axes(gyration.axes, orientation, s)
        nx, ny, nz = on_body_axes(
            axes, load(angular, 0, s), load(angular, 1, s), load(angular, 2, s))
        ox, oy, oz = on_body_axes(
            axes, load(velocity, 0, s), load(velocity, 1, s), load(velocity, 2, s))
        mx, my, mz = (
            load(gyration.moments, 0, s), load(gyration.moments, 1, s),
            load(gyration.moments, 2, s))
        lx, ly, lz = mx * ox, my * oy, mz * oz
        x, y, z = on_axes(
            axes, (nx - (oy * lz - oz * ly)) / mx, (ny - (oz * lx - ox * lz)) / my,
            (nz - (ox * ly - oy * lx)) / mz)
        store(angular, 0, s, x)
        store(angular, 1, s, y)
        store(angular, 2, s, z)


@compiled
def turning_square(
    gyration: Gyration | None, orientation: np.ndarray, velocity: np.ndarray, s: int,
    square: Vector
) -> Vector:
    """
    Return spins weighted by moments, omega . I omega / Lambda [1/s^2]; `square` if isotropic.
    """
    if gyration is None:
        return square
    else:
        axes = principal_axes(gyration.axes, orientation, s)
        ox, oy, oz = on_body_axes(
            axes, load(velocity, 0, s), load(velocity, 1, s), load(velocity, 2, s))
        return fma(load(gyration.moments, 0, s) * ox, ox, fma(
            load(gyration.moments, 1, s) * oy, oy, load(gyration.moments, 2, s) * oz * oz))


@compiled
def turning_square_at(
    gyration: Gyration | None, orientation: np.ndarray, velocity: np.ndarray, s: int
) -> float:
    """Return the weighted square of the spin, omega . I omega / Lambda [1/s^2], of one slot."""
    x, y, z = velocity[0, s], velocity[1, s], velocity[2, s]
    if gyration is None:
        return float(x * x + y * y + z * z)
    else:
        ex, ey, ez = principal_axis_at(gyration.axes, orientation, 0, s)
        nx, ny, nz = principal_axis_at(gyration.axes, orientation, 1, s)
        ux, uy, uz = principal_axis_at(gyration.axes, orientation, 2, s)
        along, across, up = (
            ex * x + ey * y + ez * z, nx * x + ny * y + nz * z, ux * x + uy * y + uz * z)
        return float(
            gyration.moments[0, s] * along * along + gyration.moments[1, s] * across * across
            + gyration.moments[2, s] * up * up)


@compiled
def on_body_axes(axes: Nine, x: Vector, y: Vector, z: Vector) -> Three:
    """Return components on body axes of a vector in world components."""
    return (
        fma(axes[0], x, fma(axes[1], y, axes[2] * z)),
        fma(axes[3], x, fma(axes[4], y, axes[5] * z)),
        fma(axes[6], x, fma(axes[7], y, axes[8] * z)))
