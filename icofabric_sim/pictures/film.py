# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Films of recorded runs and of scenes: MP4 by ffmpeg, which imageio-ffmpeg carries, WebP and GIF.

The encoder is given one thread and no time of its own, so the same moments give the same film.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
import math
from pathlib import Path
import shutil
import subprocess
from typing import Any

from icofabric_sim.libraries import import_library, MissingLibrary
from icofabric_sim.pictures.camera import View
from icofabric_sim.pictures.drawing import Framing, Renderer
from icofabric_sim.pictures.measures import fit_scale
from icofabric_sim.pictures.moment import Moment
from icofabric_sim.pictures.render import chosen_bodies, own_pushes
from icofabric_sim.simulation.simulation import Simulation
import numpy as np

FILM_SIZE = (1280, 720)
SUFFIXES = ('.mp4', '.webp', '.gif')
Progress = Callable[[float], None]
# Moments from which the scale of colours is found, and those whose marks the legend explains.
_SAMPLED = 24
# A GIF shows pictures for whole hundredths of a second, and players slow down faster ones.
FASTEST_GIF = 50.0
# Pictures from which the colours of a GIF are taken.
_COLOR_SAMPLES = 6
# How good, and how slow to make: the constant rate factor and preset of x264, the quality and
# method of WebP. `small` films have a fifth of the bytes.
_MP4 = {False: ('18', 'veryfast'), True: ('30', 'slow')}
_WEBP = {False: (85, 4), True: (40, 6)}


class FilmError(Exception):
    """The encoder has failed."""


def encoder() -> str:
    """Path of the ffmpeg that imageio-ffmpeg has, or the machine; MissingLibrary: neither has."""
    try:
        return str(import_library(
            'imageio_ffmpeg', 'an MP4 film', without='a film that ends in .webp or .gif does not'
        ).get_ffmpeg_exe())
    except (MissingLibrary, RuntimeError) as error:
        found = shutil.which('ffmpeg')
        if found is not None:
            return found
        if isinstance(error, MissingLibrary):
            raise
        raise FilmError(f'an MP4 film needs ffmpeg: {error}') from error


def simulated_moments(
    simulation: Simulation, times: np.ndarray, progress: Progress = lambda time: None
) -> list[Moment]:
    """Moments of a simulation at ascending times [s]; it is advanced to the last of them."""
    moments = []
    scene = simulation.scene
    for time in times.tolist():
        simulation.advance_to(time)
        state = simulation.snapshot()
        broken = None if state.intact.all() else np.flatnonzero(~state.intact)
        moments.append(Moment(
            time, state.position, state.orientation, scene, '', broken, state.linear_velocity,
            tuple(own_pushes(scene, state.position, state.orientation, time, set())),
            state.anchor_ends[:, 1] if scene.anchors else None,
            np.flatnonzero(~state.anchor_intact)))
        progress(time)
    return moments


def make_renderer(
    moments: Iterable[Moment], *, sampled: Iterable[Moment], title: str,
    size: tuple[int, int] = FILM_SIZE, view: View | None = None, color: str = 'strain',
    bodies: str = '', follow: str = ''
) -> Renderer:
    """One camera and one scale of colours for all the moments of a film."""
    framing = None
    for moment in moments:
        if framing is None:
            framing = Framing(
                view,
                bodies=chosen_bodies(moment.scene, 'bodies', bodies) if bodies else None,
                follow=chosen_bodies(moment.scene, 'follow', follow) if follow else None)
        framing.add(moment)
    if framing is None:
        raise ValueError('there is nothing to film: give at least one moment')
    return Renderer(
        framing, title=title, size=size, color=color, scale=fit_scale(color, sampled))


def spread_moments(moments: list[Moment]) -> list[Moment]:
    """Return a sample of the moments, which determines colours and legend."""
    places = np.unique(np.linspace(0, len(moments) - 1, _SAMPLED).astype(int))
    return [moments[place] for place in places]


def write_film(
    path: Path, renderer: Renderer, moments: Iterable[Moment], *, rate: float,
    small: bool = False, legend: Iterable[Moment] = (), progress: Progress = lambda count: None
) -> int:
    """
    Draw moments to a film of `rate` pictures a second; returns how many there are.

    The suffix of `path` says which form it has. `small`: for a web page, fewer bytes for a picture
    that is a little less sharp. What is seen in the moments `legend` is explained from the start.
    FilmError where the encoder fails; nothing is left of a film that was broken off.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f'.{path.stem}.part{path.suffix}')
    count = 0
    explained = list(legend)
    try:
        suffix = path.suffix.lower()
        if suffix == '.gif':
            samples = [renderer.picture(moment, legend=explained)
                       for moment in explained[:_COLOR_SAMPLES]]
            encode = _gif(part, rate, samples)
        elif suffix == '.webp':
            encode = _webp(part, rate, small)
        else:
            encode = _mp4(part, rate, renderer.size, small)
        with encode as add:
            for moment in moments:
                add(renderer.picture(moment, legend=[moment, *explained]))
                explained = []
                count += 1
                progress(count)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return count


@contextmanager
def _mp4(
    path: Path, rate: float, size: tuple[int, int], small: bool
) -> Iterator[Callable[[Any], None]]:
    factor, preset = _MP4[small]
    command = [
        encoder(), '-loglevel', 'error', '-y', '-f', 'rawvideo', '-pix_fmt', 'rgb24',
        '-s', f'{size[0]}x{size[1]}', '-r', f'{rate:.9g}', '-i', '-', '-an',
        '-c:v', 'libx264', '-preset', preset, '-crf', factor, '-pix_fmt', 'yuv420p',
        '-threads', '1', '-movflags', '+faststart', '-fflags', '+bitexact',
        '-flags:v', '+bitexact', '-map_metadata', '-1', '-f', 'mp4', str(path)]
    with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stderr is not None
        stdin = process.stdin
        try:
            yield lambda picture: _written(stdin.write(picture.tobytes()))
            stdin.close()
        except BrokenPipeError:
            # It says below why it ended.
            pass
        except BaseException:
            process.kill()
            raise
        said = process.stderr.read().decode(errors='replace').strip()
        if process.wait():
            raise FilmError(f'ffmpeg could not write {path}: {said or "it says nothing"}')


def _written(count: int | None) -> None:
    """Nothing: the pipe takes all."""


@contextmanager
def _gif(
    path: Path, rate: float, samples: Sequence[Any]
) -> Iterator[Callable[[Any], None]]:
    """All pictures share the colours of the samples; they wait in memory, a byte a pixel."""
    from PIL import Image

    frames: list[Any] = []
    palette = None
    if samples:
        width, height = samples[0].size
        mosaic = Image.new('RGB', (width * len(samples), height))
        for number, sample in enumerate(samples):
            mosaic.paste(sample, (number * width, 0))
        palette = mosaic.quantize(256, method=Image.Quantize.MEDIANCUT)

    def add(picture: Any) -> None:
        shared = palette or (frames[0] if frames else picture.quantize(256))
        frames.append(picture.quantize(palette=shared, dither=Image.Dither.NONE))

    yield add
    if frames:
        frames[0].save(
            path, format='GIF', save_all=True, append_images=frames[1:], loop=0,
            duration=_durations(len(frames), rate, 10))


@contextmanager
def _webp(path: Path, rate: float, small: bool) -> Iterator[Callable[[Any], None]]:
    """Yield a function that adds pictures to a WebP film, held in memory until the end."""
    frames: list[Any] = []
    yield frames.append
    if frames:
        quality, method = _WEBP[small]
        frames[0].save(
            path, format='WEBP', save_all=True, append_images=frames[1:], loop=0,
            quality=quality, method=method, duration=_durations(len(frames), rate, 1))


def _durations(count: int, rate: float, unit: int) -> list[int]:
    """Return the display time [ms] of each picture; ends are rounded to multiples of `unit`."""
    ends = np.rint(1000.0 / unit * np.arange(count + 1) / rate)
    return list((unit * np.diff(ends)).astype(int).tolist())


def film_times(start: float, end: float, rate: float, speed: float) -> np.ndarray:
    """Return simulated times [s] of a film: `rate` pictures and `speed` s in each second."""
    count = math.floor((end - start) * rate / speed + 1e-9) + 1
    return np.asarray(start + np.arange(count) * speed / rate)
