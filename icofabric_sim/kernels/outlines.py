# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Ends of connectors and corners of shells, for messages and figures.

Bodies first: `position` (n, 3) [m], `orientation` (n, 4) unit quaternions x y z w. Points are
written directly to their destination, which need not be aligned in memory, without intermediate
copies.
"""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.terms.shared import Connectors
import numpy as np


@compiled
def edge_point(
    connectors: Connectors, position: np.ndarray, orientation: np.ndarray, b: int, edge: int
) -> tuple[float, float, float]:
    """
    Return the attachment point at an edge of body `b` [m], world frame; the midpoint in eq 49.

    Edge codes: up, down, north, south, west, east, on the body axes z, x, y.
    """
    x, y, z = arm_at(connectors.attachment, connectors.half_width, orientation, b, edge)
    return position[b, 0] + x, position[b, 1] + y, position[b, 2] + z


@compiled
def arm_at(
    attachment: np.ndarray | None, half_width: float, orientation: np.ndarray, b: int, edge: int
) -> tuple[float, float, float]:
    """Return the arm [m] from the centre of body `b` to its attachment point, world frame."""
    if attachment is None:
        return arm_on_axis(half_width, orientation, b, edge)
    else:
        vx, vy, vz = attachment[edge, 0], attachment[edge, 1], attachment[edge, 2]
        x, y, z, w = orientation[b, 0], orientation[b, 1], orientation[b, 2], orientation[b, 3]
        tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
        return (
            vx + w * tx + y * tz - z * ty, vy + w * ty + z * tx - x * tz,
            vz + w * tz + x * ty - y * tx)


@compiled
def arm_on_axis(
    half_width: float, orientation: np.ndarray, b: int, edge: int
) -> tuple[float, float, float]:
    """Return the arm [m] to an attachment point on a body axis, world frame."""
    x, y, z, w = orientation[b, 0], orientation[b, 1], orientation[b, 2], orientation[b, 3]
    h = half_width
    axis = edge >> 1
    if axis == 0:
        ax = h * 2.0 * (x * z + w * y)
        ay = h * 2.0 * (y * z - w * x)
        az = h * (1.0 - 2.0 * (x * x + y * y))
    elif axis == 1:
        ax = h * (1.0 - 2.0 * (y * y + z * z))
        ay = h * 2.0 * (x * y + w * z)
        az = h * 2.0 * (x * z - w * y)
    else:
        ax = h * 2.0 * (x * y - w * z)
        ay = h * (1.0 - 2.0 * (x * x + z * z))
        az = h * 2.0 * (y * z + w * x)
    sign = 1.0 - 2.0 * (edge & 1)
    return sign * ax, sign * ay, sign * az


@compiled
def fill_lengths(
    connectors: Connectors, position: np.ndarray, orientation: np.ndarray, lengths: np.ndarray
) -> None:
    """Write the lengths [m] of all connectors into `lengths` (c,)."""
    for c in range(connectors.first.shape[0]):
        x0, y0, z0 = edge_point(
            connectors, position, orientation, connectors.first[c], connectors.first_edge[c])
        x1, y1, z1 = edge_point(
            connectors, position, orientation, connectors.second[c], connectors.second_edge[c])
        dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
        lengths[c] = math.sqrt(dx * dx + dy * dy + dz * dz)


@compiled
def classify(
    lengths: np.ndarray, natural_length: np.ndarray, bounds: np.ndarray, classes: np.ndarray,
    counts: np.ndarray
) -> None:
    """
    Write the class of the strain of every connector: the number of `bounds` that it exceeds.

    `natural_length` (c,), or (1,) for all; `classes` (c,) uint8; `counts` of each class, one more
    than the bounds. NaN exceeds all bounds. Hinges, of natural length 0, have no strain.
    """
    counts[:] = 0
    for c in range(lengths.shape[0]):
        rest = natural_length[c if c < natural_length.shape[0] else 0]
        strain = lengths[c] / rest - 1.0 if rest > 0.0 else 0.0
        number = 0
        for k in range(bounds.shape[0]):
            if not strain <= bounds[k]:
                number += 1
        classes[c] = number
        counts[number] += 1


@compiled
def fill_lines(
    connectors: Connectors, position: np.ndarray, orientation: np.ndarray, classes: np.ndarray,
    wanted: int, points: np.ndarray
) -> None:
    """
    Write both ends [m] of every connector of the class `wanted`, in order, into `points` (2 m, 3).
    """
    row = 0
    for c in range(classes.shape[0]):
        if classes[c] == wanted:
            x, y, z = edge_point(
                connectors, position, orientation, connectors.first[c], connectors.first_edge[c])
            points[row, 0], points[row, 1], points[row, 2] = x, y, z
            x, y, z = edge_point(
                connectors, position, orientation, connectors.second[c], connectors.second_edge[c])
            points[row + 1, 0], points[row + 1, 1], points[row + 1, 2] = x, y, z
            row += 2


@compiled
def fill_shells(
    bodies: np.ndarray, position: np.ndarray, orientation: np.ndarray, vertices: np.ndarray,
    corners: np.ndarray, points: np.ndarray
) -> None:
    """
    Write the corners [m] of the faces of some bodies, in order, into `points` (m k, 3).

    `vertices` (v, 3) [m] in body axes; `corners` (k,) their numbers, three for each face.
    """
    world = np.empty(vertices.shape)
    count = corners.shape[0]
    for row in range(bodies.shape[0]):
        b = bodies[row]
        x, y, z, w = orientation[b, 0], orientation[b, 1], orientation[b, 2], orientation[b, 3]
        for v in range(vertices.shape[0]):
            vx, vy, vz = vertices[v, 0], vertices[v, 1], vertices[v, 2]
            # Twice the cross product of the quaternion's axis with the vector (eq 26).
            tx = 2.0 * (y * vz - z * vy)
            ty = 2.0 * (z * vx - x * vz)
            tz = 2.0 * (x * vy - y * vx)
            world[v, 0] = position[b, 0] + vx + w * tx + y * tz - z * ty
            world[v, 1] = position[b, 1] + vy + w * ty + z * tx - x * tz
            world[v, 2] = position[b, 2] + vz + w * tz + x * ty - y * tx
        for k in range(count):
            v = corners[k]
            at = row * count + k
            points[at, 0], points[at, 1], points[at, 2] = world[v, 0], world[v, 1], world[v, 2]
