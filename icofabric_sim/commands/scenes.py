# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Argument SCENE with its overrides, for the verbs that take a scene."""

import argparse
from collections.abc import Sequence
from pathlib import Path
import re
from typing import TYPE_CHECKING

from icofabric_sim.parameters.example_scenes import example_scenes, find_scene
from icofabric_sim.terminal import bad_input, InputError

if TYPE_CHECKING:
    from icofabric_sim.parameters.validation import Parameters
    import yaml


def add_scene_arguments(
    parser: argparse.ArgumentParser, metavar: str = 'SCENE', alternative: str = ''
) -> None:
    """Declare SCENE (or another kind of input, `alternative`) and `-p name:=value`."""
    names = ', '.join(example_scenes()) or 'none is installed'
    text = f'parameter file of a scene, or the name of an example scene ({names})'
    if alternative:
        text += f', or {alternative}'
    parser.add_argument('scene', metavar=metavar, help=text)
    parser.add_argument(
        '-p', '--parameter', metavar='NAME:=VALUE', action='append', default=[],
        help='parameter override, as with -p in ROS; may be repeated')


def read_parameters(arguments: argparse.Namespace) -> tuple[str, 'Parameters']:
    """Return the name of the scene and its parameters with the overrides."""
    from icofabric_sim.parameters.file import load_parameter_file, parse_parameter_override
    from icofabric_sim.parameters.validation import make_parameters
    with bad_input():
        path = find_scene(arguments.scene)
        flat = load_parameter_file(path)
        for rule in arguments.parameter:
            name, value = parse_parameter_override(rule)
            flat[name] = value
        return path.stem, make_parameters(flat)


_DOTTED = re.compile(r'[a-z]\w*(?:\.[A-Za-z_]\w*)+(?=[:, ])')


def located(error: InputError, scene: str, given: Sequence[str] = ()) -> InputError:
    """
    Return the error with the line of the scene file that it concerns, if known.

    `given` are the parameters `NAME:=VALUE` of the command line that replace values of the file.
    """
    from icofabric_sim.parameters.validation import ParameterError
    cause = error.__cause__
    # Errors of code without parameters start with the name of a parameter.
    begun = _DOTTED.match(str(error))
    name = cause.name if isinstance(cause, ParameterError) else begun[0] if begun else ''
    if (not scene or not name or not isinstance(cause, ValueError)
            or name in {words.partition(':=')[0] for words in given}):
        return error
    try:
        path = find_scene(scene)
        line = line_of(path, name)
    except (ValueError, OSError):
        return error
    return InputError(f'{error} ({path}, line {line})') if line else error


def line_of(path: Path, name: str) -> int:
    """Return the line of a parameter file that sets a parameter or its nearest parent; 0: none."""
    import yaml
    try:
        root = yaml.compose(path.read_text('utf-8'), yaml.SafeLoader)
    except yaml.YAMLError:
        return 0
    found = (0, 0)  # depth, line
    for _, section in getattr(root, 'value', []):
        for key, parameters in getattr(section, 'value', []):
            if key.value == 'ros__parameters':
                found = max(found, _deepest(parameters, name, 0))
    return found[1]


def _deepest(node: 'yaml.Node', name: str, depth: int) -> tuple[int, int]:
    """Return depth and line of the longest prefix of a dotted name below a node."""
    best = (0, 0)
    for key, value in node.value if isinstance(node.value, list) else []:
        word = str(getattr(key, 'value', ''))
        if name == word or name.startswith(f'{word}.'):
            here = (depth + 1, key.start_mark.line + 1)
            rest = name[len(word) + 1:]
            below = _deepest(value, rest, depth + 1) if rest and isinstance(
                value.value, list) and value.id == 'mapping' else (0, 0)
            best = max(best, here, below)
    return best
