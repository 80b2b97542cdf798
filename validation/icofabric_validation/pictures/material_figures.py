# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of the parts of the material study."""

from collections.abc import Callable, Mapping, Sequence
import math
from pathlib import Path
from typing import Any, Final

from icofabric_sim.libraries import require_library
from icofabric_sim.pictures.figure_style import (
    draw_line,
    line_styles,
    paper_style,
    save_figure,
)
from icofabric_validation.material.elastic import constants_of, slab_rows
from icofabric_validation.material.friction import friction_of
from icofabric_validation.material.jamming import (
    CONTACT,
    contact_of,
    jamming_ratio,
    map_of,
    RATIO,
    ratio_of,
    shear_of,
)
from icofabric_validation.material.part import BENDING_UNIT, closed_form_ratio, MIN_ANGLE, Results
from icofabric_validation.material.strength import curve_of, KINDS
from icofabric_validation.material.surfaces import ANGLES, LAYERS, PLACES
from icofabric_validation.material.waves import gap_of
import numpy as np

_WIDTH, _HEIGHT, _DOTS = 3.4, 2.9, 130  # inches of a plot, dots per inch
_ANGLE = 'connector angle [rad]'
# Readable in grey and with colour blindness.
_MAP = 'cividis'


def draw_part(path: Path, name: str, found: Results) -> bool:
    """Draw the figure of a part without a display; return False if the part has none."""
    if name not in FIGURES:
        return False
    require_library('matplotlib', 'a picture')
    from matplotlib.figure import Figure

    columns, draw = FIGURES[name]
    with paper_style():
        figure = Figure(
            figsize=(_WIDTH * columns, _HEIGHT), dpi=_DOTS, layout='constrained')
        draw(list(figure.subplots(1, columns, squeeze=False)[0]), found)
        save_figure(figure, path)
    return True


def _label(plot: Any, x: str, y: str, title: str = '', *, legend: bool = True) -> None:
    plot.set(xlabel=x, ylabel=y, title=title)
    if legend:
        plot.legend()


def _constants(plots: Sequence[Any], found: Results) -> None:
    by_bending: dict[float, list[dict[str, float]]] = {}
    for row in found['endless']:
        one = constants_of(row)
        by_bending.setdefault(one['bending'], []).append(one)
    ratio, shear, young = plots
    for (bending, points), style in zip(by_bending.items(), line_styles(len(by_bending))):
        x = [one['angle'] for one in points]
        for plot, name in ((ratio, 'nu'), (shear, 'C44')):
            draw_line(plot, x, [one[name] for one in points], style, f'{bending:g}')
    fine = np.linspace(MIN_ANGLE, math.pi / 4.0, 200)
    ratio.plot(fine, [closed_form_ratio(angle) for angle in fine], color='0.5', linewidth=3.0,
               alpha=0.5, zorder=0, label='closed form')
    stiff = by_bending[max(value for value in by_bending if value <= 0.1)]
    names = (('x', 'E along x'), ('xy', 'E along xy'), ('xyz', 'E along xyz'), ('K', 'bulk K'))
    for (name, label), style in zip(names, line_styles(len(names))):
        draw_line(young, [one['angle'] for one in stiff], [one[name] for one in stiff], style,
                  label)
    _label(ratio, _ANGLE, "Poisson's ratio along an axis [-]", 'bending stiffness / (k a$^2$)')
    _label(shear, _ANGLE, 'C44 [k / W]', 'shear along the axes', legend=False)
    _label(young, _ANGLE, 'modulus [k / W]', 'bending stiffness 0.1 k a$^2$')


def _slabs(plots: Sequence[Any], found: Results) -> None:
    stiffness, ratio = plots
    groups: dict[tuple[str, float], list[Any]] = {}
    for row in slab_rows(found):
        groups.setdefault((row['kind'], row['angle']), []).append(row)
    for ((kind, angle), rows), style in zip(groups.items(), line_styles(len(groups))):
        widths = [int(row['size'].split('x')[1]) for row in rows]
        stiffness.plot(widths, [row['young'] for row in rows], color=style.color,
                       linestyle='none', marker=style.marker, markersize=5,
                       label=f'{kind}, {angle:g} rad')
        if kind == 'orthogonal':
            for name, fill in (('y', 'full'), ('z', 'none')):
                ratio.plot(widths, [row[name] for row in rows], color=style.color,
                           linestyle='none', marker=style.marker, markersize=5, fillstyle=fill,
                           label=f'{angle:g} rad, across {name}')
            ratio.axhline(rows[0]['endless_y'], color=style.color, linestyle=style.line,
                          linewidth=1.0)
    stiffness.axhline(1.0, color='0.5', linewidth=1.0)
    stiffness.set_ylim(0.0, None)
    _label(stiffness, 'width [positions]', 'E over that of the periodic fabric [-]')
    _label(ratio, 'width [positions]', "Poisson's ratio [-]", 'lines: periodic fabric')


def _waves(plots: Sequence[Any], found: Results) -> None:
    plot, = plots
    gaps: dict[float, dict[float, float]] = {}
    for row in found['map']:
        gaps.setdefault(round(row['connector.bending_stiffness'] / BENDING_UNIT, 9), {})[
            row['weave.connector_angle']] = gap_of(row)
    for (bending, values), style in zip(gaps.items(), line_styles(len(gaps))):
        draw_line(plot, list(values), list(values.values()), style, f'{bending:g}')
    plot.legend(title='bending / (k a$^2$)', ncols=2)
    _label(plot, _ANGLE, 'width of the gap over its middle [-]', legend=False)


def _surfaces(plots: Sequence[Any], found: Results) -> None:
    depth, place = plots
    cubes = [row for row in found['slabs'] if len(set(map(int, row['weave.size']))) == 1]
    sizes = sorted({int(row['weave.size'][0]) for row in cubes})
    level = [row for row in cubes if row['weave.connector_angle'] == ANGLES[-1]]
    for row, style in zip(level, line_styles(len(level))):
        layers = [(layer, row[f'mechanisms.at.depth.{layer}']) for layer in range(LAYERS)]
        x, y = zip(*((layer, value) for layer, value in layers if math.isfinite(value)))
        draw_line(depth, x, y, style, f'{int(row["weave.size"][0])} positions a side')
    largest = [row for row in cubes if int(row['weave.size'][0]) == sizes[-1]]
    for row, style in zip(largest, line_styles(len(ANGLES))):
        draw_line(place, range(len(PLACES)), [
            row[f'mechanisms.at.{where}'] for where in PLACES], style,
            f'{row["weave.connector_angle"]:.3g} rad')
    depth.set_xticks(range(LAYERS))
    place.set_xticks(range(len(PLACES)), PLACES)
    for plot in plots:
        plot.set_ylim(0.0, 6.0)
    _label(depth, 'layers below the nearest face', 'freedoms in mechanisms [of 6 a body]',
           f'{ANGLES[-1]:g} rad')
    _label(place, 'place of the body', 'freedoms in mechanisms [of 6 a body]',
           f'{sizes[-1]} positions a side')


def _jam(plots: Sequence[Any], found: Results) -> None:
    counts, held, plane = plots
    free: dict[float, list[tuple[float, float]]] = {}
    for row in found['free']:
        if row['state'] == 'done':
            free.setdefault(contact_of(row), []).append(
                (ratio_of(row), row['statics.mechanisms']))
    for (stiffness, points), style in zip(free.items(), line_styles(len(free))):
        x, y = zip(*points)
        draw_line(counts, x, y, style, _contact_name(stiffness))
    counts.set_ylim(0.0, None)
    _label(counts, 'D / L', 'motions without energy', 'free slab, least angle')
    curves: dict[float, list[tuple[float, float]]] = {}
    for row in found['held']:
        curves.setdefault(contact_of(row), []).append((ratio_of(row), shear_of(row)))
    for (stiffness, points), style in zip(curves.items(), line_styles(len(curves))):
        x, y = zip(*points)
        draw_line(held, x, y, style, _contact_name(stiffness))
    # Space for the legend above the curves.
    held.set_ylim(None, 1.5 * held.get_ylim()[1])
    held.legend(ncols=2)
    _label(held, 'D / L', 'shear modulus [k / W]', 'between held ends, least angle', legend=False)
    _phases(plane, found)


def _contact_name(stiffness: float) -> str:
    return f'K / k = {stiffness:g}' if stiffness else 'without contact'


def _phases(plot: Any, found: Results) -> None:
    """Draw the shear modulus by angle and D / L, and the limit of face contact."""
    touching = map_of(found, CONTACT)
    there = sorted(touching)
    ratios = sorted({ratio for row in touching.values() for ratio in row})
    values = np.array([[touching[angle].get(ratio, math.nan) for angle in there]
                       for ratio in ratios])
    # Values that were not computed are slack.
    image = plot.imshow(
        np.nan_to_num(np.clip(values, 0.0, None)), origin='lower', aspect='auto', cmap=_MAP,
        extent=(-0.5, len(there) - 0.5, -0.5, len(ratios) - 0.5))
    plot.figure.colorbar(image, ax=plot, label='shear modulus [k / W]')
    plot.set_xticks(range(len(there)), [f'{angle:.2f}' for angle in there], rotation=45)
    plot.set_yticks(range(len(ratios)), [f'{ratio:g}' for ratio in ratios])
    limit = [np.interp(jamming_ratio(angle), ratios, np.arange(len(ratios)), left=-0.5)
             for angle in there]
    plot.plot(range(len(there)), limit, color='white', linewidth=2.5)
    plot.plot(range(len(there)), limit, color='#d55e00', linestyle='--', linewidth=1.3,
              label='L$_{min}$ / L: below it free slabs jam')
    plot.set_ylim(-0.5, len(ratios) - 0.5)
    plot.grid(visible=False)
    plot.legend(loc='lower left', facecolor='white', frameon=True, framealpha=0.9)
    _label(plot, _ANGLE, 'D / L', f'between held ends, K / k = {CONTACT:g}', legend=False)


def _strength(plots: Sequence[Any], found: Results) -> None:
    rows = [row for row in found['curves'] if row['weave.kind'] == 'orthogonal']
    for kind, plot in zip(KINDS, plots):
        for row, style in zip(rows, line_styles(len(rows))):
            if row['state'] == 'done':
                draw_line(plot, *curve_of(row, kind), style,
                          f'{row["weave.connector_angle"]:.3g} rad')
        _label(plot, 'strain [-]', 'stress [k / W]', kind, legend=kind == KINDS[0])


def _friction(plots: Sequence[Any], found: Results) -> None:
    sheared, around = plots
    rows = [row for row in found['slab'] if ratio_of(row) == RATIO]
    for row, style in zip(rows, line_styles(len(rows))):
        draw_line(sheared, *curve_of(row, 'shear'), style, f'friction {friction_of(row):g}')
    _label(sheared, 'strain [-]', 'stress [k / W]', f'shear, least angle, D / L = {RATIO:g}')
    rows = [row for row in found['around'] if row['weave.connector_angle'] == min(
        each['weave.connector_angle'] for each in found['around'])]
    curves = [(row, kind) for kind in ('push', 'shear') for row in rows]
    for (row, kind), style in zip(curves, line_styles(len(curves))):
        way = 'around' if row['connector.obstruction'] == 'wrap' else 'through'
        draw_line(around, *curve_of(row, kind), style, f'{kind}, {way} shells')
    angle = rows[0]['weave.connector_angle']
    _label(around, 'strain [-]', 'stress [k / W]', f'connectors that only pull, {angle:.3g} rad')


# Number of plots in a row, and the function that draws them.
FIGURES: Final[Mapping[str, tuple[int, Callable[[Sequence[Any], Results], None]]]] = {
    'constants': (3, _constants), 'slabs': (2, _slabs), 'waves': (1, _waves),
    'surfaces': (2, _surfaces), 'jam': (3, _jam),
    'friction': (2, _friction), 'strength': (3, _strength)}
