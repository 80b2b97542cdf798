# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Figure 5 of the document, and the diagram of edges and connectors that it wishes for.

Source: "A Mathematical Model of Icosahedral Materials": "Connector length as a function of
connection angle", and, before Table 5, "A diagram would be nice". Both are drawn from the
functions and tables that weaves are built from.
"""

import math
from typing import Any

from icofabric_sim.geometry.icosahedron import (
    edge_midpoints,
    EDGES,
    FACES,
    NAMED_EDGE_DIRECTIONS,
    NAMED_EDGE_VERTICES,
    NAMED_EDGES,
    vertices,
)
from icofabric_sim.scene.weave_geometry import geometry_from_angle, LIMIT_ANGLE, MINIMUM_ANGLE
from icofabric_sim.scene.weave_tables import TABLE_5
import numpy as np

# Okabe and Ito (2008), distinguishable to the colour-blind. Of the edges on body z, x and y:
PAIR_COLORS = ('#0072b2', '#d55e00', '#009e73')
_PAIR_DASHES = ('-', (0, (4, 1.2)), (0, (1.2, 1.0)))
_CURVE_COLOR, _LEAST_COLOR, _LIMIT_COLOR = '0.15', '#0072b2', '#d55e00'
# The longest connector that the curve shows, in units of w.
_MAX_LENGTH = 6.0
# Angle [rad] of the connectors in the diagram, and the part of them that is drawn.
_SHOWN_ANGLE, _SHOWN_PART = 0.25, 0.6
# Where the viewer of the diagram stands [degrees], and the direction to there.
_AZIMUTH, _ELEVATION = 32.0, 20.0
_VIEW = np.array([
    math.cos(math.radians(_ELEVATION)) * math.cos(math.radians(_AZIMUTH)),
    math.cos(math.radians(_ELEVATION)) * math.sin(math.radians(_AZIMUTH)),
    math.sin(math.radians(_ELEVATION))])
# Ends of the named edges at which their names stand, and how far out.
_LABEL_ENDS, _LABEL_REACH = (0, 1, 1, 0, 0, 1), 1.36


def length_figure(title: str) -> Any:
    """Return Figure 5 beside a diagram of the edges, a figure of matplotlib."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 6.2), dpi=100, facecolor='white')
    _draw_lengths(figure.add_subplot(1, 2, 1), title)
    _draw_edges(figure.add_axes((0.5, 0.02, 0.48, 0.87), projection='3d'))
    return figure


def length_curve() -> tuple[np.ndarray, np.ndarray]:
    """Connector angles [rad] and lengths in units of w, of which the last is `_MAX_LENGTH`."""
    # From L = w / (sqrt(2) sin(pi/4 - theta)), eq 53.
    last = LIMIT_ANGLE - math.asin(1.0 / (math.sqrt(2.0) * _MAX_LENGTH))
    angles = np.linspace(MINIMUM_ANGLE, last, 400)
    woven = [geometry_from_angle(1.0, angle) for angle in angles.tolist()]
    return angles, np.array([one.connector_length / one.cube_width for one in woven])


def connector_stubs(half_edge: float, angle: float) -> np.ndarray:
    """
    Return both ends (12, 2, 3) of the connectors of one icosahedron, in the rows of Table 5.

    Body axes, in the unit of `half_edge`; the first end is its own, the second the neighbour's.
    """
    pitch = geometry_from_angle(half_edge, angle).pitch
    midpoints = edge_midpoints(half_edge)
    return np.array([
        [midpoints[edge], pitch * np.array(direction) + midpoints[edge ^ 1]]
        for edge, direction in TABLE_5])


def _draw_lengths(axes: Any, title: str) -> None:
    angles, lengths = length_curve()
    axes.plot(np.degrees(angles), lengths, color=_CURVE_COLOR, linewidth=2.0)
    for angle, color, dashes, label in (
            (MINIMUM_ANGLE, _LEAST_COLOR, (0, (2, 2)), r'$\theta_{min}$'),
            (LIMIT_ANGLE, _LIMIT_COLOR, (0, (8, 4)), 'asymptote')):
        degrees = math.degrees(angle)
        axes.axvline(degrees, color=color, linestyle=dashes, linewidth=1.6)
        axes.annotate(
            f'{label} {degrees:.4g}°', (degrees, 0.6 * _MAX_LENGTH), rotation=90, color=color,
            xytext=(-4, 0), textcoords='offset points', ha='right', va='center')
    least = float(lengths[0])
    axes.annotate(
        f'$L_{{min}}$ = {least:.6f} w', (math.degrees(MINIMUM_ANGLE), least), xytext=(8, -16),
        textcoords='offset points', color=_CURVE_COLOR)
    axes.plot(0.0, 1.0, 'o', color=_CURVE_COLOR)
    axes.annotate(
        'L = w', (0.0, 1.0), xytext=(4, -16), textcoords='offset points', color=_CURVE_COLOR)
    axes.set(
        xlim=(-30.0, 50.0), ylim=(0.0, _MAX_LENGTH), title=title,
        xlabel=r'connector angle $\theta$ [degrees]', ylabel='connector length L / w')
    axes.grid(alpha=0.3)


def _draw_edges(axes: Any) -> None:
    """One icosahedron in its body axes: its six named edges, and where its connectors begin."""
    corners = vertices(1.0)
    axes.computed_zorder = False
    # Faces veil what lies behind them.
    axes.plot_trisurf(
        *corners.T, triangles=_front_faces(corners), color='0.9', edgecolor='none', alpha=0.75,
        shade=False, zorder=4)
    for ends in corners[EDGES]:
        axes.plot(*ends.T, color='0.6', linewidth=0.8, zorder=_order(ends.mean(axis=0)))
    for edge, name in enumerate(NAMED_EDGES):
        ends, color = corners[NAMED_EDGE_VERTICES[edge]], PAIR_COLORS[edge // 2]
        order = _order(NAMED_EDGE_DIRECTIONS[edge])
        axes.plot(*ends.T, color=color, linewidth=5.0, solid_capstyle='round', zorder=order)
        sign, letter = '+' if NAMED_EDGE_DIRECTIONS[edge].sum() > 0 else '-', 'zxy'[edge // 2]
        axes.text(
            *(_LABEL_REACH * ends[_LABEL_ENDS[edge]]), f'{name} ({sign}{letter})', color=color,
            ha='center', va='center', fontsize=11, fontweight='bold', zorder=9)
    stubs = connector_stubs(1.0, _SHOWN_ANGLE)
    for (edge, _), (near, far) in zip(TABLE_5, stubs):
        shown = near + _SHOWN_PART * (far - near)
        axes.plot(
            *np.stack([near, shown]).T, color=PAIR_COLORS[edge // 2], linewidth=2.0,
            linestyle=_PAIR_DASHES[edge // 2], zorder=_order(near) + 1)
    size = 1.15 * float(np.abs(stubs[:, 0] + _SHOWN_PART * (stubs[:, 1] - stubs[:, 0])).max())
    limits = (-size, size)
    axes.set(
        xlim=limits, ylim=limits, zlim=limits,
        title='Table 5: six edges, two connectors at each, body axes')
    axes.set_box_aspect((1, 1, 1), zoom=1.3)
    axes.set_proj_type('ortho')
    axes.view_init(elev=_ELEVATION, azim=_AZIMUTH)
    axes.set_axis_off()


def _front_faces(corners: np.ndarray) -> np.ndarray:
    """Vertex numbers (m, 3) of the faces that the viewer sees from outside."""
    return FACES[corners[FACES].mean(axis=1) @ _VIEW > 0.0]


def _order(place: np.ndarray) -> int:
    """Order of drawing: before the faces, or after them."""
    return 6 if float(place @ _VIEW) > 0.0 else 2
