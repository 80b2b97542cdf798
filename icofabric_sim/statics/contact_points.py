# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Contacts of a configuration as friction needs them: normal forces, points, normals, patches."""

from typing import NamedTuple

from icofabric_sim.terms.contacts.laws import patch_radius
import numpy as np


class ContactPoints(NamedTuple):
    """Contacts of a configuration with normal forces, points and normals."""

    pairs: np.ndarray  # (p, 2) bodies; the second one -1 - k: plane k
    push: np.ndarray  # (p,) normal force N [N]
    point: np.ndarray  # (p, 3) [m] world
    normal: np.ndarray  # (p, 3) direction of the normal force on the first body
    radius: np.ndarray  # (p,) [m] effective radius of the patch for friction about the normal
    # (p, 12) force and torque about its centre on the first body, and on the second, for N = 1 N
    wrenches: np.ndarray
    overlap: np.ndarray  # (p,) [m]


def contact_points_from(
    pairs: np.ndarray, pushes: np.ndarray, out: np.ndarray, middle: np.ndarray
) -> ContactPoints:
    """
    Return contacts from kernel output `out` (p, 20).

    `middle` (p, 3) [m] is the midpoint of both bodies, and `pushes` (p, 3) [N] the normal force on
    the first one.
    """
    size = np.linalg.norm(out[:, :3], axis=1)
    # Contact in a single point or edge may have no normal force.
    there = size > 0.0
    pairs, pushes, out, middle, size = (
        part[there] for part in (pairs, pushes, out, middle, size))
    push = np.linalg.norm(pushes, axis=1)
    return ContactPoints(
        pairs, push, out[:, 15:18] + middle, out[:, :3] / size[:, None],
        np.array([patch_radius(row) for row in out]),
        np.hstack([out[:, :6], -out[:, :3], out[:, 6:9]]) / size[:, None],
        np.where(push > 0.0, out[:, 11], 0.0))
