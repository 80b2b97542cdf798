# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Numbers that kernels read and write in one array, by name.

Kernels know them by their places; Python reads and writes `ledger.rate`.
"""

from typing import Any

import numpy as np


class At:
    """A number by its place in the array `numbers` of the object that it is part of."""

    def __init__(self, place: int) -> None:
        """Stand for the number at `place`."""
        self._place = place

    def __get__(self, holder: Any, owner: Any = None) -> float:
        """Return the number."""
        return float(holder.numbers[self._place])

    def __set__(self, holder: Any, value: float) -> None:
        """Write the number."""
        numbers: np.ndarray = holder.numbers
        numbers[self._place] = value
