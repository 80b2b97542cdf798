# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors from edges to points of the world, fixed or moving: eq 49 with one end prescribed."""

from icofabric_sim.kernels.connectors import Six
from icofabric_sim.kernels.records import Anchors, Loads, Model, State
from icofabric_sim.kernels.rotations import turn_to_world
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fabs,
    fma,
    lane,
    LANES,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    store,
    store_at,
    Vector,
    where,
)
from icofabric_sim.terms.shared import inverses
import numpy as np


@compiled
def anchor_of(anchors: Anchors, number: int) -> int:
    """Return the number of the anchor of a row of the loads; negative if the row is no anchor."""
    return -1 - number - anchors.first


@compiled
def world_point(anchors: Anchors, a: int, k: int, time: float) -> float:
    """Return coordinate `k` [m] of the point of an anchor at `time` [s]."""
    t, cubic = time - anchors.start[a], anchors.cubic
    return float(cubic[a, 0, k] + t * (
        cubic[a, 1, k] + t * (cubic[a, 2, k] + t * cubic[a, 3, k])))


@compiled
def world_speed(anchors: Anchors, a: int, k: int, time: float) -> float:
    """Return the velocity [m/s] of the point of an anchor along axis `k` at `time` [s]."""
    t, cubic = time - anchors.start[a], anchors.cubic
    return float(cubic[a, 1, k] + t * (2.0 * cubic[a, 2, k] + t * (3.0 * cubic[a, 3, k])))


@compiled
def reach_of(
    anchors: Anchors, state: State, a: int, s: int, time: float
) -> tuple[Vector, Vector, Vector, Vector, Vector, Vector]:
    """
    Return the arms [m] of a block to its ends of an anchor, and from there to the world point.
    """
    px, py, pz = turn_to_world(
        state.orientation, s, splat(anchors.arm[a, 0]), splat(anchors.arm[a, 1]),
        splat(anchors.arm[a, 2]))
    place = state.position
    return (
        px, py, pz,
        splat(world_point(anchors, a, 0, time)) - load(place, 0, s) - px,
        splat(world_point(anchors, a, 1, time)) - load(place, 1, s) - py,
        splat(world_point(anchors, a, 2, time)) - load(place, 2, s) - pz)


@compiled
def tension_of(
    anchors: Anchors, a: int, ux: Vector, uy: Vector, uz: Vector
) -> tuple[Vector, Vector, Vector]:
    """
    Return 1 / l [1/m], stretch l - D [m] and slope k_e or k_c [N/m] of an anchor (eqs 1 and 2).
    """
    squared = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(1e-300))
    inverse = rsqrt(squared)
    stretch = fma(squared, inverse, splat(-anchors.natural_length[a]))
    slope = where(
        stretch > splat(0.0), splat(anchors.extension[a]), splat(anchors.compression[a]))
    return inverse, stretch, slope


@compiled
def pull_of(anchors: Anchors, state: State, a: int, s: int, time: float) -> Six:
    """Return force [N] and torque about the centre [N m] of an anchor on a block, world frame."""
    px, py, pz, ux, uy, uz = reach_of(anchors, state, a, s, time)
    inverse, stretch, slope = tension_of(anchors, a, ux, uy, uz)
    tension = slope * stretch * inverse
    fx, fy, fz = tension * ux, tension * uy, tension * uz
    return fx, fy, fz, py * fz - pz * fy, pz * fx - px * fz, px * fy - py * fx


@compiled
def power_of(anchors: Anchors, pull: Six, a: int, time: float) -> Vector:
    """Return the power [W] of the external agent that moves the point of an anchor."""
    return fma(pull[0], splat(world_speed(anchors, a, 0, time)), fma(
        pull[1], splat(world_speed(anchors, a, 1, time)),
        pull[2] * splat(world_speed(anchors, a, 2, time))))


@compiled
def add_pull(
    model: Model, loads: Loads, velocity: np.ndarray, spin: np.ndarray, pull: Six, m: int, s: int,
    h: float
) -> None:
    """Add h F / M and h N / Lambda to velocities of the bodies of row `m`."""
    mx, my, mz, inertia = inverses(
        model.supports, model.inverse_mass, model.inverse_inertia, s)
    step = where(bits(loads.lanes[m]), splat(h), splat(0.0))
    inertia = step * inertia
    store(velocity, 0, s, fma(step * mx, pull[0], load(velocity, 0, s)))
    store(velocity, 1, s, fma(step * my, pull[1], load(velocity, 1, s)))
    store(velocity, 2, s, fma(step * mz, pull[2], load(velocity, 2, s)))
    store(spin, 0, s, fma(inertia, pull[3], load(spin, 0, s)))
    store(spin, 1, s, fma(inertia, pull[4], load(spin, 1, s)))
    store(spin, 2, s, fma(inertia, pull[5], load(spin, 2, s)))


@compiled
def kick_anchor(
    anchors: Anchors | None, model: Model, loads: Loads, state: State, m: int, s: int,
    time: float, h: float
) -> None:
    """
    Kick the bodies of row `m` over `h` if the row is an anchor; add the work of its point.

    The work is h F . dA/dt at the time of the kick, as for a driven body (kernels/drives.py).
    """
    if anchors is None:
        return
    else:
        a = anchor_of(anchors, loads.wrench[m])
        if a < 0:
            return
        pull = pull_of(anchors, state, a, s, time)
        add_pull(
            model, loads, state.linear_velocity, state.angular_velocity, pull, m, s, h)
        done = load_at(loads.work, LANES * m)
        more = fma(splat(h), power_of(anchors, pull, a, time), done)
        store_at(loads.work, LANES * m, where(bits(loads.lanes[m]), more, done))


@compiled
def anchor_slope(
    anchors: Anchors | None, model: Model, loads: Loads, state: State, linear: np.ndarray,
    angular: np.ndarray, m: int, s: int, time: float, index: int
) -> None:
    """Add the accelerations and power of row `m` to slopes if the row is an anchor."""
    if anchors is None:
        return
    else:
        a = anchor_of(anchors, loads.wrench[m])
        if a < 0:
            return
        pull = pull_of(anchors, state, a, s, time)
        add_pull(model, loads, linear, angular, pull, m, s, 1.0)
        store(loads.power, index, LANES * m, where(
            bits(loads.lanes[m]), power_of(anchors, pull, a, time), splat(0.0)))


@compiled
def anchor_look(
    anchors: Anchors | None, model: Model, loads: Loads, state: State, m: int, s: int, time: float
) -> tuple[Vector, Vector]:
    """
    Return the bound of the squared frequency [1/s^2] that row `m` adds to its bodies; energy [J].

    The second variation is k (n.du)^2 + f/l |P du|^2 and moments of f, with du = dx + dtheta x s.
    In mass-scaled coordinates the first has the one eigenvalue k (1/M + |s x n|^2 / Lambda), the
    second is at most f/l (1/M + s^2/Lambda) if f > 0, the last |f| |s| / Lambda. The larger of k_e
    and k_c counts.
    """
    zero = splat(0.0)
    if anchors is None:
        return zero, zero
    else:
        a = anchor_of(anchors, loads.wrench[m])
        if a < 0:
            return zero, zero
        px, py, pz, ux, uy, uz = reach_of(anchors, state, a, s, time)
        inverse, stretch, slope = tension_of(anchors, a, ux, uy, uz)
        tension = slope * stretch
        square = fma(px, px, fma(py, py, pz * pz))
        arm = square * rsqrt(maximum(square, splat(1e-300)))
        mass, inertia = splat(model.inverse_mass), splat(model.inverse_inertia)
        cx, cy, cz = py * uz - pz * uy, pz * ux - px * uz, px * uy - py * ux
        across = fma(cx, cx, fma(cy, cy, cz * cz)) * inverse * inverse
        stiff = maximum(splat(anchors.extension[a]), splat(anchors.compression[a]))
        bound = stiff * fma(across, inertia, mass)
        bound = fma(fma(square, inertia, mass), maximum(tension, zero) * inverse, bound)
        bound = fma(fabs(tension) * arm, inertia, bound)
        mine = bits(loads.lanes[m])
        energy = splat(0.5) * tension * stretch
        return where(mine, bound, zero), where(mine, energy, zero)


@compiled
def look_at_anchors(
    model: Model, loads: Loads, state: State, time: float
) -> tuple[float, float]:
    """Return the largest bound of a body [1/s^2] and the energy [J] of all anchors."""
    largest, total = 0.0, 0.0
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        bound, energy = splat(0.0), splat(0.0)
        for m in range(loads.start[block], loads.start[block + 1]):
            more, part = anchor_look(loads.anchors, model, loads, state, m, s, time)
            bound, energy = bound + more, energy + part
        for i in range(LANES):
            largest = max(largest, lane(bound, i))
            total += lane(energy, i)
    return largest, total
