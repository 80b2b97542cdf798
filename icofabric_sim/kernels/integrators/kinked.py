# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps of splitting methods that keep their order if the slopes of connectors jump.

The treatment of the kinks is described in kernels/kinks.py.
"""

from icofabric_sim.kernels.flows import (
    drift,
    keep_accelerations,
    place_all,
    push,
    push_kept,
)
from icofabric_sim.kernels.kinks import (
    account,
    choose_law,
    FAR_AWAY,
    foretell,
    forget_crossings,
    has_crossings,
    is_far,
    keep_state,
    keep_velocities,
    moved_of,
    note_margin,
    note_motion,
    note_reach,
    note_stretches,
    reach_of,
    stays_far,
    strike,
)
from icofabric_sim.kernels.records import Loads, Model, State, Team, Work
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import maximum, splat, Vector, where
from icofabric_sim.kernels.runtime.team import own_blocks, wait_for_all
from icofabric_sim.terms.contacts.displacement import add_ways, note_ways, shift_at
from icofabric_sim.terms.contacts.force import touch_all
from icofabric_sim.terms.contacts.record import Contacts, Watch
from icofabric_sim.terms.contacts.stiffness import note_pushes
from icofabric_sim.terms.links.kinks import Kinks
import numpy as np


@compiled
def kinked_steps(
    kinks: Kinks, kicks: np.ndarray, drifts: np.ndarray, model: Model, contacts: Contacts | None,
    loads: Loads | None, state: State, work: Work, team: Team, watch: Watch | None, origin: float,
    index: int, h: float, count: int
) -> None:
    """
    Take `count` steps of length `h` [s], the first from origin + index h on, as `steps` does.

    For methods that begin and end with a kick. If all connectors are far from their kinks, the
    steps are those of plain springs.
    """
    first, last = own_blocks(team, model.blocks.slot.shape[0])
    order, count_own = team.sweep.drifts, last - first
    # A literal would be a type of its own, and compile the drift once more.
    begin: int = np.int64(0)  # type: ignore[assignment]
    stages = drifts.shape[0]
    zero = splat(0.0)
    most = zero
    placed = False
    for step in range(index, index + count):
        now, end = origin + step * h, origin + (step + 1) * h
        for block in range(first, last):
            keep_velocities(kinks, state, model.blocks.slot[block])
        push_kept(model, loads, state, work, now, kicks[0] * h, first, last)
        reach, moved = zero, zero
        for block in range(first, last):
            s = model.blocks.slot[block]
            reach = maximum(reach, reach_of(kinks, model.links, state, h, kicks[0] * h, s))
            if kinks.margin[0] > 0.0:
                moved = maximum(moved, moved_of(kinks, model.links, state, s))
        note_reach(kinks, team.member, reach, moved)
        wait_for_all(team)
        far = stays_far(kinks, team.size)
        if not far:
            if not placed:
                place_all(model, state, work, first, last)
            for block in range(first, last):
                note_motion(
                    model.links, kinks, state, work.points, kicks[0] * h,
                    model.blocks.slot[block])
            wait_for_all(team)
            look(model, kinks, work, h, team.member, first, last)
            wait_for_all(team)
            far = is_far(kinks, team.size)
            if far:
                forget_crossings(kinks, first, last)
                for block in range(first, last):
                    keep_state(kinks, state, model.blocks.slot[block])
            else:
                strike_foretold(model, loads, kinks, state, work, kicks[0] * h, first, last)
            if team.member == 0:
                note_margin(kinks, team.size, far)
            wait_for_all(team)
        if team.member == 0:
            choose_law(kinks, far)
        placed = True
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
            if ends and not far:
                for block in range(first, last):
                    keep_velocities(kinks, state, model.blocks.slot[block])
            push(
                model, loads, state, work, kinks, part, after, kicks[stage + 1] * h, 0.0, ends,
                order, begin, count_own)
            if ends and not far:
                for block in range(first, last):
                    note_motion(
                        model.links, kinks, state, work.points, -kicks[stages] * h,
                        model.blocks.slot[block])
            wait_for_all(team)
            now = after
        if far:
            continue
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
            if team.member == 0:
                kinks.margin[2] += 1.0
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
    note_pushes(
        contacts, model.blocks, model.inverse_mass, model.inverse_inertia, first, last)
    wait_for_all(team)


@compiled
def look(
    model: Model, kinks: Kinks, work: Work, h: float, member: int, first: int, last: int
) -> None:
    """Predict crossings of blocks first to last, and store their distances from kinks."""
    nearest, lowest, highest = splat(FAR_AWAY), splat(FAR_AWAY), splat(-FAR_AWAY)
    for block in range(first, last):
        _, near, low, high = foretell(
            model.links, kinks, work.points, h, block, model.blocks.slot[block])
        nearest = where(near < nearest, near, nearest)
        lowest = where(low < lowest, low, lowest)
        highest = maximum(high, highest)
    note_stretches(kinks, member, nearest, lowest, highest)


@compiled
def strike_foretold(
    model: Model, loads: Loads | None, kinks: Kinks, state: State, work: Work, h: float,
    first: int, last: int
) -> None:
    """Apply the impulses of predicted crossings in the first kick of `h` [s]."""
    for block in range(first, last):
        if has_crossings(kinks, block):
            strike(model, loads, kinks, state, work, 0, h, block, model.blocks.slot[block])


@compiled
def note_own(
    watch: Watch | None, model: Model, state: State, time: float, first: int, last: int,
    most: Vector
) -> Vector:
    """
    Return the larger of `most` and squared displacements of blocks first to last at `time` [s].
    """
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
    """Apply the impulses that crossings still lack, for blocks first to last."""
    for block in range(first, last):
        strike(model, loads, kinks, state, work, row, 1.0, block, model.blocks.slot[block])
