# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Shortest ways of connectors around the shells at their ends, one at a time.

The length of a way over given edges is that of a straight line in the unfolded plane (see
wrapping.py beside this folder); a way is taut where the free rest leaves its last edge between
the two faces there. The shortest taut one counts. Where both ends lie around their shells each
leaves its own at a place that depends on the other's: the sum of the two unfolded parts and the
free one between them is convex in both places, and Newton's method finds its least value.
"""

import math

from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.records import Wrapping
import numpy as np

# Position and the body's axes in the world: x, y, z, then components of its x, y and z axis.
Pose = tuple[
    float, float, float, float, float, float, float, float, float, float, float, float]
Point = tuple[float, float, float]
# Ends that need no way, and that find none.
STRAIGHT, LOST = -1, -2
# Lengths are compared to this, in parts of the inscribed radius.
_SLACK = 1e-12
_ROUNDS, _NEWTON, _STARTS = 12, 40, 24


@compiled
def pose_of(position: np.ndarray, orientation: np.ndarray, s: int) -> Pose:
    """
    Place and axes of the body in slot `s` (eqs 16 and 26).
    """
    if orientation.ndim == 2:
        x, y, z, w = orientation[0, s], orientation[1, s], orientation[2, s], orientation[3, s]
        return (
            position[0, s], position[1, s], position[2, s],
            1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
            2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
            2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    else:
        return (
            position[0, s], position[1, s], position[2, s],
            orientation[0, 0, s], orientation[0, 1, s], orientation[0, 2, s],
            orientation[1, 0, s], orientation[1, 1, s], orientation[1, 2, s],
            orientation[2, 0, s], orientation[2, 1, s], orientation[2, 2, s])


@compiled
def turned(pose: Pose, x: float, y: float, z: float) -> Point:
    """
    World components of a vector in body axes.
    """
    return (
        x * pose[3] + y * pose[6] + z * pose[9], x * pose[4] + y * pose[7] + z * pose[10],
        x * pose[5] + y * pose[8] + z * pose[11])


@compiled
def seen_from(pose: Pose, point: Point) -> Point:
    """
    Body coordinates of a point of the world.
    """
    x, y, z = point[0] - pose[0], point[1] - pose[1], point[2] - pose[2]
    return (
        x * pose[3] + y * pose[4] + z * pose[5], x * pose[6] + y * pose[7] + z * pose[8],
        x * pose[9] + y * pose[10] + z * pose[11])


@compiled
def attachment(half_width: float, edge: int) -> Point:
    """
    Midpoint of a named edge in body axes.
    """
    out = half_width * (1.0 - 2.0 * (edge & 1))
    pair = edge >> 1
    if pair == 0:
        return 0.0, 0.0, out
    elif pair == 1:
        return out, 0.0, 0.0
    else:
        return 0.0, out, 0.0


@compiled
def over(wrapping: Wrapping, face: int, point: Point) -> float:
    """
    Height [m] of a point over the plane of a face, body axes.
    """
    height: float = (
        wrapping.normals[face, 0] * point[0] + wrapping.normals[face, 1] * point[1]
        + wrapping.normals[face, 2] * point[2] - wrapping.height)
    return height


@compiled
def around(
    wrapping: Wrapping, edge: int, point: Point, least: float
) -> tuple[int, float, float]:
    """
    The shortest way from the midpoint of an edge to a point in body axes, and where it leaves.

    Of those whose squared length [m^2], which is returned too, is above `least`. STRAIGHT where
    nothing is in between, LOST where there is no way. A point within the shell is led to over the
    face that it is nearest to, so that a length does not jump where it enters.
    """
    if over(wrapping, wrapping.start[edge, 0], point) >= 0.0 or over(
            wrapping, wrapping.start[edge, 1], point) >= 0.0:
        return STRAIGHT, 0.0, 0.0
    nearest, top = 0, -math.inf
    for face in range(20):
        height = over(wrapping, face, point)
        if height > top:
            nearest, top = face, height
    slack = _SLACK * wrapping.height
    shortest, chosen, place = math.inf, LOST, 0.0
    for number in range(wrapping.ways.shape[1]):
        following = wrapping.faces[edge, number, 1]
        if top < 0.0:
            if following != nearest:
                continue
        elif over(wrapping, wrapping.faces[edge, number, 0], point) > slack or over(
                wrapping, following, point) < -slack:
            continue
        way = wrapping.ways[edge, number]
        x, y, z = point[0] - way[0], point[1] - way[1], point[2] - way[2]
        along = x * way[3] + y * way[4] + z * way[5]
        x, y, z = x - along * way[3], y - along * way[4], z - along * way[5]
        beside = math.sqrt(x * x + y * y + z * z)
        passed = way[6] + (along - way[6]) * (way[7] / (way[7] + beside))
        if passed < way[8] - slack or passed > way[9] + slack:
            continue
        square = (along - way[6]) ** 2 + (beside + way[7]) ** 2
        if least < square < shortest:
            shortest, chosen, place = square, number, passed
    return chosen, place, shortest


@compiled
def leaving(
    wrapping: Wrapping, pose: Pose, edge: int, way: int, place: float
) -> Point:
    """
    Where in the world a connector becomes free.
    """
    if way < 0:
        x, y, z = attachment(wrapping.half_width, edge)
    else:
        row = wrapping.ways[edge, way]
        x, y, z = row[0] + place * row[3], row[1] + place * row[4], row[2] + place * row[5]
    x, y, z = turned(pose, x, y, z)
    return pose[0] + x, pose[1] + y, pose[2] + z


@compiled
def wound(wrapping: Wrapping, edge: int, way: int, place: float) -> float:
    """
    Length [m] that lies on the shell.
    """
    if way < 0:
        return 0.0
    row = wrapping.ways[edge, way]
    return math.sqrt((place - row[6]) ** 2 + row[7] ** 2)


@compiled
def apart(one: Point, other: Point) -> float:
    """
    Distance [m].
    """
    return math.sqrt(
        (one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2 + (one[2] - other[2]) ** 2)


@compiled
def settle(
    wrapping: Wrapping, pose: Pose, edge: int, way: int, place: float, far: Pose, far_edge: int,
    far_way: int, far_place: float
) -> tuple[float, float]:
    """
    Where a connector around both shells leaves them, along the last edges of given ways.

    Newton's method for the least length; a step that makes it longer is halved.
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
        a = row[7] ** 2 / one**3 + (1.0 - tw * tw) / free
        b = far_row[7] ** 2 / two**3 + (1.0 - rw * rw) / free
        c = -(cross - tw * rw) / free
        determinant = a * b - c * c
        if not determinant > 0.0:
            break
        step, far_step = -(b * g - c * h) / determinant, -(a * h - c * g) / determinant
        total, factor = one + two + free, 1.0
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
    return place, far_place


@compiled
def within(wrapping: Wrapping, edge: int, way: int, place: float) -> bool:
    """
    Whether a way passes all its edges between their ends.
    """
    row, slack = wrapping.ways[edge, way], _SLACK * wrapping.height
    return row[8] - slack <= place <= row[9] + slack


@compiled
def taut(
    wrapping: Wrapping, pose: Pose, edge: int, far: Pose, far_edge: int
) -> tuple[int, float, int, float]:
    """
    Way and place at either end of a connector between the midpoints of two named edges.

    Tried are all taut ways from either end to the other attachment point, each with all taut ways
    of the other end to where it leaves its shell, as long as they can be shorter than what was
    found. Where none of these pairs is taut at both ends the ends are wound up in turn.
    """
    one = tightened(wrapping, pose, edge, far, far_edge, math.inf)
    two = tightened(wrapping, far, far_edge, pose, edge, one[4])
    if two[4] < one[4]:
        return two[2], two[3], two[0], two[1]
    if one[4] < math.inf:
        return one[0], one[1], one[2], one[3]
    start = leaving(wrapping, pose, edge, STRAIGHT, 0.0)
    return wind(wrapping, pose, edge, far, far_edge, start)


@compiled
def tightened(
    wrapping: Wrapping, pose: Pose, edge: int, far: Pose, far_edge: int, bound: float
) -> tuple[int, float, int, float, float]:
    """
    The shortest pair of ways that is found from the first end on, below the length `bound` [m].

    With its length, infinite where there is none.
    """
    b = leaving(wrapping, far, far_edge, STRAIGHT, 0.0)
    best, shortest = (STRAIGHT, 0.0, STRAIGHT, 0.0, math.inf), bound
    least = 0.0
    for _ in range(_STARTS):
        way, start, square = around(wrapping, edge, seen_from(pose, b), least)
        # With what comes around the other shell it is only longer.
        if least > 0.0 and (way < 0 or square >= shortest * shortest):
            break
        least = square * (1.0 + 1e-12)
        p = leaving(wrapping, pose, edge, way, start)
        far_least = 0.0
        for _ in range(_STARTS):
            far_way, far_place, far_square = around(
                wrapping, far_edge, seen_from(far, p), far_least)
            if far_least > 0.0 and far_way < 0:
                break
            far_least = far_square * (1.0 + 1e-12)
            place = start
            if way >= 0 and far_way >= 0:
                place, far_place = settle(
                    wrapping, pose, edge, way, place, far, far_edge, far_way, far_place)
            found = way, place, far_way, far_place
            if not both_allowed(wrapping, pose, edge, far, far_edge, found):
                q = leaving(wrapping, far, far_edge, far_way, far_place)
                found = wind(wrapping, far, far_edge, pose, edge, q)
                found = found[2], found[3], found[0], found[1]
            length = whole(
                wrapping, pose, edge, found[0], found[1], far, far_edge, found[2], found[3])
            if length < shortest and both_allowed(wrapping, pose, edge, far, far_edge, found):
                shortest, best = length, (found[0], found[1], found[2], found[3], length)
            if far_way < 0:
                break
        if way < 0:
            break
    return best


@compiled
def both_allowed(
    wrapping: Wrapping, pose: Pose, edge: int, far: Pose, far_edge: int,
    found: tuple[int, float, int, float]
) -> bool:
    """
    Whether a pair of ways is taut at both ends.
    """
    way, place, far_way, far_place = found
    p = leaving(wrapping, pose, edge, way, place)
    q = leaving(wrapping, far, far_edge, far_way, far_place)
    return allowed(wrapping, edge, way, place, seen_from(pose, q)) and allowed(
        wrapping, far_edge, far_way, far_place, seen_from(far, p))


@compiled
def allowed(wrapping: Wrapping, edge: int, way: int, place: float, point: Point) -> bool:
    """
    Whether a way to a point in body axes is taut, and passes all its edges between their ends.
    """
    if way == LOST:
        return True
    slack = _SLACK * wrapping.height
    if way == STRAIGHT:
        return over(wrapping, wrapping.start[edge, 0], point) >= -slack or over(
            wrapping, wrapping.start[edge, 1], point) >= -slack
    return within(wrapping, edge, way, place) and over(
        wrapping, wrapping.faces[edge, way, 0], point) <= slack and over(
        wrapping, wrapping.faces[edge, way, 1], point) >= -slack


@compiled
def whole(
    wrapping: Wrapping, pose: Pose, edge: int, way: int, place: float, far: Pose, far_edge: int,
    far_way: int, far_place: float
) -> float:
    """
    Length [m] of a connector with these ways and places.
    """
    return wound(wrapping, edge, way, place) + wound(
        wrapping, far_edge, far_way, far_place) + apart(
            leaving(wrapping, pose, edge, way, place),
            leaving(wrapping, far, far_edge, far_way, far_place))


@compiled
def wind(
    wrapping: Wrapping, pose: Pose, edge: int, far: Pose, far_edge: int, p: Point
) -> tuple[int, float, int, float]:
    """
    Ways and places of a connector that is wound up from its second end on, to the point `p`.

    Either end in turn with the other held, which shortens it each time, until the ways no
    longer change; then both at once.
    """
    far_way, far_place = STRAIGHT, 0.0
    way, place = STRAIGHT, 0.0
    before, far_before = -3, -3
    for _ in range(_ROUNDS):
        far_way, far_place, _ = around(wrapping, far_edge, seen_from(far, p), 0.0)
        q = leaving(wrapping, far, far_edge, far_way, far_place)
        way, place, _ = around(wrapping, edge, seen_from(pose, q), 0.0)
        p = leaving(wrapping, pose, edge, way, place)
        if way == before and far_way == far_before:
            if way < 0 or far_way < 0:
                break
            one, two = settle(
                wrapping, pose, edge, way, place, far, far_edge, far_way, far_place)
            if within(wrapping, edge, way, one) and within(wrapping, far_edge, far_way, two):
                p = leaving(wrapping, pose, edge, way, one)
                q = leaving(wrapping, far, far_edge, far_way, two)
                again, _, _ = around(wrapping, edge, seen_from(pose, q), 0.0)
                far_again, _, _ = around(wrapping, far_edge, seen_from(far, p), 0.0)
                if again == way and far_again == far_way:
                    return way, one, far_way, two
        before, far_before = way, far_way
    return way, place, far_way, far_place
