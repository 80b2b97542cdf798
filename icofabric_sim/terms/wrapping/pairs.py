# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Shortest paths of connectors that may be wrapped over both of their shells.

The shortest path for one end alone is shortest for both if the other end is clear. Otherwise
each end leaves its own shell at a place that depends on the other's. For given paths the sum of
the two unfolded lengths and the free one between them is convex in both places, and Newton's
method finds the minimum. All pairs of paths are tried that can be taut and can be shorter than the
shortest so far: a path to the other's attachment point is never longer than one over its shell.
So the result is the shortest of all, and changes with the poses without a jump.
"""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.terms.wrapping.path import (
    allowed,
    apart,
    around,
    is_clear,
    is_close,
    leaving,
    over,
    Point,
    Pose,
    seen_from,
    SLACK,
    STRAIGHT,
    turned,
    unfolded,
    within,
    wound,
)
from icofabric_sim.terms.wrapping.record import Wrapping

_ROUNDS, _NEWTON = 12, 40
# A set of paths, the straight one first, takes three words of this number of bits.
WORD_BITS = 62
Found = tuple[int, float, int, float]
Ways = tuple[int, int, int]


@compiled
def taut(wrapping: Wrapping, pose: Pose, edge: int, far: Pose, far_edge: int) -> Found:
    """
    Return path and place at either end of a connector between the points at two named edges.

    If shells overlap, the result depends on the end at which the search begins. It is always the
    lower edge, so that both ends get the same result.
    """
    swaps = edge > far_edge
    if swaps:
        pose, far = far, pose
        edge, far_edge = far_edge, edge
    way, place, far_way, far_place = taut_from(wrapping, pose, edge, far, far_edge)
    if swaps:
        return far_way, far_place, way, place
    return way, place, far_way, far_place


@compiled
def taut_from(wrapping: Wrapping, pose: Pose, edge: int, far: Pose, far_edge: int) -> Found:
    """
    Return path and place at either end of a connector, with a search from the first end.

    If shells overlap, no pair may be taut at both ends; the ends are then wound up in turn.
    """
    a = leaving(wrapping, pose, edge, STRAIGHT, 0.0)
    b = leaving(wrapping, far, far_edge, STRAIGHT, 0.0)
    way, place = around(wrapping, edge, seen_from(pose, b))
    p = leaving(wrapping, pose, edge, way, place)
    if is_clear(wrapping, far_edge, seen_from(far, p), 0.0):
        return way, place, STRAIGHT, 0.0
    far_way, far_place = around(wrapping, far_edge, seen_from(far, a))
    q = leaving(wrapping, far, far_edge, far_way, far_place)
    if is_clear(wrapping, edge, seen_from(pose, q), 0.0):
        return STRAIGHT, 0.0, far_way, far_place
    best, length = shortest_pair(wrapping, pose, edge, far, far_edge)
    if length < math.inf:
        return best
    return wind(wrapping, pose, edge, far, far_edge, a)


@compiled
def shortest_pair(
    wrapping: Wrapping, pose: Pose, edge: int, far: Pose, far_edge: int
) -> tuple[Found, float]:
    """
    Return the shortest pair of paths that is taut at both ends; its length, infinite without one.
    """
    a = seen_from(far, leaving(wrapping, pose, edge, STRAIGHT, 0.0))
    b = seen_from(pose, leaving(wrapping, far, far_edge, STRAIGHT, 0.0))
    best, shortest = wound_up(wrapping, pose, edge, far, far_edge)
    some = candidates(wrapping, pose, edge, far, b, shortest)
    far_some = candidates(wrapping, far, far_edge, pose, a, shortest)
    for way in range(-1, wrapping.ways.shape[1]):
        if not is_member(some, way) or least(wrapping, edge, way, b) >= shortest:
            continue
        for far_way in range(-1, wrapping.ways.shape[1]):
            if not is_member(far_some, far_way) or not can_be_taut(
                    wrapping, pose, edge, way, far, far_edge, far_way) or not can_be_taut(
                    wrapping, far, far_edge, far_way, pose, edge, way):
                continue
            found, length = tighten(
                wrapping, pose, edge, way, far, far_edge, far_way, shortest)
            if length < shortest and both_allowed(wrapping, pose, edge, far, far_edge, found):
                best, shortest = found, length
    return best, shortest


@compiled
def wound_up(
    wrapping: Wrapping, pose: Pose, edge: int, far: Pose, far_edge: int
) -> tuple[Found, float]:
    """Return a taut pair, as a rule the shortest one, and its length, infinite without one."""
    a = leaving(wrapping, pose, edge, STRAIGHT, 0.0)
    found = wind(wrapping, pose, edge, far, far_edge, a)
    if not both_allowed(wrapping, pose, edge, far, far_edge, found):
        return found, math.inf
    return found, whole(
        wrapping, pose, edge, found[0], found[1], far, far_edge, found[2], found[3])


@compiled
def candidates(
    wrapping: Wrapping, pose: Pose, edge: int, far: Pose, point: Point, shortest: float
) -> Ways:
    """
    Return paths that can be taut towards a corner of the other shell, and short enough to `point`.

    `point` is the other attachment point.
    """
    first, second, third = 0, 0, 0
    # Planes that some corner of the other shell is below, and above.
    below, above = 0, 0
    count = wrapping.corners.shape[0]
    for corner in range(count + 1):
        # The attachment point may lie outside its shell.
        seen = point
        if corner < count:
            x, y, z = turned(
                far, wrapping.corners[corner, 0], wrapping.corners[corner, 1],
                wrapping.corners[corner, 2])
            seen = seen_from(pose, (far[0] + x, far[1] + y, far[2] + z))
        for plane in range(wrapping.normals.shape[1]):
            if over(wrapping, edge, plane, seen) >= 0.0:
                above |= 1 << plane
            else:
                below |= 1 << plane
    for k in range(wrapping.start.shape[1]):
        if (above >> wrapping.start[edge, k]) & 1:
            first = 1
    for way in range(wrapping.ways.shape[1]):
        if (below >> wrapping.faces[edge, way, 0]) & (
                above >> wrapping.faces[edge, way, 1]) & 1 and least(
                wrapping, edge, way, point) < shortest:
            word, bit = divmod(way + 1, WORD_BITS)
            if word == 0:
                first |= 1 << bit
            elif word == 1:
                second |= 1 << bit
            else:
                third |= 1 << bit
    return first, second, third


@compiled
def is_member(ways: Ways, way: int) -> bool:
    """Check that a path is in a set."""
    word, bit = divmod(way + 1, WORD_BITS)
    return bool((ways[word] >> bit) & 1)


@compiled
def least(wrapping: Wrapping, edge: int, way: int, point: Point) -> float:
    """Return the least length [m] of a path to a point in body axes, taut or not."""
    if way < 0:
        return 0.0
    row = wrapping.ways[edge, way]
    place, _ = unfolded(wrapping, edge, way, point)
    place = min(max(place, row[8]), row[9])
    x = row[0] + place * row[3] - point[0]
    y = row[1] + place * row[4] - point[1]
    z = row[2] + place * row[5] - point[2]
    return wound(wrapping, edge, way, place) + math.sqrt(x * x + y * y + z * z)


@compiled
def can_be_taut(
    wrapping: Wrapping, pose: Pose, edge: int, way: int, far: Pose, far_edge: int, far_way: int
) -> bool:
    """
    Check that a path can be taut towards a place where the other end may leave its own shell.
    """
    slack = SLACK * wrapping.height
    start, end = 0.0, 0.0
    if far_way >= 0:
        start, end = wrapping.ways[far_edge, far_way, 8], wrapping.ways[far_edge, far_way, 9]
    one = seen_from(pose, leaving(wrapping, far, far_edge, far_way, start))
    two = seen_from(pose, leaving(wrapping, far, far_edge, far_way, end))
    if is_close(wrapping, one) or is_close(wrapping, two):
        # One of the points may be inside the shell, where other rules hold.
        return True
    if way < 0:
        return is_clear(wrapping, edge, one, slack) or is_clear(wrapping, edge, two, slack)
    on, following = wrapping.faces[edge, way, 0], wrapping.faces[edge, way, 1]
    return min(over(wrapping, edge, on, one), over(wrapping, edge, on, two)) <= slack and max(
        over(wrapping, edge, following, one), over(wrapping, edge, following, two)) >= -slack


@compiled
def tighten(
    wrapping: Wrapping, pose: Pose, edge: int, way: int, far: Pose, far_edge: int, far_way: int,
    limit: float
) -> tuple[Found, float]:
    """
    Return where given paths of least length leave their shells, and that length.

    The length may be infinite if it cannot be shorter than `limit`.
    """
    if way >= 0:
        row = wrapping.ways[edge, way]
        q = leaving(wrapping, far, far_edge, far_way, middle(wrapping, far_edge, far_way))
        place, _ = unfolded(wrapping, edge, way, seen_from(pose, q))
        if far_way >= 0:
            place = min(max(place, row[8]), row[9])
    else:
        place = 0.0
    far_place = 0.0
    if far_way >= 0:
        p = leaving(wrapping, pose, edge, way, place)
        far_place, _ = unfolded(wrapping, far_edge, far_way, seen_from(far, p))
        if way >= 0:
            row = wrapping.ways[far_edge, far_way]
            far_place = min(max(far_place, row[8]), row[9])
            place, far_place, length = settle(
                wrapping, pose, edge, way, place, far, far_edge, far_way, far_place, limit)
            return (way, place, far_way, far_place), length
    return (way, place, far_way, far_place), whole(
        wrapping, pose, edge, way, place, far, far_edge, far_way, far_place)


@compiled
def middle(wrapping: Wrapping, edge: int, way: int) -> float:
    """Return the place in the middle of the range of a path on its last edge."""
    if way < 0:
        return 0.0
    return 0.5 * (wrapping.ways[edge, way, 8] + wrapping.ways[edge, way, 9])


@compiled
def settle(
    wrapping: Wrapping, pose: Pose, edge: int, way: int, place: float, far: Pose, far_edge: int,
    far_way: int, far_place: float, limit: float
) -> tuple[float, float, float]:
    """
    Return where a connector wrapped over both shells leaves them, for given paths; its length.

    Newton's method for the least length; a step that makes the connector longer is halved. A
    convex function lies above its tangents. If a tangent shows that no places between the ends of
    the edges give a length below `limit` [m], the search stops with an infinite length.
    """
    row, far_row = wrapping.ways[edge, way], wrapping.ways[far_edge, far_way]
    t = turned(pose, row[3], row[4], row[5])
    r = turned(far, far_row[3], far_row[4], far_row[5])
    cross = t[0] * r[0] + t[1] * r[1] + t[2] * r[2]
    enough = 1e-15 * wrapping.height
    p = leaving(wrapping, pose, edge, way, place)
    q = leaving(wrapping, far, far_edge, far_way, far_place)
    one, two = wound(wrapping, edge, way, place), wound(
        wrapping, far_edge, far_way, far_place)
    free = apart(p, q)
    for _ in range(_NEWTON):
        if not free > 0.0:
            break
        x, y, z = (p[0] - q[0]) / free, (p[1] - q[1]) / free, (p[2] - q[2]) / free
        tw = x * t[0] + y * t[1] + z * t[2]
        rw = x * r[0] + y * r[1] + z * r[2]
        g, h = (place - row[6]) / one + tw, (far_place - far_row[6]) / two - rw
        total = one + two + free
        low, high = (row[8] - place) * g, (row[9] - place) * g
        far_low, far_high = (far_row[8] - far_place) * h, (far_row[9] - far_place) * h
        if total + min(low, high) + min(far_low, far_high) > limit:
            return place, far_place, math.inf
        a = row[7] ** 2 / one**3 + (1.0 - tw * tw) / free
        b = far_row[7] ** 2 / two**3 + (1.0 - rw * rw) / free
        c = -(cross - tw * rw) / free
        determinant = a * b - c * c
        if not determinant > 0.0:
            break
        step, far_step = -(b * g - c * h) / determinant, -(a * h - c * g) / determinant
        factor = 1.0
        for _ in range(30):
            new, far_new = place + factor * step, far_place + factor * far_step
            p = leaving(wrapping, pose, edge, way, new)
            q = leaving(wrapping, far, far_edge, far_way, far_new)
            one, two = wound(wrapping, edge, way, new), wound(
                wrapping, far_edge, far_way, far_new)
            free = apart(p, q)
            if one + two + free <= total * (1.0 + 4e-16):
                break
            factor *= 0.5
        place, far_place = new, far_new
        if abs(step) + abs(far_step) <= enough:
            break
    return place, far_place, one + two + free


@compiled
def both_allowed(
    wrapping: Wrapping, pose: Pose, edge: int, far: Pose, far_edge: int,
    found: Found
) -> bool:
    """Check that a pair of paths is taut at both ends."""
    way, place, far_way, far_place = found
    p = leaving(wrapping, pose, edge, way, place)
    q = leaving(wrapping, far, far_edge, far_way, far_place)
    return allowed(wrapping, edge, way, place, seen_from(pose, q)) and allowed(
        wrapping, far_edge, far_way, far_place, seen_from(far, p))


@compiled
def whole(
    wrapping: Wrapping, pose: Pose, edge: int, way: int, place: float, far: Pose, far_edge: int,
    far_way: int, far_place: float
) -> float:
    """Return the length [m] of a connector with these paths and places."""
    return wound(wrapping, edge, way, place) + wound(
        wrapping, far_edge, far_way, far_place) + apart(
            leaving(wrapping, pose, edge, way, place),
            leaving(wrapping, far, far_edge, far_way, far_place))


@compiled
def wind(
    wrapping: Wrapping, pose: Pose, edge: int, far: Pose, far_edge: int, p: Point
) -> Found:
    """
    Return paths and places of a connector that is wound up from its second end on, to `p`.

    Either end in turn with the other held, which shortens the connector each time, until the paths
    no longer change; then both at once.
    """
    far_way, far_place = STRAIGHT, 0.0
    way, place = STRAIGHT, 0.0
    before, far_before = -3, -3
    for _ in range(_ROUNDS):
        far_way, far_place = around(wrapping, far_edge, seen_from(far, p))
        q = leaving(wrapping, far, far_edge, far_way, far_place)
        way, place = around(wrapping, edge, seen_from(pose, q))
        p = leaving(wrapping, pose, edge, way, place)
        if way == before and far_way == far_before:
            if way < 0 or far_way < 0:
                break
            one, two, _ = settle(
                wrapping, pose, edge, way, place, far, far_edge, far_way, far_place, math.inf)
            if within(wrapping, edge, way, one) and within(wrapping, far_edge, far_way, two):
                p = leaving(wrapping, pose, edge, way, one)
                q = leaving(wrapping, far, far_edge, far_way, two)
                again, _ = around(wrapping, edge, seen_from(pose, q))
                far_again, _ = around(wrapping, far_edge, seen_from(far, p))
                if again == way and far_again == far_way:
                    return way, one, far_way, two
        before, far_before = way, far_way
    return way, place, far_way, far_place
