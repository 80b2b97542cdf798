# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Splitting methods: the exact flows of kinetic and potential energy in turn.

The inertia is isotropic, so the kinetic flow is free flight and one rotation about a constant
axis, both exact; the potential flow changes velocities only. See docs/decisions/.

The control is one kernel for all scenes, see bodies.py.
"""

import math

from icofabric_sim.kernels.contact.displacement import farthest, STRIDE
from icofabric_sim.kernels.contact.forces import deepest_overlap
from icofabric_sim.kernels.contact.losses import losses_of, save_stretches
from icofabric_sim.kernels.contact.rebuild_check import judge_ways, MISSED
from icofabric_sim.kernels.contact.stiffness import swing_of
from icofabric_sim.kernels.integrators.bodies import Bodies, examine_bodies, own
from icofabric_sim.kernels.integrators.sweep import Splitting
from icofabric_sim.kernels.loads import keep_work
from icofabric_sim.kernels.monitor import (
    DEEPEST_LIMIT,
    judge_roughness,
    least_scale,
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
from icofabric_sim.kernels.records import Contacts, Watch
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.outlined import call_none
from icofabric_sim.kernels.runtime.team import tell_all, wait_for_all
import numpy as np

# An interval that never ends: no health checks.
NEVER = 2**62


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
def stage_count(method: Splitting) -> int:
    """Return the number of force evaluations in a step."""
    return min(method.kicks.shape[0], method.drifts.shape[0])


@compiled
def take_interval(
    bodies: Bodies, method: Splitting, origin: float, index: int, h: float, count: int,
    since_check: int, check_interval: int, regular: int, ledger: np.ndarray
) -> None:
    """
    Take `count` steps up to the next check, and sample the roughness of the motion.

    Step ends are sampled in consecutive windows of as many steps as the difference has, regardless
    of health checks in between. If a step has few evaluations, only the last window before a
    health check is sampled. `regular` steps of this length were taken before.
    """
    state, work, team, slot = bodies.state, bodies.work, bodies.team, bodies.model.blocks.slot
    differences = work.weights.shape[0] - 1
    done = 0
    while done < count:
        ahead, sampled = count - done, -1
        if 0 < differences and check_interval < NEVER:
            sampled = (regular + done) % differences
            if stage_count(method) < 4:
                sampled = since_check + done - (check_interval - differences)
            if sampled < 0:
                ahead = min(ahead, -sampled)
            else:
                ahead = 1
                if sampled % differences == 0:
                    if team.member == 0:
                        sample(
                            slot, state.position, state.orientation, work.difference,
                            work.weights, 0)
                    wait_for_all(team)
        call_none(bodies.steps, (
            method, bodies.model, bodies.loads, state, work, team, bodies.watch, origin,
            index + done, h, ahead))
        done += ahead
        if sampled >= 0:
            if team.member == 0:
                number = sampled % differences + 1
                sample(
                    slot, state.position, state.orientation, work.difference, work.weights,
                    number)
                if number == differences:
                    ledger[ROUGHEST] = max(ledger[ROUGHEST], roughness(work, ledger))
            wait_for_all(team)
    if team.member == 0 and check_interval < NEVER:
        ledger[REGULAR] += count
        ledger[PENDING_STEPS] += count


@compiled
def splitting(
    bodies: Bodies, method: Splitting, origin: float, index: int, h: float, count: int,
    since_check: int, check_interval: int, ledger: np.ndarray
) -> tuple[int, int, int]:
    """
    Take up to `count` steps of length `h`: kick, drift, ..., kick or drift, kick, ..., drift.

    The first begins at origin + index h [s]. Each stage takes one evaluation of the forces. If
    kicks begin, the last of a step and the first of the next share theirs, and `work` must hold
    the accelerations of the state, as it does again at the end. After every `check_interval` steps
    a health check examines the state (`ledger`, see kernels/monitor.py) and saves a sound state; a
    status other than 0 ends the call early. Return the status, the steps taken, and the steps
    since the last health check.
    """
    state, work, team, watch = bodies.state, bodies.work, bodies.team, bodies.watch
    contacts = bodies.contacts
    guarded = check_interval < NEVER and is_guarded(contacts, ledger)
    # Read before any thread takes a step; the first counts on in the ledger.
    regular = int(ledger[REGULAR])
    done = 0
    while done < count:
        # Read again, because a search within the kernel may change the stride.
        stride = stride_of(watch, check_interval)
        ahead = min(count - done, check_interval - since_check, stride - since_check % stride)
        if guarded:
            # A strongly damped collision may be over within a few steps.
            ahead = min(ahead, 1)
        take_interval(
            bodies, method, origin, index + done, h, ahead, since_check, check_interval,
            regular + done, ledger)
        done += ahead
        since_check += ahead
        time = origin + (index + done) * h
        examined = since_check >= check_interval
        watched = watch is not None and since_check % stride == 0
        status = 0
        if guarded and team.member == 0:
            ledger[SWING] = max(ledger[SWING], swing_of(contacts, h))
            if ledger[SWING] > ledger[SWING_LIMIT] * least_scale(ledger):
                status |= SWINGS
        if examined:
            since_check = 0
            status |= examine_bodies(bodies, time, ledger)
            if team.member == 0:
                differences = work.weights.shape[0] - 1
                status |= judge_roughness(
                    work, ledger, differences if stage_count(method) < 4 else check_interval)
        if watched and team.member == 0:
            status |= judge_ways(watch, farthest(watch, team.size), state, time, h)
            if deepest_overlap(contacts, team.size) > ledger[DEEPEST_LIMIT]:
                status |= TOO_DEEP
        if examined or watched or guarded:
            status = tell_all(team, status)
        if examined and status & (UNSOUND | ROUGHER | TOO_DEEP | MISSED | SWINGS) == 0:
            if team.member == 0:
                ledger[SAVED_AT] = done
            first, last = own(bodies)
            save(bodies.model, state, bodies.saved, first, last)
            save_stretches(losses_of(contacts), team)
            keep_work(bodies.loads, first, last)
        if status != 0:
            return status, done, since_check
    return 0, done, since_check
