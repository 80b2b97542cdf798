# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
The implicit midpoint rule: what a step needs of kernels; simulation/stepping/implicit.py solves.

With v the velocities and spins in the middle of a step, x_m = x + h/2 v and R_m = exp(h/2 omega) R
the configuration there, and a the accelerations in it:

    v = v_0 + h/2 a(x_m, R_m, v),    v_1 = v_0 + h a,    x_1 = x + h v,    R_1 = exp(h omega) R.

The inertia is isotropic, so spins in world axes change as velocities do, and what bodies do to
each other in the middle of the step leaves momentum and angular momentum as they are.
"""

from icofabric_sim.kernels.connectors import slope_of
from icofabric_sim.kernels.hessian import hessian_times
from icofabric_sim.kernels.law_tables import tabled_pull, tabled_slope
from icofabric_sim.kernels.monitor import rows_of
from icofabric_sim.kernels.records import Damping, Links, Model, State, Variety
from icofabric_sim.kernels.rotations import rotate
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    LANES,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    store,
    Vector,
    where,
)
from icofabric_sim.kernels.viscous import coefficient_of
import numpy as np

_SMALLEST = 1e-300
# Where a law is flat, of its tension over its length: the tension decides there, not the slope.
_FLAT = 1e-9


@compiled
def take_velocities(model: Model, state: State, velocity: np.ndarray) -> None:
    """Velocities [m/s] and spins [rad/s] of a state, (6, s)."""
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        for k in range(3):
            store(velocity, k, s, load(state.linear_velocity, k, s))
            store(velocity, k + 3, s, load(state.angular_velocity, k, s))


@compiled
def to_middle(
    model: Model, state: State, velocity: np.ndarray, h: float, middle: State
) -> None:
    """Where velocities (6, s) lead in half of a step `h` [s]."""
    half, turn, turned = splat(0.5 * h), rows_of(state.orientation), rows_of(middle.orientation)
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        for k in range(3):
            store(middle.position, k, s, fma(
                half, load(velocity, k, s), load(state.position, k, s)))
            store(middle.linear_velocity, k, s, load(velocity, k, s))
            store(middle.angular_velocity, k, s, load(velocity, k + 3, s))
        for k in range(turn.shape[0]):
            store(turned, k, s, load(turn, k, s))
        rotate(
            middle.orientation, s, 0.5 * h, load(velocity, 3, s), load(velocity, 4, s),
            load(velocity, 5, s))


@compiled
def residual(
    model: Model, state: State, velocity: np.ndarray, slope: np.ndarray, h: float,
    result: np.ndarray
) -> None:
    """v - v_0 - h/2 a, (6, s); `slope` as in kernels/rhs.py."""
    half, row = splat(-0.5 * h), 3 + rows_of(state.orientation).shape[0]
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        for k in range(3):
            store(result, k, s, fma(half, load(slope, row + k, s), load(
                velocity, k, s) - load(state.linear_velocity, k, s)))
            store(result, k + 3, s, fma(half, load(slope, row + 3 + k, s), load(
                velocity, k + 3, s) - load(state.angular_velocity, k, s)))


@compiled
def finish(model: Model, state: State, velocity: np.ndarray, slope: np.ndarray, h: float) -> None:
    """Take the step whose middle is known."""
    step, row = splat(h), 3 + rows_of(state.orientation).shape[0]
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        rotate(
            state.orientation, s, h, load(velocity, 3, s), load(velocity, 4, s),
            load(velocity, 5, s))
        for k in range(3):
            store(state.position, k, s, fma(
                step, load(velocity, k, s), load(state.position, k, s)))
            store(state.linear_velocity, k, s, fma(
                step, load(slope, row + k, s), load(state.linear_velocity, k, s)))
            store(state.angular_velocity, k, s, fma(
                step, load(slope, row + 3 + k, s), load(state.angular_velocity, k, s)))


@compiled
def tangent_springs(
    links: Links | None, damping: Damping | None, model: Model, points: np.ndarray, stride: int,
    h: float, slopes: np.ndarray, rest: np.ndarray
) -> None:
    """
    Springs (12, s) that resist as connectors do to a change of velocities in a step `h` [s].

    Those of length l, tension f, slope k and damping c get the slope h^2/4 k + h/2 c and the
    tension h^2/4 f at l.
    """
    if links is None:
        return
    quarter, half = splat(0.25 * h * h), splat(0.5 * h)
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        for link in range(12):
            at = 3 * (link >> 1) * stride + s
            place = links.place[block, link]
            ux = load_at(points, place) - load_at(points, at)
            uy = load_at(points, place + stride) - load_at(points, at + stride)
            uz = load_at(points, place + 2 * stride) - load_at(points, at + 2 * stride)
            square = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(_SMALLEST))
            length = square * rsqrt(square)
            k, pull = law_at(links.variety, links, link, s, square, length)
            pull = tabled_pull(links.tables, links.variety, link, s, length, pull)
            k = tabled_slope(links.tables, links.variety, link, s, length, k)
            pull = quarter * pull
            k = fma(quarter, k, half * damping_of(damping, link, s))
            size = maximum(pull, splat(0.0) - pull)
            least = maximum(splat(_FLAT) * size / length, splat(_SMALLEST))
            k = where(maximum(k, splat(0.0) - k) > least, k, least)
            there = bits(links.present[block, link])
            store(slopes, link, s, where(there, k, splat(0.0)))
            store(rest, link, s, where(there, length - pull / k, splat(0.0)))


@compiled
def law_at(
    variety: Variety | None, links: Links, link: int, s: int, square: Vector, length: Vector
) -> tuple[Vector, Vector]:
    """Slope [N/m] and tension [N] of a spring."""
    if variety is None:
        k = splat(links.stiffness)
        return k, k * (length - splat(links.natural_length))
    else:
        k, rest = slope_of(variety, link, s, square)
        return k, k * (length - rest)


@compiled
def damping_of(damping: Damping | None, link: int, s: int) -> Vector:
    """Damping [N s/m] of a connector at each body of a block."""
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
    Blocks (p, 6, 6) of the matrix that `hessian_times` multiplies with.

    `colour` (n,) of bodies, none of which is joined to two of one; `pair` (colours, n): number of
    the block of a body and the one of that colour that it is or is joined to; -1: there is none.
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
