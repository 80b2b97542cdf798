# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Detection of connectors that reach a breaking length (eq 3), at every step end.

The lengths at the ends of a step are examined. A connector is reported if its length is beyond a
limit, or if it approached the limit at first and receded at last and may have exceeded the limit
in between. `event_location.py` then determines whether and when the connector broke.
"""

from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.hessian import move_links
from icofabric_sim.kernels.records import Breakage, Links, Model, State, Trail, Work
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    any_lane,
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
from icofabric_sim.kernels.runtime.team import Team, wait_for_all
from icofabric_sim.terms.wrapping.rates import change_rates
from icofabric_sim.terms.wrapping.record import Wrapping
import numpy as np

# A length within this relative distance of a limit has reached the limit: lengths are rounded.
TOGETHER = 1e-12
# Fraction of the distance from the cubic through both ends of a step up to its tangents that is
# added at the turning point of a length; enough for vibrations of up to 2 rad in a step.
DOUBT = 0.35
# A connector wrapped over a shell may change to another path, a corner: the whole distance.
CORNER_DOUBT = 1.0


@compiled
def note_lengths(
    model: Model, breakage: Breakage | None, state: State, work: Work, team: Team, first: int,
    last: int
) -> None:
    """Store lengths and their rates at the start of a step, for blocks first to last."""
    if breakage is None:
        return
    place_all(model, state, work, first, last)
    move_blocks(model, breakage, state, work.points, first, last)
    wait_for_all(team)
    for block in range(first, last):
        measure(
            model.wrapping, model.links, breakage, state, work.points, 0.0, block,
            model.blocks.slot[block])
    wait_for_all(team)


@compiled
def is_breaking(
    model: Model, breakage: Breakage | None, state: State, work: Work, trail: Trail, team: Team,
    h: float, first: int, last: int
) -> bool:
    """
    Check if a connector may have reached a limit within a step of length `h` that has just ended.

    The attachment points at the end of the step are in place. `breakage.excess` marks the
    connectors.
    """
    if breakage is None:
        return False
    move_blocks(model, breakage, state, work.points, first, last)
    wait_for_all(team)
    found = 0.0
    for block in range(first, last):
        if measure(
                model.wrapping, model.links, breakage, state, work.points, h, block,
                model.blocks.slot[block]):
            found = 1.0
    trail.errors[team.member] = found
    wait_for_all(team)
    for member in range(team.size):
        found = max(found, trail.errors[member])
    wait_for_all(team)
    return found > 0.0


@compiled
def move_blocks(
    model: Model, breakage: Breakage, state: State, points: np.ndarray, first: int, last: int
) -> None:
    """
    Write the velocities v + omega x s [m/s] of the attachment points of blocks first to last.
    """
    velocity, spin = state.linear_velocity, state.angular_velocity
    for block in range(first, last):
        s = model.blocks.slot[block]
        move_links(model.links, points, state.position, (
            load(velocity, 0, s), load(velocity, 1, s), load(velocity, 2, s),
            load(spin, 0, s), load(spin, 1, s), load(spin, 2, s)), breakage.moving, s)


@compiled
def measure(
    wrapping: Wrapping | None, links: Links | None, breakage: Breakage, state: State,
    points: np.ndarray, h: float, block: int, s: int
) -> bool:
    """
    Store lengths and rates of the connectors of a block; return True if one may have broken.

    The step of length `h` began with the stored lengths. With h = 0 lengths are only stored.
    """
    if links is None:
        return False
    moving, stride = breakage.moving, breakage.length.shape[1]
    doubt = doubt_of(wrapping)
    found = False
    for edge in range(6):
        at = 3 * edge * stride + s
        for link in range(2 * edge, 2 * edge + 2):
            place = links.place[block, link]
            ux = load_at(points, place) - load_at(points, at)
            uy = load_at(points, place + stride) - load_at(points, at + stride)
            uz = load_at(points, place + 2 * stride) - load_at(points, at + 2 * stride)
            vx = load_at(moving, place) - load_at(moving, at)
            vy = load_at(moving, place + stride) - load_at(moving, at + stride)
            vz = load_at(moving, place + 2 * stride) - load_at(moving, at + 2 * stride)
            square = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(1e-300))
            inverse = rsqrt(square)
            length = square * inverse
            rate = fma(ux, vx, fma(uy, vy, uz * vz)) * inverse
            length, rate = change_rates(
                wrapping, links, state, points, block, link, s, length, rate)
            excess = splat(-1.0)
            if h > 0.0:
                before, speed = load(breakage.length, link, s), load(breakage.rate, link, s)
                excess = maximum(
                    excess_over(
                        load(breakage.longest, link, s), before, speed, length, rate, h, doubt),
                    excess_under(
                        load(breakage.shortest, link, s), before, speed, length, rate, h, doubt))
                excess = where(bits(links.present[block, link]), excess, splat(-1.0))
                if any_lane(excess > splat(0.0)):
                    found = True
            store(breakage.excess, link, s, excess)
            store(breakage.length, link, s, length)
            store(breakage.rate, link, s, rate)
    return found


@compiled
def excess_over(
    limit: Vector, before: Vector, speed: Vector, after: Vector, rate: Vector, h: float,
    doubt: float
) -> Vector:
    """Estimate by how much a length has exceeded a limit [m] within a step."""
    slack = splat(1.0 - TOGETHER) * limit
    return maximum(
        maximum(before, after), highest(before, speed, after, rate, h, doubt)) - slack


@compiled
def excess_under(
    limit: Vector, before: Vector, speed: Vector, after: Vector, rate: Vector, h: float,
    doubt: float
) -> Vector:
    """Estimate by how much a length has fallen below a limit [m] within a step."""
    zero = splat(0.0)
    slack = splat(1.0 + TOGETHER) * limit
    before, speed, after, rate = zero - before, zero - speed, zero - after, zero - rate
    return maximum(
        maximum(before, after), highest(before, speed, after, rate, h, doubt)) + slack


@compiled
def doubt_of(wrapping: Wrapping | None) -> float:
    """Return the fraction of the distance up to the tangents that `highest` adds to the cubic."""
    if wrapping is None:
        return DOUBT
    else:
        return CORNER_DOUBT


@compiled
def highest(
    before: Vector, speed: Vector, after: Vector, rate: Vector, h: float, doubt: float
) -> Vector:
    """
    Return an estimate of the maximum in a step of a number that rose at first and fell at last.

    The maximum is that of the cubic through both ends, at its turning point, plus the fraction
    `doubt` of the remaining distance to the tangents. If the number has not risen and fallen,
    return its end.
    """
    zero, one, step = splat(0.0), splat(1.0), splat(h)
    turns = where(speed > zero, where(rate < zero, one, zero), zero)
    turning = turns > zero
    x = where(turning, speed, one) / where(turning, speed - rate, one)
    y = one - x
    rise, fall = step * speed, zero - step * rate
    tangent = fma(rise, x, before)
    other = fma(fall, y, after)
    tangent = where(other < tangent, other, tangent)
    cubic = before * y * y * (one + x + x) + after * x * x * (one + y + y)
    cubic = fma(x * y, fma(rise, y, fall * x), cubic)
    return where(turning, fma(splat(doubt), tangent - cubic, cubic), after)
