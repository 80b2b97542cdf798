# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The embedded Runge-Kutta pair: steps of given length, or under error control; dense output.

Not symplectic, but valid also if forces depend on velocities, with an error estimate in every
step.
"""

from typing import Any

from icofabric_sim.kernels.breakage import is_breaking, note_lengths
from icofabric_sim.kernels.contact.clearance import CLEAR, find_clear, NEAR_CONTACT, NO_ROOM
from icofabric_sim.kernels.contact.displacement import farthest, forget_ways, has_missed, ways_of
from icofabric_sim.kernels.contact.forces import (
    deepest_overlap,
    has_touched,
    note_touch,
    set_tests,
    tests_of,
)
from icofabric_sim.kernels.contact.landing import foresee, land, NEVER_MEET, UNKNOWN
from icofabric_sim.kernels.contact.losses import (
    accept_stretches,
    combine_stretches,
    losses_of,
    repeat_stretches,
    save_stretches,
    stretch_error,
    touch_moving,
)
from icofabric_sim.kernels.contact.rebuild_check import can_look_farther, judge_ways, MISSED
from icofabric_sim.kernels.drives import place_row
from icofabric_sim.kernels.external import ask_outside
from icofabric_sim.kernels.integrators import dop853
from icofabric_sim.kernels.integrators.tableau import FIRST, Pair, pair_of, SECOND
from icofabric_sim.kernels.loads import keep_work
from icofabric_sim.kernels.meters import add_flow, repeat_flow
from icofabric_sim.kernels.monitor import (
    conclude,
    DEEPEST_LIMIT,
    note_own,
    save,
    SAVED_AT,
    TOO_DEEP,
    UNSOUND,
)
from icofabric_sim.kernels.probable_error import SMOOTH_RATIO
from icofabric_sim.kernels.records import Loads, Model, State, Team, Trail, Watch, Work
from icofabric_sim.kernels.rhs import (
    add_work,
    combine,
    find_slopes,
    interpolate,
    larger_of,
    LAST,
    normalise,
    path_error,
    place_blocks,
    step_error,
)
from icofabric_sim.kernels.rotations import rows_of
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import LANES, load, store
from icofabric_sim.kernels.runtime.team import own_blocks, tell_all, wait_for_all
import numpy as np

# Indices in the control array: start and length of the step in progress [s], the next length, the
# time that is to be passed [s], the tolerance [1/s], the sum of the probable errors of steps
# including the one in progress, its error rate [1/s], the number of rejected steps, the shortest
# step [s], 1 if slope 12 is that of the present state, the longest step [s], and the time [s] for
# which the tolerance of a shorter step counts: if forces jump, the error rate does not fall with
# the step.
(START, LENGTH, NEXT, GOAL, TOLERANCE, TOTAL, RATE, REFUSED, SHORTEST_STEP, HAS_LAST, LONGEST_STEP,
 SPARE) = range(12)
# A step at most this long [s] is accepted with any error: there may be a kink in the forces, for
# which no length meets the tolerance.
KINK = 12
# Error rate [1/s] of rounding in stiff contacts: a smaller tolerance cannot be met.
FLOOR = 13
# The time [s] when a contact begins or ends, for all threads, and the next length [s] after a step
# that ends then.
MEETING, RESUME = 14, 15
# Square [1/s^2] of the fastest motion if forces have kinks; 0: no kinks.
KINKED = 16
# The longest step [s] in which a contact is possible; the number of further steps that must be no
# longer, and the last value set for that number.
CLOSE, HELD, HOLD = 17, 18, 19
# Sum of the probable errors of steps without possible contacts; 1 if the last was such a step.
CLEAR_TOTAL, IS_CLEAR = 20, 21
# Evaluations of the forces, including those of rejected steps.
EVALUATIONS = 22
# Squared errors of position, orientation, velocity and spin are multiplied by these four.
SCALES = 23
CONTROL_COUNT = 27
# Target of the error as a fraction of the tolerance (a step is rejected above the tolerance);
# smallest and largest factor of the step length at once.
_AIM_RATIO, _SHRINK_RATIO, _GROW_RATIO = 0.4, 0.2, 4.0
# Number of shorter steps after a step that was rejected because of a possible contact, and its
# largest value if the next long step is rejected too.
_HOLD, _LONGEST_HOLD = 8.0, 64.0
TOO_SHORT, BREAKING, TOO_FAR, LIST_FULL = 64, 256, 8192, 16384
# No limit of a length [s], and no required accuracy, as for steps of a given length: as large as
# a checkpoint may hold.
ANY = 1e300
# Sentinel: a body left the region that the neighbour list covers.
_MISSED = 1e300

DOP8 = pair_of(dop853.TABLEAU)


@compiled
def some(trail: Trail | None) -> Trail:
    """Return the trail, which is not None."""
    return trail  # type: ignore[return-value]


@compiled
def slope_at(
    model: Model, loads: Loads, state: State, work: Work, trail: Trail, index: int,
    team: Team, watch: Watch | None, time: float, first: int, last: int
) -> None:
    """Write slope number `index` at a state and a `time` [s], for all bodies."""
    place_blocks(model, loads, state, work, time, first, last)
    ways_of(watch, model.blocks, state, time, team.member, first, last)
    wait_for_all(team)
    touch_moving(model.contacts, state, index, team)
    note_touch(loads.drives, model.contacts, index == SECOND, team.member)
    ask_outside(work.external, state, time, team)
    find_slopes(model, loads, state, work, time, trail.slopes[index], index, first, last)
    wait_for_all(team)


@compiled
def try_step(
    pair: Pair, model: Model, loads: Loads, state: State, work: Work, trail: Trail,
    team: Team, watch: Watch | None, time: float, h: float, first: int, last: int
) -> None:
    """
    Compute the other slopes of a step from `state` at `time` [s], whose own slope is in place.

    The end of the step goes into trail.stage.
    """
    for index in range(SECOND, pair.step.shape[0]):
        weights = pair.weights[index, :pair.lengths[index]]
        for block in range(first, last):
            combine(state, trail.slopes, weights, h, trail.stage, model.blocks.slot[block])
        combine_stretches(losses_of(model.contacts), weights, h, False, team)
        slope_at(
            model, loads, trail.stage, work, trail, index, team, watch,
            time + pair.nodes[index] * h, first, last)
    for block in range(first, last):
        s = model.blocks.slot[block]
        combine(state, trail.slopes, pair.step, h, trail.stage, s)
        normalise(trail.stage.orientation, s)
    combine_stretches(losses_of(model.contacts), pair.step, h, False, team)
    # Forces will be evaluated at the end too.
    ways_of(watch, model.blocks, trail.stage, time + h, team.member, first, last)


@compiled
def fixed_pair(
    pair: Pair, model: Model, loads: Loads, state: State, saved: State, work: Work,
    team: Team, origin: float, index: int, h: float, count: int, since_check: int,
    check_interval: int, watch: Watch | None, ledger: np.ndarray
) -> tuple[int, int, int]:
    """Take up to `count` steps of length `h` from origin + index h [s] on, as `splitting` does."""
    first, last = own_blocks(team, model.blocks.slot.shape[0])
    trail = some(work.trail)
    # The call before has ended with the same evaluation, which counts once.
    tests = tests_of(model.contacts, team.member)
    slope_at(model, loads, state, work, trail, FIRST, team, watch, origin + index * h, first, last)
    set_tests(model.contacts, team.member, tests)
    done = 0
    while done < count:
        try_step(
            pair, model, loads, state, work, trail, team, watch, origin + (index + done) * h, h,
            first, last)
        save(model, trail.stage, state, first, last)
        accept_stretches(losses_of(model.contacts), team)
        add_work(loads, h, pair.step, first, last)
        add_flow(work.spent, model.blocks.slot, h, pair.step, first, last)
        add_flow(work.given, model.blocks.slot, h, pair.step, first, last)
        done += 1
        slope_at(
            model, loads, state, work, trail, FIRST, team, watch, origin + (index + done) * h,
            first, last)
        since_check += 1
        status, since_check = look(
            model, loads, state, saved, work, team, since_check, check_interval, watch, ledger,
            done, origin + (index + done) * h, h, first, last)
        if status != 0:
            return status, done, since_check
    return 0, done, since_check


@compiled
def look(
    model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
    since_check: int, check_interval: int, watch: Watch | None, ledger: np.ndarray, done: int,
    time: float, step: float, first: int, last: int
) -> tuple[int, int]:
    """
    Check the state at `time` [s] if a health check is due, and save a sound state.

    Other steps of the length `step` [s] will follow; 0: of any length.

    Return the status and the steps since the last health check.
    """
    examined = since_check >= check_interval
    status = 0
    if examined:
        note_own(model, loads, state, work, team, time, ledger)
    if team.member == 0:
        if examined:
            status = conclude(model, state, work.figures, ledger)
        status |= judge_ways(watch, farthest(watch, team.size), state, time, step)
        if deepest_overlap(model.contacts, team.size) > ledger[DEEPEST_LIMIT]:
            status |= TOO_DEEP
    status = tell_all(team, status)
    if examined:
        since_check = 0
        if status & (UNSOUND | TOO_DEEP | MISSED) == 0:
            if team.member == 0:
                ledger[SAVED_AT] = done
            save(model, state, saved, first, last)
            save_stretches(losses_of(model.contacts), team)
    return status, since_check


@compiled
def largest_error(
    pair: Pair, model: Model, loads: Loads, trail: Trail, control: np.ndarray, turn_rows: int,
    team: Team, watch: Watch | None, h: float, first: int, last: int
) -> tuple[float, float]:
    """
    Return the error rate of a step of length `h` [s], the largest of all bodies; the probable one.

    Equal in all threads. Larger than any other if bodies left the region in which contacts are
    known.
    """
    largest, probable = 0.0, 0.0
    smooth = SMOOTH_RATIO * control[KINKED] * h * h if control[KINKED] > 0.0 else 1e300
    for block in range(first, last):
        error, error_of_step = step_error(
            trail.slopes, turn_rows, pair.higher_error, pair.lower_error, control[SCALES:], smooth,
            model.blocks.slot[block])
        largest = larger_of(largest, error)
        probable = max(probable, error_of_step)
    if has_touched(loads.drives, model.contacts, team.size):
        largest = larger_of(largest, path_error(
            loads.drives, model, loads, trail.slopes, turn_rows, pair.higher_error,
            pair.lower_error, control[SCALES + 2], first, last))
    error, error_of_step = stretch_error(
        losses_of(model.contacts), pair.higher_error, pair.lower_error, control[SCALES], smooth,
        team)
    largest = larger_of(largest, error)
    probable = max(probable, error_of_step)
    if has_missed(watch, team.member) and largest < _MISSED:
        largest = _MISSED
    trail.errors[team.member] = largest
    trail.probable[team.member] = probable
    wait_for_all(team)
    for member in range(team.size):
        largest = larger_of(largest, trail.errors[member])
        probable = max(probable, trail.probable[member])
    return pair.estimate_ratio * largest, pair.probable_ratio * probable


@compiled
def adaptive_pair(
    pair: Pair, model: Model, loads: Loads, state: State, saved: State, work: Work,
    team: Team, control: np.ndarray, count: int, since_check: int, check_interval: int,
    watch: Watch | None, ledger: np.ndarray
) -> tuple[int, int, int]:
    """
    Take up to `count` steps until one ends after control[GOAL].

    `state` is the end of the step in progress, trail.start its start; its slopes are kept for
    states in between. Time is control[START] + control[LENGTH] before and after. A step is
    rejected and shortened if its error exceeds tolerance x its length, or x control[SPARE]. If a
    contact begins or ends within the step, the shorter step ends just there, else steps are
    shortened until such a change hardly matters. A step no longer than control[CLOSE] is not tried
    if the change is predicted, but ends there at once. A longer step is rejected if a contact is
    possible within it. A step in which a connector may have broken is the last one, and its status
    is BREAKING.
    """
    first, last = own_blocks(team, model.blocks.slot.shape[0])
    trail = some(work.trail)
    turn_rows = rows_of(state.orientation).shape[0]
    has_last = control[HAS_LAST] != 0.0
    wait_for_all(team)
    start, length, h = control[START], control[LENGTH], control[NEXT]
    total, rate, refused = control[TOTAL], control[RATE], control[REFUSED]
    clear_total, is_clear = control[CLEAR_TOTAL], control[IS_CLEAR]
    goal, shortest = control[GOAL], control[SHORTEST_STEP]
    tolerance = max(control[TOLERANCE], control[FLOOR])
    longest, spare, kink = control[LONGEST_STEP], control[SPARE], control[KINK]
    close, held, hold = control[CLOSE], control[HELD], max(control[HOLD], _HOLD)
    meeting, resume = control[MEETING:MEETING + 1], control[RESUME]
    done, status, evaluations = 0, 0, 0
    note_lengths(model, work.breakage, state, work, team, first, last)
    while done < count and start + length <= goal and status == 0:
        tests = tests_of(model.contacts, team.member)
        if has_last:
            repeat_slope(model, loads, work, trail, first, last)
            repeat_stretches(losses_of(model.contacts), team)
        else:
            slope_at(
                model, loads, state, work, trail, FIRST, team, watch, start + length, first, last)
            evaluations += 1
        accepted = landing = False
        asked, asked_held, asked_hold, asked_refused = h, held, hold, refused
        if kink < h <= close and tolerance < ANY:
            meets = foresee(
                model.contacts, watch, model.blocks, state, trail, team, start + length, h,
                0.1 * kink, meeting, first, last)
            if meets == UNKNOWN:
                set_tests(model.contacts, team.member, tests)
                status = TOO_FAR
                break
            if meets < h:
                h, landing = max(meets, shortest), True
        while not accepted:
            forget_ways(watch, team.member)
            try_step(
                pair, model, loads, state, work, trail, team, watch, start + length, h, first,
                last)
            evaluations += pair.step.shape[0] - 1
            if pair.judges_end:
                slope_at(
                    model, loads, trail.stage, work, trail, LAST, team, watch, start + length + h,
                    first, last)
                evaluations += 1
            # Per unit of time, so the length of the step cancels.
            error, probable = largest_error(
                pair, model, loads, trail, control, turn_rows, team, watch, h, first, last)
            change = _SHRINK_RATIO
            if error <= tolerance or error * h <= tolerance * spare:
                accepted = True
                change = _GROW_RATIO
            if 0.0 < error and error < np.inf:
                ratio = (_AIM_RATIO * tolerance / error) ** pair.exponent
                change = min(change, max(_SHRINK_RATIO, ratio))
            elif not error <= tolerance:
                change = _SHRINK_RATIO
            finite = error < pair.estimate_ratio * _MISSED
            if not accepted and h <= kink and finite:
                accepted = True
                change = _GROW_RATIO
            clear = CLEAR
            if accepted and h > close:
                clear = find_clear(
                    watch, model.blocks, state, trail, pair.step.shape[0], team,
                    start + length, h, first, last)
                accepted = clear == CLEAR
            # Steps do not depend on the list: repeat the step after a search with a longer reach,
            # or with a longer list of pairs.
            unknown = not accepted and error == pair.estimate_ratio * _MISSED
            again = clear == NO_ROOM or (unknown and can_look_farther(watch, start + length))
            if accepted:
                held, is_clear = max(held - 1.0, 0.0), 0.0
                if h > close:
                    hold, is_clear = _HOLD, 1.0
                    clear_total += probable * h
                total += probable * h
                rate = probable
                save(model, state, trail.start, first, last)
                save(model, trail.stage, state, first, last)
                accept_stretches(losses_of(model.contacts), team)
                keep_work(loads, first, last)
                add_work(loads, h, pair.step, first, last)
                add_flow(work.spent, model.blocks.slot, h, pair.step, first, last)
                add_flow(work.given, model.blocks.slot, h, pair.step, first, last)
                start, length = start + length, h
            elif not again:
                refused += 1.0
                if h <= shortest:
                    status = TOO_SHORT
                    accepted = True
            shorter = NEVER_MEET
            if again:
                # All trials of this step are repeated; tested pairs and rejections count once.
                status, accepted, landing, change = TOO_FAR, True, False, 1.0
                h, held, hold, refused = asked, asked_held, asked_hold, asked_refused
                if clear == NO_ROOM:
                    status = LIST_FULL
                    set_tests(model.contacts, team.member, tests)
            elif clear == NEAR_CONTACT:
                held, hold = hold, min(2.0 * hold, _LONGEST_HOLD)
            elif unknown:
                change = 0.5
            elif not accepted and finite:
                shorter = land(
                    model.contacts, team, state, trail.slopes[0], h, 0.1 * kink, meeting)
            # If a step that should end there is rejected too, the prediction was too inaccurate.
            if shorter < (0.9 * h if landing else NEVER_MEET):
                h, landing = max(shorter, shortest), True
            else:
                h = min(max(h * change, shortest), longest)
            if held > 0.0:
                h = min(h, close)
        if landing and status == 0:
            h = min(max(h, resume), close if held > 0.0 else longest)
        if status != 0 and pair.judges_end:
            # The slope at the end of a refused step has replaced that of the present state.
            has_last = False
        if status == 0:
            if not pair.judges_end:
                slope_at(
                    model, loads, state, work, trail, LAST, team, watch, start + length, first,
                    last)
                evaluations += 1
            has_last = True
            done += 1
            since_check += 1
            if is_breaking(model, work.breakage, state, work, trail, team, length, first, last):
                # No health check for a step that will be rolled back.
                status = BREAKING
            else:
                status, since_check = look(
                    model, loads, state, saved, work, team, since_check, check_interval, watch,
                    ledger, done, start + length, 0.0, first, last)
    wait_for_all(team)
    if team.member == 0:
        control[START], control[LENGTH], control[NEXT] = start, length, h
        control[TOTAL], control[RATE], control[REFUSED] = total, rate, refused
        control[HAS_LAST] = 1.0 if has_last else 0.0
        control[CLEAR_TOTAL], control[IS_CLEAR] = clear_total, is_clear
        control[HELD], control[HOLD], control[MEETING] = held, hold, 0.0
        control[EVALUATIONS] += evaluations
    return status, done, since_check


@compiled
def repeat_slope(
    model: Model, loads: Loads, work: Work, trail: Trail, first: int, last: int
) -> None:
    """Copy the last slope of a step to the first of the next."""
    for block in range(first, last):
        s = model.blocks.slot[block]
        for k in range(trail.slopes.shape[1]):
            store(trail.slopes[0], k, s, load(trail.slopes[LAST], k, s))
    repeat_power(loads, first, last)
    repeat_flow(work.spent, model.blocks.slot, first, last)
    repeat_flow(work.given, model.blocks.slot, first, last)


@compiled
def repeat_power(loads: Loads, first: int, last: int) -> None:
    """Copy the last powers of loads in a step to the first of the next."""
    for m in range(LANES * loads.start[first], LANES * loads.start[last], LANES):
        store(loads.power, 0, m, load(loads.power, LAST, m))


@compiled
def prepare_dense(
    pair: Pair, model: Model, loads: Loads, work: Work, team: Team, trail: Trail,
    watch: Watch | None, time: float, h: float
) -> None:
    """Compute the slopes of `dense_state` for the step in progress, which begins at `time` [s]."""
    first, last = own_blocks(team, model.blocks.slot.shape[0])
    for index in pair.dense_slots:
        weights = pair.weights[index, :pair.lengths[index]]
        for block in range(first, last):
            combine(trail.start, trail.slopes, weights, h, trail.stage, model.blocks.slot[block])
        combine_stretches(losses_of(model.contacts), weights, h, True, team)
        slope_at(
            model, loads, trail.stage, work, trail, index, team, watch,
            time + pair.nodes[index] * h, first, last)


@compiled
def dense_state(
    pair: Pair, model: Model, loads: Loads, state: State, team: Team, trail: Trail,
    time: float, h: float, x: float, target: State
) -> None:
    """Write the state at the fraction `x` of the step in progress, which begins at `time` [s]."""
    first, last = own_blocks(team, model.blocks.slot.shape[0])
    for block in range(first, last):
        s = model.blocks.slot[block]
        interpolate(trail.start, state, trail.slopes, pair.dense, h, x, target, s)
        normalise(target.orientation, s)
        for m in range(loads.start[block], loads.start[block + 1]):
            place_row(loads.drives, loads, target, m, s, time + x * h)


def dense_sum(
    pair: Pair, rates: np.ndarray, before: Any, after: Any, h: float, x: float
) -> Any:
    """
    Integrate `rates` over the fraction `x` of a step of length `h`, as `dense_state` does.

    `rates`: its rates at the slopes, (16,) for one quantity, (16, m) for m of them; `before` and
    `after`: its values at the start and the end.
    """
    rise, first, last = after - before, h * rates[0], h * rates[LAST]
    total = 0.0 * rise
    for i in range(len(pair.dense) - 1, -1, -1):
        part = h * (pair.dense[i] @ rates[:pair.dense.shape[1]])
        total = (total + part) * (x if i % 2 == 1 else 1.0 - x)
    total = (total + (rise + rise - first - last)) * x
    total = (total + (first - rise)) * (1.0 - x)
    return before + (total + rise) * x
