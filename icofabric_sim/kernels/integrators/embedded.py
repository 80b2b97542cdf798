# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The embedded Runge-Kutta pair: steps of given length, or under error control; dense output.

Not symplectic, but valid also if forces depend on velocities, with an error estimate in every
step.
"""

from typing import Any

from icofabric_sim.kernels.integrators import dop853
from icofabric_sim.kernels.integrators.bodies import (
    accept_step,
    begin,
    Bodies,
    can_search_farther,
    check_clear,
    check_health,
    combine_dense,
    count_tests,
    find_slope,
    finish,
    foresee_contact,
    land_on_contact,
    largest_error,
    LEFT_REGION,
    may_break,
    repeat_count,
    repeat_slope,
    try_step,
)
from icofabric_sim.kernels.integrators.tableau import FIRST, Pair, pair_of
from icofabric_sim.kernels.loads import place_row
from icofabric_sim.kernels.probable_error import SMOOTH_RATIO
from icofabric_sim.kernels.records import Loads, Model, State, Team, Trail
from icofabric_sim.kernels.rhs import interpolate, LAST, normalise
from icofabric_sim.kernels.runtime.compiled import asked, compiled
from icofabric_sim.kernels.runtime.team import own_blocks
from icofabric_sim.terms.contacts.clearance import CLEAR, NEAR_CONTACT, NO_ROOM
from icofabric_sim.terms.contacts.landing import NEVER_MEET, UNKNOWN
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

DOP8 = pair_of(dop853.TABLEAU)


@asked
def fixed_pair(
    bodies: Bodies, pair: Pair, origin: float, index: int, h: float, count: int,
    since_check: int, check_interval: int, ledger: np.ndarray
) -> tuple[int, int, int]:
    """Take up to `count` steps of length `h` from origin + index h [s] on, as `splitting` does."""
    # The call before has ended with the same evaluation, which counts once.
    tests = count_tests(bodies)
    find_slope(bodies, FIRST, False, origin + index * h)
    repeat_count(bodies, tests)
    done = 0
    while done < count:
        try_step(bodies, pair, origin + (index + done) * h, h, False)
        accept_step(bodies, pair, h, False)
        done += 1
        find_slope(bodies, FIRST, False, origin + (index + done) * h)
        since_check += 1
        status, since_check = check_health(
            bodies, since_check, check_interval, ledger, done, origin + (index + done) * h, h)
        if status != 0:
            return status, done, since_check
    return 0, done, since_check


@asked
def adaptive_pair(
    bodies: Bodies, pair: Pair, control: np.ndarray, count: int, since_check: int,
    check_interval: int, ledger: np.ndarray
) -> tuple[int, int, int]:
    """
    Take up to `count` steps until one ends after control[GOAL].

    The state is the end of the step in progress, trail.start its start; its slopes are kept for
    states in between. Time is control[START] + control[LENGTH] before and after. A step is
    rejected and shortened if its error exceeds tolerance x its length, or x control[SPARE]. If a
    contact begins or ends within the step, the shorter step ends just there, else steps are
    shortened until such a change hardly matters. A step no longer than control[CLOSE] is not tried
    if the change is predicted, but ends there at once. A longer step is rejected if a contact is
    possible within it. A step in which a connector may have broken is the last one, and its status
    is BREAKING.
    """
    begin(bodies)
    has_last = control[HAS_LAST] != 0.0
    start, length, h = control[START], control[LENGTH], control[NEXT]
    total, rate, refused = control[TOTAL], control[RATE], control[REFUSED]
    clear_total, is_clear = control[CLEAR_TOTAL], control[IS_CLEAR]
    goal, shortest = control[GOAL], control[SHORTEST_STEP]
    tolerance = max(control[TOLERANCE], control[FLOOR])
    longest, spare, kink = control[LONGEST_STEP], control[SPARE], control[KINK]
    close, held, hold = control[CLOSE], control[HELD], max(control[HOLD], _HOLD)
    meeting, resume = control[MEETING:MEETING + 1], control[RESUME]
    done, status, evaluations = 0, 0, 0
    scales = control[SCALES:]
    while done < count and start + length <= goal and status == 0:
        tests = count_tests(bodies)
        if has_last:
            repeat_slope(bodies)
        else:
            find_slope(bodies, FIRST, False, start + length)
            evaluations += 1
        accepted = landing = False
        asked, asked_held, asked_hold, asked_refused = h, held, hold, refused
        if kink < h <= close and tolerance < ANY:
            meets = foresee_contact(bodies, start + length, h, 0.1 * kink, meeting)
            if meets == UNKNOWN:
                repeat_count(bodies, tests)
                status = TOO_FAR
                break
            if meets < h:
                h, landing = max(meets, shortest), True
        while not accepted:
            try_step(bodies, pair, start + length, h, True)
            evaluations += pair.step.shape[0] - 1
            if pair.judges_end:
                find_slope(bodies, LAST, True, start + length + h)
                evaluations += 1
            # Per unit of time, so the length of the step cancels.
            smooth = SMOOTH_RATIO * control[KINKED] * h * h if control[KINKED] > 0.0 else 1e300
            error, probable = largest_error(bodies, pair, scales, smooth, h)
            change = _SHRINK_RATIO
            if error <= tolerance or error * h <= tolerance * spare:
                accepted = True
                change = _GROW_RATIO
            if 0.0 < error and error < np.inf:
                ratio = (_AIM_RATIO * tolerance / error) ** pair.exponent
                change = min(change, max(_SHRINK_RATIO, ratio))
            elif not error <= tolerance:
                change = _SHRINK_RATIO
            finite = error < pair.estimate_ratio * LEFT_REGION
            if not accepted and h <= kink and finite:
                accepted = True
                change = _GROW_RATIO
            clear = CLEAR
            if accepted and h > close:
                clear = check_clear(bodies, pair, start + length, h)
                accepted = clear == CLEAR
            # Steps do not depend on the list: repeat the step after a search with a longer reach,
            # or with a longer list of pairs.
            unknown = not accepted and error == pair.estimate_ratio * LEFT_REGION
            again = clear == NO_ROOM or (unknown and can_search_farther(bodies, start + length))
            if accepted:
                held, is_clear = max(held - 1.0, 0.0), 0.0
                if h > close:
                    hold, is_clear = _HOLD, 1.0
                    clear_total += probable * h
                total += probable * h
                rate = probable
                accept_step(bodies, pair, h, True)
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
                    repeat_count(bodies, tests)
            elif clear == NEAR_CONTACT:
                held, hold = hold, min(2.0 * hold, _LONGEST_HOLD)
            elif unknown:
                change = 0.5
            elif not accepted and finite:
                shorter = land_on_contact(bodies, h, 0.1 * kink, meeting)
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
                find_slope(bodies, LAST, False, start + length)
                evaluations += 1
            has_last = True
            done += 1
            since_check += 1
            if may_break(bodies, length):
                # No health check for a step that will be rolled back.
                status = BREAKING
            else:
                status, since_check = check_health(
                    bodies, since_check, check_interval, ledger, done, start + length, 0.0)
    if finish(bodies):
        control[START], control[LENGTH], control[NEXT] = start, length, h
        control[TOTAL], control[RATE], control[REFUSED] = total, rate, refused
        control[HAS_LAST] = 1.0 if has_last else 0.0
        control[CLEAR_TOTAL], control[IS_CLEAR] = clear_total, is_clear
        control[HELD], control[HOLD], control[MEETING] = held, hold, 0.0
        control[EVALUATIONS] += evaluations
    return status, done, since_check


@compiled
def prepare_dense(bodies: Bodies, pair: Pair, time: float, h: float) -> None:
    """Compute the slopes of `dense_state` for the step in progress, which begins at `time` [s]."""
    for index in pair.dense_slots:
        combine_dense(bodies, pair.weights[index, :pair.lengths[index]], h)
        find_slope(bodies, index, True, time + pair.nodes[index] * h)


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
            place_row(loads, target, m, s, time + x * h)


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
