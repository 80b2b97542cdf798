# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Splitting methods: the exact flows of kinetic and potential energy in turn.

The inertia is isotropic, so the kinetic flow is free flight and one rotation about a constant
axis, both exact; the potential flow changes velocities only. See docs/decisions/.
"""

import math

from icofabric_sim.kernels.contact.displacement import (
    add_ways,
    farthest,
    note_ways,
    shift_at,
    STRIDE,
)
from icofabric_sim.kernels.contact.forces import deepest_overlap
from icofabric_sim.kernels.contact.losses import losses_of, save_stretches, touch_ahead
from icofabric_sim.kernels.contact.rebuild_check import judge_ways, MISSED
from icofabric_sim.kernels.contact.stiffness import note_pushes, swing_of
from icofabric_sim.kernels.flows import drift, push, push_kept
from icofabric_sim.kernels.integrators.kinked import kinked_steps
from icofabric_sim.kernels.loads import has_rows, keep_work
from icofabric_sim.kernels.monitor import (
    conclude,
    DEEPEST_LIMIT,
    judge_roughness,
    least_scale,
    note_own,
    PENDING_STEPS,
    REGULAR,
    ROUGHER,
    ROUGHEST,
    roughness,
    sample,
    save,
    SAVED_AT,
    SWING,
    SWING_LIMIT,
    SWINGS,
    TOO_DEEP,
    UNSOUND,
)
from icofabric_sim.kernels.records import Contacts, Kinks, Loads, Model, State, Team, Watch, Work
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import splat
from icofabric_sim.kernels.runtime.team import own_blocks, tell_all, TILE, wait_for_all
import numpy as np

# An interval that never ends: no health checks.
NEVER = 2**62


@compiled
def steps(
    kicks: np.ndarray, drifts: np.ndarray, model: Model, contacts: Contacts | None,
    loads: Loads | None, state: State, work: Work, team: Team, watch: Watch | None, origin: float,
    index: int, h: float, count: int
) -> None:
    """
    Take `count` steps of length `h`, the first from origin + index h on; see `splitting`.

    Contacts need the positions of all bodies, so in their sweeps all bodies drift first.
    Dissipative contacts are for the leapfrog alone (kernels/contact/losses.py). The displacements
    of bodies are stored only where forces are evaluated; positions in between do not count.

    A block can be kicked once its neighbours have drifted, so both run over the fabric in one
    sweep (see traversal_order.py) and each body comes from memory once. Blocks of a thread that
    border on another's drift first.
    """
    first, last = own_blocks(team, model.blocks.slot.shape[0])
    sweep = team.sweep
    count_own = last - first
    # A literal would be a type of its own, and compile the drift once more.
    begin: int = np.int64(0)  # type: ignore[assignment]
    kick_first = kicks.shape[0] > drifts.shape[0]
    stages = min(kicks.shape[0], drifts.shape[0])
    if kick_first:
        push_kept(model, loads, state, work, origin + index * h, kicks[0] * h, first, last)
    now = 0.0
    most = splat(0.0)
    for evaluation in range(count * stages):
        stage = evaluation % stages
        # The times of a step do not depend on the call that contains it.
        step = index + evaluation // stages
        if stage == 0:
            now = origin + step * h
        whole = drifts[stage] * h
        after = now + whole
        if kick_first and stage + 1 == stages:
            after = origin + (step + 1) * h
        kick = kicks[stage] * h
        again = 0.0
        keep = False
        if kick_first:
            kick = kicks[stage + 1] * h
            # The last kick of a step and the first of the next share their forces.
            keep = evaluation + 1 == count * stages
            if stage + 1 == stages and not keep:
                again = kicks[0] * h
        drifted = begin
        shift = shift_at(watch, after)
        if team.size > 1:
            drift(
                model, loads, state, work, now, whole, sweep.drifts, drifted, sweep.border)
            drifted = sweep.border
            wait_for_all(team)
        if contacts is not None:
            if team.size == 1:
                drift(model, loads, state, work, now, whole, sweep.drifts, drifted, count_own)
                drifted = count_own
            touch_ahead(
                losses_of(contacts), contacts, state, model.inverse_mass, model.inverse_inertia,
                h, h, team)
        if watch is not None:
            for turn in range(drifted):
                block = sweep.drifts[turn]
                most = add_ways(
                    watch, state, model.blocks.alive[block], shift, model.blocks.slot[block], most)
        for tile in range(sweep.ahead.shape[0]):
            goal: int = np.int64(sweep.ahead[tile])  # type: ignore[assignment]
            drift(model, loads, state, work, now, whole, sweep.drifts, drifted, goal)
            if watch is not None:
                for turn in range(drifted, goal):
                    block = sweep.drifts[turn]
                    most = add_ways(
                        watch, state, model.blocks.alive[block], shift, model.blocks.slot[block],
                        most)
            drifted = goal
            push(
                model, loads, state, work, None, 0.0, after, kick, again, keep, sweep.pushes,
                TILE * tile, min(TILE * tile + TILE, count_own))
        if evaluation + 1 == count * stages:
            note_ways(watch, team.member, most)
            note_pushes(contacts, model, first, last)
        wait_for_all(team)
        now = after
        if not kick_first and stage + 1 == stages:
            drift(
                model, loads, state, work, now, drifts[stages] * h, sweep.drifts, begin, count_own)
            wait_for_all(team)


@compiled
def take_steps(
    kinks: Kinks | None, kicks: np.ndarray, drifts: np.ndarray, model: Model, loads: Loads,
    state: State, work: Work, team: Team, watch: Watch | None, origin: float, index: int, h: float,
    count: int
) -> None:
    """
    Take `count` steps of length `h`; with `kinks` they keep their order if slopes jump.

    Bodies without loads have separate loops: a search for rows block by block, without any rows,
    took 5 % of a leapfrog step.
    """
    if kinks is None:
        if has_rows(loads):
            steps(
                kicks, drifts, model, model.contacts, loads, state, work, team, watch, origin,
                index, h, count)
        else:
            steps(
                kicks, drifts, model, model.contacts, None, state, work, team, watch, origin,
                index, h, count)
    elif has_rows(loads):
        kinked_steps(
            kinks, kicks, drifts, model, model.contacts, loads, state, work, team, watch, origin,
            index, h, count)
    else:
        kinked_steps(
            kinks, kicks, drifts, model, model.contacts, None, state, work, team, watch, origin,
            index, h, count)


@compiled
def stride_of(watch: Watch | None, check_interval: int) -> int:
    """Return the number of steps between two checks of displacements."""
    if watch is None:
        return check_interval
    return int(watch.limits[STRIDE])


@compiled
def is_guarded(contacts: Contacts | None, ledger: np.ndarray) -> bool:
    """Check that the energy oscillation of contacts within a step has a limit."""
    if contacts is None:
        return False
    return ledger[SWING_LIMIT] < math.inf


@compiled
def splitting(
    kicks: np.ndarray,
    drifts: np.ndarray,
    model: Model,
    loads: Loads,
    state: State,
    saved: State,
    work: Work,
    team: Team,
    origin: float,
    index: int,
    h: float,
    count: int,
    since_check: int,
    check_interval: int,
    watch: Watch | None,
    ledger: np.ndarray,
) -> tuple[int, int, int]:
    """
    Take up to `count` steps of length `h`: kick, drift, ..., kick or drift, kick, ..., drift.

    The first begins at origin + index h [s]. `kicks` and `drifts` are the fractions of the step
    that each flow takes; the longer of the two begins and ends a step. Each stage takes one
    evaluation of the forces. If kicks begin, the last of a step and the first of the next share
    theirs, and `work` must hold the accelerations of the state, as it does again at the end. After
    every `check_interval` steps a health check examines the state (`ledger`, see
    kernels/monitor.py) and saves a sound state; a status other than 0 ends the call early. Return
    the status, the steps taken, and the steps since the last health check.
    """
    stages = min(kicks.shape[0], drifts.shape[0])
    first, last = own_blocks(team, model.blocks.slot.shape[0])
    differences = work.weights.shape[0] - 1
    # Read before any thread takes a step; the first counts on in the ledger.
    regular = int(ledger[REGULAR])
    done = 0
    while done < count:
        # As far as the next health check.
        ahead = min(count - done, check_interval - since_check)
        # Read again, because a search within the kernel may change the stride.
        stride = stride_of(watch, check_interval)
        ahead = min(ahead, stride - since_check % stride)
        guarded = is_guarded(model.contacts, ledger) and check_interval < NEVER
        if guarded:
            # A strongly damped collision may be over within a few steps.
            ahead = min(ahead, 1)
        # Step ends are sampled in consecutive windows of as many steps as the difference has,
        # regardless of health checks in between. If a step is a single evaluation, only the last
        # window before a health check is sampled.
        sampled = -1
        if 0 < differences and check_interval < NEVER:
            sampled = regular % differences
            if stages < 4:
                sampled = since_check - (check_interval - differences)
            if sampled < 0:
                ahead = min(ahead, -sampled)
            else:
                ahead = 1
                if sampled % differences == 0:
                    if team.member == 0:
                        sample(
                            model.blocks.slot, state.position, state.orientation,
                            work.difference, work.weights, sampled % differences)
                    wait_for_all(team)
        take_steps(
            work.kinks, kicks, drifts, model, loads, state, work, team, watch, origin,
            index + done, h, ahead)
        done += ahead
        since_check += ahead
        regular += ahead
        if sampled >= 0:
            if team.member == 0:
                number = sampled % differences + 1
                sample(
                    model.blocks.slot, state.position, state.orientation, work.difference,
                    work.weights, number)
                if number == differences:
                    ledger[ROUGHEST] = max(ledger[ROUGHEST], roughness(work, ledger))
            wait_for_all(team)
        if team.member == 0 and check_interval < NEVER:
            ledger[REGULAR] += ahead
            ledger[PENDING_STEPS] += ahead
        examined = since_check >= check_interval
        watched = watch is not None and since_check % stride == 0
        status = 0
        if guarded and team.member == 0:
            ledger[SWING] = max(ledger[SWING], swing_of(model.contacts, h))
            if ledger[SWING] > ledger[SWING_LIMIT] * least_scale(ledger):
                status |= SWINGS
        if examined:
            since_check = 0
            note_own(model, loads, state, work, team, origin + (index + done) * h, ledger)
            if team.member == 0:
                status |= conclude(model, state, work.figures, ledger)
                status |= judge_roughness(
                    work, ledger, differences if stages < 4 else check_interval)
        if watched and team.member == 0:
            status |= judge_ways(
                watch, farthest(watch, team.size), state, origin + (index + done) * h, h)
            if deepest_overlap(model.contacts, team.size) > ledger[DEEPEST_LIMIT]:
                status |= TOO_DEEP
        if examined or watched or guarded:
            status = tell_all(team, status)
        if examined and status & (UNSOUND | ROUGHER | TOO_DEEP | MISSED | SWINGS) == 0:
            if team.member == 0:
                ledger[SAVED_AT] = done
            save(model, state, saved, first, last)
            save_stretches(losses_of(model.contacts), team)
            keep_work(loads, first, last)
        if status != 0:
            return status, done, since_check
    return 0, done, since_check
