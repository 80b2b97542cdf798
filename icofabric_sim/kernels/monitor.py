# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Looks at a running state every so many steps.

Is it finite, is the step still safe, does the energy balance, has a body moved far?
"""

import math
from typing import Any

from icofabric_sim.kernels.anchors import anchor_look
from icofabric_sim.kernels.connectors import arm_of, slope_of
from icofabric_sim.kernels.contact.forces import contact_look
from icofabric_sim.kernels.drives import energy_of_drives
from icofabric_sim.kernels.fields import field_parts
from icofabric_sim.kernels.gyration import turning_square
from icofabric_sim.kernels.law_tables import tabled_energy, tabled_pull
from icofabric_sim.kernels.masses import largest_of, units_of, weights_of
from icofabric_sim.kernels.maxwell import maxwell_look
from icofabric_sim.kernels.meters import flowed
from icofabric_sim.kernels.moment_bounds import bending_look, twisting_look
from icofabric_sim.kernels.obstruction import obstructed_lanes
from icofabric_sim.kernels.records import (
    Dipole,
    Gravity,
    LawTables,
    Links,
    Loads,
    Model,
    State,
    Variety,
    Work,
    Wrapping,
)
from icofabric_sim.kernels.rotations import rows_of
from icofabric_sim.kernels.runtime.compiled import compiled, inlined
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fabs,
    fma,
    lane,
    LANES,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    sqrt,
    store,
    Vector,
    where,
)
from icofabric_sim.kernels.wrap.forces import wrapping_look
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
# above.
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
LEDGER_COUNT = 56
# Evaluations of the forces between two looks, or somewhat more: each rounds places once.
_ROUNDINGS = 100.0

Row = tuple[Vector, Vector, Vector, Vector, Vector, Vector]
Block = tuple[Row, Row, Row, Row, Row, Row]


@compiled
def largest_lane(value: Vector) -> float:
    """Largest number of a vector; infinite where one is not a number."""
    largest = 0.0
    for i in range(LANES):
        number = lane(value, i)
        if not number <= largest:
            largest = number if number == number else math.inf
    return largest


@compiled
def sum_of_lanes(value: Vector) -> float:
    """Sum of the numbers of a vector."""
    total = 0.0
    for i in range(LANES):
        total += lane(value, i)
    return total


@compiled
def block_bound(
    links: Links | None, inverse_mass: float, inverse_inertia: float, points: np.ndarray,
    position: np.ndarray, block: int, s: int
) -> tuple[Vector, Vector, Vector]:
    """
    Bound of the squared frequency [1/s^2] for each body of a block; connector energy and tension.

    The second variation of a connector's energy for small motions (dx, dtheta) of its two bodies
    is k (n.du)^2 + f/l |P du|^2 + moments of f, with du = du_2 - du_1 and
    du_i = dx_i + dtheta_i x s_i. From (x - y)^2 <= 2 x^2 + 2 y^2 it is at most the sum over both
    ends of 2 k (n.du_i)^2 + 2 max(f/l, 0) |du_i|^2 + |f| |s| |dtheta_i|^2, a block-diagonal form:
    its largest eigenvalue, in mass-scaled coordinates, bounds that of the fabric. Each 6 x 6
    block is bounded by the largest absolute row sum of its square. In the woven rest state the
    bound is close, because neighbours that move against each other make (x - y)^2 =
    2 x^2 + 2 y^2. Half of each connector's energy [J] and of the magnitude of its tension [N]
    counts for either end.
    """
    zero = splat(0.0)
    energy = zero
    if links is None:
        return zero, energy, zero
    else:
        root_m, root_i = math.sqrt(inverse_mass), math.sqrt(inverse_inertia)
        stride = position.shape[1]
        square = links.half_width ** 2
        stiffness, minus_rest = splat(links.stiffness), splat(-links.natural_length)
        # |du_i|^2 <= (|dx| + |s| |dtheta|)^2 <= (1/m + s^2/Lambda) |y|^2 by Cauchy and Schwarz,
        # y mass-scaled.
        spread = splat(2.0 * (inverse_mass + square * inverse_inertia))
        moment = splat(links.half_width * inverse_inertia)
        tension, pulls = zero, zero
        b00, b01, b02, b03, b04, b05 = zero, zero, zero, zero, zero, zero
        b11, b12, b13, b14, b15, b22 = zero, zero, zero, zero, zero, zero
        b23, b24, b25, b33, b34, b35 = zero, zero, zero, zero, zero, zero
        b44, b45, b55 = zero, zero, zero
        for edge in range(6):
            at = 3 * edge * stride + s
            px, py = load_at(points, at), load_at(points, at + stride)
            pz = load_at(points, at + 2 * stride)
            sx, sy, sz = arm_of(links.attachment, points, position, edge, s)
            sx, sy, sz = sx * splat(root_i), sy * splat(root_i), sz * splat(root_i)
            for link in range(2 * edge, 2 * edge + 2):
                place = links.place[block, link]
                there = bits(links.present[block, link])
                ux = load_at(points, place) - px
                uy = load_at(points, place + stride) - py
                uz = load_at(points, place + 2 * stride) - pz
                squared = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(1e-300))
                inverse = where(there, rsqrt(squared), zero)
                stretch, pull, root_k = bound_parts(
                    links.variety, link, s, squared, inverse, stiffness, minus_rest)
                pull = tabled_pull(
                    links.tables, links.variety, link, s, squared * inverse, pull)
                stretch, pull = where(there, stretch, zero), where(there, pull, zero)
                energy = stored_part(
                    links.tables, links.variety, link, s, there, squared * inverse, stretch, pull,
                    energy)
                tension = fma(maximum(pull, zero), inverse, tension)
                pulls = pulls + fabs(pull)
                weight = inverse * root_k
                nx, ny, nz = ux * weight, uy * weight, uz * weight
                r0, r1, r2 = nx * splat(root_m), ny * splat(root_m), nz * splat(root_m)
                r3, r4, r5 = sy * nz - sz * ny, sz * nx - sx * nz, sx * ny - sy * nx
                b00, b01, b02 = fma(r0, r0, b00), fma(r0, r1, b01), fma(r0, r2, b02)
                b03, b04, b05 = fma(r0, r3, b03), fma(r0, r4, b04), fma(r0, r5, b05)
                b11, b12, b13 = fma(r1, r1, b11), fma(r1, r2, b12), fma(r1, r3, b13)
                b14, b15, b22 = fma(r1, r4, b14), fma(r1, r5, b15), fma(r2, r2, b22)
                b23, b24, b25 = fma(r2, r3, b23), fma(r2, r4, b24), fma(r2, r5, b25)
                b33, b34, b35 = fma(r3, r3, b33), fma(r3, r4, b34), fma(r3, r5, b35)
                b44, b45, b55 = fma(r4, r4, b44), fma(r4, r5, b45), fma(r5, r5, b55)
        block_rows = (
            (b00, b01, b02, b03, b04, b05), (b01, b11, b12, b13, b14, b15),
            (b02, b12, b22, b23, b24, b25), (b03, b13, b23, b33, b34, b35),
            (b04, b14, b24, b34, b44, b45), (b05, b15, b25, b35, b45, b55))
        largest = largest_of_block(block_rows)
        # Where connectors have their own laws, the roots of their stiffnesses are in the sums.
        twice = splat(2.0 * links.stiffness if links.variety is None else 2.0)
        bound = fma(twice, largest, fma(spread, tension, moment * pulls))
        share = 0.25 * links.stiffness if links.variety is None else 0.25
        return bound, energy * splat(share), splat(0.5) * pulls


@inlined
def largest_of_block(rows: Block) -> Vector:
    """
    Bound of the largest eigenvalue of a symmetric block B: the root of that of B B.

    A largest absolute row sum bounds every eigenvalue; of the square it is closer to the largest,
    as the others count less: 1.1 instead of 1.2 times it where a fabric moves.
    """
    most = splat(0.0)
    scale = splat(0.0)
    for k in range(6):
        scale = maximum(scale, rows[k][k])
    # Squares of what may be large or small: in parts of the largest on the diagonal.
    inverse = splat(1.0) / maximum(scale, splat(1e-300))
    for k in range(6):
        total = splat(0.0)
        for m in range(6):
            entry = splat(0.0)
            for n in range(6):
                entry = fma(rows[k][n] * inverse, rows[n][m] * inverse, entry)
            total = total + fabs(entry)
        most = maximum(most, total)
    return scale * sqrt(most)


@compiled
def bound_parts(
    variety: Variety | None, link: int, s: int, squared: Vector, inverse: Vector,
    stiffness: Vector, minus_rest: Vector
) -> tuple[Vector, Vector, Vector]:
    """
    Stretch [m], tension [N] and root of the largest slope of a connector, 1 where all are alike.

    The larger of k_e and k_c counts: between two looks a connector may come from one to the other.
    """
    if variety is None:
        stretch = fma(squared, inverse, minus_rest)
        return stretch, stiffness * stretch, splat(1.0)
    else:
        k, rest = slope_of(variety, link, s, squared)
        stretch = squared * inverse - rest
        most = maximum(load(variety.extension, link, s), load(variety.compression, link, s))
        return stretch, k * stretch, sqrt(most)


@compiled
def stored_part(
    tables: LawTables | None, variety: Variety | None, link: int, s: int, there: Any,
    length: Vector, stretch: Vector, pull: Vector, energy: Vector
) -> Vector:
    """Add the energy of a connector, by a table where it has one, but for a common factor."""
    if tables is None:
        return energy_part(variety, stretch, pull, energy)
    else:
        double = tabled_energy(
            tables, variety, link, s, length, splat(0.5) * (stretch * pull))
        return energy + where(there, double + double, splat(0.0))


@compiled
def energy_part(
    variety: Variety | None, stretch: Vector, pull: Vector, energy: Vector
) -> Vector:
    """Add the energy of a connector, but for a common factor."""
    if variety is None:
        return fma(stretch, stretch, energy)
    else:
        return fma(stretch, pull, energy)


@compiled
def bound_and_energies(
    model: Model, state: State, work: Work, block: int, s: int
) -> tuple[Vector, Vector, Vector, Vector, Vector]:
    """
    Bound of the squared frequency [1/s^2] of each body of a block, and its stored energies [J].

    Those of connectors, of moments and ways around shells, and of fields; then the magnitudes of
    tensions [N]. Of a sum of energies the bound is the sum of their bounds.
    """
    bound, linked, pulls = block_bound(
        model.links, model.inverse_mass, model.inverse_inertia, work.points, state.position,
        block, s)
    more, bent = bending_look(
        model.bending, model.links, model.inverse_mass, model.inverse_inertia, state.position,
        state.orientation, work.points, block, s)
    most, twisted = twisting_look(
        model.twisting, model.links, model.inverse_inertia, state.orientation, block, s)
    field, potential = field_parts(
        model.dipole, model.coulomb, model, state, model.blocks.alive[block], s)
    around, wound, _ = wrapping_look(
        model.wrapping, model.links, model.maxwell, model.inverse_mass, model.inverse_inertia,
        state.position, state.orientation, state.rest, work.points, block, s)
    arms, held = maxwell_look(
        model.maxwell, model.links, model.inverse_mass, model.inverse_inertia, state.rest,
        work.points, state.position.shape[1], block, s)
    return (
        bound + more + most + field + around + arms, linked + held, bent + twisted + wound,
        potential, pulls)


@compiled
def frequency_bound(model: Model, state: State, work: Work) -> float:
    """Upper bound of the largest squared frequency [1/s^2] of the fabric, see `block_bound`."""
    largest = splat(0.0)
    for block in range(model.blocks.slot.shape[0]):
        bound, _, _, _, _ = bound_and_energies(
            model, state, work, block, model.blocks.slot[block])
        largest = maximum(bound, largest)
    return largest_lane(largest)


@compiled
def field_bound(model: Model, state: State) -> float:
    """What electric fields add to that at most [1/s^2]."""
    largest = splat(0.0)
    for block in range(model.blocks.slot.shape[0]):
        bound, _ = field_parts(
            model.dipole, model.coulomb, model, state, model.blocks.alive[block],
            model.blocks.slot[block])
        largest = maximum(bound, largest)
    return largest_lane(largest)


@compiled
def examine(
    model: Model, loads: Loads, state: State, work: Work, time: float, ledger: np.ndarray
) -> int:
    """
    Status bits of the state at `time` [s], and its figures into `ledger`.

    Its attachment points are in place.
    """
    zero = splat(0.0)
    largest, spin, linear, angular, height, extent = zero, zero, zero, zero, zero, zero
    linked, bent, field, anchored, tensions = zero, zero, zero, zero, zero
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        bound, straight, around, potential, pulls = bound_and_energies(
            model, state, work, block, s)
        linked, bent, field = linked + straight, bent + around, field + potential
        tensions = tensions + pulls
        for m in range(loads.start[block], loads.start[block + 1]):
            more, part = anchor_look(loads.anchors, model, loads, state, m, s, time)
            bound, anchored = bound + more, anchored + part
        largest = maximum(bound, largest)
        square = zero
        heavy, slow = weights_of(model.masses, s)
        for k in range(3):
            v, o = load(state.linear_velocity, k, s), load(state.angular_velocity, k, s)
            linear = fma(heavy * v, v, linear)
            square = fma(o, o, square)
        angular = fma(slow, turning_square(
            model.gyration, state.orientation, state.angular_velocity, s, square), angular)
        spin = maximum(square, spin)
        for k in range(3):
            # Also with no weight: what is not finite shows in the sum.
            weight, place = splat(gravity_along(model.gravity, k)), load(state.position, k, s)
            height = fma(heavy * weight, place, height)
            extent = maximum(fabs(place), extent)
    mass, inertia = units_of(model.masses, model.inverse_mass, model.inverse_inertia)
    ledger[SPIN] = math.sqrt(largest_lane(spin))
    rate = math.sqrt(largest_lane(largest) + ledger[CONTACT_RATE])
    ledger[RATE] = rate + ledger[SPIN_WEIGHT] * ledger[SPIN]
    ledger[KINETIC] = 0.5 * mass * sum_of_lanes(linear) + 0.5 * inertia * sum_of_lanes(angular)
    ledger[CONTACT], ledger[DEEPEST], ledger[TOUCHING] = contact_look(model.contacts, state)
    ledger[DEEPEST_EVER] = max(ledger[DEEPEST_EVER], ledger[DEEPEST])
    ledger[LINKED], ledger[BENT] = sum_of_lanes(linked), sum_of_lanes(bent)
    ledger[FIELD], ledger[ANCHORED] = sum_of_lanes(field), sum_of_lanes(anchored)
    ledger[STORED] = ledger[LINKED] + ledger[BENT] + ledger[FIELD] + ledger[ANCHORED]
    ledger[STORED] += ledger[CONTACT]
    ledger[HEIGHT] = -mass * sum_of_lanes(height)
    ledger[TENSIONS], ledger[EXTENT] = sum_of_lanes(tensions), largest_lane(extent)
    # What driven bodies move with is work of their drives too.
    ledger[WORK] = ledger[EARLIER_WORK] + energy_of_drives(model, loads, state)
    ledger[WORKED] = abs(ledger[WORK]) + work_size(loads) + abs(flowed(work.given))
    ledger[WORK] += work_done(loads) + flowed(work.given)
    ledger[SPENT] = flowed(work.spent)
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
        ledger[OBSTRUCTED] = sum_of_lanes(obstructed_ends(
            model.wrapping, model, state, work.points))
        if ledger[OBSTRUCTED] > ledger[OBSTRUCTED_LIMIT]:
            status |= OBSTRUCTING
    if ledger[DEEPEST] > ledger[DEEPEST_LIMIT]:
        status |= TOO_DEEP
    if ledger[DEEPEST] > ledger[TOLD_LIMIT]:
        status |= DEEP
    return status


@compiled
def obstructed_ends(
    wrapping: Wrapping | None, model: Model, state: State, points: np.ndarray
) -> Vector:
    """
    Ends of connectors in the shells they are attached to; of those that lie around: without a way.
    """
    if wrapping is None:
        return obstructed_lanes(
            model.links, model.shells, model.blocks, state.orientation, points,
            state.position.shape[1])
    else:
        total = splat(0.0)
        for block in range(model.blocks.slot.shape[0]):
            _, _, lost = wrapping_look(
                wrapping, model.links, model.maxwell, model.inverse_mass, model.inverse_inertia,
                state.position, state.orientation, state.rest, points, block,
                model.blocks.slot[block])
            total = total + lost
        return total


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
    """ROUGHER where the motion has become so; needs `interval` steps of one length."""
    ledger[ROUGH] = -1.0
    roughest = ledger[ROUGHEST]
    ledger[ROUGHEST] = 0.0
    if work.weights.shape[0] < 2 or ledger[REGULAR] < interval:
        return 0
    ledger[ROUGH] = roughest
    return ROUGHER if ledger[ROUGH] > ledger[ROUGH_LIMIT] else 0


@compiled
def gravity_along(gravity: Gravity | None, k: int) -> float:
    """Gravity [m/s^2] along an axis."""
    if gravity is None:
        return 0.0
    return float(gravity.acceleration[k])


@compiled
def work_done(loads: Loads) -> float:
    """Work [J] of the present loads."""
    total = 0.0
    for m in range(loads.work.shape[0]):
        total += loads.work[m]
    return total


@compiled
def work_size(loads: Loads) -> float:
    """Sum of the magnitudes of the work [J] of the present loads, each on each body."""
    total = 0.0
    for m in range(loads.work.shape[0]):
        total += abs(loads.work[m])
    return total


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
