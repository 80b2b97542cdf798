# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Looks at a running state every so many steps.

Is it finite, is the step still safe, does the energy balance, has a body moved far?
"""

import math

from icofabric_sim.kernels.contact.forces import contact_look
from icofabric_sim.kernels.figures import (
    ANCHORS,
    DONE,
    DONE_SIZE,
    DRIVEN,
    FARTHEST,
    FASTEST,
    FIELDS,
    fold_figures,
    GIVEN,
    INSIDE,
    LINKS,
    MOMENTS,
    MOVING,
    note_figures,
    PULLS,
    STIFFEST,
    TAKEN,
    TURNING,
    WEIGHT,
)
from icofabric_sim.kernels.masses import largest_of, units_of
from icofabric_sim.kernels.records import Dipole, Gravity, Loads, Model, State, Team, Work
from icofabric_sim.kernels.rotations import rows_of
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lane_reductions import largest_lane
from icofabric_sim.kernels.runtime.lanes import fma, LANES, load, maximum, splat, store
from icofabric_sim.kernels.runtime.team import own_blocks, wait_for_all
import numpy as np

# Bits of the status that `examine` returns; the rates concern the bound of the largest frequency.
RATE_HIGH, RATE_LOW, NOT_FINITE, UNBALANCED, LIVELIER, ROUGHER, OBSTRUCTING = (
    1, 2, 4, 16, 32, 128, 512)
# Shells that overlap too deeply, and more than they should. Others are in
# kernels/contact/rebuild_check.py.
TOO_DEEP, DEEP = 2048, 4096
# Contacts make more energy swing in a step than may.
SWINGS = 32768
# Not to be saved as a state from which a run can go on.
UNSOUND = NOT_FINITE | UNBALANCED
# Places in the ledger. What a look finds: the rate sqrt(bound) + SPIN_WEIGHT x largest spin
# [rad/s], the largest spin [rad/s], energies [J] and the work [J] of the present loads.
RATE, SPIN, KINETIC, STORED, HEIGHT, WORK = 0, 1, 2, 3, 4, 5
# What is asked of it: RATE_HIGH above, RATE_LOW below, LIVELIER where the kinetic energy [J] is
# above. Where LOW is 0 the bound is coarse as long as that keeps the rate below HIGH.
HIGH, LOW, SPIN_WEIGHT, LIVELY = 6, 7, 8, 9
# The balance: energy less work and with what was spent at the start, height at the start [J],
# the largest sum of the magnitudes of what moves, was exchanged or was done [J], the largest error
# beside the scale, the present error [J] and the part of the scale that is allowed.
BASE, BASE_HEIGHT, SCALE, WORST, ERROR, LIMIT = 10, 11, 12, 13, 14, 15
# Work of loads before the present ones [J], and steps of this call when the state was saved.
EARLIER_WORK, SAVED_AT = 16, 17
# How rough the motion was just before the look (-1: not known), ROUGHER where that is above; steps
# of one length until now; 1 / a^2 [1/m^2].
# The roughest so far since the last look.
ROUGH, ROUGH_LIMIT, REGULAR, INVERSE_SIZE, ROUGHEST = 18, 19, 20, 21, 22
# What forces that depend on velocities have taken from the motion [J].
SPENT = 23
# Energy lost where connectors broke [J].
LOST = 24
# Ends of connectors that are in the shells they are attached to; OBSTRUCTING where that is more.
OBSTRUCTED, OBSTRUCTED_LIMIT = 25, 26
# Looks until connectors in shells are looked for again, and from one of these to the next.
UNTIL_OBSTRUCTED, OBSTRUCTED_EVERY = 27, 28
# Energy of contacts [J], which STORED includes, their number, the deepest overlap at a look [m],
# the deepest at any so far; TOO_DEEP above this [m], and DEEP above that.
CONTACT, TOUCHING, DEEPEST, DEEPEST_EVER, DEEPEST_LIMIT, TOLD_LIMIT = 29, 30, 31, 32, 33, 34
# What contacts that may happen before the next look add to the squared frequency [1/s^2] at most.
CONTACT_RATE = 35
# Energies of connectors, of moments and ways around shells, of charges and dipoles, and of anchors
# [J]; what these and the contacts had at the start; the magnitudes of all work [J].
LINKED, BENT, FIELD, ANCHORED = 36, 37, 38, 39
BASE_LINKED, BASE_BENT, BASE_FIELD, BASE_ANCHORED, BASE_CONTACT, WORKED = 40, 41, 42, 43, 44, 45
# Sum of the tensions' magnitudes [N], the largest coordinate [m], the number of bodies, the part
# of a number that counts as rounding; from them the energy that rounding may make [J], at most so
# far. What the tolerance may make of it [J]; looks so far.
TENSIONS, EXTENT, BODIES, ROUNDING, NOISE, FLOOR, LOOKS = 46, 47, 48, 49, 50, 51, 52
# Where steps run through contacts: the largest energy [J] that swung in a step because of them
# (kernels/contact/stiffness.py), the part of the scale up to which it may (inf: it is not asked
# for), and the part of the longest step that is left because of that.
SWING, SWING_LIMIT, SWING_PART = 53, 54, 55
# Roughness at the last check that knew it, its sum over steps, and steps not yet part of the sum.
STEADY_ROUGH, ROUGH_SUM, UNCOUNTED = 56, 57, 58
LEDGER_COUNT = 59
# Evaluations of the forces between two looks, or somewhat more: each rounds places once.
_ROUNDINGS = 100.0


@compiled
def examine(
    model: Model, loads: Loads, state: State, work: Work, time: float, ledger: np.ndarray
) -> int:
    """
    Status bits of the state at `time` [s], and its figures into `ledger`.

    Its attachment points are in place.
    """
    blocks = model.blocks.slot.shape[0]
    note_figures(
        model, loads, state, work, time, coarse_up_to(ledger), looks_inside(ledger), 0,
        work.figures.shape[0] - 1, blocks)
    return conclude(model, state, work.figures, ledger)


@compiled
def note_own(
    model: Model, loads: Loads, state: State, work: Work, team: Team, time: float,
    ledger: np.ndarray
) -> None:
    """Have a thread note its share of the figures; all have been noted at the end."""
    first, last = own_blocks(team, work.figures.shape[0] - 1)
    note_figures(
        model, loads, state, work, time, coarse_up_to(ledger), looks_inside(ledger), first, last,
        model.blocks.slot.shape[0])
    wait_for_all(team)


@compiled
def coarse_up_to(ledger: np.ndarray) -> float:
    """
    Squared frequency [1/s^2] of a body up to which a coarse bound will do; below 0: none.

    So that the next look finds RATE_HIGH only where the close bound does, as long as the spin has
    not grown by a quarter since the last one.
    """
    left = ledger[HIGH] - 1.25 * ledger[SPIN_WEIGHT] * ledger[SPIN]
    if ledger[LOW] > 0.0 or not left > 0.0:
        return -1.0
    return left * left - ledger[CONTACT_RATE]


@compiled
def looks_inside(ledger: np.ndarray) -> bool:
    """Whether the next look counts the connectors that are in shells."""
    return ledger[UNTIL_OBSTRUCTED] <= 1.0


@compiled
def conclude(
    model: Model, state: State, figures: np.ndarray, ledger: np.ndarray
) -> int:
    """
    Status bits of a state whose `figures` have been noted, and what they come to into `ledger`.

    The figures are of all groups (kernels/figures.py); contacts are added up here.
    """
    totals = fold_figures(figures)
    mass, inertia = units_of(model.masses, model.inverse_mass, model.inverse_inertia)
    ledger[SPIN] = math.sqrt(totals[FASTEST])
    rate = math.sqrt(totals[STIFFEST] + ledger[CONTACT_RATE])
    ledger[RATE] = rate + ledger[SPIN_WEIGHT] * ledger[SPIN]
    ledger[KINETIC] = 0.5 * mass * totals[MOVING] + 0.5 * inertia * totals[TURNING]
    ledger[CONTACT], ledger[DEEPEST], ledger[TOUCHING] = contact_look(model.contacts, state)
    ledger[DEEPEST_EVER] = max(ledger[DEEPEST_EVER], ledger[DEEPEST])
    ledger[LINKED], ledger[BENT] = totals[LINKS], totals[MOMENTS]
    ledger[FIELD], ledger[ANCHORED] = totals[FIELDS], totals[ANCHORS]
    ledger[STORED] = ledger[LINKED] + ledger[BENT] + ledger[FIELD] + ledger[ANCHORED]
    ledger[STORED] += ledger[CONTACT]
    ledger[HEIGHT] = -mass * totals[WEIGHT]
    ledger[TENSIONS], ledger[EXTENT] = totals[PULLS], totals[FARTHEST]
    # What driven bodies move with is work of their drives too.
    ledger[WORK] = ledger[EARLIER_WORK] + totals[DRIVEN]
    ledger[WORKED] = abs(ledger[WORK]) + totals[DONE_SIZE] + abs(totals[GIVEN])
    ledger[WORK] += totals[DONE] + totals[GIVEN]
    ledger[SPENT] = totals[TAKEN]
    status = balance(ledger)
    if status != NOT_FINITE:
        status |= judge_balance(model, ledger, rate)
    if not ledger[RATE] <= ledger[HIGH]:
        status |= RATE_HIGH
    if ledger[RATE] < ledger[LOW]:
        status |= RATE_LOW
    if ledger[KINETIC] > ledger[LIVELY]:
        status |= LIVELIER
    ledger[UNTIL_OBSTRUCTED] -= 1.0
    if ledger[UNTIL_OBSTRUCTED] <= 0.0:
        ledger[UNTIL_OBSTRUCTED] = ledger[OBSTRUCTED_EVERY]
        ledger[OBSTRUCTED] = totals[INSIDE]
        if ledger[OBSTRUCTED] > ledger[OBSTRUCTED_LIMIT]:
            status |= OBSTRUCTING
    if ledger[DEEPEST] > ledger[DEEPEST_LIMIT]:
        status |= TOO_DEEP
    if ledger[DEEPEST] > ledger[TOLD_LIMIT]:
        status |= DEEP
    return status


@compiled
def sample(
    slot: np.ndarray, position: np.ndarray, orientation: np.ndarray, difference: np.ndarray,
    weights: np.ndarray, number: int
) -> None:
    """
    Add the positions and orientations at a step end to a difference of high order.

    With weights (-1)^k n! / (k! (n - k)!) the n-th difference of a vibration of frequency w is
    its amplitude times (w h)^n: what a method of order n errs by, but for a factor that stays.
    """
    weight = splat(weights[number])
    samples = difference.shape[1] // LANES
    count = slot.shape[0]
    turn = rows_of(orientation)
    for i in range(samples):
        s = slot[i * count // samples]
        at = LANES * i
        for k in range(3 + turn.shape[0]):
            if k < 3:
                value = load(position, k, s)
            else:
                value = load(turn, k - 3, s)
            value = weight * value
            if number > 0:
                value = value + load(difference, k, at)
            store(difference, k, at, value)


@compiled
def roughness(work: Work, ledger: np.ndarray) -> float:
    """The largest difference of a body: of its position over a, or of its orientation in rad."""
    difference = work.difference
    largest = splat(0.0)
    # A small rotation by x changes the quaternion by x / 2, the cosines by sqrt(2) x.
    turned = splat(4.0 if difference.shape[0] == 7 else 0.5)
    size = splat(ledger[INVERSE_SIZE])
    for i in range(difference.shape[1] // LANES):
        shift, turn = splat(0.0), splat(0.0)
        for k in range(difference.shape[0]):
            value = load(difference, k, LANES * i)
            if k < 3:
                shift = fma(value, value, shift)
            else:
                turn = fma(value, value, turn)
        largest = maximum(maximum(size * shift, turned * turn), largest)
    return math.sqrt(largest_lane(largest))


@compiled
def judge_roughness(work: Work, ledger: np.ndarray, interval: int) -> int:
    """
    ROUGHER where the motion has become so; needs a whole difference of steps of one length.

    After `interval` steps in which none came to its end what was known stays.
    """
    roughest, steady = ledger[ROUGHEST], ledger[STEADY_ROUGH]
    ledger[ROUGHEST] = 0.0
    count, ledger[UNCOUNTED] = ledger[UNCOUNTED], 0.0
    differences = work.weights.shape[0] - 1
    if differences < 1 or ledger[REGULAR] < differences:
        ledger[ROUGH] = -1.0
        ledger[ROUGH_SUM] += steady * count
        return 0
    before = max(ledger[REGULAR] - interval, 0.0)
    if ledger[REGULAR] // differences == before // differences:
        ledger[ROUGH_SUM] += steady * count
        return 0
    # At least what was expected, so that a sum that is shown never falls.
    ledger[ROUGH_SUM] += max(steady, 0.5 * (steady + roughest)) * count
    ledger[STEADY_ROUGH] = ledger[ROUGH] = roughest
    return ROUGHER if ledger[ROUGH] > ledger[ROUGH_LIMIT] else 0


@compiled
def gravity_size(gravity: Gravity | None) -> float:
    """Magnitude of gravity [m/s^2]."""
    if gravity is None:
        return 0.0
    g = gravity.acceleration
    return math.sqrt(g[0] ** 2 + g[1] ** 2 + g[2] ** 2)


@compiled
def dipole_size(dipole: Dipole | None) -> float:
    """Largest energy [J] of a dipole in the field, over two."""
    if dipole is None:
        return 0.0
    else:
        return dipole.largest


@compiled
def balance(ledger: np.ndarray) -> int:
    """
    Compare all energy, less the work done and with what was spent, with what it was at the start.

    The scale is a sum of magnitudes, in which nothing cancels: kinetic energy, work, what was
    spent and lost, and the change of every potential energy, as where these are zero means nothing
    (tables, weight, charges), or only what the fabric is held with (pre-stress).
    """
    total = ledger[KINETIC] + ledger[STORED] + ledger[HEIGHT]
    if not math.isfinite(total + ledger[WORKED] + ledger[SPENT]):
        return NOT_FINITE
    changed = abs(ledger[LINKED] - ledger[BASE_LINKED]) + abs(ledger[BENT] - ledger[BASE_BENT])
    changed += abs(ledger[FIELD] - ledger[BASE_FIELD])
    changed += abs(ledger[ANCHORED] - ledger[BASE_ANCHORED])
    changed += abs(ledger[CONTACT] - ledger[BASE_CONTACT])
    changed += abs(ledger[HEIGHT] - ledger[BASE_HEIGHT])
    done = ledger[WORKED] + abs(ledger[SPENT]) + abs(ledger[LOST])
    ledger[SCALE] = max(ledger[SCALE], ledger[KINETIC] + changed + done)
    ledger[ERROR] = total - ledger[WORK] + ledger[SPENT] + ledger[LOST] - ledger[BASE]
    return 0


@compiled
def judge_balance(model: Model, ledger: np.ndarray, rate: float) -> int:
    """
    UNBALANCED where the error is more than allowed, and more than rounding and tolerance may make.

    `rate` [rad/s] bounds the fastest motion.
    """
    ledger[LOOKS] += 1.0
    noise = rounding_energy(model, ledger, rate)
    if noise < math.inf:
        ledger[NOISE] = max(ledger[NOISE], noise)
    scale = least_scale(ledger)
    if scale > 0.0:
        ledger[WORST] = max(ledger[WORST], abs(ledger[ERROR]) / scale)
        if abs(ledger[ERROR]) > ledger[LIMIT] * scale:
            return UNBALANCED
    return 0


@compiled
def least_scale(ledger: np.ndarray) -> float:
    """Scale [J] of the balance: so large that what rounding and tolerance make is allowed."""
    if not ledger[LIMIT] > 0.0:
        return ledger[SCALE]
    return max(ledger[SCALE], (ledger[NOISE] + ledger[FLOOR]) / ledger[LIMIT])


@compiled
def rounding_energy(model: Model, ledger: np.ndarray, rate: float) -> float:
    """
    Energy [J] that rounding may make, or hide.

    A place is known to u times its largest coordinate X, with u = ledger[ROUNDING], an orientation
    to u. So tensions f make f u X of each connector. Energies E that are never negative and whose
    second derivative by mass-scaled coordinates y is at most W^2, W = `rate`, have a slope of at
    most W sqrt(2 E), and make W sqrt(2 E) |dy| + W^2 |dy|^2 / 2, with |dy|^2 = u^2 (M X^2 +
    Lambda) for each body; the last part again in each step. Sums are rounded themselves.
    """
    u, bodies = ledger[ROUNDING], ledger[BODIES]
    # Attachment points and contacts are beside the centres.
    extent = ledger[EXTENT] + 2.0 / math.sqrt(max(ledger[INVERSE_SIZE], 1e-300))
    mass, inertia = largest_of(model.masses, model.inverse_mass, model.inverse_inertia)
    displaced = u * math.sqrt(bodies * (mass * extent * extent + inertia))
    others = abs(ledger[BENT]) + abs(ledger[FIELD]) + abs(ledger[ANCHORED]) + ledger[CONTACT]
    held = mass * gravity_size(model.gravity) * extent + dipole_size(model.dipole)
    summed = abs(ledger[LINKED]) + others + bodies * held + ledger[KINETIC] + ledger[WORKED]
    return u * (extent * ledger[TENSIONS] + math.sqrt(bodies) * summed) + (
        rate * displaced * math.sqrt(2.0 * others)) + (
        0.5 * (1.0 + _ROUNDINGS * ledger[LOOKS]) * (rate * displaced) ** 2)


@compiled
def save(model: Model, state: State, saved: State, first: int, last: int) -> None:
    """Copy the state of blocks first to last."""
    for block in range(first, last):
        s = model.blocks.slot[block]
        for k in range(3):
            store(saved.position, k, s, load(state.position, k, s))
            store(saved.linear_velocity, k, s, load(state.linear_velocity, k, s))
            store(saved.angular_velocity, k, s, load(state.angular_velocity, k, s))
        if state.orientation.ndim == 2:
            for k in range(4):
                store(saved.orientation, k, s, load(state.orientation, k, s))
        else:
            for i in range(3):
                for k in range(3):
                    store(saved.orientation[i], k, s, load(state.orientation[i], k, s))
        save_rest(state.rest, saved.rest, s)


@compiled
def save_rest(rest: np.ndarray | None, saved: np.ndarray | None, s: int) -> None:
    """Copy the rest lengths of Maxwell arms of a block."""
    if rest is None:
        return
    if saved is None:
        return
    for k in range(rest.shape[0]):
        store(saved, k, s, load(rest, k, s))
