# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Common arguments of verbs that draw: size, camera, colours, bodies, and a span of time."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import math
from pathlib import Path
import re
from typing import TYPE_CHECKING

from icofabric_sim.libraries import require_library
from icofabric_sim.terminal import InputError, require_place

if TYPE_CHECKING:
    from icofabric_sim.pictures.camera import View

_MIN_PIXELS, _MAX_PIXELS = 320, 16000  # pixels
_FIGURE_SUFFIXES = ('.png', '.svg')
COLORS = ('strain', 'force', 'speed', 'contact')


def add_picture_arguments(parser: argparse.ArgumentParser, size: str) -> None:
    """Declare the arguments that all pictures of fabrics have in common."""
    parser.add_argument(
        '--size', default=size, metavar='WxH', help='width and height of a picture [pixels] '
                                                    '(%(default)s)')
    parser.add_argument(
        '--camera', '--view', type=float, nargs='+', metavar='ANGLE', dest='camera',
        help='camera direction: AZIMUTH ELEVATION [degrees], from +x towards +y and above '
             'the horizontal, and optionally the distance [m] from the target (default: '
             '-62 16, at the distance at which everything shown fits)')
    parser.add_argument(
        '--color', choices=COLORS, default='strain',
        help='quantity shown by colours: strain or tension of connectors, speed of bodies (for a '
             'recorded run: between its poses), or overlap of shells (%(default)s)')
    parser.add_argument('--title', default='', help='title of the picture (default: the name)')
    parser.add_argument(
        '--bodies', default='', metavar='GROUP',
        help="draw only these bodies: a group of the scene, a selector such as 'level 2', or "
             "numbers such as '0 5 7'; they also determine what fits into the picture")
    parser.add_argument(
        '--follow', default='', metavar='GROUP',
        help='move the camera with the centroid of these bodies')
    parser.add_argument(
        '--from', type=float, metavar='T', dest='start', help='start at this simulated time [s]')
    parser.add_argument(
        '--to', type=float, metavar='T', dest='end', help='end at this simulated time [s]')


@contextmanager
def chosen_bodies_errors() -> Iterator[None]:
    """Report bodies of --bodies and --follow that do not exist as bad input."""
    from icofabric_sim.parameters.validation import ParameterError
    try:
        yield
    except ParameterError as error:
        raise InputError(f'--{error}') from error


def figure_path(
    option: str, text: str | Path, suffixes: Sequence[str] = _FIGURE_SUFFIXES
) -> Path:
    """Return the path of a picture; reject an unwritable place or another format."""
    path = Path(text).expanduser()
    if path.suffix.lower() not in suffixes:
        raise InputError(f'{option} {path}: give a file that ends in {" or ".join(suffixes)}')
    require_library('matplotlib', 'a picture')
    return require_place(option, path)


def picture_path(arguments: argparse.Namespace, name: str) -> Path | None:
    """Return the PNG file that an option names, or None if the option is missing."""
    text = getattr(arguments, name)
    return None if text is None else figure_path(f'--{name}', text, ('.png',))


def picture_size(text: str) -> tuple[int, int]:
    """Return width and height [pixels] of --size."""
    match = re.fullmatch('([0-9]{1,5})[x,]([0-9]{1,5})', text)
    if match is None:
        raise InputError(f'--size must be WIDTHxHEIGHT in pixels, such as 1280x960, got {text!r}')
    size = int(match[1]), int(match[2])
    if not all(_MIN_PIXELS <= side <= _MAX_PIXELS for side in size):
        raise InputError(f'--size must be {_MIN_PIXELS} to {_MAX_PIXELS} pixels, got {text}')
    return size


def camera_view(numbers: list[float] | None) -> 'View | None':
    """Return the view of --camera, or None if the option is missing."""
    if numbers is None:
        return None
    said = ' '.join(f'{number:g}' for number in numbers)
    if len(numbers) not in (2, 3):
        raise InputError(
            '--camera (--view) takes an azimuth and an elevation in degrees, and optionally a '
            f'distance in m, got {said}')
    azimuth, elevation = numbers[:2]
    distance = numbers[2] if len(numbers) == 3 else 0.0
    if not (math.isfinite(azimuth) and abs(elevation) <= 90.0):
        raise InputError(
            '--camera (--view) takes an azimuth and an elevation from -90 to 90 degrees, got '
            f'{said}')
    if len(numbers) == 3 and not 0.0 < distance < math.inf:
        raise InputError(f'--camera (--view) takes a distance above 0 m, got {said}')
    from icofabric_sim.pictures.camera import View
    return View(math.radians(azimuth), math.radians(elevation), distance)


def time_span(arguments: argparse.Namespace, first: float, last: float) -> tuple[float, float]:
    """Return the simulated times [s] of --from and --to within the recorded span."""
    start = first if arguments.start is None else arguments.start
    end = last if arguments.end is None else arguments.end
    near = 0.5e-9
    for option, time in (('--from', start), ('--to', end)):
        if not first - near <= time <= last + near:
            raise InputError(
                f'{option} {time:g} s: the motion lasts from {first:.6g} s to {last:.6g} s; '
                'choose a time in between')
    if not end >= start:
        raise InputError(f'--to {end:g} s is before --from {start:g} s')
    return start, end
