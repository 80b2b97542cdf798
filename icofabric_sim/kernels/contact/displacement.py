# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
How far bodies have moved since a look: what was apart by more than two ways is still apart.

Let two shells have a gap g along a unit vector n: n . x_B - n . x_A = h_A(n) + h_B(n) + g, with
the supports h. When a body moves by dx and turns by an angle theta, no point of its shell is
displaced by more than w = |dx| + 2 R sin(theta / 2), R the radius of the sphere around it, so the
interval that it covers along n moves by at most w at either end, and the gap along n stays at
least g - w_A - w_B. It is not lost before w_A + w_B = g, and so not while every way is at most
g / 2. The same holds for a plane and w_A alone.

A displacement that all bodies have in common brings no two closer. It may be any function of time
alone; taken is that of the mean velocity at the look and of gravity, where nothing is held.

For quaternions |q - q0| = 2 sin(theta / 4) >= sin(theta / 2) (of q and -q either will do: the
other is farther), for direction cosines the squares of all differences add up to
8 sin(theta / 2)^2. With (x + y)^2 <= 2 x^2 + 2 y^2 the square of a way is at most
2 |dx|^2 + 8 R^2 |q - q0|^2, or 2 |dx|^2 + R^2 |C - C0|^2: no root is drawn for any body.
"""

import math

from icofabric_sim.kernels.records import Blocks, State, Watch
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    lane,
    LANES,
    load,
    maximum,
    splat,
    Vector,
    where,
)
import numpy as np

Shift = tuple[float, float, float]
# Places among the limits of a watch. The squares of the displacements [m^2] that ask for a new
# search, and up to which nothing was missed; steps of one length after which they are checked.
SOON, LATE, STRIDE = 0, 1, 2
# Largest speed of a point of a body at the last look [m/s]; time [s] that a reach should last
# where something is near; the reach is at least and at most [m]; how far beyond spheres bodies of
# a list are apart [m].
SPEED, HORIZON, LEAST, MOST, SKIN = 3, 4, 5, 6, 7
# Most steps between two questions; 1 where kernels may look on their own, else 0.
MOST_STRIDE, OWN = 8, 9
# The displacement [m] up to which nothing can touch, also nothing that is listed.
FREE = 10
LIMIT_COUNT = 11
# Steps between two looks at the ways, times this, must not lead beyond the reach.
ROOM = 3.0
# Part of the reach that asks for a new search.
_SOON = 0.6


@compiled
def shift_at(watch: Watch | None, time: float) -> Shift:
    """What all bodies have moved by in common at `time` [s], in [m]."""
    if watch is None:
        return 0.0, 0.0, 0.0
    else:
        frame = watch.frame
        t = time - frame[0]
        return (
            t * (frame[1] + t * frame[4]), t * (frame[2] + t * frame[5]),
            t * (frame[3] + t * frame[6]))


@compiled
def add_ways(
    watch: Watch | None, state: State, alive: int, shift: Shift, s: int, most: Vector
) -> Vector:
    """The larger of `most` and the squares of the ways [m^2] of the bodies of a block."""
    if watch is None:
        return most
    else:
        zero = splat(0.0)
        way = zero
        for k in range(3):
            u = load(state.position, k, s) - load(watch.reference, k, s) - splat(shift[k])
            way = fma(u, u, way)
        turn = zero
        if state.orientation.ndim == 2:
            for k in range(4):
                u = load(state.orientation, k, s) - load(watch.turned, k, s)
                turn = fma(u, u, turn)
            turn = splat(8.0 * watch.radius * watch.radius) * turn
        else:
            for i in range(3):
                for k in range(3):
                    u = load(state.orientation[i], k, s) - load(watch.turned[i], k, s)
                    turn = fma(u, u, turn)
            turn = splat(watch.radius * watch.radius) * turn
        square = where(bits(alive), fma(splat(2.0), way, turn), zero)
        # What is not a number is found by the looks at the state.
        return maximum(square, most)


@compiled
def note_ways(watch: Watch | None, member: int, most: Vector) -> None:
    """Keep the largest square that a thread has seen."""
    if watch is not None:
        far = watch.far
        for i in range(LANES):
            far[8 * member] = max(far[8 * member], lane(most, i))


@compiled
def ways_of(
    watch: Watch | None, blocks: Blocks, state: State, time: float, member: int, first: int,
    last: int
) -> None:
    """Note the ways of blocks first to last at `time` [s]."""
    if watch is None:
        return
    shift = shift_at(watch, time)
    most = splat(0.0)
    for block in range(first, last):
        most = add_ways(watch, state, blocks.alive[block], shift, blocks.slot[block], most)
    note_ways(watch, member, most)


@compiled
def farthest(watch: Watch | None, size: int) -> float:
    """The largest square [m^2] that any of `size` threads has noted; forgets it."""
    if watch is None:
        return 0.0
    most = 0.0
    for member in range(size):
        most = max(most, watch.far[8 * member])
        watch.far[8 * member] = 0.0
    return most


@compiled
def forget_ways(watch: Watch | None, member: int) -> None:
    """A thread begins anew."""
    if watch is not None:
        watch.far[8 * member] = 0.0


@compiled
def set_reach(limits: np.ndarray, reach: float, listed: bool) -> None:
    """How far bodies may move [m] from now on; `listed`: something may touch before."""
    limits[SOON], limits[LATE] = (_SOON * reach) ** 2, reach * reach
    limits[FREE] = 0.0 if listed else reach


@compiled
def longest_step(limits: np.ndarray) -> float:
    """Longest step [s] in which no body moves too far."""
    if not limits[SPEED] > 0.0:
        return math.inf
    return math.sqrt(limits[LATE]) / (ROOM * limits[SPEED])


@compiled
def pace(limits: np.ndarray, step: float) -> None:
    """Set for a `step` [s] after how many of them the ways are asked for."""
    steps = limits[MOST_STRIDE]
    longest = longest_step(limits)
    if longest < math.inf and step > 0.0:
        steps = max(min(float(int(0.5 * longest / step)), steps), 1.0)
    limits[STRIDE] = steps


@compiled
def has_missed(watch: Watch | None, member: int) -> bool:
    """Whether a body of a thread was where contacts are not known."""
    if watch is None:
        return False
    return watch.far[8 * member] > watch.limits[LATE]
