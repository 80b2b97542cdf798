# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric film BAG|SCENE FILE`."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

import icofabric_sim as ico
from icofabric_sim.commands.bags import bag_errors, bag_path, is_bag
from icofabric_sim.commands.picture_arguments import (
    add_picture_arguments,
    camera_view,
    chosen_bodies_errors,
    picture_size,
    time_span,
)
from icofabric_sim.commands.scenes import add_scene_arguments, read_parameters
from icofabric_sim.libraries import require_library
from icofabric_sim.parameters.example_scenes import example_scenes
from icofabric_sim.terminal import (
    bad_input,
    CommandFailed,
    InputError,
    notes,
    Progress,
    require_place,
)

if TYPE_CHECKING:
    from icofabric_sim.pictures.drawing import Renderer

_NAME = 'icofabric film'
_MAX_RATE = 240.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    add_scene_arguments(parser, 'SCENE|BAG', 'the folder of a bag')
    parser.add_argument(
        'film', metavar='FILE', help='the film: a file that ends in .mp4, .webp or .gif')
    parser.add_argument(
        '--rate', type=float, default=30.0, metavar='R',
        help='frames per second (%(default)g)')
    parser.add_argument(
        '--speed', type=float, default=1.0, metavar='X',
        help='simulated seconds per second of the film: 0.2 is slow motion (%(default)g)')
    parser.add_argument(
        '--duration', type=float, metavar='S',
        help='of a scene: simulated time [s]; required if the scene has no duration')
    parser.add_argument(
        '--small', action='store_true',
        help='for a web page: MP4 or WebP with a fifth of the size, slightly less sharp')
    add_picture_arguments(parser, '1280x720')


def main(arguments: argparse.Namespace) -> int:
    """Film a recorded run, or a scene that is simulated for the film."""
    path = Path(arguments.film).expanduser()
    size = _check(arguments, path)
    require_place('FILE', path)
    require_library('matplotlib', 'a film')
    from icofabric_sim.pictures.film import encoder, FilmError
    try:
        if path.suffix.lower() == '.mp4':
            encoder()
        source = bag_path(arguments.scene)
        if arguments.scene not in example_scenes() and is_bag(source):
            if arguments.parameter or arguments.duration is not None:
                raise InputError('-p and --duration apply to scenes; a recorded run cannot be '
                                 'changed')
            with bag_errors(source):
                return _film_bag(arguments, source, path, size)
        return _film_scene(arguments, path, size)
    except FilmError as error:
        raise CommandFailed(str(error)) from error


def _check(arguments: argparse.Namespace, path: Path) -> tuple[int, int]:
    from icofabric_sim.pictures.film import FASTEST_GIF, SUFFIXES
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(
            f'{path} is not a film: give a file that ends in .mp4, .webp or .gif')
    if not 0.0 < arguments.rate <= _MAX_RATE:
        raise InputError(
            f'--rate must be above 0 and at most {_MAX_RATE:g} frames per second, got '
            f'{arguments.rate:g}')
    if path.suffix.lower() == '.gif' and arguments.rate > FASTEST_GIF:
        raise InputError(
            f'--rate of a GIF is at most {FASTEST_GIF:g} frames per second, got '
            f'{arguments.rate:g}; an MP4 allows more')
    if path.suffix.lower() == '.gif' and arguments.small:
        raise InputError('--small is for a film that ends in .mp4 or .webp; a GIF has one quality')
    if not 1e-6 <= arguments.speed <= 1e6:
        raise InputError(f'--speed must lie in 1e-06 to 1e+06, got {arguments.speed:g}')
    size = picture_size(arguments.size)
    if path.suffix.lower() == '.mp4' and any(side % 2 for side in size):
        raise InputError(f'--size of an MP4: width and height must be even, got {arguments.size}')
    camera_view(arguments.camera)
    return size


def _film_bag(
    arguments: argparse.Namespace, source: Path, path: Path, size: tuple[int, int]
) -> int:
    from icofabric_sim.bag.recorded_run import RecordedRun
    from icofabric_sim.pictures.film import film_times, write_film
    from icofabric_sim.pictures.render import nearest_times, RunPictures, spread_times
    import numpy as np

    with RecordedRun(source) as run:
        recorded = run.pose_times()
        if not len(recorded):
            raise InputError(f'{source} holds no poses to film')
        start, end = time_span(arguments, float(recorded[0]) / 1e9, float(recorded[-1]) / 1e9)
        wanted = film_times(start, end, arguments.rate, arguments.speed)
        times = nearest_times(recorded, np.rint(1e9 * wanted))
        rate = arguments.rate
        if len(times) < len(wanted):
            # With fewer poses than frames the duration of the film stays the same.
            rate *= len(times) / len(wanted)
        with chosen_bodies_errors():
            pictures = RunPictures(
                run, times, view=camera_view(arguments.camera), size=size,
                title=arguments.title, color=arguments.color, bodies=arguments.bodies,
                follow=arguments.follow)
        legend = list(pictures.moments_at(spread_times(times, 8)))
        with Progress(len(times), 'pictures') as progress:
            count = write_film(
                path, pictures.renderer, pictures.moments(), rate=rate, legend=legend,
                small=arguments.small, progress=progress.update)
    return _report(count, rate, path)


def _film_scene(arguments: argparse.Namespace, path: Path, size: tuple[int, int]) -> int:
    from icofabric_sim.pictures.film import (
        film_times,
        make_renderer,
        simulated_moments,
        spread_moments,
        write_film,
    )

    name, parameters = read_parameters(arguments)
    duration = parameters['duration'] if arguments.duration is None else arguments.duration
    if arguments.duration is None and arguments.end is not None:
        duration = arguments.end
    if not 0.0 < duration < math.inf:
        raise InputError(
            'duration required: give --duration S, the simulated time in seconds (above 0)')
    start, end = time_span(arguments, 0.0, duration)
    with bad_input():
        scene = ico.Scene.from_parameters(parameters)
        simulation = ico.compile_scene(scene)
    times = film_times(start, end, arguments.rate, arguments.speed)
    with Progress(end, 's simulated') as progress, notes(progress, _NAME):
        try:
            moments = simulated_moments(simulation, times, progress.update)
        except ico.SimulationError as error:
            raise CommandFailed(str(error)) from error
    with chosen_bodies_errors():
        renderer: Renderer = make_renderer(
            moments, sampled=spread_moments(moments), title=arguments.title or name, size=size,
            view=camera_view(arguments.camera), color=arguments.color, bodies=arguments.bodies,
            follow=arguments.follow)
    with Progress(len(moments), 'pictures') as progress:
        count = write_film(
            path, renderer, moments, rate=arguments.rate, legend=spread_moments(moments)[::3],
            small=arguments.small, progress=progress.update)
    return _report(count, arguments.rate, path)


def _report(count: int, rate: float, path: Path) -> int:
    print(f'{count} frames, {count / rate:.3g} s, in {path}')
    return 0
