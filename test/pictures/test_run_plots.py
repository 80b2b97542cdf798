# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Plots of runs: their numbers are those of the simulation, and lines are told apart by anyone."""

from pathlib import Path
from xml.etree import ElementTree

from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.commands.main import main
from icofabric_sim.pictures import run_plots
from icofabric_sim.pictures.figure_style import COLORS, line_styles
from icofabric_sim.simulation.simulation import compile_scene
from matplotlib.image import imread
import numpy as np
import pytest
from recorded_runs import record_push, swing_scene

SERIES = run_plots._read


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('bags') / 'swing'
    record_push(path, swing_scene())
    return path


def series_of(bag: Path, *groups: str) -> run_plots.Series:
    with RecordedRun(bag) as run:
        return SERIES(run, groups, -np.inf, np.inf)


def test_styles_differ_in_every_way() -> None:
    styles = line_styles(30)
    assert len(set(styles)) == 30
    for part in zip(*styles[:len(COLORS)]):
        assert len(set(part)) == len(COLORS)


# What people see who lack cones for red, green or blue (Vienot, Brettel and Mollon 1999 for the
# first two; Machado, Oliveira and Fernandes 2009 for the third), from linear RGB, and in grey.
SEEN = {
    'all cones': np.eye(3),
    'no red': [[0.112, 0.112, 0.004], [0.888, 0.888, -0.004], [0.0, 0.0, 1.0]],
    'no green': [[0.293, 0.293, -0.021], [0.707, 0.707, 0.021], [0.0, 0.0, 1.0]],
    'no blue': [[1.256, -0.078, 0.005], [-0.077, 0.931, 0.691], [-0.179, 0.148, 0.304]],
}


@pytest.mark.parametrize('eyes', SEEN)
def test_colours_differ_for_all_who_confuse_them(eyes: str) -> None:
    rgb = np.array([[int(color[k:k + 2], 16) for k in (1, 3, 5)] for color in COLORS]) / 255.0
    seen = np.clip(rgb ** 2.2 @ np.array(SEEN[eyes]), 0.0, 1.0) ** (1.0 / 2.2)
    for k in range(len(COLORS)):
        for other in range(k):
            # Black and white are 1.7 apart.
            assert np.linalg.norm(seen[k] - seen[other]) > 0.1, (COLORS[k], COLORS[other])


def test_the_confusions_are_those_of_the_literature() -> None:
    # Grey stays grey; a red and a green of the same other cones' answer become one.
    for name, matrix in SEEN.items():
        assert np.ones(3) @ np.array(matrix) == pytest.approx(np.ones(3), abs=0.01), name
    for name in ('no red', 'no green'):
        confused = np.linalg.svd(np.array(SEEN[name]).T)
        assert confused[1][-1] < 0.01
        assert np.abs(confused[2][-1, :2]).min() > 0.05


def test_scales_of_pictures_are_told_apart_by_all() -> None:
    from icofabric_sim.pictures.measures import QUANTITIES, Scale
    for name in QUANTITIES:
        scale = Scale(QUANTITIES[name], 1.0)
        ends = scale.colors(np.array([-1.0, 0.0, 1.0] if scale.quantity.signed else [0.0, 1.0]))
        for eyes, matrix in SEEN.items():
            seen = np.clip(ends ** 2.2 @ np.array(matrix), 0.0, 1.0) ** (1.0 / 2.2)
            apart = np.linalg.norm(seen[:, None] - seen[None], axis=2)
            assert (apart + 9.0 * np.eye(len(seen))).min() > 0.3, (name, eyes)


def test_displacements_and_forces_are_those_of_the_simulation(bag: Path) -> None:
    series = series_of(bag, 'tip', 'wall')
    scene = swing_scene()
    moved = run_plots.displacements(series)
    tip = scene.groups['tip']
    np.testing.assert_allclose(
        moved['tip'], series.position[:, tip].mean(axis=1) - scene.position[tip].mean(axis=0),
        atol=1e-12)
    assert moved['tip'][-1, 2] < -1e-3 and not moved['wall'].any()
    # Newton's second law for the free part, before anything pushes it: the wall bears what the
    # weight and the acceleration leave.
    simulation = compile_scene(scene)
    simulation.advance_to(0.05)
    step = 1e-5
    before = simulation.snapshot().linear_velocity
    simulation.advance_to(0.05 + 2 * step)
    acceleration = (simulation.snapshot().linear_velocity - before) / (2 * step)
    number = int(np.argmin(np.abs(series.times - 0.05)))
    assert series.times[number] == pytest.approx(0.05, abs=1e-9)
    free = np.setdiff1d(np.arange(scene.body_count), scene.groups['wall'])
    mass = scene.shell.mass
    needed = mass * (acceleration[free] - np.array([0.0, 0.0, -9.81])).sum(axis=0)
    pull = run_plots.forces(series)['wall'][number]
    # The wall is pulled by what the free part needs, the other way round.
    np.testing.assert_allclose(pull, -needed, atol=0.02 * np.linalg.norm(needed))


def test_a_sine_has_its_frequency_and_amplitude() -> None:
    times = np.arange(0.0, 4.0, 1.0 / 60.0)
    values = np.stack([0.3 * np.sin(2 * np.pi * 7.0 * times) + 5.0, 0.0 * times], axis=1)
    frequency, amplitude = run_plots.spectrum(times, values)
    peak = int(np.argmax(amplitude[:, 0]))
    assert frequency[peak] == pytest.approx(7.0, abs=0.1)
    assert amplitude[peak, 0] == pytest.approx(0.3, rel=0.02)
    assert not amplitude[:, 1].any()


def test_stress_and_strain_have_the_sign_of_a_pull(bag: Path) -> None:
    series = series_of(bag, 'wall', 'tip')
    # Stretched along x by 1 %, as one moment: every connector along x pulls.
    stretched = series._replace(position=series.position.copy())
    stretched.position[-1] = series.position[0] * [1.01, 1.0, 1.0]
    stretched.orientation[-1] = series.orientation[0]
    strain, stress = run_plots.stress_strain(stretched)
    assert strain[0] == 0.0 and stress[0] == pytest.approx(0.0, abs=1e-6)
    assert strain[-1] == pytest.approx(0.01) and stress[-1] > 0.0


LABELS = {
    'energy': ('energy [J]', 'time [s]'), 'displacement': ('displacement [m]', 'time [s]'),
    'force': ('force [N]', 'time [s]'), 'tension': ('tension [N]', 'connectors'),
    'spectrum': ('frequency [Hz]', 'amplitude [m]'), 'stress': ('strain [%]', 'stress [Pa]')}


@pytest.mark.parametrize('kind', run_plots.PLOTS)
def test_every_plot_as_png_and_svg(
        kind: str, bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    groups = ['--groups', 'wall', 'tip'] if kind != 'energy' else []
    svg, png = tmp_path / f'{kind}.svg', tmp_path / f'{kind}.png'
    for path in (png, svg):
        assert main([
            'plot', str(bag), kind, '--output', str(path), '--size', '5x3', *groups]) == 0
    capsys.readouterr()
    again = tmp_path / 'again.svg'
    assert main(['plot', str(bag), kind, '--output', str(again), '--size', '5x3', *groups]) == 0
    assert again.read_bytes() == svg.read_bytes()
    high = 3.75 if kind == 'energy' else 3.0
    picture = imread(png)
    assert picture.shape[:2] == (round(160 * high), 800)
    # Axes say their units; text is drawn as outlines, with the words beside them in comments.
    said = svg.read_text('utf-8')
    for label in LABELS[kind]:
        assert f'<!-- {label} -->' in said
    assert ElementTree.parse(svg).getroot().get('width') == '360pt'
    used = {color for color in COLORS if color in said}
    assert used and COLORS[0] in used
    colours = np.rint(255 * picture[:, :, :3]).reshape(-1, 3)
    wanted = np.array([int(COLORS[0][k:k + 2], 16) for k in (1, 3, 5)])
    assert (np.abs(colours - wanted).max(axis=1) <= 3).sum() > 20


def test_what_a_plot_refuses(
        bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, status, named in (
        (['force', '--output', 'x.pdf'], 2, '.png or .svg'),
        (['force', '--groups', 'nowhere'], 2, '--groups'),
        (['stress', '--groups', 'tip'], 2, 'two groups'),
        (['stress', '--groups', 'tip', '0 1 2 3 4 5 6 7'], 0, ''),
        (['force', '--size', '1x1'], 2, '--size'), (['force', '--size', '6'], 2, '--size'),
        (['force', '--from', '2', '--to', '1'], 2, '--to'),
        (['force', '--from', '5'], 1, 'no poses'), (['energy', '--from', '5'], 1, 'no energies'),
        (['spectrum', '--to', '0.05'], 1, 'at least'),
    ):
        output = [] if '--output' in words else ['--output', str(tmp_path / 'x.svg')]
        assert main(['plot', str(bag), *words, *output]) == status, words
        error = capsys.readouterr().err
        assert named in error and len(error.splitlines()) == (status > 0)


TABLE = """solver,tool,setting_kind,setting,error,time_s,time_low_s,time_high_s,rounds
ours,icofabric_sim,steps,100,1e-4,0.01,0.009,0.012,3
ours,icofabric_sim,steps,200,1e-6,0.02,0.019,0.022,3
ours too,icofabric_sim,steps,200,2e-6,0.03,0.029,0.032,3
theirs,scipy,tolerance,1e-6,1e-5,0.4,0.39,0.41,3
"""


def test_work_and_precision_are_drawn_from_their_table(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, svg = tmp_path / 'work_precision.csv', tmp_path / 'drawn.svg'
    table.write_text(TABLE, 'utf-8')
    words = ['plot', str(table), 'work-precision', '--size', '5x4']
    assert main([*words, '--output', str(svg)]) == 0
    said = svg.read_text('utf-8')
    for label in ('ours', 'ours too', 'theirs', 'time [s], one thread'):
        assert f'<!-- {label} -->' in said
    # A colour for each tool; solvers of one tool differ in dash.
    assert COLORS[0] in said and COLORS[1] in said and COLORS[2] not in said
    assert ElementTree.parse(svg).getroot().get('width') == '360pt'
    assert main(words) == 0
    assert imread(tmp_path / 'work_precision_work-precision.png').shape[:2] == (640, 800)
    capsys.readouterr()
    other = tmp_path / 'other.csv'
    other.write_text('a,b\n1,2\n', 'utf-8')
    for path, more, named in (
            (other, [], 'no table of work'), (tmp_path / 'none.csv', [], 'no such file'),
            (table, ['--axis', 'x'], '--axis')):
        assert main(['plot', str(path), 'work-precision', *more]) == 2
        assert named in capsys.readouterr().err
