# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Constants of surface forces."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Tractions(Record):
    """
    Surface forces, summed over the faces of each body, see sums.py.

    A row for every block that a surface force acts on, with the numbers of all lanes adjacent.
    """

    first: int  # rows of the loads whose wrench is this or later are surface forces
    place: np.ndarray  # (m,) int64 number of a row of the loads among the r rows here
    # (6 LANES r,) force [N] and torque about the centre [N m] that turn with the body, body axes
    turning: np.ndarray | None
    # (12 LANES r,) force [N] of fixed direction, world axes, and first moments [N m]: the sum of
    # p F_k over the faces, p in body axes, for the world axes k = x, y, z
    fixed: np.ndarray | None
    # (45 LANES r,) [N], [N m] without friction: sums of n n F (xx, xy, xz, yy, yz, zz of body
    # axes, each along the three of the world) and of (p x n) n F (two body axes, one of the world)
    sliding: np.ndarray | None
    kept: np.ndarray  # (6 LANES r,) [N], [N m] wrench of the last kick, world axes
    force: np.ndarray  # (LANES r,) [N] bound of the force on each body; not for kernels
    moment: np.ndarray  # (LANES r,) [N m] bound of the torque
