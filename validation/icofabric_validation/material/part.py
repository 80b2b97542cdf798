# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Records of the material study (stages, parts, tables), and shared functions."""

from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
import math
from typing import Any, Final, NamedTuple, TypeVar

from icofabric_sim.scene.weave_geometry import (
    geometry_from_angle,
    MINIMUM_ANGLE,
    WeaveGeometry,
)
from icofabric_sim.sweeps.table import SweepTable

_T = TypeVar('_T')
# Half edge of a shell [m] and stiffness of a connector [N/m]; results are in these units.
HALF_EDGE: Final = 0.01
K: Final = 500.0
MIN_ANGLE: Final = MINIMUM_ANGLE  # [rad]
# Unit of bending stiffness [N m/rad].
BENDING_UNIT: Final = K * HALF_EDGE**2

Row = Mapping[str, Any]


class Level(IntEnum):
    """The extent of a study."""

    QUICK = 0  # some minutes of one core
    USUAL = 1  # the results in docs/study.md
    LARGE = 2  # larger slabs and more values, hours of one core

    def pick(self, quick: _T, usual: _T, large: _T) -> _T:
        """Return the value for this level."""
        return (quick, usual, large)[self]


class Stage(NamedTuple):
    """Runs with the same verbs and results."""

    cases: Sequence[Mapping[str, Any]]  # parameters that differ
    verbs: Sequence[str]
    keep: Sequence[str]
    seconds: float  # approximate time of a run on one core
    base: Mapping[str, Any] = {}  # common parameters


class Table(NamedTuple):
    """A table of a part, as text."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    note: str = ''

    def lines(self) -> list[str]:
        """Return the table in Markdown."""
        return [
            '| ' + ' | '.join(self.columns) + ' |', '|' + '---|' * len(self.columns),
            *('| ' + ' | '.join(map(cell, row)) + ' |' for row in self.rows)]


# Results of the stages of a part by name; a row for each run.
Results = Mapping[str, Sequence[Row]]


class Part(NamedTuple):
    """One question of the study."""

    name: str
    title: str
    stages: Callable[[Level], dict[str, Stage]]
    tables: Callable[[Results], list[Table]]


def rows_of(table: SweepTable) -> list[Row]:
    """Return the runs of a stage as dictionaries; values of failed runs are NaN or ''."""
    columns = {name: table[name].tolist() for name in table}
    return [{name: values[row] for name, values in columns.items()}
            for row in range(len(table))]


def woven(angle: float) -> WeaveGeometry:
    """Return the geometry of a weave of the shells of the study."""
    return geometry_from_angle(HALF_EDGE, angle)


def modulus_unit(angle: float) -> float:
    """Return the unit of moduli, k / W [Pa]."""
    return K / woven(angle).pitch


def closed_form_ratio(angle: float) -> float:
    """Return Poisson's ratio along an axis for point springs (docs/material.md)."""
    s = math.sin(2.0 * angle)
    return s / (2.0 + s)


def cell(value: Any) -> str:
    """Return a value with three digits, or a dash if it is not finite."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return str(value)
    if not math.isfinite(value):
        return '-'
    if isinstance(value, int) or (value == int(value) and abs(value) < 1e6):
        return f'{int(value):,}'
    return f'{value:.3g}'


def fixed(value: float, digits: int) -> str:
    """Return a value with `digits` decimals, or a dash if it is not finite."""
    if not math.isfinite(value):
        return '-'
    text = f'{value:.{digits}f}'
    return text.removeprefix('-') if not float(text) else text


def angles(count: int, last: float) -> list[float]:
    """Return connector angles [rad] from the smallest one to `last`, with 0 among them."""
    step = (last - MIN_ANGLE) / (count - 1)
    found = [MIN_ANGLE + step * number for number in range(count)]
    nearest = min(range(1, count), key=lambda number: abs(found[number]))
    found[nearest] = 0.0
    return found
