# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Pairs that need no test, because bodies cannot have closed the gap since the last evaluation.

Two shells with a gap g are apart while the displacements of both add up to less than g
(displacement.py). The path is the sum over all evaluations of the largest displacement of any body
from one evaluation to the next. No displacement between two evaluations is longer than the
increase of the path in between, whether methods step forwards or back.

A step that is tried and rejected may lead far, to orientations that are no rotations. No point
moves farther than R |C1 - C2| for any matrices. Those of eq 16 from any quaternions differ by at
most (|q1| + |q2|) |q1 - q2| + | |q1|^2 - |q2|^2 |, as they turn v to q v q* - |q|^2 v + v.

A pair that is tested at a path w and has a gap g sleeps until w + g / 2, one of a shell and a
plane at rest until w + g. Separate pairs add nothing to forces, and the stored data of a pair
change no bit of its later forces. The results are therefore those of testing all pairs.

Lists cover the displacements until the next search, so most listed pairs sleep. If few pairs are
listed among many bodies, measuring displacements would take longer than testing the pairs.
"""

import math

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
from icofabric_sim.kernels.runtime.team import own_blocks, Team, wait_for_all
from icofabric_sim.terms.contacts.displacement import Shift
from icofabric_sim.terms.contacts.record import Sleep
import numpy as np

# Pairs that sleep only for the evaluation in which they were found apart, and pairs that touch or
# were never tested.
APART, AWAKE = 0.0, -1.0
# Longest path in radii before the path restarts from 0; relative spacing of numbers near 1.
_MAX_PATH_RATIO, _ROUNDING = 1e3, 2.0**-52
# Indices in Sleep.path: of all threads, and in the range of each thread.
_PATH, _FIRST, _SQUARE = 0, 2, 1


@compiled
def go_on(
    sleep: Sleep, position: np.ndarray, orientation: np.ndarray, team: Team
) -> float:
    """
    Add the displacement since the last evaluation to the path; return the path [m].

    Also a barrier. The path is infinite if no pair sleeps.
    """
    count = sleep.blocks.slot.shape[0]
    if count == 0:
        return math.inf
    first, last = own_blocks(team, count)
    # Shared numbers are read before the barrier, and written by one thread after it, because
    # evaluations by one thread may alternate with those by several.
    path = sleep.path
    before = path[_PATH]
    shift: Shift = (0.0, 0.0, 0.0)
    x, y, z = 0.0, 0.0, 0.0
    if sleep.free:
        # The displacement of any body serves as the common displacement.
        s = sleep.blocks.slot[0]
        x, y, z = position[0, s], position[1, s], position[2, s]
        shift = x - path[_FIRST], y - path[_FIRST + 1], z - path[_FIRST + 2]
    most = splat(0.0)
    for block in range(first, last):
        s = sleep.blocks.slot[block]
        square = way_of(sleep, position, orientation, shift, s)
        keep_place(sleep, position, orientation, s)
        # NaN, as after a trial step that diverged, counts as infinite.
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
    if way > _MAX_PATH_RATIO * sleep.radius:
        # Far from 0 the spacing of numbers is too large, as after a rejected step.
        wake_all(sleep.until, team)
        way = 0.0
    if team.member == 0:
        path[_PATH], path[_FIRST], path[_FIRST + 1], path[_FIRST + 2] = way, x, y, z
    return way


@compiled
def wake_all(until: np.ndarray, team: Team) -> None:
    """Wake all sleeping pairs, so that they are tested in this evaluation."""
    count = until.shape[0]
    for p in range(count * team.member // team.size, count * (team.member + 1) // team.size):
        until[p] = min(until[p], APART)
    wait_for_all(team)


@compiled
def path_to(sleep: Sleep, position: np.ndarray, orientation: np.ndarray) -> float:
    """
    Return the path [m] to the present positions, without adding it; infinite if no pair sleeps.

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
    """
    Return squared displacements [m^2] of a block since the last evaluation, less a `shift` [m].
    """
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
    """Store position and orientation of a block at this evaluation."""
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
    Return the path [m] until which a pair sleeps whose bodies may each still move by `room` [m].

    `before`: the earlier value. A pair that has just separated is evaluated once more, so that
    readers of the results see that it no longer touches.
    """
    return path + room if before >= APART else APART
