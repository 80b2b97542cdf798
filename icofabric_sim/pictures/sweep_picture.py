# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A figure of a study: what was kept over what was varied."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from icofabric_sim.libraries import require_library
from icofabric_sim.pictures.figure_style import line_styles, paper_style, save_figure
from icofabric_sim.sweeps.table import SweepTable
import numpy as np

# Rows and columns of plots; curves that a plot can hold, and points of a line at least.
_MOST_ROWS, _MOST_COLUMNS, _MOST_LINES, _LEAST_POINTS = 6, 4, 7, 2
_WIDTH, _HEIGHT = 4.2, 2.6  # inches of a plot


def draw_sweep(
    path: Path, name: str, table: SweepTable, columns: Sequence[str] = ()
) -> None:
    """
    Draw columns (default: the first ones that vary) over each varied parameter.

    Of varied parameters among `columns` only those are drawn over.

    Runs that differ in the one parameter only are joined by a line, told apart by the others.
    ValueError where there is nothing to draw.
    """
    require_library('matplotlib', 'a picture')
    from matplotlib.figure import Figure

    if not table.kept:
        raise ValueError('there is nothing to draw: no run has a result')
    # Parameters among the columns are those to draw over.
    over = [one for one in columns if one in table.varied] or table.varied
    across = [one for one in over if _is_numeric(table[one])][:_MOST_COLUMNS]
    measures = [one for one in columns if one not in table.varied]
    up = measures or _telling(table)
    for one in measures:
        if one not in table.kept or not _is_numeric(table[one]):
            raise ValueError(
                f'{one} is not a column of numbers; there are: '
                f'{", ".join(name for name in table.kept if _is_numeric(table[name]))}')
    if not across or not up:
        raise ValueError(
            'there is nothing to draw: no parameter with numbers varies' if not across else
            'there is nothing to draw: no column of numbers differs from run to run')
    up = up[:_MOST_ROWS]
    with paper_style():
        figure = Figure(
            figsize=(_WIDTH * len(across), _HEIGHT * len(up)), dpi=130, layout='constrained')
        plots = figure.subplots(len(up), len(across), sharex='col', sharey='row', squeeze=False)
        for row, measure in enumerate(up):
            for place, parameter in enumerate(across):
                axes = plots[row, place]
                _draw(axes, table, parameter, measure)
                if row == len(up) - 1:
                    axes.set_xlabel(_title(table, parameter))
                if not place:
                    axes.set_ylabel(_title(table, measure))
        figure.suptitle(name, fontsize=10.0)
        save_figure(figure, path)


def _draw(axes: Any, table: SweepTable, parameter: str, measure: str) -> None:
    x, y = table[parameter].astype(float), table[measure].astype(float)
    others = [one for one in table.varied if one != parameter]
    groups: dict[tuple[str, ...], list[int]] = {}
    for row in range(len(table)):
        groups.setdefault(
            tuple(str(table[one][row]) for one in others), []).append(row)
    if len(groups) > _MOST_LINES or max(map(len, groups.values())) < _LEAST_POINTS:
        axes.plot(x, y, 'o', color='#0072b2', markersize=3.0)
    else:
        for (values, rows), style in zip(groups.items(), line_styles(len(groups))):
            order = sorted(rows, key=lambda row: x[row])
            axes.plot(
                x[order], y[order], color=style.color, linestyle=style.line, marker=style.marker,
                markersize=3.5, label=', '.join(
                    f'{one} {_short(value)}' for one, value in zip(others, values)))
        if others and len(groups) > 1:
            axes.legend()
    axes.set(xscale=_scale(x), yscale=_scale(y))


def _title(table: SweepTable, name: str) -> str:
    unit = table.units.get(name, '')
    return f'{name} [{unit}]' if unit else name


def _is_numeric(values: np.ndarray) -> bool:
    return values.ndim == 1 and values.dtype.kind in 'iuf'


def _telling(table: SweepTable) -> list[str]:
    """Columns of numbers that differ from run to run by more than rounding of their like."""
    numbers = [one for one in table.kept if _is_numeric(table[one])]
    largest: dict[str, float] = {}
    for one in numbers:
        unit = table.units.get(one, '') or one
        largest[unit] = max(largest.get(unit, 0.0), _size(table[one]))
    return [one for one in numbers if _differs(
        table[one], largest[table.units.get(one, '') or one])]


def _size(values: np.ndarray) -> float:
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0))


def _differs(values: np.ndarray, largest: float) -> bool:
    """More than rounding does, of values of a unit of which some are as large as `largest`."""
    finite = values[np.isfinite(values)]
    return bool(len(finite) > 1 and np.ptp(finite) > 1e-9 * largest)


def _scale(values: np.ndarray) -> str:
    """Return the scale of an axis: logarithmic where the values span decades."""
    finite = values[np.isfinite(values)]
    spans_decades = len(finite) > 2 and finite.min() > 0.0 and finite.max() > 30.0 * finite.min()
    return 'log' if spans_decades else 'linear'


def _short(text: str) -> str:
    try:
        return f'{float(text):.4g}'
    except ValueError:
        return text
