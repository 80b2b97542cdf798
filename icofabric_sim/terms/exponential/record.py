# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The record of the law."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Exponential(Record):
    """Exponents of the connectors at each body; k and D are those of its springs."""

    alpha: np.ndarray  # (12, s) [1/m], 0: the connector follows another law
