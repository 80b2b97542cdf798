# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A picture of elastic constants: Young's modulus in every direction, and curves of a slab."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from icofabric_sim.libraries import require_library
from icofabric_sim.pictures.figure_style import draw_line, line_styles
from icofabric_sim.statics.moment_curve import MomentCurvePoint
from icofabric_sim.statics.periodic import Elasticity
from icofabric_sim.statics.stress_strain import CurvePoint
import numpy as np

_AROUND, _DOWN = 121, 61
# Of a fabric at its kink, where every direction is a search of its own.
_FEW_AROUND, _FEW_DOWN = 49, 25


def draw_elasticity(
    path: Path, title: str, constants: Elasticity | None,
    curves: Mapping[str, Sequence[CurvePoint]],
    turns: Mapping[str, Sequence[MomentCurvePoint]]
) -> None:
    """Draw elasticity to a PNG file; no display needed. `constants` is None if not periodic."""
    require_library('matplotlib', 'a picture')
    from matplotlib.figure import Figure

    columns = (constants is not None) + bool(curves) + bool(turns)
    figure = Figure(
        figsize=(6.0 * columns, 5.4), dpi=100, facecolor='white', layout='constrained')
    if constants is not None:
        _draw_moduli(figure.add_subplot(1, columns, 1, projection='3d'), constants)
    if curves:
        _draw_curves(
            figure.add_subplot(1, columns, columns - bool(turns)), 'slab between two ends',
            'strain', 'stress [Pa]', {
                kind: [(point.strain, point.stress) for point in points]
                for kind, points in curves.items()})
    if turns:
        _draw_curves(
            figure.add_subplot(1, columns, columns), 'ends turned against each other',
            'angle [rad]', 'moment [N m]', {
                kind: [(point.angle, point.moment) for point in points]
                for kind, points in turns.items()})
    figure.suptitle(title)
    # The same picture gives the same file.
    figure.savefig(path, format='png', metadata={'Software': None})


def _draw_moduli(left: Any, constants: Elasticity) -> None:
    """Draw Young's modulus in every direction as a surface."""
    from matplotlib.ticker import MaxNLocator

    kinked = bool(constants.branches)
    around, rows = (_FEW_AROUND, _FEW_DOWN) if kinked else (_AROUND, _DOWN)
    across, down = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, around), np.linspace(0.0, np.pi, rows))
    direction = np.stack(
        [np.sin(down) * np.cos(across), np.sin(down) * np.sin(across), np.cos(down)], axis=-1)
    most = 0.0
    for sign in (1.0, -1.0) if kinked else (1.0,):
        modulus = constants.young_modulus(direction) if not kinked else np.array([
            [constants.uniaxial_response(one, sign).modulus for one in row] for row in direction])
        most = max(most, float(modulus.max()))
        left.plot_surface(
            *np.moveaxis(modulus[..., None] * direction, -1, 0), rcount=rows, ccount=around,
            color='#d9b26f' if sign > 0.0 else '#2c5f8a', linewidth=0.1, edgecolor='#00000022',
            alpha=0.35 if kinked and sign > 0.0 else None)
    most = most or 1.0
    limits = (-most, most)
    left.set(
        xlim=limits, ylim=limits, zlim=limits, xlabel='x', ylabel='y', zlabel='z',
        title="Young's modulus [Pa], periodic fabric" + (
            ':\npulled (light) and pushed (dark)' if kinked else ''))
    for axis in (left.xaxis, left.yaxis, left.zaxis):
        axis.set_major_locator(MaxNLocator(4))
    left.set_box_aspect((1, 1, 1))


def _draw_curves(
    axes: Any, title: str, along: str, up: str,
    curves: Mapping[str, Sequence[tuple[float, float]]]
) -> None:
    """Draw lines that begin at 0."""
    for style, (kind, points) in zip(line_styles(len(curves)), curves.items()):
        x, y = zip((0.0, 0.0), *points)
        draw_line(axes, x, y, style, kind)
    axes.set(xlabel=along, ylabel=up, title=title)
    axes.grid(alpha=0.3)
    axes.legend()
