# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Displacements of bodies since a search: pairs with a gap above both displacements stay apart.

Let two shells have a gap g along a unit vector n: n . x_B - n . x_A = h_A(n) + h_B(n) + g, with
the supports h. When a body moves by dx and turns by an angle theta, no point of its shell is
displaced by more than w = |dx| + 2 R sin(theta / 2), R the radius of the sphere around it. The
interval that it covers along n moves by at most w at either end, and the gap along n stays at
least g - w_A - w_B. The gap is not lost before w_A + w_B = g, and so not while every displacement
is at most g / 2. The same holds for a plane that moves, and for one at rest with w_A alone.

A displacement that all bodies have in common brings no two closer. It may be any function of time
alone. If no body is held, the mean velocity at the search and gravity define it.

For quaternions |q - q0| = 2 sin(theta / 4) >= sin(theta / 2) (either sign of q is valid: the
other is farther), for direction cosines the squares of all differences add up to
8 sin(theta / 2)^2. With (x + y)^2 <= 2 x^2 + 2 y^2 the square of a displacement is at most
2 |dx|^2 + 8 R^2 |q - q0|^2, or 2 |dx|^2 + R^2 |C - C0|^2, so no roots are needed for bodies.
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
    Vector,
    where,
)
from icofabric_sim.terms.carriers import moving_lanes
from icofabric_sim.terms.contacts.record import Watch
from icofabric_sim.terms.shared import Blocks, State
import numpy as np

Shift = tuple[float, float, float]
# Indices in the limits of a watch. The squares of the displacements [m^2] that require a new
# search, and up to which no contact is missed; steps of one length between two checks.
SOON, LATE, STRIDE = 0, 1, 2
# Largest speed of a point of a body at the last search [m/s]; time [s] that a reach should last
# if pairs are near; least and largest reach [m]; largest distance [m] of the spheres of listed
# pairs.
SPEED, HORIZON, MIN_REACH, MAX_REACH, SKIN = 3, 4, 5, 6, 7
# Most steps between two checks; 1 if kernels may search without a return, else 0.
MOST_STRIDE, OWN = 8, 9
# The displacement [m] up to which no contact is possible, not even of listed pairs.
FREE = 10
LIMIT_COUNT = 11
# The displacement between two checks, times this factor, must not exceed the reach.
REACH_FACTOR = 3.0
# Fraction of the reach that requires a new search.
_SOON = 0.6


@compiled
def shift_at(watch: Watch | None, time: float) -> Shift:
    """Return the common displacement [m] of all bodies at `time` [s]."""
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
    """Return the larger of `most` and the squared displacements [m^2] of the bodies of a block."""
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
        lanes = bits(moving_lanes(watch.carried, alive, s))
        square = where(lanes, fma(splat(2.0), way, turn), zero)
        # NaN is found by the health checks.
        return maximum(square, most)


@compiled
def note_ways(watch: Watch | None, member: int, most: Vector) -> None:
    """Store the largest squared displacement of a thread."""
    if watch is not None:
        far = watch.far
        for i in range(LANES):
            far[8 * member] = max(far[8 * member], lane(most, i))


@compiled
def ways_of(
    watch: Watch | None, blocks: Blocks, state: State, time: float, member: int, first: int,
    last: int
) -> None:
    """Store the displacements of blocks first to last at `time` [s]."""
    if watch is None:
        return
    shift = shift_at(watch, time)
    most = splat(0.0)
    for block in range(first, last):
        most = add_ways(watch, state, blocks.alive[block], shift, blocks.slot[block], most)
    note_ways(watch, member, most)


@compiled
def farthest(watch: Watch | None, size: int) -> float:
    """Return the largest squared displacement [m^2] of `size` threads, and reset it."""
    if watch is None:
        return 0.0
    most = 0.0
    for member in range(size):
        most = max(most, watch.far[8 * member])
        watch.far[8 * member] = 0.0
    return most


@compiled
def forget_ways(watch: Watch | None, member: int) -> None:
    """Reset the largest squared displacement of a thread."""
    if watch is not None:
        watch.far[8 * member] = 0.0


@compiled
def set_reach(limits: np.ndarray, reach: float, listed: bool) -> None:
    """Set the distance [m] that bodies may move; `listed`: contacts are possible before."""
    limits[SOON], limits[LATE] = (_SOON * reach) ** 2, reach * reach
    limits[FREE] = 0.0 if listed else reach


@compiled
def longest_step(limits: np.ndarray) -> float:
    """Return the longest step [s] in which no body moves too far."""
    if not limits[SPEED] > 0.0:
        return math.inf
    return math.sqrt(limits[LATE]) / (REACH_FACTOR * limits[SPEED])


@compiled
def pace(limits: np.ndarray, step: float) -> None:
    """Set the number of steps between two checks of displacements, for a `step` [s]."""
    steps = limits[MOST_STRIDE]
    longest = longest_step(limits)
    if longest < math.inf and step > 0.0:
        steps = max(min(float(int(0.5 * longest / step)), steps), 1.0)
    limits[STRIDE] = steps


@compiled
def has_missed(watch: Watch | None, member: int) -> bool:
    """Check that a body of a thread was outside the region in which contacts are known."""
    if watch is None:
        return False
    return watch.far[8 * member] > watch.limits[LATE]
