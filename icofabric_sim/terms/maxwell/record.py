# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The record of the term."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Maxwell(Record):
    """A spring and a dashpot in series, parallel to each connector."""

    stiffness: float  # k_1 [N/m]; of many the largest
    rate: float  # 1 / tau [1/s]; of many the largest
    own_stiffness: np.ndarray | None  # (12, s) [N/m] of the connectors at each body
    own_rate: np.ndarray | None  # (12, s) [1/s] likewise; both where not all are alike
