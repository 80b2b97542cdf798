# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Splitting methods: the exact flows of kinetic and potential energy in turn.

The inertia is isotropic, so the kinetic flow is free flight and one rotation about a constant
axis, both exact; the potential flow changes velocities only. See docs/design.md.
"""

from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.monitor import examine, MOVED_FAR, moved_far
from icofabric_sim.kernels.records import Loads, Model, State, Supports, Work
from icofabric_sim.kernels.rotations import rotate
from icofabric_sim.kernels.wrenches import compute_wrenches
import numpy as np


@compiled
def kick_gravity(
    gravity: np.ndarray | None, supports: Supports | None, h: float, velocity: np.ndarray
) -> None:
    """
    Add h g to the velocities of the bodies that are free to move that way.
    """
    if gravity is None:
        return
    for b in range(velocity.shape[0]):
        for k in range(3):
            if is_free(supports, b, k):
                velocity[b, k] += h * gravity[k]


@compiled
def is_free(supports: Supports | None, b: int, k: int) -> bool:
    """
    Whether body `b` may move along the world axis `k`.
    """
    if supports is None:
        return True
    return supports.inverse_mass[b, k] > 0.0


@compiled
def kick_wrenches(
    supports: Supports | None,
    inverse_mass: float,
    inverse_inertia: float,
    h: float,
    work: Work,
    velocity: np.ndarray,
    spin: np.ndarray,
) -> None:
    """
    Add h F / M and h N / Lambda (eq 45 without the gyroscopic term, which vanishes).
    """
    if supports is None:
        for b in range(velocity.shape[0]):
            for k in range(3):
                velocity[b, k] += h * inverse_mass * work.force[b, k]
                spin[b, k] += h * inverse_inertia * work.torque[b, k]
    else:
        for b in range(velocity.shape[0]):
            for k in range(3):
                velocity[b, k] += h * supports.inverse_mass[b, k] * work.force[b, k]
                spin[b, k] += h * supports.inverse_inertia[b] * work.torque[b, k]


@compiled
def kick(model: Model, h: float, state: State, work: Work) -> None:
    """
    Flow of the potential energy over `h`: velocities only.
    """
    kick_gravity(model.gravity, model.supports, h, state.linear_velocity)
    kick_wrenches(
        model.supports,
        model.inverse_mass,
        model.inverse_inertia,
        h,
        work,
        state.linear_velocity,
        state.angular_velocity,
    )


@compiled
def drift(h: float, state: State) -> None:
    """
    Flow of the kinetic energy over `h`: free flight and free rotation, exact.
    """
    for b in range(state.position.shape[0]):
        for k in range(3):
            state.position[b, k] += h * state.linear_velocity[b, k]
        rotate(
            state.orientation,
            b,
            h,
            state.angular_velocity[b, 0],
            state.angular_velocity[b, 1],
            state.angular_velocity[b, 2],
        )


@compiled
def splitting(
    kicks: np.ndarray,
    drifts: np.ndarray,
    model: Model,
    loads: Loads | None,
    state: State,
    work: Work,
    h: float,
    count: int,
    since_check: int,
    check_interval: int,
    reference: np.ndarray | None,
    readings: np.ndarray,
    high: float,
    low: float,
    spin_weight: float,
    reach: float,
) -> tuple[int, int, int]:
    """
    Take up to `count` steps of length `h`: kick, drift, kick, ..., drift, kick.

    `kicks` (m + 1,) and `drifts` (m,) are the parts of the step that each flow takes; one
    evaluation of the wrenches for each drift, because the last kick of a step and the first of the
    next share theirs. `work` must hold the wrenches of the state. After every `check_interval`
    steps the state is examined; a status other than 0 ends the call early. Returns the status, the
    steps taken, and the steps since the last examination.
    """
    done = 0
    while done < count:
        kick(model, kicks[0] * h, state, work)
        for stage in range(drifts.shape[0]):
            drift(drifts[stage] * h, state)
            compute_wrenches(model, loads, state, work)
            kick(model, kicks[stage + 1] * h, state, work)
        done += 1
        since_check += 1
        if since_check >= check_interval:
            since_check = 0
            status = examine(
                model, state, work, reference, readings, high, low, spin_weight, reach
            )
            if status != 0:
                return status, done, since_check
        # A fast body crosses a shell in fewer steps than lie between two looks; free bodies, which
        # take long steps, in one. Looking for pairs costs about ten steps of a fabric.
        stride = 1 if model.connectors is None else max(1, 8 // drifts.shape[0])
        if since_check % stride == 0 and moved_far(reference, state.position, reach):
            return MOVED_FAR, done, since_check
    return 0, done, since_check
