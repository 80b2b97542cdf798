# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Check that no contact can occur within a step of any length.

A contact that begins and ends between two evaluations of the forces leaves no trace, so steps are
limited if a contact is possible. Let no point of a shell be faster than v, and half of the
smallest gap of any two be g, or the smallest gap to a plane at rest. No contact occurs in a step
shorter than g / v, as no point moves farther than that.

The answer depends on the step alone, not on the times and reach of neighbour searches. If the
last search found enough clearance, the search for g is skipped, which never changes the result.
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
from icofabric_sim.kernels.runtime.team import Team, tell_all, wait_for_all
from icofabric_sim.terms.carriers import moving_lanes
from icofabric_sim.terms.contacts.displacement import add_ways, FREE, MAX_REACH, shift_at, SKIN
from icofabric_sim.terms.contacts.record import Watch
from icofabric_sim.terms.contacts.search import find_reach, refresh, survey
from icofabric_sim.terms.shared import Blocks, State, Trail
import numpy as np

# Results: a contact is possible, none is possible, and the list of pairs is too short.
NEAR_CONTACT, CLEAR, NO_ROOM = 0, 1, 2
# Speeds are known at the stages of a step only; between two of them, up to 0.27 of it apart, they
# may be higher: by 1 / cos(0.135 x 4) = 1.17 at the middle, for a vibration that turns by 4 rad.
_BETWEEN = 1.25


@compiled
def find_clear(
    watch: Watch | None, blocks: Blocks, state: State, trail: Trail, stages: int, team: Team,
    time: float, h: float, first: int, last: int
) -> int:
    """
    Return NEAR_CONTACT, CLEAR or NO_ROOM for a step of length `h` [s] from `state` at `time` [s].

    Its slopes are those of the first `stages`. The result is equal in all threads.
    """
    if watch is None:
        return CLEAR
    nearby = watch.nearby
    mean = mean_velocity(state, nearby.slots) if nearby.free else (0.0, 0.0, 0.0)
    speed, moved = fastest_points(
        watch, blocks, state, trail, stages, mean, time, first, last)
    trail.speeds[team.member], trail.ways[team.member] = speed, moved
    wait_for_all(team)
    found = NEAR_CONTACT
    if team.member == 0:
        for member in range(team.size):
            speed = max(speed, trail.speeds[member])
            moved = max(moved, trail.ways[member])
        found = judge_clear(watch, state, way_between(h, speed), moved)
    return int(tell_all(team, found))


@compiled
def fastest_points(
    watch: Watch, blocks: Blocks, state: State, trail: Trail, stages: int,
    mean: tuple[float, float, float], time: float, first: int, last: int
) -> tuple[float, float]:
    """
    Return the largest speed [m/s] of a point of bodies in blocks first to last in a step's stages.

    The speed is relative to the `mean` [m/s] of all. The second result is the largest square of a
    displacement [m^2] since the last search, at the start of the step at `time` [s].
    """
    shift = shift_at(watch, time)
    zero = splat(0.0)
    quickest, way = zero, zero
    rows = rows_of(state.orientation).shape[0]
    # |dq/dt| is half of the spin; the squares of all de_i/dt add up to twice its square.
    spins = splat(4.0 if rows == 4 else 0.5)
    for block in range(first, last):
        s = blocks.slot[block]
        fastest, spin = zero, zero
        for j in range(stages):
            ux = load(trail.slopes[j], 0, s) - splat(mean[0])
            uy = load(trail.slopes[j], 1, s) - splat(mean[1])
            uz = load(trail.slopes[j], 2, s) - splat(mean[2])
            fastest = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), fastest)
            square = zero
            for k in range(3, 3 + rows):
                u = load(trail.slopes[j], k, s)
                square = fma(u, u, square)
            spin = maximum(square, spin)
        # Computed for each body alone, so that the largest does not depend on a thread's bodies.
        own = fma(splat(watch.radius), sqrt(spins * spin), sqrt(fastest))
        lanes = bits(moving_lanes(watch.carried, blocks.alive[block], s))
        quickest = maximum(where(lanes, own, zero), quickest)
        way = add_ways(watch, state, blocks.alive[block], shift, s, way)
    speed, moved = 0.0, 0.0
    for i in range(LANES):
        speed = max(speed, lane(quickest, i))
        moved = max(moved, lane(way, i))
    return speed, moved


@compiled
def way_between(h: float, speed: float) -> float:
    """
    Return the path length [m] of a point in a step of `h` [s] with a largest stage speed `speed`.
    """
    return _BETWEEN * h * speed


@compiled
def judge_clear(watch: Watch, state: State, needed: float, moved: float) -> int:
    """
    Return NEAR_CONTACT, CLEAR or NO_ROOM if points may move by `needed` [m] from `state`.

    `moved`: square of the largest displacement [m^2] since the last search.
    """
    # Every search covers this distance.
    if not needed <= 0.5 * watch.limits[MAX_REACH]:
        return NEAR_CONTACT
    if watch.limits[FREE] - math.sqrt(moved) > needed:
        return CLEAR
    return search_clear(watch, state, needed)


@compiled
def search_clear(watch: Watch, state: State, needed: float) -> int:
    """
    Return CLEAR if all bodies can move by `needed` [m] from a `state` without contact.

    Else NEAR_CONTACT, or NO_ROOM if the list of pairs is too short.
    """
    nearby, limits = watch.nearby, watch.limits
    _, way = survey(nearby, state)
    most, skin = limits[MAX_REACH], limits[SKIN]
    if 2.0 * (way + most) > skin and refresh(
            nearby, state.position, skin) > nearby.pairs.shape[1]:
        return NO_ROOM
    return CLEAR if find_reach(nearby, state.position, 0.0, most) > needed else NEAR_CONTACT


@compiled
def mean_velocity(state: State, slots: np.ndarray) -> tuple[float, float, float]:
    """Return the mean velocity [m/s] of all bodies."""
    x, y, z = 0.0, 0.0, 0.0
    for b in range(slots.shape[0]):
        x += state.linear_velocity[0, slots[b]]
        y += state.linear_velocity[1, slots[b]]
        z += state.linear_velocity[2, slots[b]]
    part = 1.0 / max(slots.shape[0], 1)
    return x * part, y * part, z * part
