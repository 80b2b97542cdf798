# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Paths of driven bodies."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Drives(Record):
    """Paths of driven bodies, see path.py; world frame."""

    start: np.ndarray  # (p,) [s] start of the present interval of each path
    cubic: np.ndarray  # (p, 4, 6) [m], [rad], and by powers of [s]
    wave: np.ndarray  # (p, 6) [m], [rad]
    rate: np.ndarray  # (p,) [rad/s]
    phase: np.ndarray  # (p,) [rad]
    base: np.ndarray  # (p, 3) [m] middle of the bodies without displacement
    turn: np.ndarray  # (p, 4) x y z w: their rotation without displacement
    arm: np.ndarray  # (3, s) [m] from the middle to each body at the start
    first: np.ndarray  # orientations at the start, in the form of the state
    # (p, 4) uint8: whether they move along x, y, z, and turn; other freedoms stay free
    moves: np.ndarray
