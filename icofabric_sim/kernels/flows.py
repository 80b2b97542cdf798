# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The two flows of all splitting methods, for runs of blocks.

`drift`: the kinetic energy alone, free flight and free rotation, exact because the inertia is
isotropic. `push`: the potential energy alone, which changes velocities only. `accelerations` calls
all terms of the registry that depend on the pose of a fabric; loads are listed in `push`.
"""

from icofabric_sim.kernels.composition import compose_terms
from icofabric_sim.kernels.loads import (
    bear_row,
    kick_row,
    kick_row_again,
    NONE,
    place_row,
    resist_row,
    stop_row,
    velocities_before,
    work_row,
)
from icofabric_sim.kernels.records import Links, Loads, Model, State, Supports, Work
from icofabric_sim.kernels.rotations import place_anywhere, place_points, rotate
from icofabric_sim.kernels.runtime.compiled import compiled, compiled_for, inlined
from icofabric_sim.kernels.runtime.lanes import fma, load, splat, store
from icofabric_sim.terms.contacts.losses import begin_lead, end_lead, losses_of, spend
from icofabric_sim.terms.links.kinks import Kinks
from icofabric_sim.terms.profiles import ONES
from icofabric_sim.terms.shared import Six
import numpy as np

add_forces = compose_terms(
    'add_force', 'model, state, points, kinks, part, time, block, s', 'wrench')
add_accelerations = compose_terms('add_acceleration', 'model, state, time, block, s, a', 'a')


@compiled
def drift(
    model: Model, loads: Loads | None, state: State, work: Work, time: float, h: float,
    order: np.ndarray, first: int, last: int
) -> None:
    """
    Apply the flow of the kinetic energy over `h` from `time` [s] on; place the attachment points.

    For blocks order[first] to order[last - 1].
    """
    step = splat(h)
    known, factors = NONE, ONES
    for turn in range(first, last):
        block = np.int64(order[turn])
        s = model.blocks.slot[block]
        if loads is not None:
            for m in range(loads.start[block], loads.start[block + 1]):
                stop_row(loads, state, m, s)
            for m in range(loads.start[block], loads.start[block + 1]):
                known, factors = work_row(loads, state, m, s, time, h, known, factors)
        for k in range(3):
            store(state.position, k, s, fma(
                step, load(state.linear_velocity, k, s), load(state.position, k, s)))
        rotate(
            state.orientation, s, h,
            load(state.angular_velocity, 0, s),
            load(state.angular_velocity, 1, s),
            load(state.angular_velocity, 2, s))
        if loads is not None:
            for m in range(loads.start[block], loads.start[block + 1]):
                place_row(loads, state, m, s, time + h)
        place_links(model.links, state, work, s)


@inlined
def place_links(links: Links | None, state: State, work: Work, s: int) -> None:
    """Place the attachment points of a block, if there are connectors."""
    if links is None:
        return
    place_attachments(
        links.attachment, links.half_width, state.position, state.orientation, work.points, s)


@inlined
def place_attachments(
    attachment: np.ndarray | None, half_width: float, position: np.ndarray,
    orientation: np.ndarray, points: np.ndarray, s: int
) -> None:
    """Place the attachment points of a block: on the body axes, or anywhere."""
    if attachment is None:
        place_points(half_width, position, orientation, points, s)
    else:
        place_anywhere(attachment, position, orientation, points, s)


@compiled_for(model='supports', work='')
def place_all(model: Model, state: State, work: Work, first: int, last: int) -> None:
    """Place the attachment points of blocks first to last without motion."""
    for block in range(first, last):
        place_links(model.links, state, work, model.blocks.slot[block])


@compiled
def push(
    model: Model, loads: Loads | None, state: State, work: Work, kinks: Kinks | None, part: float,
    time: float, h: float, again: float, keep: bool, order: np.ndarray, first: int, last: int
) -> None:
    """
    Apply the flow of the potential energy at `time` [s] over `h`, and over `again` if not 0.

    The second kick is the first one of the next step, which shares the forces. `keep` stores the
    accelerations for a later kick. For blocks order[first] to order[last - 1]. `kinks`, `part`:
    see `accelerations`.
    """
    known, factor = NONE, 1.0
    for turn in range(first, last):
        block = np.int64(order[turn])
        s = model.blocks.slot[block]
        a = accelerations(model, state, work.points, kinks, part, time, block, s)
        if keep:
            for k in range(3):
                store(work.acceleration, k, s, a[k])
                store(work.acceleration, k + 3, s, a[k + 3])
        if loads is not None:
            for m in range(loads.start[block], loads.start[block + 1]):
                a = resist_row(model, loads, state, m, s, h, again, a)
        spend(losses_of(model.contacts), work.spent, state, s, h)
        kick(state, a, h, s)
        if loads is not None:
            before = velocities_before(loads, state, s)
            for m in range(loads.start[block], loads.start[block + 1]):
                known, factor = kick_row(model, loads, state, m, s, time, h, known, factor)
            for m in range(loads.start[block], loads.start[block + 1]):
                bear_row(loads, state, before, m, s)
        spend(losses_of(model.contacts), work.spent, state, s, h)
        if again != 0.0:
            spend(losses_of(model.contacts), work.spent, state, s, again)
            begin_lead(losses_of(model.contacts), state, s)
            kick(state, a, again, s)
            if loads is not None:
                before = velocities_before(loads, state, s)
                for m in range(loads.start[block], loads.start[block + 1]):
                    known, factor = kick_row_again(
                        model, loads, state, m, s, time, again, known, factor)
                for m in range(loads.start[block], loads.start[block + 1]):
                    bear_row(loads, state, before, m, s)
            end_lead(losses_of(model.contacts), state, s)
            spend(losses_of(model.contacts), work.spent, state, s, again)


@compiled
def push_kept(
    model: Model, loads: Loads | None, state: State, work: Work, time: float, h: float, first: int,
    last: int
) -> None:
    """
    Apply the flow of the potential energy at `time` [s] over `h` with the stored accelerations.
    """
    known, factor = NONE, 1.0
    for block in range(first, last):
        s = model.blocks.slot[block]
        a = (
            load(work.acceleration, 0, s), load(work.acceleration, 1, s),
            load(work.acceleration, 2, s), load(work.acceleration, 3, s),
            load(work.acceleration, 4, s), load(work.acceleration, 5, s))
        if loads is not None:
            for m in range(loads.start[block], loads.start[block + 1]):
                a = resist_row(model, loads, state, m, s, h, 0.0, a)
        spend(losses_of(model.contacts), work.spent, state, s, h)
        begin_lead(losses_of(model.contacts), state, s)
        kick(state, a, h, s)
        if loads is not None:
            before = velocities_before(loads, state, s)
            for m in range(loads.start[block], loads.start[block + 1]):
                known, factor = kick_row(model, loads, state, m, s, time, h, known, factor)
            for m in range(loads.start[block], loads.start[block + 1]):
                bear_row(loads, state, before, m, s)
        end_lead(losses_of(model.contacts), state, s)
        spend(losses_of(model.contacts), work.spent, state, s, h)


@compiled_for(model='damping', work='')
def keep_accelerations(
    model: Model, state: State, work: Work, time: float, first: int, last: int
) -> None:
    """Store the accelerations of blocks first to last at `time` [s]; their points are in place."""
    for block in range(first, last):
        s = model.blocks.slot[block]
        a = accelerations(model, state, work.points, None, 0.0, time, block, s)
        for k in range(3):
            store(work.acceleration, k, s, a[k])
            store(work.acceleration, k + 3, s, a[k + 3])


@inlined
def accelerations(
    model: Model, state: State, points: np.ndarray, kinks: Kinks | None, part: float, time: float,
    block: int, s: int
) -> Six:
    """
    Return the linear [m/s^2] and angular [rad/s^2] acceleration of a block at `time` [s] (eq 45).

    Includes all forces that depend on positions and orientations, without loads. Velocities are
    not read. With `kinks`, at a fraction `part` of a step in which each connector keeps its slope
    (kernels/kinks.py).

    The gyroscopic term vanishes. Gravity is an acceleration and needs no detour over the mass.
    """
    wrench = add_forces(model, state, points, kinks, part, time, block, s)
    return add_accelerations(
        model, state, time, block, s,
        accelerate(model.supports, model.inverse_mass, model.inverse_inertia, wrench, s))


@inlined
def accelerate(
    supports: Supports | None, inverse_mass: float, inverse_inertia: float, force: Six, s: int
) -> Six:
    """Return accelerations from forces and torques, zero along held freedoms."""
    fx, fy, fz, tx, ty, tz = force
    if supports is None:
        mass, inertia = splat(inverse_mass), splat(inverse_inertia)
        return fx * mass, fy * mass, fz * mass, tx * inertia, ty * inertia, tz * inertia
    else:
        inertia = load(supports.inverse_inertia, 0, s)
        return (
            fx * load(supports.inverse_mass, 0, s),
            fy * load(supports.inverse_mass, 1, s),
            fz * load(supports.inverse_mass, 2, s),
            tx * inertia, ty * inertia, tz * inertia)


@inlined
def kick(state: State, a: Six, h: float, s: int) -> None:
    """Add h times the accelerations to the velocities of a block."""
    step = splat(h)
    velocity, spin = state.linear_velocity, state.angular_velocity
    for k in range(3):
        store(velocity, k, s, fma(step, a[k], load(velocity, k, s)))
        store(spin, k, s, fma(step, a[k + 3], load(spin, k, s)))
