# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Accelerations of free bodies."""

from icofabric_sim.kernels.runtime.compiled import inlined
from icofabric_sim.kernels.runtime.lanes import bits, load, splat, where
from icofabric_sim.terms.gravity.record import Gravity
from icofabric_sim.terms.shared import Six, Supports


@inlined
def add_acceleration(
    gravity: Gravity | None, supports: Supports | None, alive: int, s: int, a: Six
) -> Six:
    """Add gravity to the accelerations of bodies that are free to fall."""
    if gravity is None:
        return a
    else:
        ax, ay, az, bx, by, bz = a
        zero = splat(0.0)
        g = gravity.acceleration
        gx, gy, gz = splat(g[0]), splat(g[1]), splat(g[2])
        if supports is None:
            there = bits(alive)
            gx, gy, gz = where(there, gx, zero), where(there, gy, zero), where(there, gz, zero)
        else:
            gx = where(load(supports.inverse_mass, 0, s) > zero, gx, zero)
            gy = where(load(supports.inverse_mass, 1, s) > zero, gy, zero)
            gz = where(load(supports.inverse_mass, 2, s) > zero, gz, zero)
        return ax + gx, ay + gy, az + gz, bx, by, bz
