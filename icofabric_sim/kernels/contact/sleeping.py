# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Which pairs need no test: those whose gap bodies cannot have closed on their way since the last.

Two shells with a gap g are apart while the ways of both add up to less than g (displacement.py).
The path is the sum over all evaluations of the longest way of any body from one evaluation to the
next, so no way between two evaluations is longer than what was added to the path in between,
whether methods go on or back.

A step that is tried and refused may lead far, to orientations that are no rotations. No point
moves farther than R |C1 - C2| for any matrices. Those of eq 16 from any quaternions differ by at
most (|q1| + |q2|) |q1 - q2| + | |q1|^2 - |q2|^2 |, as they turn v to q v q* - |q|^2 v + v.

A pair that is tested at a path w and has a gap g sleeps until w + g / 2, one of a shell and a
plane until w + g. As what is apart adds nothing, and what was kept of a pair changes no bit of
what it adds later, the results are those of tests of all.

Lists reach as far as bodies come until the next search, so most of what is listed sleeps. Where
few pairs are listed among many bodies to follow these would take longer than to test those.
"""

import math

from icofabric_sim.kernels.contact.displacement import Shift
from icofabric_sim.kernels.records import Sleep, Team
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    lane,
    LANES,
    load,
    maximum,
    splat,
    store,
    Vector,
    where,
)
from icofabric_sim.kernels.runtime.team import own_blocks, wait_for_all
import numpy as np

# Pairs that sleep no longer than the one evaluation in which they were found apart, and those that
# touch or were never tested.
APART, AWAKE = 0.0, -1.0
# The path begins anew from so many radii on; numbers of 1 are this far apart.
_LONGEST, _ROUNDING = 1e3, 2.0**-52
# Places in Sleep.path: of all threads, and in the part of each.
_PATH, _FIRST, _SQUARE = 0, 2, 1


@compiled
def go_on(
    sleep: Sleep, position: np.ndarray, orientation: np.ndarray, team: Team
) -> float:
    """
    Add the way since the last evaluation to the path; returns the path [m]. Also a barrier.

    Where no pair sleeps it is infinite.
    """
    count = sleep.blocks.slot.shape[0]
    if count == 0:
        return math.inf
    first, last = own_blocks(team, count)
    # What all threads share is read before the barrier, and written by one after it: a thread
    # alone may evaluate in between what many do.
    path = sleep.path
    before = path[_PATH]
    shift: Shift = (0.0, 0.0, 0.0)
    x, y, z = 0.0, 0.0, 0.0
    if sleep.free:
        # The way of any body will do for what all have in common.
        s = sleep.blocks.slot[0]
        x, y, z = position[0, s], position[1, s], position[2, s]
        shift = x - path[_FIRST], y - path[_FIRST + 1], z - path[_FIRST + 2]
    most = splat(0.0)
    for block in range(first, last):
        s = sleep.blocks.slot[block]
        square = way_of(sleep, position, orientation, shift, s)
        keep_place(sleep, position, orientation, s)
        # What is no number, as where a step that was tried ran away, is farther than any way.
        square = where(square < splat(math.inf), square, splat(math.inf))
        most = maximum(where(bits(sleep.blocks.alive[block]), square, splat(0.0)), most)
    longest = 0.0
    for i in range(LANES):
        longest = max(longest, lane(most, i))
    path[8 * team.member + _SQUARE] = longest
    wait_for_all(team)
    for member in range(team.size):
        longest = max(longest, path[8 * member + _SQUARE])
    way = 0.0
    if before >= 0.0:
        # Rounded up.
        way = (before + math.sqrt(longest)) * (1.0 + _ROUNDING)
    if way > _LONGEST * sleep.radius:
        # So far from 0 numbers lie too far apart, as after a step that was tried and refused.
        wake_all(sleep.until, team)
        way = 0.0
    if team.member == 0:
        path[_PATH], path[_FIRST], path[_FIRST + 1], path[_FIRST + 2] = way, x, y, z
    return way


@compiled
def wake_all(until: np.ndarray, team: Team) -> None:
    """Have all pairs that sleep tested in this evaluation."""
    count = until.shape[0]
    for p in range(count * team.member // team.size, count * (team.member + 1) // team.size):
        until[p] = min(until[p], APART)
    wait_for_all(team)


@compiled
def path_to(sleep: Sleep, position: np.ndarray, orientation: np.ndarray) -> float:
    """
    Path [m] to where bodies are, which is not added; infinite where no pair sleeps.

    By one thread alone.
    """
    path, count = sleep.path, sleep.blocks.slot.shape[0]
    if count == 0 or path[_PATH] < 0.0:
        return math.inf
    shift: Shift = (0.0, 0.0, 0.0)
    if sleep.free:
        s = sleep.blocks.slot[0]
        shift = (
            position[0, s] - path[_FIRST], position[1, s] - path[_FIRST + 1],
            position[2, s] - path[_FIRST + 2])
    most = splat(0.0)
    for block in range(count):
        square = way_of(sleep, position, orientation, shift, sleep.blocks.slot[block])
        square = where(square < splat(math.inf), square, splat(math.inf))
        most = maximum(where(bits(sleep.blocks.alive[block]), square, splat(0.0)), most)
    longest = 0.0
    for i in range(LANES):
        longest = max(longest, lane(most, i))
    # Rounded up.
    return (path[_PATH] + math.sqrt(longest)) * (1.0 + _ROUNDING)


@compiled
def way_of(
    sleep: Sleep, position: np.ndarray, orientation: np.ndarray, shift: Shift, s: int
) -> Vector:
    """Squares of the ways [m^2] of a block since the last evaluation, beside a `shift` [m]."""
    way = splat(0.0)
    for k in range(3):
        u = load(position, k, s) - load(sleep.position, k, s) - splat(shift[k])
        way = fma(u, u, way)
    turn = splat(0.0)
    if orientation.ndim == 2:
        norm, before = splat(0.0), splat(0.0)
        for k in range(4):
            new, old = load(orientation, k, s), load(sleep.orientation, k, s)
            turn = fma(new - old, new - old, turn)
            norm, before = fma(new, new, norm), fma(old, old, before)
        # (x + y)^2 <= 17 x^2 / 16 + 17 y^2, and (|q1| + |q2|)^2 at most twice the squares of both.
        grown = norm - before
        turn = fma(splat(2.125) * (norm + before), turn, splat(17.0) * grown * grown)
    else:
        for i in range(3):
            for k in range(3):
                new, old = load(orientation[i], k, s), load(sleep.orientation[i], k, s)
                turn = fma(new - old, new - old, turn)
    # (x + y)^2 <= 2 x^2 + 2 y^2
    return splat(2.0) * fma(splat(sleep.radius * sleep.radius), turn, way)


@compiled
def keep_place(
    sleep: Sleep, position: np.ndarray, orientation: np.ndarray, s: int
) -> None:
    """Keep where a block is evaluated."""
    for k in range(3):
        store(sleep.position, k, s, load(position, k, s))
    if orientation.ndim == 2:
        for k in range(4):
            store(sleep.orientation, k, s, load(orientation, k, s))
    else:
        for i in range(3):
            for k in range(3):
                store(sleep.orientation[i], k, s, load(orientation[i], k, s))


@compiled
def sleeps_until(before: float, path: float, room: float) -> float:
    """
    Until which path [m] a pair sleeps whose bodies may still move by `room` [m], above 0, each.

    `before`: what was known of it. One that has just parted is looked at once more, so that those
    who read what was evaluated see that it no longer touches.
    """
    return path + room if before >= APART else APART
