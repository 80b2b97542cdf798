# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The record of the term."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Magnet(Record):
    """A uniform magnetic field, and the charges that move in it."""

    field: np.ndarray  # (3,) B [T]
    charge: np.ndarray  # (1, s) q [C]
    moment: np.ndarray  # (3, s) dipole [C m], body axes
    second: np.ndarray  # (1, s) s = q Lambda / (2 M) [C m^2]
