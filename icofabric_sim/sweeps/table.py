# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The results of a sweep: one row per run, in the order of the plan."""

from collections.abc import Iterable, Sequence
from importlib import import_module
import json
import math
import os
from pathlib import Path
from typing import Any, Final

from icofabric_sim import checks
from icofabric_sim.libraries import import_library
from icofabric_sim.simulation.model.as_table import AsTable
from icofabric_sim.sweeps.plan import Plan
from icofabric_sim.sweeps.single_run import Outcome, State
from icofabric_sim.sweeps.values import parse_name
import numpy as np

SUFFIXES: Final = ('.csv', '.parquet')
_RUN, _STATE, _REASON, _KEY = 'run', 'state', 'reason', 'key'


class SweepTable(AsTable):
    """
    Results of a sweep: columns by name, with units.

    `table['elasticity.density']` is an array with NaN for failed runs; `units` gives the units.
    `to_csv`, `to_parquet` and `to_pandas` name columns with their units, as in
    'elasticity.density [kg/m^3]'.
    """

    def __init__(self, plan: Plan, outcomes: Iterable[Outcome], *, store: Path) -> None:
        """Put finished runs in the order of the plan; unfinished runs are omitted."""
        self.varied = plan.names
        self.store = store
        self.outcomes: tuple[Outcome, ...] = tuple(sorted(outcomes))
        self.units: dict[str, str] = {name: parse_name(name).unit for name in plan.names}
        numbers = [outcome.number for outcome in self.outcomes]
        self._columns: dict[str, list[Any]] = {_RUN: numbers}
        for place, name in enumerate(plan.names):
            parsed = parse_name(name)
            values = [plan.points[number][place] for number in numbers]
            if None in values:
                default = plan.base[parsed.parameter] if parsed.parameter in plan.base else None
                if parsed.element is not None and default is not None:
                    default = default[parsed.element]
                values = [default if value is None else value for value in values]
            self._columns[name] = _fill_missing(values)
        found: dict[str, dict[int, Any]] = {}
        for row, outcome in enumerate(self.outcomes):
            for column in outcome.columns:
                found.setdefault(column.name, {})[row] = column.value
                self.units.setdefault(column.name, column.unit)
        self.kept = tuple(found)
        for name, values_of in found.items():
            missing = '' if isinstance(next(iter(values_of.values())), str) else math.nan
            self._columns[name] = [
                values_of.get(row, missing) for row in range(len(self.outcomes))]
        self._columns[_STATE] = [outcome.state.value for outcome in self.outcomes]
        self._columns[_REASON] = [outcome.reason for outcome in self.outcomes]
        self._columns[_KEY] = [outcome.key for outcome in self.outcomes]

    def __repr__(self) -> str:
        """Return the numbers of runs, failures and columns."""
        failed = len(self.failed)
        return (f'<SweepTable: {len(self.outcomes):,} runs'
                f'{f", {failed:,} of them failed" if failed else ""}, '
                f'{len(self.kept)} columns kept>')

    def __len__(self) -> int:
        """Count the runs."""
        return len(self.outcomes)

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column by its name without the unit."""
        if name not in self._columns:
            raise KeyError(f'there is no column {name!r}; there are: {", ".join(self._columns)}')
        values = self._columns[name]
        lists = [value for value in values if isinstance(value, list)]
        if lists:
            hole = [math.nan] * len(lists[0])
            return np.array([hole if value is None else value for value in values], float)
        return np.array(values)

    def __iter__(self) -> Any:
        """Iterate over the names of the columns."""
        return iter(self._columns)

    @property
    def failed(self) -> tuple[Outcome, ...]:
        """Runs without a result, with their reasons."""
        return tuple(one for one in self.outcomes if one.state is not State.DONE)

    def folder(self, number: int) -> Path:
        """Return the folder of a run: scene, result, and the bag if kept."""
        for outcome in self.outcomes:
            if outcome.number == number:
                return self.store / outcome.key
        raise KeyError(f'there is no run {number!r}')

    def table(self) -> dict[str, list[Any]]:
        """Return a list for each column, named with its unit; the first lists run numbers."""
        return {self._title(name): [_cell(value) for value in values]
                for name, values in self._columns.items()}

    def to_parquet(self, path: str | os.PathLike[str]) -> None:
        """
        Write the table to a Parquet file; needs pyarrow.

        Columns have the names of the CSV file, and also their units as metadata `unit`.
        """
        place = checks.path('path', path)
        arrow, parquet = parquet_modules()
        columns = self.table()
        arrays = {name: arrow.array(values) for name, values in columns.items()}
        fields = [
            arrow.field(title, arrays[title].type, metadata={'unit': self.units.get(name, '')})
            for title, name in zip(columns, self._columns)]
        parquet.write_table(
            arrow.table(list(arrays.values()), schema=arrow.schema(fields)), place)

    def save(self, path: Path) -> None:
        """Write a CSV or Parquet file, chosen by the suffix, atomically."""
        require_suffix(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        aside = path.with_name(f'.{path.stem}.{os.getpid()}{path.suffix}')
        try:
            (self.to_csv if path.suffix == '.csv' else self.to_parquet)(aside)
            aside.replace(path)
        finally:
            aside.unlink(missing_ok=True)

    def lines(self, row_count: int = 20, columns: Sequence[str] = ()) -> list[str]:
        """Return the first rows for a terminal, with the varied and some of the kept columns."""
        # Without any finished run, the kept columns do not exist.
        names = list(dict.fromkeys([_RUN, *self.varied, *(
            [name for name in columns if name in self._columns] or self.kept[:4])]))
        rows = [[_short(self._columns[name][row]) for name in names]
                for row in range(min(len(self), row_count))]
        for row, outcome in enumerate(self.outcomes[:row_count]):
            if outcome.state is not State.DONE:
                rows[row].append(f'{outcome.state.value}: {outcome.reason}')
        titles = [self._title(name) for name in names]
        widths = [max([len(title), *(len(row[place]) for row in rows)])
                  for place, title in enumerate(titles)]
        # The reason of a failed run follows the last column.
        said = ['  '.join(text.rjust(width) for text, width in zip(texts, [*widths, 0]))
                for texts in (titles, *rows)]
        if len(self) > row_count:
            said.append(f'... and {len(self) - row_count:,} more')
        return said

    def _title(self, name: str) -> str:
        unit = self.units.get(name, '')
        return f'{name} [{unit}]' if unit else name


def require_suffix(path: Path) -> Path:
    """Raise ValueError unless the suffix names a CSV file or a writable Parquet file."""
    if path.suffix not in SUFFIXES:
        raise ValueError(f'{path}: a table is a file that ends in {" or ".join(SUFFIXES)}')
    if path.suffix == '.parquet':
        parquet_modules()
    return path


def parquet_modules() -> tuple[Any, Any]:
    """Return the modules of pyarrow. Raise MissingLibrary if it is not installed."""
    arrow = import_library('pyarrow', 'a Parquet file', without='a CSV file does not')
    return arrow, import_module('pyarrow.parquet')


def _fill_missing(values: list[Any]) -> list[Any]:
    """Replace None of cases without a value by NaN, or '' among strings; keep it among lists."""
    sample = next((value for value in values if value is not None), None)
    if isinstance(sample, (list, bool)):
        return values
    missing = '' if isinstance(sample, str) else math.nan
    return [missing if value is None else value for value in values]


def _cell(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list) else value


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f'{value:.6g}'
    return '' if value is None else str(_cell(value))
