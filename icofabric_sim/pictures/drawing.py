# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Pictures of a fabric: single frames, and sheets of several moments side by side; no display needed.

All pictures made by one `Renderer` share view and scale. Positions and orientations come from
snapshots or from bags.
"""

from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any, NamedTuple

from icofabric_sim.messages.markers import held_bodies, STRAIN_CLASSES
from icofabric_sim.pictures.fabric_polygons import (
    Bounds,
    fabric_polygons,
    FREE_COLOR,
    HELD_COLOR,
    LARGEST_SHELL_COUNT,
    View,
)
from icofabric_sim.pictures.plane_pictures import plane_pictures
from icofabric_sim.scene.scene import Scene
import numpy as np

_DOTS_PER_INCH = 100.0
_LEAST_LINE_PIXELS = 1.6
_TEXT_COLOR = '0.25'
# Colours of floors and walls and of the lines on them; how much hides what is behind a wall.
_PLANE_COLOR, _LINE_COLOR, _VEIL = '0.95', '0.86', 0.12
# Heights [inches] of the heading, of the legend and of a caption.
_HEADING, _FOOTING, _CAPTION = 0.42, 0.62, 0.30
# Height [inches] of the strip of the scale bar, and room around the fabric.
_STRIP, _MARGIN = 0.42, 1.05


class Moment(NamedTuple):
    """A state to be drawn."""

    time: float  # [s]; NaN: of no time
    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) x y z w
    scene: Scene
    note: str = ''  # what acts at that time
    broken: np.ndarray | None = None  # numbers of broken connectors


class Renderer:
    """Draws moments of one run from one side and at one scale."""

    def __init__(
        self,
        bounds: Bounds,
        *,
        title: str = '',
        view: View | None = None,
        size: tuple[int, int] = (1280, 960),
    ) -> None:
        """
        Show what lies within `bounds` in pictures of `size` pixels.

        A sheet is as wide, and as high as its rows need but no higher.
        """
        width, height = size
        self.bounds, self.title, self.view = bounds, title, View() if view is None else view
        self.inches = (width / _DOTS_PER_INCH, height / _DOTS_PER_INCH)

    def frame(self, moment: Moment, path: str | Path) -> None:
        """Draw one moment to a PNG file."""
        self.sheet([moment], path)

    def sheet(self, moments: Sequence[Moment], path: str | Path) -> None:
        """Draw moments side by side to a PNG file."""
        if not moments:
            raise ValueError('there is nothing to draw: give at least one moment')
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        heading = _HEADING if self.title else 0.0
        columns, rows, panel = self._arrange(len(moments), heading)
        wide, high = self.inches[0], self.inches[1]
        if rows > 1 or columns > 1:
            high = heading + _FOOTING + rows * panel[1]
        figure = Figure(figsize=(wide, high), dpi=_DOTS_PER_INCH, facecolor='white')
        FigureCanvasAgg(figure)
        for number, moment in enumerate(moments):
            row, column = divmod(number, columns)
            left, bottom = column * panel[0], _FOOTING + (rows - 1 - row) * panel[1]
            inches = (panel[0], panel[1] - _CAPTION)
            axes = figure.add_axes(
                (left / wide, bottom / high, inches[0] / wide, inches[1] / high)
            )
            self._draw(axes, moment, inches, marks=number == 0)
        if self.title:
            figure.text(
                0.5, 1.0 - 0.6 * heading / high, self.title, ha='center', va='center',
                fontsize=12, color=_TEXT_COLOR,
            )  # fmt: skip
        self._legend(figure, moments)
        # The same picture gives the same file.
        figure.savefig(path, format='png', metadata={'Software': None})

    def _arrange(
        self, count: int, heading: float
    ) -> tuple[int, int, tuple[float, float]]:
        """
        Columns and rows that show `count` panels at the largest scale, and a panel in inches.
        """
        across, upwards = _MARGIN * (self.bounds.high - self.bounds.low)[:2]
        wide, high = self.inches[0], self.inches[1] - heading - _FOOTING
        spare = _CAPTION + _STRIP

        def scale(columns: int) -> float:
            rows = math.ceil(count / columns)
            return float(min(wide / columns / across, max(high / rows - spare, 0.01) / upwards))

        columns = max(range(1, count + 1), key=lambda columns: (scale(columns), -columns))
        rows = math.ceil(count / columns)
        least = scale(columns) * upwards + spare
        return columns, rows, (wide / columns, high if count == 1 else min(least, high / rows))

    def _draw(
        self, axes: Any, moment: Moment, inches: tuple[float, float], *, marks: bool
    ) -> None:
        from matplotlib.collections import PolyCollection

        low, high = self.bounds.low[:2], self.bounds.high[:2]
        free = np.array([inches[0], inches[1] - _STRIP])
        meters = _MARGIN * float(max((high - low) / free))  # for each inch
        # The strip below the fabric is for the scale bar.
        corner = 0.5 * (low + high) - 0.5 * meters * free - np.array([0.0, meters * _STRIP])
        axes.set_xlim(corner[0], corner[0] + meters * inches[0])
        axes.set_ylim(corner[1], corner[1] + meters * inches[1])
        axes.set_axis_off()
        pixel = meters / _DOTS_PER_INCH
        scene = moment.scene
        shapes = fabric_polygons(
            scene,
            moment.position,
            moment.orientation,
            view=self.view,
            bounds=self.bounds,
            broken=moment.broken,
            line_width=max(0.16 * scene.shell.half_edge, _LEAST_LINE_PIXELS * pixel),
        )
        _planes(axes, scene, self.view, self.bounds)
        large = scene.shell.half_edge > 6.0 * pixel
        axes.add_collection(
            PolyCollection(
                list(shapes.corners),
                facecolors=shapes.colors,
                # Edges hide the seams between faces; on large shells they also show the faces.
                edgecolors=(0.86 if large else 0.95) * shapes.colors,
                linewidths=0.5 if large else 0.3,
                joinstyle='round',
                zorder=1.0,
            ),
            autolim=False,
        )
        when = '' if math.isnan(moment.time) else f't = {moment.time:.3f} s'
        caption = '   '.join(part for part in (when, moment.note) if part)
        axes.set_title(caption, fontsize=10, color=_TEXT_COLOR, pad=4)
        if marks:
            _scale_bar(axes, corner, meters, inches[0])
            _triad(axes, self.view, corner + meters * np.array([inches[0] - 0.55, 0.18]), meters)

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
                    markerfacecolor=tuple(color), markeredgecolor=tuple(0.7 * color),
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


def _planes(axes: Any, scene: Scene, view: View, bounds: Bounds) -> None:
    """Draw floors and walls: behind the fabric, or as a veil before it where it is behind them."""
    from matplotlib.collections import LineCollection, PolyCollection

    for picture in plane_pictures(scene, view, bounds):
        order = 0.0 if picture.faces_viewer else 2.0
        axes.add_collection(PolyCollection(
            [picture.corners], facecolors=_PLANE_COLOR, edgecolors=_LINE_COLOR, linewidths=0.8,
            alpha=1.0 if picture.faces_viewer else _VEIL, zorder=order), autolim=False)
        axes.add_collection(LineCollection(
            list(picture.lines), colors=_LINE_COLOR, linewidths=0.6,
            alpha=1.0 if picture.faces_viewer else 2.0 * _VEIL, zorder=order), autolim=False)


def _scale_bar(axes: Any, corner: np.ndarray, meters: float, inches: float) -> None:
    """Draw a bar of a round length, at most a quarter of the width, with its length in m."""
    wanted = 0.25 * inches * meters
    power = 10.0 ** math.floor(math.log10(wanted))
    length = power * max(factor for factor in (1.0, 2.0, 5.0) if factor * power <= wanted)
    start = corner + meters * np.array([0.2, 0.14])
    tick = 0.05 * meters
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


def _triad(axes: Any, view: View, origin: np.ndarray, meters: float) -> None:
    """Draw the world's axes."""
    for name, direction in zip('xyz', 0.3 * meters * view.axes[:2].T):
        tip = origin + direction
        axes.plot(*zip(origin, tip), color=_TEXT_COLOR, linewidth=1.2)
        axes.text(
            *(origin + 1.3 * direction), name,
            ha='center', va='center', fontsize=9, color=_TEXT_COLOR,
        )  # fmt: skip
