# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Threads that share the steps of one call: a barrier, and a value that all see.

Each thread computes its own run of blocks and waits for the others where it needs their results.
Threads of Numba's own are not used: they would have to be started for every stage.
"""

from typing import Any

from icofabric_sim.kernels.records import Team
from icofabric_sim.kernels.runtime.compiled import compiled
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
import numpy as np

# Untyped: intrinsics are called without their first argument.
_intrinsic: Any = intrinsic
# Places in Team.flags, one cache line apart.
_ARRIVED, _ROUND, _SHARED = 0, 8, 16
FLAG_COUNT = 24
# Blocks that are drifted and pushed in one go: they stay in the cache in between.
TILE = 64
# Looks at the flag before the processor is offered to others.
_PATIENCE = 4000


def _address(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    array = context.make_array(sig.args[0])(context, builder, args[0])
    place = context.cast(builder, args[1], sig.args[1], types.intp)
    return builder.gep(array.data, [place])


@_intrinsic
def _fetch_add(typing: Any, array: Any, place: Any, value: Any) -> Any:
    """Add at once, return what was there."""
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.atomic_rmw('add', _address(context, builder, sig, args), args[2], 'seq_cst')
    return types.int64(array, place, types.int64), generate


@_intrinsic
def _read(typing: Any, array: Any, place: Any) -> Any:
    """Read what another thread may write."""
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load_atomic(_address(context, builder, sig, args), 'seq_cst', 8)
    return types.int64(array, place), generate


@_intrinsic
def _offer_processor(typing: Any) -> Any:
    """Let another thread run, sched_yield(2)."""
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(ir.IntType(32), []), 'sched_yield')
        return builder.call(function, [])
    return types.int32(), generate


@compiled
def own_blocks(team: Team, block_count: int) -> tuple[int, int]:
    """First block of this thread, and the one after its last."""
    return (
        block_count * team.member // team.size,
        block_count * (team.member + 1) // team.size,
    )


@compiled
def wait_for_all(team: Team) -> None:
    """Go on once every thread of the team has come here."""
    if team.size > 1:
        _wait(team.flags, team.size)


@compiled
def _wait(flags: np.ndarray, count: int) -> None:
    present: int = _read(flags, _ROUND)
    if _fetch_add(flags, _ARRIVED, 1) == count - 1:
        _fetch_add(flags, _ARRIVED, -count)
        _fetch_add(flags, _ROUND, 1)
    else:
        looks = 0
        while _read(flags, _ROUND) == present:
            looks += 1
            if looks > _PATIENCE:
                _offer_processor()


@compiled
def tell_all(team: Team, value: int) -> int:
    """What the first thread says, to all; also a barrier."""
    if team.size > 1:
        if team.member == 0:
            team.flags[_SHARED] = value
        _wait(team.flags, team.size)
        value = team.flags[_SHARED]
        _wait(team.flags, team.size)
    return value
