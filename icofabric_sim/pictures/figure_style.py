# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
How figures look: as in a paper, the same everywhere, told apart without colour.

Colours are those of Okabe and Ito (2008), which people who confuse colours tell apart; each goes
with a line style and a marker of its own.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from icofabric_sim.checks import choice
from icofabric_sim.libraries import require_library
import numpy as np

COLORS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#000000')
_LINES = ('-', '--', '-.', ':', (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 1)))
_MARKERS = ('o', 's', '^', 'D', 'v', 'P', 'X')
SUFFIXES = ('.png', '.svg')
_DOTS_PER_INCH = 160
# Markers of a line, at most.
_MARKS = 12

_STYLE: dict[Any, Any] = {
    'font.size': 9.0, 'axes.titlesize': 9.5, 'axes.labelsize': 9.0, 'legend.fontsize': 8.0,
    'axes.spines.top': False, 'axes.spines.right': False, 'axes.linewidth': 0.8,
    'axes.grid': True, 'grid.color': '0.9', 'grid.linewidth': 0.6, 'lines.linewidth': 1.3,
    # Legible where it lies over lines.
    'legend.frameon': True, 'legend.fancybox': False, 'legend.framealpha': 0.85,
    'legend.edgecolor': 'none', 'axes.axisbelow': True, 'svg.hashsalt': 'icofabric_sim',
    'figure.facecolor': 'white', 'axes.formatter.useoffset': False}


class LineStyle(NamedTuple):
    """Style of one of several lines."""

    color: str
    line: Any
    marker: str


def line_styles(count: int) -> list[LineStyle]:
    """Return styles of several lines: up to seven differ in colour, line and marker."""
    many = len(COLORS)
    return [
        LineStyle(COLORS[k % many], _LINES[(k + k // many) % many],
                  _MARKERS[(k + 2 * (k // many)) % many]) for k in range(count)]


@contextmanager
def paper_style() -> Iterator[None]:
    """Within it figures are drawn and saved in this style, whatever matplotlib's settings are."""
    require_library('matplotlib', 'a picture')
    from matplotlib import rc_context
    with rc_context(_STYLE):
        yield


def make_figure(size: tuple[float, float], rows: int = 1) -> tuple[Any, list[Any]]:
    """Return a figure of that size [inches] with stacked plots that share the x axis."""
    require_library('matplotlib', 'a picture')
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=_DOTS_PER_INCH, layout='constrained')
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)
    return figure, list(axes[:, 0])


def draw_line(
    axes: Any, x: Sequence[float] | np.ndarray, y: Sequence[float] | np.ndarray,
    style: LineStyle, label: str
) -> None:
    """Draw a line with a few markers."""
    axes.plot(
        x, y, color=style.color, linestyle=style.line, marker=style.marker, markersize=3.5,
        markevery=max(len(x) // _MARKS, 1), label=label, linewidth=1.3)


def save_figure(figure: Any, path: Path) -> None:
    """Write a PNG or an SVG; the same figure gives the same file."""
    suffix = choice('suffix', path.suffix.lower(), SUFFIXES)
    path.parent.mkdir(parents=True, exist_ok=True)
    metadata = {'Software': None} if suffix == '.png' else {'Date': None, 'Creator': None}
    figure.savefig(path, format=suffix[1:], metadata=metadata)
