# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Forces between shells in contact, and between shells and planes.

Every candidate pair is evaluated once, by one thread (terms/contacts/pair.py), after all bodies
have drifted. Then forces are summed at the bodies, in the order of the pairs. The result does not
depend on the number of threads, and forces on the two bodies of a pair are exactly opposite.
"""

import math

from icofabric_sim.kernels.runtime.borrowed import borrowed
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import LANES, load
from icofabric_sim.kernels.runtime.outlined import call_int
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.kernels.runtime.team import end_parts, own_blocks, take_part, Team, wait_for_all
from icofabric_sim.terms.carriers import offset_of, share_of, slot_of
from icofabric_sim.terms.contacts.apex import (
    ALONG_CENTRES,
    APEX_UNIT,
    edges_across,
    FOUND,
    put_features,
    SURE,
    take_lane,
    vertices_in_faces,
)
from icofabric_sim.terms.contacts.axis import FACE_OF_FIRST
from icofabric_sim.terms.contacts.gap import Axes, axes_of, edge_of, plane_gap, ratio_of, support
from icofabric_sim.terms.contacts.pair import LINE, Scratch, touch_pair_again, touch_plane
from icofabric_sim.terms.contacts.record import Contacts
from icofabric_sim.terms.contacts.sleeping import APART, AWAKE, go_on, path_to, sleeps_until
from icofabric_sim.terms.contacts.surface import EDGES, EDGES_WAIT, POINTS, POINTS_WAIT
from icofabric_sim.terms.shared import Six
import numpy as np

# A gap of more than this fraction of a proves that two shells are apart for any rounding.
_APART = 1e-9
# Batches of pairs in the run of each of several threads, and least number of pairs in a batch.
_PARTS, LEAST_PART = 64, 16


@compiled
def touch_all(
    contacts: Contacts | None, position: np.ndarray, orientation: np.ndarray, team: Team
) -> None:
    """
    Write forces and torques of all contacts into contacts.rows; each thread writes its blocks.

    The caller has waited until all bodies are in place. Also a barrier.
    """
    if contacts is None:
        return
    touch_awake(contacts, position, orientation, team)
    wait_for_all(team)
    end_parts(team)
    add_up(contacts, contacts.result, contacts.rows, team)


@compiled
def touch_awake(
    contacts: Contacts, position: np.ndarray, orientation: np.ndarray, team: Team
) -> None:
    """Evaluate those awake pairs that this thread takes."""
    path = go_on(contacts.sleep, position, orientation, team)
    contacts.deepest[8 * team.member] = 0.0
    touch_listed(
        contacts, position, orientation, team.scratch, contacts.result, contacts.sleep.until,
        path, team.flags, team.member, team.size)


@compiled
def part_of(count: int, size: int) -> int:
    """
    Return the number of pairs in a batch of `count` pairs, which `size` threads take in turn.

    Adjacent pairs are similar, and some kinds of contact take ten times as long as others.
    """
    if size == 1:
        return max(count, 1)
    return max(count // (_PARTS * size), LEAST_PART)


@compiled
def touch_listed(
    contacts: Contacts, position: np.ndarray, orientation: np.ndarray, scratch: Scratch,
    result: np.ndarray, until: np.ndarray, path: float, flags: np.ndarray, member: int, size: int
) -> int:
    """Call `touch_some` by its address, one compiled function for all kernel variants."""
    return call_int(contacts.touch_address, (
        contacts, position, orientation, scratch, result, until, path, flags, member, size))


@compiled
def touch_some(
    contacts: Contacts, position: np.ndarray, orientation: np.ndarray, scratch: Scratch,
    result: np.ndarray, until: np.ndarray, path: float, flags: np.ndarray, member: int, size: int
) -> int:
    """
    Evaluate the awake pairs at a `path` [m] (sleeping.py); return their number.

    This thread of `size` threads takes batches of pairs (runtime/team.py). It links its batches in
    a separate chain, because other threads may not yet have stored theirs. The numbers of the
    evaluated pairs of a batch go into `awake`, from its first index on. Pairs that had one apex at
    the last evaluation wait until there are enough to fill the lanes of a vector; all others are
    evaluated one by one.
    """
    deepest, edges, points, total = 0.0, 0, 0, 0
    count = contacts.pairs.shape[0]
    part = part_of(count, size)
    parts = (count + part - 1) // part
    until, awake = borrowed(until), borrowed(contacts.sleep.awake)
    # Views of arrays that count references would take longer than to reject a pair.
    pairs, planes, result = borrowed(contacts.pairs), borrowed(contacts.planes), borrowed(result)
    position, orientation = borrowed(position), borrowed(orientation)
    own, other = borrowed(contacts.first)[member], borrowed(contacts.second)[member]
    axis = borrowed(contacts.sleep.axis)
    room, marks = borrowed(scratch.room), borrowed(scratch.marks)
    half_edge, half_edges = contacts.half_edge, contacts.half_edges
    latest: int = np.int64(-1)  # type: ignore[assignment]
    number = take_part(flags, member, size, parts, -1)
    while number >= 0:
        contacts.earlier[number] = latest
        latest = number
        first, last, tested = number * part, min((number + 1) * part, count), 0
        for p in range(first, last):
            if path < until[p]:
                continue
            s, t = pairs[p, 0], pairs[p, 1]
            if until[p] > APART and t >= 0:
                # The pair has slept: its row holds zeros, and need not come from memory.
                left = room_along(
                    edge_of(half_edge, half_edges, s), ratio_of(half_edges, s, t), position,
                    orientation, s, t, axis[p])
                if left > 0.0:
                    until[p] = path + left
                    continue
            awake[first + tested] = p
            tested += 1
            out = result[p]
            if t < 0:
                axes, plane = axes_of(orientation, s), planes[-1 - t]
                edge = edge_of(half_edge, half_edges, s)
                offset = offset_of(planes, contacts.carriers, position, -1 - t)
                gap = plane_gap(
                    plane, offset, edge, position[0, s], position[1, s], position[2, s], axes)
                if gap > _APART * edge and until[p] >= APART:
                    # Its results are zero already.
                    until[p] = path + share_of(contacts.carriers, -1 - t) * (
                        gap - _APART * edge)
                    tested -= 1
                    continue
                set_place(position, axes, s, own)
                touches = touch_plane(
                    edge, plane[:3], offset, own[0], own[1:], scratch, out)
                until[p] = AWAKE if touches else APART
                deepest = max(deepest, out[11])
                continue
            code = int(out[19])
            if code < APEX_UNIT:
                deepest = max(deepest, touch_alone(
                    half_edge, half_edges, position, orientation, s, t, own, other, scratch, out,
                    until, axis, path, p))
                if until[p] > APART:
                    tested -= 1
            elif code % APEX_UNIT < FACE_OF_FIRST:
                marks[EDGES_WAIT + edges] = put_pair(
                    room, EDGES, edges, position, orientation, s, t, p, code)
                edges += 1
                if edges == LANES:
                    edges_across(room, EDGES, half_edge)
                    deepest = max(deepest, take_lanes(
                        contacts, position, orientation, pairs, own, other, scratch, room, marks,
                        result, until, path, EDGES, EDGES_WAIT, edges))
                    edges = 0
            else:
                marks[POINTS_WAIT + points] = put_pair(
                    room, POINTS, points, position, orientation, s, t, p, code)
                points += 1
                if points == LANES:
                    vertices_in_faces(room, POINTS, half_edge)
                    deepest = max(deepest, take_lanes(
                        contacts, position, orientation, pairs, own, other, scratch, room, marks,
                        result, until, path, POINTS, POINTS_WAIT, points))
                    points = 0
        if first + tested < last:
            awake[first + tested] = -1
        total += tested
        contacts.tests[8 * member] += last - first
        number = take_part(flags, member, size, parts, number)
    if edges > 0:
        edges_across(room, EDGES, half_edge)
        deepest = max(deepest, take_lanes(
            contacts, position, orientation, pairs, own, other, scratch, room, marks, result,
            until, path, EDGES, EDGES_WAIT, edges))
    if points > 0:
        vertices_in_faces(room, POINTS, half_edge)
        deepest = max(deepest, take_lanes(
            contacts, position, orientation, pairs, own, other, scratch, room, marks, result,
            until, path, POINTS, POINTS_WAIT, points))
    contacts.latest[8 * member] = latest
    contacts.deepest[8 * member] = max(contacts.deepest[8 * member], deepest)
    contacts.deepest[8 * member + 1] = max(contacts.deepest[8 * member + 1], deepest)
    return total


@compiled
def touch_alone(
    half_edge: float, half_edges: np.ndarray | None, position: np.ndarray,
    orientation: np.ndarray, s: int, t: int, own: np.ndarray, other: np.ndarray, scratch: Scratch,
    out: np.ndarray, until: np.ndarray, axis: np.ndarray, path: float, p: int
) -> float:
    """Evaluate pair `p`, of shells; return their overlap [m]."""
    edge, ratio = edge_of(half_edge, half_edges, s), ratio_of(half_edges, s, t)
    # The axis that last separated them.
    for k in range(3):
        axis[p, k] = out[12 + k]
    room = room_along(edge, ratio, position, orientation, s, t, axis[p])
    if room > 0.0:
        if until[p] < APART:
            for k in range(12):
                out[k] = 0.0
            out[19] = 0.0
        until[p] = sleeps_until(until[p], path, room)
        return 0.0
    axes, others = axes_of(orientation, s), axes_of(orientation, t)
    set_place(position, axes, s, own)
    set_place(position, others, t, other)
    touches = touch_pair_again(
        edge, edge_of(half_edge, half_edges, t), own[0], own[1:], other[0], other[1:], scratch,
        out)
    until[p] = AWAKE if touches else APART
    if half_edges is not None and out[19] >= APEX_UNIT and edge != half_edge:
        # Pairs in lanes must have the common size.
        out[19] = 0.0
    if touches:
        # No axis shows less than the depth.
        out[11] = min(out[11], scratch.room[LINE])
    return float(out[11])


@compiled
def put_pair(
    room: np.ndarray, at: int, lane: int, position: np.ndarray, orientation: np.ndarray, s: int,
    t: int, p: int, number: int
) -> int:
    """
    Write pair `p` of slots `s` and `t` into a lane; return 2 p, plus 1 if the pair is exchanged.
    """
    first, second = axes_of(orientation, s), axes_of(orientation, t)
    dx, dy = position[0, t] - position[0, s], position[1, t] - position[1, s]
    dz = position[2, t] - position[2, s]
    # The same arithmetic whichever body comes first, as in `meet`.
    swapped = dx < 0.0 or (dx == 0.0 and (dy < 0.0 or (dy == 0.0 and dz < 0.0)))
    if swapped:
        dx, dy, dz = -dx, -dy, -dz
        first, second = second, first
    exchanged = put_features(room, at, lane, dx, dy, dz, first, second, number)
    return 2 * p + (1 if exchanged != swapped else 0)


@compiled
def take_lanes(
    contacts: Contacts, position: np.ndarray, orientation: np.ndarray, pairs: np.ndarray,
    own: np.ndarray, other: np.ndarray, scratch: Scratch, room: np.ndarray, marks: np.ndarray,
    result: np.ndarray, until: np.ndarray, path: float, at: int, waiting: int, count: int
) -> float:
    """
    Copy the results of pairs from their lanes; return the deepest overlap [m].

    A pair whose overlap no longer has one apex, or whose facet may have changed, is evaluated
    alone.
    """
    deepest, left = 0.0, 0
    for lane in range(count):
        mark = marks[waiting + lane]
        if room[at + LANES * FOUND + lane] == 1.0 and room[at + LANES * SURE + lane] == 1.0:
            out = result[mark >> 1]
            take_lane(room, at, lane, mark & 1 == 1, int(out[19]), out)
            out[11] = min(out[11], room[at + LANES * ALONG_CENTRES + lane])
            deepest = max(deepest, out[11])
            until[mark >> 1] = AWAKE
        else:
            marks[waiting + left] = mark
            left += 1
    for k in range(left):
        p = marks[waiting + k] >> 1
        deepest = max(deepest, touch_alone(
            contacts.half_edge, contacts.half_edges, position, orientation, pairs[p, 0],
            pairs[p, 1], own, other, scratch, result[p], until, contacts.sleep.axis, path, p))
    return deepest


@compiled
def room_along(
    half_edge: float, ratio: float, position: np.ndarray, orientation: np.ndarray, s: int, t: int,
    axis: np.ndarray
) -> float:
    """
    Return the distance [m] that two bodies may each move before contact, by an axis.

    If the distance is not positive, they may touch.
    """
    axes, others = axes_of(orientation, s), axes_of(orientation, t)
    nx, ny, nz = axis[0], axis[1], axis[2]
    gap = nx * (position[0, t] - position[0, s]) + ny * (position[1, t] - position[1, s])
    gap += nz * (position[2, t] - position[2, s])
    gap -= half_edge * (support(axes, nx, ny, nz) + ratio * support(others, nx, ny, nz) + _APART)
    # The axis is longer than 1 if an orientation was not normalised.
    return 0.5 * gap / max(math.sqrt(nx * nx + ny * ny + nz * nz), 1.0)


@compiled
def set_place(position: np.ndarray, axes: Axes, s: int, place: np.ndarray) -> None:
    """
    Write the position of slot `s`, and its axes as a rotation matrix (body to world), (4, 3).
    """
    for k in range(3):
        place[0, k] = position[k, s]
    place[1, 0], place[2, 0], place[3, 0] = axes[0], axes[1], axes[2]
    place[1, 1], place[2, 1], place[3, 1] = axes[3], axes[4], axes[5]
    place[1, 2], place[2, 2], place[3, 2] = axes[6], axes[7], axes[8]


@compiled
def add_up(contacts: Contacts, pushes: np.ndarray, rows: np.ndarray, team: Team) -> None:
    """
    Sum rows, (6, s) [N], [N m], of the bodies of this thread from the forces of their pairs.

    Carriers of planes count as bodies. `pushes`: (p, 9) or longer, for a contact stiffness of
    1 N/m, as `contacts.result`, of pairs in contact there. Pairs in contact, or that have just
    separated, are awake; all other rows are zero already.
    """
    count = contacts.pairs.shape[0]
    part = part_of(count, team.size)
    first, last = own_blocks(team, contacts.start.shape[0] - 1)
    pairs, until = borrowed(contacts.pairs), borrowed(contacts.sleep.until)
    turns = borrowed(contacts.turns)
    awake, result = borrowed(contacts.sleep.awake), borrowed(contacts.result)
    pushes, rows, stiffness = borrowed(pushes), borrowed(rows), contacts.stiffness
    for adds in range(2):
        for begin in range(0, count, part):
            for i in range(begin, min(begin + part, count)):
                p = awake[i]
                if p < 0:
                    break
                if until[p] > APART:
                    continue
                for side in range(2):
                    s = slot_of(contacts.carriers, pairs[p, side])
                    if s < 0 or turns[s // LANES] < first or turns[s // LANES] >= last:
                        continue
                    if adds == 0:
                        for k in range(6):
                            rows[k, s] = 0.0
                        continue
                    if result[p, 10] == 0.0:
                        continue
                    push = stiffness if side == 0 else -stiffness
                    for k in range(3):
                        rows[k, s] += push * pushes[p, k]
                        rows[k + 3, s] += stiffness * pushes[p, 3 + 3 * side + k]


@compiled
def add_force(contacts: Contacts | None, s: int, wrench: Six) -> Six:
    """Add the forces and torques of contacts on a block."""
    if contacts is None:
        return wrench
    else:
        fx, fy, fz, tx, ty, tz = wrench
        rows = contacts.rows
        return (
            fx + load(rows, 0, s), fy + load(rows, 1, s), fz + load(rows, 2, s),
            tx + load(rows, 3, s), ty + load(rows, 4, s), tz + load(rows, 5, s))


@compiled
def deepest_overlap(contacts: Contacts | None, size: int) -> float:
    """Return the deepest overlap [m] in the last evaluation by `size` threads."""
    most = 0.0
    if contacts is None:
        return most
    for member in range(size):
        most = max(most, contacts.deepest[8 * member])
    return most


@compiled
def note_touch(
    drives: Record | None, contacts: Contacts | None, begins: bool, member: int
) -> None:
    """
    Store the deepest overlap in all stages of a step; `begins` marks its first stage.

    Only with drives, whose work is to be measured.
    """
    if drives is None:
        return
    if contacts is None:
        return
    deepest = contacts.deepest
    before = 0.0 if begins else deepest[8 * member + 2]
    deepest[8 * member + 2] = max(before, deepest[8 * member])


@compiled
def has_touched(drives: Record | None, contacts: Contacts | None, size: int) -> bool:
    """Check that a contact occurred in a stage of the step, in any of `size` threads."""
    touched = False
    if drives is None:
        return touched
    if contacts is None:
        return touched
    for member in range(size):
        touched = touched or contacts.deepest[8 * member + 2] > 0.0
    return touched


@compiled
def tests_of(contacts: Contacts | None, member: int) -> int:
    """Return the number of pairs that one thread has tested so far."""
    if contacts is None:
        return 0
    return int(contacts.tests[8 * member])


@compiled
def set_tests(contacts: Contacts | None, member: int, tests: int) -> None:
    """Set the number of tested pairs; later tests were a repetition."""
    if contacts is None:
        return
    contacts.tests[8 * member] = tests


@compiled
def contact_look(
    contacts: Contacts, position: np.ndarray, orientation: np.ndarray
) -> tuple[float, float, int]:
    """Return energy [J], deepest overlap [m] and number of the contacts."""
    energy, deepest, count = 0.0, 0.0, 0
    tests, before = contacts.tests[0], contacts.deepest[0]
    if contacts.pairs.shape[0] == 0:
        return energy, deepest, count
    sleep, aside = contacts.sleep, contacts.aside
    # Pairs that sleep at the present positions are apart; all others are tested.
    path = path_to(sleep, position, orientation)
    for p in range(contacts.pairs.shape[0]):
        sleep.looked[p] = AWAKE
        if path < sleep.until[p]:
            sleep.looked[p] = math.inf
            if aside[p, 11] > 0.0:
                for k in range(12):
                    aside[p, k] = 0.0
                aside[p, 19] = 0.0
    touch_listed(
        contacts, position, orientation, contacts.scratch, aside, sleep.looked, 0.0,
        contacts.earlier, 0, 1)
    contacts.tests[0], contacts.deepest[0] = tests, before
    for p in range(contacts.pairs.shape[0]):
        energy += aside[p, 9]
        deepest = max(deepest, aside[p, 11])
        count += aside[p, 9] > 0.0
    return contacts.stiffness * energy, deepest, count
