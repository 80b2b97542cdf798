# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
What the step control of explicit methods asks of the bodies.

The control in embedded.py and splitting.py is one kernel for all scenes: it sees the first fields
of a model and of its loads, which all scenes have. The functions that read the terms of a scene
are kernels of their own, compiled for these terms and called by address, once for all blocks of a
thread.

Bodies may also be elsewhere, with ranks or a GPU. The control then runs in Python, and calls the
methods of these names of an object that stands for the bodies.
"""

from typing import Any
from weakref import finalize

from icofabric_sim.kernels.breakage import is_breaking, note_lengths
from icofabric_sim.kernels.figures import note_figures
from icofabric_sim.kernels.integrators.sweep import kernel_of, Splitting
from icofabric_sim.kernels.integrators.tableau import LAST, Pair, SECOND
from icofabric_sim.kernels.loads import keep_work
from icofabric_sim.kernels.monitor import (
    add_contacts,
    coarse_up_to,
    conclude,
    DEEPEST_LIMIT,
    forget_contacts,
    looks_inside,
    save,
    SAVED_AT,
    TOO_DEEP,
    UNSOUND,
)
from icofabric_sim.kernels.records import Loads, Model, State, Team, Trail, Work
from icofabric_sim.kernels.rhs import (
    add_work,
    combine,
    find_slopes,
    larger_of,
    normalise,
    path_error,
    place_blocks,
    step_error,
)
from icofabric_sim.kernels.rotations import rows_of
from icofabric_sim.kernels.runtime.compiled import asked, compiled, compiled_for
from icofabric_sim.kernels.runtime.lanes import LANES, load, store
from icofabric_sim.kernels.runtime.outlined import address_of, call_float, call_int, call_none
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.kernels.runtime.team import own_blocks, tell_all, wait_for_all
from icofabric_sim.terms.body_force.external_force import ask_outside
from icofabric_sim.terms.contacts.clearance import find_clear
from icofabric_sim.terms.contacts.displacement import farthest, forget_ways, has_missed, ways_of
from icofabric_sim.terms.contacts.force import (
    deepest_overlap,
    has_touched,
    note_touch,
    set_tests,
    tests_of,
)
from icofabric_sim.terms.contacts.landing import foresee, land
from icofabric_sim.terms.contacts.losses import (
    accept_stretches,
    combine_stretches,
    losses_of,
    repeat_stretches,
    save_stretches,
    stretch_error,
    touch_moving,
)
from icofabric_sim.terms.contacts.rebuild_check import can_look_farther, judge_ways, MISSED
from icofabric_sim.terms.contacts.record import Contacts, Watch
from icofabric_sim.terms.meters import add_flow, repeat_flow
import numpy as np

# Sentinel: a body left the region that the neighbour list covers.
LEFT_REGION = 1e300


class Bodies(Record):
    """The bodies of a scene for one thread, and addresses of the kernels for their terms."""

    model: Any  # the first fields of a Model
    contacts: Contacts | None
    loads: Any  # the first fields of Loads
    state: State
    saved: State
    work: Any  # the first fields of Work
    trail: Any  # a Trail for embedded pairs, else None
    team: Team
    watch: Watch | None
    # Addresses; 0: the method or the scene has no such term.
    steps: int
    slopes: int
    figures: int
    verdict: int
    contact_figures: int
    error_of_paths: int
    lengths: int
    breaking: int


# Addresses in `Bodies` by the types of the records that the kernels take, and whether any loads.
_known: dict[Any, tuple[int, ...]] = {}
# The last bodies of each thread, and the records that they were made of, as long as the work
# arrays exist. The bodies do not keep those.
_made: dict[int, dict[int, tuple[tuple[Any, ...], Bodies]]] = {}
# Threads whose bodies are kept.
_MAX_THREAD_COUNT = 256


def bodies_of(
    model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
    watch: Watch | None, *, is_called: bool = True
) -> Bodies:
    """
    Return the bodies of a scene; compile or load the kernels for its terms if necessary.

    Unless a kernel `is_called` with them: for their type alone no kernels are needed.
    """
    given = model, loads, state, saved, team, watch
    kept = _made_with(work) if is_called else {}
    if id(team) in kept:
        before, bodies = kept[id(team)]
        if all(one is other for one, other in zip(before, given)):
            return bodies
    kinds = (*map(type, (model, loads, state, work, team, watch)), len(loads.wrench) > 0)
    if is_called and kinds not in _known:
        _known[kinds] = tuple(
            address_of(*call) if call else 0
            for call in calls_of(model, loads, state, work, team, watch))
    bodies = Bodies(
        model.common(), model.contacts, loads.common(), state, saved, work.common(), work.trail,
        team, watch, *(_known[kinds] if is_called else 8 * (0,)))
    if len(kept) >= _MAX_THREAD_COUNT:
        kept.clear()
    kept[id(team)] = given, bodies
    return bodies


def _made_with(work: Work) -> dict[int, tuple[tuple[Any, ...], Bodies]]:
    key = id(work)
    if key not in _made:
        _made[key] = {}
        finalize(work, _made.pop, key, None).atexit = False
    return _made[key]


def calls_of(
    model: Model, loads: Loads, state: State, work: Work, team: Team, watch: Watch | None
) -> list[tuple[Any, ...]]:
    """
    Return the kernels of `Bodies` with arguments of their types; empty where there is no term.
    """
    trail, numbers = work.trail, np.zeros(1)
    checks = [
        (note_figures, model, loads, state, work, 0.0, 0.0, False, 0, 0, 0),
        (conclude, work.figures, numbers),
        () if model.contacts is None else (
            add_contacts, model.contacts, state.position, state.orientation, numbers)]
    if trail is None:
        method = Splitting(numbers, numbers)
        steps = (
            kernel_of(loads, work), method, model, loads, state, work, team, watch, 0.0, 0, 0.0, 0)
        return [steps, (), *checks, (), (), ()]
    drives, breaks = loads.drives is not None, work.breakage is not None
    return [
        (), (slope_at, model, loads, state, work, trail, 0, team, watch, 0.0, 0, 0), *checks,
        (paths_error, model, loads, trail, numbers, numbers, 0.0, team) if drives else (),
        (begin_lengths, model, state, work, team, 0, 0) if breaks else (),
        (end_lengths, model, state, work, trail, team, 0.0, 0, 0) if breaks else ()]


# -- kernels for the terms of a scene, called by address ------------------------------------------

@compiled_for(work='breakage')
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
def paths_error(
    model: Model, loads: Loads, trail: Trail, higher: np.ndarray, lower: np.ndarray, scale: float,
    team: Team
) -> float:
    """Return the error of the work of paths for the blocks of a thread; 0 if nothing touches."""
    if not has_touched(loads.drives, model.contacts, team.size):
        return 0.0
    first, last = own_blocks(team, model.blocks.slot.shape[0])
    return path_error(
        loads.drives, model, loads, trail.slopes, rows_of(trail.stage.orientation).shape[0],
        higher, lower, scale, first, last)


@compiled
def begin_lengths(
    model: Model, state: State, work: Work, team: Team, first: int, last: int
) -> None:
    """Store lengths and their rates at the start of a step."""
    note_lengths(model, work.breakage, state, work, team, first, last)


@compiled
def end_lengths(
    model: Model, state: State, work: Work, trail: Trail, team: Team, h: float, first: int,
    last: int
) -> int:
    """Return 1 if a connector may have broken within a step of length `h` [s], else 0."""
    return int(is_breaking(model, work.breakage, state, work, trail, team, h, first, last))


@compiled
def copy_last(
    model: Model, loads: Loads, work: Work, trail: Trail, first: int, last: int
) -> None:
    """Copy slopes and powers at the end of a step to its start, for blocks first to last."""
    slot, power = model.blocks.slot, loads.power
    for block in range(first, last):
        s = slot[block]
        for k in range(trail.slopes.shape[1]):
            store(trail.slopes[0], k, s, load(trail.slopes[LAST], k, s))
    for m in range(LANES * loads.start[first], LANES * loads.start[last], LANES):
        store(power, 0, m, load(power, LAST, m))
    repeat_flow(work.spent, slot, first, last)
    repeat_flow(work.given, slot, first, last)


# -- what the control asks ------------------------------------------------------------------------

@compiled
def own(bodies: Bodies) -> tuple[int, int]:
    """Return the blocks of this thread: first, and one after the last."""
    return own_blocks(bodies.team, bodies.model.blocks.slot.shape[0])


@asked
def begin(bodies: Bodies) -> None:
    """Wait for all threads, and store lengths of connectors that can break."""
    wait_for_all(bodies.team)
    if bodies.lengths != 0:
        first, last = own(bodies)
        call_none(bodies.lengths, (
            bodies.model, bodies.state, bodies.work, bodies.team, first, last))


@asked
def finish(bodies: Bodies) -> bool:
    """Wait for all threads; return True in the one that writes the results of the control."""
    wait_for_all(bodies.team)
    return bodies.team.member == 0


@asked
def count_tests(bodies: Bodies) -> int:
    """Return the number of pairs tested so far."""
    return tests_of(bodies.contacts, bodies.team.member)


@asked
def repeat_count(bodies: Bodies, tests: int) -> None:
    """Set the number of tested pairs; later tests were a repetition."""
    set_tests(bodies.contacts, bodies.team.member, tests)


@asked
def find_slope(bodies: Bodies, index: int, of_stage: bool, time: float) -> None:
    """Write slope number `index` at a `time` [s]: of the stage in progress, or of the state."""
    first, last = own(bodies)
    state = bodies.trail.stage if of_stage else bodies.state
    call_none(bodies.slopes, (
        bodies.model, bodies.loads, state, bodies.work, bodies.trail, index, bodies.team,
        bodies.watch, time, first, last))


@asked
def repeat_slope(bodies: Bodies) -> None:
    """Copy the last slope of a step to the first of the next."""
    first, last = own(bodies)
    copy_last(bodies.model, bodies.loads, bodies.work, bodies.trail, first, last)
    repeat_stretches(losses_of(bodies.contacts), bodies.team)


@asked
def foresee_contact(
    bodies: Bodies, time: float, h: float, close: float, meeting: np.ndarray
) -> float:
    """Return when a contact begins or ends within `h` [s] from `time` [s], see `foresee`."""
    first, last = own(bodies)
    return foresee(
        bodies.contacts, bodies.watch, bodies.model.blocks, bodies.state, bodies.trail,
        bodies.team, time, h, close, meeting, first, last)


@asked
def try_step(bodies: Bodies, pair: Pair, time: float, h: float, is_judged: bool) -> None:
    """
    Compute the other slopes of a step from `time` [s], whose own slope is in place.

    The end of the step goes into trail.stage. `is_judged`: the step may be refused.
    """
    first, last = own(bodies)
    slot, state, trail = bodies.model.blocks.slot, bodies.state, bodies.trail
    if is_judged:
        forget_ways(bodies.watch, bodies.team.member)
    for index in range(SECOND, pair.step.shape[0]):
        weights = pair.weights[index, :pair.lengths[index]]
        for block in range(first, last):
            combine(state, trail.slopes, weights, h, trail.stage, slot[block])
        combine_stretches(losses_of(bodies.contacts), weights, h, False, bodies.team)
        find_slope(bodies, index, True, time + pair.nodes[index] * h)
    for block in range(first, last):
        combine(state, trail.slopes, pair.step, h, trail.stage, slot[block])
        normalise(trail.stage.orientation, slot[block])
    combine_stretches(losses_of(bodies.contacts), pair.step, h, False, bodies.team)
    # Forces will be evaluated at the end too.
    ways_of(
        bodies.watch, bodies.model.blocks, trail.stage, time + h, bodies.team.member, first, last)


@asked
def largest_error(
    bodies: Bodies, pair: Pair, scales: np.ndarray, smooth: float, h: float
) -> tuple[float, float]:
    """
    Return the error rate of a step of length `h` [s], the largest of all bodies; the probable one.

    Equal in all threads. Larger than any other if bodies left the region in which contacts are
    known. `scales` and `smooth`: see `step_error`.
    """
    first, last = own(bodies)
    trail, team, slot = bodies.trail, bodies.team, bodies.model.blocks.slot
    turn_rows = rows_of(bodies.state.orientation).shape[0]
    largest, probable = 0.0, 0.0
    for block in range(first, last):
        error, error_of_step = step_error(
            trail.slopes, turn_rows, pair.higher_error, pair.lower_error, scales, smooth,
            slot[block])
        largest = larger_of(largest, error)
        probable = max(probable, error_of_step)
    if bodies.error_of_paths != 0:
        largest = larger_of(largest, call_float(bodies.error_of_paths, (
            bodies.model, bodies.loads, trail, pair.higher_error, pair.lower_error, scales[2],
            team)))
    error, error_of_step = stretch_error(
        losses_of(bodies.contacts), pair.higher_error, pair.lower_error, scales[0], smooth, team)
    largest = larger_of(largest, error)
    probable = max(probable, error_of_step)
    if has_missed(bodies.watch, team.member) and largest < LEFT_REGION:
        largest = LEFT_REGION
    trail.errors[team.member] = largest
    trail.probable[team.member] = probable
    wait_for_all(team)
    for member in range(team.size):
        largest = larger_of(largest, trail.errors[member])
        probable = max(probable, trail.probable[member])
    return pair.estimate_ratio * largest, pair.probable_ratio * probable


@asked
def check_clear(bodies: Bodies, pair: Pair, time: float, h: float) -> int:
    """Check that no contact is possible within a step from `time` [s], see `find_clear`."""
    first, last = own(bodies)
    return find_clear(
        bodies.watch, bodies.model.blocks, bodies.state, bodies.trail, pair.step.shape[0],
        bodies.team, time, h, first, last)


@asked
def can_search_farther(bodies: Bodies, time: float) -> bool:
    """Check that a search from the positions at `time` [s] has a longer reach than the last."""
    return can_look_farther(bodies.watch, time)


@asked
def accept_step(bodies: Bodies, pair: Pair, h: float, keeps_start: bool) -> None:
    """Let the bodies be where the step of `h` [s] ends; `keeps_start` for states within it."""
    first, last = own(bodies)
    slot, trail, work = bodies.model.blocks.slot, bodies.trail, bodies.work
    if keeps_start:
        save(bodies.model, bodies.state, trail.start, first, last)
    save(bodies.model, trail.stage, bodies.state, first, last)
    accept_stretches(losses_of(bodies.contacts), bodies.team)
    if keeps_start:
        keep_work(bodies.loads, first, last)
    add_work(bodies.loads, h, pair.step, first, last)
    add_flow(work.spent, slot, h, pair.step, first, last)
    add_flow(work.given, slot, h, pair.step, first, last)


@asked
def land_on_contact(bodies: Bodies, h: float, close: float, meeting: np.ndarray) -> float:
    """Return when a contact begins or ends within a refused step of `h` [s], see `land`."""
    return land(
        bodies.contacts, bodies.team, bodies.state, bodies.trail.slopes[0], h, close, meeting)


@asked
def may_break(bodies: Bodies, h: float) -> bool:
    """Check if a connector may have broken within the step of `h` [s] that has just ended."""
    if bodies.breaking == 0:
        return False
    first, last = own(bodies)
    return call_int(bodies.breaking, (
        bodies.model, bodies.state, bodies.work, bodies.trail, bodies.team, h, first, last)) != 0


@asked
def examine(bodies: Bodies, time: float, ledger: np.ndarray) -> int:
    """Return the status of a health check at `time` [s] in the first thread, 0 in all others."""
    team, figures = bodies.team, bodies.work.figures
    first, last = own_blocks(team, figures.shape[0] - 1)
    call_none(bodies.figures, (
        bodies.model, bodies.loads, bodies.state, bodies.work, time, coarse_up_to(ledger),
        looks_inside(ledger), first, last, bodies.model.blocks.slot.shape[0]))
    wait_for_all(team)
    if team.member != 0:
        return 0
    forget_contacts(ledger)
    if bodies.contact_figures != 0:
        call_none(bodies.contact_figures, (
            bodies.contacts, bodies.state.position, bodies.state.orientation, ledger))
    return call_int(bodies.verdict, (figures, ledger))


@asked
def search(bodies: Bodies, time: float, step: float, ledger: np.ndarray) -> int:
    """
    Return the status of displacements and overlaps at `time` [s], 0 except in the first thread.

    Other steps of the length `step` [s] will follow; 0: of any length.
    """
    team, watch = bodies.team, bodies.watch
    if team.member != 0:
        return 0
    status = judge_ways(watch, farthest(watch, team.size), bodies.state, time, step)
    if deepest_overlap(bodies.contacts, team.size) > ledger[DEEPEST_LIMIT]:
        status |= TOO_DEEP
    return status


@asked
def agree(bodies: Bodies, status: int) -> int:
    """Return the status of the first thread in all threads."""
    return tell_all(bodies.team, status)


@asked
def save_sound(bodies: Bodies, done: int, ledger: np.ndarray) -> None:
    """Save a sound state, after `done` steps of this call."""
    if bodies.team.member == 0:
        ledger[SAVED_AT] = done
    first, last = own(bodies)
    save(bodies.model, bodies.state, bodies.saved, first, last)
    save_stretches(losses_of(bodies.contacts), bodies.team)
    # Each step of a pair keeps the work of loads where it begins.
    if bodies.trail is None:
        keep_work(bodies.loads, first, last)


@asked
def check_health(
    bodies: Bodies, since_check: int, check_interval: int, ledger: np.ndarray, done: int,
    time: float, step: float
) -> tuple[int, int]:
    """
    Check the state at `time` [s] if a health check is due, and save a sound state.

    Return the status and the steps since the last health check. `step`: see `search`.
    """
    examined = since_check >= check_interval
    status = 0
    if examined:
        status = examine(bodies, time, ledger)
    status |= search(bodies, time, step, ledger)
    status = agree(bodies, status)
    if examined:
        since_check = 0
        if status & (UNSOUND | TOO_DEEP | MISSED) == 0:
            save_sound(bodies, done, ledger)
    return status, since_check


@asked
def combine_dense(bodies: Bodies, weights: np.ndarray, h: float) -> None:
    """Write a stage of a step of `h` [s] that has ended, for states within it."""
    first, last = own(bodies)
    trail = bodies.trail
    for block in range(first, last):
        combine(
            trail.start, trail.slopes, weights, h, trail.stage, bodies.model.blocks.slot[block])
    combine_stretches(losses_of(bodies.contacts), weights, h, True, bodies.team)
