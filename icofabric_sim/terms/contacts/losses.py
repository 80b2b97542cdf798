# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Dissipation of contacts, by the laws of laws.py.

The thread that evaluates a pair also evaluates its losses. The force of the pair is changed before
forces are summed at the bodies, so forces on both bodies stay opposite, and no bit depends on the
number of threads.

Stretches of friction are integrated with the state: four numbers of each listed pair, with slopes
at every stage. A pair that is apart at the end of a step begins the next without stretch (`held`).
All the power of friction counts as dissipated. The energy in its springs is computed from their
stretches and subtracted again where energies are displayed.

Runge-Kutta methods have velocities at every stage. The leapfrog has velocities half a step before
the positions of its forces. They are extrapolated by the kick before, which leaves an error of the
square of the step, and stretches follow by Heun's method: both of order 2. At first touch the
normal force is zero, and so are damping and the limit of friction: nothing jumps there.
"""

import math

from icofabric_sim.kernels.probable_error import probable_error
from icofabric_sim.kernels.runtime.borrowed import borrowed
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, lane, load, splat, store, Vector
from icofabric_sim.kernels.runtime.team import end_parts, own_blocks, Team, wait_for_all
from icofabric_sim.terms.carriers import slot_of
from icofabric_sim.terms.contacts.force import add_up, part_of, touch_all, touch_awake
from icofabric_sim.terms.contacts.laws import (
    damping_factor,
    depth_rate,
    effective_damping,
    Four,
    patch_radius,
    pull,
    slip,
    stretch_rate,
    Three,
)
from icofabric_sim.terms.contacts.record import ContactLosses, Contacts
from icofabric_sim.terms.contacts.sleeping import APART
from icofabric_sim.terms.meters import Meter
from icofabric_sim.terms.shared import State
import numpy as np

# The slope at the end of a step; that at its start has number 0.
_LAST = 12
# Largest fraction of a velocity along the depth that the damping of a pair removes in a step of
# the leapfrog. In longer steps the damping is reduced, and never reverses the velocity.
_MOST_DAMPED = 0.5


@compiled
def losses_of(contacts: Contacts | None) -> ContactLosses | None:
    """Return the losses of contacts, or None."""
    if contacts is None:
        return None
    else:
        return contacts.losses


@compiled
def touch_moving(contacts: Contacts | None, state: State, index: int, team: Team) -> None:
    """
    Evaluate contacts as `touch_all`, with velocity-dependent forces, for slope number `index`.

    Also a barrier.
    """
    touch_losing(losses_of(contacts), contacts, state, index, team)


@compiled
def touch_losing(
    losses: ContactLosses | None, contacts: Contacts | None, state: State, index: int, team: Team
) -> None:
    """Evaluate contacts for slope number `index`; by `touch_all` without losses."""
    if losses is None:
        touch_all(contacts, state.position, state.orientation, team)
    else:
        touch_and_lose(losses, contacts, state, index, team)


@compiled
def touch_and_lose(
    losses: ContactLosses, contacts: Contacts, state: State, index: int, team: Team
) -> None:
    """Evaluate contacts with losses for slope number `index`."""
    count = contacts.pairs.shape[0]
    part = part_of(count, team.size)
    touch_awake(contacts, state.position, state.orientation, team)
    number = contacts.latest[8 * team.member]
    while number >= 0:
        first = number * part
        lose_some(losses, contacts, state, index, first, min(first + part, count))
        number = contacts.earlier[number]
    wait_for_all(team)
    end_parts(team)
    add_up(contacts, contacts.result, contacts.rows, team)
    first, last = own_blocks(team, contacts.start.shape[0] - 1)
    add_up_taken(losses, contacts, first, last)


@compiled
def lose_some(
    losses: ContactLosses, contacts: Contacts, state: State, index: int, first: int, last: int
) -> None:
    """Add the losses of pairs first to last to their forces; bodies are in place."""
    pairs, result = borrowed(contacts.pairs), borrowed(contacts.result)
    velocity, spin = borrowed(state.linear_velocity), borrowed(state.angular_velocity)
    position, power = borrowed(state.position), borrowed(losses.power)
    stretches, until = borrowed(losses.stage), borrowed(contacts.sleep.until)
    if index % _LAST == 0:
        stretches = borrowed(losses.stretch)
    kept, slopes = borrowed(losses.held), borrowed(losses.slopes)
    for p in range(first, last):
        out = result[p]
        power[p] = 0.0
        rate: Four = (0.0, 0.0, 0.0, 0.0)
        left: Four = (0.0, 0.0, 0.0, 0.0)
        if until[p] < APART and out[10] > 0.0:
            s, t = pairs[p, 0], pairs[p, 1]
            va, wa = column(velocity, s), column(spin, s)
            second = slot_of(contacts.carriers, t)
            vb, wb = column(velocity, second), column(spin, second)
            size = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
            deepening = depth_rate(out, va, wa, vb, wb)
            damping = effective_damping(losses.damping, deepening, out[10], losses.lag)
            factor = damping_factor(damping, deepening)
            power[p] = contacts.stiffness * out[10] * deepening * (factor - 1.0)
            for k in range(9):
                out[k] *= factor
            if losses.friction > 0.0:
                arm_a, arm_b = arms_of(position, s, t, out)
                radius = patch_radius(out)
                n, slips, turn = slips_of(out, va, wa, arm_a, vb, wb, arm_b, radius, t)
                left = (
                    stretches[p, 0], stretches[p, 1], stretches[p, 2], stretches[p, 3])
                stiffness = losses.friction_stiffness
                limit = losses.friction * factor * size * contacts.stiffness / stiffness
                q = pull(left, slips, losses.lag, n, limit)
                rate = stretch_rate(left, q, losses.lag, turn)
                power[p] += stiffness * (
                    q[0] * slips[0] + q[1] * slips[1] + q[2] * slips[2] + q[3] * slips[3])
                add_pull(out, q, n, arm_a, arm_b, radius, stiffness / contacts.stiffness)
        if losses.friction > 0.0:
            for k in range(4):
                slopes[index, p, k] = rate[k]
                if index % _LAST == 0:
                    kept[p, k] = left[k]


@compiled
def slips_of(
    out: np.ndarray, va: Three, wa: Three, arm_a: Three, vb: Three, wb: Three, arm_b: Three,
    radius: float, t: int
) -> tuple[Three, Four, Three]:
    """
    Return the normal of a pair, its four slips [m/s], and the angular velocity of its stretch.

    Slot `t` of the second body below 0: a plane.
    """
    n, v = slip(out, va, wa, arm_a, vb, wb, arm_b)
    if t < 0:
        turning = 0.5 * (wa[0] * n[0] + wa[1] * n[1] + wa[2] * n[2])
        turn = turning * n[0], turning * n[1], turning * n[2]
    else:
        turn = 0.5 * (wa[0] + wb[0]), 0.5 * (wa[1] + wb[1]), 0.5 * (wa[2] + wb[2])
    spun = (wb[0] - wa[0]) * n[0] + (wb[1] - wa[1]) * n[1] + (wb[2] - wa[2]) * n[2]
    return n, (v[0], v[1], v[2], radius * spun), turn


@compiled
def touch_ahead(
    losses: ContactLosses | None, contacts: Contacts, state: State, inverse_mass: float,
    inverse_inertia: float, h: float, step: float, team: Team
) -> None:
    """
    Evaluate contacts as `touch_all`, with losses, after a drift of `h` [s] of the leapfrog.

    Stretches advance by `h`: 0 to recompute forces. The forces act for a `step` [s].
    """
    if losses is None:
        touch_all(contacts, state.position, state.orientation, team)
    else:
        count = contacts.pairs.shape[0]
        part = part_of(count, team.size)
        touch_awake(contacts, state.position, state.orientation, team)
        number = contacts.latest[8 * team.member]
        while number >= 0:
            first = number * part
            lose_ahead(
                losses, contacts, state, inverse_mass, inverse_inertia, h, step, first,
                min(first + part, count))
            number = contacts.earlier[number]
        wait_for_all(team)
        end_parts(team)
        add_up(contacts, contacts.result, contacts.rows, team)
        add_up(contacts, losses.changes, losses.lost, team)


@compiled
def lose_ahead(
    losses: ContactLosses, contacts: Contacts, state: State, inverse_mass: float,
    inverse_inertia: float, h: float, step: float, first: int, last: int
) -> None:
    """
    Add losses as `lose_some` to awake pairs of a batch, `h` [s] after their last evaluation.

    For forces that act for a `step` [s]. A pair that was and is apart has no stretch left.
    """
    awake, until = borrowed(contacts.sleep.awake), borrowed(contacts.sleep.until)
    pairs, result = borrowed(contacts.pairs), borrowed(contacts.result)
    velocity, spin = borrowed(state.linear_velocity), borrowed(state.angular_velocity)
    linear, angular = borrowed(losses.lead[:3]), borrowed(losses.lead[3:])
    position, changes = borrowed(state.position), borrowed(losses.changes)
    stretches, slopes = borrowed(losses.stretch), borrowed(losses.slopes)[0]
    for i in range(first, last):
        p = awake[i]
        if p < 0:
            break
        if until[p] > APART:
            continue
        out = result[p]
        if not out[10] > 0.0:
            for k in range(9):
                changes[p, k] = 0.0
            if losses.friction > 0.0:
                for k in range(4):
                    stretches[p, k] = slopes[p, k] = 0.0
            continue
        for k in range(9):
            changes[p, k] = -out[k]
        s, t = pairs[p, 0], pairs[p, 1]
        va, wa = ahead(velocity, linear, s), ahead(spin, angular, s)
        second = slot_of(contacts.carriers, t)
        vb, wb = ahead(velocity, linear, second), ahead(spin, angular, second)
        size = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
        deepening = depth_rate(out, va, wa, vb, wb)
        # Change of the depth rate by a step h: h c K delta (grad delta)^2 / M.
        bodies = 1.0 if t < 0 else 2.0
        mobility = bodies * inverse_mass * size * size + inverse_inertia * (
            out[3] * out[3] + out[4] * out[4] + out[5] * out[5]
            + out[6] * out[6] + out[7] * out[7] + out[8] * out[8])
        damping = effective_damping(losses.damping, deepening, out[10], losses.lag)
        part = step * damping * contacts.stiffness * mobility / out[10]
        if part > _MOST_DAMPED:
            damping *= _MOST_DAMPED / part
        factor = damping_factor(damping, deepening)
        for k in range(9):
            out[k] *= factor
        if losses.friction > 0.0:
            arm_a, arm_b = arms_of(position, s, t, out)
            radius = patch_radius(out)
            n, slips, turn = slips_of(out, va, wa, arm_a, vb, wb, arm_b, radius, t)
            stiffness, lag = losses.friction_stiffness, losses.lag
            limit = losses.friction * factor * size * contacts.stiffness / stiffness
            before: Four = (stretches[p, 0], stretches[p, 1], stretches[p, 2], stretches[p, 3])
            slope: Four = (slopes[p, 0], slopes[p, 1], slopes[p, 2], slopes[p, 3])
            guess = moved(before, slope, h)
            rate = stretch_rate(guess, pull(guess, slips, lag, n, limit), lag, turn)
            left = moved(moved(before, slope, 0.5 * h), rate, 0.5 * h)
            q = pull(left, slips, lag, n, limit)
            rate = stretch_rate(left, q, lag, turn)
            add_pull(out, q, n, arm_a, arm_b, radius, stiffness / contacts.stiffness)
            for k in range(4):
                stretches[p, k], slopes[p, k] = left[k], rate[k]
        for k in range(9):
            changes[p, k] += out[k]


@compiled
def moved(stretch: Four, rate: Four, h: float) -> Four:
    """Return a stretch after `h` [s] at one rate."""
    return (
        stretch[0] + h * rate[0], stretch[1] + h * rate[1], stretch[2] + h * rate[2],
        stretch[3] + h * rate[3])


@compiled
def ahead(rows: np.ndarray, lead: np.ndarray, s: int) -> Three:
    """Return the extrapolated velocity or spin of slot `s`; 0 for a plane at rest."""
    if s < 0:
        return 0.0, 0.0, 0.0
    return rows[0, s] + lead[0, s], rows[1, s] + lead[1, s], rows[2, s] + lead[2, s]


@compiled
def begin_lead(losses: ContactLosses | None, state: State, s: int) -> None:
    """Store the velocities of a block before the first kick of a step."""
    if losses is not None:
        for k in range(3):
            store(losses.lead, k, s, load(state.linear_velocity, k, s))
            store(losses.lead, k + 3, s, load(state.angular_velocity, k, s))


@compiled
def end_lead(losses: ContactLosses | None, state: State, s: int) -> None:
    """Store the change of the velocities of a block by the first kick of a step."""
    if losses is not None:
        for k in range(3):
            store(losses.lead, k, s, load(state.linear_velocity, k, s) - load(losses.lead, k, s))
            store(losses.lead, k + 3, s, load(
                state.angular_velocity, k, s) - load(losses.lead, k + 3, s))


@compiled
def spend(
    losses: ContactLosses | None, meter: Meter | None, state: State, s: int, h: float
) -> None:
    """
    Add half of the energy that contacts of a block dissipate in a kick of `h` [s] to the meter.

    Called before and after the kick: a kick dissipates exactly its force times the mean of the two
    velocities.
    """
    if losses is None or meter is None:
        return
    power = splat(0.0)
    for k in range(3):
        power = fma(load(losses.lost, k, s), load(state.linear_velocity, k, s), power)
        power = fma(load(losses.lost, k + 3, s), load(state.angular_velocity, k, s), power)
    store(meter.done, 0, s, fma(splat(-0.5 * h), power, load(meter.done, 0, s)))


@compiled
def add_pull(
    out: np.ndarray, q: Four, n: Three, arm_a: Three, arm_b: Three, radius: float, scale: float
) -> None:
    """
    Add force and torques of a stretch q [m] on both bodies, for a contact stiffness of 1 N/m.

    `scale`: stiffness of friction over that of the contact.
    """
    fx, fy, fz, turn = scale * q[0], scale * q[1], scale * q[2], scale * radius * q[3]
    out[0] += fx
    out[1] += fy
    out[2] += fz
    out[3] += arm_a[1] * fz - arm_a[2] * fy + turn * n[0]
    out[4] += arm_a[2] * fx - arm_a[0] * fz + turn * n[1]
    out[5] += arm_a[0] * fy - arm_a[1] * fx + turn * n[2]
    out[6] -= arm_b[1] * fz - arm_b[2] * fy + turn * n[0]
    out[7] -= arm_b[2] * fx - arm_b[0] * fz + turn * n[1]
    out[8] -= arm_b[0] * fy - arm_b[1] * fx + turn * n[2]


@compiled
def arms_of(position: np.ndarray, s: int, t: int, out: np.ndarray) -> tuple[Three, Three]:
    """Return the arms [m] from both centres to the contact point; 0 for a plane (slot below 0)."""
    x, y, z = out[15], out[16], out[17]
    if t < 0:
        return (x, y, z), (0.0, 0.0, 0.0)
    hx = 0.5 * (position[0, t] - position[0, s])
    hy = 0.5 * (position[1, t] - position[1, s])
    hz = 0.5 * (position[2, t] - position[2, s])
    return (x + hx, y + hy, z + hz), (x - hx, y - hy, z - hz)


@compiled
def column(rows: np.ndarray, s: int) -> Three:
    """Return three numbers of slot `s`; 0 for a plane at rest, whose slot is below 0."""
    if s < 0:
        return 0.0, 0.0, 0.0
    return rows[0, s], rows[1, s], rows[2, s]


@compiled
def add_up_taken(losses: ContactLosses, contacts: Contacts, first: int, last: int) -> None:
    """Sum the dissipated powers [W] of pairs at their first bodies, for blocks first to last."""
    before = -1
    for e in range(contacts.start[first], contacts.start[last]):
        s, p, side = contacts.slot[e], contacts.entry[e] >> 1, contacts.entry[e] & 1
        if s != before:
            losses.spent[0, s] = 0.0
        before = s
        if side == 0:
            losses.spent[0, s] += losses.power[p]


@compiled
def add_taken(losses: ContactLosses | None, s: int, spent: Vector) -> Vector:
    """Add the power [W] that contacts dissipate at a block."""
    if losses is None:
        return spent
    else:
        return spent + load(losses.spent, 0, s)


@compiled
def combine_stretches(
    losses: ContactLosses | None, weights: np.ndarray, h: float, again: bool, team: Team
) -> None:
    """
    Write stretches of a stage: those at the start of the step plus h times the sum of w_j slope_j.

    `again`: of the step in progress, which has been taken.
    """
    if losses is None:
        return
    count = losses.stretch.shape[0]
    first, last = own_blocks(team, count)
    begin, slopes = losses.held, losses.slopes
    if again:
        begin = losses.start
    for p in range(first, last):
        for k in range(4):
            total = 0.0
            for j in range(weights.shape[0]):
                total += weights[j] * slopes[j, p, k]
            losses.stage[p, k] = begin[p, k] + h * total


@compiled
def accept_stretches(losses: ContactLosses | None, team: Team) -> None:
    """Accept a step: its stage becomes the state, and the held stretches become its start."""
    if losses is None:
        return
    count = losses.stretch.shape[0]
    first, last = own_blocks(team, count)
    for p in range(first, last):
        for k in range(4):
            losses.start[p, k] = losses.held[p, k]
            losses.stretch[p, k] = losses.stage[p, k]


@compiled
def repeat_stretches(losses: ContactLosses | None, team: Team) -> None:
    """Copy the last slope of a step to the first of the next."""
    if losses is None:
        return
    count = losses.stretch.shape[0]
    first, last = own_blocks(team, count)
    for p in range(first, last):
        for k in range(4):
            losses.slopes[0, p, k] = losses.slopes[_LAST, p, k]


@compiled
def save_stretches(losses: ContactLosses | None, team: Team) -> None:
    """Save the stretches of a sound state."""
    if losses is None:
        return
    count = losses.stretch.shape[0]
    first, last = own_blocks(team, count)
    for p in range(first, last):
        for k in range(4):
            losses.saved[p, k] = losses.stretch[p, k]


@compiled
def stretch_error(
    losses: ContactLosses | None, error_5: np.ndarray, error_3: np.ndarray, scale: float,
    smooth: float, team: Team
) -> tuple[float, float]:
    """
    Return both errors of `step_error` for the stretches in a step of length 1, the largest.

    Squares of lengths are multiplied by `scale`.
    """
    largest, probable = 0.0, 0.0
    if losses is None:
        return largest, probable
    count = losses.stretch.shape[0]
    first, last = own_blocks(team, count)
    for p in range(first, last):
        square_5, square_3 = 0.0, 0.0
        for k in range(4):
            first_sum, second_sum = 0.0, 0.0
            for j in range(error_5.shape[0]):
                value = losses.slopes[j, p, k]
                first_sum += error_5[j] * value
                second_sum += error_3[j] * value
            square_5 += first_sum * first_sum
            square_3 += second_sum * second_sum
        sum_ = max(scale * (square_5 + 0.01 * square_3), 1e-300)
        error = scale * square_5 / math.sqrt(sum_)
        # NaN counts as infinite.
        largest = max(largest, error) if error <= math.inf else math.inf
        probable = max(probable, lane(probable_error(
            splat(scale * square_5), splat(scale * square_3), smooth), 0))
    return largest, probable
