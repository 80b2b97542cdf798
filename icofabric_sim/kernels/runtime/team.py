# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Threads that share the steps of one call: a barrier, a shared value, and batches of work.

Each thread computes its own run of blocks and waits for the others where it needs their results.
Threads of Numba's own are not used: they would have to be started for every stage.

A waiting thread polls a flag for a while, which costs least if every thread has a core. Then it
sleeps until the last thread wakes it (futex(2)). Yielding the processor by sched_yield(2) in place
of sleeping costs a time slice of other processes, milliseconds, at every barrier.
"""

import platform
import sys
from typing import Any

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.numba_private import cgutils
from icofabric_sim.kernels.runtime.record import Record
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
import numpy as np

# Untyped: intrinsics are called without their first argument.
_intrinsic: Any = intrinsic
# Indices in Team.flags, one cache line apart. From the last index on each thread has a line: the
# number of parts taken, then which of two shared values is used next.
_ARRIVED, _ROUND, _SHARED, _ASLEEP, _IN_VAIN, _TAKEN_PARTS = 0, 8, 16, 24, 32, 40
_TURN, _LINE = 1, 8
# A part taken from the back of a run adds this number to the count, one from the front adds 1.
_BEHIND = 2**32
# Blocks that are drifted and kicked together, so that they stay in the cache in between.
TILE = 64
# Polls of the flag before a thread sleeps: about 80 us, less than the time to wake a thread. After
# _ENOUGH fruitless waits, the next _PAUSE waits poll for 0.5 us.
_MAX_POLL_COUNT, _MIN_POLL_COUNT = 200_000, 1_000
_ENOUGH, _PAUSE = 8, 256
# Number of futex(2) among the system calls of Linux, by processor; 0: threads yield instead.
_FUTEX = {'x86_64': 202, 'aarch64': 98}.get(
    platform.machine(), 0) if sys.platform == 'linux' else 0
# Operations for threads of one process, and a count that is enough to wake all.
_FUTEX_WAIT, _FUTEX_WAKE, _ALL = 128, 129, 2**31 - 1


class Sweep(Record):
    """The order in which a thread visits its blocks, see traversal_order.py."""

    drifts: np.ndarray  # (b,) uint32, the thread's blocks in the order of drifts
    pushes: np.ndarray  # (b,) uint32, the same blocks in the order of kicks
    ahead: np.ndarray  # (t,) int32, number of drifted blocks before each tile is kicked
    border: int  # number of drifted blocks before other threads kick


class Team(Record):
    """Threads that share a call; each takes a run of blocks."""

    member: int
    size: int
    flags: np.ndarray  # int64, see above
    sweep: Sweep
    scratch: Any  # scratch arrays for contacts (terms/contacts/surface.py), or None


def flag_count(size: int) -> int:
    """Return the number of flags that a team of such a size needs."""
    return _TAKEN_PARTS + _LINE * size


def _address(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    array = context.make_array(sig.args[0])(context, builder, args[0])
    place = context.cast(builder, args[1], sig.args[1], types.intp)
    return builder.gep(array.data, [place])


@_intrinsic
def _fetch_add(typing: Any, array: Any, place: Any, value: Any) -> Any:
    """Add atomically and return the value before."""
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.atomic_rmw('add', _address(context, builder, sig, args), args[2], 'seq_cst')
    return types.int64(array, place, types.int64), generate


@_intrinsic
def _read(typing: Any, array: Any, place: Any) -> Any:
    """Read a flag that another thread may write."""
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load_atomic(_address(context, builder, sig, args), 'seq_cst', 8)
    return types.int64(array, place), generate


@_intrinsic
def _futex(typing: Any, array: Any, place: Any, operation: Any, value: Any) -> Any:
    """Call futex(2) on the lower half of a flag, without a time limit."""
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        long = ir.IntType(64)
        if not _FUTEX:
            function = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(ir.IntType(32), []), 'sched_yield')
            return builder.sext(builder.call(function, []), long)
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(long, [long] * 7), 'syscall')
        address = builder.ptrtoint(_address(context, builder, sig, args), long)
        nothing = ir.Constant(long, 0)
        return builder.call(function, [
            ir.Constant(long, _FUTEX), address, args[2], args[3], nothing, nothing, nothing])
    return types.int64(array, place, types.int64, types.int64), generate


@compiled
def own_blocks(team: Team, block_count: int) -> tuple[int, int]:
    """Return the first block of this thread, and the one after its last."""
    return (
        block_count * team.member // team.size,
        block_count * (team.member + 1) // team.size,
    )


@compiled
def wait_for_all(team: Team) -> None:
    """Wait until every thread of the team has called this function."""
    if team.size > 1:
        _wait(team.flags, team.size)


@compiled
def _wait(flags: np.ndarray, count: int) -> None:
    present: int = _read(flags, _ROUND)
    if _fetch_add(flags, _ARRIVED, 1) == count - 1:
        _fetch_add(flags, _ARRIVED, -count)
        _fetch_add(flags, _ROUND, 1)
        # A thread that is about to sleep adds 1 to the flag _ASLEEP before the system compares the
        # round with `present`.
        if _read(flags, _ASLEEP) > 0:
            _futex(flags, _ROUND, _FUTEX_WAKE, _ALL)
        return
    # If other processes compute, some threads may wait for a core, which polling would occupy.
    in_vain = flags[_IN_VAIN]
    for _ in range(_MAX_POLL_COUNT if in_vain < _ENOUGH else _MIN_POLL_COUNT):
        if _read(flags, _ROUND) != present:
            flags[_IN_VAIN] = max(in_vain - 1, 0)
            return
    flags[_IN_VAIN] = in_vain + 1 if in_vain < _ENOUGH - 1 else (
        _ENOUGH + _PAUSE if in_vain < _ENOUGH else in_vain - 1)
    _fetch_add(flags, _ASLEEP, 1)
    while _read(flags, _ROUND) == present:
        _futex(flags, _ROUND, _FUTEX_WAIT, present & 0xffffffff)
    _fetch_add(flags, _ASLEEP, -1)


@compiled
def take_part(flags: np.ndarray, member: int, size: int, parts: int, before: int) -> int:
    """
    Take the next part of some work; return its number, -1 if all are taken.

    Each thread first takes parts of the run of blocks that belongs to it, from the front. Then it
    takes the remaining parts of the other runs from behind, so the caches of a core are mostly
    reused. `before`: the part that this thread took last, -1 at first. After the barrier at the
    end of the work each thread calls `end_parts`; another barrier separates `end_parts` from the
    next work.
    """
    if size == 1:
        return before + 1 if before + 1 < parts else -1
    for turn in range(size):
        owner = (member + turn) % size
        first, last = parts * owner // size, parts * (owner + 1) // size
        place = _TAKEN_PARTS + _LINE * owner
        if _left(_read(flags, place), last - first):
            # Both ends are in one number, so that each part is given once.
            taken: int = _fetch_add(flags, place, 1 if turn == 0 else _BEHIND)
            if _left(taken, last - first):
                return first + taken % _BEHIND if turn == 0 else last - 1 - taken // _BEHIND
    return -1


@compiled
def _left(taken: int, parts: int) -> bool:
    """Check that a part of a run is left."""
    return taken % _BEHIND + taken // _BEHIND < parts


@compiled
def end_parts(team: Team) -> None:
    """Reset the count of parts taken from this thread's run."""
    if team.size > 1:
        team.flags[_TAKEN_PARTS + _LINE * team.member] = 0


@compiled
def tell_all(team: Team, value: int) -> int:
    """Return the value of the first thread in all threads; also a barrier."""
    if team.size > 1:
        # Two flags in turn: one is written again only after all threads have read the other.
        turn = _TAKEN_PARTS + _LINE * team.member + _TURN
        place = _SHARED + team.flags[turn]
        team.flags[turn] = 1 - team.flags[turn]
        if team.member == 0:
            team.flags[place] = value
        _wait(team.flags, team.size)
        value = team.flags[place]
    return value
