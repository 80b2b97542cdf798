# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The record of the term."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Coulomb(Record):
    """Charges and dipoles at the centres of bodies."""

    strength: float  # kappa = q^2 / (4 pi eps_0) [J m] of the largest charge q, see packing
    slots: np.ndarray  # (n,) int32, the slots of charged bodies and of dipoles
    charge: np.ndarray  # (1, s) relative to q
    moment: np.ndarray | None  # (3, s) p / q [m], body axes; None: no dipoles
