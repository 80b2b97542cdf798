# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Tabulated connector laws: tension over length from a CSV file instead of eq 1.

Between the rows the law is the monotone cubic of Fritsch and Carlson (1980, SIAM J. Numer. Anal.
17, 238) with the slopes of Fritsch and Butland (1984, SIAM J. Sci. Stat. Comput. 5, 300). It does
not overshoot, has a continuous slope, and is linear beyond both ends. The energy is its exact
integral.
"""

from typing import Any, NamedTuple

from icofabric_sim.scene.tables import read_numeric_table
import numpy as np


class LawTable(NamedTuple):
    """
    Piecewise cubic law: f + t (d + t (c + t b)) with t = length - base length, one piece per row.

    Columns: smallest length [m], base length [m], f [N], d, c, b, energy at the base length [J].
    """

    rows: np.ndarray  # (m, 7)
    natural_length: float  # largest length [m] without tension; 0: every length has tension
    largest_slope: float  # [N/m]
    file: str

    @property
    def law(self) -> str:
        """Name of the law."""
        return 'tables'

    @property
    def text(self) -> str:
        """Description for messages."""
        return f'its table {self.file}'

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest length [m] of the table."""
        return float(self.rows[1, 0]), float(self.rows[-1, 0])

    @property
    def has_corners(self) -> bool:
        """True: the slope of the tension has a corner at each row."""
        return True

    def evaluate(
        self, length: np.ndarray, stiffness: Any = None, natural_length: Any = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the tension [N] and the energy [J] at lengths [m]; the rest is in the table."""
        piece = np.searchsorted(self.rows[1:, 0], length, side='left')
        _, base, f, d, c, b, energy = self.rows[piece].T
        t = length - base
        return f + t * (d + t * (c + t * b)), energy + t * (
            f + t * (d / 2.0 + t * (c / 3.0 + t * b / 4.0)))

    def slope(
        self, length: np.ndarray, stiffness: Any = None, natural_length: Any = None
    ) -> np.ndarray:
        """Return the slope of the tension [N/m] at lengths [m]."""
        piece = np.searchsorted(self.rows[1:, 0], length, side='left')
        _, base, _, d, c, b, _ = self.rows[piece].T
        t = length - base
        return np.asarray(d + t * (2.0 * c + t * (3.0 * b)))


def read_law(name: str, file: str) -> LawTable:
    """
    Read a table of length [m] and force [N], positive in tension, for the parameter `name`.

    Raises ParameterError with the file, the line and a remedy.
    """
    table = read_numeric_table(
        name, file, {2: 'length [m], force [N]'}, first='lengths', unit='m')
    return make_law(table[:, 0], table[:, 1], file)


def make_law(length: np.ndarray, force: np.ndarray, file: str = '') -> LawTable:
    """Return the law through points of strictly increasing `length` [m] and `force` [N], (n,)."""
    step = np.diff(length)
    secant = np.diff(force) / step
    slope = monotone_slopes(step, secant)
    # A linear piece before the first point, the cubics, and a linear piece after the last point.
    rows = np.zeros((len(length) + 1, 7))
    rows[0, 0], rows[1:, 0] = -np.inf, length
    rows[0, 1], rows[1:, 1] = length[0], length
    rows[0, 2], rows[1:, 2] = force[0], force
    rows[0, 3], rows[1:, 3] = slope[0], slope
    rows[1:-1, 4] = (3.0 * secant - 2.0 * slope[:-1] - slope[1:]) / step
    rows[1:-1, 5] = (slope[:-1] + slope[1:] - 2.0 * secant) / step**2
    f, d, c, b = rows[1:-1, 2:6].T
    rows[2:, 6] = np.cumsum(step * (f + step * (d / 2.0 + step * (c / 3.0 + step * b / 4.0))))
    # The slope of a cubic is largest at its ends or at its inflection.
    with np.errstate(divide='ignore', invalid='ignore'):
        bend = np.clip(np.nan_to_num(-c / (3.0 * b)), 0.0, step)
    largest = max(float(slope.max()), float((d + bend * (2.0 * c + 3.0 * bend * b)).max()))
    law = LawTable(rows, 0.0, max(largest, 0.0), file)
    rest = _natural_length(law, length, force)
    if rest > 0.0:
        rows[:, 6] -= law.evaluate(np.array([rest]))[1][0]
    return law._replace(natural_length=rest)


def monotone_slopes(step: np.ndarray, secant: np.ndarray) -> np.ndarray:
    """Return slopes (n,) at points with spacing `step` and secant slopes `secant`, (n - 1,)."""
    if len(step) == 1:
        return np.repeat(secant, 2)
    slopes = np.zeros(len(step) + 1)
    before, after = secant[:-1], secant[1:]
    first, second = 2.0 * step[1:] + step[:-1], step[1:] + 2.0 * step[:-1]
    rises = before * after > 0.0
    # A weighted harmonic mean; 0 at a turning point.
    slopes[1:-1][rises] = ((first + second)[rises] / (
        first[rises] / before[rises] + second[rises] / after[rises]))
    for end, (h, g, s, r) in (
            (0, (step[0], step[1], secant[0], secant[1])),
            (-1, (step[-1], step[-2], secant[-1], secant[-2]))):
        value = ((2.0 * h + g) * s - h * r) / (h + g)
        if not value * s > 0.0:
            value = 0.0
        elif not s * r > 0.0 and abs(value) > 3.0 * abs(s):
            value = 3.0 * s
        slopes[end] = value
    return slopes


def _natural_length(law: LawTable, length: np.ndarray, force: np.ndarray) -> float:
    """Return the largest length [m] without tension, or 0 if every length has tension."""
    def tension(value: float) -> float:
        return float(law.evaluate(np.array([value]))[0][0])

    quiet = np.flatnonzero(force <= 0.0)
    if not len(quiet):
        slope = law.rows[0, 3]
        return max(0.0, float(length[0] - force[0] / slope)) if slope > 0.0 else 0.0
    last = int(quiet[-1])
    if force[last] == 0.0:
        return float(length[last])
    if last + 1 == len(length):
        slope = law.rows[-1, 3]
        return float(length[-1] - force[-1] / slope) if slope > 0.0 else 0.0
    # Takes a fifth of a second to import, needed only by scenes with tables.
    from scipy.optimize import brentq

    return float(brentq(tension, length[last], length[last + 1], xtol=1e-300, rtol=1e-15))
