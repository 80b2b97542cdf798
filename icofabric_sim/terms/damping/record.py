# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The record of the term."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Damping(Record):
    """Damping along the connectors."""

    coefficient: float  # c [N s/m]; of many the largest
    own: np.ndarray | None  # (12, s) [N s/m] of the connectors at each body, where not all alike
