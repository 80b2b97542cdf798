# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The record of the term."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Dipole(Record):
    """A uniform electric field, and the dipoles that turn in it."""

    field: np.ndarray  # (3,) E [V/m]
    moment: np.ndarray  # (3,) p [C m], body axes
    largest: float  # |p| |E| [J]
