# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Results as plain numbers: CSV files, and tables of pandas."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
import csv
import os
from typing import Any, Protocol, TypeVar

from icofabric_sim import checks
from icofabric_sim.libraries import import_library


class AsTable(ABC):
    """What has a `table()`; writes it to files and hands it to pandas."""

    @abstractmethod
    def table(self) -> dict[str, list[Any]]:
        """A list for each column, named with its unit; the first one numbers the rows."""

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the table to a CSV file, numbers in full."""
        columns = self.table()
        with open(checks.path('path', path), 'w', newline='', encoding='utf-8') as stream:
            table = csv.writer(stream)
            table.writerow(columns)
            table.writerows(zip(*columns.values()))

    def to_pandas(self) -> Any:
        """Return the table as a DataFrame of pandas. Raise ImportError if that is missing."""
        pandas = import_library(
            'pandas', 'to_pandas', without='table() and to_csv() do not')
        columns = self.table()
        return pandas.DataFrame(columns).set_index(next(iter(columns)))


class Row(Protocol):
    """One of several results."""

    def row(self) -> Sequence[Any]:
        """Plain values, one for each column of their table."""


_Row = TypeVar('_Row', bound=Row)


class Results(list[_Row], AsTable):
    """A list of results of one kind, which is a table, too."""

    def __init__(
        self, columns: Sequence[str], results: Iterable[_Row] = (), *, number: str = ''
    ) -> None:
        """Under the names of their `columns`, with units; a `number` counts them from 1."""
        super().__init__(results)
        self.columns, self.number = tuple(columns), number

    def __repr__(self) -> str:
        """Say what they are and how far the first column goes, without the numbers."""
        if not self:
            return '<no results>'
        first, last = self[0].row()[0], self[-1].row()[0]
        reach = f'{first:.6g} to {last:.6g}' if len(self) > 1 else f'{first:.6g}'
        return f'<{len(self):,} of {type(self[0]).__name__}: {self.columns[0]} {reach}>'

    def table(self) -> dict[str, list[Any]]:
        """A list for each column."""
        rows = [result.row() for result in self]
        numbers = {self.number: list(range(1, len(self) + 1))} if self.number else {}
        return {**numbers,
                **{name: [row[k] for row in rows] for k, name in enumerate(self.columns)}}
