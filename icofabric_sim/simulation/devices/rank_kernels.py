# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Kernels of a rank during a step: kicks while poses are exchanged, and copies of poses.

The flows are those of kernels/flows.py. These kernels are outside the kernels package because the
cache depends on that package as a whole: a change here compiles nothing else.
"""

from icofabric_sim.kernels.flows import drift, place_links, push, push_kept
from icofabric_sim.kernels.hessian import move_block
from icofabric_sim.kernels.kinks import account, foretell, keep_velocities, note_motion, strike
from icofabric_sim.kernels.records import Loads, Model, State, Team, Trail, Work
from icofabric_sim.kernels.rhs import combine, larger_of, normalise, path_error, step_error
from icofabric_sim.kernels.rotations import rows_of
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import LANES, load, splat, store
from icofabric_sim.kernels.runtime.team import TILE
from icofabric_sim.terms.contacts.losses import stretch_error
from icofabric_sim.terms.contacts.record import ContactLosses
from icofabric_sim.terms.damping.speeds import place_speeds
from icofabric_sim.terms.links.kinks import Kinks
import numpy as np

# Numbers of a pose: position and quaternion; with velocities; and with those before a kick, too.
POSE, STAGE, MOTION = 7, 13, 19
# Of a small motion: displacements and rotation vectors, scaled by the roots of mass and inertia.
VECTOR = 6


@compiled
def drift_and_push(
    model: Model, loads: Loads | None, state: State, work: Work, kinks: Kinks | None,
    step_part: float, now: float, whole: float, after: float, kick: float, again: float,
    keep: bool, drifts: np.ndarray, drifted: int, pushes: np.ndarray, ahead: np.ndarray
) -> None:
    """
    Drift the blocks of `drifts` from the place `drifted` on, and kick those of `pushes`.

    As in `steps` of kernels/integrators/splitting.py, `ahead` blocks have drifted before each tile
    of kicks, and all at the end. `kinks` are those at a fraction of a step in which each connector
    keeps its slope; the kick at its end stores the velocities before the kick.
    """
    count = pushes.shape[0]
    for tile in range(ahead.shape[0]):
        goal: int = np.int64(ahead[tile])  # type: ignore[assignment]
        drift(model, loads, state, work, now, whole, drifts, drifted, goal)
        if keep:
            keep_drifted(model, kinks, state, drifts, drifted, goal)
        drifted = max(drifted, goal)
        push(
            model, loads, state, work, kinks, step_part, after, kick, again, keep, pushes,
            TILE * tile, min(TILE * tile + TILE, count))
    drift(model, loads, state, work, now, whole, drifts, drifted, drifts.shape[0])
    if keep:
        keep_drifted(model, kinks, state, drifts, drifted, drifts.shape[0])


@compiled
def keep_drifted(
    model: Model, kinks: Kinks | None, state: State, drifts: np.ndarray, first: int, last: int
) -> None:
    """
    Store velocities of blocks drifts[first] to drifts[last - 1] before the last kick of a step.

    The blocks have drifted, so driven bodies have the velocities of their paths.
    """
    if kinks is not None:
        for turn in range(first, last):
            keep_velocities(kinks, state, model.blocks.slot[np.int64(drifts[turn])])


@compiled
def take_poses(state: State, slots: np.ndarray, poses: np.ndarray) -> None:
    """Copy positions and orientations of the blocks that start at `slots` to (7, m LANES)."""
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        for k in range(3):
            store(poses, k, LANES * i, load(state.position, k, s))
        for k in range(4):
            store(poses, 3 + k, LANES * i, load(state.orientation, k, s))


@compiled
def put_poses(
    model: Model, state: State, work: Work, slots: np.ndarray, poses: np.ndarray
) -> None:
    """Copy positions and orientations back, and compute the attachment points of these blocks."""
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        for k in range(3):
            store(state.position, k, s, load(poses, k, LANES * i))
        for k in range(4):
            store(state.orientation, k, s, load(poses, 3 + k, LANES * i))
        place_links(model.links, state, work, s)


@compiled
def take_vectors(vector: np.ndarray, slots: np.ndarray, values: np.ndarray) -> None:
    """Copy rows (6, s) of the blocks that start at `slots` to (6, m LANES)."""
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        for k in range(VECTOR):
            store(values, k, LANES * i, load(vector, k, s))


@compiled
def put_vectors(vector: np.ndarray, slots: np.ndarray, values: np.ndarray) -> None:
    """Copy rows (6, s) back."""
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        for k in range(VECTOR):
            store(vector, k, s, load(values, k, LANES * i))


@compiled
def divide_vectors(vector: np.ndarray, slots: np.ndarray, length: float) -> None:
    """Divide rows (6, s) of the blocks that start at `slots` by a `length`."""
    divisor = splat(length)
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        for k in range(VECTOR):
            store(vector, k, s, load(vector, k, s) / divisor)


@compiled
def move_blocks(
    model: Model, state: State, points: np.ndarray, moved: np.ndarray, turns: np.ndarray,
    root_m: float, root_i: float, vector: np.ndarray, slots: np.ndarray
) -> None:
    """Write displacements of the blocks that begin at `slots` to `moved` and `turns`."""
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        move_block(
            model, state, points, moved, turns, root_m, root_i, model.supports, vector, s)


@compiled
def begin_kinked(
    model: Model, loads: Loads | None, kinks: Kinks, state: State, work: Work, now: float,
    kick: float, first: int, last: int
) -> None:
    """Start a step at `now` [s] as `kinked_steps`: the first kick of blocks first to last."""
    for block in range(first, last):
        keep_velocities(kinks, state, model.blocks.slot[block])
    push_kept(model, loads, state, work, now, kick, first, last)
    for block in range(first, last):
        note_motion(model.links, kinks, state, work.points, kick, model.blocks.slot[block])


@compiled
def strike_foretold(
    model: Model, loads: Loads | None, kinks: Kinks, state: State, work: Work, h: float,
    kick: float, first: int, last: int
) -> None:
    """Predict the crossings of a step of `h` [s], and add their impulses to its first kick."""
    for block in range(first, last):
        s = model.blocks.slot[block]
        if foretell(model.links, kinks, work.points, h, block, s)[0]:
            strike(model, loads, kinks, state, work, 0, kick, block, s)


@compiled
def note_all_motion(
    model: Model, kinks: Kinks, state: State, work: Work, kick: float, first: int, last: int
) -> None:
    """Store the motion of attachment points at the end of a step."""
    for block in range(first, last):
        note_motion(model.links, kinks, state, work.points, kick, model.blocks.slot[block])


@compiled
def account_all(
    model: Model, kinks: Kinks, work: Work, h: float, first: int, last: int
) -> bool:
    """Compute the missing impulses of a step of `h` [s]; return True if there are any."""
    found = False
    for block in range(first, last):
        if account(model.links, kinks, work.points, h, block, model.blocks.slot[block]):
            found = True
    return found


@compiled
def strike_all(
    model: Model, loads: Loads | None, kinks: Kinks, state: State, work: Work, row: int,
    first: int, last: int
) -> None:
    """Apply the impulses that crossings of kinks still lack."""
    for block in range(first, last):
        strike(model, loads, kinks, state, work, row, 1.0, block, model.blocks.slot[block])


@compiled
def take_stage(state: State, slots: np.ndarray, motions: np.ndarray) -> None:
    """Copy poses and velocities of the blocks that start at `slots` to (13, m LANES)."""
    take_poses(state, slots, motions)
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        for k in range(3):
            store(motions, 7 + k, LANES * i, load(state.linear_velocity, k, s))
            store(motions, 10 + k, LANES * i, load(state.angular_velocity, k, s))


@compiled
def put_velocities(state: State, slots: np.ndarray, motions: np.ndarray) -> None:
    """Copy velocities back."""
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        for k in range(3):
            store(state.linear_velocity, k, s, load(motions, 7 + k, LANES * i))
            store(state.angular_velocity, k, s, load(motions, 10 + k, LANES * i))


@compiled
def put_stage(
    model: Model, state: State, work: Work, slots: np.ndarray, motions: np.ndarray
) -> None:
    """Copy poses and velocities back, and compute attachment points and their velocities."""
    put_poses(model, state, work, slots, motions)
    put_velocities(state, slots, motions)
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        place_speeds(model.damping, state, work.points, work.speeds, s)


@compiled
def take_motions(
    state: State, more: np.ndarray, slots: np.ndarray, motions: np.ndarray
) -> None:
    """Copy poses, velocities and six more values, `more` (6, s), to (19, m LANES)."""
    take_stage(state, slots, motions)
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        for k in range(6):
            store(motions, 13 + k, LANES * i, load(more, k, s))


@compiled
def put_motions(
    model: Model, more: np.ndarray, state: State, work: Work, slots: np.ndarray,
    motions: np.ndarray
) -> None:
    """
    Copy poses, velocities and `more` back, and compute the attachment points of these blocks.
    """
    put_poses(model, state, work, slots, motions)
    put_velocities(state, slots, motions)
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        for k in range(6):
            store(more, k, s, load(motions, 13 + k, LANES * i))


@compiled
def note_motions(
    model: Model, kinks: Kinks, state: State, work: Work, kick: float, slots: np.ndarray
) -> None:
    """Store the motion of attachment points of blocks of other ranks, around a `kick` [s]."""
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        note_motion(model.links, kinks, state, work.points, kick, s)


@compiled
def combine_all(
    state: State, trail: Trail, weights: np.ndarray, h: float, slot: np.ndarray, first: int,
    last: int, is_end: bool
) -> None:
    """Compute the stage of a step of `h` [s] of blocks first to last; its end if `is_end`."""
    for block in range(first, last):
        combine(state, trail.slopes, weights, h, trail.stage, slot[block])
        if is_end:
            normalise(trail.stage.orientation, slot[block])


@compiled
def errors_of(
    trail: Trail, model: Model, loads: Loads, losses: ContactLosses | None,
    error_5: np.ndarray, error_3: np.ndarray, scales: np.ndarray, smooth: float, first: int,
    last: int, team: Team
) -> tuple[float, float, float]:
    """
    Return the errors of `largest_error` for blocks first to last and the pairs of a part.

    The error of the work of paths, which counts where something touches, comes last.
    """
    largest, probable = 0.0, 0.0
    turn_rows = rows_of(trail.stage.orientation).shape[0]
    for block in range(first, last):
        error, error_of_step = step_error(
            trail.slopes, turn_rows, error_5, error_3, scales, smooth, model.blocks.slot[block])
        largest = larger_of(largest, error)
        probable = max(probable, error_of_step)
    error, error_of_step = stretch_error(losses, error_5, error_3, scales[0], smooth, team)
    of_paths = path_error(
        loads.drives, model, loads, trail.slopes, turn_rows, error_5, error_3, scales[2], first,
        last)
    return larger_of(largest, error), max(probable, error_of_step), of_paths
