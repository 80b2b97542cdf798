# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
External wrenches on bodies: what they add to the velocities, and the work that they do.
"""

import math

from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.records import Loads, Model, State, Supports
from icofabric_sim.kernels.rotations import to_world
import numpy as np


@compiled
def kick_loads(model: Model, loads: Loads | None, state: State, block: int, h: float) -> None:
    """
    Add h F / M and h N / Lambda of every wrench on the bodies of a block.

    The force acts at its point, the torque adds to the moment of the force.
    """
    if loads is None:
        return
    for m in range(loads.start[block], loads.start[block + 1]):
        s = loads.slot[m]
        force, torque = wrench_of(loads, state.orientation, m, s)
        for k in range(3):
            mass, inertia = inverses(
                model.supports, model.inverse_mass, model.inverse_inertia, k, s)
            state.linear_velocity[k, s] += h * mass * force[k]
            state.angular_velocity[k, s] += h * inertia * torque[k]


@compiled
def inverses(
    supports: Supports | None, inverse_mass: float, inverse_inertia: float, k: int, s: int
) -> tuple[float, float]:
    """
    Inverse mass along axis `k` [1/kg] and inverse inertia [1/(kg m^2)] of the body in slot `s`.
    """
    if supports is None:
        return inverse_mass, inverse_inertia
    return supports.inverse_mass[k, s], supports.inverse_inertia[0, s]


@compiled
def wrench_of(
    loads: Loads, orientation: np.ndarray, m: int, s: int
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """
    Force [N] and torque about the centre [N m] of a row of the loads, world frame.
    """
    fx, fy, fz = loads.force[m, 0], loads.force[m, 1], loads.force[m, 2]
    tx, ty, tz = loads.torque[m, 0], loads.torque[m, 1], loads.torque[m, 2]
    if loads.in_body_axes[m]:
        fx, fy, fz = to_world(orientation, s, fx, fy, fz)
        tx, ty, tz = to_world(orientation, s, tx, ty, tz)
    px, py, pz = to_world(orientation, s, loads.point[m, 0], loads.point[m, 1], loads.point[m, 2])
    return (
        (fx, fy, fz),
        (tx + py * fz - pz * fy, ty + pz * fx - px * fz, tz + px * fy - py * fx),
    )


@compiled
def work_loads(loads: Loads | None, state: State, block: int, h: float) -> None:
    """
    Add the work [J] of every wrench on a block over a drift of `h`, before the drift moves it.

    Exact: the body moves at constant v and turns at constant omega. A wrench that turns with it
    keeps its moment about omega, and its force turns by omega t; one that does not turn has the
    power F . v + N . omega + F . d/dt p.
    """
    if loads is None:
        return
    for m in range(loads.start[block], loads.start[block + 1]):
        s = loads.slot[m]
        v = (
            state.linear_velocity[0, s], state.linear_velocity[1, s], state.linear_velocity[2, s])
        o = (
            state.angular_velocity[0, s], state.angular_velocity[1, s],
            state.angular_velocity[2, s])
        force, torque = wrench_of(loads, state.orientation, m, s)
        if loads.in_body_axes[m]:
            turn = torque[0] * o[0] + torque[1] * o[1] + torque[2] * o[2]
            mean = mean_of_turning(force, o, h)
            loads.work[m] += h * (turn + mean[0] * v[0] + mean[1] * v[1] + mean[2] * v[2])
        else:
            p = to_world(
                state.orientation, s, loads.point[m, 0], loads.point[m, 1], loads.point[m, 2])
            # d/dt p = omega x p turns with the body as p does.
            rate = mean_of_turning(
                (o[1] * p[2] - o[2] * p[1], o[2] * p[0] - o[0] * p[2], o[0] * p[1] - o[1] * p[0]),
                o, h)
            power = 0.0
            for k in range(3):
                power += force[k] * (v[k] + rate[k]) + loads.torque[m, k] * o[k]
            loads.work[m] += h * power


@compiled
def keep_work(loads: Loads | None, first: int, last: int) -> None:
    """
    Note the work so far, to come back to.
    """
    if loads is None:
        return
    for m in range(loads.start[first], loads.start[last]):
        loads.earlier_work[m] = loads.work[m]


@compiled
def mean_of_turning(
    f: tuple[float, float, float], o: tuple[float, float, float], h: float
) -> tuple[float, float, float]:
    """
    Mean over `h` of a vector that turns at omega from `f` on: the integral of eq 22's rotation.

    f + (1 - cos x) / x^2 (h omega x f) + (x - sin x) / x^3 (h omega x (h omega x f)), with
    x = |omega| h.
    """
    ox, oy, oz = h * o[0], h * o[1], h * o[2]
    square = ox * ox + oy * oy + oz * oz
    if square < 1e-2:
        # The next terms are below 1e-17.
        first = 0.5 - square * (1 / 24 - square * (1 / 720 - square * (
            1 / 40320 - square / 3628800)))
        second = 1 / 6 - square * (1 / 120 - square * (1 / 5040 - square * (
            1 / 362880 - square / 39916800)))
    else:
        x = math.sqrt(square)
        first = (1.0 - math.cos(x)) / square
        second = (x - math.sin(x)) / (square * x)
    cx, cy, cz = oy * f[2] - oz * f[1], oz * f[0] - ox * f[2], ox * f[1] - oy * f[0]
    dx, dy, dz = oy * cz - oz * cy, oz * cx - ox * cz, ox * cy - oy * cx
    return (
        f[0] + first * cx + second * dx,
        f[1] + first * cy + second * dy,
        f[2] + first * cz + second * dz,
    )
