# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Where a running fabric keeps its checkpoints: `checkpoint.path`, or beside its bag.

The path is a folder, in which checkpoints are numbered and none is overwritten, or a file whose
name ends with .checkpoint, which always holds the last one.
"""

from collections.abc import Collection
from pathlib import Path
import re

from icofabric_sim.parameters.validation import Parameters

SUFFIX = '.checkpoint'
_NUMBERED = re.compile(r'([0-9]{1,9})\.checkpoint')


def path_to_save(parameters: Parameters, being_saved: Collection[Path] = ()) -> Path:
    """
    Return the file that the next checkpoint goes to; its folder is made.

    None of those `being_saved`, which may not be there yet.
    """
    place = _place(parameters)
    folder = place.parent if place.suffix == SUFFIX else place
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(
            f'checkpoint.path: the folder {folder} cannot be made ({error.strerror}); choose '
            'another one') from error
    if place.suffix == SUFFIX:
        return place
    number = max(_numbers(place), default=0) + 1
    while (path := place / f'{number}{SUFFIX}') in being_saved:
        number += 1
    return path


def path_to_restore(parameters: Parameters) -> Path:
    """Return the file of the last checkpoint; ValueError where there is none."""
    place = _place(parameters)
    if place.suffix == SUFFIX:
        if not place.is_file():
            raise ValueError(f'there is no checkpoint {place}: ~/save_checkpoint makes it')
        return place
    numbers = _numbers(place)
    if not numbers:
        raise ValueError(f'there is no checkpoint in {place}: ~/save_checkpoint makes one')
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
        f'whose name ends with {SUFFIX}; without it they lie beside the bag of record.path')


def _numbers(folder: Path) -> list[int]:
    try:
        found = [_NUMBERED.fullmatch(path.name) for path in folder.iterdir()]
    except OSError:
        return []
    return [int(match[1]) for match in found if match]
