# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The law for NumPy."""

from collections.abc import Mapping, Sequence
import math
from typing import NamedTuple

import numpy as np

# Below this |x| the series of exp(x) - 1 - x has no cancellation.
_SERIES_LIMIT = 0.5
_COEFFICIENTS = [1.0 / math.factorial(n) for n in range(18, 1, -1)]


class ExponentialCurve(NamedTuple):
    """Tension k/alpha (exp(alpha (l - D)) - 1)."""

    alpha: float  # [1/m]

    @property
    def law(self) -> str:
        """Name of the law."""
        return 'exponential'

    @property
    def text(self) -> str:
        """Description for messages."""
        return f'exponential, alpha {self.alpha:.6g} 1/m'

    @property
    def limits(self) -> tuple[float, float]:
        """All lengths [m]."""
        return -math.inf, math.inf

    @property
    def has_corners(self) -> bool:
        """False: the law is smooth."""
        return False

    def evaluate(
        self, length: np.ndarray, stiffness: np.ndarray, natural_length: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return tensions [N] and energies k/alpha^2 (exp(x) - 1 - x) [J], x = alpha (l - D)."""
        x = self.alpha * (length - natural_length)
        grown = np.expm1(x)
        series = x * x * np.polyval(_COEFFICIENTS, np.clip(x, -_SERIES_LIMIT, _SERIES_LIMIT))
        rest = np.where(np.abs(x) < _SERIES_LIMIT, series, grown - x)
        return stiffness / self.alpha * grown, stiffness / self.alpha**2 * rest

    def slope(
        self, length: np.ndarray, stiffness: np.ndarray, natural_length: np.ndarray
    ) -> np.ndarray:
        """Return slopes k exp(alpha (l - D)) [N/m]."""
        return np.asarray(stiffness * np.exp(self.alpha * (length - natural_length)))


def make_curve(values: Mapping[str, float]) -> ExponentialCurve:
    """Return the law with these values of its parameters; raise ValueError without exponent."""
    if values['alpha'] == 0.0:
        raise ValueError('alpha is 0, which is a spring: give alpha [1/m], or leave out the law')
    return ExponentialCurve(values['alpha'])


def rows(curves: Sequence[ExponentialCurve | None]) -> dict[str, np.ndarray]:
    """Return the values of each of `curves` for the record, 0 for other laws."""
    return {'alpha': np.array([0.0 if curve is None else curve.alpha for curve in curves])}
