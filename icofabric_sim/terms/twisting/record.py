# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The record of the term."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Twisting(Record):
    """Resistance to rotations of two connected bodies against each other."""

    stiffness: float  # kappa_t [N m/rad]; of many the largest
    variety: np.ndarray | None  # (12, s) [N m/rad] where not all are alike
    woven: np.ndarray | None  # (9, s) world components of the woven body axes, where they differ
