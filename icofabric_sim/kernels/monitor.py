# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Health checks of a running state, at regular numbers of steps.

A check tests that the state is finite, the step is safe, and the energy balances. It also measures
how rough the motion is.
"""

import math

from icofabric_sim.kernels.figures import (
    ANCHORS,
    DISSIPATED,
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
    TURNING,
    WEIGHT,
)
from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.kernels.rotations import rows_of
from icofabric_sim.kernels.runtime.compiled import compiled, in_python
from icofabric_sim.kernels.runtime.lane_reductions import largest_lane
from icofabric_sim.kernels.runtime.lanes import fma, LANES, load, maximum, splat, store
from icofabric_sim.terms.contacts.force import contact_look
from icofabric_sim.terms.contacts.record import Contacts
import numpy as np

# Bits of the status that `examine` returns; the rates concern the bound of the largest frequency.
RATE_HIGH, RATE_LOW, NOT_FINITE, UNBALANCED, KINETIC_HIGH, ROUGHER, OBSTRUCTING = (
    1, 2, 4, 16, 32, 128, 512)
# Shells that overlap too deeply, and more than they should. Others are in
# terms/contacts/rebuild_check.py.
TOO_DEEP, DEEP = 2048, 4096
# More energy oscillates within a step because of contacts than the limit allows.
SWINGS = 32768
# A state with these bits must not be saved for a restart.
UNSOUND = NOT_FINITE | UNBALANCED
# Indices in the ledger. Results of a check: the rate sqrt(bound) + SPIN_WEIGHT x largest spin
# [rad/s], the largest spin [rad/s], energies [J] and the work [J] of the present loads.
RATE, SPIN, KINETIC, STORED, HEIGHT, WORK = 0, 1, 2, 3, 4, 5
# Limits: RATE_HIGH above HIGH, RATE_LOW below LOW, KINETIC_HIGH if the kinetic energy [J] is above
# LIVELY. If LOW is 0, the bound is coarse as long as the rate stays below HIGH.
HIGH, LOW, SPIN_WEIGHT, LIVELY = 6, 7, 8, 9
# Balance: energy less work plus dissipated energy at the start [J], energy of the height at the
# start [J], the scale [J] (largest sum of the magnitudes of kinetic energy, changes and work), the
# largest error over the scale, the present error [J] and the largest allowed ratio.
BASE, BASE_HEIGHT, SCALE, WORST, ERROR, LIMIT = 10, 11, 12, 13, 14, 15
# Work of loads before the present ones [J], and steps of this call when the state was saved.
EARLIER_WORK, SAVED_AT = 16, 17
# Roughness of the motion just before the check (-1: not known), ROUGHER above the limit; number of
# steps of one length until now; 1 / a^2 [1/m^2]; largest roughness since the last check.
ROUGH, ROUGH_LIMIT, REGULAR, INVERSE_SIZE, ROUGHEST = 18, 19, 20, 21, 22
# Energy dissipated by velocity-dependent forces [J].
SPENT = 23
# Energy lost where connectors broke [J].
LOST = 24
# Ends of connectors inside the shells they are attached to; OBSTRUCTING above the limit.
OBSTRUCTED, OBSTRUCTED_LIMIT = 25, 26
# Checks until connectors inside shells are counted again, and the interval between two counts.
UNTIL_OBSTRUCTED, OBSTRUCTED_EVERY = 27, 28
# Energy of contacts [J], which STORED includes, their number, the deepest overlap at this check
# and at any check so far [m]; limits [m] for TOO_DEEP and for DEEP.
CONTACT, TOUCHING, DEEPEST, DEEPEST_EVER, DEEPEST_LIMIT, TOLD_LIMIT = 29, 30, 31, 32, 33, 34
# Bound of what contacts before the next check add to the squared frequency [1/s^2].
CONTACT_RATE = 35
# Energies [J] of connectors, of moments and connectors wrapped over shells, of charges and
# dipoles, and of anchors; their values and that of contacts at the start; magnitudes of all work.
LINKED, BENT, FIELD, ANCHORED = 36, 37, 38, 39
BASE_LINKED, BASE_BENT, BASE_FIELD, BASE_ANCHORED, BASE_CONTACT, WORKED = 40, 41, 42, 43, 44, 45
# Sum of the tensions' magnitudes [N], the largest coordinate [m], the number of bodies, the
# relative rounding error; from them the largest energy error of rounding so far [J]. Energy error
# of the tolerance [J]; number of checks so far.
TENSIONS, EXTENT, BODIES, ROUNDING, NOISE, FLOOR, CHECK_COUNT = 46, 47, 48, 49, 50, 51, 52
# For steps through contacts: the largest energy [J] that oscillated within a step because of them
# (terms/contacts/stiffness.py), its limit relative to the scale (inf: not measured), and the
# fraction of the longest step that remains after the limit was exceeded.
SWING, SWING_LIMIT, SWING_PART = 53, 54, 55
# Roughness at the last check that measured it, its sum over steps, and steps not yet in the sum.
STEADY_ROUGH, ROUGH_SUM, PENDING_STEPS = 56, 57, 58
# Constants of the scene: factors of the sums that masses [kg] and inertias [kg m^2] weight, the
# largest of each, and largest energies of weight [J/(kg m)] and dipoles [J].
MASS, INERTIA, LARGEST_MASS, LARGEST_INERTIA, GRAVITY, DIPOLE = 59, 60, 61, 62, 63, 64
LEDGER_COUNT = 65
# Evaluations of the forces between two checks, or somewhat more: each rounds positions once.
_ROUNDINGS = 100.0


def examine(
    model: Model, loads: Loads, state: State, work: Work, time: float, ledger: np.ndarray
) -> int:
    """
    Return the status bits of the state at `time` [s]; write its figures into `ledger`.

    The attachment points are in place. The kernels are those that steps call by address.
    """
    note_figures(
        model, loads, state, work, time, float(in_python(coarse_up_to)(ledger)),
        bool(in_python(looks_inside)(ledger)), 0, len(work.figures) - 1, len(model.blocks.slot))
    return judge(model.contacts, state, work.figures, ledger)


def judge(
    contacts: Contacts | None, state: State, figures: np.ndarray, ledger: np.ndarray
) -> int:
    """Return the status bits of a state with known `figures`; write the results into `ledger`."""
    in_python(forget_contacts)(ledger)
    if contacts is not None:
        add_contacts(contacts, state.position, state.orientation, ledger)
    return conclude(figures, ledger)


@compiled
def forget_contacts(ledger: np.ndarray) -> None:
    """Let there be no contacts."""
    ledger[CONTACT] = ledger[DEEPEST] = ledger[TOUCHING] = 0.0


@compiled
def add_contacts(
    contacts: Contacts, position: np.ndarray, orientation: np.ndarray, ledger: np.ndarray
) -> None:
    """Write energy [J], deepest overlap [m] and number of the contacts into `ledger`."""
    ledger[CONTACT], ledger[DEEPEST], ledger[TOUCHING] = contact_look(
        contacts, position, orientation)


@compiled
def coarse_up_to(ledger: np.ndarray) -> float:
    """
    Return the squared frequency [1/s^2] up to which a coarse bound suffices; negative: none.

    The next check then finds RATE_HIGH only if the close bound does, unless the spin has grown by
    more than a quarter since the last check.
    """
    left = ledger[HIGH] - 1.25 * ledger[SPIN_WEIGHT] * ledger[SPIN]
    if ledger[LOW] > 0.0 or not left > 0.0:
        return -1.0
    return left * left - ledger[CONTACT_RATE]


@compiled
def looks_inside(ledger: np.ndarray) -> bool:
    """Check that the next health check counts the connectors inside shells."""
    return ledger[UNTIL_OBSTRUCTED] <= 1.0


@compiled
def conclude(figures: np.ndarray, ledger: np.ndarray) -> int:
    """
    Return the status bits of a state with known `figures`; write the results into `ledger`.

    The figures are of all groups (kernels/figures.py); those of contacts are in the ledger. It is
    the same kernel for all scenes.
    """
    totals = fold_figures(figures)
    mass, inertia = ledger[MASS], ledger[INERTIA]
    ledger[SPIN] = math.sqrt(totals[FASTEST])
    rate = math.sqrt(totals[STIFFEST] + ledger[CONTACT_RATE])
    ledger[RATE] = rate + ledger[SPIN_WEIGHT] * ledger[SPIN]
    ledger[KINETIC] = 0.5 * mass * totals[MOVING] + 0.5 * inertia * totals[TURNING]
    ledger[DEEPEST_EVER] = max(ledger[DEEPEST_EVER], ledger[DEEPEST])
    ledger[LINKED], ledger[BENT] = totals[LINKS], totals[MOMENTS]
    ledger[FIELD], ledger[ANCHORED] = totals[FIELDS], totals[ANCHORS]
    ledger[STORED] = ledger[LINKED] + ledger[BENT] + ledger[FIELD] + ledger[ANCHORED]
    ledger[STORED] += ledger[CONTACT]
    ledger[HEIGHT] = -mass * totals[WEIGHT]
    ledger[TENSIONS], ledger[EXTENT] = totals[PULLS], totals[FARTHEST]
    # The kinetic energy of driven bodies is work of their drives too.
    ledger[WORK] = ledger[EARLIER_WORK] + totals[DRIVEN]
    ledger[WORKED] = abs(ledger[WORK]) + totals[DONE_SIZE] + abs(totals[GIVEN])
    ledger[WORK] += totals[DONE] + totals[GIVEN]
    ledger[SPENT] = totals[DISSIPATED]
    status = balance(ledger)
    if status != NOT_FINITE:
        status |= judge_balance(ledger, rate)
    if not ledger[RATE] <= ledger[HIGH]:
        status |= RATE_HIGH
    if ledger[RATE] < ledger[LOW]:
        status |= RATE_LOW
    if ledger[KINETIC] > ledger[LIVELY]:
        status |= KINETIC_HIGH
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

    With weights (-1)^k n! / (k! (n - k)!) the n-th difference of a vibration of frequency w is its
    amplitude times (w h)^n. A method of order n has this error, up to a constant factor.
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
    """
    Return the largest difference of a body: of its position over a, or of its orientation [rad].
    """
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
    Return ROUGHER if the motion is rougher than the limit, else 0.

    The roughness is known after a complete difference of steps of one length. If no difference was
    completed within `interval` steps, the previous value stays.
    """
    roughest, steady = ledger[ROUGHEST], ledger[STEADY_ROUGH]
    ledger[ROUGHEST] = 0.0
    count, ledger[PENDING_STEPS] = ledger[PENDING_STEPS], 0.0
    differences = work.weights.shape[0] - 1
    if differences < 1 or ledger[REGULAR] < differences:
        ledger[ROUGH] = -1.0
        ledger[ROUGH_SUM] += steady * count
        return 0
    before = max(ledger[REGULAR] - interval, 0.0)
    if ledger[REGULAR] // differences == before // differences:
        ledger[ROUGH_SUM] += steady * count
        return 0
    # At least the expected value, so that the displayed sum never falls.
    ledger[ROUGH_SUM] += max(steady, 0.5 * (steady + roughest)) * count
    ledger[STEADY_ROUGH] = ledger[ROUGH] = roughest
    return ROUGHER if ledger[ROUGH] > ledger[ROUGH_LIMIT] else 0


@compiled
def balance(ledger: np.ndarray) -> int:
    """
    Compare the total energy, corrected for work and dissipated energy, with that at the start.

    The scale is a sum of magnitudes without cancellation: kinetic energy, work, dissipated and
    lost energy, and the change of every potential energy. Only changes of potential energies count
    because their zeros are arbitrary (tables, weight, charges) or include pre-stress.
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
def judge_balance(ledger: np.ndarray, rate: float) -> int:
    """
    Return UNBALANCED if the error exceeds the limit and the error of rounding and tolerance.

    `rate` [rad/s] bounds the fastest motion.
    """
    ledger[CHECK_COUNT] += 1.0
    noise = rounding_energy(ledger, rate)
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
    """
    Return the scale [J] of the balance, large enough to allow errors of rounding and tolerance.
    """
    if not ledger[LIMIT] > 0.0:
        return ledger[SCALE]
    return max(ledger[SCALE], (ledger[NOISE] + ledger[FLOOR]) / ledger[LIMIT])


@compiled
def rounding_energy(ledger: np.ndarray, rate: float) -> float:
    """
    Return the energy [J] that rounding may add or hide.

    A position is exact to u times its largest coordinate X, with u = ledger[ROUNDING], an
    orientation to u. So tensions f contribute f u X of each connector. Energies E that are never
    negative and whose second derivative by mass-scaled coordinates y is at most W^2, W = `rate`,
    have a slope of at most W sqrt(2 E). They contribute W sqrt(2 E) |dy| + W^2 |dy|^2 / 2, with
    |dy|^2 = u^2 (M X^2 + Lambda) for each body; the last term again in each step. Sums are rounded
    as well.
    """
    u, bodies = ledger[ROUNDING], ledger[BODIES]
    # Attachment points and contacts are farther out than the centres.
    extent = ledger[EXTENT] + 2.0 / math.sqrt(max(ledger[INVERSE_SIZE], 1e-300))
    mass, inertia = ledger[LARGEST_MASS], ledger[LARGEST_INERTIA]
    displaced = u * math.sqrt(bodies * (mass * extent * extent + inertia))
    others = abs(ledger[BENT]) + abs(ledger[FIELD]) + abs(ledger[ANCHORED]) + ledger[CONTACT]
    held = mass * ledger[GRAVITY] * extent + ledger[DIPOLE]
    summed = abs(ledger[LINKED]) + others + bodies * held + ledger[KINETIC] + ledger[WORKED]
    return u * (extent * ledger[TENSIONS] + math.sqrt(bodies) * summed) + (
        rate * displaced * math.sqrt(2.0 * others)) + (
        0.5 * (1.0 + _ROUNDINGS * ledger[CHECK_COUNT]) * (rate * displaced) ** 2)


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
