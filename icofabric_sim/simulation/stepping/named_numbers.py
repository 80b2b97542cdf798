# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Names of values that kernels read and write in one array.

Kernels use indices; Python reads and writes, for example, `ledger.rate`.
"""

from typing import Any

import numpy as np


class At:
    """A value at an index of the array `numbers` of its object."""

    def __init__(self, place: int) -> None:
        """Refer to the value at index `place`."""
        self._place = place

    def __get__(self, holder: Any, owner: Any = None) -> float:
        """Return the value."""
        return float(holder.numbers[self._place])

    def __set__(self, holder: Any, value: float) -> None:
        """Write the value."""
        numbers: np.ndarray = holder.numbers
        numbers[self._place] = value
