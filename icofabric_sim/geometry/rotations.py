# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Conversion between unit quaternions (x y z w) and direction cosines mu_ij = e_i . e0_j (eq 17).
"""

import numpy as np


def cosines_from_quaternions(orientation: np.ndarray) -> np.ndarray:
    """
    Return direction cosines (n, 3, 3): row i is body axis i in world components.

    `orientation` is (n, 4), x y z w.
    """
    x, y, z, w = orientation.T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=-1),
            np.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], axis=-1),
            np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=-2,
    )


def quaternions_from_cosines(cosines: np.ndarray) -> np.ndarray:
    """
    Return unit quaternions (n, 4) with w >= 0 of direction cosines (n, 3, 3).

    The largest of the four components is computed first (Shepperd 1978, J. Guid. Control 1, 223),
    to avoid loss of precision.
    """
    m = np.swapaxes(cosines, -1, -2)  # body to world
    trace = m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2]
    squares = np.stack(
        [
            1 + 2 * m[:, 0, 0] - trace,
            1 + 2 * m[:, 1, 1] - trace,
            1 + 2 * m[:, 2, 2] - trace,
            1 + trace,
        ],
        axis=-1,
    )  # 4 q_i^2
    differences = np.stack(
        [m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], axis=-1
    )
    products = np.empty((len(m), 4, 4))  # 4 q_i q_j
    for i in range(3):
        for j in range(3):
            products[:, i, j] = m[:, i, j] + m[:, j, i]
        products[:, i, 3] = products[:, 3, i] = differences[:, i]
    for i in range(4):
        products[:, i, i] = squares[:, i]
    row = products[np.arange(len(m)), np.argmax(squares, axis=1)]
    quaternion = row / np.linalg.norm(row, axis=1, keepdims=True)
    return np.where(quaternion[:, 3:] < 0.0, -quaternion, quaternion)


def unit_quaternions(orientation: np.ndarray) -> np.ndarray:
    """
    Return quaternions (n, 4) of unit length.

    Quaternions already of unit length to 4e-16 are returned unchanged, as are zero and non-finite
    ones.
    """
    with np.errstate(all='ignore'):
        length = np.linalg.norm(orientation, axis=1, keepdims=True)
        off = (np.abs(length - 1.0) > 4e-16) & (length > 0.0) & (length < np.inf)
        return np.asarray(np.where(off, orientation / length, orientation))


def relative_rotation(orientation: np.ndarray, before: np.ndarray) -> np.ndarray:
    """
    Return quaternions x y z w, (n, 4), of the rotations from `before` to `orientation`.
    """
    x1, y1, z1, w1 = orientation.T
    x2, y2, z2, w2 = before.T
    return np.stack([
        x1 * w2 - w1 * x2 - y1 * z2 + z1 * y2, y1 * w2 - w1 * y2 + x1 * z2 - z1 * x2,
        z1 * w2 - w1 * z2 - x1 * y2 + y1 * x2, w1 * w2 + x1 * x2 + y1 * y2 + z1 * z2], axis=-1)


def rotate_quaternions(rotation: np.ndarray, orientation: np.ndarray) -> np.ndarray:
    """
    Rotate quaternions x y z w, (n, 4), by rotation vectors (n, 3) [rad] in the world frame.
    """
    angle = np.linalg.norm(rotation, axis=1, keepdims=True)
    vector = 0.5 * np.sinc(angle / (2.0 * np.pi)) * rotation
    scalar = np.cos(0.5 * angle)
    v, w = orientation[:, :3], orientation[:, 3:]
    turned = np.hstack([
        scalar * v + w * vector + np.cross(vector, v),
        scalar * w - (v * vector).sum(axis=1, keepdims=True)])
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def rotate_axes(rotation: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Rotate body axes (n, 3, 3), as rows, by rotation vectors (n, 3) [rad] in the world frame."""
    angle = np.linalg.norm(rotation, axis=1)[:, None, None]
    cross = np.zeros_like(axes)
    cross[:, 0, 1], cross[:, 0, 2] = -rotation[:, 2], rotation[:, 1]
    cross[:, 1, 0], cross[:, 1, 2] = rotation[:, 2], -rotation[:, 0]
    cross[:, 2, 0], cross[:, 2, 1] = -rotation[:, 1], rotation[:, 0]
    matrix = np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(
        angle / (2.0 * np.pi))**2 * (cross @ cross)
    return np.asarray(axes @ np.swapaxes(matrix, 1, 2))
