# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Plots of recorded runs: energies, displacements, forces, tensions, spectra, stress."""

from collections.abc import Callable, Sequence
import math
from pathlib import Path
from typing import Any, NamedTuple

from icofabric_sim.bag import BagError
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.messages import decode_float64_multi_array
from icofabric_sim.messages.topics import ENERGIES, ENERGY
from icofabric_sim.pictures.figure_style import (
    draw_line,
    line_styles,
    make_figure,
    paper_style,
    save_figure,
)
from icofabric_sim.pictures.measures import connector_ends, connector_segments, tensions
from icofabric_sim.pictures.render import recorded_bodies, spread_times
from icofabric_sim.scene.published import spread
from icofabric_sim.scene.scene import Scene
from icofabric_sim.statics.stress_strain import cross_section
import numpy as np

# Kinds of plots, and what each shows.
PLOTS = {
    'energy': 'energies over time, and the error of their balance',
    'displacement': 'displacement of the middle of each group over time',
    'force': 'force of the springs that lead into each group, without damping, over time',
    'tension': 'how many connectors have which tension, at a few times',
    'spectrum': 'amplitudes of the displacement of each group over frequency',
    'stress': 'stress over strain between two groups',
}
DEFAULT_SIZE = (6.4, 4.0)  # [inches]
AXES = ('x', 'y', 'z')
_MOMENTS = 4  # of the tensions
_FEWEST_BINS, _MOST_BINS = 9, 80
# The shortest record [poses] that has a spectrum.
_LEAST_POSES = 8
# Energies that stay below this part of the largest are left out.
_SMALL_RATIO = 1e-6


class Series(NamedTuple):
    """Data of a plot of a run."""

    times: np.ndarray  # (t,) [s]
    groups: dict[str, np.ndarray]  # numbers of bodies
    position: np.ndarray  # (t, n, 3) [m]
    orientation: np.ndarray  # (t, n, 4)
    broken: list[np.ndarray]  # numbers of broken connectors at each time
    scene: Scene


def plot_run(
    run: RecordedRun, kind: str, path: Path, *, groups: Sequence[str] = (), axis: str = '',
    size: tuple[float, float] = DEFAULT_SIZE, start: float = -math.inf, end: float = math.inf
) -> None:
    """
    Draw one of PLOTS to a PNG or SVG file of `size` [inches], from `start` to `end` [s].

    `groups`: groups of the scene, selectors or body numbers; by default the scene's groups.
    `axis` x, y or z: that component; by default the size of the vector. ParameterError or
    ValueError where the scene lacks a group, BagError where the record lacks what is needed.
    """
    drawers: dict[str, Callable[..., Any]] = {
        'displacement': _displacement, 'force': _force, 'tension': _tension,
        'spectrum': _spectrum, 'stress': _stress}
    with paper_style():
        if kind == 'energy':
            figure = _energy(run, size, start, end)
        else:
            figure = drawers[kind](_read(run, groups, start, end), axis, size)
        figure.get_axes()[0].set_title(f'{run.path.name}: {PLOTS[kind]}', loc='left')
        save_figure(figure, path)


def _read(run: RecordedRun, names: Sequence[str], start: float, end: float) -> Series:
    """Return the longest part of the run with one scene."""
    times = run.pose_times()
    times = times[(times >= 1e9 * start - 0.5) & (times <= 1e9 * end + 0.5)]
    if not len(times):
        raise BagError(f'{run.path} holds no poses between these times')
    scene = run.scene_at(int(times[-1]))
    frames = [frame for frame in run.poses(times)
              if run.scene_at(frame.nanoseconds) is scene
              and len(frame.position) == len(_known(scene))]
    if not frames:
        raise BagError(f'{run.path} holds no poses of its last scene between these times')
    breaks = run.breaks()
    broken = []
    for frame in frames:
        told = [rows[:, 0].astype(int) for time, rows in breaks if time <= frame.nanoseconds]
        # Of connectors: anchors have no tension here.
        broken.append(told[-1][told[-1] >= 0] if told else np.zeros(0, int))
    if not names:
        names = [name for name, bodies in scene.groups.items()
                 if np.isin(bodies, _known(scene)).all()]
        if not names:
            raise BagError(f'{run.path} has no group of which it holds all poses; name bodies')
    groups = {name: recorded_bodies(scene, 'groups', name) for name in names}
    chosen = scene.published_bodies
    return Series(
        np.array([frame.time for frame in frames]), groups,
        np.array([spread(chosen, frame.position, scene.position) for frame in frames]),
        np.array([spread(chosen, frame.orientation, scene.orientation) for frame in frames]),
        broken, scene)


def _require_all(scene: Scene) -> None:
    """Raise BagError where a record lacks the poses of some bodies."""
    if scene.published_bodies is not None:
        raise BagError(
            'forces are drawn of all bodies; publish.group and publish.stride of this run leave '
            'some out: take energy, displacement or spectrum')


def _known(scene: Scene) -> np.ndarray:
    """Numbers of the bodies whose poses a record has."""
    chosen = scene.published_bodies
    return np.arange(scene.body_count) if chosen is None else chosen


def displacements(series: Series) -> dict[str, np.ndarray]:
    """Displacement (t, 3) [m] of the middle of each group since the first pose."""
    return {
        name: series.position[:, bodies].mean(axis=1) - series.position[0, bodies].mean(axis=0)
        for name, bodies in series.groups.items()}


def _require_plain(scene: Scene) -> None:
    """Raise BagError where more than straight springs leads into a group."""
    _require_all(scene)
    found = [f'connector.{name}' for name in ('bending_stiffness', 'twisting_stiffness')
             if getattr(scene.connectors, name).any()]
    if scene.parameters['connector.obstruction'] == 'wrap':
        found.append('connector.obstruction: wrap')
    if found:
        raise BagError(
            f'forces are drawn of straight springs only; this run has {", ".join(found)}: '
            'take energy, displacement or spectrum')


def forces(series: Series) -> dict[str, np.ndarray]:
    """Force (t, 3) [N] with which the connectors from other bodies pull at each group."""
    scene = series.scene
    _require_plain(scene)
    result = {name: np.zeros((len(series.times), 3)) for name in series.groups}
    if not scene.connector_count:
        return result
    inside = {}
    for name, bodies in series.groups.items():
        member = np.zeros(scene.body_count, bool)
        member[bodies] = True
        inside[name] = member[scene.connectors.bodies]
    for number in range(len(series.times)):
        ends = connector_ends(scene, series.position[number], series.orientation[number])
        pull = tensions(scene, np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
        pull[series.broken[number]] = 0.0
        along = ends[:, 1] - ends[:, 0]
        along *= (pull / np.linalg.norm(along, axis=1))[:, None]
        for name, sides in inside.items():
            # Of a connector between two bodies of the group both ends pull: nothing is left.
            sign = sides[:, 0].astype(float) - sides[:, 1]
            result[name][number] = sign @ along
    return result


def _component(values: np.ndarray, axis: str) -> np.ndarray:
    if axis:
        return np.asarray(values[:, AXES.index(axis)])
    return np.asarray(np.linalg.norm(values, axis=1))


def _lines(
    series: Series, values: dict[str, np.ndarray], axis: str, label: str,
    size: tuple[float, float]
) -> Any:
    figure, (axes,) = make_figure(size)
    for style, (name, rows) in zip(line_styles(len(values)), values.items()):
        draw_line(axes, series.times, _component(rows, axis), style, name)
    axes.set(xlabel='time [s]', ylabel=label)
    axes.legend(title='group')
    return figure


def _displacement(series: Series, axis: str, size: tuple[float, float]) -> Any:
    label = f'displacement along {axis} [m]' if axis else 'displacement [m]'
    return _lines(series, displacements(series), axis, label, size)


def _force(series: Series, axis: str, size: tuple[float, float]) -> Any:
    label = f'force along {axis} [N]' if axis else 'force [N]'
    return _lines(series, forces(series), axis, label, size)


def _energy(run: RecordedRun, size: tuple[float, float], start: float, end: float) -> Any:
    times, rows = [], []
    topic = ENERGY.name
    for _, time, data in run.messages(names=[topic]):
        if 1e9 * start - 0.5 <= time <= 1e9 * end + 0.5:
            times.append(time / 1e9)
            rows.append(run.decoded(decode_float64_multi_array, data).values)
    if not rows:
        raise BagError(
            f'{run.path} holds no energies ({topic}) between these times; runs of this simulator '
            'record them')
    energies = dict(zip(ENERGIES, np.array(rows).T))
    balance = energies.pop('balance error')
    largest = max(float(np.abs(values).max()) for values in energies.values()) or 1.0
    figure, (upper, lower) = make_figure((size[0], 1.25 * size[1]), rows=2)
    upper.get_gridspec().set_height_ratios((3, 1))
    shown = {name: values for name, values in energies.items()
             if np.abs(values).max() > _SMALL_RATIO * largest}
    for style, (name, values) in zip(line_styles(len(shown)), shown.items()):
        draw_line(upper, times, values, style, name)
    upper.set_ylabel('energy [J]')
    upper.legend(ncols=2)
    style, = line_styles(1)
    draw_line(lower, times, balance, style, 'balance error')
    lower.set(xlabel='time [s]', ylabel='balance\nerror [J]')
    return figure


def _tension(series: Series, axis: str, size: tuple[float, float]) -> Any:
    if not series.scene.connector_count:
        raise BagError('the scene has no connectors, and so no tensions')
    _require_all(series.scene)
    picked = spread_times(np.arange(len(series.times)), _MOMENTS)
    found = []
    for number in picked:
        length = connector_segments(
            series.scene, series.position[number], series.orientation[number]).lengths(
                series.scene.connector_count)
        found.append(np.delete(tensions(series.scene, length), series.broken[number]))
    low, high = (limit(values.min(initial=0.0) if limit is min else values.max(initial=0.0)
                       for values in found) for limit in (min, max))
    # Rice's rule.
    rule = 2.0 * series.scene.connector_count ** (1.0 / 3.0)
    bins = int(np.clip(rule, _FEWEST_BINS, _MOST_BINS))
    edges = np.linspace(low, high if high > low else low + 1e-9, bins + 1)
    figure, (axes,) = make_figure(size)
    for style, number, values in zip(line_styles(len(picked)), picked, found):
        counts, _ = np.histogram(values, edges)
        axes.stairs(counts, edges, color=style.color, linestyle=style.line, linewidth=1.3,
                    label=f't = {series.times[number]:.3g} s')
        middle = 0.5 * (edges[1:] + edges[:-1])
        axes.plot(middle[counts > 0], counts[counts > 0], linestyle='', marker=style.marker,
                  markersize=3.0, color=style.color)
    axes.set(xlabel='tension [N]', ylabel='connectors')
    axes.set_yscale('symlog', linthresh=1.0)
    axes.set_ylim(bottom=0.0)
    axes.legend()
    return figure


def spectrum(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Frequencies [Hz] and amplitudes (m, k) of the columns of `values` (t, k), without their means.

    Through a Hann window, scaled so that a sine of amplitude A has a peak of A.
    """
    step = float(np.median(np.diff(times)))
    even = np.arange(times[0], times[-1] + 0.5 * step, step)
    columns = np.array([np.interp(even, times, column) for column in values.T]).T
    window = np.hanning(len(even))[:, None]
    amplitude = 2.0 * np.abs(np.fft.rfft(window * (columns - columns.mean(axis=0)), axis=0))
    return np.fft.rfftfreq(len(even), step), amplitude / window.sum()


def _spectrum(series: Series, axis: str, size: tuple[float, float]) -> Any:
    if len(series.times) < _LEAST_POSES:
        raise BagError(
            f'a spectrum needs at least {_LEAST_POSES} poses between these times, there are '
            f'{len(series.times)}')
    figure, (axes,) = make_figure(size)
    moved = displacements(series)
    for style, (name, values) in zip(line_styles(len(moved)), moved.items()):
        frequency, amplitude = spectrum(series.times, values)
        draw_line(axes, frequency[1:], _component(amplitude, axis)[1:], style, name)
    axes.set(
        xlabel='frequency [Hz]',
        ylabel=f'amplitude along {axis} [m]' if axis else 'amplitude [m]')
    if any(values.any() for values in moved.values()):
        axes.set_yscale('log')
    axes.legend(title='group')
    return figure


def stress_strain(series: Series) -> tuple[np.ndarray, np.ndarray]:
    """
    Strain (t,) and stress (t,) [Pa] between the two groups of the series.

    Strain: of the distance between their middles. Stress: the mean of the forces that pull both
    towards each other, over the woven cross section.
    """
    if len(series.groups) != 2:
        raise ValueError(
            f'groups: stress over strain needs two groups, the ends of the pulled fabric, got '
            f'{", ".join(series.groups)}')
    one, other = series.groups
    middles = {name: series.position[:, bodies].mean(axis=1)
               for name, bodies in series.groups.items()}
    between = middles[other] - middles[one]
    distance = np.linalg.norm(between, axis=1)
    if not distance[0] > 0.0:
        raise ValueError(f'groups: {one} and {other} have the same middle')
    towards = between / distance[:, None]
    pulls = forces(series)
    pull = 0.5 * np.einsum('ti,ti->t', pulls[one] - pulls[other], towards)
    area = cross_section(series.scene, int(np.argmax(np.abs(between[0]))))
    return distance / distance[0] - 1.0, pull / area


def _stress(series: Series, axis: str, size: tuple[float, float]) -> Any:
    strain, stress = stress_strain(series)
    figure, (axes,) = make_figure(size)
    style, = line_styles(1)
    one, other = series.groups
    draw_line(axes, 100.0 * strain, stress, style, f'{one} to {other}')
    for place, marker, said in ((0, 'o', 'first'), (-1, 'X', 'last')):
        axes.plot([100.0 * strain[place]], [stress[place]], marker=marker, markersize=6.0,
                  color='black', linestyle='', label=f'{said}, t = {series.times[place]:.3g} s')
    axes.set(xlabel='strain [%]', ylabel='stress [Pa]')
    axes.legend()
    return figure
