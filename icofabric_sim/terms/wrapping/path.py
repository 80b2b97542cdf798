# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Shortest paths of connectors over the shells at their ends, one end at a time.

The length of a path over given edges is that of a straight line in the unfolded plane (see
simulation/model/wrapping.py). A path is taut if the free segment leaves its last edge between the
two faces there. The shortest taut path counts. Both ends together: pairs.py.
"""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.terms.wrapping.record import Wrapping
import numpy as np

# Position and the body's axes in the world: x, y, z, then components of its x, y and z axis.
Pose = tuple[
    float, float, float, float, float, float, float, float, float, float, float, float]
Point = tuple[float, float, float]
# Ends that need no path, and ends for which no path exists.
STRAIGHT, LOST = -1, -2
# Tolerance of comparisons of lengths, relative to the inscribed radius.
SLACK = 1e-12
# These planes come first, see Wrapping.
FACE_COUNT = 20


@compiled
def pose_of(position: np.ndarray, orientation: np.ndarray, s: int) -> Pose:
    """Return position and axes of the body in slot `s` (eqs 16 and 26)."""
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
    """Return world components of a vector in body axes."""
    return (
        x * pose[3] + y * pose[6] + z * pose[9], x * pose[4] + y * pose[7] + z * pose[10],
        x * pose[5] + y * pose[8] + z * pose[11])


@compiled
def seen_from(pose: Pose, point: Point) -> Point:
    """Return body coordinates of a point of the world."""
    x, y, z = point[0] - pose[0], point[1] - pose[1], point[2] - pose[2]
    return (
        x * pose[3] + y * pose[4] + z * pose[5], x * pose[6] + y * pose[7] + z * pose[8],
        x * pose[9] + y * pose[10] + z * pose[11])


@compiled
def attachment(wrapping: Wrapping, edge: int) -> Point:
    """Return the attachment point at a named edge in body axes."""
    return wrapping.points[edge, 0], wrapping.points[edge, 1], wrapping.points[edge, 2]


@compiled
def over(wrapping: Wrapping, edge: int, plane: int, point: Point) -> float:
    """
    Return the height [m] of a point over a plane of the attachment point at an edge, body axes.
    """
    height: float = (
        wrapping.normals[edge, plane, 0] * point[0] + wrapping.normals[edge, plane, 1] * point[1]
        + wrapping.normals[edge, plane, 2] * point[2] - wrapping.heights[edge, plane])
    return height


@compiled
def is_clear(wrapping: Wrapping, edge: int, point: Point, slack: float) -> bool:
    """
    Check that a straight line from an attachment point to a point in body axes misses the shell.

    The point may be below the planes of a clear line by `slack` [m].
    """
    for k in range(wrapping.start.shape[1]):
        if over(wrapping, edge, wrapping.start[edge, k], point) >= -slack:
            return True
    return False


@compiled
def starts_on(wrapping: Wrapping, edge: int, plane: int) -> bool:
    """Check that an attachment point is on a face or over it."""
    for k in range(wrapping.start.shape[1]):
        if wrapping.start[edge, k] == plane:
            return True
    return False


@compiled
def nearest_face(wrapping: Wrapping, point: Point) -> tuple[int, float]:
    """
    Return the face that a point in body axes is highest over, and that height [m]: < 0 inside.
    """
    nearest, top = 0, -math.inf
    for face in range(FACE_COUNT):
        height = over(wrapping, 0, face, point)
        if height > top:
            nearest, top = face, height
    return nearest, top


@compiled
def around(wrapping: Wrapping, edge: int, point: Point) -> tuple[int, float]:
    """
    Return the shortest path from an attachment point to a point in body axes, and where it leaves.

    STRAIGHT if the line is clear, LOST without a path. A path to a point inside the shell ends
    over the nearest face of the point, so that a length does not jump when the point enters the
    shell.
    """
    if is_clear(wrapping, edge, point, 0.0):
        return STRAIGHT, 0.0
    nearest, top = nearest_face(wrapping, point)
    slack = SLACK * wrapping.height
    shortest, chosen, place = math.inf, LOST, 0.0
    for number in range(wrapping.ways.shape[1]):
        following = wrapping.faces[edge, number, 1]
        if top < 0.0:
            if following != nearest:
                continue
        elif over(wrapping, edge, wrapping.faces[edge, number, 0], point) > slack or over(
                wrapping, edge, following, point) < -slack:
            continue
        passed, square = unfolded(wrapping, edge, number, point)
        way = wrapping.ways[edge, number]
        if way[8] - slack <= passed <= way[9] + slack and square < shortest:
            shortest, chosen, place = square, number, passed
    return chosen, place


@compiled
def unfolded(wrapping: Wrapping, edge: int, way: int, point: Point) -> tuple[float, float]:
    """
    Return where the unfolded line to a point in body axes passes the last edge; its square [m^2].
    """
    row = wrapping.ways[edge, way]
    x, y, z = point[0] - row[0], point[1] - row[1], point[2] - row[2]
    along = x * row[3] + y * row[4] + z * row[5]
    x, y, z = x - along * row[3], y - along * row[4], z - along * row[5]
    beside = math.sqrt(x * x + y * y + z * z)
    return (
        row[6] + (along - row[6]) * (row[7] / (row[7] + beside)),
        (along - row[6]) ** 2 + (beside + row[7]) ** 2)


@compiled
def leaving(
    wrapping: Wrapping, pose: Pose, edge: int, way: int, place: float
) -> Point:
    """Return the world point where a connector becomes free."""
    if way < 0:
        x, y, z = attachment(wrapping, edge)
    else:
        row = wrapping.ways[edge, way]
        x, y, z = row[0] + place * row[3], row[1] + place * row[4], row[2] + place * row[5]
    x, y, z = turned(pose, x, y, z)
    return pose[0] + x, pose[1] + y, pose[2] + z


@compiled
def wound(wrapping: Wrapping, edge: int, way: int, place: float) -> float:
    """Return the length [m] on the shell."""
    if way < 0:
        return 0.0
    row = wrapping.ways[edge, way]
    return math.sqrt((place - row[6]) ** 2 + row[7] ** 2)


@compiled
def apart(one: Point, other: Point) -> float:
    """Return the distance [m]."""
    return math.sqrt(
        (one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2 + (one[2] - other[2]) ** 2)


@compiled
def within(wrapping: Wrapping, edge: int, way: int, place: float) -> bool:
    """Check that a path passes all its edges between their ends."""
    row, slack = wrapping.ways[edge, way], SLACK * wrapping.height
    return row[8] - slack <= place <= row[9] + slack


@compiled
def allowed(wrapping: Wrapping, edge: int, way: int, place: float, point: Point) -> bool:
    """
    Check that a path to a point in body axes is taut, and passes all its edges between their ends.

    A path to a point inside the shell must end over the nearest face of the point, so that nothing
    jumps when shells begin to touch.
    """
    if way == LOST:
        return True
    slack = SLACK * wrapping.height
    nearest, top = -1, 0.0
    if is_close(wrapping, point):
        nearest, top = nearest_face(wrapping, point)
    if way == STRAIGHT:
        if top < -slack:
            return starts_on(wrapping, edge, nearest)
        return is_clear(wrapping, edge, point, slack)
    if not within(wrapping, edge, way, place):
        return False
    on, following = wrapping.faces[edge, way, 0], wrapping.faces[edge, way, 1]
    if top < -slack:
        return bool(nearest == following)
    return over(wrapping, edge, on, point) <= slack and over(
        wrapping, edge, following, point) >= -slack


@compiled
def is_close(wrapping: Wrapping, point: Point) -> bool:
    """Check that a point in body axes is no farther from the centre than the corners."""
    x, y, z = wrapping.corners[0, 0], wrapping.corners[0, 1], wrapping.corners[0, 2]
    square: float = point[0] ** 2 + point[1] ** 2 + point[2] ** 2
    return square <= x * x + y * y + z * z
