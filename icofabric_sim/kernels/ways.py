# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
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

from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.lanes import (
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
from icofabric_sim.kernels.records import Blocks, State, Watch

Shift = tuple[float, float, float]


@compiled
def shift_at(watch: Watch | None, time: float) -> Shift:
    """
    What all bodies have moved by in common at `time` [s], in [m].
    """
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
    """
    The larger of `most` and the squares of the ways [m^2] of the bodies of a block.
    """
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
    """
    Keep the largest square that a thread has seen.
    """
    if watch is not None:
        far = watch.far
        for i in range(LANES):
            far[8 * member] = max(far[8 * member], lane(most, i))


@compiled
def ways_of(
    watch: Watch | None, blocks: Blocks, state: State, time: float, member: int, first: int,
    last: int
) -> None:
    """
    Note the ways of blocks first to last at `time` [s].
    """
    if watch is None:
        return
    shift = shift_at(watch, time)
    most = splat(0.0)
    for block in range(first, last):
        most = add_ways(watch, state, blocks.alive[block], shift, blocks.slot[block], most)
    note_ways(watch, member, most)


@compiled
def farthest(watch: Watch | None, size: int) -> float:
    """
    The largest square [m^2] that any of `size` threads has noted; forgets it.
    """
    if watch is None:
        return 0.0
    most = 0.0
    for member in range(size):
        most = max(most, watch.far[8 * member])
        watch.far[8 * member] = 0.0
    return most


@compiled
def forget_ways(watch: Watch | None, member: int) -> None:
    """
    A thread begins anew.
    """
    if watch is not None:
        watch.far[8 * member] = 0.0


@compiled
def has_missed(watch: Watch | None, member: int) -> bool:
    """
    Whether a body of a thread was where contacts are not known.
    """
    if watch is None:
        return False
    return watch.far[8 * member] > watch.late
