# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Connectors whose slope jumps at their natural length, within one step.

Splittings and interpolations require smooth forces. So for one step every connector keeps the
slope of the side on which it begins. A crossing changes the tension by D e(t), with D the
difference of the slopes and e the stretch from its crossing on. That change becomes a cubic in
time with the same first four moments, predicted from stretch, rate and second derivative at the
start of the step. The cubic acts with the other forces in every stage.

After the step e is known better, as the quintic through both ends. The missing impulse and first
moment act in two kicks along the connectors, at the end of the step and half a step before it, to
which all drift freely. All kicks are equal and opposite along a connector. See
docs/decisions/kinks.md.

If every connector is several times as far from its kink as points can move in the step, the state
at the start of the step decides and nothing is predicted. The lengths need not be computed for
that decision while bodies are near their positions at the last measurement (`moved_of`, a bound).
A fabric far from its kinks therefore takes the steps of plain springs.
"""

import math

from icofabric_sim.kernels.flows import accelerate, kick
from icofabric_sim.kernels.loads import resist_row
from icofabric_sim.kernels.records import Links, Loads, Model, State, Work
from icofabric_sim.kernels.rotations import rows_of
from icofabric_sim.kernels.runtime.compiled import compiled, inlined
from icofabric_sim.kernels.runtime.lanes import (
    any_lane,
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
    sqrt,
    store,
    store_at,
    Vector,
    where,
)
from icofabric_sim.terms.links.kinks import Kinks
import numpy as np

_SMALLEST_SQUARE = 1e-300
# Steps of Newton's method towards a crossing, from a secant over half of the step; the error of an
# impulse is of the order of the squared remaining error.
_NEWTON = 2


def _gauss(count: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return nodes and weights of Gauss and Legendre on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return tuple(0.5 * float(1.0 + x) for x in nodes), tuple(0.5 * float(w) for w in weights)


# Exact for the quintic times the time, and for a quadratic times its cube.
_NODES, _WEIGHTS = _gauss(4)
_FEWER_NODES, _FEWER_WEIGHTS = _gauss(3)
# From the moments of 1, s, s^2, s^3 on [0, 1] to the cubic that has them: the inverse of the
# Hilbert matrix.
_CUBIC = (
    (16.0, -120.0, 240.0, -140.0), (-120.0, 1200.0, -2700.0, 1680.0),
    (240.0, -2700.0, 6480.0, -4200.0), (-140.0, 1680.0, -4200.0, 2800.0))

# Rows of Kinks.start, twelve each: stretch, rate and half the second derivative of a step.
_STRETCH, _RATE, _CURVE = 0, 12, 24

# Indices of a thread in Kinks.ranges: how far points move in a step, and have moved from the
# stored state; the least distance from a kink, the least and the largest stretch.
_REACH, _MOVED, _NEAREST, _LOWEST, _HIGHEST = 0, 1, 2, 3, 4
# Least distance of a connector from its kink over the displacement of a point: two, because both
# ends move, and two more as a margin for errors of the prediction.
_SAFE = 4.0
# Factor of distances that covers rounding.
_ROUNDING_FACTOR = 0.999
FAR_AWAY = 1e300

Four = tuple[Vector, Vector, Vector, Vector]
Sextuple = tuple[Vector, Vector, Vector, Vector, Vector, Vector]


@compiled
def note_motion(
    links: Links | None, kinks: Kinks, state: State, points: np.ndarray, h: float, s: int
) -> None:
    """
    Write velocities and accelerations of the attachment points of a block.

    They are computed from the velocities before and after a kick of `h` [s], which `kinks.before`
    and `state` hold. With h > 0 the kick begins a step and the velocities before it count, else
    those after.
    """
    if links is None:
        return
    stride = state.position.shape[1]
    per = splat(1.0 / abs(h))
    px, py, pz = load(state.position, 0, s), load(state.position, 1, s), load(state.position, 2, s)
    vx, vy = load(state.linear_velocity, 0, s), load(state.linear_velocity, 1, s)
    vz, ox = load(state.linear_velocity, 2, s), load(state.angular_velocity, 0, s)
    oy, oz = load(state.angular_velocity, 1, s), load(state.angular_velocity, 2, s)
    wx, wy, wz = load(kinks.before, 0, s), load(kinks.before, 1, s), load(kinks.before, 2, s)
    qx, qy, qz = load(kinks.before, 3, s), load(kinks.before, 4, s), load(kinks.before, 5, s)
    ax, ay, az = per * (vx - wx), per * (vy - wy), per * (vz - wz)
    bx, by, bz = per * (ox - qx), per * (oy - qy), per * (oz - qz)
    if h > 0.0:
        vx, vy, vz, ox, oy, oz = wx, wy, wz, qx, qy, qz
    for edge in range(6):
        at = 3 * edge * stride + s
        rx, ry = load_at(points, at) - px, load_at(points, at + stride) - py
        rz = load_at(points, at + 2 * stride) - pz
        tx, ty, tz = oy * rz - oz * ry, oz * rx - ox * rz, ox * ry - oy * rx
        store_at(kinks.rates, at, vx + tx)
        store_at(kinks.rates, at + stride, vy + ty)
        store_at(kinks.rates, at + 2 * stride, vz + tz)
        store_at(kinks.seconds, at, ax + (by * rz - bz * ry) + (oy * tz - oz * ty))
        store_at(
            kinks.seconds, at + stride, ay + (bz * rx - bx * rz) + (oz * tx - ox * tz))
        store_at(
            kinks.seconds, at + 2 * stride, az + (bx * ry - by * rx) + (ox * ty - oy * tx))


@compiled
def reach_of(
    kinks: Kinks, links: Links | None, state: State, h: float, kick: float, s: int
) -> Vector:
    """
    Estimate how far [m] attachment points of a block move in a step of `h` [s].

    The estimate uses the velocities before and after its first kick of `kick` [s].
    """
    zero = splat(0.0)
    if links is None:
        return zero
    v, o, a, b = zero, zero, zero, zero
    per = splat(1.0 / kick)
    for k in range(3):
        w, q = load(kinks.before, k, s), load(kinks.before, k + 3, s)
        more = per * (load(state.linear_velocity, k, s) - w)
        turn = per * (load(state.angular_velocity, k, s) - q)
        v, o, a, b = fma(w, w, v), fma(q, q, o), fma(more, more, a), fma(turn, turn, b)
    radius = splat(links.half_width)
    speed = fma(radius, sqrt(o), sqrt(v))
    rate = fma(radius, sqrt(b) + o, sqrt(a))
    return splat(h) * fma(splat(0.5 * h), rate, speed)


@compiled
def moved_of(kinks: Kinks, links: Links | None, state: State, s: int) -> Vector:
    """Return a bound of the distance [m] of a block's attachment points from the stored state."""
    zero = splat(0.0)
    if links is None:
        return zero
    shift, turn = zero, zero
    for k in range(3):
        d = load(state.position, k, s) - load(kinks.kept_position, k, s)
        shift = fma(d, d, shift)
    turns = rows_of(state.orientation)
    for k in range(turns.shape[0]):
        d = load(turns, k, s) - load(kinks.kept_orientation, k, s)
        turn = fma(d, d, turn)
    # A point moves by at most twice the change of the quaternion, or the change of the cosines.
    factor = 2.0 if turns.shape[0] == 4 else 1.0
    return fma(splat(factor * links.half_width), sqrt(turn), sqrt(shift))


@compiled
def keep_state(kinks: Kinks, state: State, s: int) -> None:
    """Store position and orientation of a block."""
    for k in range(3):
        store(kinks.kept_position, k, s, load(state.position, k, s))
    turns = rows_of(state.orientation)
    for k in range(turns.shape[0]):
        store(kinks.kept_orientation, k, s, load(turns, k, s))


@compiled
def note_reach(kinks: Kinks, member: int, reach: Vector, moved: Vector) -> None:
    """Store the largest reach and displacement [m] of a thread's blocks."""
    kinks.ranges[8 * member + _REACH] = most_of_lanes(reach, 0.0)
    kinks.ranges[8 * member + _MOVED] = most_of_lanes(moved, 0.0)


@compiled
def note_stretches(
    kinks: Kinks, member: int, nearest: Vector, lowest: Vector, highest: Vector
) -> None:
    """Store the least distance from a kink and the range of stretches [m] of a thread's blocks."""
    minus = splat(-1.0)
    kinks.ranges[8 * member + _NEAREST] = -most_of_lanes(minus * nearest, -FAR_AWAY)
    kinks.ranges[8 * member + _LOWEST] = -most_of_lanes(minus * lowest, -FAR_AWAY)
    kinks.ranges[8 * member + _HIGHEST] = most_of_lanes(highest, -FAR_AWAY)


@compiled
def most_of_lanes(value: Vector, least: float) -> float:
    """Return the largest number of a vector, at least `least`; infinite if one is not a number."""
    largest = least
    for i in range(LANES):
        number = lane(value, i)
        if not number <= largest:
            largest = number if number == number else math.inf
    return largest


@compiled
def largest_of(kinks: Kinks, row: int, size: int) -> float:
    """Return the largest number of all threads in a row of `kinks.ranges`."""
    largest = kinks.ranges[row]
    for member in range(1, size):
        largest = max(largest, kinks.ranges[8 * member + row])
    return float(largest)


@compiled
def least_of(kinks: Kinks, row: int, size: int) -> float:
    """Return the least number of all threads in a row of `kinks.ranges`."""
    least = kinks.ranges[row]
    for member in range(1, size):
        least = min(least, kinks.ranges[8 * member + row])
    return float(least)


@compiled
def stays_far(kinks: Kinks, size: int) -> bool:
    """Check by a bound of displacements that all connectors are far from their kinks."""
    if not kinks.margin[0] > 0.0:
        return False
    left = _ROUNDING_FACTOR * kinks.margin[0] - 2.0 * largest_of(kinks, _MOVED, size)
    return left > _SAFE * largest_of(kinks, _REACH, size)


@compiled
def is_far(kinks: Kinks, size: int) -> bool:
    """Check by their lengths that all connectors are far from their kinks."""
    return least_of(kinks, _NEAREST, size) > _SAFE * largest_of(kinks, _REACH, size)


@compiled
def note_margin(kinks: Kinks, size: int, far: bool) -> None:
    """Store the least distance from a kink and the common side; zeros if not all are `far`."""
    kinks.margin[0] = kinks.margin[1] = 0.0
    if far:
        kinks.margin[0] = least_of(kinks, _NEAREST, size)
        if least_of(kinks, _LOWEST, size) > 0.0:
            kinks.margin[1] = 1.0
        elif largest_of(kinks, _HIGHEST, size) < 0.0:
            kinks.margin[1] = -1.0


@compiled
def choose_law(kinks: Kinks, far: bool) -> None:
    """Store the common stiffness if all connectors are alike in this step, else 0."""
    kinks.alike[0] = 0.0
    if far and kinks.margin[1] != 0.0:
        kinks.alike[0] = kinks.uniform[0 if kinks.margin[1] > 0.0 else 1]
        kinks.alike[1] = kinks.uniform[2]


@compiled
def forget_crossings(kinks: Kinks, first: int, last: int) -> None:
    """Clear all crossings of blocks first to last."""
    for block in range(first, last):
        for link in range(12):
            kinks.active[block, link] = 0


@compiled
def has_crossings(kinks: Kinks, block: int) -> bool:
    """Check that at least one crossing acts on a block."""
    for link in range(12):
        if kinks.active[block, link] != 0:
            return True
    return False


@compiled
def keep_velocities(kinks: Kinks, state: State, s: int) -> None:
    """Store the velocities of a block before a kick."""
    for k in range(3):
        store(kinks.before, k, s, load(state.linear_velocity, k, s))
        store(kinks.before, k + 3, s, load(state.angular_velocity, k, s))


@inlined
def stretch_of(
    kinks: Kinks, points: np.ndarray, stride: int, at: int, place: int, rest: Vector, h: float
) -> tuple[Vector, Vector, Vector]:
    """Return stretch, h times its rate and h^2 / 2 times its second derivative, all [m]."""
    rates, seconds = kinks.rates, kinks.seconds
    ux = load_at(points, place) - load_at(points, at)
    uy = load_at(points, place + stride) - load_at(points, at + stride)
    uz = load_at(points, place + 2 * stride) - load_at(points, at + 2 * stride)
    vx = load_at(rates, place) - load_at(rates, at)
    vy = load_at(rates, place + stride) - load_at(rates, at + stride)
    vz = load_at(rates, place + 2 * stride) - load_at(rates, at + 2 * stride)
    ax = load_at(seconds, place) - load_at(seconds, at)
    ay = load_at(seconds, place + stride) - load_at(seconds, at + stride)
    az = load_at(seconds, place + 2 * stride) - load_at(seconds, at + 2 * stride)
    length = sqrt(maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(_SMALLEST_SQUARE)))
    inverse = splat(1.0) / length
    rate = fma(ux, vx, fma(uy, vy, uz * vz)) * inverse
    second = fma(vx, vx, fma(vy, vy, vz * vz)) + fma(ux, ax, fma(uy, ay, uz * az))
    second = (second - rate * rate) * inverse
    return length - rest, splat(h) * rate, splat(0.5 * h * h) * second


@inlined
def value_of(c: Sextuple, x: Vector) -> Vector:
    """Return the value of a quintic at x."""
    return fma(x, fma(x, fma(x, fma(x, fma(x, c[5], c[4]), c[3]), c[2]), c[1]), c[0])


@inlined
def slope_at(c: Sextuple, x: Vector) -> Vector:
    """Return the derivative of a quintic at x."""
    return fma(x, fma(x, fma(x, fma(
        x, splat(5.0) * c[5], splat(4.0) * c[4]), splat(3.0) * c[3]), c[2] + c[2]), c[1])


@inlined
def crossing(c: Sextuple, low: Vector, high: Vector, sign: float) -> Vector:
    """
    Return the zero of a quintic between `low` and `high`: falling for `sign` 1, rising for -1.

    Newton's method with bounds that shrink. Lanes without a crossing return any number.
    """
    zero, half = splat(0.0), splat(0.5)
    turn, minus = splat(sign), splat(-1.0)
    first, last = turn * value_of(c, low), turn * value_of(c, high)
    fall = first - last
    x = low + (high - low) * (first / where(fall > zero, fall, splat(1.0)))
    for _ in range(_NEWTON):
        middle = half * (low + high)
        x = where(x < low, middle, where(x > high, middle, x))
        value, slope = turn * value_of(c, x), turn * slope_at(c, x)
        above = value > zero
        low, high = where(above, x, low), where(above, high, x)
        falls = slope < zero
        x = where(falls, x - value / where(falls, slope, minus), half * (low + high))
    middle = half * (low + high)
    return where(x < low, middle, where(x > high, middle, x))


@inlined
def moments_beyond(c: Sextuple) -> tuple[Vector, Vector]:
    """
    Return integrals of g and s g over the subset of [0, 1] where the quintic g is negative.

    g begins at 0 or above; the integrals are zero if g is negative neither at the middle nor the
    end.
    """
    zero, half, one = splat(0.0), splat(0.5), splat(1.0)
    middle, last = value_of(c, half), value_of(c, one)
    early, late = middle < zero, last < zero
    begin = crossing(c, where(early, zero, half), where(early, half, one), 1.0)
    end = one
    dips = where(early, where(late, zero, one), zero) > zero
    if any_lane(dips):
        end = where(dips, crossing(c, half, one, -1.0), one)
    there = where(early, one, where(late, one, zero)) > zero
    begin = where(there, begin, zero)
    span = where(there, end - begin, zero)
    a, b = zero, zero
    for k in range(4):
        x = fma(span, splat(_NODES[k]), begin)
        term = splat(_WEIGHTS[k]) * span * value_of(c, x)
        a = a + term
        b = fma(x, term, b)
    return a, b


@inlined
def moments_foretold(c: Sextuple) -> Four:
    """
    Return integrals of g, s g, s^2 g, s^3 g over the subset of [0, 1] where g is negative.

    g is a quadratic: the other coefficients are zero. Otherwise as `moments_beyond`.
    """
    zero, half, one = splat(0.0), splat(0.5), splat(1.0)
    early, late = value_of(c, half) < zero, value_of(c, one) < zero
    root = c[1] * c[1] - splat(4.0) * c[2] * c[0]
    lower = sqrt(where(root > zero, root, zero)) - c[1]
    begin = (c[0] + c[0]) / where(lower > zero, lower, one)
    end = one
    dips = where(early, where(late, zero, one), zero) > zero
    if any_lane(dips):
        rises = c[2] > zero
        end = where(dips, lower / where(rises, c[2] + c[2], one), one)
    there = where(early, one, where(late, one, zero)) > zero
    begin = where(there, begin, zero)
    span = where(there, end - begin, zero)
    a, b, d, e = zero, zero, zero, zero
    for k in range(3):
        x = fma(span, splat(_FEWER_NODES[k]), begin)
        term = splat(_FEWER_WEIGHTS[k]) * span * value_of(c, x)
        a = a + term
        term = x * term
        b = b + term
        term = x * term
        d = d + term
        e = fma(x, term, e)
    return a, b, d, e


@compiled
def side_of(kinks: Kinks, links: Links, block: int, link: int, s: int) -> tuple[Vector, Vector]:
    """
    Return the side of a connector at the start of a step, and the jump of its slope [N/m].

    1 if the connector is longer than its natural length, else -1. The jump is how much stiffer the
    other side is; it is 0 without a connector.
    """
    zero, one = splat(0.0), splat(1.0)
    longer = load(kinks.start, _STRETCH + link, s) > zero
    pull, push = load(kinks.extension, link, s), load(kinks.compression, link, s)
    return where(longer, one, zero - one), where(
        bits(links.present[block, link]), where(longer, push - pull, pull - push), zero)


@compiled
def foretell(
    links: Links | None, kinks: Kinks, points: np.ndarray, h: float, block: int, s: int
) -> tuple[bool, Vector, Vector, Vector]:
    """
    Choose the slopes of a step of `h` [s] for the connectors of a block, and predict crossings.

    Return True if a crossing is predicted; the least distance from a kink, the least and the
    largest stretch [m].
    """
    found = False
    nearest, lowest, highest = splat(FAR_AWAY), splat(FAR_AWAY), splat(-FAR_AWAY)
    if links is None:
        return found, nearest, lowest, highest
    stride, zero = kinks.start.shape[1], splat(0.0)
    for link in range(12):
        at = 3 * (link >> 1) * stride + s
        e, v, a = stretch_of(
            kinks, points, stride, at, links.place[block, link],
            load(kinks.natural_length, link, s), h)
        store(kinks.start, _STRETCH + link, s, e)
        store(kinks.start, _RATE + link, s, v)
        store(kinks.start, _CURVE + link, s, a)
        store(kinks.slope, link, s, where(
            e > zero, load(kinks.extension, link, s), load(kinks.compression, link, s)))
        side, jump = side_of(kinks, links, block, link, s)
        counts = jump * jump > zero
        away = where(counts, e, splat(FAR_AWAY))
        lowest = where(away < lowest, away, lowest)
        away = fabs(away)
        nearest = where(away < nearest, away, nearest)
        highest = maximum(where(counts, e, splat(-FAR_AWAY)), highest)
        c = (side * e, side * v, side * a, zero, zero, zero)
        beyond = where(
            value_of(c, splat(0.5)) < zero, splat(1.0),
            where(value_of(c, splat(1.0)) < zero, splat(1.0), zero))
        crosses = any_lane(beyond * jump * jump > zero)
        kinks.active[block, link] = 1 if crosses else 0
        if crosses:
            found = True
            store_forces(kinks, moments_foretold(c), side * jump, link, s)
    return found, nearest, lowest, highest


@inlined
def store_forces(kinks: Kinks, mu: Four, jump: Vector, link: int, s: int) -> None:
    """Store the cubic in time of the tension that a crossing adds [N], from its four moments."""
    for k in range(4):
        row = _CUBIC[k]
        value = fma(splat(row[0]), mu[0], splat(row[1]) * mu[1])
        value = fma(splat(row[2]), mu[2], fma(splat(row[3]), mu[3], value))
        store(kinks.forces, 12 * k + link, s, jump * value)


@compiled
def account(
    links: Links | None, kinks: Kinks, points: np.ndarray, h: float, block: int, s: int
) -> bool:
    """
    Store the impulses [N s] that a step of `h` [s] lacks: at its end, and half a step before it.

    For the connectors of a block, once the end is known. Return True if there are any.
    """
    found = False
    if links is None:
        return found
    stride, zero = kinks.start.shape[1], splat(0.0)
    for link in range(12):
        at = 3 * (link >> 1) * stride + s
        e, v, a = stretch_of(
            kinks, points, stride, at, links.place[block, link],
            load(kinks.natural_length, link, s), h)
        side, jump = side_of(kinks, links, block, link, s)
        first, rate = load(kinks.start, _STRETCH + link, s), load(kinks.start, _RATE + link, s)
        curve = load(kinks.start, _CURVE + link, s)
        d = side * (e - first - rate - curve)
        v, a = side * (v - rate - curve - curve), side * (a - curve)
        # v, a: differences of the rate and of half the second derivative.
        c = (
            side * first, side * rate, side * curve,
            fma(splat(10.0), d, a - splat(4.0) * v),
            fma(splat(-15.0), d, splat(7.0) * v - (a + a)),
            fma(splat(6.0), d, a - splat(3.0) * v))
        beyond = where(
            value_of(c, splat(0.5)) < zero, splat(1.0), where(side * e < zero, splat(1.0), zero))
        crosses = any_lane(beyond * jump * jump > zero)
        if not crosses and kinks.active[block, link] == 0:
            continue
        impulse, moment = zero, zero
        if crosses:
            mu = moments_beyond(c)
            jump = side * jump
            impulse, moment = jump * mu[0], jump * (mu[0] - mu[1])
        if kinks.active[block, link] != 0:
            # Subtract what has acted: impulse, and impulse times the remaining time.
            for k in range(4):
                force = load(kinks.forces, 12 * k + link, s)
                impulse = fma(splat(-1.0 / (k + 1)), force, impulse)
                moment = fma(splat(-1.0 / ((k + 1) * (k + 2))), force, moment)
        early = splat(2.0 * h) * moment
        store(kinks.forces, link, s, splat(h) * impulse - early)
        store(kinks.forces, 12 + link, s, early)
        kinks.active[block, link] = 2
        found = True
    return found


@compiled
def strike(
    model: Model, loads: Loads | None, kinks: Kinks, state: State, work: Work, row: int, h: float,
    block: int, s: int
) -> None:
    """
    Apply impulses along the active connectors of a block: `h` times those in rows from `row` on.

    The connectors act along their present directions.
    """
    force = impulses(model.links, kinks, work.points, state.position, row, h, block, s)
    a = accelerate(model.supports, model.inverse_mass, model.inverse_inertia, force, s)
    if loads is not None:
        for m in range(loads.start[block], loads.start[block + 1]):
            a = resist_row(model, loads, state, m, s, 1.0, 0.0, a)
    kick(state, a, 1.0, s)


@compiled
def impulses(
    links: Links | None, kinks: Kinks, points: np.ndarray, position: np.ndarray, row: int,
    h: float, block: int, s: int
) -> Sextuple:
    """Return impulse [N s] and angular impulse about the centre [N m s] on a block."""
    zero = splat(0.0)
    fx, fy, fz, tx, ty, tz = zero, zero, zero, zero, zero, zero
    if links is None:
        return fx, fy, fz, tx, ty, tz
    stride, factor = position.shape[1], splat(h)
    for link in range(12):
        if kinks.active[block, link] == 0:
            continue
        at, place = 3 * (link >> 1) * stride + s, links.place[block, link]
        px, py = load_at(points, at), load_at(points, at + stride)
        pz = load_at(points, at + 2 * stride)
        ux, uy = load_at(points, place) - px, load_at(points, place + stride) - py
        uz = load_at(points, place + 2 * stride) - pz
        square = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(_SMALLEST_SQUARE))
        pull = factor * load(kinks.forces, row + link, s) * rsqrt(square)
        pull = where(bits(links.present[block, link]), pull, zero)
        ax, ay, az = pull * ux, pull * uy, pull * uz
        fx, fy, fz = fx + ax, fy + ay, fz + az
        rx, ry = px - load(position, 0, s), py - load(position, 1, s)
        rz = pz - load(position, 2, s)
        tx = fma(ry, az, tx - rz * ay)
        ty = fma(rz, ax, ty - rx * az)
        tz = fma(rx, ay, tz - ry * ax)
    return fx, fy, fz, tx, ty, tz
