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
"""The argument SCENE with its overrides, for all verbs that take one."""

import argparse
from typing import TYPE_CHECKING

from icofabric_sim.terminal import bad_input

if TYPE_CHECKING:
    from icofabric_sim.parameters.validation import Parameters


def add_scene_arguments(parser: argparse.ArgumentParser, metavar: str = 'SCENE') -> None:
    """Declare SCENE and `-p name:=value`."""
    from icofabric_sim.parameters.ready_scenes import ready_scenes
    names = ', '.join(ready_scenes()) or 'none is installed'
    text = f'parameter file of a scene, or the name of a ready scene ({names})'
    if metavar != 'SCENE':
        text += ', or the folder of a bag'
    parser.add_argument('scene', metavar=metavar, help=text)
    parser.add_argument(
        '-p', '--parameter', metavar='NAME:=VALUE', action='append', default=[],
        help="another value for a parameter of the scene, as after ROS's -p; may be repeated")


def read_parameters(arguments: argparse.Namespace) -> tuple[str, 'Parameters']:
    """Name of the scene, and its parameters with the overrides."""
    from icofabric_sim.parameters.file import load_parameter_file, parse_parameter_override
    from icofabric_sim.parameters.ready_scenes import find_scene
    from icofabric_sim.parameters.validation import make_parameters
    with bad_input():
        path = find_scene(arguments.scene)
        flat = load_parameter_file(path)
        for rule in arguments.parameter:
            name, value = parse_parameter_override(rule)
            flat[name] = value
        return path.stem, make_parameters(flat)
