# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of results: CSV files and data frames of pandas."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
import csv
import os
from typing import Any, Protocol, TypeVar

from icofabric_sim import checks
from icofabric_sim.libraries import import_library


class AsTable(ABC):
    """Base class of results that form a table, with output to CSV files and pandas."""

    @abstractmethod
    def table(self) -> dict[str, list[Any]]:
        """
        Return a list for each column, named with its unit; the first column numbers the rows.
        """

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the table to a CSV file with all digits."""
        columns = self.table()
        with open(checks.path('path', path), 'w', newline='', encoding='utf-8') as stream:
            table = csv.writer(stream)
            table.writerow(columns)
            table.writerows(zip(*columns.values()))

    def to_pandas(self) -> Any:
        """Return the table as a DataFrame; raise ImportError if pandas is missing."""
        pandas = import_library(
            'pandas', 'to_pandas', without='table() and to_csv() do not')
        columns = self.table()
        return pandas.DataFrame(columns).set_index(next(iter(columns)))


class Row(Protocol):
    """A row of a table of results."""

    def row(self) -> Sequence[Any]:
        """Return the values of the row, one for each column."""


_Row = TypeVar('_Row', bound=Row)


class Results(list[_Row], AsTable):
    """A list of results of one type that is also a table."""

    def __init__(
        self, columns: Sequence[str], results: Iterable[_Row] = (), *, number: str = ''
    ) -> None:
        """Name the `columns`, with units; a column `number` counts the rows from 1."""
        super().__init__(results)
        self.columns, self.number = tuple(columns), number

    def __repr__(self) -> str:
        """Return the type, the number of results and the range of the first column."""
        if not self:
            return '<no results>'
        first, last = self[0].row()[0], self[-1].row()[0]
        reach = f'{first:.6g} to {last:.6g}' if len(self) > 1 else f'{first:.6g}'
        return f'<{len(self):,} of {type(self[0]).__name__}: {self.columns[0]} {reach}>'

    def table(self) -> dict[str, list[Any]]:
        """Return a list for each column."""
        rows = [result.row() for result in self]
        numbers = {self.number: list(range(1, len(self) + 1))} if self.number else {}
        return {**numbers,
                **{name: [row[k] for row in rows] for k, name in enumerate(self.columns)}}
