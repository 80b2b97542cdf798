# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The equations of motion as dy/dt = f(y) for Runge-Kutta methods, and sums of their slopes.

Rows of a slope, slots last: 3 of the position, 4 of the quaternion (or 9 direction cosines), 3 of
the velocity, 3 of the spin, and with Maxwell arms 12 of their rest lengths.
"""

from icofabric_sim.kernels.composition import compose_terms
from icofabric_sim.kernels.flows import accelerations, place_links
from icofabric_sim.kernels.loads import (
    add_row_slope,
    keep_row_turning,
    NONE,
    place_row,
    resist_row_slope,
)
from icofabric_sim.kernels.probable_error import probable_error
from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.kernels.rotations import orthonormalise, rows_of
from icofabric_sim.kernels.runtime.compiled import compiled, inlined
from icofabric_sim.kernels.runtime.lanes import (
    fma,
    lane,
    LANES,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    store,
    store_at,
    Vector,
    where,
)
from icofabric_sim.terms.damping.speeds import place_speeds
from icofabric_sim.terms.drives.path import path_of
from icofabric_sim.terms.drives.record import Drives
from icofabric_sim.terms.gyration import turn_by_moments
from icofabric_sim.terms.masses import masses_of
from icofabric_sim.terms.meters import note_flow
import numpy as np

# Slot of the slope at the end of a step.
LAST = 12

add_velocity_forces = compose_terms(
    'add_velocity_force',
    'model, state, points, speeds, slope, row, linear, angular, block, s, spent', 'spent')
add_external_forces = compose_terms(
    'add_external_force', 'model, state, external, linear, angular, s, given', 'given')


@compiled
def place_blocks(
    model: Model, loads: Loads, state: State, work: Work, time: float, first: int,
    last: int
) -> None:
    """
    Place the attachment points of blocks first to last at `time` [s], and driven bodies on paths.

    Also set the velocities of the points if a damping term needs them.
    """
    for block in range(first, last):
        s = model.blocks.slot[block]
        for m in range(loads.start[block], loads.start[block + 1]):
            place_row(loads, state, m, s, time)
        place_links(model.links, state, work, s)
        place_speeds(model.damping, state, work.points, work.speeds, s)


@compiled
def find_slopes(
    model: Model, loads: Loads, state: State, work: Work, time: float, slope: np.ndarray,
    index: int, first: int, last: int
) -> None:
    """
    Write slope number `index` at `state` and `time` [s], for blocks first to last.

    The attachment points are in place. dq/dt = omega q / 2 (eq 22) or de_i/dt = omega x e_i (eq
    19), and eq 45. The power of the loads goes into `loads.power`, dissipated and external power
    into `work`.
    """
    turn = rows_of(state.orientation).shape[0]
    linear, angular = slope[3 + turn:6 + turn], slope[6 + turn:9 + turn]
    known, factor = NONE, 1.0
    for block in range(first, last):
        s = model.blocks.slot[block]
        for k in range(3):
            store(slope, k, s, load(state.linear_velocity, k, s))
        turn_slopes(state.orientation, state.angular_velocity, slope, s)
        a = accelerations(model, state, work.points, None, 0.0, time, block, s)
        for k in range(3):
            store(linear, k, s, a[k])
            store(angular, k, s, a[k + 3])
        spent = add_velocity_forces(
            model, state, work.points, work.speeds, slope, 9 + turn, linear, angular, block, s,
            splat(0.0))
        note_flow(work.spent, index, s, spent)
        given = add_external_forces(
            model, state, work.external, linear, angular, s, splat(0.0))
        note_flow(work.given, index, s, given)
        for m in range(loads.start[block], loads.start[block + 1]):
            known, factor = add_row_slope(
                model, loads, state, linear, angular, m, s, time, index, work.spent, known,
                factor)
        for m in range(loads.start[block], loads.start[block + 1]):
            resist_row_slope(model, loads, state, linear, angular, m, s, index)
        turn_by_moments(model.gyration, state.orientation, state.angular_velocity, angular, s)
        for m in range(loads.start[block], loads.start[block + 1]):
            keep_row_turning(model, loads, angular, m, s)


@compiled
def turn_slopes(
    orientation: np.ndarray, spin: np.ndarray, slope: np.ndarray, s: int
) -> None:
    """Write the slopes of the orientations of a block."""
    zero = splat(0.0)
    if orientation.ndim == 2:
        half = splat(0.5)
        ux, uy = half * load(spin, 0, s), half * load(spin, 1, s)
        uz = half * load(spin, 2, s)
        x, y = load(orientation, 0, s), load(orientation, 1, s)
        z, w = load(orientation, 2, s), load(orientation, 3, s)
        store(slope, 3, s, fma(ux, w, fma(uy, z, zero - uz * y)))
        store(slope, 4, s, fma(uy, w, fma(uz, x, zero - ux * z)))
        store(slope, 5, s, fma(uz, w, fma(ux, y, zero - uy * x)))
        store(slope, 6, s, zero - fma(ux, x, fma(uy, y, uz * z)))
    else:
        ux, uy, uz = load(spin, 0, s), load(spin, 1, s), load(spin, 2, s)
        for i in range(3):
            axis = orientation[i]
            x, y, z = load(axis, 0, s), load(axis, 1, s), load(axis, 2, s)
            store(slope, 3 + 3 * i, s, uy * z - uz * y)
            store(slope, 4 + 3 * i, s, uz * x - ux * z)
            store(slope, 5 + 3 * i, s, ux * y - uy * x)


@compiled
def add_work(loads: Loads, h: float, weights: np.ndarray, first: int, last: int) -> None:
    """
    Add the work [J] of the loads on blocks first to last in a step: the weighted sum of powers.
    """
    for m in range(LANES * loads.start[first], LANES * loads.start[last], LANES):
        total = splat(0.0)
        for j in range(weights.shape[0]):
            total = fma(splat(weights[j]), load(loads.power, j, m), total)
        store_at(loads.work, m, fma(splat(h), total, load_at(loads.work, m)))


@compiled
def combine(
    source: State, slopes: np.ndarray, weights: np.ndarray, h: float, target: State, s: int
) -> None:
    """Write y + h sum of w_j slope_j of a block, for as many slopes as there are weights."""
    turn, target_turn = source.orientation, target.orientation
    combine_three(source.position, slopes, 0, weights, h, target.position, s)
    if turn.ndim == 2:
        combine_three(turn, slopes, 3, weights, h, target_turn, s)
        total = sum_one(slopes, 6, weights, s)
        store(target_turn, 3, s, fma(splat(h), total, load(turn, 3, s)))
        combine_velocities(source, slopes, 7, weights, h, target, s)
    else:
        for i in range(3):
            combine_three(turn[i], slopes, 3 + 3 * i, weights, h, target_turn[i], s)
        combine_velocities(source, slopes, 12, weights, h, target, s)


@inlined
def combine_velocities(
    source: State, slopes: np.ndarray, row: int, weights: np.ndarray, h: float, target: State,
    s: int
) -> None:
    """
    Combine velocities and spins, from slope `row` on, and the rest lengths in the rows after them.
    """
    combine_three(source.linear_velocity, slopes, row, weights, h, target.linear_velocity, s)
    combine_three(source.angular_velocity, slopes, row + 3, weights, h, target.angular_velocity, s)
    combine_rest(source.rest, slopes, row + 6, weights, h, target.rest, s)


@inlined
def combine_three(
    source: np.ndarray, slopes: np.ndarray, row: int, weights: np.ndarray, h: float,
    target: np.ndarray, s: int
) -> None:
    """Combine the first three rows of an array."""
    x, y, z = sum_three(slopes, row, weights, s)
    step = splat(h)
    store(target, 0, s, fma(step, x, load(source, 0, s)))
    store(target, 1, s, fma(step, y, load(source, 1, s)))
    store(target, 2, s, fma(step, z, load(source, 2, s)))


@inlined
def sum_three(
    slopes: np.ndarray, row: int, weights: np.ndarray, s: int
) -> tuple[Vector, Vector, Vector]:
    """
    Return the sums of w_j slope_j of three rows of a block, for as many slopes as weights.

    Three rows at once, because the additions of one row wait for each other.
    """
    x, y, z = splat(0.0), splat(0.0), splat(0.0)
    for j in range(weights.shape[0]):
        # Many weights of high-order methods are 0.
        if weights[j] != 0.0:
            weight, slope = splat(weights[j]), slopes[j]
            x = fma(weight, load(slope, row, s), x)
            y = fma(weight, load(slope, row + 1, s), y)
            z = fma(weight, load(slope, row + 2, s), z)
    return x, y, z


@inlined
def sum_one(slopes: np.ndarray, row: int, weights: np.ndarray, s: int) -> Vector:
    """Return the sum of w_j slope_j of one row of a block."""
    total = splat(0.0)
    for j in range(weights.shape[0]):
        if weights[j] != 0.0:
            total = fma(splat(weights[j]), load(slopes[j], row, s), total)
    return total


@compiled
def combine_rest(
    source: np.ndarray | None, slopes: np.ndarray, row: int, weights: np.ndarray, h: float,
    target: np.ndarray | None, s: int
) -> None:
    """Combine the rest lengths of Maxwell arms, if there are arms."""
    if source is None:
        return
    if target is None:
        return
    combine_rows(source, slopes, row, weights, h, target, s)


@compiled
def combine_rows(
    source: np.ndarray, slopes: np.ndarray, row: int, weights: np.ndarray, h: float,
    target: np.ndarray, s: int
) -> int:
    """Combine the rows of one array as `combine` does; return the slope row after them."""
    step = splat(h)
    for k in range(source.shape[0]):
        total = splat(0.0)
        for j in range(weights.shape[0]):
            # Many weights of high-order methods are 0.
            if weights[j] != 0.0:
                total = fma(splat(weights[j]), load(slopes[j], row + k, s), total)
        store(target, k, s, fma(step, total, load(source, k, s)))
    return row + source.shape[0]


@compiled
def normalise(orientation: np.ndarray, s: int) -> None:
    """
    Normalise quaternions, or orthonormalise cosines by two Newton steps.

    Each Newton step squares the error of the cosines.
    """
    if orientation.ndim == 2:
        x, y = load(orientation, 0, s), load(orientation, 1, s)
        z, w = load(orientation, 2, s), load(orientation, 3, s)
        scale = rsqrt(fma(x, x, fma(y, y, fma(z, z, w * w))))
        store(orientation, 0, s, x * scale)
        store(orientation, 1, s, y * scale)
        store(orientation, 2, s, z * scale)
        store(orientation, 3, s, w * scale)
    else:
        orthonormalise(orientation, s)
        orthonormalise(orientation, s)


@compiled
def larger_of(largest: float, error: float) -> float:
    """Return the larger of two errors; NaN counts as infinite."""
    if not error <= np.inf:
        return np.inf
    return max(largest, error)


@compiled
def step_error(
    slopes: np.ndarray, turn_rows: int, error_5: np.ndarray, error_3: np.ndarray,
    scales: np.ndarray, smooth: float, s: int
) -> tuple[float, float]:
    """
    Return two errors of a step of length 1, each the largest of a block: for acceptance; probable.

    Squares of position, orientation, velocity and spin are multiplied by `scales` (4,), and the
    largest of the four counts; rest lengths of Maxwell arms count as positions. The estimates of
    order 5 and 3 are combined as in DOP853, e5^2 / sqrt(e5^2 + 0.01 e3^2), which has order 7 and
    is conservative. See `probable_error` for the second error and for `smooth`.
    """
    zero = splat(0.0)
    place_5 = squares_of_three(slopes, 0, error_5, s)
    place_3 = squares_of_three(slopes, 0, error_3, s)
    turn_5 = squares_of_turn(slopes, turn_rows, error_5, s)
    turn_3 = squares_of_turn(slopes, turn_rows, error_3, s)
    speed_5 = squares_of_three(slopes, 3 + turn_rows, error_5, s)
    speed_3 = squares_of_three(slopes, 3 + turn_rows, error_3, s)
    spin_5 = squares_of_three(slopes, 6 + turn_rows, error_5, s)
    spin_3 = squares_of_three(slopes, 6 + turn_rows, error_3, s)
    all_squares = (place_5 + place_3) + (turn_5 + turn_3) + (speed_5 + speed_3) + (spin_5 + spin_3)
    largest_5 = maximum(splat(scales[3]) * spin_5, maximum(
        splat(scales[2]) * speed_5, maximum(
            splat(scales[1]) * turn_5, maximum(splat(scales[0]) * place_5, zero))))
    largest_3 = maximum(splat(scales[3]) * spin_3, maximum(
        splat(scales[2]) * speed_3, maximum(
            splat(scales[1]) * turn_3, maximum(splat(scales[0]) * place_3, zero))))
    row = 9 + turn_rows
    for k in range(row, slopes[0].shape[0]):
        first, second = zero, zero
        for j in range(error_5.shape[0]):
            value = load(slopes[j], k, s)
            first = fma(splat(error_5[j]), value, first)
            second = fma(splat(error_3[j]), value, second)
        all_squares = all_squares + fma(first, first, second * second)
        largest_5 = maximum(splat(scales[0]) * (first * first), largest_5)
        largest_3 = maximum(splat(scales[0]) * (second * second), largest_3)
    sum_ = maximum(fma(splat(0.01), largest_3, largest_5), splat(1e-300))
    # The maximum of vectors ignores NaN; 0 times NaN is NaN.
    error = largest_5 * rsqrt(sum_) + zero * all_squares
    error_of_step = probable_error(largest_5, largest_3, smooth)
    largest, probable = 0.0, 0.0
    for i in range(LANES):
        largest = larger_of(largest, lane(error, i))
        probable = max(probable, lane(error_of_step, i))
    return largest, probable


@inlined
def squares_of_three(slopes: np.ndarray, row: int, weights: np.ndarray, s: int) -> Vector:
    """Return the sum of the squares of the weighted sums of three rows of a block."""
    x, y, z = sum_three(slopes, row, weights, s)
    return fma(z, z, fma(y, y, x * x))


@inlined
def squares_of_turn(slopes: np.ndarray, rows: int, weights: np.ndarray, s: int) -> Vector:
    """Return the sum of the squares of the weighted sums of the `rows` of orientations."""
    total = squares_of_three(slopes, 3, weights, s)
    if rows == 4:
        x = sum_one(slopes, 6, weights, s)
        return fma(x, x, total)
    for row in (6, 9):
        x, y, z = sum_three(slopes, row, weights, s)
        total = fma(z, z, fma(y, y, fma(x, x, total)))
    return total


@compiled
def path_error(
    drives: Drives | None, model: Model, loads: Loads, slopes: np.ndarray, turn_rows: int,
    error_5: np.ndarray, error_3: np.ndarray, scale: float, first: int, last: int
) -> float:
    """
    Return the error of the work of paths in a step of length 1, as `step_error` does.

    For blocks first to last. Contacts change the work, but not the motion of driven bodies. An
    error dP of the power counts as a velocity error dP / sqrt(m (m v^2 + I omega^2)), whose square
    is multiplied by `scale`.
    """
    largest = 0.0
    if drives is None:
        return largest
    size = 4.0 if turn_rows == 4 else 0.5
    for block in range(first, last):
        s = model.blocks.slot[block]
        mass, inertia = masses_of(model.masses, model.inverse_mass, model.inverse_inertia, s)
        # Carriers of planes have no mass.
        mass = where(splat(0.0) < mass, mass, splat(1.0 / model.inverse_mass))
        for m in range(loads.start[block], loads.start[block + 1]):
            p = path_of(drives, loads.wrench[m])
            if p < 0:
                continue
            sum_5, sum_3, moving = splat(0.0), splat(0.0), splat(1e-200)
            for j in range(error_5.shape[0]):
                power = load(loads.power, j, LANES * m)
                sum_5 = fma(splat(error_5[j]), power, sum_5)
                sum_3 = fma(splat(error_3[j]), power, sum_3)
                square, turning = splat(0.0), splat(0.0)
                for k in range(3):
                    if drives.moves[p, k]:
                        v = load(slopes[j], k, s)
                        square = fma(v, v, square)
                if drives.moves[p, 3]:
                    for k in range(3, 3 + turn_rows):
                        v = load(slopes[j], k, s)
                        turning = fma(v, v, turning)
                moving = maximum(fma(mass, square, splat(size) * inertia * turning), moving)
            part = splat(scale) / (mass * moving)
            square_5, square_3 = part * (sum_5 * sum_5), part * (sum_3 * sum_3)
            error = square_5 * rsqrt(
                maximum(fma(splat(0.01), square_3, square_5), splat(1e-300)))
            for i in range(LANES):
                largest = larger_of(largest, lane(error, i))
    return largest


@compiled
def interpolate(
    start: State, end: State, slopes: np.ndarray, dense: np.ndarray, h: float, x: float,
    target: State, s: int
) -> None:
    """
    Write the state of a block at the fraction `x` of a step.

    The interpolation is the cubic of Hermite plus x^2 (1 - x)^2 (c_0 + x (c_1 + (1 - x) (c_2 + x
    c_3))), where c_i = h sum of dense_ij slope_j.
    """
    turn = rows_of(start.orientation)
    row = interpolate_rows(
        start.position, end.position, slopes, 0, dense, h, x, target.position, s)
    row = interpolate_rows(
        turn, rows_of(end.orientation), slopes, row, dense, h, x, rows_of(target.orientation), s)
    row = interpolate_rows(
        start.linear_velocity, end.linear_velocity, slopes, row, dense, h, x,
        target.linear_velocity, s)
    row = interpolate_rows(
        start.angular_velocity, end.angular_velocity, slopes, row, dense, h, x,
        target.angular_velocity, s)
    interpolate_rest(start.rest, end.rest, slopes, row, dense, h, x, target.rest, s)
    normalise(target.orientation, s)


@compiled
def interpolate_rest(
    start: np.ndarray | None, end: np.ndarray | None, slopes: np.ndarray, row: int,
    dense: np.ndarray, h: float, x: float, target: np.ndarray | None, s: int
) -> None:
    """Interpolate the rest lengths of Maxwell arms, if there are arms."""
    if start is None:
        return
    if end is None:
        return
    if target is None:
        return
    interpolate_rows(start, end, slopes, row, dense, h, x, target, s)


@compiled
def interpolate_rows(
    start: np.ndarray, end: np.ndarray, slopes: np.ndarray, row: int, dense: np.ndarray, h: float,
    x: float, target: np.ndarray, s: int
) -> int:
    """Interpolate the rows of one array as `interpolate` does; return the slope row after them."""
    step, here, rest = splat(h), splat(x), splat(1.0 - x)
    for k in range(start.shape[0]):
        old, new = load(start, k, s), load(end, k, s)
        first, last = load(slopes[0], row + k, s), load(slopes[LAST], row + k, s)
        change = new - old
        total = splat(0.0)
        for i in range(dense.shape[0] - 1, -1, -1):
            part = splat(0.0)
            for j in range(dense.shape[1]):
                if dense[i, j] != 0.0:
                    part = fma(splat(dense[i, j]), load(slopes[j], row + k, s), part)
            total = fma(step, part, total) * (here if i % 2 == 1 else rest)
        total = (total + (change + change - step * (first + last))) * here
        total = (total + (step * first - change)) * rest
        total = (total + change) * here
        store(target, k, s, old + total)
    return row + start.shape[0]


@compiled
def rates_of_rows(
    model: Model, loads: Loads, state: State, work: Work, slope: np.ndarray, slot: np.ndarray,
    y: np.ndarray, result: np.ndarray
) -> None:
    """
    Write the slopes at time 0 for a state `y`; `y` and `result` have the shape (13 n,), by bodies.
    """
    last = model.blocks.slot.shape[0]
    read_rows(y, slot, state)
    place_blocks(model, loads, state, work, 0.0, 0, last)
    find_slopes(model, loads, state, work, 0.0, slope, 0, 0, last)
    copy_rows(slope, slot, result)


@compiled
def read_rows(y: np.ndarray, slot: np.ndarray, state: State) -> None:
    """
    Copy `y` (13 n,), which holds the numbers of each body in turn, into a state with quaternions.
    """
    for b in range(slot.shape[0]):
        s = slot[b]
        for k in range(3):
            state.position[k, s] = y[13 * b + k]
            state.linear_velocity[k, s] = y[13 * b + 7 + k]
            state.angular_velocity[k, s] = y[13 * b + 10 + k]
        for k in range(4):
            state.orientation[k, s] = y[13 * b + 3 + k]


@compiled
def copy_rows(slope: np.ndarray, slot: np.ndarray, result: np.ndarray) -> None:
    """Copy the slopes into `result` (13 n,), which holds the numbers of each body in turn."""
    for b in range(slot.shape[0]):
        for k in range(13):
            result[13 * b + k] = slope[k, slot[b]]
