# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors from edges to points of the world, fixed or moving: eq 49 with one end prescribed."""

import math

from icofabric_sim.kernels.rotations import turn_to_world
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, load, maximum, rsqrt, splat, Vector, where
from icofabric_sim.terms.anchors.record import Anchors, Waves
from icofabric_sim.terms.shared import Six, SMALLEST_SQUARE, State
import numpy as np


@compiled
def anchor_of(anchors: Anchors, number: int) -> int:
    """Return the number of the anchor of a row of the loads; negative if the row is no anchor."""
    return -1 - number - anchors.first


@compiled
def world_point(anchors: Anchors, a: int, k: int, time: float) -> float:
    """Return coordinate `k` [m] of the point of an anchor at `time` [s]."""
    t, cubic = time - anchors.start[a], anchors.cubic
    return add_wave(anchors.waves, a, k, t, float(cubic[a, 0, k] + t * (
        cubic[a, 1, k] + t * (cubic[a, 2, k] + t * cubic[a, 3, k]))))


@compiled
def add_wave(waves: Waves | None, a: int, k: int, t: float, place: float) -> float:
    """Return a coordinate [m] of a point with that of its sine motion, `t` [s] from its start."""
    if waves is None:
        return place
    else:
        return place + float(
            waves.amplitude[a, k] * math.sin(waves.rate[a] * t + waves.phase[a]))


@compiled
def world_speed(anchors: Anchors, a: int, k: int, time: float) -> float:
    """Return the velocity [m/s] of the point of an anchor along axis `k` at `time` [s]."""
    t, cubic = time - anchors.start[a], anchors.cubic
    return add_wave_speed(anchors.waves, a, k, t, float(
        cubic[a, 1, k] + t * (2.0 * cubic[a, 2, k] + t * (3.0 * cubic[a, 3, k]))))


@compiled
def add_wave_speed(waves: Waves | None, a: int, k: int, t: float, speed: float) -> float:
    """Return a velocity [m/s] of a point with that of its sine motion."""
    if waves is None:
        return speed
    else:
        return speed + float(
            waves.amplitude[a, k] * waves.rate[a] * math.cos(waves.rate[a] * t + waves.phase[a]))


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
    squared = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(SMALLEST_SQUARE))
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
def add_damping(
    damping: np.ndarray | None, anchors: Anchors, state: State, a: int, s: int, time: float,
    pull: Six
) -> tuple[Six, Vector]:
    """
    Return a wrench with damping c dl/dt along the anchor, and the power [W] that this dissipates.
    """
    if damping is None:
        return pull, splat(0.0)
    else:
        px, py, pz, ux, uy, uz = reach_of(anchors, state, a, s, time)
        velocity, spin = state.linear_velocity, state.angular_velocity
        ox, oy, oz = load(spin, 0, s), load(spin, 1, s), load(spin, 2, s)
        wx = splat(world_speed(anchors, a, 0, time)) - load(velocity, 0, s) - (oy * pz - oz * py)
        wy = splat(world_speed(anchors, a, 1, time)) - load(velocity, 1, s) - (oz * px - ox * pz)
        wz = splat(world_speed(anchors, a, 2, time)) - load(velocity, 2, s) - (ox * py - oy * px)
        inverse = rsqrt(maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(SMALLEST_SQUARE)))
        rate = fma(ux, wx, fma(uy, wy, uz * wz)) * inverse
        tension = splat(damping[a]) * rate
        factor = tension * inverse
        fx, fy, fz = factor * ux, factor * uy, factor * uz
        return (
            pull[0] + fx, pull[1] + fy, pull[2] + fz, pull[3] + (py * fz - pz * fy),
            pull[4] + (pz * fx - px * fz), pull[5] + (px * fy - py * fx)), tension * rate


@compiled
def power_of(anchors: Anchors, pull: Six, a: int, time: float) -> Vector:
    """Return the power [W] of the external agent that moves the point of an anchor."""
    return fma(pull[0], splat(world_speed(anchors, a, 0, time)), fma(
        pull[1], splat(world_speed(anchors, a, 1, time)),
        pull[2] * splat(world_speed(anchors, a, 2, time))))
