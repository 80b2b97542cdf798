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
Steps of splitting methods that keep their order where the slopes of connectors jump.

What is done about the kinks: kernels/kinks.py.
"""

from icofabric_sim.kernels.contact.displacement import add_ways, note_ways, shift_at
from icofabric_sim.kernels.contact.forces import touch_all
from icofabric_sim.kernels.flows import (
    drift,
    keep_accelerations,
    place_all,
    push,
    push_kept,
)
from icofabric_sim.kernels.kinks import account, foretell, keep_velocities, note_motion, strike
from icofabric_sim.kernels.records import (
    Contacts,
    Kinks,
    Loads,
    Model,
    State,
    Team,
    Watch,
    Work,
)
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import splat, Vector
from icofabric_sim.kernels.runtime.team import own_blocks, wait_for_all
import numpy as np


@compiled
def kinked_steps(
    kinks: Kinks, kicks: np.ndarray, drifts: np.ndarray, model: Model, contacts: Contacts | None,
    loads: Loads | None, state: State, work: Work, team: Team, watch: Watch | None, origin: float,
    index: int, h: float, count: int
) -> None:
    """
    Take `count` steps of length `h` [s], the first from origin + index h on, as `steps` does.

    For methods that begin and end with a kick.
    """
    first, last = own_blocks(team, model.blocks.slot.shape[0])
    order, count_own = team.sweep.drifts, last - first
    # A literal would be a type of its own, and compile the drift once more.
    begin: int = np.int64(0)  # type: ignore[assignment]
    stages = drifts.shape[0]
    most = splat(0.0)
    place_all(model, state, work, first, last)
    for step in range(index, index + count):
        now, end = origin + step * h, origin + (step + 1) * h
        for block in range(first, last):
            keep_velocities(kinks, state, model.blocks.slot[block])
        push_kept(model, loads, state, work, now, kicks[0] * h, first, last)
        for block in range(first, last):
            note_motion(
                model.links, kinks, state, work.points, kicks[0] * h, model.blocks.slot[block])
        wait_for_all(team)
        found = False
        for block in range(first, last):
            s = model.blocks.slot[block]
            if foretell(model.links, kinks, work.points, h, block, s):
                found = True
                strike(model, loads, kinks, state, work, 0, kicks[0] * h, block, s)
        wait_for_all(team)
        part = 0.0
        for stage in range(stages):
            whole = drifts[stage] * h
            after = end if stage + 1 == stages else now + whole
            part += drifts[stage]
            drift(model, loads, state, work, now, whole, order, begin, count_own)
            wait_for_all(team)
            if contacts is not None:
                touch_all(contacts, state.position, state.orientation, team)
            most = note_own(watch, model, state, after, first, last, most)
            ends = stage + 1 == stages
            if ends:
                for block in range(first, last):
                    keep_velocities(kinks, state, model.blocks.slot[block])
            push(
                model, loads, state, work, kinks, part, after, kicks[stage + 1] * h, 0.0, ends,
                order, begin, count_own)
            if ends:
                for block in range(first, last):
                    note_motion(
                        model.links, kinks, state, work.points, -kicks[stages] * h,
                        model.blocks.slot[block])
            wait_for_all(team)
            now = after
        found = False
        for block in range(first, last):
            if account(
                    model.links, kinks, work.points, h, block, model.blocks.slot[block]):
                found = True
        kinks.found[8 * team.member] = found
        wait_for_all(team)
        found = False
        for member in range(team.size):
            found = found or kinks.found[8 * member]
        if found:
            back = -0.5 * h
            drift(model, loads, state, work, end, back, order, begin, count_own)
            wait_for_all(team)
            strike_own(model, loads, kinks, state, work, 12, first, last)
            wait_for_all(team)
            drift(model, loads, state, work, end + back, -back, order, begin, count_own)
            wait_for_all(team)
            strike_own(model, loads, kinks, state, work, 0, first, last)
            if contacts is not None:
                touch_all(contacts, state.position, state.orientation, team)
            most = note_own(watch, model, state, end, first, last, most)
            keep_accelerations(model, state, work, end, first, last)
            wait_for_all(team)
    note_ways(watch, team.member, most)
    wait_for_all(team)


@compiled
def note_own(
    watch: Watch | None, model: Model, state: State, time: float, first: int, last: int,
    most: Vector
) -> Vector:
    """The ways of blocks first to last until `time` [s], where forces are evaluated."""
    if watch is not None:
        shift = shift_at(watch, time)
        for block in range(first, last):
            most = add_ways(
                watch, state, model.blocks.alive[block], shift, model.blocks.slot[block], most)
    return most


@compiled
def strike_own(
    model: Model, loads: Loads | None, kinks: Kinks, state: State, work: Work, row: int,
    first: int, last: int
) -> None:
    """What crossings still lack, for blocks first to last."""
    for block in range(first, last):
        strike(model, loads, kinks, state, work, row, 1.0, block, model.blocks.slot[block])
