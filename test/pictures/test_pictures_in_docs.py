# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The gallery has every example scene, in pictures of the size and colours of its commands."""

from pathlib import Path
import re
import runpy
import shlex

from icofabric_sim.geometry.icosahedron import NAMED_EDGE_DIRECTIONS, NAMED_EDGES
from icofabric_sim.parameters.example_scenes import example_scenes
from icofabric_sim.pictures.document_figures import draw_figure
from icofabric_sim.pictures.fabric_polygons import FREE_COLOR
from icofabric_sim.pictures.measures import QUANTITIES, Scale
from icofabric_sim.scene.weave_tables import TABLE_5
from matplotlib.image import imread
import numpy as np
from PIL import Image
import pytest

ROOT = Path(__file__).resolve().parents[2]
GALLERY = (ROOT / 'docs' / 'gallery.md').read_text('utf-8')
LARGEST = 150_000  # [bytes]
LARGEST_FILM = 350_000  # [bytes]


def section(name: str) -> str:
    found = re.search(rf'^## {name}\n(.*?)(?=^## |\Z)', GALLERY, re.MULTILINE | re.DOTALL)
    assert found, f'docs/gallery.md does not show {name}'
    return found[1]


@pytest.mark.parametrize('name', example_scenes())
def test_every_ready_scene_is_in_the_gallery(name: str) -> None:
    text = section(name)
    picture, = re.findall(r'!\[[^\]]+\]\(([\w/]+\.png)\)', text)
    path = ROOT / 'docs' / picture
    run, render, film = (shlex.split(line) for line in text.splitlines()
                         if line.startswith('    '))
    # The commands are about this scene, and the picture is where they put it.
    assert run[1:3] == ['run', name] and film[1:3] == ['film', name]
    assert (ROOT / render[render.index('--sheet') + 1]) == path
    assert render[render.index('--times') + 1] == run[run.index('--duration') + 1]
    speed = float(film[film.index('--speed') + 1]) if '--speed' in film else 1.0
    assert float(film[film.index('--duration') + 1]) / speed == 10.0
    # What to notice.
    assert len(re.sub(r'!.*|    .*', '', text).split()) > 15
    assert path.stat().st_size < LARGEST
    seen = imread(path)
    assert f'{seen.shape[1]}x{seen.shape[0]}' == render[render.index('--size') + 1]
    # Shells, and the ends of the scale of colours, which stands in the lower right corner.
    pixels = np.rint(255.0 * seen[:, :, :3]).reshape(-1, 3)
    free = np.rint(255.0 * FREE_COLOR)
    assert (np.abs(pixels - free).max(axis=1) <= 2.0).sum() > 20
    corner = np.rint(255.0 * seen[-70:, -230:, :3]).reshape(-1, 3)
    for color in Scale(QUANTITIES['strain'], 1.0).colors(np.array([-1.0, 0.0, 1.0])):
        assert (np.abs(corner - np.rint(255.0 * color)).max(axis=1) <= 6.0).sum() >= 3


def boxes(data: bytes) -> dict[bytes, bytes]:
    """The boxes of an MP4 file (ISO/IEC 14496-12), by type."""
    found, place = {}, 0
    while place + 8 <= len(data):
        size = int.from_bytes(data[place:place + 4], 'big')
        assert size >= 8
        found[data[place + 4:place + 8]] = data[place + 8:place + size]
        place += size
    return found


@pytest.mark.parametrize('name', example_scenes())
def test_every_ready_scene_has_a_film_of_ten_seconds_that_its_command_makes(name: str) -> None:
    text = section(name)
    path = ROOT / 'docs' / 'gallery' / f'{name}.mp4'
    video, = re.findall('<video src="([^"]+)" width="([0-9]+)" height="([0-9]+)"', text)
    film, = (shlex.split(line) for line in text.splitlines() if ' film ' in line[:40])
    assert ROOT / 'docs' / video[0] == path == ROOT / film[3]
    assert 'x'.join(video[1:]) == film[film.index('--size') + 1] and '--small' in film
    assert 20_000 < path.stat().st_size < LARGEST_FILM
    data = path.read_bytes()
    # Players can begin before they have all of it: the index comes first.
    assert data.index(b'moov') < data.index(b'mdat')
    header = boxes(boxes(data)[b'moov'])[b'mvhd']
    assert header[0] == 0
    ticks, length = (int.from_bytes(header[k:k + 4], 'big') for k in (12, 16))
    rate = float(film[film.index('--rate') + 1])
    # The first picture and the last are both shown.
    assert length / ticks == pytest.approx(10.0 + 1.0 / rate, abs=0.01)


def test_the_moving_picture_at_the_top_is_what_its_command_says() -> None:
    text = (ROOT / 'docs' / 'decisions' / 'pictures.md').read_text('utf-8')
    film, = (shlex.split(line) for line in text.splitlines() if ' film folded_slab ' in line)
    path = ROOT / film[3]
    for page, name in (('README.md', 'docs/folded.webp'), ('docs/index.md', 'folded.webp')):
        assert f']({name})' in (ROOT / page).read_text('utf-8')
    assert path.stat().st_size < LARGEST_FILM
    with Image.open(path) as picture:
        assert f'{picture.width}x{picture.height}' == film[film.index('--size') + 1]
        seconds, rate = (float(film[film.index(word) + 1]) for word in ('--duration', '--rate'))
        assert picture.n_frames == seconds * rate + 1


def test_the_script_of_the_gallery_runs_its_commands() -> None:
    commands = runpy.run_path(str(ROOT / 'docs' / 'draw_gallery.py'))['commands'](GALLERY)
    assert list(commands) == re.findall(r'^## (\w+)$', GALLERY, re.MULTILINE)
    for name, lines in commands.items():
        assert [line[1] for line in lines] == ['run', 'render', 'film'], name


def test_the_index_of_the_gallery_leads_to_every_scene() -> None:
    index = GALLERY.partition('\n## ')[0]
    for name in example_scenes():
        assert f'(gallery/{name}.png)](#{name})<br>`{name}`' in index


def test_the_films_are_small_enough_for_a_repository() -> None:
    films = list((ROOT / 'docs' / 'gallery').glob('*.mp4'))
    assert sum(path.stat().st_size for path in films) < 4_500_000


def test_the_gallery_shows_nothing_else() -> None:
    shown = {path.stem for path in (ROOT / 'docs' / 'gallery').iterdir()
             if not path.name.startswith('.')}
    assert shown == set(example_scenes()) == set(re.findall(r'^## (\w+)$', GALLERY, re.MULTILINE))


def test_the_figures_of_the_concepts_are_what_their_command_draws(tmp_path: Path) -> None:
    draw = runpy.run_path(str(ROOT / 'docs' / 'draw_concepts.py'))['draw']
    text = (ROOT / 'docs' / 'concepts.md').read_text('utf-8')
    paths = draw(tmp_path)
    assert len(paths) == 3
    for path in paths:
        assert f']({path.name})' in text
        drawn, kept = imread(path)[:, :, :3], imread(ROOT / 'docs' / path.name)[:, :, :3]
        # Fonts differ between versions of matplotlib; weaves do not.
        assert drawn.shape == kept.shape and (np.abs(drawn - kept) > 0.1).mean() < 0.02


def test_the_figures_of_the_weave_are_what_their_command_draws(tmp_path: Path) -> None:
    draw = runpy.run_path(str(ROOT / 'docs' / 'draw_weave.py'))['draw']
    text = (ROOT / 'docs' / 'weave.md').read_text('utf-8')
    paths = draw(tmp_path)
    assert len(paths) == 4
    for path in paths:
        assert f']({path.name})' in text
        kept = ROOT / 'docs' / path.name
        assert kept.stat().st_size < LARGEST
        drawn, kept = imread(path)[:, :, :3], imread(kept)[:, :, :3]
        assert drawn.shape == kept.shape and (np.abs(drawn - kept) > 0.1).mean() < 0.02


@pytest.mark.parametrize('name', ['2', '3a', '3b', '5'])
def test_the_figures_of_the_document_are_what_the_verb_draws(name: str, tmp_path: Path) -> None:
    pages = [(ROOT / 'docs' / f'{page}.md').read_text('utf-8') for page in ('document', 'weave')]
    assert any(f'](figure_{name}.png)' in text for text in pages)
    draw_figure(name, tmp_path / 'drawn.png')
    kept = ROOT / 'docs' / f'figure_{name}.png'
    assert kept.stat().st_size < LARGEST
    drawn, shown = imread(tmp_path / 'drawn.png')[:, :, :3], imread(kept)[:, :, :3]
    assert drawn.shape == shown.shape and (np.abs(drawn - shown) > 0.1).mean() < 0.02


def test_the_twelve_ends_of_the_weave_are_those_of_table_5() -> None:
    text = (ROOT / 'docs' / 'weave.md').read_text('utf-8')
    rows = re.findall(
        r'^\| (\d+) \| (\w+) \| ([+-])([xyz]) \| (\w+) \| \((.*)\) \|$', text, re.MULTILINE)
    assert len(rows) == len(TABLE_5) == 12
    for number, (row, (edge, direction)) in enumerate(zip(rows, TABLE_5), 1):
        axis = NAMED_EDGE_DIRECTIONS[edge]
        letter = 'xyz'[int(np.argmax(np.abs(axis)))]
        assert row == (
            str(number), NAMED_EDGES[edge], '+' if axis.sum() > 0 else '-', letter,
            NAMED_EDGES[edge ^ 1], ', '.join(map(str, direction)))


@pytest.mark.parametrize('page', ['tour', 'howto/hammock'])
def test_pictures_of_a_page_are_of_the_size_that_its_commands_say(page: str) -> None:
    text = (ROOT / 'docs' / f'{page}.md').read_text('utf-8')
    made = {}
    for line in text.splitlines():
        words = shlex.split(line) if line.startswith('    .venv/bin/icofabric') else []
        for option in ('--sheet', '--output'):
            if option in words:
                made[Path(words[words.index(option) + 1]).name] = words
        if 'film' in words:
            made[Path(words[3]).name] = words
    shown = re.findall(r'!\[[^\]]+\]\(([\w/]+\.\w+)\)', text)
    assert shown
    for name in shown:
        path = (ROOT / 'docs' / page).parent / name
        words = made[path.name]
        assert path.stat().st_size < (4 if path.suffix == '.gif' else 1.2) * LARGEST
        if '--size' in words:
            wide, high = map(int, words[words.index('--size') + 1].split('x'))
            seen = imread(path)
            # A sheet is cut to what the moments need.
            assert seen.shape[1] == wide and 0.7 * high < seen.shape[0] <= high
