# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Work-precision diagrams: the error that a solver makes over the time that it takes."""

import csv
from pathlib import Path
from typing import NamedTuple

from icofabric_sim.checks import number_in
from icofabric_sim.pictures.figure_style import (
    COLORS,
    line_styles,
    make_figure,
    paper_style,
    save_figure,
)

HEADER = ('solver', 'tool', 'setting_kind', 'setting', 'error', 'time_s', 'time_low_s',
          'time_high_s', 'rounds')
SIZE = (7.0, 5.0)
_DASHES = ('-', '--', ':', '-.')
# Curves whose names have room beside them; those of more stand on the right.
_WITHIN = 7


class PrecisionPoint(NamedTuple):
    """One run of one solver."""

    solver: str
    tool: str
    error: float
    time: float  # [s] median over the rounds
    low: float  # [s]
    high: float  # [s]


def read_points(path: Path) -> list[PrecisionPoint]:
    """
    Points of the table that `icofabric benchmark work-precision --output` writes.

    ValueError, with the way out, where it is another table.
    """
    try:
        with open(path, newline='', encoding='utf-8') as file:
            rows = list(csv.DictReader(file))
        points = [PrecisionPoint(
            row['solver'], row['tool'], *(number_in(row[name]) for name in HEADER[4:8]))
            for row in rows]
    except (KeyError, TypeError, UnicodeError, csv.Error, ValueError) as error:
        raise ValueError(
            f'{path} is no table of work and precision ({error}): give work_precision.csv of '
            'icofabric benchmark work-precision --output FOLDER') from error
    if not points:
        raise ValueError(f'{path} holds no points')
    return points


def draw_work_precision(
    points: list[PrecisionPoint], path: Path, *, title: str = '',
    size: tuple[float, float] = SIZE
) -> None:
    """
    Draw a curve for each solver; grey bars are the range over the rounds.

    Solvers of one tool share colour and marker and differ in dash.
    """
    curves: dict[str, list[PrecisionPoint]] = {}
    for point in points:
        curves.setdefault(point.solver, []).append(point)
    tools = list(dict.fromkeys(point.tool for point in points))
    styles = line_styles(len(COLORS))
    drawn = dict.fromkeys(tools, 0)
    with paper_style():
        figure, (axes,) = make_figure(size)
        for solver, run in curves.items():
            tool = run[0].tool
            style = styles[tools.index(tool) % len(styles)]
            axes.plot(
                [point.time for point in run], [point.error for point in run], color=style.color,
                marker=style.marker, markersize=4, linestyle=_DASHES[drawn[tool] % len(_DASHES)],
                label=solver)
            drawn[tool] += 1
            for point in run:
                axes.plot([point.low, point.high], [point.error] * 2, color='0.6', linewidth=1,
                          zorder=0)
        axes.set(xscale='log', yscale='log', xlabel='time [s], one thread',
                 ylabel='error at the end (over a, rad)')
        axes.set_title(title or 'work and precision', loc='left')
        if len(curves) > _WITHIN:
            axes.legend(loc='upper left', bbox_to_anchor=(1.0, 1.0))
        else:
            axes.legend()
        save_figure(figure, path)
