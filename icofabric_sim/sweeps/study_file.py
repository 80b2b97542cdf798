# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Sweep files in YAML: a scene, varied parameters, verbs and kept results.

    scene: stiff_cantilever
    parameters: {gravity: [0.0, 0.0, 0.0]}
    vary:
      weave.connector_angle: 0.1..0.7/13
      connector.stiffness: [300.0, 500.0]
    verbs: [elasticity]
"""

from collections.abc import Mapping
from pathlib import Path
import re
from typing import Any, NamedTuple

from icofabric_sim.checks import decoded, shown
from icofabric_sim.parameters.example_scenes import example_scenes, find_scene
from icofabric_sim.parameters.file import load_parameter_file
from icofabric_sim.parameters.text import flatten_parameters
import yaml

KEYS = ('scene', 'parameters', 'vary', 'cases', 'sample', 'verbs', 'keep')
_MAX_FILE_BYTES = 16 * 2**20


class SweepFile(NamedTuple):
    """Contents of a sweep file, before validation of the parameters."""

    path: Path
    scene: Path
    parameters: dict[str, Any]  # of the scene, with those of the sweep file
    vary: Any
    cases: Any
    sample: Any
    verbs: Any
    keep: Any


class _Loader(yaml.SafeLoader):
    """SafeLoader that reads 1e-3 as a number and rejects duplicate keys."""


_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'[-+]?(?:\d+\.?\d*|\.\d+)[eE][-+]?\d+$'), list('-+0123456789.'))


def _mapping(loader: Any, node: Any) -> dict[Any, Any]:
    found: dict[Any, Any] = {}
    for key_node, value_node in node.value:
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, str):
            raise ValueError(
                f'line {key_node.start_mark.line + 1}: {shown(key)} must be a string')
        if key in found:
            raise ValueError(f'line {key_node.start_mark.line + 1}: {key} is given twice')
        found[key] = loader.construct_object(value_node, deep=True)
    return found


_Loader.add_constructor('tag:yaml.org,2002:map', _mapping)


def is_sweep_file(path: Path) -> bool:
    """Return True for a sweep file; a parameter file of ROS starts with node names."""
    if path.suffix not in ('.yaml', '.yml') or not path.is_file():
        return False
    try:
        return re.search(
            rf'^(?:{"|".join(KEYS)})\s*:', path.read_text('utf-8'), re.MULTILINE) is not None
    except (OSError, UnicodeDecodeError):
        return False


def parse_yaml(text: str) -> Any:
    """Parse YAML by the rules of sweep files."""
    return yaml.load(text, _Loader)


def read_sweep_file(path: Path) -> SweepFile:
    """Read a sweep file. Raise ValueError that names the file and the reason."""
    try:
        return _read(path)
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from error


def _read(path: Path) -> SweepFile:
    if path.stat().st_size > _MAX_FILE_BYTES:
        raise ValueError(
            f'the file is larger than {_MAX_FILE_BYTES:,} bytes, the limit of a sweep file')
    try:
        said = parse_yaml(decoded(path.read_bytes()))
    except yaml.YAMLError as error:
        raise ValueError(f'this is not YAML: {" ".join(str(error).split())}') from error
    if not isinstance(said, Mapping):
        raise ValueError(f'must be a mapping with the keys {", ".join(KEYS)}, got {shown(said)}')
    unknown = [name for name in said if name not in KEYS]
    if unknown:
        raise ValueError(
            f'unknown key {unknown[0]}; the keys are {", ".join(KEYS)}')
    if not isinstance(said.get('scene'), str):
        raise ValueError(
            'scene is missing: the name of an example scene, or a parameter file in this folder')
    name = said['scene']
    scene = find_scene(name if name in example_scenes() else str(path.parent / name))
    given = dict(load_parameter_file(scene))
    if said.get('parameters') is not None:
        given.update(flatten_parameters(said['parameters']))
    return SweepFile(
        path, scene, given, said.get('vary'), said.get('cases'), said.get('sample'),
        said.get('verbs', ['run']), said.get('keep'))
