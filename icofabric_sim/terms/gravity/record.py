# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The record of the term."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Gravity(Record):
    """An acceleration of all bodies that are free to fall."""

    acceleration: np.ndarray  # (3,) [m/s^2], with that of charges in a uniform electric field

    @classmethod
    def absent(cls) -> 'Gravity':
        """Return the record that stands for None."""
        return cls(np.zeros(3))
