# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Diagonally implicit Runge-Kutta methods: functions of a stage, which stepping/implicit.py solves.

With g the diagonal of the tableau times the step, and x*, q*, v* the state after the stages
before, a stage is the solution of

    x = x* + g v,    q = q* + g omega q / 2,    v = v* + g a(x, q, v, omega).

Its unknowns are the velocities and spins: x follows, and with u = g omega / 2 also
q = (1 + u) q* / (1 + u^2). The inertia is isotropic, so spins in world axes change as velocities
do.
"""

from icofabric_sim.kernels.hessian import hessian_times
from icofabric_sim.kernels.loads import place_row
from icofabric_sim.kernels.records import Links, Loads, Model, State
from icofabric_sim.kernels.rhs import combine, larger_of, normalise, step_error
from icofabric_sim.kernels.rotations import rows_of
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    store,
    Vector,
    where,
)
from icofabric_sim.terms.damping.record import Damping
from icofabric_sim.terms.laws import replace_pull, replace_slope
from icofabric_sim.terms.links.force import slope_of
from icofabric_sim.terms.shared import coefficient_of, Variety
import numpy as np

_MIN_POSITIVE = 1e-300
# Least slope relative to tension over length: for a flat law the tension matters, not the slope.
_FLAT = 1e-9


@compiled
def take_velocities(model: Model, state: State, velocity: np.ndarray) -> None:
    """Copy velocities [m/s] and spins [rad/s] of a state into `velocity` (6, s)."""
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        for k in range(3):
            store(velocity, k, s, load(state.linear_velocity, k, s))
            store(velocity, k + 3, s, load(state.angular_velocity, k, s))


@compiled
def to_stage(
    model: Model, base: State, velocity: np.ndarray, g: float, stage: State
) -> None:
    """
    Write velocities (6, s), and the pose that they reach from `base` in `g` [s], into `stage`.
    """
    time = splat(g)
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        for k in range(3):
            store(stage.position, k, s, fma(
                time, load(velocity, k, s), load(base.position, k, s)))
            store(stage.linear_velocity, k, s, load(velocity, k, s))
            store(stage.angular_velocity, k, s, load(velocity, k + 3, s))
        turn(base.orientation, velocity, g, stage.orientation, s)


@compiled
def turn(
    base: np.ndarray, velocity: np.ndarray, g: float, result: np.ndarray, s: int
) -> None:
    """Solve q = q* + g omega q / 2, or e = e* + g omega x e for each axis, for a block."""
    part = splat(0.5 * g if base.ndim == 2 else g)
    ux, uy = part * load(velocity, 3, s), part * load(velocity, 4, s)
    uz = part * load(velocity, 5, s)
    scale = splat(1.0) / fma(ux, ux, fma(uy, uy, fma(uz, uz, splat(1.0))))
    if base.ndim == 2:
        zero = splat(0.0)
        x, y, z, w = load(base, 0, s), load(base, 1, s), load(base, 2, s), load(base, 3, s)
        store(result, 0, s, scale * (x + fma(ux, w, fma(uy, z, zero - uz * y))))
        store(result, 1, s, scale * (y + fma(uy, w, fma(uz, x, zero - ux * z))))
        store(result, 2, s, scale * (z + fma(uz, w, fma(ux, y, zero - uy * x))))
        store(result, 3, s, scale * (w - fma(ux, x, fma(uy, y, uz * z))))
    else:
        for i in range(3):
            axis, turned = base[i], result[i]
            x, y, z = load(axis, 0, s), load(axis, 1, s), load(axis, 2, s)
            along = fma(ux, x, fma(uy, y, uz * z))
            store(turned, 0, s, scale * (x + uy * z - uz * y + along * ux))
            store(turned, 1, s, scale * (y + uz * x - ux * z + along * uy))
            store(turned, 2, s, scale * (z + ux * y - uy * x + along * uz))


@compiled
def residual(
    model: Model, base: State, velocity: np.ndarray, slope: np.ndarray, g: float,
    result: np.ndarray
) -> None:
    """Compute v - v* - g a, (6, s); `slope` as in kernels/rhs.py."""
    time, row = splat(-g), 3 + rows_of(base.orientation).shape[0]
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        for k in range(3):
            store(result, k, s, fma(time, load(slope, row + k, s), load(
                velocity, k, s) - load(base.linear_velocity, k, s)))
            store(result, k + 3, s, fma(time, load(slope, row + 3 + k, s), load(
                velocity, k + 3, s) - load(base.angular_velocity, k, s)))


@compiled
def end_stage(
    model: Model, state: State, slopes: np.ndarray, weights: np.ndarray, h: float, base: State
) -> None:
    """Write the state after the stages so far, as many as there are weights, into `base`."""
    for block in range(model.blocks.slot.shape[0]):
        combine(state, slopes, weights, h, base, model.blocks.slot[block])


@compiled
def end_step(
    model: Model, state: State, slopes: np.ndarray, weights: np.ndarray, h: float, target: State
) -> None:
    """Write the state after a step, or a fraction of it, by its stages into `target`."""
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        combine(state, slopes, weights, h, target, s)
        normalise(target.orientation, s)


@compiled
def place_paths(model: Model, loads: Loads, state: State, time: float) -> None:
    """Place driven bodies on their paths at `time` [s]."""
    for block in range(model.blocks.slot.shape[0]):
        for m in range(loads.start[block], loads.start[block + 1]):
            place_row(loads, state, m, model.blocks.slot[block], time)


@compiled
def stage_error(
    model: Model, slopes: np.ndarray, weights: np.ndarray, turn_rows: int, scales: np.ndarray
) -> float:
    """
    Return the error rate of a step, the largest of all bodies, see kernels/rhs.py.

    `weights`: those of the step less those of the embedded method.
    """
    largest = 0.0
    for block in range(model.blocks.slot.shape[0]):
        error, _ = step_error(
            slopes, turn_rows, weights, weights, scales, 1e300, model.blocks.slot[block])
        largest = larger_of(largest, error)
    return largest


@compiled
def tangent_springs(
    links: Links | None, damping: Damping | None, model: Model, points: np.ndarray, stride: int,
    g: float, slopes: np.ndarray, rest: np.ndarray
) -> None:
    """
    Write springs (12, s) that resist a change of velocities over `g` [s] as connectors do.

    Connectors of length l, tension f, slope k and damping c get the slope g^2 k + g c and the
    tension g^2 f at l.
    """
    if links is None:
        return
    time, square_time = splat(g), splat(g * g)
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        for link in range(12):
            at = 3 * (link >> 1) * stride + s
            place = links.place[block, link]
            ux = load_at(points, place) - load_at(points, at)
            uy = load_at(points, place + stride) - load_at(points, at + stride)
            uz = load_at(points, place + 2 * stride) - load_at(points, at + 2 * stride)
            square = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(_MIN_POSITIVE))
            length = square * rsqrt(square)
            k, pull = law_at(links.variety, links, link, s, square, length)
            pull = replace_pull(links.laws, links.variety, link, s, length, pull)
            k = replace_slope(links.laws, links.variety, link, s, length, k)
            pull = square_time * pull
            k = fma(square_time, k, time * damping_of(damping, link, s))
            size = maximum(pull, splat(0.0) - pull)
            least = maximum(splat(_FLAT) * size / length, splat(_MIN_POSITIVE))
            k = where(maximum(k, splat(0.0) - k) > least, k, least)
            there = bits(links.present[block, link])
            store(slopes, link, s, where(there, k, splat(0.0)))
            store(rest, link, s, where(there, length - pull / k, splat(0.0)))


@compiled
def law_at(
    variety: Variety | None, links: Links, link: int, s: int, square: Vector, length: Vector
) -> tuple[Vector, Vector]:
    """Return slope [N/m] and tension [N] of a spring."""
    if variety is None:
        k = splat(links.stiffness)
        return k, k * (length - splat(links.natural_length))
    else:
        k, rest = slope_of(variety, link, s, square)
        return k, k * (length - rest)


@compiled
def damping_of(damping: Damping | None, link: int, s: int) -> Vector:
    """Return the damping [N s/m] of a connector at each body of a block."""
    if damping is None:
        return splat(0.0)
    else:
        return coefficient_of(damping.own, damping.coefficient, link, s)


@compiled
def assemble(
    model: Model, state: State, points: np.ndarray, moved: np.ndarray, turns: np.ndarray,
    root_m: float, root_i: float, colour: np.ndarray, slot: np.ndarray, pair: np.ndarray,
    vector: np.ndarray, product: np.ndarray, blocks: np.ndarray
) -> None:
    """
    Write the blocks (p, 6, 6) of the matrix of `hessian_times`.

    `colour` (n,) of bodies: no body is joined to two bodies of one colour. `pair` (colours, n):
    number of the block of a body and the body of that colour that it is or is joined to; -1
    without one.
    """
    for number in range(pair.shape[0]):
        for freedom in range(6):
            vector[:] = 0.0
            for body in range(slot.shape[0]):
                if colour[body] == number:
                    vector[freedom, slot[body]] = 1.0
            hessian_times(
                model, state, points, moved, turns, root_m, root_i, model.supports, vector,
                product)
            for body in range(slot.shape[0]):
                p = pair[number, body]
                if p >= 0:
                    for k in range(6):
                        blocks[p, k, freedom] = product[k, slot[body]]
