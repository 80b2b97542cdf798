# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Prediction of the time when a contact begins or ends, from the start of a step.

Forces have a kink at that time, and a step of high order across the kink has an error of order 2.
The step control would shorten steps again and again until the step with the kink hardly matters,
and then lengthen them again. A step that ends at the kink is as accurate as one without contact,
and so is the step that starts there.

Bodies are extrapolated with their velocity and acceleration: x + v t + a t^2 / 2, turned by
w t + b t^2 / 2. For the short steps around contacts the predicted time is accurate to a small
fraction of the step; from there it is predicted once more.

A step in which a contact is possible is examined before it is tried. The result must not depend on
the list: if bodies may move farther than the list covers, a search comes first. After a step that
was rejected for its error, the prediction is repeated.
"""

import math

from icofabric_sim.kernels.rotations import rows_of
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    lane,
    LANES,
    load,
    maximum,
    splat,
    sqrt,
    where,
)
from icofabric_sim.kernels.runtime.outlined import call_float
from icofabric_sim.kernels.runtime.team import Team, wait_for_all
from icofabric_sim.terms.carriers import moving_lanes, offset_of, slot_of
from icofabric_sim.terms.contacts.clearance import mean_velocity
from icofabric_sim.terms.contacts.displacement import add_ways, FREE, LATE, MAX_REACH, shift_at
from icofabric_sim.terms.contacts.gap import Axes, axes_of, edge_of, plane_gap, ratio_of, support
from icofabric_sim.terms.contacts.record import Contacts, Watch
from icofabric_sim.terms.contacts.shape import OUTER
from icofabric_sim.terms.shared import Blocks, State, Trail
import numpy as np

# No contact changes; the result is not known.
NEVER_MEET, UNKNOWN = 1e300, -1.0
# Changes within this multiple of the accuracy of a landing are those of the landing before.
_EARLY = 4.0


@compiled
def foresee(
    contacts: Contacts | None, watch: Watch | None, blocks: Blocks, state: State, trail: Trail,
    team: Team, time: float, h: float, close: float, meeting: np.ndarray, first: int, last: int
) -> float:
    """
    Return the result of `land` for a step of `h` [s] from `state` at `time` [s], before the step.

    Changes within the first few `close` [s] do not count: a step that begins just before a contact
    contains little of the kink. UNKNOWN if a search has to come first, NEVER_MEET also if bodies
    move so far that no search would suffice.
    """
    if watch is None:
        return NEVER_MEET
    quickest, way = ways_to_come(watch, blocks, state, trail.slopes[0], time, h, first, last)
    trail.speeds[team.member], trail.ways[team.member] = quickest, way
    wait_for_all(team)
    if team.member == 0:
        for member in range(team.size):
            quickest = max(quickest, trail.speeds[member])
            way = max(way, trail.ways[member])
        meeting[0] = first_ahead(
            contacts, watch, state, trail.slopes[0], time, h, close, quickest, math.sqrt(way))
    wait_for_all(team)
    return float(meeting[0])


@compiled
def first_ahead(
    contacts: Contacts | None, watch: Watch, state: State, slope: np.ndarray, time: float,
    h: float, close: float, farthest: float, moved: float
) -> float:
    """
    Return the result of `foresee` in one thread.

    Bodies move by `farthest` [m] at most, relative to their common motion, and have moved by
    `moved` [m] since the last search.
    """
    if not farthest <= 0.5 * watch.limits[MAX_REACH]:
        return NEVER_MEET
    # The common motion differs a little from that of the last search.
    nearby, frame = watch.nearby, watch.frame
    mean = mean_velocity(state, nearby.slots) if nearby.free else (0.0, 0.0, 0.0)
    square = 0.0
    for k in range(3):
        square += (mean[k] - frame[1 + k] - 2.0 * (time - frame[0]) * frame[4 + k]) ** 2
    farthest += h * math.sqrt(square)
    if watch.limits[FREE] > moved + farthest:
        return NEVER_MEET
    if moved + farthest > math.sqrt(watch.limits[LATE]):
        watch.far[0] = max(watch.far[0], farthest * farthest)
        return UNKNOWN
    if contacts is None:
        return NEVER_MEET
    else:
        return first_change(contacts, state, slope, _EARLY * close, h, close)


@compiled
def ways_to_come(
    watch: Watch, blocks: Blocks, state: State, slope: np.ndarray, time: float, h: float,
    first: int, last: int
) -> tuple[float, float]:
    """
    Return a bound of the predicted displacements [m] in `h` [s] of points in blocks first to last.

    Relative to the common motion. The second result is the largest squared displacement [m^2]
    since the last search.
    """
    nearby, frame, zero = watch.nearby, watch.frame, splat(0.0)
    mean = mean_velocity(state, nearby.slots) if nearby.free else (0.0, 0.0, 0.0)
    shift, row = shift_at(watch, time), row_of_accelerations(state)
    quickest, way = zero, zero
    step, half, radius = splat(h), splat(0.5 * h), splat(watch.radius)
    for block in range(first, last):
        s = blocks.slot[block]
        v, a, o, b = zero, zero, zero, zero
        for k in range(3):
            u = load(state.linear_velocity, k, s) - splat(mean[k])
            v = fma(u, u, v)
            u = load(slope, row + k, s) - splat(2.0 * frame[4 + k])
            a = fma(u, u, a)
            u = load(state.angular_velocity, k, s)
            o = fma(u, u, o)
            u = load(slope, row + 3 + k, s)
            b = fma(u, u, b)
        speed = fma(radius, sqrt(o), sqrt(v)) + half * fma(radius, sqrt(b), sqrt(a))
        lanes = bits(moving_lanes(watch.carried, blocks.alive[block], s))
        quickest = maximum(where(lanes, step * speed, zero), quickest)
        way = add_ways(watch, state, blocks.alive[block], shift, s, way)
    farthest, moved = 0.0, 0.0
    for i in range(LANES):
        farthest = max(farthest, lane(quickest, i))
        moved = max(moved, lane(way, i))
    return farthest, moved


@compiled
def row_of_accelerations(state: State) -> int:
    """
    Return the first row of accelerations in a slope; rows of Maxwell arms may come after them.
    """
    return int(3 + rows_of(state.orientation).shape[0])


@compiled
def land(
    contacts: Contacts | None, team: Team, state: State, slope: np.ndarray, tried: float,
    close: float, meeting: np.ndarray
) -> float:
    """
    Return the time [s] until a contact begins or ends, less than a step of length `tried` [s].

    From `state` with its slopes (r, s), to within `close` [s]; just before the change, if the
    change is more than a few `close` away. NEVER_MEET without a change. Equal in all threads,
    through `meeting` (1,).
    """
    if contacts is None:
        return NEVER_MEET
    if team.member == 0:
        meeting[0] = first_change(contacts, state, slope, 0.0, tried, close)
    wait_for_all(team)
    return float(meeting[0])


@compiled
def first_change(
    contacts: Contacts, state: State, slope: np.ndarray, begin: float, tried: float, close: float
) -> float:
    """Return the result of `land` in one thread, for changes from a time `begin` [s] on."""
    first, found = NEVER_MEET, NEVER_MEET
    for p in range(contacts.pairs.shape[0]):
        until = min(tried, first)
        if stays_apart(contacts, state, slope, p, until):
            continue
        now = gap_at(contacts, state, slope, p, begin)
        then = gap_at(contacts, state, slope, p, until)
        if (now > 0.0) != (then > 0.0):
            low, high = bracket(contacts, state, slope, p, begin, until, now, then, close)
            first = high
            # Just before, so that there is no kink in the step. If the change is close, the step
            # is so short that the kink does not matter.
            found = low if low > 4.0 * close else high
    return found if found < tried else NEVER_MEET


@compiled
def stays_apart(
    contacts: Contacts, state: State, slope: np.ndarray, p: int, t: float
) -> bool:
    """
    Check that the separating axis of two bodies shows a gap that they cannot close in `t` [s].
    """
    s, other = contacts.pairs[p, 0], contacts.pairs[p, 1]
    if other < 0:
        return False
    axis = contacts.result[p, 12:15]
    gap, square, turning = 0.0, 0.0, 0.0
    half_edge = edge_of(contacts.half_edge, contacts.half_edges, s)
    ratio = ratio_of(contacts.half_edges, s, other)
    row = row_of_accelerations(state)
    for k in range(3):
        gap += axis[k] * (state.position[k, other] - state.position[k, s])
        u = t * (
            state.linear_velocity[k, other] - state.linear_velocity[k, s]
            + 0.5 * t * (slope[row + k, other] - slope[row + k, s]))
        square += u * u
    for body in (s, other):
        spin = 0.0
        for k in range(3):
            u = t * (state.angular_velocity[k, body] + 0.5 * t * slope[row + 3 + k, body])
            spin += u * u
        spin = math.sqrt(spin)
        turning += spin if body == s else ratio * spin
    gap -= half_edge * (
        support(axes_of(state.orientation, s), axis[0], axis[1], axis[2])
        + ratio * support(axes_of(state.orientation, other), axis[0], axis[1], axis[2]))
    return gap > math.sqrt(square) + OUTER * half_edge * turning


@compiled
def bracket(
    contacts: Contacts, state: State, slope: np.ndarray, p: int, begin: float, until: float,
    now: float, then: float, close: float
) -> tuple[float, float]:
    """
    Return two times [s], at most `close` apart, around the sign change of the gap of a pair.

    By the secant through the gaps [m] at both ends, `now` and `then`, a little to the farther
    side, so that both ends converge; by bisection if that does not halve the range.
    """
    low, high, below, above = begin, until, now, then
    halve = False
    while high - low > close:
        length = high - low
        place = low + 0.5 * length
        if not halve and below != above:
            part = below / (below - above)
            place = low + part * length + (0.45 if part < 0.5 else -0.45) * close
        if not low < place < high:
            place = low + 0.5 * length
        if not low < place < high:
            break
        gap = gap_at(contacts, state, slope, p, place)
        if (gap > 0.0) == (now > 0.0):
            low, below = place, gap
        else:
            high, above = place, gap
        halve = not halve and high - low > 0.5 * length
    return low, high


@compiled
def gap_at(
    contacts: Contacts, state: State, slope: np.ndarray, p: int, t: float
) -> float:
    """Return the predicted gap [m] of a pair after a time `t` [s]; not above 0: contact."""
    s, other = contacts.pairs[p, 0], contacts.pairs[p, 1]
    own = contacts.first[0]
    foretell(state, slope, s, t, own)
    if other < 0:
        axes = (
            own[1, 0], own[2, 0], own[3, 0], own[1, 1], own[2, 1], own[3, 1], own[1, 2],
            own[2, 2], own[3, 2])
        offset = offset_of(contacts.planes, contacts.carriers, state.position, -1 - other)
        carrier = slot_of(contacts.carriers, other)
        if carrier >= 0:
            for k in range(3):
                offset += t * contacts.planes[-1 - other, k] * state.linear_velocity[k, carrier]
        return plane_gap(
            contacts.planes[-1 - other], offset,
            edge_of(contacts.half_edge, contacts.half_edges, s), own[0, 0], own[0, 1], own[0, 2],
            axes)
    second = contacts.second[0]
    foretell(state, slope, other, t, second)
    # `found_gap` of pair.py
    return call_float(contacts.gap_address, (
        edge_of(contacts.half_edge, contacts.half_edges, s),
        edge_of(contacts.half_edge, contacts.half_edges, other), own[0], own[1:], second[0],
        second[1:], contacts.scratch))


@compiled
def foretell(
    state: State, slope: np.ndarray, s: int, t: float, place: np.ndarray
) -> None:
    """
    Write the predicted position and rotation matrix (body to world) of slot `s` after `t` [s].
    """
    row = row_of_accelerations(state)
    for k in range(3):
        place[0, k] = state.position[k, s] + t * (
            state.linear_velocity[k, s] + 0.5 * t * slope[row + k, s])
    x = t * (state.angular_velocity[0, s] + 0.5 * t * slope[row + 3, s])
    y = t * (state.angular_velocity[1, s] + 0.5 * t * slope[row + 4, s])
    z = t * (state.angular_velocity[2, s] + 0.5 * t * slope[row + 5, s])
    axes = turned(axes_of(state.orientation, s), x, y, z)
    place[1, 0], place[2, 0], place[3, 0] = axes[0], axes[1], axes[2]
    place[1, 1], place[2, 1], place[3, 1] = axes[3], axes[4], axes[5]
    place[1, 2], place[2, 2], place[3, 2] = axes[6], axes[7], axes[8]


@compiled
def turned(axes: Axes, x: float, y: float, z: float) -> Axes:
    """Return axes turned by a rotation vector (O. Rodrigues 1840)."""
    square = x * x + y * y + z * z
    # (1 - cos) / angle^2 and sin / angle
    if square > 1e-8:
        angle = math.sqrt(square)
        along, across = (1.0 - math.cos(angle)) / square, math.sin(angle) / angle
    else:
        along, across = 0.5 - square / 24.0, 1.0 - square / 6.0
    ax, ay, az = turned_one(axes[0], axes[1], axes[2], x, y, z, square, along, across)
    bx, by, bz = turned_one(axes[3], axes[4], axes[5], x, y, z, square, along, across)
    cx, cy, cz = turned_one(axes[6], axes[7], axes[8], x, y, z, square, along, across)
    return ax, ay, az, bx, by, bz, cx, cy, cz


@compiled
def turned_one(
    vx: float, vy: float, vz: float, x: float, y: float, z: float, square: float, along: float,
    across: float
) -> tuple[float, float, float]:
    """Return the sum of v, across w x v and along w x (w x v)."""
    dot = vx * x + vy * y + vz * z
    return (
        vx + across * (y * vz - z * vy) + along * (dot * x - square * vx),
        vy + across * (z * vx - x * vz) + along * (dot * y - square * vy),
        vz + across * (x * vy - y * vx) + along * (dot * z - square * vz))
