# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Pictures of a fabric: single frames, and sheets of several moments side by side; no display needed.

All pictures made by one `Renderer` share view and scale. Positions and orientations come from snapshots or from bags.
"""

from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any, NamedTuple

from icofabric_sim.fabric_polygons import (
    Bounds,
    fabric_polygons,
    FREE_COLOR,
    held_bodies,
    HELD_COLOR,
    LARGEST_SHELL_COUNT,
    View,
)
from icofabric_sim.outputs import STRAIN_CLASSES
from icofabric_sim.scene import Scene
import numpy as np

_DOTS_PER_INCH = 100.0
_LEAST_LINE_PIXELS = 1.6
_TEXT_COLOR = '0.25'
# Height [inches] of the heading and of the legend.
_HEADING, _FOOTING, _CAPTION = 0.42, 0.62, 0.30


class Moment(NamedTuple):
    """
    A state to be drawn.
    """

    time: float  # [s]
    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) x y z w
    scene: Scene
    note: str = ''  # what acts at that time


class Renderer:
    """
    Draws moments of one run from one side and at one scale.
    """

    def __init__(
        self,
        bounds: Bounds,
        *,
        title: str = '',
        view: View | None = None,
        size: tuple[int, int] = (1280, 960),
    ) -> None:
        """
        Show what lies within `bounds` in pictures of `size` pixels (a sheet is as large as one frame).
        """
        width, height = size
        if not (200 <= width <= 20000 and 200 <= height <= 20000):
            raise ValueError(
                f'size must be 200 to 20000 pixels wide and high, got {width} x {height}'
            )
        self.bounds, self.title, self.view = bounds, title, View() if view is None else view
        self.inches = (width / _DOTS_PER_INCH, height / _DOTS_PER_INCH)

    def frame(self, moment: Moment, path: str | Path) -> None:
        """
        Draw one moment to a PNG file.
        """
        self.sheet([moment], path)

    def sheet(self, moments: Sequence[Moment], path: str | Path) -> None:
        """
        Draw moments side by side to a PNG file.
        """
        if not moments:
            raise ValueError('there is nothing to draw: give at least one moment')
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=self.inches, dpi=_DOTS_PER_INCH, facecolor='white')
        FigureCanvasAgg(figure)
        wide, high = self.inches
        heading = _HEADING if self.title else 0.0
        area = (wide, high - heading - _FOOTING)
        columns, rows = self._arrange(len(moments), area)
        panel = (area[0] / columns, area[1] / rows)
        for number, moment in enumerate(moments):
            row, column = divmod(number, columns)
            left, bottom = column * panel[0], _FOOTING + (rows - 1 - row) * panel[1]
            axes = figure.add_axes(
                (left / wide, bottom / high, panel[0] / wide, (panel[1] - _CAPTION) / high)
            )
            self._draw(axes, moment, (panel[0], panel[1] - _CAPTION), marks=number == 0)
        if self.title:
            figure.text(
                0.5, 1.0 - 0.6 * heading / high, self.title, ha='center', va='center',
                fontsize=12, color=_TEXT_COLOR,
            )  # fmt: skip
        self._legend(figure, moments)
        # The same picture gives the same file.
        figure.savefig(path, format='png', metadata={'Software': None})

    def _arrange(self, count: int, area: tuple[float, float]) -> tuple[int, int]:
        """
        Columns and rows that show `count` panels at the largest scale.
        """
        across, upwards = (self.bounds.high - self.bounds.low)[:2]

        def scale(columns: int) -> float:
            rows = math.ceil(count / columns)
            free = max(area[1] / rows - _CAPTION, 0.01)
            return float(min(area[0] / columns / across, free / upwards))

        columns = max(range(1, count + 1), key=lambda columns: (scale(columns), -columns))
        return columns, math.ceil(count / columns)

    def _draw(
        self, axes: Any, moment: Moment, inches: tuple[float, float], *, marks: bool
    ) -> None:
        from matplotlib.collections import PolyCollection

        low, high = self.bounds.low[:2], self.bounds.high[:2]
        middle, margin = 0.5 * (low + high), 1.06
        meters = margin * float(max((high - low) / inches))  # for each inch
        half = 0.5 * meters * np.array(inches)
        axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
        axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
        axes.set_aspect('equal')
        axes.set_axis_off()
        pixel = meters / _DOTS_PER_INCH
        scene = moment.scene
        shapes = fabric_polygons(
            scene,
            moment.position,
            moment.orientation,
            view=self.view,
            bounds=self.bounds,
            line_width=max(0.16 * scene.shell.half_edge, _LEAST_LINE_PIXELS * pixel),
        )
        large = scene.shell.half_edge > 6.0 * pixel
        axes.add_collection(
            PolyCollection(
                shapes.corners,
                facecolors=shapes.colors,
                # Edges hide the seams between faces; on large shells they also show the faces.
                edgecolors=(0.86 if large else 0.95) * shapes.colors,
                linewidths=0.5 if large else 0.3,
                joinstyle='round',
            ),
            autolim=False,
        )
        caption = f't = {moment.time:.3f} s' + (f'   {moment.note}' if moment.note else '')
        axes.set_title(caption, fontsize=10, color=_TEXT_COLOR, pad=4)
        if marks:
            _scale_bar(axes, middle - half, 2.0 * half)
            _triad(axes, self.view, middle + half * (0.86, -0.80), 0.13 * float(half.min()))

    def _legend(self, figure: Any, moments: Sequence[Moment]) -> None:
        from matplotlib.lines import Line2D

        handles: list[Any] = []
        if any(moment.scene.connector_count for moment in moments):
            handles += [
                Line2D([], [], color=entry.color, linewidth=3.0, label=entry.name)
                for entry in STRAIN_CLASSES
            ]
        held = any(held_bodies(moment.scene).any() for moment in moments)
        discs = any(moment.scene.body_count > LARGEST_SHELL_COUNT for moment in moments)
        free_label = 'free body' if not discs else 'free body (many: drawn as a disc)'
        for color, label in ((HELD_COLOR, 'held body'), (FREE_COLOR, free_label)):
            if color is HELD_COLOR and not held:
                continue
            handles.append(
                Line2D(
                    [], [], linestyle='', marker='h', markersize=9, label=label,
                    markerfacecolor=color, markeredgecolor=0.7 * color,
                )  # fmt: skip
            )
        wide = self.inches[0] > 8.0
        figure.legend(
            handles=handles,
            loc='lower center',
            ncols=4 if wide else 2,
            fontsize=9 if wide else 7,
            frameon=False,
            labelcolor=_TEXT_COLOR,
            handlelength=1.6,
            columnspacing=1.6,
            borderaxespad=0.1,
        )


def _scale_bar(axes: Any, corner: np.ndarray, extent: np.ndarray) -> None:
    """
    Draw a bar of a round length, at most a quarter of the width, with its length in m.
    """
    wanted = 0.25 * float(extent[0])
    power = 10.0 ** math.floor(math.log10(wanted))
    length = power * max(factor for factor in (1.0, 2.0, 5.0) if factor * power <= wanted)
    start = corner + extent * (0.04, 0.05)
    tick = 0.012 * extent[1]
    axes.plot(
        start[0] + length * np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]),
        start[1] + tick * np.array([-1.0, 1.0, 0.0, 0.0, 1.0, -1.0]),
        color=_TEXT_COLOR,
        linewidth=1.2,
    )
    axes.text(
        start[0] + 0.5 * length, start[1] + 1.2 * tick, f'{length:g} m',
        ha='center', va='bottom', fontsize=9, color=_TEXT_COLOR,
    )  # fmt: skip


def _triad(axes: Any, view: View, origin: np.ndarray, length: float) -> None:
    """
    Draw the world's axes.
    """
    for name, direction in zip('xyz', length * view.axes[:2].T):
        tip = origin + direction
        axes.plot(*zip(origin, tip), color=_TEXT_COLOR, linewidth=1.2)
        axes.text(
            *(origin + 1.25 * direction), name,
            ha='center', va='center', fontsize=9, color=_TEXT_COLOR,
        )  # fmt: skip
