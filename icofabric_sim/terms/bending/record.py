# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The record of the term."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Bending(Record):
    """
    Resistance to a change of the angle between connectors and bodies.
    """

    stiffness: float  # kappa_b [N m/rad]; of many the largest
    # Directions of connectors in the weave, unit vectors: (12, 3) in body axes, or, if woven
    # orientations differ, (36, s) for each body in world axes.
    direction: np.ndarray
    directions: np.ndarray | None
    variety: np.ndarray | None  # (12, s) [N m/rad] where not all are alike
    woven: np.ndarray | None  # (9, s) world components of the woven body axes, where they differ
