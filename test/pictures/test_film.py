# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Films: as long as they should be, the same for the same run, and moving."""

from pathlib import Path
import subprocess
import sys

from icofabric_sim.commands.main import main
from icofabric_sim.pictures.film import _gif, film_times
import numpy as np
from PIL import Image
import pytest
from recorded_runs import record_push, swing_scene

SMALL = ['--size', '320x320', '--rate', '20']


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('bags') / 'swing'
    record_push(path, swing_scene())
    return path


def scene_file(folder: Path) -> str:
    from icofabric_sim.parameters.text import dump_parameters
    path = folder / 'swing.yaml'
    path.write_text(dump_parameters(swing_scene().parameters.complete()), 'utf-8')
    return str(path)


def frames_of(path: Path) -> list[np.ndarray]:
    with Image.open(path) as film:
        frames = []
        for number in range(film.n_frames):
            film.seek(number)
            frames.append(np.asarray(film.convert('RGB')).astype(int))
        return frames


def test_times_of_a_film() -> None:
    np.testing.assert_allclose(film_times(0.5, 1.0, 10.0, 1.0), [0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
    # A tenth of the speed: ten times as many pictures.
    assert len(film_times(0.0, 1.0, 10.0, 0.1)) == 101


@pytest.mark.parametrize('rate', [10.0, 24.0, 30.0, 40.0, 50.0])
def test_gif_plays_at_the_speed_that_was_asked_for(tmp_path: Path, rate: float) -> None:
    film = tmp_path / 'film.gif'
    pictures = [
        Image.new('RGB', (32, 32), 3 * (50 + 150 * (number % 2),)) for number in range(100)]
    with _gif(film, rate, pictures[:2]) as add:
        for picture in pictures:
            add(picture)
    with Image.open(film) as image:
        times = []
        for number in range(image.n_frames):
            image.seek(number)
            times.append(image.info['duration'])
    assert len(times) == 100 and sum(times) == pytest.approx(100_000.0 / rate, abs=10.0)


def test_film_of_a_bag_moves_and_is_the_same_again(
        bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    films = [tmp_path / name for name in ('one.gif', 'two.gif')]
    for film in films:
        assert main(['film', str(bag), str(film), *SMALL, '--to', '0.2']) == 0
    assert '5 frames' in capsys.readouterr().out
    assert films[0].read_bytes() == films[1].read_bytes()
    frames = frames_of(films[0])
    assert len(frames) == 5 and frames[0].shape == (320, 320, 3)
    for one, two in zip(frames, frames[1:]):
        assert (np.abs(one - two).max(axis=2) > 20)[30:280].mean() > 0.01


def test_film_of_a_scene_shows_what_a_run_of_it_does(
        bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    film = tmp_path / 'scene.gif'
    # Before the push of the recorded run, whose arrow would count for the framing.
    words = ['--to', '0.05', '--color', 'speed', *SMALL]
    assert main(['film', scene_file(tmp_path), str(film), *words]) == 0
    other = tmp_path / 'bag.gif'
    assert main(['film', str(bag), str(other), *words]) == 0
    capsys.readouterr()
    scene, recorded = frames_of(film), frames_of(other)
    assert len(scene) == len(recorded) == 2
    # The same silhouettes but for pixels at edges: poses are those of the run.
    for one, two in zip(scene, recorded):
        dark = [(picture[40:270].min(axis=2) < 200) for picture in (one, two)]
        assert dark[0].mean() > 0.03 and (dark[0] != dark[1]).mean() < 0.04


@pytest.mark.parametrize('rate', [12.0, 24.0])
def test_webp_plays_at_the_speed_that_was_asked_for(
        bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], rate: float) -> None:
    films = [tmp_path / name for name in ('film.webp', 'small.webp')]
    for film, more in zip(films, ([], ['--small'])):
        assert main([
            'film', str(bag), str(film), '--size', '320x320', '--rate', str(rate), '--speed',
            '0.5', *more]) == 0
    capsys.readouterr()
    frames = frames_of(films[0])
    times = []
    with Image.open(films[0]) as image:
        for number in range(image.n_frames):
            image.seek(number)
            image.load()
            times.append(image.info['duration'])
    # The run of 0.3 s at half its speed, and the last picture.
    assert len(frames) == len(times) == round(0.6 * rate - 0.5) + 1
    assert sum(times) == pytest.approx(1000.0 * len(times) / rate, abs=1.0)
    assert (np.abs(frames[0] - frames[-1]).max(axis=2) > 30).mean() > 0.03
    assert films[1].stat().st_size < 0.8 * films[0].stat().st_size


def test_film_as_mp4(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    imageio_ffmpeg = pytest.importorskip('imageio_ffmpeg')
    film = tmp_path / 'films' / 'swing.mp4'
    assert main(['film', str(bag), str(film), *SMALL, '--speed', '0.5']) == 0
    assert '13 frames, 0.65 s' in capsys.readouterr().out
    assert [path.name for path in film.parent.iterdir()] == ['swing.mp4']
    said = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), '-i', str(film), '-f', 'null', '-'],
        capture_output=True, text=True, check=True).stderr
    assert '320x320' in said and '20 fps' in said and 'yuv420p' in said
    # The pictures themselves: read back, they move.
    raw = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), '-loglevel', 'error', '-i', str(film), '-f', 'rawvideo',
         '-pix_fmt', 'rgb24', '-'], capture_output=True, check=True).stdout
    pictures = np.frombuffer(raw, np.uint8).reshape(-1, 320, 320, 3).astype(int)
    assert len(pictures) == 13
    assert (np.abs(pictures[0] - pictures[-1]).max(axis=2) > 30).mean() > 0.03


def test_what_a_film_refuses(
        bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = scene_file(tmp_path)
    film = str(tmp_path / 'film.gif')
    for words, named in (
        ([str(bag), str(tmp_path / 'film.avi')], '.mp4, .webp or .gif'),
        ([str(bag), film, '--small'], '--small'),
        ([str(bag), film, '--rate', '0'], '--rate'), ([str(bag), film, '--rate', 'nan'], '--rate'),
        ([str(bag), film, '--speed', '0'], '--speed'),
        ([str(bag), film, '--speed', '1e-310'], '--speed'),
        ([str(bag), film, '--rate', '60'], '50'),
        ([str(bag), str(tmp_path / 'f.mp4'), '--size', '321x320'], 'even'),
        ([str(bag), film, '--from', '7'], '--from 7 s'),
        ([str(bag), film, '--duration', '1'], '--duration'),
        ([scene, film, '--duration', '-1'], '--duration'),
        ([str(bag), film, '--bodies', 'nowhere'], 'bodies'),
        ([str(bag), str(tmp_path / 'swing.yaml' / 'film.gif')], 'not a folder'),
    ):
        assert main(['film', *words]) == 2, words
        error = capsys.readouterr().err
        assert named in error and len(error.splitlines()) == 1
    assert not list(tmp_path.glob('*.gif')) and not list(tmp_path.glob('.*.gif'))


def test_without_the_encoder_the_way_out_is_said(
        bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'imageio_ffmpeg', None)
    monkeypatch.setenv('PATH', str(tmp_path))
    assert main(['film', str(bag), str(tmp_path / 'film.mp4')]) == 2
    said = capsys.readouterr().err
    assert 'pip install imageio-ffmpeg' in said and said.count('\n') == 1
