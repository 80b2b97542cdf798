# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Picture of the stability map: energy error against step times frequency."""

from collections.abc import Sequence
import math
from pathlib import Path

from icofabric_sim.pictures.figure_style import line_styles, make_figure, paper_style
from icofabric_sim.simulation.stepping.methods import facts_of
from icofabric_validation.stability_map import Cell


def draw_map(path: Path, cells: Sequence[Cell]) -> None:
    """Draw cells to a PNG file without a display. Crosses: refused runs; triangles: stopped."""
    fabrics = list(dict.fromkeys(cell.fabric for cell in cells))
    methods = list(dict.fromkeys(cell.method for cell in cells))
    with paper_style():
        figure, plots = make_figure((7.0, 2.6 * len(fabrics)), rows=len(fabrics))
        for plot, fabric in zip(plots, fabrics):
            for number, (method, style) in enumerate(zip(methods, line_styles(len(methods)))):
                own = [cell for cell in cells if (cell.fabric, cell.method) == (fabric, method)]
                ran = [cell for cell in own if cell.outcome == 'ran']
                plot.loglog(
                    [cell.product for cell in ran], [cell.energy for cell in ran], label=method,
                    color=style.color, linestyle=style.line, marker=style.marker, markersize=3)
                # A row for each method above the curves.
                for word, mark in (('refused', 'x'), ('stopped', '^')):
                    places = [cell.product for cell in own if cell.outcome == word]
                    plot.loglog(
                        places, [30.0 * 5.0**number] * len(places), mark, color=style.color,
                        markersize=4)
                limit = facts_of(method).stability
                if math.isfinite(limit):
                    plot.axvline(limit, color=style.color, linewidth=0.5)
            plot.set_ylabel(f'{fabric}: energy error')
        plots[0].legend(fontsize=7, ncols=len(methods), loc='upper left')
        plots[-1].set_xlabel('step times largest frequency')
        figure.savefig(path)
