# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""CSV tables named by a scene: rows by time [s], or by body number."""

from collections.abc import Sequence
import math
from pathlib import Path
from typing import NamedTuple

from icofabric_sim.checks import decoded, number_in
from icofabric_sim.parameters.example_scenes import scene_folders
from icofabric_sim.parameters.named_files import recorded_content, register_content
from icofabric_sim.parameters.validation import ParameterError
import numpy as np

_MAX_ROWS = 1_000_000  # rows
_MAX_LINE_LENGTH = 10_000  # characters


def read_numeric_table(
    name: str, file: str, widths: dict[int, str], *, first: str = 'times', unit: str = 's'
) -> np.ndarray:
    """
    Return the rows of a table, (r, c): times [s], strictly increasing from 0 on, then values.

    `widths` maps allowed numbers of columns to their description. `first` and `unit` describe the
    first column; if `first` is empty, rows have any order, and one is enough. Empty lines, lines
    that begin with # and a header line are skipped. A relative path is searched in the working
    directory, then among the example scenes. Raises ParameterError for the parameter `name`.
    """
    rows: list[list[float]] = []
    wanted = ' or '.join(widths.values())
    path, lines = _read_lines(name, file)
    for number, line in enumerate(lines, start=1):
        text = line.strip()
        if not text or text.startswith('#'):
            continue
        if len(text) > _MAX_LINE_LENGTH or len(rows) >= _MAX_ROWS:
            raise ParameterError(name, f'{name}: {path} is too long for a table of {wanted}')
        values = _numbers(text)
        if values is None and not rows and not any(c.isdigit() for c in text):
            continue  # names of the columns
        if values is None or len(values) not in widths or (
                rows and len(values) != len(rows[0])):
            raise ParameterError(
                name, f'{name}: {path}, line {number}, must be {wanted}, all finite and the '
                f'same in every line, got {text!r:.80}')
        if first and not (values[0] >= 0.0 if not rows else values[0] > rows[-1][0]):
            raise ParameterError(
                name, f'{name}: {path}, line {number}: {first} must increase from line to '
                f'line, from 0 {unit} on, got {values[0]!r} {unit}'
                + (f' after {rows[-1][0]!r} {unit}' if rows else ''))
        rows.append(values)
    if len(rows) < (2 if first else 1):
        least = 'two lines' if first else 'one line'
        raise ParameterError(
            name, f'{name}: {path} must have at least {least} of {wanted}, got {len(rows)}')
    return np.array(rows)


class BodyTable(NamedTuple):
    """Rows of a table by the number of a body."""

    path: Path
    bodies: np.ndarray  # (r,)
    values: dict[Sequence[str], np.ndarray]  # (r, c) of each set of columns that is there
    lines: list[int]  # numbers of the lines, from 1 on

    def place(self, row: int, column: str) -> str:
        """Say where a number stands."""
        return f'{self.path}, line {self.lines[row]}, column {column}'


def read_named_table(name: str, file: str, sets: Sequence[Sequence[str]]) -> BodyTable:
    """
    Read a table of bodies with some of the `sets` of columns.

    The first line names the columns: `body`, and one or more complete sets. Empty lines and lines
    that begin with # are skipped. The file is searched as in `read_numeric_table`. Raises
    ParameterError for the parameter `name`.
    """
    path, lines = _read_lines(name, file)
    known = ['body', *(column for columns in sets for column in columns)]
    names: list[str] = []
    rows: list[list[float]] = []
    numbers: list[int] = []
    for number, line in enumerate(lines, start=1):
        text = line.strip()
        if not text or text.startswith('#'):
            continue
        if not names:
            names = [column.strip() for column in text.split(',')]
            if len(set(names)) < len(names) or not {'body'} < set(names) <= set(known) or any(
                    0 < len(set(columns) & set(names)) < len(columns) for columns in sets):
                raise ParameterError(
                    name, f'{name}: {path}, line {number}, must name the column body and one or '
                    f'more of these sets: {"; ".join(map(" ".join, sets))}, got {text!r:.200}')
            continue
        values = _numbers(text) if len(text) <= _MAX_LINE_LENGTH else None
        if values is None or len(values) != len(names) or len(rows) >= _MAX_ROWS:
            raise ParameterError(
                name, f'{name}: {path}, line {number}, must be {len(names)} finite numbers, as '
                f'its first line says, and one of {_MAX_ROWS} lines at most, got {text!r:.80}')
        rows.append(values)
        numbers.append(number)
    if not rows:
        raise ParameterError(name, f'{name}: {path} has no line of numbers')
    table = np.array(rows)
    bodies = table[:, names.index('body')]
    # Doubles do not distinguish larger integers.
    if (bodies != np.rint(bodies)).any() or np.abs(bodies).max() > 2.0**53 or (
            len(np.unique(bodies)) < len(bodies)):
        raise ParameterError(
            name, f'{name}: {path}: body numbers must be integers without repetition')
    return BodyTable(path, bodies.astype(np.int64), {
        columns: table[:, [names.index(column) for column in columns]]
        for columns in sets if columns[0] in names}, numbers)


def _read_lines(name: str, file: str) -> tuple[Path, list[str]]:
    """Return the path and the lines of a table."""
    path, content = Path(file), recorded_content(file)
    try:
        if content is None:
            path = find_table(name, file)
            content = path.read_bytes()
            register_content(file, content)
        return path, decoded(content).splitlines()
    except (OSError, MemoryError) as error:
        raise ParameterError(name, f'{name}: cannot read {path}: {error}') from None
    except ParameterError:
        raise
    except ValueError as error:
        raise ParameterError(name, f'{name}: {path}: {error}') from None


def find_table(name: str, file: str) -> Path:
    """Return the path of a table's file; raise ParameterError for `name` if it is missing."""
    path = Path(file).expanduser()
    if file:
        places = [path, *(() if path.is_absolute() else (
            folder / path for folder in scene_folders()))]
        for place in places:
            if place.is_file():
                return place
    raise ParameterError(
        name, f'{name}: there is no file {file!r}; give the path of a CSV file, from '
        f'{Path.cwd()} if it is not absolute')


def _numbers(text: str) -> list[float] | None:
    try:
        values = [number_in(part) for part in text.split(',')]
    except ValueError:
        return None
    return values if all(map(math.isfinite, values)) else None
