# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric render BAG`."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from icofabric_sim.commands.bags import bag_errors, bag_path
from icofabric_sim.commands.picture_arguments import (
    add_picture_arguments,
    camera_view,
    chosen_bodies_errors,
    picture_path,
    picture_size,
    time_span,
)
from icofabric_sim.libraries import require_library
from icofabric_sim.terminal import InputError, Progress, require_place

if TYPE_CHECKING:
    import numpy as np

_DEFAULT_COUNT = 8
_FILES = (
    '.avi', '.gif', '.jpeg', '.jpg', '.mkv', '.mov', '.mp4', '.pdf', '.png', '.svg', '.webm')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument('bag', metavar='BAG', help='folder of a recorded run, or its file')
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        '--frames', type=int, metavar='N',
        help=f'N frames spread evenly over the run (default: {_DEFAULT_COUNT})')
    which.add_argument(
        '--every', type=float, metavar='S', help='one frame every S seconds of simulated time')
    which.add_argument(
        '--times', type=float, nargs='+', metavar='T',
        help='frames at these simulated times [s]; each shows the nearest recorded poses')
    parser.add_argument(
        '--sheet', metavar='FILE', help='draw the frames side by side into this PNG')
    parser.add_argument(
        '--output', metavar='DIR',
        help='folder for frame_0001.png, ... (default: BAG_frames, unless --sheet is given)')
    add_picture_arguments(parser, '1280x960')


def main(arguments: argparse.Namespace) -> int:
    """Draw frames, a sheet, or both."""
    size = picture_size(arguments.size)
    view = camera_view(arguments.camera)
    path = bag_path(arguments.bag)
    sheet = picture_path(arguments, 'sheet')
    if arguments.output:
        if Path(arguments.output).suffix.lower() in _FILES:
            raise InputError(
                f'--output {arguments.output} looks like a file, but must be a folder for frames; '
                'give a name without this ending, or --sheet FILE.png for a single picture')
        require_place('--output', Path(arguments.output).expanduser(), is_folder=True)
    require_library('matplotlib', 'a picture')
    from icofabric_sim.bag import next_free_path
    from icofabric_sim.bag.recorded_run import RecordedRun
    from icofabric_sim.pictures.render import RunPictures

    with bag_errors(path), RecordedRun(path) as run:
        recorded = run.pose_times()
        times = _times(arguments, recorded)
        with chosen_bodies_errors():
            pictures = RunPictures(
                run, times, view=view, size=size, title=arguments.title, color=arguments.color,
                bodies=arguments.bodies, follow=arguments.follow)
        if sheet is not None:
            sheet.parent.mkdir(parents=True, exist_ok=True)
            pictures.sheet(sheet)
            print(f'{len(times)} frames in {sheet}')
        if arguments.output or sheet is None:
            folder = Path(arguments.output).expanduser() if arguments.output else next_free_path(
                path.absolute().with_name(f'{path.stem if path.is_file() else path.name}_frames'))
            if folder.exists() and any(folder.glob('frame_*.png')):
                raise InputError(
                    f'--output {folder} already contains frames, which would be mixed; choose '
                    'another folder')
            with Progress(len(times), 'frames') as progress:
                drawn = pictures.frames(folder, progress=progress.update)
            print(f'{len(drawn)} frames in {folder}')
    return 0


def _times(arguments: argparse.Namespace, recorded: 'np.ndarray') -> 'np.ndarray':
    """Return the recorded times [ns] of the requested frames."""
    from icofabric_sim.pictures.render import nearest_times, spread_times
    import numpy as np
    if not len(recorded):
        raise InputError(f'{arguments.bag} contains no poses to draw')
    start, end = time_span(arguments, float(recorded[0]) / 1e9, float(recorded[-1]) / 1e9)
    recorded = recorded[(recorded >= 1e9 * start - 0.5) & (recorded <= 1e9 * end + 0.5)]
    if not len(recorded):
        raise InputError(
            f'no poses were recorded from {start:g} s to {end:g} s: choose a longer span')
    first, last = int(recorded[0]), int(recorded[-1])
    span = f'the run was recorded from {first / 1e9:.6g} s to {last / 1e9:.6g} s'
    if arguments.times is not None:
        for time in arguments.times:
            if not first - 0.5e-9 <= time * 1e9 <= last + 0.5e-9:
                raise InputError(f'--times {time:g} s: {span}; choose times in between')
        return nearest_times(recorded, np.array(arguments.times) * 1e9)
    if arguments.every is not None:
        if not 0.0 < arguments.every < math.inf:
            raise InputError(f'--every must be above 0 s, got {arguments.every:g} s')
        intervals = (last - first) / 1e9 / arguments.every + 1e-9
        if intervals >= len(recorded):
            return recorded
        count = int(intervals)
        return nearest_times(recorded, first + arguments.every * 1e9 * np.arange(count + 1))
    count = _DEFAULT_COUNT if arguments.frames is None else arguments.frames
    if not count >= 1:
        raise InputError(f'--frames must be at least 1, got {count}')
    return spread_times(recorded, count)
