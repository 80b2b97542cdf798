# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Location of a run's checkpoints: `checkpoint.path`, or beside the bag.

The path is a folder with numbered checkpoints, of which none is overwritten, or a file with the
suffix .checkpoint, which always holds the last one.
"""

from collections.abc import Collection
from pathlib import Path
import re

from icofabric_sim.parameters.validation import Parameters

SUFFIX = '.checkpoint'
_NUMBERED = re.compile(r'([0-9]{1,9})\.checkpoint')


def path_to_save(parameters: Parameters, being_saved: Collection[Path] = ()) -> Path:
    """
    Return the file for the next checkpoint, and create its folder.

    Files in `being_saved`, which may not exist yet, are avoided.
    """
    place = _place(parameters)
    folder = place.parent if place.suffix == SUFFIX else place
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(
            f'checkpoint.path: the folder {folder} cannot be created ({error.strerror}); choose '
            'another one') from error
    if place.suffix == SUFFIX:
        return place
    number = max(_numbers(place), default=0) + 1
    while (path := place / f'{number}{SUFFIX}') in being_saved:
        number += 1
    return path


def path_to_restore(parameters: Parameters) -> Path:
    """Return the file of the last checkpoint; raise ValueError without one."""
    place = _place(parameters)
    if place.suffix == SUFFIX:
        if not place.is_file():
            raise ValueError(f'no checkpoint {place}: call ~/save_checkpoint first')
        return place
    numbers = _numbers(place)
    if not numbers:
        raise ValueError(f'no checkpoint in {place}: call ~/save_checkpoint first')
    return place / f'{max(numbers)}{SUFFIX}'


def _place(parameters: Parameters) -> Path:
    given, bag = parameters['checkpoint.path'], parameters['record.path']
    if given:
        return Path(given).expanduser()
    if bag:
        bag = Path(bag).expanduser()
        return bag.with_name(f'{bag.name}_checkpoints')
    raise ValueError(
        'checkpoint.path is empty: set it to a folder, or to a file '
        f'whose name ends with {SUFFIX}; by default checkpoints are beside the bag of record.path')


def _numbers(folder: Path) -> list[int]:
    try:
        found = [_NUMBERED.fullmatch(path.name) for path in folder.iterdir()]
    except OSError:
        return []
    return [int(match[1]) for match in found if match]
