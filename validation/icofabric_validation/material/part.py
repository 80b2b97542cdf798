# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Records of the study: stages of runs, parts, tables; and what all parts share."""

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
# Half an edge of a shell [m] and stiffness of a connector [N/m]; results are in units of them.
HALF_EDGE: Final = 0.01
K: Final = 500.0
LEAST: Final = MINIMUM_ANGLE
# [N m/rad]
BENDING_UNIT: Final = K * HALF_EDGE**2

Row = Mapping[str, Any]


class Level(IntEnum):
    """How much of a study is done."""

    QUICK = 0  # some minutes of one core
    USUAL = 1  # what docs/study.md shows
    LARGE = 2  # larger slabs and more values, hours of one core

    def pick(self, quick: _T, usual: _T, large: _T) -> _T:
        """What belongs to it."""
        return (quick, usual, large)[self]


class Stage(NamedTuple):
    """Runs of one kind."""

    cases: Sequence[Mapping[str, Any]]  # parameters that differ
    verbs: Sequence[str]
    keep: Sequence[str]
    seconds: float  # that a run takes on one core, about
    base: Mapping[str, Any] = {}  # parameters that all of them have


class Table(NamedTuple):
    """A table of a part, as text."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    note: str = ''

    def lines(self) -> list[str]:
        """The table as pages have it."""
        return [
            '| ' + ' | '.join(self.columns) + ' |', '|' + '---|' * len(self.columns),
            *('| ' + ' | '.join(map(cell, row)) + ' |' for row in self.rows)]


# What the stages of a part have found, by their names: a row a run.
Found = Mapping[str, Sequence[Row]]


class Part(NamedTuple):
    """One question of the study."""

    name: str
    title: str
    stages: Callable[[Level], dict[str, Stage]]
    tables: Callable[[Found], list[Table]]


def rows_of(table: SweepTable) -> list[Row]:
    """The runs of a stage as dictionaries, in their order; values of failed ones are NaN or ''."""
    columns = {name: table[name].tolist() for name in table}
    return [{name: values[row] for name, values in columns.items()}
            for row in range(len(table))]


def woven(angle: float) -> WeaveGeometry:
    """Lengths of a weave of the shells of the study."""
    return geometry_from_angle(HALF_EDGE, angle)


def modulus_unit(angle: float) -> float:
    """Return k / W [Pa]."""
    return K / woven(angle).pitch


def closed_form(angle: float) -> float:
    """Poisson's ratio along an axis of the periodic fabric of point springs (docs/material.md)."""
    s = math.sin(2.0 * angle)
    return s / (2.0 + s)


def cell(value: Any) -> str:
    """A value as a table has it: three digits, a dash where there is none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return str(value)
    if not math.isfinite(value):
        return '-'
    if isinstance(value, int) or (value == int(value) and abs(value) < 1e6):
        return f'{int(value):,}'
    return f'{value:.3g}'


def fixed(value: float, digits: int) -> str:
    """A value with so many digits behind the point; a dash where there is none."""
    if not math.isfinite(value):
        return '-'
    text = f'{value:.{digits}f}'
    return text.removeprefix('-') if not float(text) else text


def angles(count: int, last: float) -> list[float]:
    """Connector angles [rad] from the least one, level connectors among them."""
    step = (last - LEAST) / (count - 1)
    found = [LEAST + step * number for number in range(count)]
    nearest = min(range(1, count), key=lambda number: abs(found[number]))
    found[nearest] = 0.0
    return found
