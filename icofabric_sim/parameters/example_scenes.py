# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Find the example scenes in a clone or in the share folder of an installation."""

import difflib
from pathlib import Path

_PACKAGE = 'icofabric_sim'


def example_scenes() -> dict[str, Path]:
    """Return the parameter file of every example scene by name; empty if none is installed."""
    for folder in scene_folders():
        found = {path.stem: path for path in sorted(folder.glob('*.yaml'))}
        if found:
            return found
    return {}


def find_scene(scene: str) -> Path:
    """
    Return the parameter file of an example scene or path; scene names take precedence.

    Raises ValueError if there is no such scene or file.
    """
    examples = example_scenes()
    if scene in examples:
        return examples[scene]
    path = Path(scene).expanduser()
    if not path.is_file():
        reason = 'is a folder' if path.is_dir() else 'does not exist'
        names = ', '.join(examples) or 'none is installed'
        raise ValueError(
            f'{scene} {reason}: {suggest_scene(scene)}give the parameter file (.yaml) of a scene, '
            f'or the name of an example scene ({names})'
        )
    return path


def suggest_scene(scene: str) -> str:
    """Return a question that suggests the example scene with the nearest name, or ''."""
    near = difflib.get_close_matches(scene, example_scenes(), 1)
    return f'did you mean {near[0]}? ' if near else ''


def scene_folders() -> list[Path]:
    """
    Return the folders that may hold example scenes, the source tree first.

    Installations by colcon, by pip and into a virtual environment have the folder
    PREFIX/share/icofabric_sim/config and the package PREFIX/.../site-packages/icofabric_sim.
    """
    file = Path(__file__)
    here, real = file.absolute().parents[1], file.resolve().parents[1]
    trees = [place.parent for place in (here, real)]
    folders = [tree / 'config' for tree in trees if (tree / 'package.xml').is_file()]
    for place in (here, real):
        folders += [parent / 'share' / _PACKAGE / 'config' for parent in place.parents]
    return folders
