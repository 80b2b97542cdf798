# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Splitting methods: the exact flows of kinetic and potential energy in turn.

The inertia is isotropic, so the kinetic flow is free flight and one rotation about a constant
axis, both exact; the potential flow changes velocities only. See docs/decisions/.

The control is one kernel for all scenes, see bodies.py.
"""

import math

from icofabric_sim.kernels.integrators.bodies import agree, Bodies, examine, save_sound, search
from icofabric_sim.kernels.integrators.sweep import Splitting
from icofabric_sim.kernels.monitor import (
    judge_roughness,
    least_scale,
    PENDING_STEPS,
    REGULAR,
    ROUGHER,
    ROUGHEST,
    roughness,
    sample,
    SWING,
    SWING_LIMIT,
    SWINGS,
    TOO_DEEP,
    UNSOUND,
)
from icofabric_sim.kernels.runtime.compiled import asked, compiled
from icofabric_sim.kernels.runtime.outlined import call_none
from icofabric_sim.kernels.runtime.team import wait_for_all
from icofabric_sim.terms.contacts.displacement import STRIDE
from icofabric_sim.terms.contacts.rebuild_check import MISSED
from icofabric_sim.terms.contacts.record import Contacts, Watch
from icofabric_sim.terms.contacts.stiffness import swing_of
import numpy as np

# An interval that never ends: no health checks.
NEVER = 2**62


@compiled
def is_guarded(contacts: Contacts | None, ledger: np.ndarray) -> bool:
    """Check that the energy oscillation of contacts within a step has a limit."""
    if contacts is None:
        return False
    return ledger[SWING_LIMIT] < math.inf


@compiled
def swing_status(contacts: Contacts | None, h: float, ledger: np.ndarray) -> int:
    """Return SWINGS if contacts let the energy oscillate too far in steps of `h` [s], else 0."""
    ledger[SWING] = max(ledger[SWING], swing_of(contacts, h))
    return SWINGS if ledger[SWING] > ledger[SWING_LIMIT] * least_scale(ledger) else 0


@compiled
def stride_of(watch: Watch | None) -> int:
    """Return the number of steps between two checks of displacements; 0: no checks."""
    if watch is None:
        return 0
    return int(watch.limits[STRIDE])


@asked
def can_swing(bodies: Bodies, ledger: np.ndarray) -> bool:
    """Check that each step must be examined for the energy oscillation of contacts."""
    return is_guarded(bodies.contacts, ledger)


@asked
def judge_swing(bodies: Bodies, h: float, ledger: np.ndarray) -> int:
    """Return the status of the last step of `h` [s], 0 except in the first thread."""
    return swing_status(bodies.contacts, h, ledger) if bodies.team.member == 0 else 0


@asked
def check_stride(bodies: Bodies) -> int:
    """Return the number of steps between two checks of displacements; 0: no checks."""
    return stride_of(bodies.watch)


@asked
def judge_motion(
    bodies: Bodies, method: Splitting, check_interval: int, ledger: np.ndarray
) -> int:
    """Return ROUGHER if the motion is too rough for the step, 0 except in the first thread."""
    if bodies.team.member != 0:
        return 0
    differences = bodies.work.weights.shape[0] - 1
    return judge_roughness(
        bodies.work, ledger, differences if stage_count(method) < 4 else check_interval)


@compiled
def stage_count(method: Splitting) -> int:
    """Return the number of force evaluations in a step."""
    return min(method.kicks.shape[0], method.drifts.shape[0])


@asked
def take_interval(
    bodies: Bodies, method: Splitting, origin: float, index: int, h: float, count: int,
    since_check: int, check_interval: int, regular: int, guarded: bool, searched: bool,
    ledger: np.ndarray
) -> None:
    """
    Take `count` steps up to the next check, and sample the roughness of the motion.

    `guarded`, `searched`: overlaps, displacements are examined at the end.

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


@asked
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
    guarded = check_interval < NEVER and can_swing(bodies, ledger)
    # Read before any thread takes a step; the first counts on in the ledger.
    regular = int(ledger[REGULAR])
    done, status = 0, 0
    while done < count and status == 0:
        ahead = min(count - done, check_interval - since_check)
        # Read again, because a search within the call may change the stride.
        stride = check_stride(bodies)
        if stride > 0:
            ahead = min(ahead, stride - since_check % stride)
        if guarded:
            # A strongly damped collision may be over within a few steps.
            ahead = min(ahead, 1)
        searched = stride > 0 and (since_check + ahead) % stride == 0
        take_interval(
            bodies, method, origin, index + done, h, ahead, since_check, check_interval,
            regular + done, guarded, searched, ledger)
        done += ahead
        since_check += ahead
        time = origin + (index + done) * h
        examined = since_check >= check_interval
        if guarded:
            status |= judge_swing(bodies, h, ledger)
        if examined:
            since_check = 0
            status |= examine(bodies, time, ledger)
            status |= judge_motion(bodies, method, check_interval, ledger)
        if searched:
            status |= search(bodies, time, h, ledger)
        if examined or searched or guarded:
            status = agree(bodies, status)
        if examined and status & (UNSOUND | ROUGHER | TOO_DEEP | MISSED | SWINGS) == 0:
            save_sound(bodies, done, ledger)
    return status, done, since_check
