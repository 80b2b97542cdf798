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
"""A picture of elastic constants: Young's modulus in every direction, and curves of a slab."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from icofabric_sim.pictures.figure_style import draw_line, line_styles
from icofabric_sim.statics.periodic import Elasticity
from icofabric_sim.statics.stretching import CurvePoint
import numpy as np

_AROUND, _DOWN = 121, 61
# Of a fabric at its kink, where every direction is a search of its own.
_FEW_AROUND, _FEW_DOWN = 49, 25


def draw_elasticity(
    path: Path, title: str, constants: Elasticity, curves: Mapping[str, Sequence[CurvePoint]]
) -> None:
    """Draw to a PNG file; no display needed."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0 if curves else 6.0, 5.4), dpi=100, facecolor='white')
    FigureCanvasAgg(figure)
    left = figure.add_subplot(1, 2 if curves else 1, 1, projection='3d')
    kinked = bool(constants.branches)
    around, rows = (_FEW_AROUND, _FEW_DOWN) if kinked else (_AROUND, _DOWN)
    across, down = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, around), np.linspace(0.0, np.pi, rows))
    direction = np.stack(
        [np.sin(down) * np.cos(across), np.sin(down) * np.sin(across), np.cos(down)], axis=-1)
    most = 0.0
    for sign in (1.0, -1.0) if kinked else (1.0,):
        modulus = constants.young_modulus(direction) if not kinked else np.array([
            [constants.pulled(one, sign).modulus for one in row] for row in direction])
        most = max(most, float(modulus.max()))
        left.plot_surface(  # type: ignore[attr-defined]
            *np.moveaxis(modulus[..., None] * direction, -1, 0), rcount=rows, ccount=around,
            color='#d9b26f' if sign > 0.0 else '#2c5f8a', linewidth=0.1, edgecolor='#00000022',
            alpha=0.35 if kinked and sign > 0.0 else None)
    most = most or 1.0
    for set_limits in (left.set_xlim, left.set_ylim, left.set_zlim):  # type: ignore[attr-defined]
        set_limits(-most, most)
    left.set_box_aspect((1, 1, 1))  # type: ignore[arg-type]
    left.set_title("Young's modulus [Pa], endless fabric" + (
        ':\npulled (light) and pushed (dark)' if kinked else ''))
    left.set_xlabel('x')
    left.set_ylabel('y')
    left.set_zlabel('z')  # type: ignore[attr-defined]
    if curves:
        right = figure.add_subplot(1, 2, 2)
        for style, (kind, points) in zip(line_styles(len(curves)), curves.items()):
            draw_line(
                right, [0.0, *(point.strain for point in points)],
                [0.0, *(point.stress for point in points)], style, kind)
        right.set_xlabel('strain')
        right.set_ylabel('stress [Pa]')
        right.set_title('slab between two ends')
        right.grid(alpha=0.3)
        right.legend()
    figure.suptitle(title)
    # The same picture gives the same file.
    figure.savefig(path, format='png', metadata={'Software': None})
